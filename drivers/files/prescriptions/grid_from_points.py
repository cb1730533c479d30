"""How do points with a rate each, the centres of equal cells, become a prescription?

The cells follow from the points alone: rows and columns at a right angle, at any heading, regular
in metres or in degrees. Points that form no grid are refused, because a point without its cell
covers no ground.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from topdress.control.geodesy import TangentPlane
from topdress.control.recordings.finding import Finding, many
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.columns import list_known_or_none
from topdress.drivers.files.imports.cell_numbers import parse_number_column
from topdress.drivers.files.imports.column_vocabulary import (
    find_subject,
    fold_column_name,
    has_places_without_time,
    has_time_column,
)
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.imports.mapping import Source
from topdress.drivers.files.imports.raw_table import RawTable
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.prescriptions.features import Feature, build_imported_map
from topdress.drivers.files.prescriptions.map_choices import (
    ImportedMap,
    NotAMapError,
    PrescriptionError,
    RateChoice,
    RateQuestion,
    check_degrees,
)
from topdress.drivers.files.prescriptions.map_projection import TransverseMercator
from topdress.drivers.files.stated_units import StatedUnit
from topdress.drivers.plain_text import Reason

# Four points, two rows of two, show both spacings.
MIN_POINT_COUNT = 4
# Names of columns of positions in metres, as kriging programs write them.
EAST_NAMES = frozenset("x easting east x_utm utm_x utm_e x_m east_m x_coord xcoord point_x".split())
NORTH_NAMES = frozenset(
    "y northing north y_utm utm_y utm_n y_m north_m y_coord ycoord point_y".split()
)
# A UTM zone with its hemisphere: 32N.
_UTM_ZONE = re.compile(r"^\s*(\d{1,2})\s*([NS])\s*$", re.IGNORECASE)
# A number such as 1.234, which means 1234 next to decimal commas.
_THOUSANDS = re.compile(r"^\s*([-+]?\d{1,3})\.(\d{3})\s*$")
# Distance below which points are at the same position, m.
SAME_PLACE_M = 0.01
# Share of a cell by which a point may deviate from its centre, because degrees are rounded.
MAX_CENTRE_OFFSET_CELLS = 0.25
# Share of the nearest points' distance above which a step leads to the next row.
NEXT_ROW_DISTANCE_SHARE = 0.3
# Share of the points that must have a neighbour in their row, and in their column.
MIN_SHARE_WITH_NEIGHBOURS = 0.8
# Radius in cells around the middle on which the grid is fitted first; the radius doubles in each
# round.
FIRST_FIT_RADIUS_CELLS = 4.0
# Ratio of length to width of a cell above which the points are tracks of a machine.
MAX_CELL_LENGTH_TO_WIDTH = 10.0


class PointGrid(NamedTuple):
    """Holds a grid: cell (i, j) has its centre at origin + i along + j aside, m. `cells` (n, 2) are
    the integers (i, j) of each point."""

    origin: Floats
    along: Floats
    aside: Floats
    cells: NDArray[np.int64]
    # Largest deviation of a point from its cell's centre, as a share of a cell.
    off: float

    @property
    def size_m(self) -> tuple[float, float]:
        """Length and width of a cell, m."""
        return float(np.hypot(*self.along)), float(np.hypot(*self.aside))


class NoGridError(ValueError):
    """Reports why the points form no grid, as part of a sentence."""

    def __init__(self, text: str, **values: object) -> None:
        self.reason = Reason(text, values)
        super().__init__(str(self.reason))


def read_point_grid(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of points. Raises PrescriptionError, OSError."""
    try:
        raw = read_raw_table(path, Source(inside=choice.inside))
    except TableError as trouble:
        raise PrescriptionError(trouble.where, "{why}", why=trouble.reasons[0]) from None
    # Degrees are preferred; metres are used only in a table without degrees.
    metres = find_metre_columns(raw.names)
    if metres is None and not has_places_without_time(raw.names):
        raise NotAMapError(
            path,
            "columns {columns_there}: allowed are latitude, longitude and a rate without times, or "
            "polygons (WKT)",
            " (a log is read by topdress import)",
            columns_there=", ".join(raw.names[:12]),
        )
    if metres is None:
        lat, lon = (_read_place_column(raw, column) for column in ("lat_deg", "lon_deg"))
    else:
        lat, lon = _convert_utm_places(path, raw, metres, choice.zone)
    # Points without a position are counted and reported.
    known = np.isfinite(lat) & np.isfinite(lon)
    rows = np.flatnonzero(known)
    if not len(rows):
        raise PrescriptionError(path, "no point with latitude and longitude: allowed are degrees")
    lat, lon = lat[rows], lon[rows]
    # Positions are checked before the fit, whose errors would be harder to understand.
    check_degrees(path, np.column_stack((lat, lon)))
    try:
        found, corners = _build_cells_deg(lat, lon)
    except NoGridError as why:
        raise PrescriptionError(
            path,
            "points with no time form no even lattice ({why}): allowed are the middles of "
            "even cells, or polygons",
            why=why.reason,
        ) from None
    attributes = _read_attributes(raw, metres or ())
    features = [
        # Row numbers are those of the file, so that messages refer to visible rows.
        Feature(raw.first_row + row, attributes[row], [(corners[k],)])
        for k, row in enumerate(rows.tolist())
    ]
    wide, high = found.size_m
    lattice = (
        f"{many(len(rows), 'point')} taken for the middles of cells of {wide:.4g} x {high:.4g} m"
    )
    findings = [*raw.findings, Finding("lattice", lattice)]
    if not known.all():
        findings.append(
            Finding("no_place", f"{many(int((~known).sum()), 'point')} without a place left out")
        )
    units = {
        name.casefold(): StatedUnit(unit, "the file, besides its name")
        for name, unit in raw.units.items()
        # A unit in the name itself is found by the words of the name.
        if unit not in name
    }
    return build_imported_map(
        path, "points", features, choice, findings, title=path.stem, units=units
    )


