"""When is the dose of a plant commanded? When the distance to the plant is at most the lag
distance plus a threshold.

Point paper, eq 1-5 and section 1.3.2. The paper used its mean error as a constant threshold and
left updating it to later work; here the threshold is learnt from measured dose errors, as a
distance and a time, so that it also holds at other speeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from .plant_places import PlantRow

# Standard gravity, m/s2.
GRAVITY_MPS2 = 9.80665


class PointLag(NamedTuple):
    """Holds the four parts of a dose's lag, s (point paper, eq 1-4; eq 3 with the factor 6 that
    is missing in print)."""

    # This is 0 where the track place of the picture is known.
    vision_s: float
    link_s: float
    turn_s: float
    fall_s: float

    @property
    def total_s(self) -> float:
        """Returns the sum of the four parts, s."""
        return self.vision_s + self.link_s + self.turn_s + self.fall_s

    def find_distance_m(self, speed_mps: float) -> float:
        """Returns the lag distance L_d, m (eq 5). A falling dose keeps the machine's speed, so
        that every part counts with the same v."""
        return speed_mps * self.total_s


def calc_point_lag(
    turn_deg: float, shaft_rpm: float, fall_m: float, vision_s: float = 0.0, link_s: float = 0.8
) -> PointLag:
    """Returns the lag of a dose of `turn_deg` at a shaft speed, r/min.

    Raises
    ------
    ValueError : the shaft stands, or the fall is below 0."""
    if not (shaft_rpm > 0.0 and fall_m >= 0.0 and turn_deg > 0.0):
        raise ValueError(
            f"dose of {turn_deg:g} deg at {shaft_rpm:g} r/min, fall {fall_m:g} m: allowed "
            "is above 0"
        )
    return PointLag(
        # 6 n degrees per second is the angular speed; sqrt(2 h / g) is the time of a free fall.
        vision_s,
        link_s,
        turn_deg / (6.0 * shaft_rpm),
        (2.0 * fall_m / GRAVITY_MPS2) ** 0.5,
    )


@dataclass(frozen=True)
class ThresholdLearning:
    """Holds the speed of learning: prior standard deviations of the threshold's parts, that of a
    dose's error, and the memory in doses."""

    offset_sd_m: float = 0.10
    delay_sd_s: float = 0.10
    error_sd_m: float = 0.03
    memory_doses: float = 200.0
    # A larger threshold is no correction but a fault, m.
    most_m: float = 0.5
    outlier_sd: float = 4.0


class DoseThreshold:
    """Learns the threshold T = a + b v by recursive least squares from measured errors (landing
    place minus plant, late positive)."""

    def __init__(self, learning: ThresholdLearning | None = None) -> None:
        self._how = learning or ThresholdLearning()
        self.offset_m = 0.0
        self.delay_s = 0.0
        self.doses = 0
        # Variance of the offset, covariance, variance of the delay.
        self._p = (self._how.offset_sd_m**2, 0.0, self._how.delay_sd_s**2)

    def find_threshold_m(self, speed_mps: float) -> float:
        """Returns the threshold at a speed, m. It is added to the lag distance, so that a dose
        that landed late is commanded earlier."""
        most = self._how.most_m
        # A larger threshold is a fault and no correction.
        return min(most, max(-most, self.offset_m + self.delay_s * speed_mps))

    def learn_error(self, error_m: float, speed_mps: float, threshold_m: float) -> None:
        """Learns from one measured dose: its error, its speed and the threshold that it was
        commanded with. Outliers weigh less."""
        a, c, b = self._p
        # Old doses lose weight, so that recent doses count more.
        keep = 1.0 - 1.0 / self._how.memory_doses
        a, c, b = a / keep, c / keep, b / keep
        along_a, along_b = a + c * speed_mps, c + b * speed_mps
        spread = along_a + along_b * speed_mps + self._how.error_sd_m**2
        # The threshold in force when the dose was commanded is part of the measured error.
        missed = error_m + threshold_m - (self.offset_m + self.delay_s * speed_mps)
        limit = self._how.outlier_sd * spread**0.5
        # An outlier counts as an error at the limit, so that a mistyped value does little harm.
        missed = min(limit, max(-limit, missed))
        self.offset_m += along_a / spread * missed
        self.delay_s += along_b / spread * missed
        a, c, b = (
            a - along_a * along_a / spread,
            c - along_a * along_b / spread,
            b - along_b * along_b / spread,
        )
        # Forgetting must not make the variances larger than the prior ones.
        share = min(1.0, self._how.offset_sd_m**2 / a, self._how.delay_sd_s**2 / b)
        self._p = (share * a, share * c, share * b)
        self.doses += 1


