"""How late does a receiver's speed arrive? The delay is measured against the wheel.

GNSS's speed corrects the wheel's. Compared with the present wheel speed, a speed that arrives
0.4 s late is 0.2 m/s wrong while the machine accelerates, and a correction that follows slip
within seconds would follow that error too. So the delay is measured: while GNSS's speed changes,
its change over a second is compared with the wheel's change some tenths of a second earlier.
Changes are compared because slip and tyre size are in the level; changes of GNSS's speed,
because a wheel that begins to slip changes although the machine does not. For each candidate
delay a sum of squares is kept, and the odds follow from these sums."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import exp, sqrt
from typing import NamedTuple

# Candidate delays, s: GNSS speeds arrive 0.1 to 1 s late (effect `speed.gnss_latency`).
CANDIDATE_DELAYS_S = tuple(0.1 * k for k in range(11))
# A change of speed is the difference over this time, s.
CHANGE_SPAN_S = 1.0
# The wheel's speed at a moment is its mean over this time, s: some pulses.
WHEEL_AVERAGE_S = 0.2
# Least change of GNSS's speed that a delay is learnt from, m/s: seven times its noise.
MIN_CHANGE_MPS = 0.2
# Standard deviation of the difference of the two changes at the right delay, m/s: noise of both.
# Epochs 0.2 s apart share most of their second.
CHANGE_SD_MPS = 0.1
# Time constant of forgetting, s of driving with changes of speed: receivers are exchanged.
MEMORY_S = 600.0
# Standard deviation of the delay within a step of the candidates, s.
DELAY_STEP_SD_S = 0.03
# Standard deviation of a GNSS speed, m/s, as `place_drift.SPEED_STEP_SD_MPS`.
SPEED_SD_MPS = 0.03


class DelayedWheel(NamedTuple):
    """Holds the wheel's mean speed at the moment that an epoch's speed belongs to, and the
    weight of the comparison, 0 to 1: with a poorly known delay it falls as the machine's speed
    changes."""

    speed_mps: float
    weight: float


class GnssDelay:
    """Estimates the delay of a receiver's speed. `record_wheel` is called once a tick with a
    trusted wheel, `take_epoch` once for each trusted GNSS speed."""

    def __init__(self) -> None:
        self._times_s: deque[float] = deque()
        self._ways_m: deque[float] = deque()
        # Time, s, and speed, m/s, of the epochs of the last second.
        self._epochs: deque[tuple[float, float]] = deque()
        self._squares = [0.0] * len(CANDIDATE_DELAYS_S)
        # Mean and standard deviation of the delay, s.
        self.delay_and_sd_s = self._estimate_delay_s()

    def record_wheel(self, time_s: float, wheel_mps: float, dt_s: float) -> None:
        """Adds the wheel's distance of one tick."""
        if self._times_s and not 0.0 < time_s - self._times_s[-1] < CHANGE_SPAN_S:
            self._times_s.clear()
            self._ways_m.clear()
        self._ways_m.append((self._ways_m[-1] if self._ways_m else 0.0) + wheel_mps * dt_s)
        self._times_s.append(time_s)
        while (
            time_s - self._times_s[0]
            > CANDIDATE_DELAYS_S[-1] + CHANGE_SPAN_S + WHEEL_AVERAGE_S + 0.1
        ):
            self._times_s.popleft()
            self._ways_m.popleft()

    def _estimate_delay_s(self) -> tuple[float, float]:
        least = min(self._squares)
        odds = [exp(-0.5 * (squares - least) / CHANGE_SD_MPS**2) for squares in self._squares]
        mean = sum(delay * odd for delay, odd in zip(CANDIDATE_DELAYS_S, odds, strict=True)) / sum(
            odds
        )
        spread = sum(
            odd * (delay - mean) ** 2 for delay, odd in zip(CANDIDATE_DELAYS_S, odds, strict=True)
        ) / sum(odds)
        return mean, sqrt(spread + DELAY_STEP_SD_S**2)

    def take_epoch(self, time_s: float, gnss_mps: float, ratio: float) -> DelayedWheel | None:
        """Stores a GNSS speed and returns the wheel speed for comparison; None where the wheel has
        not been trusted for long enough.

        Parameters
        ----------
        time_s : time of the epoch, s. gnss_mps : the receiver's speed, m/s. ratio : the present
        correction factor of the wheel.
        """
        while self._epochs and time_s - self._epochs[0][0] > CHANGE_SPAN_S + 1e-6:
            self._epochs.popleft()
        before = (
            self._epochs[0]
            if self._epochs and time_s - self._epochs[0][0] > 0.5 * CHANGE_SPAN_S
            else None
        )
        self._epochs.append((time_s, gnss_mps))
        change_mps = 0.0 if before is None else (gnss_mps - before[1]) / (time_s - before[0])
        if before is not None and abs(gnss_mps - before[1]) >= MIN_CHANGE_MPS:
            self._learn_delay(time_s, gnss_mps - before[1], before[0], ratio)
        delay_s, sd_s = self.delay_and_sd_s
        then_mps = self._average_wheel_mps(time_s - delay_s)
        if then_mps is None:
            return None
        return DelayedWheel(
            then_mps, SPEED_SD_MPS**2 / (SPEED_SD_MPS**2 + (change_mps * sd_s) ** 2)
        )

    def _learn_delay(self, time_s: float, change_mps: float, before_s: float, ratio: float) -> None:
        changes = []
        for delay_s in CANDIDATE_DELAYS_S:
            now, then = (
                self._average_wheel_mps(time_s - delay_s),
                self._average_wheel_mps(before_s - delay_s),
            )
            if now is None or then is None:
                return
            changes.append(ratio * (now - then))
        keep = exp(-(time_s - self._epochs[-2][0]) / MEMORY_S)
        self._squares = [
            keep * squares + (change_mps - change) ** 2
            for squares, change in zip(self._squares, changes, strict=True)
        ]
        self.delay_and_sd_s = self._estimate_delay_s()

    def _average_wheel_mps(self, at_s: float) -> float | None:
        """Returns the mean wheel speed around a moment, m/s; None where it is not known."""
        if not self._times_s or at_s - 0.5 * WHEEL_AVERAGE_S < self._times_s[0]:
            return None
        end_s = min(at_s + 0.5 * WHEEL_AVERAGE_S, self._times_s[-1])
        begin_s = min(at_s - 0.5 * WHEEL_AVERAGE_S, end_s - 0.5 * WHEEL_AVERAGE_S)
        return (self._find_way_m(end_s) - self._find_way_m(begin_s)) / (end_s - begin_s)

    def _find_way_m(self, at_s: float) -> float:
        k = bisect_right(self._times_s, at_s)
        if k >= len(self._times_s):
            return self._ways_m[-1]
        share = (at_s - self._times_s[k - 1]) / (self._times_s[k] - self._times_s[k - 1])
        return self._ways_m[k - 1] + share * (self._ways_m[k] - self._ways_m[k - 1])