def _read_place_column(raw: RawTable, column: str) -> Floats:
    """Returns the numbers (n,) of the column of latitudes or longitudes."""
    name = next(
        name
        for name in raw.names
        if (subject := find_subject(fold_column_name(name), None)) is not None
        and subject.reading == column
    )
    return parse_number_column(raw.columns[name], raw.decimal_comma).values


def find_metre_columns(names: Collection[str]) -> tuple[str, str] | None:
    """Returns the columns of positions in metres, east and north, of a table without degrees and
    without times; None without such columns."""
    # A table with times is a log of a machine, whose points form no grid.
    if has_places_without_time(names) or has_time_column(names):
        return None
    found = [
        next((name for name in names if fold_column_name(name) in words), None)
        for words in (EAST_NAMES, NORTH_NAMES)
    ]
    east, north = found
    return None if east is None or north is None else (east, north)


def _convert_utm_places(
    path: Path, raw: RawTable, metres: tuple[str, str], zone: str | None
) -> tuple[Floats, Floats]:
    """Returns latitude and longitude (n,) of positions in UTM. Raises RateQuestion without a zone,
    PrescriptionError for an unknown zone."""
    # The zone cannot be derived from the numbers, because all zones use the same range.
    if zone is None:
        others = [name for name in raw.names if name not in metres]
        raise RateQuestion(
            path,
            "places in metres (columns {east}, {north}) of a zone that is not said: allowed with "
            "the UTM zone",
            f" (--zone 32N or another; --column says which is the rate: {', '.join(others[:12])})",
            east=metres[0],
            north=metres[1],
        )
    found = _UTM_ZONE.match(zone)
    # The earth has 60 zones.
    if found is None or not 1 <= int(found[1]) <= 60:
        raise PrescriptionError(
            path, "zone {zone}: allowed are 1N to 60N and 1S to 60S", zone=zone[:20]
        )
    utm = TransverseMercator(
        f"UTM zone {zone}",
        # UTM has zones of 6 degrees from 180 W, scale 0.9996, and false origins that keep numbers
        # positive.
        6.0 * int(found[1]) - 183.0,
        scale=0.9996,
        false_east=500_000.0,
        false_north=0.0 if found[2].upper() == "N" else 10_000_000.0,
    )
    east, north = (
        parse_number_column(raw.columns[name], raw.decimal_comma).values for name in metres
    )
    return utm.to_deg(east, north)


