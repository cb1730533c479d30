"""Which ground ahead along the working line has its material from an earlier pass? It gets no
second dose."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from topdress.control.field.cell_tests import offset_places
from topdress.control.field.coverage import Coverage, CoveredArea, Raster
from topdress.control.field.ground_trace import GroundTrace
from topdress.control.geodesy import Place, find_unit_vector

# Edges are looked for this far ahead, m: 4 s at 3.3 m/s and a margin.
LOOK_AHEAD_M = 16.0
# Spacing of the places that are looked at, m.
LOOK_STEP_M = 0.25
# Share of the outlets over done ground from which the whole machine counts as over it.
DONE_OUTLET_SHARE = 0.8
# Shorter stretches, done or not, are cut corners, m.
MIN_STRETCH_M = 0.5
# A longer way in one tick is a jump of the position, m.
MAX_TICK_WAY_M = 5.0
# A heading this close to that of the last look is the same, degrees.
SAME_HEADING_DEG = 1.0
# An edge this close to the place of a change that was made is that change, m.
SAME_EDGE_M = 2.0


class DoneGroundAhead:
    """Finds the done ground along the way ahead; it looks anew after every step of the way and
    in turns.

    `outlets` stand at even distances over the width of `coverage`; each counts by its own place."""

    def __init__(self, coverage: Coverage, outlets: int) -> None:
        # Places of the track where done ground begins or ends, m.
        self.places_m: list[float] = []
        self.coverage = coverage
        self._trace = GroundTrace(coverage)
        # Track of the last tick, m.
        self._track_m: float | None = None
        self._aside = (
            np.arange(outlets) + 0.5
        ) / outlets * coverage.width_m - 0.5 * coverage.width_m
        self._ahead = np.arange(0.0, LOOK_AHEAD_M, LOOK_STEP_M)
        # Whether the place of the last look is done.
        self._done_here = False
        # From START until ground without material is reached.
        self._wanted_here = False
        # Track, m, and heading, degrees, of the last look.
        self._looked: tuple[float, float] | None = None
        # Landing time, s, and whether material was released.
        self._falling: deque[tuple[float, bool | Sequence[bool]]] = deque()
        self._lands: bool | Sequence[bool] = coverage.no_flow

    @property
    def covered_area(self) -> CoveredArea:
        return self.coverage.covered_area

    def record_release(
        self,
        now_s: float,
        place: Place | None,
        heading_deg: float | None,
        released: bool | Sequence[bool],
        drop_s: float,
        track_m: float,
    ) -> tuple[float, bool] | None:
        """Takes the place of the outlets. Material released now, by strips of the coverage where
        it has several, lands a drop time later under the outlets' place of then. Returns the
        value of `GroundTrace.pass_over`."""
        self._falling.append((now_s + drop_s, released))
        while self._falling and self._falling[0][0] <= now_s:
            self._lands = self._falling.popleft()[1]
        way_m = 0.0 if self._track_m is None else track_m - self._track_m
        self._track_m = track_m
        return self._trace.pass_over(place, heading_deg, self._lands, way_m)

    def add_earlier_ground(self, ground: Raster, ours: bool = True) -> None:
        """Adds the ground that an earlier part of the job, or another machine (not ours), has
        done. START does not release it; only the job's `no_double` does."""
        self.coverage.add_earlier_ground(ground, ours)
        self._looked = None

    def is_done_earlier(self, place: Place) -> bool:
        """Returns whether an earlier part of the job has spread here."""
        return bool(self.coverage.find_covered_earlier([place])[0])

    def forget_view(self) -> None:
        """Forgets what was seen ahead, because the position has jumped."""
        self.places_m, self._looked = [], None

    def record_start(self) -> None:
        """Releases the ground under the machine that was done in this run, because the operator
        wants flow from here on."""
        self._wanted_here, self._looked = True, None

    def look_ahead(
        self, track_m: float, place: Place | None, heading_deg: float | None, fired_to_m: float
    ) -> None:
        """Looks from the outlets straight ahead. An edge up to `fired_to_m`, where changes have
        been made, keeps its place."""
        if place is None or heading_deg is None:
            self._done_here, self.places_m, self._looked = False, [], None
            return
        if (
            self._looked is not None
            and abs(track_m - self._looked[0]) < LOOK_STEP_M
            and abs((heading_deg - self._looked[1] + 180.0) % 360.0 - 180.0) < SAME_HEADING_DEG
        ):
            return
        self._looked = track_m, heading_deg
        over = self._find_done_steps(place, heading_deg, earlier=False)
        if self._wanted_here:
            ends = np.flatnonzero(~over)
            self._wanted_here = bool(over[0])
            meant = slice(int(ends[0]) if len(ends) else len(over))
            over[meant] = self._find_done_steps(place, heading_deg, earlier=True)[meant]
        self._done_here = bool(over[0])
        seen = (track_m + LOOK_STEP_M * (np.flatnonzero(over[1:] != over[:-1]) + 0.5)).tolist()
        made = [known for known in self.places_m if known <= fired_to_m]
        self.places_m = [
            next((old for old in made if abs(old - edge) < SAME_EDGE_M), edge) for edge in seen
        ]

    def is_inside(self, place_m: float) -> bool:
        """Returns whether a place of the track may get material, because it has none yet."""
        crossed = [edge for edge in self.places_m if edge <= place_m]
        return self._done_here == (len(crossed) % 2 == 1)

    def _find_done_steps(self, place: Place, heading_deg: float, earlier: bool) -> np.ndarray:
        """Returns for each step ahead (k,) whether the machine would be over done ground.
        earlier: done by an earlier run."""
        course = find_unit_vector(heading_deg)
        done = self.coverage.count_done_ahead(place, course, self._ahead, self._aside, earlier)
        if done is None:
            places = np.empty((len(self._ahead), len(self._aside), 2))
            places[..., 0] = offset_places(
                place[0], self._ahead[:, None], course[0], self._aside, course[1]
            )
            places[..., 1] = offset_places(
                place[1], self._ahead[:, None], course[1], -self._aside, course[0]
            )
            asked = self.coverage.find_covered_earlier if earlier else self.coverage.find_covered
            done = asked(places.reshape(-1, 2)).reshape(places.shape[:2]).sum(axis=1)
        over = done / len(self._aside) >= DONE_OUTLET_SHARE
        return merge_short_runs(over, round(MIN_STRETCH_M / LOOK_STEP_M))


def merge_short_runs(flags: np.ndarray, least: int) -> np.ndarray:
    """Merges runs of less than `least` equal values (k,) into the run before; the first run
    stays."""
    begins = (np.flatnonzero(flags[1:] != flags[:-1]) + 1).tolist()
    kept = flags.copy() if begins else flags
    for begin, end in zip(begins, [*begins[1:], len(flags)], strict=False):
        if end - begin < least and end < len(flags):
            kept[begin:end] = kept[begin - 1]
    return kept
