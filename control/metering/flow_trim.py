"""Does the hopper scale confirm the flow that shaft and opening give? The trim of the flow
model, and faults that no trim may hide.

The data are one series of blocks of `BLOCK_S`: what the model says has left the hopper by then,
and what the scale read at which pitch. The filter `flow_trim` is a Kalman filter on this series.
Its state is the mass in the hopper; three effects of the flow that a scale can measure while
working: the gain (density, product, head of the hopper, moisture: a slow random walk), an offset
for each revolution whatever the opening, and an effect of pitch; and three of the scale itself:
the error for a degree of pitch, the share of the cosine of the pitch in its reading, and the
load of wind. So two readings at different pitch are compared only as closely as these are known.
Wind is a load that returns to its mean (`SWAY_TAU_S`, first-order Gauss-Markov). Its variance is
learnt from second differences of the readings, in which no straight line shows; on a calm scale
it is 0, and the filter works as without it.

The filter never goes faster than its evidence: where the estimate is x standard deviations from
the trim, the trim goes 1 - (DOUBT_SD / x)^2 of the way, and below `DEAD_BAND_SD` it does not move.
The estimate is kept within `most_percent`, and weighted by the flow's own prior variance (by the
age of its catch test) against the scale's.

The watch compares the present reading with what the filter of 2, 4, ... 120 blocks ago predicts.
Where they differ by more than `CHANGE_SD`:

- nothing turns and the scale falls: material leaves that nobody ordered (`unordered_kg`); the
scale rises: the hopper is filled;
- material flows: the trim returns to its value of then, and rests. A straight line through the
blocks since then gives the share of the model's flow that really left; its standard deviation
comes from its own residuals, so that a scale that sways shows nothing. From `DECISION_FLOW_S` of
flow on the finding is `share` (too far off), `outlets` (closed ones, where the drive works harder
since then), `below_percent` (a fall that may be closed outlets), `beyond_percent` (more than is
trimmed: the trim is 1), or a change that may be trimmed. The same line through the last two
minutes finds what was wrong from the start.

The limit of a difference follows from what the filter of then knew: the file's noise, scaled by
the noise that its readings showed, and the wind of then. Where nothing turns, also from the
present wind, and from as much wind as a scale may still have that has not shown that it is calm.

Inputs: measured shaft and opening through the model, `hopper_kg`, `pitch_deg`; output:
`flow_trim`. All are logged."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from math import cos, exp, hypot, inf, log, radians, sqrt
from typing import NamedTuple

import numpy as np
from topdress.control.machine.scale import Scale
from topdress.control.readings import NO_SCALE_FINDING, Reading, ScaleFinding
from topdress.control.signals import VALID_FOR


@dataclass(frozen=True)
class FlowTrimLimits:
    """Holds the limits of the flow trim; standard deviations unless a comment says otherwise."""

    # Greatest trim, % of the flow; a larger error is reported instead.
    most_percent: float = 10.0
    # Error of a product's flow before its catch test: 5 to 50 % are usual.
    gain_percent: float = 5.0
    # Error of the scale's gain; 0.5 to 5 % are usual (effect scale.gain).
    scale_percent: float = 1.0
    # Offset of the flow for each revolution; one near 8 g is published.
    offset_g_rev: float = 4.0
    # Effect of pitch on the flow; 0.3 to 1 % per degree are published.
    slope_percent_per_deg: float = 0.5
    # Effect of pitch on the scale: side load on its cells makes 0 to 0.3 % per degree.
    tilt_percent_per_deg: float = 0.15
    # Error of the machine file's cosine share: cells on the frame read all of it, others none.
    cosine_share: float = 0.5
    # Random walk of the gain in the square root of an hour: head 1 to 3 % a hopper, moisture.
    wanders_percent: float = 1.0
    # Change of the gain at a refill; with 3 every refill was followed by a minute of trimmed noise.
    another_lot_percent: float = 1.5
    # Change of the gain where the flow has changed by itself.
    changed_percent: float = 10.0
    # Mass in the hopper before the first weighing.
    level_kg: float = 100.0
    # Lowest share of the model's flow at which shaft and scale can both be right.
    low_share: float = 0.5
    # Highest share of the model's flow at which shaft and scale can both be right.
    high_share: float = 1.5
    # Bags are within 1 to 2 % of their label: a rise that differs by more is an error of the
    # scale's gain.
    refill_percent: float = 5.0


# Weighings are averaged over this time, s.
BLOCK_S = 1.0
# An estimate closer to the trim than this, standard deviations, does not move it.
DEAD_BAND_SD = 1.2
# A rise of the scale by this much from one weighing to the next, kg, is a refill.
REFILL_KG = 2.0
# Difference from the prediction that is a change, standard deviations: with 7 tests a second none
# is wrong in months.
CHANGE_SD = 5.0
# Lengths of the watch's windows, blocks; a quarter of each is averaged at its end.
WINDOW_BLOCKS = (2, 4, 8, 16, 32, 64, 120)
# Flow that a decision needs, s: a scale that sways by 1 kg in 30 s is a straight line for less.
DECISION_FLOW_S = 24.0
# Distance of a share beyond its limit that decides, standard deviations of the line's residuals.
DECISION_SD = 4.0
# Least share of an error that must persist in the last third: that of a scale that sways returns.
PERSISTING_ERROR_SHARE = 0.75
# Distance beyond `low_share` or `high_share` that rules out a healthy flow, standard deviations.
FAR_FROM_FLOW_SD = 2.0
# Blocks at rest: material has left where the scale reads less than in all of these.
STANDING_BLOCKS = 30
# Variance of a load in gusts of 2 kg at three standard deviations, kg2, with the time constant
# `SWAY_TAU_S`: a scale at rest may have it as far as its readings leave that likely.
GUST_VARIANCE_KG2 = 0.77
# Size of a fall in standard deviations, where the drive's effort confirms it in the same seconds.
BLOCKAGE_SD = 3.0
# Blocks of flow with normal effort before a blockage: a drive that is heavy from its start (cold
# grease) shows that within some 6 s.
NORMAL_EFFORT_BLOCKS = 12
# A blockage shows in the drive's effort within 4 to 6 s (`EFFORT_MEAN_S` of its watch).
EFFORT_DELAY_BLOCKS = 7
# A share with a smaller standard deviation than this, within its limits, is a changed flow.
MAX_FLOW_SHARE_SD = 0.03
# Share by which each block moves the estimate of the scale's noise.
NOISE_RATE = 0.02
# The initial noise weighs as much as this many blocks.
INITIAL_NOISE_BLOCKS = 2.0
# Initial noise as a factor on the file's variance, a sway of 1 kg: a scale has to show that it is
# calm.
INITIAL_NOISE_FACTOR = 20.0
# Greatest noise as a factor on the file's variance.
MAX_NOISE_FACTOR = 100.0
# Time constant of the wind's load, s. Gusts last 3 to 30 s; against measured loads this value is
# right for 8 s within a tenth, and too large for shorter ones.
SWAY_TAU_S = 16.0
# Lags of the second differences, blocks: the first shows wind, the second does not. A straight line
# shows in neither, so that a flow, a leak or a wrong gain is no sway.
SWAY_LAG, NOISE_LAG = 8, 1
# Number of second differences in the mean, and the least number that is used.
MAX_SWAY_BENDS, MIN_SWAY_BENDS = 300, 12
# Second differences beyond the file's noise by this many standard deviations are sway.
SWAY_DETECTION_SD = 4.0
# Number of second differences of white noise that are worth one independent value.
NOISE_DIFFERENCES_PER_VALUE = 1.94
# Number of second differences of gusts that are worth one independent value.
GUST_DIFFERENCES_PER_VALUE = 8.0
# Initial variance of the steps between weighings, kg2; its weight in weighings, at first and at
# most.
INITIAL_STEP_KG2, INITIAL_STEPS, MAX_STEPS = 0.16, 20.0, 200.0
# An older weighing is not used, s.
WEIGHING_VALID_S = VALID_FOR["hopper_kg"].control_s
# Least mass of a revolution by the model, g, when an offset is converted to a share.
MIN_GRAMS_PER_REV = 1.0
# Noise of a scale whose file gives none, kg.
MIN_SCALE_NOISE_KG = 0.001
# A smaller flow is no evidence, kg/s.
MIN_FLOW_KG_S = 0.005
# After so many blocks without a further fall nothing leaves any more.
LEAK_END_BLOCKS = 8
# A fall faster than the machine's largest flow times this is no flow: a load was taken off the
# hopper.
MAX_FLOW_FACTOR = 1.5
# Error of the flow after a catch test of today, %.
CATCH_TEST_PERCENT = 1.5
# Growth of that error in the square root of a day by storage and weather, %: 5 % after three
# months.
CATCH_TEST_DRIFT_PERCENT = 0.5

H, GAIN, OFFSET, SLOPE, TILT, COSINE, SWAY = range(7)
# A row of the state as a tuple: calls of numpy take longer than so few numbers.
Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]
NO_TRIM = (0.0,) * 7
# This scale reads the same at every pitch.
PITCH_FREE_SCALE = Scale()


class _Block(NamedTuple):
    """Holds one block of the series, with the state of the filter after it."""

    # Sums since the beginning: expected kg, 1000 revolutions, kg x degrees of pitch.
    sums: Vector
    # Mean reading of the scale, kg.
    kg: float
    # Row of the measurement: the level, and the share of each effect of pitch.
    reads: Vector
    flows: bool
    labours: bool
    state: Vector
    spread: Matrix
    trimmed: Vector
    number: int
    sway_kg2: float


class FlowTrim:
    """Trims the flow model of a run by the hopper scale. `update_trim` is called once a
    tick; `find_factor` returns the factor on the model's flow."""

    def __init__(
        self,
        scale_kg: float = 0.15,
        correlation_s: float = 1.0,
        limits: FlowTrimLimits = FlowTrimLimits(),
        *,
        outlets: int = 6,
        most_kg_s: float = inf,
        scale: Scale = PITCH_FREE_SCALE,
    ) -> None:
        """Starts without any weighing.

        Parameters
        ----------
        scale_kg, correlation_s : noise of the scale (1 standard deviation) and its correlation
            time, from the machine file.
        limits : of the trim.
        outlets : number of outlets of the machine.
        most_kg_s : largest flow of the machine, kg/s.
        scale : tilt and cosine share of the scale, from the machine file."""
        self._scale = scale
        self._limits, self._outlets, self._most_kg = (
            limits,
            outlets,
            MAX_FLOW_FACTOR * most_kg_s * BLOCK_S,
        )
        self._scale_kg2, self._correlation_s = max(MIN_SCALE_NOISE_KG, scale_kg) ** 2, correlation_s
        # Variance of a block's mean, kg2, for independent blocks.
        self._block_kg2 = self._scale_kg2 * min(4.0, 2.0 * correlation_s / BLOCK_S)
        self._gain_percent = limits.gain_percent
        # Factor on the file's variance.
        self._noise = INITIAL_NOISE_FACTOR
        # Number of blocks from which the noise was learnt.
        self._judged = 0
        # Variance of the sway, variance of the steps between weighings, kg2, and the weight of the
        # latter.
        self._sway_kg2, self._step_kg2, self._steps = 0.0, INITIAL_STEP_KG2, INITIAL_STEPS
        # Second differences by their lag: mean square beyond the file's noise, kg2, and number.
        self._bends = {SWAY_LAG: (0.0, 0), NOISE_LAG: (0.0, 0)}
        self._number = 0
        self._refill_percent: float | None = None
        self._sums = 0.0, 0.0, 0.0
        self._block: list[tuple[tuple[float, float, float], float, tuple[float, float]]] = []
        self._since_s = 0.0
        # Newest weighing, kg, its inputs, and the mass that had left by the model, kg.
        self._last: tuple[float, Vector, float] | None = None
        self._weighed_s: float | None = None
        # Last step of the scale in this rest, kg, and the covariance before the step.
        self._stepped: tuple[float, Matrix] | None = None
        # Ordered refills of this rest, kg.
        self._filled_kg = 0.0
        # Lowest scale reading of this rest, kg, and the inputs from which it was calculated.
        self._lowest: tuple[float, Vector] | None = None
        self._unordered_kg = self._taken_kg = 0.0
        # Values of the newest tick.
        self.grams_per_rev, self.pitch_deg = 100.0, 0.0
        self.reset_calibration()

    def reset_calibration(self) -> None:
        """Returns to the model's own calibration, as before the first weighing; the learnt noise
        of the scale stays."""
        limits = self._limits
        scale = self._scale
        self._state: Vector = (
            *NO_TRIM[:TILT],
            scale.tilt_percent_per_deg,
            scale.cosine_share,
            0.0,
        )
        sds = (
            limits.level_kg,
            self._gain_percent,
            limits.offset_g_rev,
            limits.slope_percent_per_deg,
            limits.tilt_percent_per_deg,
            limits.cosine_share,
            sqrt(self._sway_kg2),
        )
        self._spread: Matrix = tuple(
            [
                tuple([sd * sd if j == k else 0.0 for j in range(len(sds))])
                for k, sd in enumerate(sds)
            ]
        )
        # Trim of each effect of the state, as far as the evidence supports it.
        self._trimmed: Vector = NO_TRIM
        # Cached factor, because a tick needs it twice.
        self._value: float | None = None
        self._said = NO_SCALE_FINDING
        # Whether the trim is suspended, because the scale's finding is no trim or is undecided.
        self._rests = False
        self.restart_level()

    @property
    def present_factor(self) -> float:
        """Returns the factor on the present flow."""
        if self._value is None:
            self._value = self.find_factor(self.grams_per_rev, self.pitch_deg)
        return self._value

    @property
    def is_scale_agreeing(self) -> bool:
        """Returns whether the scale contradicts neither shaft nor gate."""
        return self._said.is_agreeing

    @property
    def scale_finding(self) -> ScaleFinding:
        """Returns the present finding of the scale."""
        return self._said._replace(
            trimmed_percent=100.0 * (self.present_factor - 1.0),
            unordered_kg=self._unordered_kg,
            refill_percent=self._refill_percent,
        )

    @property
    def flow_sd_percent(self) -> float:
        """Returns the standard deviation of the estimate for the present flow, %."""
        shows = _make_flow_row(self.grams_per_rev, self.pitch_deg)
        return sqrt(max(1e-12, _multiply_vectors(shows, _multiply_matrix(self._spread, shows))))

    def find_factor(self, grams_per_rev: float, pitch_deg: float) -> float:
        """Returns the factor on the model's flow. grams_per_rev: mass of a revolution by the
        model."""
        if self._refill_percent is not None:
            return 1.0
        most, trimmed = (
            self._limits.most_percent,
            _multiply_vectors(self._trimmed, _make_flow_row(grams_per_rev, pitch_deg)),
        )
        own = self._gain_percent**2
        believed = own / (own + self._limits.scale_percent**2)
        return 1.0 + 0.01 * believed * min(most, max(-most, trimmed))

    def restart_level(self, another_lot: bool = False) -> None:
        """Starts a new level, as after a pause, a tare or a refill. another_lot: the product may
        have changed too."""
        self._block.clear()
        self._blocks: deque[_Block] = deque(maxlen=WINDOW_BLOCKS[-1] + 1)
        # Blocks with flow since the last change.
        self._flow: deque[_Block] = deque(maxlen=WINDOW_BLOCKS[-1])
        # Readings at rest, kg.
        self._standing_kg: deque[float] = deque(maxlen=STANDING_BLOCKS)
        # Number of consecutive blocks of flow with normal effort, and the block before the effort
        # rose.
        self._easy_blocks = 0
        self._easy: _Block | None = None
        # Last block before unordered material left.
        self._left: _Block | None = None
        self._unordered_kg = self._taken_kg = 0.0
        # Number of blocks without a further loss.
        self._quiet = 0
        self._spread = _replace_level(self._spread, (self._limits.level_kg**2, *NO_TRIM[GAIN:]))
        if another_lot:
            self._spread = _widen_gain(self._spread, self._limits.another_lot_percent)

    def set_catch_test_age(self, age_days: float) -> None:
        """Sets the age of the product's catch test, days, before work begins: after a recent
        test the model has more weight than the scale."""
        self._gain_percent = min(
            self._limits.gain_percent,
            sqrt(CATCH_TEST_PERCENT**2 + CATCH_TEST_DRIFT_PERCENT**2 * max(0.0, age_days)),
        )
        self.reset_calibration()

    def begin_work(self) -> None:
        """Begins or resumes work: a fault may have been repaired and is judged anew."""
        self._flow.clear()
        if self._said.share is not None:
            self._said = NO_SCALE_FINDING

    def record_refill(self, kg: float) -> None:
        """Stores an ordered refill, kg. If the scale rises by another amount before work
        resumes, the scale's gain is wrong."""
        self._filled_kg += kg
        self.restart_level(another_lot=True)

    def take_unordered_kg(self) -> float:
        """Returns the mass that left without an order since the last call, kg."""
        kg = max(0.0, self._unordered_kg - self._taken_kg)
        self._taken_kg += kg
        return kg

    def update_trim(
        self,
        now_s: float,
        dt_s: float,
        model_flow_kg_s: float,
        shaft_rpm: float,
        pitch_deg: float,
        scale: Reading | None,
        labours: bool = False,
    ) -> None:
        """Updates the filter with the readings of one tick.

        Parameters
        ----------
        now_s, dt_s : present time and time since the last tick, s. model_flow_kg_s : flow from
        measured shaft and opening, without this trim, kg/s. shaft_rpm, pitch_deg : measured shaft
        speed, r/min, and pitch, degrees. scale : newest weighing, kg; None means no scale. labours
        : whether the metering drive's effort is too high.
        """
        self._value = None
        if shaft_rpm > 0.0 and model_flow_kg_s > 0.0:
            self.grams_per_rev = max(MIN_GRAMS_PER_REV, model_flow_kg_s * 60_000.0 / shaft_rpm)
        self.pitch_deg = pitch_deg
        given_kg = model_flow_kg_s * dt_s
        turned = shaft_rpm / 60_000.0 * dt_s if given_kg > 0.0 else 0.0
        given, turns, on_slope = self._sums
        self._sums = given + given_kg, turns + turned, on_slope + given_kg * pitch_deg
        if (
            scale is None
            or now_s - scale.time_s > WEIGHING_VALID_S
            or scale.time_s == self._weighed_s
        ):
            return
        weighed_s, self._weighed_s = self._weighed_s, scale.time_s
        leans = pitch_deg, 100.0 * (cos(radians(pitch_deg)) - 1.0)
        last, self._last = (
            self._last,
            (scale.value, _make_reading_row(scale.value, leans), self._sums[0]),
        )
        if last is not None and weighed_s is not None:
            self._judge_step(last, self._last, scale.time_s - weighed_s)
        if not self._block:
            self._since_s = now_s
        self._block.append((self._sums, scale.value, leans))
        if now_s - self._since_s + dt_s > BLOCK_S - 1e-6:
            self._take_block(labours)

    def _judge_step(
        self,
        before: tuple[float, Vector, float],
        now: tuple[float, Vector, float],
        elapsed_s: float,
    ) -> None:
        """Judges the step between two weighings that exceeds the scale's noise and any flow: a
        refill, a person on the hopper, or an unloaded hopper."""
        rise_kg, unknown_kg2 = self._calc_rise(before[:2], now[:2])
        usual_kg = max(REFILL_KG, CHANGE_SD * sqrt(self._step_kg2))
        usual_kg += CHANGE_SD * sqrt(unknown_kg2)
        if not -usual_kg - self._most_kg * abs(elapsed_s) / BLOCK_S < rise_kg < usual_kg:
            stepped, self._stepped = self._stepped, (rise_kg, self._spread)
            back = stepped is not None and abs(rise_kg + stepped[0]) < usual_kg
            if stepped is not None and back:
                # A person who stepped up has stepped down, so there is no new lot.
                self._spread, self._stepped = stepped[1], None
            self.restart_level(another_lot=rise_kg > 0.0 and not back)
            return
        more_kg = rise_kg + now[2] - before[2]
        self._steps = min(MAX_STEPS, self._steps + 1.0)
        self._step_kg2 += (more_kg**2 - self._step_kg2) / self._steps

    # The following methods process blocks.

    def _take_block(self, labours: bool) -> None:
        sums = _average_columns([sums for sums, _, _ in self._block])
        kg = sum([kg for _, kg, _ in self._block]) / len(self._block)
        reads = _make_reading_row(kg, _average_columns([leans for _, _, leans in self._block]))
        self._block.clear()
        if not self._blocks:
            self._set_level(kg, reads)
            self._append_block(sums, kg, reads, False, labours)
            return
        before = self._blocks[-1]
        gone = _add_scaled(sums, -1.0, before.sums)
        flows = gone[0] >= MIN_FLOW_KG_S * BLOCK_S
        rise_kg, unknown_kg2 = self._calc_rise((before.kg, before.reads), (kg, reads))
        unknown_kg2 += 2.0 * (self._calc_mean_kg2(1) + self._sway_kg2 * (1.0 - _calc_sway_left(1)))
        if abs(rise_kg + gone[0]) > self._most_kg + CHANGE_SD * sqrt(unknown_kg2):
            # Somebody stepped on the hopper, or took a load off.
            self.restart_level()
            self._set_level(kg, reads)
            self._append_block(sums, kg, reads, flows, labours)
            return
        if flows:
            self._stepped = None
            self._check_refill(before)
        self._note_lowest(kg, reads, before.flows and not flows)
        if self._rests and flows:
            # The filter rests; a standstill begins with the present reading.
            self._set_level(kg, reads)
        elif self._left is None:
            self._predict_level(gone)
            # At rest a change of the level says nothing about the flow.
            if not flows:
                self._spread = _separate_level(
                    self._spread, reads, 0.25 * self._noise * self._block_kg2
                )
            self._update_with_weighing(kg, reads)
            if flows:
                self._bound_estimate()
        self._append_block(sums, kg, reads, flows, labours)
        if not self._rests and self._left is None:
            self._note_sway()
        if flows:
            self._judge_flow()
        else:
            self._judge_standstill()

    def _note_lowest(self, kg: float, reads: Vector, begins: bool) -> None:
        """Stores the lowest reading of this rest. begins: whether the rest begins with this
        block."""
        lowest = self._lowest
        if begins or lowest is None or self._calc_rise(lowest, (kg, reads))[0] < 0.0:
            self._lowest = kg, reads

    def _calc_rise(
        self, before: tuple[float, Vector], now: tuple[float, Vector]
    ) -> tuple[float, float]:
        """Returns how much more is weighed than before, kg, without the effect of pitch on the
        scale, and the variance of that, kg2."""
        apart = _add_scaled(now[1], -1.0, before[1])
        return now[0] - before[0] - _multiply_vectors(apart, self._state), _multiply_vectors(
            apart, _multiply_matrix(self._spread, apart)
        )

    def _append_block(
        self, sums: Vector, kg: float, reads: Vector, flows: bool, labours: bool
    ) -> None:
        self._number += 1
        state = self._state, self._spread, self._trimmed, self._number, self._sway_kg2
        self._blocks.append(_Block(sums, kg, reads, flows, labours, *state))

    def _note_sway(self) -> None:
        """Learns the sway from second differences of the readings, which a constant flow does
        not affect: the part beyond the file's noise and chance is sway."""
        newest = list(islice(reversed(self._blocks), 2 * SWAY_LAG + 1))
        for lag, (mean_kg2, count) in self._bends.items():
            bent = newest[: 2 * lag + 1]
            if len(bent) > 2 * lag and len({one.flows for one in bent}) == 1:
                count = min(MAX_SWAY_BENDS, count + 1)
                beyond_kg2 = self._calc_bend_kg2(bent[0], bent[lag], bent[-1])
                beyond_kg2 -= _calc_bend_variance(self._covariance_kg2, lag)
                self._bends[lag] = mean_kg2 + (beyond_kg2 - mean_kg2) / count, count
        sways_kg2, count = self._bends[SWAY_LAG]
        if count >= MIN_SWAY_BENDS:
            # The second differences of white noise are the same at every lag.
            white_kg2 = max(0.0, self._bends[NOISE_LAG][0])
            chance = SWAY_DETECTION_SD * sqrt(2.0 * NOISE_DIFFERENCES_PER_VALUE / count)
            beyond_kg2 = sways_kg2 - white_kg2
            by_chance_kg2 = chance * (
                _calc_bend_variance(self._covariance_kg2, SWAY_LAG) + white_kg2
            )
            of_one = _calc_bend_variance(_calc_sway_left, SWAY_LAG) - _calc_bend_variance(
                _calc_sway_left, NOISE_LAG
            )
            self._set_sway(beyond_kg2 / of_one if beyond_kg2 > by_chance_kg2 else 0.0)

    def _calc_bend_kg2(self, last: _Block, middle: _Block, first: _Block) -> float:
        """Returns the square of a second difference of the readings, without the effect of
        pitch, kg2."""
        apart = _add_scaled(_add_scaled(last.reads, -2.0, middle.reads), 1.0, first.reads)
        gone_kg = last.sums[0] - 2.0 * middle.sums[0] + first.sums[0]
        bend_kg = (
            last.kg - 2.0 * middle.kg + first.kg + gone_kg - _multiply_vectors(apart, self._state)
        )
        return bend_kg**2 - _multiply_vectors(apart, _multiply_matrix(self._spread, apart))

    @property
    def _possible_sway_kg2(self) -> float:
        """Returns the variance of sway that is not ruled out: that of gusts, reduced by the
        likelihood that the readings are those of the file's scale."""
        evidence = 0.0
        for lag, alike in (
            (SWAY_LAG, GUST_DIFFERENCES_PER_VALUE),
            (NOISE_LAG, NOISE_DIFFERENCES_PER_VALUE),
        ):
            beyond_kg2, count = self._bends[lag]
            calm_kg2 = _calc_bend_variance(self._covariance_kg2, lag)
            gusts_kg2 = calm_kg2 + GUST_VARIANCE_KG2 * _calc_bend_variance(_calc_sway_left, lag)
            times = (calm_kg2 + max(0.0, beyond_kg2)) / calm_kg2
            likelier = times * (1.0 - calm_kg2 / gusts_kg2) - log(gusts_kg2 / calm_kg2)
            evidence += 0.5 * count / alike * likelier
        return max(self._sway_kg2, exp(min(0.0, evidence)) * GUST_VARIANCE_KG2)

    def _set_sway(self, kg2: float) -> None:
        if self._sway_kg2 == 0.0 and kg2 > 0.0:
            # The filter has attributed level and sway to each other.
            level, sway = self._spread[H], self._spread[SWAY]
            self._spread = (
                (level[H] + kg2, *level[GAIN:]),
                *self._spread[GAIN:SWAY],
                (*sway[:SWAY], sway[SWAY] + kg2),
            )
        self._sway_kg2 = kg2

    def _covariance_kg2(self, blocks: int) -> float:
        """Returns the covariance of the means of two blocks so far apart, for the scale of the
        file, kg2."""
        t = BLOCK_S / self._correlation_s
        if blocks == 0:
            return self._scale_kg2 * 2.0 * (t - 1.0 + exp(-t)) / (t * t)
        return self._scale_kg2 * ((1.0 - exp(-t)) / t) ** 2 * exp(-(blocks - 1) * t)

    def _predict_level(self, gone: Vector) -> None:
        """Predicts the level after the flow since the block before, by the model and the
        estimate."""
        level = _make_level_row(gone)
        along = _multiply_matrix(self._spread, level)
        self._state = (_multiply_vectors(level, self._state) - gone[0], *self._state[GAIN:])
        self._spread = _widen_gain(
            _replace_level(self._spread, (_multiply_vectors(level, along), *along[GAIN:])),
            self._limits.wanders_percent * sqrt(BLOCK_S / 3600.0),
        )
        self._predict_sway()

    def _predict_sway(self) -> None:
        """Predicts the sway: it returns to its mean and is driven on."""
        if self._spread[SWAY][SWAY] == 0.0:
            return
        stays = _calc_sway_left(1)
        self._state = (*self._state[:SWAY], stays * self._state[SWAY])
        of_sway = [stays * one for one in self._spread[SWAY][:SWAY]]
        own_kg2 = stays**2 * self._spread[SWAY][SWAY] + (1.0 - stays**2) * self._sway_kg2
        self._spread = (
            *[(*row[:SWAY], one) for row, one in zip(self._spread, of_sway, strict=False)],
            (*of_sway, own_kg2),
        )

    def _update_with_weighing(self, weighed_kg: float, reads: Vector) -> None:
        along = _multiply_matrix(self._spread, reads)
        variance = _multiply_vectors(reads, along) + self._noise * self._block_kg2
        off_kg = weighed_kg - _multiply_vectors(reads, self._state)
        off = off_kg / sqrt(variance)
        gain = tuple([one / variance for one in along])
        self._state = _add_scaled(self._state, off_kg, gain)
        self._spread = tuple(
            [_add_scaled(row, -one, gain) for row, one in zip(self._spread, along, strict=True)]
        )
        self._judged += 1
        rate = max(NOISE_RATE, 1.0 / (INITIAL_NOISE_BLOCKS + self._judged))
        self._noise = min(
            MAX_NOISE_FACTOR, max(1.0, self._noise * exp(rate * (min(9.0, off * off) - 1.0)))
        )

    def _bound_estimate(self) -> None:
        """Projects the estimate into its bounds, along its own uncertainty."""
        shows, most = _make_flow_row(self.grams_per_rev, self.pitch_deg), self._limits.most_percent
        percent = _multiply_vectors(shows, self._state)
        over = percent - min(most, max(-most, percent))
        along = _multiply_matrix(self._spread, shows)
        self._state = _add_scaled(
            self._state, -over / max(1e-12, _multiply_vectors(shows, along)), along
        )

    def _set_level(self, weighed_kg: float, reads: Vector) -> None:
        """Sets the level to the present weighing, whatever was estimated before."""
        by_pitch = (0.0, *reads[GAIN:])
        along = _multiply_matrix(self._spread, by_pitch)
        self._state = (weighed_kg - _multiply_vectors(by_pitch, self._state), *self._state[GAIN:])
        own_kg2 = self._noise * self._block_kg2 + _multiply_vectors(by_pitch, along)
        self._spread = _replace_level(self._spread, (own_kg2, *[-one for one in along[GAIN:]]))

    def _move_trim(self) -> None:
        """Moves the trim towards the estimate as far as the evidence for the present flow
        allows."""
        apart = _add_scaled((0.0, *self._state[GAIN:TILT], 0.0, 0.0, 0.0), -1.0, self._trimmed)
        percent, sd = (
            _multiply_vectors(apart, _make_flow_row(self.grams_per_rev, self.pitch_deg)),
            self.flow_sd_percent,
        )
        if abs(percent) > DEAD_BAND_SD * sd:
            self._trimmed = _add_scaled(
                self._trimmed, 1.0 - (DEAD_BAND_SD * sd / percent) ** 2, apart
            )

    def _check_refill(self, before: _Block) -> None:
        """Compares the rise of the scale with the ordered refill when work resumes. before: the
        last block of the rest."""
        if self._filled_kg > 0.0 and self._lowest is not None:
            rise_kg, unknown_kg2 = self._calc_rise(self._lowest, (before.kg, before.reads))
            off_kg = rise_kg - self._filled_kg
            allowed = 0.01 * self._limits.refill_percent * self._filled_kg + CHANGE_SD * sqrt(
                self._scale_kg2 + 2.0 * self._sway_kg2 + unknown_kg2
            )
            self._refill_percent = (
                100.0 * off_kg / self._filled_kg if abs(off_kg) > allowed else None
            )
        self._filled_kg, self._lowest = 0.0, None

    # The following methods watch for changes.

    def _calc_mean_kg2(self, blocks: int) -> float:
        """Returns the variance of the scale's mean over so many blocks, kg2."""
        return (
            self._noise
            * self._scale_kg2
            * _calc_mean_variance(blocks * BLOCK_S / self._correlation_s)
        )

    def _find_excess(
        self, since: _Block, blocks: int, sway_kg2: float = 0.0
    ) -> tuple[float, float]:
        """Returns the mass that left since a block beyond the prediction of that time, kg, by
        the mean of the newest blocks, and its standard deviation. sway_kg2: variance of sway
        where more is known of it now."""
        newest = list(islice(reversed(self._blocks), blocks))
        gone = _add_scaled(_average_columns([one.sums for one in newest]), -1.0, since.sums)
        reads = _add_scaled(
            _make_level_row(gone),
            1.0,
            (0.0, *_average_columns([one.reads[GAIN:] for one in newest])),
        )
        age = self._number - since.number
        stays = sum([_calc_sway_left(age - k) for k in range(blocks)]) / blocks
        reads = (*reads[:SWAY], stays)
        variance = _multiply_vectors(
            reads, _multiply_matrix(since.spread, reads)
        ) + self._calc_mean_kg2(blocks)
        variance += since.sway_kg2 * (_calc_mean_variance(blocks * BLOCK_S / SWAY_TAU_S) - stays**2)
        variance += 2.0 * max(0.0, sway_kg2 - since.sway_kg2) * (1.0 - stays)
        return _multiply_vectors(reads, since.state) - gone[0] - sum(
            [one.kg for one in newest]
        ) / blocks, sqrt(variance)

    def _find_farthest(self, most: int, sway_kg2: float) -> tuple[int, float, float]:
        """Returns window, excess in kg and standard deviation of the window with the most
        significant excess, among windows of at most so many blocks. sway_kg2: as for
        `_find_excess`."""
        asked = [
            (window, *self._find_excess(self._blocks[-1 - window], max(1, window // 4), sway_kg2))
            for window in {*WINDOW_BLOCKS, most}
            if window <= min(most, len(self._blocks) - 1)
        ]
        return max(asked, key=lambda one: abs(one[1]) / one[2], default=(0, 0.0, 1.0))

    def _judge_standstill(self) -> None:
        """Judges a change of the scale while nothing flows by the shaft: nobody ordered it."""
        if self._left is not None:
            self._judge_leak(self._left)
            return
        newest = self._blocks[-1]
        # The effect of pitch on the scale is subtracted.
        weight_kg = newest.kg - _multiply_vectors((0.0, *newest.reads[GAIN:]), newest.state)
        self._standing_kg.append(weight_kg)
        rest = next(
            (k for k, one in enumerate(reversed(self._blocks)) if one.flows), len(self._blocks) - 1
        )
        window, kg, sd = self._find_farthest(rest, self._possible_sway_kg2)
        least_kg = CHANGE_SD * sd
        # A rise means that the hopper is being filled.
        if kg < -least_kg:
            self._restore_block(self._blocks[-1 - window])
            self._blocks.clear()
            self._set_level(newest.kg, newest.reads)
            self._append_block(newest.sums, newest.kg, newest.reads, False, newest.labours)
        elif (
            kg > least_kg
            and min(list(self._standing_kg)[:-window], default=inf) - weight_kg > 0.5 * kg
        ):
            rested = list(self._blocks)[-1 - rest : -1]
            self._left = max(rested, key=lambda one: self._find_excess(one, 1)[0])
            self._restore_block(self._left)
            self._judge_leak(self._left)

    def _judge_leak(self, since: _Block) -> None:
        """Follows a leak: unordered material leaves or has left."""
        kg, sd = self._find_excess(since, min(LEAK_END_BLOCKS // 2, len(self._blocks) - 1))
        self._quiet = 0 if kg > self._unordered_kg + sd else self._quiet + 1
        self._unordered_kg = max(self._unordered_kg, kg)
        if self._quiet >= LEAK_END_BLOCKS:
            self.restart_level()

    def _judge_flow(self) -> None:
        if self._left is not None:
            self.restart_level()
            return
        self._standing_kg.clear()
        self._flow.append(self._blocks[-1])
        self._note_effort()
        if not self._rests:
            window, kg, sd = self._find_farthest(WINDOW_BLOCKS[-1], self._sway_kg2)
            if abs(kg) > CHANGE_SD * sd:
                self._return_to_change(window)
                self._said = ScaleFinding(off_kg=kg)
        if len(self._flow) * BLOCK_S >= DECISION_FLOW_S:
            self._judge_share()
        if not self._rests:
            self._move_trim()

    def _return_to_change(self, window: int) -> None:
        """Returns the trim to its value before the flow changed, and lets it rest. The change is
        the last block from which nine tenths of the window's excess are missing."""
        averaged = max(1, window // 4)
        off = [
            abs(self._find_excess(one, averaged)[0])
            for one in list(self._blocks)[-1 - window : -averaged]
        ]
        latest = max(k for k, kg in enumerate(off) if kg >= 0.9 * off[0])
        since = self._blocks[latest - window - 1]
        flow = [one for one in self._flow if one.sums[0] >= since.sums[0]]
        self._flow.clear()
        self._flow.extend(flow)
        self._restore_block(since)
        self._rests = True

    def _restore_block(self, since: _Block) -> None:
        self._state, self._spread, self._trimmed = since.state, since.spread, since.trimmed

    def _judge_share(self) -> None:
        """Judges the share of the model's flow that left, since the flow changed or over the
        last two minutes."""
        self._said = self._find_blockage() or self._said
        limits, flow = self._limits, list(self._flow)
        share, sd, noise_kg2 = self._fit_share(flow)
        off, lately = share - 1.0, self._fit_share(flow[-len(flow) // 3 :])[0] - 1.0
        goes_on = off * lately > PERSISTING_ERROR_SHARE * off * off
        fell = self._explain_fall(-off, sd)
        far = (
            not limits.low_share - FAR_FROM_FLOW_SD * sd
            < share
            < limits.high_share + FAR_FROM_FLOW_SD * sd
        )
        # In wind a few kilograms of flow are little evidence.
        if goes_on and far and abs(off) > DECISION_SD * sd:
            self._suspend_trim(ScaleFinding(share=share))
        elif goes_on and self._rests and fell is not None and self._said.beyond_percent is None:
            self._said = fell
        elif goes_on and 100.0 * (abs(off) - DECISION_SD * sd) > limits.most_percent:
            window, kg, kg_sd = self._find_farthest(WINDOW_BLOCKS[-1], self._sway_kg2)
            if not self._rests and abs(kg) > DECISION_SD * kg_sd:
                # The share was different at the beginning.
                self._return_to_change(window)
                return
            self._suspend_trim(ScaleFinding(beyond_percent=100.0 * off))
        elif self._rests and (
            (sd < MAX_FLOW_SHARE_SD and 100.0 * abs(off) < limits.most_percent)
            or (len(self._flow) == self._flow.maxlen and not self._said.has_fallen)
        ):
            self._said, self._rests = NO_SCALE_FINDING, False
            white_kg2 = noise_kg2 - self._sway_kg2
            self._noise = max(self._noise, white_kg2 / (self._calc_mean_kg2(1) / self._noise))
            newest = self._blocks[-1]
            self._blocks.clear()
            self._set_level(newest.kg, newest.reads)
            self._spread = _widen_gain(self._spread, limits.changed_percent)
            self._append_block(newest.sums, newest.kg, newest.reads, True, newest.labours)

    def _suspend_trim(self, said: ScaleFinding) -> None:
        self._said, self._rests, self._trimmed = said, True, NO_TRIM

    def _note_effort(self) -> None:
        """Stores the block before which the effort was normal for some time and after which it
        is too high."""
        if not self._blocks[-1].labours:
            self._easy_blocks += 1
            if self._easy_blocks >= NORMAL_EFFORT_BLOCKS:
                self._easy = None
            return
        if self._easy_blocks >= NORMAL_EFFORT_BLOCKS and len(self._blocks) > EFFORT_DELAY_BLOCKS:
            self._easy = self._blocks[-1 - EFFORT_DELAY_BLOCKS]
        self._easy_blocks = 0

    def _find_blockage(self) -> ScaleFinding | None:
        """Returns the closed outlets that two independent signs confirm: the effort rises, as
        with granules packed before a closed outlet, and since then less material leaves."""
        since = self._easy
        if since is None:
            return None
        flow = [one for one in self._flow if one.sums[0] >= since.sums[0]]
        if len(flow) * BLOCK_S < DECISION_FLOW_S:
            return None
        share, sd, _ = self._fit_share(flow)
        shows = _make_flow_row(self.grams_per_rev, self.pitch_deg)
        before = 1.0 + 0.01 * _multiply_vectors(since.state, shows)
        fall = 1.0 - share / before
        unknown = hypot(
            sd,
            0.01 * sqrt(max(0.0, _multiply_vectors(shows, _multiply_matrix(since.spread, shows)))),
        )
        silent = max(1, round(fall * self._outlets))
        if silent > self._closable_outlets or not BLOCKAGE_SD * unknown < fall:
            return None
        self._flow.clear()
        self._flow.extend(flow)
        self._restore_block(since)
        self._rests, self._easy = True, None
        return ScaleFinding(outlets=silent, of_outlets=self._outlets)

    def _explain_fall(self, fall: float, sd: float) -> ScaleFinding | None:
        """Returns the finding for a sudden fall of the flow by a share of a few outlets; None where
        the fall may be trimmed.

        Unless closed outlets are known already, the cause may also be another lot, or a wrong
        reading of gate or shaft.
        """
        most, lost, few = self._limits.most_percent, fall * self._outlets, self._closable_outlets
        if self._said.outlets and 100.0 * fall > most:
            sure = abs(lost - self._said.outlets) < 0.75
            return self._said if sure else self._said._replace(outlets=min(few, round(lost)))
        if lost > few + 0.5 or 100.0 * (fall - FAR_FROM_FLOW_SD * sd) < most:
            return None
        return ScaleFinding(below_percent=100.0 * fall)

    @property
    def _closable_outlets(self) -> int:
        """Returns how many outlets may close while the rest of the machine is unchanged."""
        return max(1, self._outlets // 3)

    def _fit_share(self, flow: list[_Block]) -> tuple[float, float, float]:
        """Fits a straight line of the scale's reading over the mass that left by the model.

        Returns
        -------
        The share that really left, its standard deviation from the residuals, and the residual
        variance, kg2."""
        gone = np.array([one.sums[0] for one in flow])
        kg = np.array([one.kg for one in flow])
        by_pitch = np.array([one.reads[TILT:SWAY] for one in flow])
        kg = kg - by_pitch @ np.array(self._state[TILT:SWAY])
        gone, kg = gone - gone.mean(), kg - kg.mean()
        across = max(1e-12, float(gone @ gone))
        line = float(gone @ kg) / across
        left = kg - line * gone
        noise_kg2 = max(float(left @ left) / (len(kg) - 2), self._calc_mean_kg2(1))
        alike = min(0.99, max(0.0, float(left[1:] @ left[:-1]) / max(1e-12, float(left @ left))))
        each_kg2 = noise_kg2 * max(
            self._noise * self._block_kg2 / self._calc_mean_kg2(1), (1.0 + alike) / (1.0 - alike)
        )
        # An unknown tilt turns the line where pitch changed along it.
        turned = gone @ by_pitch / across
        unknown = np.array([row[TILT:SWAY] for row in self._spread[TILT:SWAY]])
        line_2 = max(each_kg2 / across, self._calc_sway_variance(flow, gone / across))
        return -line, sqrt(line_2 + float(turned @ unknown @ turned)), noise_kg2

    def _calc_sway_variance(self, flow: list[_Block], weights: np.ndarray) -> float:
        """Returns the variance of a weighted sum of such blocks by sway and noise, kg2."""
        if self._sway_kg2 == 0.0:
            return 0.0
        at = np.array([one.number for one in flow])
        sways = self._sway_kg2 * np.exp(-np.abs(at[:, None] - at) * BLOCK_S / SWAY_TAU_S)
        white_kg2 = self._noise * self._block_kg2
        return float(weights @ sways @ weights + white_kg2 * (weights @ weights))


def _make_level_row(gone: Vector) -> Vector:
    """Returns the row of the level after so much has left by the model: the level before, and
    the effects of the flow."""
    return 1.0, -0.01 * gone[0], -gone[1], -0.01 * gone[2], 0.0, 0.0, 0.0


def _make_reading_row(kg: float, leans: Vector) -> Vector:
    """Returns the row of a reading: the level, and what a unit of each effect adds. leans:
    degrees of pitch, and how much its cosine is below 1, %."""
    return 1.0, 0.0, 0.0, 0.0, 0.01 * kg * leans[0], 0.01 * kg * leans[1], 1.0


def _make_flow_row(grams_per_rev: float, pitch_deg: float) -> Vector:
    """Returns the row of the flow in %, for a unit of each effect; the level and the scale's own
    effects are 0."""
    return 0.0, 1.0, 100.0 / max(MIN_GRAMS_PER_REV, grams_per_rev), pitch_deg, 0.0, 0.0, 0.0


def _multiply_vectors(one: Vector, other: Vector) -> float:
    return (
        one[H] * other[H]
        + one[GAIN] * other[GAIN]
        + one[OFFSET] * other[OFFSET]
        + one[SLOPE] * other[SLOPE]
        + one[TILT] * other[TILT]
        + one[COSINE] * other[COSINE]
        + one[SWAY] * other[SWAY]
    )


def _calc_sway_left(blocks: int) -> float:
    """Returns the share of the sway that is left after so many blocks."""
    return exp(-blocks * BLOCK_S / SWAY_TAU_S)


def _calc_mean_variance(t: float) -> float:
    """Returns the variance of a mean over so many correlation times, for a variance of 1."""
    return 2.0 * (t - 1.0 + exp(-t)) / (t * t)


def _calc_bend_variance(covariance: Callable[[int], float], lag: int) -> float:
    """Returns the variance of the second difference of blocks so far apart."""
    return 6.0 * covariance(0) - 8.0 * covariance(lag) + 2.0 * covariance(2 * lag)


def _multiply_matrix(spread: Matrix, way: Vector) -> Vector:
    return tuple([_multiply_vectors(row, way) for row in spread])


def _add_scaled(numbers: Vector, times: float, added: Vector) -> Vector:
    return tuple([one + times * more for one, more in zip(numbers, added, strict=True)])


def _average_columns(rows: Sequence[Vector]) -> Vector:
    return tuple([sum(column) / len(rows) for column in zip(*rows, strict=True)])


def _replace_level(spread: Matrix, level: Vector) -> Matrix:
    """Returns the covariance with another row of the level."""
    return (
        level,
        *[(one, *row[GAIN:]) for one, row in zip(level[GAIN:], spread[GAIN:], strict=True)],
    )


def _separate_level(spread: Matrix, reads: Vector, least_kg2: float) -> Matrix:
    """Returns the covariance with level and scale independent of the flow's effects. least_kg2:
    least variance of a reading."""
    level = H, TILT, COSINE, SWAY
    alone = tuple(
        [
            tuple([0.0 if (j in level) is not (k in level) else one for k, one in enumerate(row)])
            for j, row in enumerate(spread)
        ]
    )
    more_kg2 = max(0.0, least_kg2 - _multiply_vectors(reads, _multiply_matrix(alone, reads)))
    return ((alone[H][H] + more_kg2, *alone[H][GAIN:]), *alone[GAIN:])


def _widen_gain(spread: Matrix, percent: float) -> Matrix:
    """Returns the covariance with a less known gain."""
    gain = spread[GAIN]
    return (spread[H], (gain[H], gain[GAIN] + percent**2, *gain[OFFSET:]), *spread[OFFSET:])
