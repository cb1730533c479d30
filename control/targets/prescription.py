"""Which rates does a prescription give? Cells or zones in degrees, as files hold them, projected
to the field's tangent plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from topdress.control.field.boundary import Boundary
from topdress.control.geodesy import Place, TangentPlane, find_unit_vector
from topdress.control.orders import TargetSource

from .rate_map import Floats, GridMap, RateMap, ZoneMap, make_frame_deg, make_polygons
from .target_profile import Target

# A shorter stretch is a cut corner, passed before a drive has answered, m.
MIN_STRETCH_M = 0.25
# Probed places on a side: 10 m apart in a field of 1 km.
PROBES_PER_SIDE = 100
# Smaller ground is rounding of corners, m2.
MIN_GROUND_M2 = 0.01
# 111,200 m is the length of a degree of latitude, so the limit is the same ground in degrees.
MIN_GROUND_DEG2 = MIN_GROUND_M2 / 111_200.0**2
# Shorter ground without a rate between ground with rates is a sliver between polygons, m.
MIN_GAP_M = 0.5


class Fallbacks(NamedTuple):
    """Holds the rates where the map has none, kg/ha (ISO 11783-10: default, out-of-field and
    position-lost zones)."""

    # Inside the field, but in no zone or in a cell without a value.
    default_kg_ha: float = 0.0
    # Outside the field; without a known field outside the map.
    outside_kg_ha: float = 0.0
    # With a lost position.
    lost_kg_ha: float = 0.0


NO_FALLBACKS = Fallbacks()


class Zone(NamedTuple):
    """Holds one polygon and its rate. rings_deg: outline, then holes, each (k, 2) latitude and
    longitude, not closed."""

    rate_kg_ha: float
    rings_deg: tuple[Floats, ...]
    title: str = ""


class GridDeg(NamedTuple):
    """Holds cells in degrees from the south-western corner on. rate_kg_ha: (rows, columns), NaN:
    no rate."""

    south_deg: float
    west_deg: float
    cell_lat_deg: float
    cell_lon_deg: float
    rate_kg_ha: Floats


@dataclass(frozen=True, eq=False)
class MapData:
    """Holds the content of a map file, WGS84: zones or a grid, fallbacks, and the outlines of
    fields with their holes."""

    zones: tuple[Zone, ...] = ()
    grid: GridDeg | None = None
    fallbacks: Fallbacks = NO_FALLBACKS
    fields_deg: tuple[tuple[Floats, ...], ...] = ()
    title: str = ""
    product: str = ""

    def __post_init__(self) -> None:
        # Exactly one of both must be given: otherwise two sources could contradict each other.
        if bool(self.zones) == (self.grid is not None):
            raise ValueError("a prescription holds zones or a grid: allowed is one of them")

    @property
    def rates_kg_ha(self) -> list[float]:
        """Returns the different rates above 0 of all zones or cells, kg/ha, the lowest first."""
        rates = (
            np.array([zone.rate_kg_ha for zone in self.zones])
            if self.grid is None
            else self.grid.rate_kg_ha
        )
        # NaN compares as false and drops out; infinite rates are no rates of a map.
        return [float(rate) for rate in np.unique(rates[rates > 0.0]) if np.isfinite(rate)]

    @property
    def box_deg(self) -> tuple[float, float, float, float]:
        """Returns the south, west, north and east end of the ground with a rate, degrees."""
        if self.grid is not None:
            rows, columns = self.grid.rate_kg_ha.shape
            return (
                self.grid.south_deg,
                self.grid.west_deg,
                self.grid.south_deg + rows * self.grid.cell_lat_deg,
                self.grid.west_deg + columns * self.grid.cell_lon_deg,
            )
        # The outline alone bounds a zone, because holes lie inside.
        corners = np.concatenate([zone.rings_deg[0] for zone in self.zones])
        (south, west), (north, east) = corners.min(axis=0), corners.max(axis=0)
        return float(south), float(west), float(north), float(east)

    def make_plane(self) -> TangentPlane:
        """Returns the plane that touches the earth in the middle of the map."""
        south, west, north, east = self.box_deg
        return TangentPlane(0.5 * (south + north), 0.5 * (west + east))


class TargetAhead(NamedTuple):
    """Holds a target that begins `distance_m` ahead."""

    distance_m: float
    target: Target


class Prescription:
    """Holds rates, field and fallbacks on one plane; it does not change once made."""

    def __init__(
        self, rates: RateMap, fallbacks: Fallbacks, fields: Sequence[Boundary] = ()
    ) -> None:
        self._rates = rates
        self._fields = tuple(fields)
        self.fallbacks = fallbacks
        # The targets of the fallbacks are made once: the loop asks for them in every tick.
        self.lost = Target(fallbacks.lost_kg_ha, TargetSource.FALLBACK)
        self._default = Target(fallbacks.default_kg_ha, TargetSource.FALLBACK)
        self._outside = Target(fallbacks.outside_kg_ha, TargetSource.FALLBACK)

    @property
    def cell_m(self) -> float:
        """Returns the cell size of its rates, m (`RateMap`)."""
        return self._rates.cell_m

    def find_target(self, place: Place) -> Target:
        """Returns the target at a place of the plane, m; `lost` where the place is not finite."""
        return self.find_targets([place])[0]

    def find_targets(self, places: npt.ArrayLike) -> list[Target]:
        """Returns the targets at places (n, 2), m."""
        points = np.asarray(places, dtype=np.float64).reshape(-1, 2)
        rates = self._rates.find_rates(points)
        # The sum is finite only if both coordinates are.
        known = np.isfinite(points[:, 0] + points[:, 1])
        # Without a field every place counts as inside, and the map's edge decides.
        inside = np.full(len(points), not self._fields, dtype=np.bool_)
        for field in self._fields:
            np.logical_or(inside, field.contains_places(points), out=inside)
        found = []
        for k, rate in enumerate(rates.tolist()):
            if not known[k]:
                found.append(self.lost)
            # A rate that differs from itself is NaN, i.e. the map has none there.
            elif not inside[k] or (rate != rate and not self._fields):
                found.append(self._outside)
            else:
                found.append(self._default if rate != rate else Target(rate, TargetSource.MAP))
        return found

    @property
    def outside_kg_ha(self) -> float:
        """Returns the rate outside its fields, and where it has none, outside its ground."""
        return self.fallbacks.outside_kg_ha

    def calc_distance_m(self, place: Place) -> float:
        """Returns the distance of a place from the map, m: from its ground with a rate or one of
        its fields; 0 on it."""
        return min(
            [
                self._rates.calc_distance_m(place),
                *(field.calc_distance_m(place) for field in self._fields),
            ]
        )

    def has_rate_in(self, field: Boundary) -> bool:
        """Returns whether the map has a rate somewhere in a field, probed on a raster of
        `PROBES_PER_SIDE` by `PROBES_PER_SIDE` places."""
        # The raster covers the field's bounding box; places outside the field are skipped.
        west, south, east, north = field.shape.bounds
        places = np.stack(
            np.meshgrid(
                np.linspace(west, east, PROBES_PER_SIDE), np.linspace(south, north, PROBES_PER_SIDE)
            ),
            axis=-1,
        ).reshape(-1, 2)
        return bool(
            np.isfinite(self._rates.find_rates(places[field.contains_places(places)])).any()
        )

    def find_targets_ahead(
        self, start: Place, heading_deg: float, farthest_m: float
    ) -> list[TargetAhead]:
        """Returns the targets along a straight line from `start`, the first from 0 m on; each
        differs from the one before.

        A target begins where the line crosses the edge of a cell or zone, or of the field, which
        cuts the border cells (lag paper, eq 4 and 5, by vectors). Stretches below SHORTEST_M and
        gaps below GAP_M are divided between their neighbours."""
        # Rates can change only where the line crosses an edge of a cell, a zone or a field.
        meets = [self._rates.find_crossings_m(start, heading_deg, farthest_m)]
        meets += [
            np.array(field.find_crossings_m(*start, heading_deg, farthest_m))
            for field in self._fields
        ]
        edges = np.concatenate(([0.0], np.unique(np.concatenate(meets)), [farthest_m]))
        # Edges at the same distance would give a stretch of length 0.
        edges = edges[np.append(True, np.diff(edges) > 0.0)]
        # The middle of a stretch is away from the edges, where rounding could choose the wrong
        # cell.
        middles = 0.5 * (edges[:-1] + edges[1:])
        targets = self.find_targets(
            np.asarray(start) + middles[:, None] * np.asarray(find_unit_vector(heading_deg))
        )
        pieces: list[_ZoneInterval] = []
        for begin, end, target in zip(
            edges[:-1].tolist(), edges[1:].tolist(), targets, strict=True
        ):
            # Neighbouring stretches with equal targets are joined, so that no change without a
            # difference is made.
            if pieces and pieces[-1].target == target:
                begin = pieces.pop().begin_m
            pieces.append(_ZoneInterval(begin, end, target))
        long = [
            k for k, piece in enumerate(pieces) if not _is_sliver(piece, 0 < k < len(pieces) - 1)
        ]
        stretches: list[TargetAhead] = []
        # If all stretches are slivers, the first one is kept: a line always has a target.
        for before, k in zip([None, *long], long or [0], strict=False):
            if not stretches or before is None:
                stretches = [TargetAhead(0.0, pieces[k].target)]
            elif pieces[k].target != stretches[-1].target:
                stretches.append(
                    # A removed sliver is divided at its middle between its neighbours.
                    TargetAhead(0.5 * (pieces[before].end_m + pieces[k].begin_m), pieces[k].target)
                )
        return stretches


class _ZoneInterval(NamedTuple):
    begin_m: float
    end_m: float
    target: Target


def _is_sliver(piece: _ZoneInterval, between: bool) -> bool:
    """Returns whether a piece is too short to count; a gap in the map counts only where it does
    not lie between two others."""
    # A gap between polygons is a drawing error; in front of the map it is real.
    least = MIN_GAP_M if between and piece.target.source is TargetSource.FALLBACK else MIN_STRETCH_M
    return piece.end_m - piece.begin_m < least


def project_prescription(data: MapData, plane: TangentPlane) -> Prescription:
    """Projects the prescription to a plane.

    Raises
    ------
    ValueError : in one line, where a field's outline is unusable."""
    return Prescription(project_rates(data, plane), data.fallbacks, project_fields(data, plane))


