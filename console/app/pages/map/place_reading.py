"""Words the map's values at one position and the state of the whole job. Pure."""

from __future__ import annotations

from typing import NamedTuple

from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.map_camera import PixelGrid
from topdress.console.app.map_image import GroundPixels
from topdress.console.app.map_layers import MapLayer
from topdress.console.app.overlay_file import OverlayView
from topdress.console.app.panel_views import (
    AgedText,
    ItemView,
    find_rate_error,
    format_signed_percent,
    format_time_left,
)
from topdress.console.app.remaining_work import estimate_remaining
from topdress.console.app.units import Units
from topdress.console.frame import Frame
from topdress.console.locale import _


class ReadingPart(NamedTuple):
    """Holds a label and a text."""

    label: str
    text: str


class PlaceReading(NamedTuple):
    """Holds the reading at a position; the most important parts come first."""

    where: str
    parts: tuple[ReadingPart, ...]


def make_place_reading(
    where: str,
    place: tuple[float, float] | None,
    metres: float,
    worked: WorkedGround,
    picture: FieldPicture | None,
    units: Units,
    laid: OverlayView | None = None,
) -> PlaceReading:
    """Return the means over one pixel at a position.

    Parameters
    ----------
    where
        Kind of position, in words.
    place
        East and north, m.
    metres
        Side of the pixel, m.
    worked
        Ground worked so far.
    picture
        Static parts of the map, or None.
    units
        Units of the texts.
    laid
        Overlaid file, or None.
    """
    if place is None:
        return PlaceReading(_("no position yet"), ())
    # The pixel is centred on the position.
    half = 0.5 * metres
    pixel = PixelGrid(1, 1, metres, place[0] - half, place[1] + half)
    here = GroundPixels(worked, pixel)
    applied, target, ndvi, passes = (
        # Only NaN differs from itself.
        None if (value := float(here.calc_means(layer)[0, 0])) != value else value
        for layer in (MapLayer.APPLIED, MapLayer.TARGET, MapLayer.NDVI, MapLayer.PASSES)
    )
    planned = (
        picture.planned.find_rate(*place)
        if picture is not None and picture.planned is not None
        else None
    )
    # The same formula as on the Run page.
    error = find_rate_error(target, applied)
    parts = [
        ReadingPart(_("applied"), units.rate.format_with_name(applied)),
        ReadingPart(_("target"), units.rate.format_with_name(target)),
    ]
    if laid is not None:
        value = float(GroundPixels(laid.worked, pixel).calc_means(laid.scale.layer)[0, 0])
        said = laid.scale.format_value(None if value != value else value)
        parts.append(ReadingPart(_("file"), f"{said} {laid.scale.unit}".rstrip()))
    if picture is not None and picture.planned is not None:
        parts.append(ReadingPart(_("planned"), units.rate.format_with_name(planned)))
    # The panel drops parts from the end where the row is too short.
    parts += [
        ReadingPart(_("error"), "--" if error is None else format_signed_percent(100.0 * error)),
        ReadingPart("NDVI", "--" if ndvi is None else f"{ndvi:.2f}"),
        ReadingPart(_("passes"), "--" if passes is None else f"{passes:.2g}"),
        ReadingPart(_("east"), units.distance.format_with_name(place[0])),
        ReadingPart(_("north"), units.distance.format_with_name(place[1])),
    ]
    return PlaceReading(where, tuple(parts))


def list_job_items(
    frame: Frame | None, picture: FieldPicture | None, units: Units, stale: bool
) -> tuple[ItemView, ...]:
    """Return area and product done and remaining. The remaining product follows the plan, else the
    mean rate so far."""
    if frame is None:
        return ()
    # Without a boundary no share can be given.
    work_ha = picture.work_ha if picture is not None else None
    left = estimate_remaining(frame, picture)
    # Overlap can make the worked area larger than the field.
    share = f"  {100.0 * min(1.0, frame.area_ha / work_ha):.0f} %" if work_ha else ""
    row = frame.row
    return tuple(
        ItemView(label, AgedText(text, stale))
        for label, text in (
            (_("done"), f"{units.area.format_with_name(frame.area_ha)}{share}"),
            (_("left"), units.area.format_with_name(left.area_ha)),
            (
                _("time left"),
                f"{format_time_left(left.time_s)}  "
                f"{units.choose_way_unit(left.way_m).format_with_name(left.way_m)}",
            ),
            (_("applied"), units.mass.format_with_name(frame.applied_kg)),
            (_("still needed"), units.mass.format_with_name(left.product_kg)),
            (_("in hopper"), units.mass.format_with_name(row.hopper_kg)),
            (_("mean"), units.rate.format_with_name(frame.mean_rate_kg_ha)),
            (
                _("speed"),
                units.speed.format_with_name(
                    # The controller's own speed comes first, because it determines the rate.
                    row.speed_used_mps if row.speed_used_mps is not None else row.speed_mps
                ),
            ),
        )
    )