class PlannedDose(NamedTuple):
    """Orders one turn of the shaft by the dose's angle, `in_s` from now: commands are sent on
    ticks, plants stand anywhere."""

    # Place of the plant along the track, m.
    plant_m: float
    in_s: float
    # Distance by which the command is late, m; 0: in time.
    late_m: float
    threshold_m: float
    speed_mps: float


class MissedPlant(NamedTuple):
    """Holds a plant that got no dose, and why: `busy` (the shaft turns for the plant before) or
    `passed` (seen too late)."""

    plant_m: float
    why: str


class PointMode:
    """Plans doses tick by tick; every plant is dosed once or reported as missed."""

    def __init__(
        self,
        lag: PointLag,
        row: PlantRow,
        threshold: DoseThreshold | None = None,
        latest_m: float = 0.08,
        rest_s: float = 0.0,
    ) -> None:
        """Starts with no dose planned. latest_m: a dose that would be later than this is missed,
        m; rest_s: pause of the shaft between doses."""
        self.lag = lag
        self.row = row
        self.threshold = threshold or DoseThreshold()
        self._latest_m = latest_m
        self.rest_s = rest_s
        self._done_to_m = float("-inf")
        # Time at which the shaft is free for the next dose, on the clock of commands, s.
        self._free_s = float("-inf")
        self.doses = 0
        self.missed = 0

    @property
    def fixed_to_m(self) -> float:
        """Returns the place up to which plants are dosed or missed, m."""
        return self._done_to_m

    def plan_doses(
        self, now_s: float, track_m: float, speed_mps: float, period_s: float
    ) -> tuple[list[PlannedDose], list[MissedPlant]]:
        """Returns the doses whose moment comes before the next tick, and the plants that can no
        longer be met."""
        doses: list[PlannedDose] = []
        missed: list[MissedPlant] = []
        # A standing machine meets no plant, and the division below needs a speed.
        if speed_mps <= 0.0:
            return doses, missed
        threshold = self.threshold.find_threshold_m(speed_mps)
        reach = self.lag.find_distance_m(speed_mps) + threshold
        while (plant := self.row.find_next_m(self._done_to_m)) is not None:
            in_s = (plant - track_m - reach) / speed_mps
            # Plants further away wait for a later tick with a newer position.
            if in_s >= period_s:
                break
            late_m = max(0.0, -in_s * speed_mps)
            begin = now_s + max(0.0, in_s)
            # A shaft that is still turning for the plant before delays the dose.
            wait_m = max(0.0, self._free_s - begin) * speed_mps
            self._done_to_m = plant
            # A dose that lands too late feeds no plant and would waste product.
            if late_m + wait_m > self._latest_m:
                missed.append(MissedPlant(plant, "busy" if wait_m > late_m else "passed"))
                continue
            begin = max(begin, self._free_s)
            self._free_s = begin + self.lag.turn_s + self.rest_s
            doses.append(PlannedDose(plant, begin - now_s, late_m + wait_m, threshold, speed_mps))
        self.doses += len(doses)
        self.missed += len(missed)
        return doses, missed


def calc_max_speed_mps(spacing_m: float, turn_s: float, rest_s: float = 0.0) -> float:
    """Returns the ground speed above which doses are missed, m/s: one dose must end before the
    next begins.

    Raises
    ------
    ValueError : the spacing is not above 0."""
    if not spacing_m > 0.0:
        raise ValueError(f"plant spacing {spacing_m:g} m: allowed is above 0")
    return spacing_m / (turn_s + rest_s)