def _read_attributes(raw: RawTable, places: Collection[str]) -> list[dict[str, object]]:
    """Returns the attributes of each point. In a table with decimal commas a point groups
    digits."""
    attributes = {
        name: list_known_or_none(column)
        for name, column in raw.columns.items()
        if name not in places
        and (
            (subject := find_subject(fold_column_name(name), None)) is None
            or subject.reading not in ("lat_deg", "lon_deg")
        )
    }
    rows: list[dict[str, object]] = [
        dict(zip(attributes, cells, strict=True))
        for cells in zip(*attributes.values(), strict=True)
    ]
    if not raw.decimal_comma:
        return rows
    return [
        {
            # With decimal commas a point in a number groups its digits.
            name: _THOUSANDS.sub(r"\1\2", cell) if isinstance(cell, str) else cell
            for name, cell in row.items()
        }
        for row in rows
    ]


def _build_cells_deg(lat: Floats, lon: Floats) -> tuple[PointGrid, list[Floats]]:
    """Returns the grid, and each point's cell as (4, 2) latitude and longitude. The grid is regular
    in degrees or in metres, whichever fits better. Raises NoGridError."""
    plane = TangentPlane(float(np.mean(lat)), float(np.mean(lon)))
    # The lengths of a small difference in degrees give the scale of the plane.
    east, north = (
        np.array(plane.project_to_m(plane.lat_deg, plane.lon_deg + 1e-4)),
        np.array(plane.project_to_m(plane.lat_deg + 1e-4, plane.lon_deg)),
    )
    per_deg = np.array([east[0], north[1]]) / 1e-4

    def of_degrees(places: Floats) -> Floats:
        return np.column_stack(
            (plane.lat_deg + places[:, 1] / per_deg[1], plane.lon_deg + places[:, 0] / per_deg[0])
        )

    def of_metres(places: Floats) -> Floats:
        return np.array([plane.convert_to_deg(*place) for place in places.tolist()])

    in_degrees = np.column_stack((lon - plane.lon_deg, lat - plane.lat_deg)) * per_deg
    found: list[tuple[PointGrid, Callable[[Floats], Floats]]] = []
    trouble: NoGridError | None = None
    ways: tuple[tuple[Floats, Callable[[Floats], Floats]], ...] = (
        (in_degrees, of_degrees),
        (plane.project_many_to_m(lat, lon), of_metres),
    )
    # Grids are regular in the coordinates of the program that made them, so both are tried.
    for places, back in ways:
        try:
            found.append((fit_point_grid(places), back))
        except NoGridError as why:
            trouble = why
    if not found:
        assert trouble is not None
        raise trouble
    # The smaller deviation shows which coordinates the program used.
    best, to_deg = min(found, key=lambda one: one[0].off)
    # Corners are half a cell away from the centres, and integers make equal corners identical.
    halves = np.concatenate([best.cells + half for half in ((0, 0), (1, 0), (1, 1), (0, 1))])
    # Each corner is computed once, so that cells meet exactly.
    corners, which = np.unique(halves, axis=0, return_inverse=True)
    at = to_deg(
        best.origin + (corners[:, :1] - 0.5) * best.along + (corners[:, 1:] - 0.5) * best.aside
    )
    return best, list(at[which.reshape(4, -1)].transpose(1, 0, 2))