def _project_boundary(
    plane: TangentPlane, rings: Sequence[Floats]
) -> tuple[list[Place], list[list[Place]]]:
    outline, *holes = (
        [(float(e), float(n)) for e, n in plane.project_many_to_m(ring[:, 0], ring[:, 1])]
        for ring in rings
    )
    return outline, holes


def project_rates(data: MapData, plane: TangentPlane) -> RateMap:
    """Projects the rates of cells or zones to a plane."""
    if data.grid is not None:
        grid = data.grid
        rows, columns = grid.rate_kg_ha.shape
        return GridMap(
            make_frame_deg(
                plane,
                grid.south_deg,
                grid.west_deg,
                grid.cell_lat_deg,
                grid.cell_lon_deg,
                rows,
                columns,
            ),
            grid.rate_kg_ha,
        )
    return ZoneMap(project_zone_rings(data.zones, plane), [zone.rate_kg_ha for zone in data.zones])


def project_zone_rings(zones: Sequence[Zone], plane: TangentPlane) -> list[list[Floats]]:
    """Returns the rings of every zone on the plane, m; all corners are projected at once."""
    # All rings are projected in one call, because a map can have thousands.
    flat = [ring for zone in zones for ring in zone.rings_deg]
    corners = np.concatenate(flat)
    places = np.split(
        plane.project_many_to_m(corners[:, 0], corners[:, 1]),
        # Each ring's length marks where the next ring begins.
        np.cumsum([len(ring) for ring in flat])[:-1],
    )
    rings = iter(places)
    return [[next(rings) for _ in zone.rings_deg] for zone in zones]


