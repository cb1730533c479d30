"""What a map says of one place and of the whole job, in words. Pure."""

from __future__ import annotations

from typing import NamedTuple

from topdress.console.app.camera import Pixels
from topdress.console.app.coverage_raster import Worked
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.layers import MapLayer
from topdress.console.app.map_image import Ground
from topdress.console.app.overlay_file import LaidView
from topdress.console.app.remaining_work import remaining_work
from topdress.console.app.units import Units
from topdress.console.app.view import Item, Shown, duration, find_rate_error, signed_percent
from topdress.console.frame import Frame
from topdress.console.locale import _


class ReadingPart(NamedTuple):
    label: str
    text: str


class PlaceReading(NamedTuple):
    """where: what the place is; parts: the important ones first."""

    where: str
    parts: tuple[ReadingPart, ...]


def reading(
    where: str,
    place: tuple[float, float] | None,
    metres: float,
    worked: Worked,
    picture: FieldPicture | None,
    units: Units,
    laid: LaidView | None = None,
) -> PlaceReading:
    """The means over one pixel at a place."""
    if place is None:
        return PlaceReading(_("no position yet"), ())
    half = 0.5 * metres
    pixel = Pixels(1, 1, metres, place[0] - half, place[1] + half)
    here = Ground(worked, pixel)
    applied, target, ndvi, passes = (
        None if (value := float(here.layer(layer)[0, 0])) != value else value
        for layer in (MapLayer.APPLIED, MapLayer.TARGET, MapLayer.NDVI, MapLayer.PASSES)
    )
    planned = (
        picture.planned.at(*place) if picture is not None and picture.planned is not None else None
    )
    error = find_rate_error(target, applied)
    parts = [
        ReadingPart(_("applied"), units.rate.full(applied)),
        ReadingPart(_("target"), units.rate.full(target)),
    ]
    if laid is not None:
        value = float(Ground(laid.worked, pixel).layer(laid.scale.layer)[0, 0])
        said = laid.scale.text(None if value != value else value)
        parts.append(ReadingPart(_("file"), f"{said} {laid.scale.unit}".rstrip()))
    if picture is not None and picture.planned is not None:
        parts.append(ReadingPart(_("planned"), units.rate.full(planned)))
    parts += [
        ReadingPart(_("error"), "--" if error is None else signed_percent(100.0 * error)),
        ReadingPart("NDVI", "--" if ndvi is None else f"{ndvi:.2f}"),
        ReadingPart(_("passes"), "--" if passes is None else f"{passes:.2g}"),
        ReadingPart(_("east"), units.distance.full(place[0])),
        ReadingPart(_("north"), units.distance.full(place[1])),
    ]
    return PlaceReading(where, tuple(parts))


def list_job_items(
    frame: Frame | None, picture: FieldPicture | None, units: Units, stale: bool
) -> tuple[Item, ...]:
    """Area and product done and left. What is left of the product: the plan's, else the mean so
    far on what is left."""
    if frame is None:
        return ()
    field_ha = picture.area_ha if picture is not None else None
    left = remaining_work(frame, picture)
    time_left = "--" if left.time_s is None else duration(left.time_s)
    share = f"  {100.0 * min(1.0, frame.area_ha / field_ha):.0f} %" if field_ha else ""
    row = frame.row
    return tuple(
        Item(label, Shown(text, stale))
        for label, text in (
            (_("done"), f"{units.area.full(frame.area_ha)}{share}"),
            (_("left"), units.area.full(left.area_ha)),
            (_("time left"), f"{time_left}  {units.way(left.way_m).full(left.way_m)}"),
            (_("applied"), units.mass.full(frame.applied_kg)),
            (_("still needed"), units.mass.full(left.product_kg)),
            (_("in hopper"), units.mass.full(row.hopper_kg)),
            (_("mean"), units.rate.full(frame.mean_rate_kg_ha)),
            (
                _("speed"),
                units.speed.full(
                    row.speed_used_mps if row.speed_used_mps is not None else row.speed_mps
                ),
            ),
        )
    )
