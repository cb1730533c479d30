"""The scale against the flow model: a recursive estimate of how far the flow is off, with its uncertainty.

Filter `flow_trim`. A Kalman filter once a block of `BLOCK_S`; its state is the mass in the hopper and three effects
that a scale can tell while working: the gain (density, product, head of the hopper, moisture: a slow random walk), what
flows more a revolution whatever the opening, and what a degree of pitch does. The first stands out at once, the second
where the opening changes, the third on a slope. Nothing else shows on a scale: what goes on in the tube does not.

It never goes faster than its evidence: where the estimate is x standard deviations from what is trimmed, the trim goes
1 - (DOUBT_SD / x)^2 of the way, and does not move below `DOUBT_SD`. At 0.09 kg/s, with the shipped scale (0.15 kg,
correlated over 1 s), 80 % of an error of 6 % is taken back after some 80 s; a healthy machine is trimmed by 0.1 %.

Inputs: measured shaft and opening through the model, `hopper_kg`, `pitch_deg`; output: `flow_trim`. All are logged.
"""
from __future__ import annotations

from dataclasses import dataclass
from math import exp, sqrt

import numpy as np

from control.machine.elements import Array
from control.readings import Reading


@dataclass(frozen=True)
class FlowTrimLimits:
    """Standard deviations unless it says otherwise."""

    most_share: float = 0.25            # of the flow, that is trimmed at most
    gain_percent: float = 5.0           # what a product is off before its catch test: 5-50 %
    offset_g_rev: float = 4.0           # an offset near 8 g per revolution is published
    slope_percent_per_deg: float = 0.5  # 0.3-1 % per degree are published
    wanders_percent: float = 1.0        # the gain, in the square root of an hour: head 1-3 % an hopper, moisture
    another_lot_percent: float = 1.5    # the gain, at a refill: with 3 every refill was a minute of noise trimmed
    changed_percent: float = 10.0       # the gain, where the scale runs away from it: an outlet of six is 17 %
    level_kg: float = 100.0             # the mass in the hopper, before the first weighing


BLOCK_S = 2.0               # weighings are averaged over this: two correlation times of the scale's noise
DOUBT_SD = 1.5              # an estimate nearer to what is trimmed moves nothing
REFILL_KG = 2.0             # the scale rising this much from one weighing to the next is a refill
OUTLIER_SD = 4.5            # a block further off: something stands on the hopper, or was taken off it
RUNS_AWAY_SD = 4.5          # the mean of what blocks were off, by `KEEPS`: the flow has changed
KEEPS = 0.9
NOISE_RATE = 0.02           # how quickly the scale is believed to be noisier than its file says ...
NOISE_BLOCKS = 4.0          # ... and sooner at first, as if so many blocks had said that it is not
NOISE_MOST = 100.0          # times the variance
STALE_S = 1.0               # an older weighing says nothing
LEAST_G_REV = 1.0           # of the model, to say what an offset is worth

H, GAIN, OFFSET, SLOPE = range(4)