class RateShare(NamedTuple):
    """Holds area and mass of the ground that gets one rate."""

    rate_kg_ha: float
    area_ha: float
    mass_kg: float


def calc_rate_shares(data: MapData) -> tuple[RateShare, ...]:
    """Returns area and mass by rate, rising, of the cells or zones themselves (m on their own
    plane).

    Ground outside given fields does not count. Where zones overlap, the first one in order
    counts, as it holds there."""
    plane = data.make_plane()
    ground = find_rated_ground(data, plane)
    areas = ground.areas_m2
    if data.fields_deg:
        # The union prevents ground in two overlapping fields from counting twice.
        areas = ground.calc_areas_inside_m2(
            shapely.union_all([field.shape for field in project_fields(data, plane)])
        )
    # Rounding leaves slivers of no area, which would appear as rates of the map.
    counts = areas > MIN_GROUND_M2
    levels, which = np.unique(ground.rates[counts], return_inverse=True)
    # 10,000 m2 are a hectare.
    by_rate = np.bincount(which, weights=areas[counts], minlength=len(levels)) / 10_000.0
    return tuple(
        RateShare(float(rate), float(ha), float(rate * ha))
        for rate, ha in zip(levels, by_rate, strict=True)
    )


def project_fields(data: MapData, plane: TangentPlane) -> tuple[Boundary, ...]:
    """Projects the map's fields. Raises ValueError in one line where an outline is unusable."""
    return tuple(Boundary(*_project_boundary(plane, rings)) for rings in data.fields_deg)


