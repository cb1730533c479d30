"""What the ground under each section wants, at one place of the way: material, or none and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from topdress.control.field.coverage import Coverage
from topdress.control.geodesy import Place, direction
from topdress.control.machine.sections import SectionStrip
from topdress.control.targets.boundary_profile import Fence
from topdress.control.targets.profile import Target

# of the points at which a section's strip is judged
APART_M = 0.05
# points of one section; an odd number, so that half of it is its middle
FEWEST, MOST = 9, 25
# of a section's width: beyond, it is outside the field whatever the overlap setting says
MOST_OUTSIDE = 0.5
FULL = 1.0 - 1e-9

# why a section gets nothing
OUTSIDE, HEADLAND, DONE, EMPTY = "outside", "headland", "done", "map"


class SectionRates(Protocol):
    """A prescription."""

    def targets_at(self, places: npt.ArrayLike) -> list[Target]: ...


class SectionsGround(NamedTuple):
    """What holds for every section. `started`: of each, the operator wants flow on what this
    run has done."""

    # None: no field known, or the operator allows work outside it
    fence: Fence | None
    headland: Fence | None  # where it gets nothing: inside of it
    coverage: Coverage | None  # None: ground that is done may get more
    rates: SectionRates | None  # of map mode
    started: tuple[bool, ...]


class JudgedStrip(NamedTuple):
    """One section's strip. `share`: of its width that is to get nothing; `why`: what most of
    that is, or empty."""

    wanted: bool
    why: str
    share: float
    done: bool  # any of it, in this run


class SectionGround:
    """Points across the strips of a machine. overlap_percent: the share of a strip that must be
    unwanted for the section to close; 0: any, 100: all of it.

    A bitmap knows ground by its cells, so that a strip's outermost `edge_m` say nothing: they
    are left out.
    """

    def __init__(
        self, strips: Sequence[SectionStrip], overlap_percent: float, edge_m: float
    ) -> None:
        self._overlap = min(FULL, max(1e-9, overlap_percent / 100.0))
        aside = []
        for left, right, _ in strips:
            edge = min(edge_m, 0.25 * (right - left))
            count = min(
                MOST, max(FEWEST, 2 * round(0.5 * (right - left - 2.0 * edge) / APART_M) + 1)
            )
            aside.append(np.linspace(left + edge, right - edge, count))
        self._counts = [len(points) for points in aside]
        self._begins = np.concatenate([[0], np.cumsum(self._counts)[:-1]])
        self._aside = np.concatenate([np.empty(0), *aside])

    def unknown(self, ground: SectionsGround) -> tuple[JudgedStrip, ...]:
        """No place known: outside the field, where there is one."""
        outside = ground.fence is not None
        return (JudgedStrip(not outside, OUTSIDE if outside else "", float(outside), False),) * len(
            self._counts
        )

    def look(
        self, place: Place, heading_deg: float, ground: SectionsGround
    ) -> tuple[JudgedStrip, ...]:
        """The middle of the outlets is there, on this course. Some 60 us."""
        points = self._points(place, heading_deg)
        nothing: dict[str, npt.NDArray[np.bool_]] = {}
        if ground.fence is not None:
            nothing[OUTSIDE] = ~ground.fence.edge.many_inside(points)
        if ground.headland is not None:
            nothing[HEADLAND] = ~ground.headland.edge.many_inside(points)
        done = np.zeros(len(points), dtype=np.bool_)
        if ground.coverage is not None:
            done = ground.coverage.applied(points)
            nothing[DONE] = done
            if any(ground.started):
                earlier = ground.coverage.applied_earlier(points)
                nothing[DONE] = np.where(np.repeat(ground.started, self._counts), earlier, done)
        if ground.rates is not None:
            nothing[EMPTY] = np.array(
                [target.rate_kg_ha <= 0.0 for target in ground.rates.targets_at(points)]
            )
        return self._judged(nothing, done)

    def rate_kg_ha(
        self, place: Place, heading_deg: float, on: Sequence[bool], rates: SectionRates
    ) -> float:
        """Mean of what a map wants under the sections that are on, where it wants any."""
        points = self._points(place, heading_deg)[np.repeat(on, self._counts)]
        wanted = [
            target.rate_kg_ha for target in rates.targets_at(points) if target.rate_kg_ha > 0.0
        ]
        return sum(wanted) / len(wanted) if wanted else 0.0

    def _points(self, place: Place, heading_deg: float) -> npt.NDArray[np.float64]:
        east, north = direction(heading_deg)
        return np.column_stack((place[0] + self._aside * north, place[1] - self._aside * east))

    def _judged(
        self, nothing: dict[str, npt.NDArray[np.bool_]], done: npt.NDArray[np.bool_]
    ) -> tuple[JudgedStrip, ...]:
        if not nothing:
            return (JudgedStrip(True, "", 0.0, False),) * len(self._counts)
        shares = {why: self._shares(flags) for why, flags in nothing.items()}
        unwanted = self._shares(np.logical_or.reduce(list(nothing.values())))
        were_done = self._shares(done)
        found = []
        for k, share in enumerate(unwanted):
            outside = shares[OUTSIDE][k] > MOST_OUTSIDE if OUTSIDE in shares else False
            off = share >= self._overlap or outside
            why = OUTSIDE if outside else max(shares, key=lambda name: shares[name][k])
            found.append(JudgedStrip(not off, why if off else "", share, were_done[k] > 0.0))
        return tuple(found)

    def _shares(self, flags: npt.NDArray[np.bool_]) -> list[float]:
        summed = np.add.reduceat(flags.astype(np.float64), self._begins)
        return [float(total) / count for total, count in zip(summed, self._counts, strict=True)]
