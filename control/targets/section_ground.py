"""Does the ground under each section get material at a place of the way, and if not, why?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from topdress.control.field.coverage import Coverage
from topdress.control.geodesy import Place, find_unit_vector
from topdress.control.machine.sections import SectionStrip
from topdress.control.targets.boundary_profile import BoundaryAhead
from topdress.control.targets.target_profile import Target

# Spacing of the points at which a section's strip is judged, m.
POINT_SPACING_M = 0.05
# Number of points of a section; an odd number has its middle at half of it.
MIN_POINTS, MAX_POINTS = 9, 25
# Beyond this share of a section's width outside the field it closes, whatever the overlap setting
# is.
MAX_OUTSIDE_SHARE = 0.5
FULL_SHARE = 1.0 - 1e-9

# Reasons why a section gets nothing.
WHY_OUTSIDE, WHY_HEADLAND, WHY_DONE, WHY_EMPTY = "outside", "headland", "done", "map"


class SectionRates(Protocol):
    """Defines the part of a prescription that sections use."""

    def find_targets(self, places: npt.ArrayLike) -> list[Target]: ...


class SectionsGround(NamedTuple):
    """Holds what decides about every section. `started`: for each, the operator wants flow on
    ground that this run has done."""

    # None: no field is known, or the operator allows work outside it.
    fence: BoundaryAhead | None
    # The edge of a headland that gets nothing.
    headland: BoundaryAhead | None
    # None: done ground may get more.
    coverage: Coverage | None
    # The rates of map mode.
    rates: SectionRates | None
    started: tuple[bool, ...]


class JudgedStrip(NamedTuple):
    """Holds the verdict on a section's strip. `share`: part of its width that gets nothing;
    `why`: the main reason, or empty; `done`: this run has done some of it."""

    wanted: bool
    why: str
    share: float
    done: bool


class SectionGround:
    """Judges points across the strips of a machine. overlap_percent: unwanted share of a strip
    at which its section closes; 0: any, 100: all of it.

    A bitmap knows ground by its cells, so that the outermost `edge_m` of a strip are no evidence
    and are left out."""

    def __init__(
        self, strips: Sequence[SectionStrip], overlap_percent: float, edge_m: float
    ) -> None:
        self._overlap = min(FULL_SHARE, max(1e-9, overlap_percent / 100.0))
        aside = []
        for left, right, _ in strips:
            edge = min(edge_m, 0.25 * (right - left))
            count = min(
                MAX_POINTS,
                max(MIN_POINTS, 2 * round(0.5 * (right - left - 2.0 * edge) / POINT_SPACING_M) + 1),
            )
            aside.append(np.linspace(left + edge, right - edge, count))
        self._counts = [len(points) for points in aside]
        self._begins = np.concatenate([[0], np.cumsum(self._counts)[:-1]])
        self._aside = np.concatenate([np.empty(0), *aside])

    def judge_unknown_place(self, ground: SectionsGround) -> tuple[JudgedStrip, ...]:
        """Returns the verdicts without a known place: outside the field, where there is one."""
        outside = ground.fence is not None
        return (
            JudgedStrip(not outside, WHY_OUTSIDE if outside else "", float(outside), False),
        ) * len(self._counts)

    def judge_sections(
        self, place: Place, heading_deg: float, ground: SectionsGround
    ) -> tuple[JudgedStrip, ...]:
        """Returns the verdicts with the middle of the outlets at a place, on this course. It
        takes some 60 us."""
        points = self._place_points(place, heading_deg)
        nothing: dict[str, npt.NDArray[np.bool_]] = {}
        if ground.fence is not None:
            nothing[WHY_OUTSIDE] = ~ground.fence.edge.contains_places(points)
        if ground.headland is not None:
            nothing[WHY_HEADLAND] = ~ground.headland.edge.contains_places(points)
        done = np.zeros(len(points), dtype=np.bool_)
        if ground.coverage is not None:
            done = ground.coverage.find_covered(points)
            nothing[WHY_DONE] = done
            if any(ground.started):
                earlier = ground.coverage.find_covered_earlier(points)
                nothing[WHY_DONE] = np.where(np.repeat(ground.started, self._counts), earlier, done)
        if ground.rates is not None:
            nothing[WHY_EMPTY] = np.array(
                [target.rate_kg_ha <= 0.0 for target in ground.rates.find_targets(points)]
            )
        return self._judge_strips(nothing, done)

    def find_mean_rate_kg_ha(
        self, place: Place, heading_deg: float, on: Sequence[bool], rates: SectionRates
    ) -> float:
        """Returns the mean rate of a map under the sections that are on, over the points with a
        rate, kg/ha."""
        points = self._place_points(place, heading_deg)[np.repeat(on, self._counts)]
        wanted = [
            target.rate_kg_ha for target in rates.find_targets(points) if target.rate_kg_ha > 0.0
        ]
        return sum(wanted) / len(wanted) if wanted else 0.0

    def _place_points(self, place: Place, heading_deg: float) -> npt.NDArray[np.float64]:
        east, north = find_unit_vector(heading_deg)
        return np.column_stack((place[0] + self._aside * north, place[1] - self._aside * east))

    def _judge_strips(
        self, nothing: dict[str, npt.NDArray[np.bool_]], done: npt.NDArray[np.bool_]
    ) -> tuple[JudgedStrip, ...]:
        if not nothing:
            return (JudgedStrip(True, "", 0.0, False),) * len(self._counts)
        shares = {why: self._calc_shares(flags) for why, flags in nothing.items()}
        unwanted = self._calc_shares(np.logical_or.reduce(list(nothing.values())))
        were_done = self._calc_shares(done)
        found = []
        for k, share in enumerate(unwanted):
            outside = shares[WHY_OUTSIDE][k] > MAX_OUTSIDE_SHARE if WHY_OUTSIDE in shares else False
            off = share >= self._overlap or outside
            why = WHY_OUTSIDE if outside else max(shares, key=lambda name: shares[name][k])
            found.append(JudgedStrip(not off, why if off else "", share, were_done[k] > 0.0))
        return tuple(found)

    def _calc_shares(self, flags: npt.NDArray[np.bool_]) -> list[float]:
        summed = np.add.reduceat(flags.astype(np.float64), self._begins)
        return [float(total) / count for total, count in zip(summed, self._counts, strict=True)]