class RatedGround(NamedTuple):
    """Holds cells or zones (n,) with a rate that do not overlap: `shapes`, or for a grid corners
    `rings` (n, 4, 2)."""

    rates: Floats
    areas_m2: Floats
    shapes: npt.NDArray[np.object_] | None
    rings: Floats | None
    # This is ground in more than one zone.
    overlap_m2: float

    def _make_shapes(self) -> npt.NDArray[np.object_]:
        return (
            self.shapes
            if self.shapes is not None
            else np.asarray(shapely.polygons(self.rings), dtype=object)
        )

    def calc_areas_inside_m2(self, field: shapely.Geometry) -> Floats:
        """Returns the areas (n,) inside a field, m2."""
        shapes, areas = self._make_shapes(), self.areas_m2.copy()
        # A prepared geometry answers thousands of tests faster.
        shapely.prepare(field)
        # Only shapes that cross the field's edge need the slow intersection.
        cut = np.flatnonzero(~shapely.contains_properly(field, shapes))
        areas[cut] = shapely.area(shapely.intersection(shapes[cut], field))
        return areas

    def calc_distance_m(self, field: shapely.Geometry) -> float:
        """Returns the shortest distance between the ground and a field, m."""
        return float(shapely.distance(self._make_shapes(), field).min())


def find_rated_ground(data: MapData, plane: TangentPlane) -> RatedGround:
    """Returns where the map has which rate. Of overlapping zones the first one in order holds,
    as in `ZoneMap`."""
    if data.grid is not None:
        rates = data.grid.rate_kg_ha.ravel()
        # Cells without a rate are no ground of the map.
        known = np.isfinite(rates)
        rings = _make_cell_rings(data.grid, plane)[known]
        return RatedGround(rates[known], _calc_ring_areas(rings), None, rings, 0.0)
    shapes = ZoneMap(
        project_zone_rings(data.zones, plane), [zone.rate_kg_ha for zone in data.zones]
    ).shapes
    own, overlap_m2 = _subtract_earlier(shapes)
    return RatedGround(
        np.array([zone.rate_kg_ha for zone in data.zones]), shapely.area(own), own, None, overlap_m2
    )


def separate_zones(zones: Sequence[Zone]) -> tuple[Zone, ...]:
    """Returns the zones unchanged where none overlap; else zones of the ground on which each
    holds, in degrees."""
    shapes = make_polygons([zone.rings_deg for zone in zones])
    own, _ = _subtract_earlier(shapes, MIN_GROUND_DEG2)
    found: list[Zone] = []
    for zone, before, now in zip(zones, shapes, own, strict=True):
        # An unchanged zone keeps its original corners.
        if now is before:
            found.append(zone)
            continue
        for part in shapely.get_parts(now):
            # Lines and points are left by touching edges and have no area.
            if part.geom_type == "Polygon" and part.area > MIN_GROUND_DEG2:
                rings = (part.exterior, *part.interiors)
                found.append(
                    zone._replace(
                        # Zones are stored with open rings; shapely repeats the first corner.
                        rings_deg=tuple(shapely.get_coordinates(ring)[:-1] for ring in rings)
                    )
                )
    return tuple(found)