class FlowTrim:
    """One of a run. `update` once a tick; `at` is what the model's flow is multiplied by."""

    def __init__(self, scale_kg: float = 0.15, correlation_s: float = 1.0,
                 limits: FlowTrimLimits = FlowTrimLimits()) -> None:
        """scale_kg, correlation_s: the scale's noise, as the machine file has it."""
        self._limits = limits
        self._block_kg2 = scale_kg ** 2 * min(1.0, 2.0 * correlation_s / BLOCK_S)
        self._state = np.zeros(4)
        self._spread = np.diag([limits.level_kg, limits.gain_percent, limits.offset_g_rev,
                                limits.slope_percent_per_deg]) ** 2
        self._trimmed = np.zeros(3)             # of the state without the level: as far as it is believed
        self._noise = 1.0                       # times the file's variance
        self._judged = 0                        # blocks that spoke of the noise
        self._off = 0.0                         # kept mean of what blocks were off, in their standard deviations
        self._sums = np.zeros(3)                # expected kg, 1000 revolutions, kg x degrees: so far
        self._block: list[tuple[Array, float]] = []
        self._since_s = 0.0
        self._before: Array | None = None       # sums in the middle of the block before
        self._before_s = 0.0
        self._last_kg: float | None = None
        self._weighed_s: float | None = None
        self.grams_per_rev, self.pitch_deg = 100.0, 0.0     # of the newest tick

    @property
    def value(self) -> float:
        """What the flow of now is multiplied by."""
        return self.at(self.grams_per_rev, self.pitch_deg)

    @property
    def sd_percent(self) -> float:
        """Of the estimate for the flow of now."""
        shows = _shows(self.grams_per_rev, self.pitch_deg)
        return sqrt(max(1e-12, float(shows @ self._spread[GAIN:, GAIN:] @ shows)))

    def at(self, grams_per_rev: float, pitch_deg: float) -> float:
        """What the model's flow is multiplied by, where a revolution gives so much by the model."""
        most, trimmed = self._limits.most_share, 0.01 * float(self._trimmed @ _shows(grams_per_rev, pitch_deg))
        return 1.0 + min(most, max(-most, trimmed))

    def go_on(self, value: float) -> None:
        """With what a part of the job before has learnt."""
        self._state[GAIN] = self._trimmed[GAIN - 1] = 100.0 * (value - 1.0)
        if value != 1.0:
            self._spread[GAIN, GAIN] = self._spread[OFFSET, OFFSET] = 1.0

    def restart(self, another_lot: bool = False) -> None:
        """After a pause, a tare or a refill the level is another one; after a refill the lot may be."""
        self._block.clear()
        self._before = None
        self._off = 0.0
        self._spread[H, :] = self._spread[:, H] = 0.0
        self._spread[H, H] = self._limits.level_kg ** 2
        if another_lot:
            self._spread[GAIN, GAIN] += self._limits.another_lot_percent ** 2

    def update(self, now_s: float, dt_s: float, model_flow_kg_s: float, shaft_rpm: float, pitch_deg: float,
               scale: Reading | None) -> None:
        """`model_flow_kg_s`: from measured shaft and opening, without this trim."""
        if shaft_rpm > 0.0 and model_flow_kg_s > 0.0:
            self.grams_per_rev = max(LEAST_G_REV, model_flow_kg_s * 60_000.0 / shaft_rpm)
        self.pitch_deg = pitch_deg
        given_kg = model_flow_kg_s * dt_s
        turned = shaft_rpm / 60_000.0 * dt_s if given_kg > 0.0 else 0.0
        self._sums = self._sums + np.array([given_kg, turned, given_kg * pitch_deg])
        if scale is None or now_s - scale.time_s > STALE_S or scale.time_s == self._weighed_s:
            return
        self._weighed_s = scale.time_s
        if self._last_kg is not None and scale.value - self._last_kg > REFILL_KG:
            self.restart(another_lot=True)
        self._last_kg = scale.value
        if not self._block:
            self._since_s = now_s
        self._block.append((self._sums, scale.value))
        if now_s - self._since_s >= BLOCK_S:
            self._take_block(now_s)

    def _take_block(self, now_s: float) -> None:
        sums = np.mean([one for one, _ in self._block], axis=0)
        weighed = float(np.mean([kg for _, kg in self._block]))
        self._block.clear()
        if self._before is None:
            self._level(weighed)
        else:
            self._gone(sums - self._before, now_s - self._before_s)
            self._weighed(weighed)
            self._believe()
        self._before, self._before_s = sums, now_s

    def _gone(self, gone: Array, since_s: float) -> None:
        """What left the hopper since the block before, by the model and what is believed of it."""
        step = np.eye(4)
        step[H, GAIN], step[H, OFFSET], step[H, SLOPE] = -0.01 * gone[0], -gone[1], -0.01 * gone[2]
        self._state = step @ self._state
        self._state[H] -= gone[0]
        self._spread = step @ self._spread @ step.T
        self._spread[GAIN, GAIN] += self._limits.wanders_percent ** 2 * since_s / 3600.0

    def _weighed(self, weighed_kg: float) -> None:
        variance = float(self._spread[H, H]) + self._noise * self._block_kg2
        off = (weighed_kg - float(self._state[H])) / sqrt(variance)
        if abs(off) > OUTLIER_SD:
            self._level(weighed_kg)
            return
        gain = self._spread[:, H] / variance
        self._state = self._state + gain * off * sqrt(variance)
        rest = np.eye(4)
        rest[:, H] -= gain
        self._spread = rest @ self._spread @ rest.T + np.outer(gain, gain) * self._noise * self._block_kg2
        self._judged += 1
        rate = max(NOISE_RATE, 1.0 / (NOISE_BLOCKS + self._judged))
        self._noise = min(NOISE_MOST, max(1.0, self._noise * exp(rate * (min(9.0, off * off) - 1.0))))
        self._off = KEEPS * self._off + (1.0 - KEEPS) * off
        if abs(self._off) > RUNS_AWAY_SD * sqrt((1.0 - KEEPS) / (1.0 + KEEPS)):
            self._level(weighed_kg)
            self._spread[GAIN, GAIN] += self._limits.changed_percent ** 2
            self._off = 0.0

    def _level(self, weighed_kg: float) -> None:
        """The hopper holds what was just weighed, whatever was thought before."""
        self._state[H] = weighed_kg
        self._spread[H, :] = self._spread[:, H] = 0.0
        self._spread[H, H] = self._noise * self._block_kg2

    def _believe(self) -> None:
        """The trim goes towards the estimate as far as the evidence for the flow of now goes."""
        apart = self._state[GAIN:] - self._trimmed
        percent, sd = float(apart @ _shows(self.grams_per_rev, self.pitch_deg)), self.sd_percent
        if abs(percent) > DOUBT_SD * sd:
            self._trimmed = self._trimmed + (1.0 - (DOUBT_SD * sd / percent) ** 2) * apart


def _shows(grams_per_rev: float, pitch_deg: float) -> Array:
    """What a unit of each effect makes of the flow, %."""
    return np.array([1.0, 100.0 / max(LEAST_G_REV, grams_per_rev), pitch_deg])