def fit_point_grid(places: Floats) -> PointGrid:
    """Returns the grid of positions (n, 2), m. Raises NoGridError."""
    if len(places) < MIN_POINT_COUNT:
        raise NoGridError(
            "{count} points: {least} are the least", count=len(places), least=MIN_POINT_COUNT
        )
    points = shapely.points(places)
    # A tree finds the nearest neighbours of a large map within a second.
    (of, nearest), near = shapely.STRtree(points).query_nearest(
        points, exclusive=True, return_distance=True
    )
    twice = len(places) - len(np.unique(np.round(places / SAME_PLACE_M), axis=0))
    # Two points at one position would give a cell with two rates.
    if twice:
        raise NoGridError("{count} points share their place with another", count=twice)
    # The median ignores the points at the edge of the field.
    apart = float(np.median(near))
    way = places[nearest] - places[of]
    # Four times a right angle is a full turn, so all four directions to neighbours agree.
    turned = 4.0 * np.arctan2(way[:, 1], way[:, 0])
    angle = 0.25 * float(np.arctan2(np.sin(turned).sum(), np.cos(turned).sum()))
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    # Both axes have their own spacing, because cells may be rectangles.
    along, aside = (axis * _find_row_spacing(places @ axis, apart) for axis in axes)
    middle = places[np.argmin(np.hypot(*(places - np.median(places, axis=0)).T))]
    away = np.hypot(*(places - middle).T)
    reach, origin = FIRST_FIT_RADIUS_CELLS * max(np.hypot(*along), np.hypot(*aside)), middle
    # The fit begins in the middle, because far points get the right cell only from a well-fitted
    # spacing.
    while True:
        # Only points within the radius are used in this round.
        inside = away <= reach
        origin, along, aside = _fit_grid_axes(places[inside], origin, along, aside)
        if inside.all():
            break
        reach *= 2.0
    # Positions are expressed in cells by the inverse of the two axes.
    exact = (places - origin) @ np.linalg.inv(np.array([along, aside]))
    cells = np.rint(exact).astype(np.int64)
    off = float(np.abs(exact - cells).max())
    if off > MAX_CENTRE_OFFSET_CELLS:
        raise NoGridError(
            "a point lies {off:.2f} of a cell off its middle: {most} is the most",
            off=off,
            most=MAX_CENTRE_OFFSET_CELLS,
        )
    wide, high = float(np.hypot(*along)), float(np.hypot(*aside))
    _check_grid_cells(cells, wide, high)
    return PointGrid(origin, along, aside, cells - cells.min(axis=0), off)._replace(
        # The origin moves to the smallest indices, which become 0.
        origin=origin + cells.min(axis=0)[0] * along + cells.min(axis=0)[1] * aside
    )


def _find_row_spacing(along: Floats, apart: float) -> float:
    """Returns the distance between rows, m, of positions (n,) along an axis."""
    steps = np.diff(np.sort(along))
    # Small steps are the rounding of positions within one row.
    rows = steps[steps > NEXT_ROW_DISTANCE_SHARE * apart]
    if not len(rows):
        raise NoGridError("all points lie in one row")
    return float(np.median(rows))


def _fit_grid_axes(
    places: Floats, origin: Floats, along: Floats, aside: Floats
) -> tuple[Floats, Floats, Floats]:
    """Returns origin and axes fitted by least squares, with each position in its nearest cell."""
    cells = np.rint((places - origin) @ np.linalg.inv(np.array([along, aside])))
    # All points in one row leave the other axis undefined.
    if np.linalg.matrix_rank(cells - cells[0]) < 2:
        raise NoGridError("no rows and columns")
    found = np.linalg.lstsq(np.column_stack((np.ones(len(cells)), cells)), places, rcond=None)[0]
    return found[0], found[1], found[2]


def _check_grid_cells(cells: NDArray[np.int64], wide: float, high: float) -> None:
    """Refuses cells that are long, shared or scattered. Raises NoGridError."""
    # Long cells come from the track of a machine, not from a map.
    if max(wide, high) > MAX_CELL_LENGTH_TO_WIDTH * min(wide, high):
        raise NoGridError("cells of {wide:.3g} x {high:.3g} m", wide=wide, high=high)
    there = {(i, j) for i, j in cells.tolist()}
    if len(there) < len(cells):
        raise NoGridError(
            "{count} points share their cell with another", count=len(cells) - len(there)
        )
    for i, j in ((1, 0), (0, 1)):
        # Scattered points may fit a grid by chance, but they have no neighbours.
        joined = sum((a + i, b + j) in there or (a - i, b - j) in there for a, b in there)
        if joined < MIN_SHARE_WITH_NEIGHBOURS * len(there):
            raise NoGridError(
                "{count} of {total} points have none next to them",
                count=len(there) - joined,
                total=len(there),
            )