class MergedZones(NamedTuple):
    """Holds merged zones, the largest change of a rate, and the mean size of the change by area."""

    zones: tuple[Zone, ...]
    most_kg_ha: float
    mean_kg_ha: float


def merge_zones(zones: Sequence[Zone], step_kg_ha: float) -> MergedZones:
    """Merges zones whose rates round to the same multiple of a step, with their mean rate by
    area, so that the mass stays the same. Ground in several zones belongs to the first.

    Raises
    ------
    ValueError : the step is 0 or less."""
    if not step_kg_ha > 0.0:
        raise ValueError(f"merge {step_kg_ha:g} kg/ha: allowed is above 0")
    own = separate_zones(zones)
    shapes, rates = (
        make_polygons([zone.rings_deg for zone in own]),
        np.array([zone.rate_kg_ha for zone in own]),
    )
    # Rates that round to the same multiple of the step are merged.
    areas, levels = shapely.area(shapes), np.round(rates / step_kg_ha)
    found: list[Zone] = []
    new = np.empty(len(own))
    for level in np.unique(levels):
        here = levels == level
        # A zone without area would divide by zero; the addition is too small to change a mean.
        rate = float(np.average(rates[here], weights=areas[here] + MIN_GROUND_DEG2))
        new[here] = rate
        parts = [
            part
            for part in shapely.get_parts(shapely.union_all(shapes[here]))
            if part.geom_type == "Polygon"
        ]
        found += [
            Zone(
                rate,
                tuple(
                    shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)
                ),
            )
            for part in parts
        ]
    change = np.abs(new - rates)
    return MergedZones(tuple(found), float(change.max()), float(np.average(change, weights=areas)))


def _subtract_earlier(
    shapes: npt.NDArray[np.object_], least: float = MIN_GROUND_M2
) -> tuple[npt.NDArray[np.object_], float]:
    """Returns the shapes without ground that an earlier one covers, and the area in more than
    one; an overlap below `least` is ignored."""
    # The tree finds candidate pairs without comparing all zones with each other.
    tree = shapely.STRtree(shapes)
    pairs = np.concatenate(
        [tree.query(shapes, predicate=how) for how in ("overlaps", "contains", "within")], axis=1
    )
    # Each pair occurs twice; only the later zone loses ground.
    later, earlier = pairs[:, pairs[0] > pairs[1]]
    counts = shapely.area(shapely.intersection(shapes[later], shapes[earlier])) > least
    later, earlier = later[counts], earlier[counts]
    own, shared = shapes.copy(), []
    for k in np.unique(later).tolist():
        # All earlier zones are united first, so that shared ground is subtracted once.
        before = shapely.union_all(shapes[np.unique(earlier[later == k])])
        shared.append(shapely.intersection(shapes[k], before))
        own[k] = shapely.difference(shapes[k], before)
    return own, float(shapely.area(shapely.union_all(shared))) if shared else 0.0


def _make_cell_rings(grid: GridDeg, plane: TangentPlane) -> Floats:
    """Returns the corners of all cells (rows x columns, 4, 2), row by row, m."""
    rows, columns = grid.rate_kg_ha.shape
    row, column = (
        a.ravel() for a in np.meshgrid(np.arange(rows + 1), np.arange(columns + 1), indexing="ij")
    )
    corner = plane.project_many_to_m(
        grid.south_deg + row * grid.cell_lat_deg, grid.west_deg + column * grid.cell_lon_deg
    ).reshape(rows + 1, columns + 1, 2)
    return np.stack(
        (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]), axis=2
    ).reshape(-1, 4, 2)


def _calc_ring_areas(rings: Floats) -> Floats:
    """Returns the areas (n,) of four-cornered rings (n, 4, 2) by their diagonals."""
    # Half of the cross product of both diagonals is the area of a quadrilateral.
    one, other = rings[:, 2] - rings[:, 0], rings[:, 3] - rings[:, 1]
    return np.asarray(
        0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]), dtype=np.float64
    )
