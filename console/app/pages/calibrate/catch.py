"""The catch test: settle, then catch and weigh, at three settings or more. Counts seconds and
revolutions from frames.

Sampling five times a second, a start or a stop of the shaft is counted to 0.02 revolutions (the
corner of a ramp of 200 r/min per s); thirty revolutions are counted to 0.1 %.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from statistics import fmean
from typing import Literal, NamedTuple

# below this the shaft stands: the lag paper starts its clock here
TURNING_RPM = 2.0
# flutes and tubes are full and the gate stands still after that
SETTLING_S = 5.0
ADVISED_WEIGH_S = 30.0  # advised
LEAST_REVOLUTIONS = 3.0  # fewer revolutions make no point
LEAST_CATCHES = 3
# frames farther apart: nothing is counted between them
LONGEST_STEP_S = 1.0
RESTING_READINGS = 15  # of the hopper scale, five a second
# four s.d. (0.15 kg) of one reading of a hopper scale: it says that much wrong of a catch
SCALE_ERROR_KG = 0.6
# and its gain a few percent: farther off than this, one of the two is wrong
SCALE_ERROR_SHARE = 0.25
# products differ by less in grams a turn; a lost decimal sign makes 10 at least
MODEL_FACTOR = 3.0

CatchPhase = Literal["settle", "weigh"]


class CatchPoint(NamedTuple):
    """Holds one weighed catch, all outlets together.

    shaft_rpm, opening_mm: means over the revolutions, so that ramps hardly count; duration_s: such
    that shaft_rpm x duration_s are the revolutions.
    """

    shaft_rpm: float
    opening_mm: float
    duration_s: float
    mass_kg: float

    @property
    def revolutions(self) -> float:
        """Revolutions of the shaft."""
        return self.shaft_rpm * self.duration_s / 60.0

    @property
    def grams_per_revolution(self) -> float:
        """Mass of a revolution, g."""
        return 1000.0 * self.mass_kg / self.revolutions


class ShaftTurns(NamedTuple):
    """Holds the shaft's turns in one phase."""

    seconds: float = 0.0
    revolutions: float = 0.0
    # shaft speed and opening, summed over revolutions
    shaft_rpm_rev: float = 0.0
    opening_mm_rev: float = 0.0

    def add_interval(self, dt_s: float, shaft_rpm: float, opening_mm: float) -> ShaftTurns:
        """The turns with an interval more. shaft_rpm, opening_mm: means over dt_s."""
        turned = shaft_rpm * dt_s / 60.0
        return ShaftTurns(
            self.seconds + dt_s,
            self.revolutions + turned,
            self.shaft_rpm_rev + shaft_rpm * turned,
            self.opening_mm_rev + opening_mm * turned,
        )


class _CatchSample(NamedTuple):
    time_s: float
    shaft_rpm: float
    opening_mm: float


class CatchRun:
    """Records settings, runs and weighed catches so far."""

    def __init__(self, shaft_rpm: float, opening_mm: float) -> None:
        self.shaft_rpm, self.opening_mm = shaft_rpm, opening_mm
        self.phase: CatchPhase = "settle"
        self.turned = ShaftTurns()
        self.points: list[CatchPoint] = []
        self._last: _CatchSample | None = None
        self._resting_kg: deque[float] = deque(maxlen=RESTING_READINGS)
        self._before_kg: float | None = None

    def change_setting(
        self, shaft_rpm: float | None = None, opening_mm: float | None = None
    ) -> None:
        """Take another setting, which has to settle first; a catch that is not weighed is
        forgotten."""
        shaft_rpm = self.shaft_rpm if shaft_rpm is None else shaft_rpm
        opening_mm = self.opening_mm if opening_mm is None else opening_mm
        if (shaft_rpm, opening_mm) != (self.shaft_rpm, self.opening_mm):
            self.shaft_rpm, self.opening_mm = shaft_rpm, opening_mm
            self.settle_again()

    def settle_again(self) -> None:
        """Settle anew; the points stay."""
        self.phase, self.turned, self._before_kg = "settle", ShaftTurns(), None

    @property
    def can_weigh(self) -> bool:
        """Whether enough is caught to be weighed."""
        return self.phase == "weigh" and self.turned.revolutions >= LEAST_REVOLUTIONS

    @property
    def scale_loss_kg(self) -> float | None:
        """Loss of the hopper scale in the catch, kg: a hint along with the weighed mass, with the
        scale's own noise."""
        if self._before_kg is None or len(self._resting_kg) < RESTING_READINGS // 3:
            return None
        return self._before_kg - fmean(self._resting_kg)

    def is_against_scale(self, mass_kg: float) -> bool:
        """Whether the hopper scale lost quite another mass than this."""
        says = self.scale_loss_kg
        return says is not None and abs(mass_kg - says) > max(
            SCALE_ERROR_KG, SCALE_ERROR_SHARE * max(says, mass_kg)
        )

    def predict_kg(self, of: Callable[[float, float, float], float]) -> float:
        """Mass that the model expects for the turns of this catch, kg. of:
        `CalibrateService.expected_kg`."""
        turned = self.turned
        return of(
            turned.shaft_rpm_rev / turned.revolutions,
            turned.opening_mm_rev / turned.revolutions,
            turned.revolutions,
        )

    def add_weighed(self, mass_kg: float) -> None:
        """Make a point of the caught mass; the same setting may be caught again without
        settling."""
        turned = self.turned
        shaft_rpm = turned.shaft_rpm_rev / turned.revolutions
        self.points.append(
            CatchPoint(
                shaft_rpm,
                turned.opening_mm_rev / turned.revolutions,
                60.0 * turned.revolutions / shaft_rpm,
                mass_kg,
            )
        )
        self.turned, self._before_kg = ShaftTurns(), None

    def undo_point(self) -> None:
        """Drop the last point."""
        if self.points:
            self.points.pop()

    def pause_counting(self) -> None:
        """Stop counting: the machine does other things, so its turns are no catch."""
        self._last = None
        self._resting_kg.clear()

    def add_frame(
        self,
        time_s: float,
        shaft_rpm: float | None,
        opening_mm: float | None,
        hopper_kg: float | None,
        running: bool,
    ) -> None:
        """Count a frame. running: a run is going on; the shaft is counted until it stands again."""
        now = (
            None
            if shaft_rpm is None
            else _CatchSample(
                time_s, shaft_rpm, self.opening_mm if opening_mm is None else opening_mm
            )
        )
        last, self._last = self._last, now
        turning = now is not None and now.shaft_rpm > TURNING_RPM
        if turning or running:
            if self.turned.revolutions == 0.0 and self._resting_kg:
                self._before_kg = fmean(self._resting_kg)
            self._resting_kg.clear()
        elif hopper_kg is not None:
            self._resting_kg.append(hopper_kg)
        if last is None or now is None or not 0.0 < now.time_s - last.time_s <= LONGEST_STEP_S:
            return
        mean_rpm = 0.5 * (max(0.0, now.shaft_rpm) + max(0.0, last.shaft_rpm))
        if mean_rpm > TURNING_RPM:
            mean_mm = 0.5 * (now.opening_mm + last.opening_mm)
            self.turned = self.turned.add_interval(now.time_s - last.time_s, mean_rpm, mean_mm)
        elif not running and self.phase == "settle" and self.turned.seconds >= SETTLING_S:
            self.phase, self.turned, self._before_kg = "weigh", ShaftTurns(), None
