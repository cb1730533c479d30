"""Which dose is due in this tick? Plants ahead become dose orders, and measured dose errors
train the threshold."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.geodesy import Place, TangentPlane
from topdress.control.readings import CameraPlant, DoseOrder

from .plant_places import PlantList, PlantRow, TrackedPlant
from .point_mode import PlannedDose, PointLag, PointMode, calc_max_speed_mps

# Plants are looked for this far beyond the lag distance, m.
LOOK_BEYOND_LAG_M = 2.0
# After a turn by this, degrees, plants that were ahead are forgotten.
NEW_PASS_TURN_DEG = 20.0
# Length of the way behind that is kept to place earlier pictures, m.
WAY_KEPT_M = 20.0
# The shaft stands this long after the time of a dose, s.
SHAFT_SETTLING_S = 0.5
# A dose farther from its plant was meant for another one, m.
OTHER_PLANT_DISTANCE_M = 2.0
# Number of doses whose mean spacing is used.
MEAN_SPACING_DOSE_COUNT = 20


class CommandedDose(NamedTuple):
    """Holds a dose that was commanded."""

    time_s: float
    plant_m: float
    threshold_m: float
    speed_mps: float
    lands_s: float


class DoseError(NamedTuple):
    """Holds the error of a measured dose, late positive, m, its speed, and the threshold that it
    was commanded with."""

    error_m: float
    speed_mps: float
    threshold_m: float = 0.0


class DueDose(NamedTuple):
    """Holds the result of one tick: at most one dose, and the reasons why plants were missed."""

    dose: DoseOrder | None
    missed: tuple[str, ...]


NO_DOSE = DueDose(None, ())


class PlantDoser:
    """Turns plants from a list or a camera into doses.

    `find_due_dose` is called after `look_for_plants`, once a control period. A dose is commanded
    on the tick nearest to its moment, one at a time. With `learn` measured errors move the
    threshold; without `learn` the threshold stays 0."""

    def __init__(
        self,
        lag: PointLag,
        dose: DoseOrder,
        half_width_m: float,
        plants: PlantList | None = None,
        learn: bool = True,
        rest_s: float = 0.0,
        measured: Sequence[DoseError] = (),
    ) -> None:
        """Starts without a dose. measured: earlier dose errors, from which the threshold begins."""
        self.lag = lag
        self.dose = dose
        self.row = PlantRow()
        self.mode = PointMode(lag, self.row, rest_s=rest_s)
        self.missed = 0
        self.given: deque[CommandedDose] = deque(maxlen=200)
        self.doses = 0
        self._plants = plants
        self._half_width_m = half_width_m
        self._learn = learn
        for one in measured if learn else ():
            self.mode.threshold.learn_error(one.error_m, one.speed_mps, one.threshold_m)
        self._busy_s = lag.turn_s + rest_s
        self._waiting: deque[tuple[float, PlannedDose]] = deque()
        self._free_s = float("-inf")
        self._looked_deg: float | None = None
        # Time, s, and track, m, of recent ticks.
        self._way: deque[tuple[float, float]] = deque()

    @property
    def plane(self) -> TangentPlane | None:
        """Returns the plane of the plant list; None for a camera, which needs none."""
        return None if self._plants is None else self._plants.plane

    @property
    def recent_dose_spacing_m(self) -> float | None:
        """Returns the mean distance between the last doses, m; None before the second."""
        last = list(self.given)[-MEAN_SPACING_DOSE_COUNT:]
        return (last[-1].plant_m - last[0].plant_m) / (len(last) - 1) if len(last) > 1 else None

    @property
    def max_speed_mps(self) -> float:
        """Returns the ground speed above which doses are missed, by the spacing of the plants
        now known; infinity before the third plant."""
        places = self.row.places_m
        if len(places) < 3:
            return float("inf")
        return calc_max_speed_mps(
            float(np.median(np.diff(places))), self.mode.lag.turn_s, self.mode.rest_s
        )

    def may_still_be_turning(self, now_s: float) -> bool:
        """Returns whether an ordered dose may still be turning."""
        return (
            bool(self.given)
            and now_s < self.given[-1].time_s + self.lag.link_s + self.lag.turn_s + SHAFT_SETTLING_S
        )

    def find_reach_m(self, speed_mps: float) -> float:
        """Returns how far ahead a dose commanded now falls, m: lag distance and threshold."""
        return self.lag.find_distance_m(speed_mps) + self.mode.threshold.find_threshold_m(speed_mps)

    def look_for_plants(
        self,
        now_s: float,
        track_m: float,
        place: Place | None,
        heading_deg: float | None,
        speed_mps: float,
        seen: Sequence[CameraPlant],
    ) -> None:
        """Takes the plants ahead of the outlet. Nothing is taken where `place` is None (unknown,
        or turning). After a large change of heading the plants not yet dosed are forgotten."""
        self._way.append((now_s, track_m))
        while len(self._way) > 2 and self._way[1][1] < track_m - WAY_KEPT_M:
            self._way.popleft()
        fixed = self.mode.fixed_to_m
        if (
            heading_deg is not None
            and self._looked_deg is not None
            and abs((heading_deg - self._looked_deg + 180.0) % 360.0 - 180.0) > NEW_PASS_TURN_DEG
        ):
            self.row.drop_unseen([], max(fixed, track_m), float("inf"))
        if place is None or heading_deg is None:
            return
        self._looked_deg = heading_deg
        if self._plants is None:
            self.row.add_plants(
                [TrackedPlant(self._find_track_m(plant.time_s), plant.ahead_m) for plant in seen],
                fixed,
            )
        else:
            farthest = self.find_reach_m(speed_mps) + LOOK_BEYOND_LAG_M
            ahead = [
                TrackedPlant(track_m, d)
                for d in self._plants.find_plants_ahead_m(
                    place, heading_deg, farthest, self._half_width_m
                )
            ]
            self.row.drop_unseen(ahead, max(fixed, track_m), track_m + farthest)
            self.row.add_plants(ahead, fixed, newer=0.1)
        self.row.forget_behind(track_m - WAY_KEPT_M)

    def find_due_dose(
        self,
        now_s: float,
        track_m: float,
        speed_mps: float,
        period_s: float,
        may_flow: bool,
        at_work: bool,
    ) -> DueDose:
        """Returns the dose of this tick. Where flow is not allowed its plant is missed; out of
        work it is skipped."""
        half = 0.5 * period_s
        # Doses begin on ticks only.
        if period_s > 0.0:
            busy_s = math.ceil(self._busy_s / period_s - 1e-6) * period_s
            self.mode.rest_s = busy_s - self.lag.turn_s
        doses, missed = self.mode.plan_doses(
            now_s - half, track_m - half * speed_mps, speed_mps, period_s
        )
        self._waiting.extend((now_s - half + dose.in_s, dose) for dose in doses)
        if not at_work:
            self._waiting.clear()
            return NO_DOSE
        why = [miss.why for miss in missed]
        order = None
        if not may_flow:
            why += ["no_flow"] * len(self._waiting)
            self._waiting.clear()
        elif self._waiting and self._waiting[0][0] < now_s + half and now_s >= self._free_s - 1e-6:
            _, dose = self._waiting.popleft()
            self._free_s = now_s + self._busy_s
            self.doses += 1
            self.given.append(
                CommandedDose(
                    now_s, dose.plant_m, dose.threshold_m, dose.speed_mps, now_s + self.lag.total_s
                )
            )
            order = self.dose
        self.missed += len(why)
        return DueDose(order, tuple(why))

    def learn_dose_error(self, error_m: float, now_s: float) -> bool:
        """Takes an error measured now on the newest dose that has landed, late positive; False
        where there is none."""
        landed = next((given for given in reversed(self.given) if given.lands_s <= now_s), None)
        if landed is None:
            return False
        if self._learn:
            self.mode.threshold.learn_error(error_m, landed.speed_mps, landed.threshold_m)
        return True

    def _find_track_m(self, time_s: float) -> float:
        """Returns the track place of the outlet when a picture was taken, m."""
        later_s, later_m = self._way[-1]
        for at_s, at_m in reversed(self._way):
            if at_s <= time_s:
                share = (time_s - at_s) / (later_s - at_s) if later_s > at_s else 0.0
                return at_m + share * (later_m - at_m)
            later_s, later_m = at_s, at_m
        return later_m
