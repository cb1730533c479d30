"""How is a field of a file, in degrees, converted to the field of a job, on its plane, and back?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from topdress.control.field.boundary import Boundary, find_largest_part
from topdress.control.field.job import Ground, GuidanceLine
from topdress.control.geodesy import TangentPlane
from topdress.control.recordings.finding import Finding
from topdress.control.targets.rate_map import Floats
from topdress.drivers.plain_text import OneLineError

# Difference of widths, m, up to which a headland counts as equally wide.
MAX_HEADLAND_WIDTH_DIFFERENCE_M = 0.5
# Difference of headings, degrees, up to which lines count as parallel: 0.2 m over 100 m.
MAX_PARALLEL_DIFFERENCE_DEG = 0.1


class FieldError(OneLineError):
    """Reports an unusable field; the line names the reason."""


class FieldLine(NamedTuple):
    """Holds a guidance line: `places_deg` (k, 2) latitude and longitude, with two positions for a
    straight line."""

    title: str
    places_deg: Floats


@dataclass(frozen=True, eq=False)
class FieldData:
    """Holds a field in degrees. `outline_deg` (k, 2) is latitude and longitude, not closed;
    `holes_deg` are areas in the field that are not worked."""

    title: str
    outline_deg: Floats | None = None
    holes_deg: tuple[Floats, ...] = ()
    lines: tuple[FieldLine, ...] = ()
    headland_m: float | None = None
    findings: tuple[Finding, ...] = ()

    def plane(self) -> TangentPlane:
        """Returns a plane in the middle of the outline, or of the first line. Raises FieldError for
        a field with neither."""
        # A plane in the middle of the outline has the smallest distortion.
        if self.outline_deg is not None:
            places = self.outline_deg
        elif self.lines:
            places = self.lines[0].places_deg
        else:
            raise FieldError(f"{self.title}: neither an outline nor a line")
        lat, lon = places.mean(axis=0)
        # With seven decimals (1 cm) the origin reads back as it was written.
        return TangentPlane(round(float(lat), 7), round(float(lon), 7))

    def boundary(self, plane: TangentPlane) -> Boundary | None:
        """Returns the outline on a plane, m; None without an outline. Raises ValueError."""
        if self.outline_deg is None:
            return None
        return Boundary(
            _find_places_m(plane, self.outline_deg),
            [_find_places_m(plane, hole) for hole in self.holes_deg],
        )


def repair_outline(data: FieldData, path: Path, largest: bool) -> FieldData:
    """Returns the field with an outline whose edges do not cross.

    Parameters
    ----------
    data : the field.
    path : its file, for messages.
    largest : whether the largest part of a crossing outline is used.

    Returns
    -------
    the same field where no edges cross.

    Raises
    ------
    FieldError : edges cross, and `largest` is False.
    """
    if data.outline_deg is None:
        return data
    plane = data.plane()
    drawn = shapely.Polygon(_find_places_m(plane, data.outline_deg))
    # The largest part is computed once, because both the message and the repair need it.
    part = find_largest_part(drawn)
    if drawn.is_valid or not part.area:
        return data
    # GEOS reports the place as `Self-intersection[east north]`.
    east, north = map(float, shapely.is_valid_reason(drawn).partition("[")[2].rstrip("]").split())
    said = (
        f"{part.area / 1e4:.4f} of the {shapely.make_valid(drawn).area / 1e4:.4f} ha that "
        "it encloses"
    )
    # Only the user can know whether the smaller parts belong to the field.
    if not largest:
        lat, lon = plane.convert_to_deg(east, north)
        raise FieldError(
            f"{path}: the outline crosses itself at {lat:.6f}, {lon:.6f}: allowed are edges "
            "that do not "
            f"cross; --largest takes its largest part, {said}"
        )

    def degrees(ring: shapely.LinearRing) -> Floats:
        return np.array([plane.convert_to_deg(*place) for place in ring.coords[:-1]])

    # Holes in the removed parts would be outside of the repaired outline.
    holes = [
        hole
        for hole in data.holes_deg
        if part.contains(shapely.Polygon(_find_places_m(plane, hole)))
    ]
    found = Finding("crossing", f"the outline crosses itself: its largest part is taken, {said}")
    return replace(
        data,
        outline_deg=degrees(part.exterior),
        # A repair may make new holes where the outline encloses an area twice.
        holes_deg=(*holes, *map(degrees, part.interiors)),
        findings=(*data.findings, found),
    )


def _find_places_m(plane: TangentPlane, degrees: Floats) -> list[tuple[float, float]]:
    return [
        (float(east), float(north))
        for east, north in plane.project_many_to_m(degrees[:, 0], degrees[:, 1])
    ]


def build_job_ground(data: FieldData, before: Ground, line: str | None = None) -> Ground:
    """Returns the job's field with this outline and these lines; properties that the file does not
    contain are kept.

    Parameters
    ----------
    data : the field of a file, degrees.
    before : the job's field so far.
    line : title of the line that defines the heading of the passes, where several differ.

    Returns
    -------
    the job's field, m on its plane.

    Raises
    ------
    FieldError : lines have several headings and none is chosen, or the outline is unusable.
    """
    # Without a new outline the job's plane is kept, so that its other positions stay valid.
    if data.outline_deg is None and before.boundary_m:
        plane = TangentPlane(before.origin_lat_deg, before.origin_lon_deg)
    else:
        plane = data.plane()
    changes: dict[str, object] = {"origin_lat_deg": plane.lat_deg, "origin_lon_deg": plane.lon_deg}
    try:
        boundary = data.boundary(plane)
    except ValueError as error:
        raise FieldError(f"{data.title}: {error}") from None
    if boundary is not None and data.outline_deg is not None:
        changes |= {
            # A file without a title must not remove the title of the job.
            "title": data.title or before.title,
            "boundary_m": tuple(_round_places(plane, data.outline_deg)),
            "holes_m": tuple(tuple(_round_places(plane, hole)) for hole in data.holes_deg),
        }
    if data.lines:
        changes["lines"] = tuple(
            # Titles in job files are limited to 80 letters.
            GuidanceLine(title=one.title[:80], points_m=tuple(_round_places(plane, one.places_deg)))
            for one in data.lines
        )
        changes["pass_heading_deg"] = _find_pass_heading(data, plane, line)
    if data.headland_m is not None:
        # Job files hold headlands to the centimetre.
        changes["headland_m"] = round(data.headland_m, 2)
    return Ground.model_validate(before.model_dump() | changes)


def _round_places(plane: TangentPlane, degrees: Floats) -> list[tuple[float, float]]:
    """Returns positions rounded to 0.1 mm, m east and north."""
    # Four decimals of a metre are finer than any position of a machine.
    return [(round(east, 4), round(north, 4)) for east, north in _find_places_m(plane, degrees)]


def _find_pass_heading(data: FieldData, plane: TangentPlane, wanted: str | None) -> float:
    """Returns the heading of the passes, degrees from north. Raises FieldError where lines
    differ."""
    headings = {}
    for one in data.lines:
        # The direction from the first to the last point also suits curved lines.
        (east, north), (to_east, to_north) = (
            _find_places_m(plane, one.places_deg)[k] for k in (0, -1)
        )
        headings[one.title] = math.degrees(math.atan2(to_east - east, to_north - north)) % 360.0
    if wanted is not None:
        if wanted not in headings:
            raise FieldError(f"{data.title}: line {wanted}: allowed {', '.join(headings)}")
        # Rounding may give 360 degrees, which is not a valid heading.
        return round(headings[wanted], 4) % 360.0
    first = next(iter(headings.values()))
    # Lines in opposite directions are parallel too.
    off = max(abs((one - first + 90.0) % 180.0 - 90.0) for one in headings.values())
    if off > MAX_PARALLEL_DIFFERENCE_DEG:
        said = ", ".join(f"{title} ({heading:.1f} deg)" for title, heading in headings.items())
        # The message lists all headings, so that the user can choose.
        raise FieldError(
            f"{data.title}: {len(headings)} lines run different ways: {said}: --line says which"
        )
    return round(first, 4) % 360.0


def build_field_data(ground: Ground, title: str) -> FieldData:
    """Returns the job's field in degrees. Raises FieldError for a job without a field."""
    if not ground.boundary_m and not ground.lines:
        raise FieldError(
            f"{title}: the job has no field and no line: allowed is one with boundary_m or lines"
        )
    plane = TangentPlane(ground.origin_lat_deg, ground.origin_lon_deg)

    def degrees(places: Sequence[tuple[float, float]]) -> Floats:
        return np.array([plane.convert_to_deg(*place) for place in places])

    return FieldData(
        ground.title or title,
        degrees(ground.boundary_m) if ground.boundary_m else None,
        tuple(degrees(hole) for hole in ground.holes_m),
        tuple(FieldLine(one.title, degrees(one.points_m)) for one in ground.lines),
        # A headland of zero width means that the job has none.
        ground.headland_m or None,
    )


def calc_headland_width_m(outline_m: Floats, inner_m: Floats) -> tuple[float, float, float]:
    """Returns the width of a headland.

    Parameters
    ----------
    outline_m : (k, 2) corners of the field, m.
    inner_m : (n, 2) points of the headland's inner line, m.

    Returns
    -------
    median, smallest and largest distance from the outline, m.
    """
    edge = shapely.LinearRing(outline_m)
    away = shapely.distance(shapely.points(inner_m), edge)
    # The median ignores the corners, where the distance is larger.
    return float(np.median(away)), float(away.min()), float(away.max())
