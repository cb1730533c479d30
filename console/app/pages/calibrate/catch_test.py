"""Records a catch test: settle, then catch and weigh, at three settings or more. Time and
revolutions are counted from frames.

At five samples a second, a start or stop of the shaft (a ramp of 200 r/min per s) is counted to
0.02 revolutions; thirty revolutions are counted to 0.1 %.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from statistics import fmean
from typing import Literal, NamedTuple

# The shaft stands below this speed, r/min; the paper on the lag starts its clock at the same
# threshold.
MIN_TURNING_RPM = 2.0
# After this time, s, flutes and tubes are full and the gate is at rest.
SETTLING_TIME_S = 5.0
# Advised duration of a catch, s; the bar on the screen is full after this time.
ADVISED_CATCH_S = 30.0
# A catch of fewer revolutions is too inaccurate for a point.
MIN_CATCH_REVOLUTIONS = 3.0
# A line through fewer points has no measure of its scatter.
MIN_CATCHES = 3
# Nothing is counted between two frames that are further apart than this, s: frames were lost.
MAX_FRAME_STEP_S = 1.0
# Readings averaged from the resting hopper scale, at five a second.
RESTING_READINGS = 15
# Largest error of a caught mass by the hopper scale, kg: four standard deviations (0.15 kg each) of
# one reading.
SCALE_ERROR_KG = 0.6
# The gain of a hopper scale is accurate to a few percent; a larger relative difference means that
# one of the two masses is wrong.
SCALE_ERROR_SHARE = 0.25
# Products differ by less than this factor in grams per revolution; a missing decimal point gives at
# least 10.
MAX_MODEL_RATIO = 3.0

CatchPhase = Literal["settle", "weigh"]


class CatchPoint(NamedTuple):
    """Holds one weighed catch of all outlets together.

    Attributes
    ----------
    shaft_rpm, opening_mm
        Means weighted by revolutions, so that ramps hardly count.
    duration_s
        Time such that shaft_rpm x duration_s / 60 is the number of revolutions, s.
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
        """Mass per revolution, g."""
        return 1000.0 * self.mass_kg / self.revolutions


class ShaftTurns(NamedTuple):
    """Holds the revolutions of the shaft in one phase."""

    seconds: float = 0.0
    revolutions: float = 0.0
    # Shaft speed and opening, each summed with the revolutions as weights.
    shaft_rpm_rev: float = 0.0
    opening_mm_rev: float = 0.0

    def add_interval(self, dt_s: float, shaft_rpm: float, opening_mm: float) -> ShaftTurns:
        """Return the counts after another interval, with the mean speed and opening over dt_s."""
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
    """Records the setting, the run in progress and the catches weighed so far."""

    def __init__(self, shaft_rpm: float, opening_mm: float) -> None:
        self.shaft_rpm, self.opening_mm = shaft_rpm, opening_mm
        self.phase: CatchPhase = "settle"
        self.shaft_turns = ShaftTurns()
        self.points: list[CatchPoint] = []
        self._last: _CatchSample | None = None
        self._resting_kg: deque[float] = deque(maxlen=RESTING_READINGS)
        self._before_kg: float | None = None

    def change_setting(
        self, shaft_rpm: float | None = None, opening_mm: float | None = None
    ) -> None:
        """Change the setting, which has to settle first; a catch that was not weighed is
        dropped."""
        shaft_rpm = self.shaft_rpm if shaft_rpm is None else shaft_rpm
        opening_mm = self.opening_mm if opening_mm is None else opening_mm
        if (shaft_rpm, opening_mm) != (self.shaft_rpm, self.opening_mm):
            self.shaft_rpm, self.opening_mm = shaft_rpm, opening_mm
            self.settle_again()

    def settle_again(self) -> None:
        """Begin to settle again; weighed points remain."""
        self.phase, self.shaft_turns, self._before_kg = "settle", ShaftTurns(), None

    @property
    def can_weigh(self) -> bool:
        """Whether the catch has enough revolutions to be weighed."""
        return self.phase == "weigh" and self.shaft_turns.revolutions >= MIN_CATCH_REVOLUTIONS

    @property
    def scale_loss_kg(self) -> float | None:
        """Mass that the hopper scale lost during the catch, kg, including the scale's noise; None
        while the scale is not at rest."""
        # A third of the readings suffices, so that a short rest between runs is enough.
        if self._before_kg is None or len(self._resting_kg) < RESTING_READINGS // 3:
            return None
        return self._before_kg - fmean(self._resting_kg)

    def contradicts_scale(self, mass_kg: float) -> bool:
        """Return whether the hopper scale contradicts this mass."""
        says = self.scale_loss_kg
        return says is not None and abs(mass_kg - says) > max(
            SCALE_ERROR_KG, SCALE_ERROR_SHARE * max(says, mass_kg)
        )

    def predict_kg(self, of: Callable[[float, float, float], float]) -> float:
        """Return the mass that the model expects for the revolutions of this catch, kg.

        Parameters
        ----------
        of
            `CalibrateService.expected_kg`.
        """
        turned = self.shaft_turns
        return of(
            turned.shaft_rpm_rev / turned.revolutions,
            turned.opening_mm_rev / turned.revolutions,
            turned.revolutions,
        )

    def add_weighed_catch(self, mass_kg: float) -> None:
        """Add a point with the caught mass. The next catch at this setting needs no settling."""
        turned = self.shaft_turns
        shaft_rpm = turned.shaft_rpm_rev / turned.revolutions
        self.points.append(
            CatchPoint(
                shaft_rpm,
                turned.opening_mm_rev / turned.revolutions,
                60.0 * turned.revolutions / shaft_rpm,
                mass_kg,
            )
        )
        self.shaft_turns, self._before_kg = ShaftTurns(), None

    def undo_point(self) -> None:
        """Remove the last point."""
        if self.points:
            self.points.pop()

    def pause_counting(self) -> None:
        """Stop counting, because the machine does something else and its revolutions belong to no
        catch."""
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
        """Count a frame.

        Parameters
        ----------
        time_s
            Time of the frame, s.
        shaft_rpm, opening_mm, hopper_kg
            Measurements; None where unknown.
        running
            True while the key is held. The shaft counts until it stands again.
        """
        now = (
            None
            if shaft_rpm is None
            else _CatchSample(
                time_s, shaft_rpm, self.opening_mm if opening_mm is None else opening_mm
            )
        )
        last, self._last = self._last, now
        turning = now is not None and now.shaft_rpm > MIN_TURNING_RPM
        if turning or running:
            # The scale is valid only at rest, so the mass before the catch is the mean up to the
            # first revolution.
            if self.shaft_turns.revolutions == 0.0 and self._resting_kg:
                self._before_kg = fmean(self._resting_kg)
            self._resting_kg.clear()
        elif hopper_kg is not None:
            self._resting_kg.append(hopper_kg)
        if last is None or now is None or not 0.0 < now.time_s - last.time_s <= MAX_FRAME_STEP_S:
            return
        # The trapezoidal mean counts ramps correctly between two frames.
        mean_rpm = 0.5 * (max(0.0, now.shaft_rpm) + max(0.0, last.shaft_rpm))
        if mean_rpm > MIN_TURNING_RPM:
            mean_mm = 0.5 * (now.opening_mm + last.opening_mm)
            self.shaft_turns = self.shaft_turns.add_interval(
                now.time_s - last.time_s, mean_rpm, mean_mm
            )
        elif not running and self.phase == "settle" and self.shaft_turns.seconds >= SETTLING_TIME_S:
            self.phase, self.shaft_turns, self._before_kg = "weigh", ShaftTurns(), None
