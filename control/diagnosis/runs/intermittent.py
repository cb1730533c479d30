"""Finds intermittent effects at irregular times directly in the data, without a fitted pattern.

Their contribution is removed from the data before the search. Each is judged as every other effect:
log evidence plus log prior odds against the absence of the effect (`prior.py`), accepted from
`MIN_REPORT_LOG_ODDS` on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, binary_opening, median_filter
from scipy.special import betainc, betaln, expit, gammaln, log_ndtr, logsumexp
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.prior import (
    COURSE_PROBS,
    MIN_REPORT_LOG_ODDS,
    ROBUST_SD,
    UNKNOWN_PROB,
    calc_log_prior_odds,
)
from topdress.control.machine.machine import Machine
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import make_hopper_channel, predict_binned_effort
from .effort import EFFORT_CHANNELS, DriveEffort
from .hopper import Hopper
from .hypothesis import EffectInstance, list_stages, make_schedule
from .model import CHANNEL_GROUPS
from .robust import FREEDOM
from .search import MAX_DIP_STEP_S
from .speed_and_heads import TwoSpeeds
from .stages import RunData

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# Number of samples over which the noise level changes.
NOISE_WINDOW = 41

# Block length for long bridges in the hopper, s: a bridge lasts at least about twice as long.
BLOCK_S = 3.0
# Trial probabilities that a bridge begins in a block: from once in a quarter of an hour to once in
# many.
BEGIN_PROBS = (0.003, 0.01, 0.03, 0.1)
# Trial probabilities that a bridge ends in a block: mean duration of some fifteen or six seconds.
END_PROBS = (0.2, 0.5)

# Window on each side of a step of (reading - prediction), s: the scale's noise is correlated over a
# second or two. Bridges below the noise are found by the permanent step that each leaves.
STEP_WINDOW_S = 20.0
# Time around a step that is left out, s.
STEP_GAP_S = 8.0

# Length of a long dip, rows: a single outlier lasts one row, and outliers are as often above as
# below. Dips of wheel over GNSS speed are missing pulses.
LONG_DIP_ROWS = 3
# Deviation of wheel over GNSS speed from which a reading is an outlier, s.d. (Iglewicz and Hoaglin,
# 1993).
MIN_DIP_SD = 3.5
# Trial exponents of a tail of noise beyond MIN_DIP_SD: the density of the depth falls with this
# power plus one. Student's t has its degrees of freedom, a Gaussian tail some 12.
TAIL_EXPONENTS = np.array([2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0])
# Trial spreads of the depth of missing pulses, as s.d. of its logarithm: one pulse in a window of
# fixed length is a larger share of a slower speed.
DEPTH_SPREADS = np.array([0.05, 0.1, 0.2, 0.4])
DEPTH_COUNT = 11
# Trial shares of dips that belong to the noise.
NOISE_SHARES = np.array([0.02, 0.1, 0.3, 0.5, 0.7, 0.9])
# Share of rows, those closest together, that are assumed to be without a dip.
UNDISTURBED_SHARE = 0.3
# Number of classes of a variable on which dips may depend.
CLASS_COUNT = 16
# Prior samples per class: the rates of classes agree within 1 / sqrt(4) of each.
PRIOR_SAMPLES = 4.0
# Minimum speed, m/s, for a useful ratio of the two speeds.
MIN_RATIO_SPEED_MPS = 0.6
# Variables that change the number of pulses over time.
TREND_VARIABLES = ("time_s", "hopper_kg", "speed_mps")

# Standard deviation of the contribution of spells too short to detect, as a share of the detected
# contribution.
UNDETECTED_SD_SHARE = 0.2


class DirectDetection(NamedTuple):
    """An effect that was detected directly in the data."""

    part: EffectInstance
    sd: float
    # Posterior log odds against the absence of the effect.
    log_odds: float


def find_prior_odds(part: EffectInstance) -> float:
    """Return the log prior odds of a directly detected effect, among the effects of its group of
    channels."""
    channel = EFFECT_ROWS[part.id].channels[0]
    names = {
        name
        for names in CHANNEL_GROUPS.values()
        if channel in names
        for name in names
        if name not in EFFORT_CHANNELS
    }
    rivals = sum(bool(row.channels) and row.channels[0] in names for row in EFFECT_ROWS.values())
    return calc_log_prior_odds("steady" if part.onset_s is None else "begins", rivals)


def remove_spells(data: RunData, machine: Machine) -> tuple[RunData, tuple[DirectDetection, ...]]:
    """Remove intermittent effects from the data, and return the data with the removed effects."""
    found: list[DirectDetection] = []
    if data.speed is not None:
        speed, seen = _remove_dips(data.speed, _list_where_variables(data, data.speed.time_s))
        if seen is not None:
            data = data._replace(speed=speed)
            found.append(seen)
    spells = next((one for one in data.efforts if one.name == "effort"), None)
    bare = None if spells is None else _find_unloaded_spells(spells, machine)
    seen = None
    if data.hopper is not None:
        level = _read_scale_level(data.hopper, machine)
        # The drive's load tells when the rollers were empty, the scale whether they were: a current
        # sensor that reads less leaves the mass as it is.
        if bare is not None and not _has_scale_stood(data.hopper, level, bare):
            bare = None
        hopper, seen = _remove_bridges(data.hopper, level, bare)
        data = data._replace(hopper=hopper)
    if bare is not None:
        data = data._replace(
            efforts=tuple(bare.left if one is spells else one for one in data.efforts)
        )
        seen = max((seen, bare.seen), key=lambda one: -np.inf if one is None else one.log_odds)
    if seen is not None:
        found.append(seen)
    return data, tuple(found)


class _Unloaded(NamedTuple):
    """Spells in which the rollers turned without material: their times, and the drive's effort
    without these spells."""

    begin_s: Array
    end_s: Array
    left: DriveEffort
    seen: DirectDetection

    def calc_unloaded_time(self, time_s: Array) -> Array:
        """Return the total time without material up to each time, s."""
        return np.asarray(
            np.sum(np.clip(time_s[:, None] - self.begin_s, 0.0, self.end_s - self.begin_s), axis=1)
        )


def _find_unloaded_spells(e: DriveEffort, machine: Machine) -> _Unloaded | None:
    """Return the spells in which the material's load was absent, or None. At least one spell must
    end, because an empty hopper's does not."""
    bins, stages = predict_binned_effort(e), list_stages(machine)
    full = bins(make_schedule(stages, ()))
    gone = bins(make_schedule(stages.replace_fields("effort", load=0.0), ())) - full
    known = e.members > 0
    left = e.bin_row_means(e.measured) - full
    # The standard deviation comes from differences between bins, because a permanent change of load
    # is no noise.
    sd = ROBUST_SD * float(np.nanmedian(np.abs(np.diff(left)))) / np.sqrt(
        2.0
    ) + machine.noise.effort / np.sqrt(e.rows_per_bin)
    loaded = known & (gone < -sd)
    if not loaded.any():
        return None
    # A permanent change of load is no bridge.
    usual = float(np.median(left[loaded] / gone[loaded]))

    def unlike(share: float) -> Array:
        """Return the log-likelihood penalty of a share under Student's t, because a stone between
        the rollers is a large outlier."""
        return np.asarray(
            0.5 * (FREEDOM + 1.0) * np.log1p(((left - share * gone) / sd) ** 2 / FREEDOM)
        )

    on, evidence = _find_spells(
        np.where(loaded, np.minimum(unlike(0.0), unlike(usual)) - unlike(1.0), 0.0)
    )
    on = binary_opening(on, np.ones(max(2, round(BLOCK_S / e.grid.step_s)), bool))
    edges = np.diff(on.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    ended = bool(len(begins)) and bool(known[ends[0] :].any())
    if not ended:
        return None
    bridging = EffectInstance(effects.FLOW_BRIDGING.id, 100.0 * float(on[known].mean()))
    odds = evidence + find_prior_odds(bridging)
    if odds <= MIN_REPORT_LOG_ODDS:
        return None
    half_s = 0.5 * e.grid.step_s
    return _Unloaded(
        e.middle_s[begins] - half_s,
        e.middle_s[ends - 1] + half_s,
        e.remove_bins(binary_dilation(on)),
        DirectDetection(bridging, float(100.0 * len(begins) ** 0.5 / known.sum()), odds),
    )


def _list_where_variables(data: RunData, time_s: Array) -> list[Array]:
    """Return the variables on which a loss may depend, at times (m,): (m,) each. A loss that
    depends on such a variable is no missing pulse and no bridge."""
    return [
        np.interp(time_s, data.time_s, values)
        for name, values in data.variables.items()
        if name not in TREND_VARIABLES
    ]


def _remove_dips(s: TwoSpeeds, where: Sequence[Array]) -> tuple[TwoSpeeds, DirectDetection | None]:
    """Replace rows in which much of the wheel's speed is missing with the GNSS speed, and return
    the detected effect.

    where : variables on which a wheel's rolling may depend (rows,).
    """
    moving = (s.gnss_mps > MIN_RATIO_SPEED_MPS) & (s.true_mps > MIN_RATIO_SPEED_MPS)
    ratio = s.wheel_mps / np.maximum(s.gnss_mps, MIN_RATIO_SPEED_MPS)
    if not moving.any():
        return s, None
    middle, spread = _find_usual_ratio(ratio[moving])
    ratio, spread = ratio / middle, spread / middle
    usual = float(np.mean(ratio[moving & (np.abs(ratio - 1.0) < MIN_DIP_SD * spread)]))
    deep = MIN_DIP_SD * spread
    low = moving & (ratio < usual - deep)
    if not low.any():
        return s, None
    against_tail = _calc_depth_evidence(
        np.maximum.reduceat(np.where(low, usual - ratio, 0.0), _list_spell_starts(low)) / deep,
        usual / deep,
    )
    usually = float(np.median((usual - ratio)[low]))
    # A GNSS outlier of this size is as improbable as a dip.
    deep = max(deep, 0.5 * usually)
    dips, rises = moving & (ratio < usual - deep), moving & (ratio > usual + deep)
    pulse_rows = max(1.0, MAX_DIP_STEP_S / s.grid.step_s)
    missing = np.where(dips | rises, usual - ratio, 0.0)[moving]
    share = 100.0 * float(missing.mean()) / usual
    missed = EffectInstance(effects.SPEED_MISSED_PULSES.id, share)
    against_symmetric = max(
        _calc_dip_evidence(
            *(
                _count_pulses(binary_opening(one, np.ones(rows, bool)), pulse_rows)
                for one in (dips, rises)
            )
        )
        for rows in (1, LONG_DIP_ROWS)
    )
    # The evidence is divided by 2, because pulses were counted in two ways. Noise is as probably
    # symmetric as it has a tail on one side only.
    evidence = -float(np.logaddexp(np.log(2.0) - against_symmetric, -against_tail) - np.log(2.0))
    odds = _limit_by_variables(
        evidence + find_prior_odds(missed),
        missed,
        dips[moving],
        [values[moving] for values in where],
        pulse_rows,
    )
    if odds <= MIN_REPORT_LOG_ODDS:
        return s, None
    wheel = np.where(dips, s.wheel_mps * usual / np.maximum(ratio, 0.05), s.wheel_mps)
    sd = share * np.sqrt(2.0 / _count_spell_starts(dips))
    return s._replace(wheel_mps=wheel, unseen_percent=UNDETECTED_SD_SHARE * share), DirectDetection(
        missed, float(sd), odds
    )


def _limit_by_variables(
    log_odds: float, part: EffectInstance, on: BoolArray, where: Sequence[Array], spell_rows: float
) -> float:
    """Return the log odds of an intermittent effect, at most those against a loss that depends on
    a recorded variable.

    Parameters
    ----------
    on : rows in which the loss is seen (n,).
    where : variables on which it may depend, (n,) each.
    spell_rows : length of a spell, rows.
    """
    followed = [_calc_class_evidence(on, values, spell_rows) for values in where]
    if not followed:
        return log_odds
    # Some variables change over time only, and so may spells.
    steady = COURSE_PROBS["steady"]
    for_a_while = np.log(1.0 - steady) + _calc_class_evidence(
        on, np.arange(float(len(on))), spell_rows
    )
    alone = find_prior_odds(part) + float(np.logaddexp(np.log(steady), for_a_while))
    by_variable = float(np.logaddexp.reduce(followed)) + float(np.log(UNKNOWN_PROB / len(followed)))
    return min(log_odds, alone - by_variable)


def _count_pulses(on: BoolArray, rows: float) -> float:
    """Return the number of missing pulses of some spells: one each, or one for each `rows` rows."""
    return max(float(_count_spell_starts(on)), float(on.sum()) / rows)


def _calc_dip_evidence(dips: float, rises: float) -> float:
    """Return the log evidence that dips are more frequent than rises of the same size, against
    symmetric outliers.

    The model is binomial; its probability is integrated over the upper half under Jeffreys' prior.
    """
    upper = max(1.0 - float(betainc(dips + 0.5, rises + 0.5, 0.5)), 1e-300)
    return float(
        np.log(2.0 * upper / np.pi) + betaln(dips + 0.5, rises + 0.5) + (dips + rises) * np.log(2.0)
    )


def _calc_depth_evidence(depths: Array, deepest: float) -> float:
    """Return the log evidence that dips have a depth of their own, against the tail of a noise.

    The depth of a tail follows Pareto's distribution, as that of each symmetric noise with outliers
    does; the depth of missing pulses follows a log-normal one, and some dips belong to the tail.
    All parameters are averaged over.

    Parameters
    ----------
    depths : largest depth of each dip (n,), in units of the least depth of a dip.
    deepest : depth of a wheel that reads 0, in the same unit.
    """
    logs = np.log(depths)[:, None]
    # Densities of the logarithm of the depth: (n, tails) and (n, peaks).
    tails = np.log(TAIL_EXPONENTS) - TAIL_EXPONENTS * logs
    centres, spreads = (
        grid.ravel()
        for grid in np.meshgrid(
            np.linspace(0.0, np.log(deepest), DEPTH_COUNT + 1)[1:], DEPTH_SPREADS
        )
    )
    z = (logs - centres) / spreads
    peaks = -0.5 * z**2 - np.log(np.sqrt(2.0 * np.pi) * spreads) - log_ndtr(centres / spreads)
    mixed = [
        np.logaddexp(np.log(share) + tails[:, :, None], np.log1p(-share) + peaks[:, None, :]).sum(
            axis=0
        )
        for share in NOISE_SHARES
    ]
    return _average_log(np.array(mixed)) - _average_log(tails.sum(axis=0))


def _average_log(logs: Array) -> float:
    """Return the logarithm of the mean of numbers that are given by their logarithms."""
    return float(logsumexp(logs) - np.log(logs.size))


def _calc_class_evidence(on: BoolArray, values: Array, rows: float) -> float:
    """Return the log evidence that spells depend on the class of a variable, against spells at any
    time.

    Under independence, rates of classes agree within half of themselves (1 s.d.). The shares of the
    classes have a Dirichlet prior and are integrated. rows : length of a missing pulse, rows.
    """
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, CLASS_COUNT + 1)[1:-1]))
    of = np.searchsorted(edges, values)
    counts = np.bincount(of, minlength=len(edges) + 1)
    expected = counts[counts > 0] / len(values)
    if len(expected) < 2:
        return -np.inf
    inside = np.bincount(of, on, minlength=len(counts))[counts > 0]
    inside = inside * _count_pulses(on, rows) / max(1, on.sum())

    def evidence(samples: float) -> float:
        prior = samples * expected
        return float(
            gammaln(samples)
            - gammaln(samples + inside.sum())
            + np.sum(gammaln(prior + inside) - gammaln(prior))
        )

    return (
        float(np.logaddexp(evidence(1.0), evidence(len(expected))))
        - float(np.log(2.0))
        - evidence(PRIOR_SAMPLES * len(expected))
    )


def _find_usual_ratio(ratio: Array) -> tuple[float, float]:
    """Return the mode of the ratio and the standard deviation above the mode, because up to half of
    the readings may be dips."""
    ranked = np.sort(ratio)
    count = max(2, int(np.ceil(UNDISTURBED_SHARE * len(ranked))))
    if count >= len(ranked):
        return float(np.median(ranked)), ROBUST_SD * float(
            np.median(np.abs(ranked - np.median(ranked)))
        )
    width = ranked[count:] - ranked[:-count]
    at = int(np.argmin(width))
    middle = float(np.median(ranked[at : at + count + 1]))
    above = ranked[ranked > middle] - middle
    return middle, ROBUST_SD * float(np.median(above)) if len(above) else 0.0


def _list_spell_starts(on: BoolArray) -> npt.NDArray[np.int64]:
    return np.flatnonzero(on & ~np.insert(on[:-1], 0, False))


def _count_spell_starts(on: BoolArray) -> int:
    return len(_list_spell_starts(on))


class _ScaleLevel(NamedTuple):
    """Residual of the nominal machine for a scale, on the even grid (m,)."""

    predicted: Array
    left: Array
    # Ratio of the local noise level to the usual level, at least 1.
    swell: Array
    # Samples at which the hopper is refilled.
    refilled: npt.NDArray[np.int64]
    # Samples after long gaps: the level is unknown there.
    after_gap: npt.NDArray[np.int64]


def _read_scale_level(h: Hopper, machine: Machine) -> _ScaleLevel:
    """Return the residual of the nominal machine for a scale."""
    channel = make_hopper_channel(h, machine)
    predicted = channel.predict(make_schedule(list_stages(machine), ()), MAX_MODEL_STEP_S)
    left = channel.measured - predicted
    steps = np.abs(np.diff(left, append=left[-1:]))
    swell = np.maximum(1.0, median_filter(steps, NOISE_WINDOW) / max(float(np.median(steps)), 1e-9))
    return _ScaleLevel(
        predicted,
        left,
        swell,
        *(
            np.searchsorted(h.grid.even_s, h.time_s[list(bins)])
            for bins in (h.jumps, [end for end, _ in h.gaps])
        ),
    )


def _remove_bridges(
    h: Hopper, level: _ScaleLevel, bare: _Unloaded | None
) -> tuple[Hopper, DirectDetection | None]:
    """Remove spells in which the scale stands still though the shaft turns, and return the hopper
    with the detected effect.

    Long spells are found in blocks, short spells by the permanent step in (reading - prediction).
    bare : spells from the drive's load, accurate to half a second, that the scale confirms.
    """
    found = [
        one
        for one in (
            _find_long_bridges(h, level),
            _find_short_bridges(h, level),
            bare and (np.cumsum(_calc_unfallen_mass(h, level, bare)[1]), bare.seen),
        )
        if one is not None
    ]
    if not found:
        return h, None
    stayed_kg, seen = max(found, key=lambda one: one[1].log_odds)
    at_s = h.time_s[:-1] + 0.5 * h.grid.step_s
    return h._replace(reading_kg=h.reading_kg - np.interp(at_s, h.grid.even_s, stayed_kg)), seen


def _has_scale_stood(h: Hopper, level: _ScaleLevel, bare: _Unloaded) -> bool:
    """Tell whether the scale stood still in the spells found from the drive's load: more than half
    of the mass that the model meters there remained."""
    stands, fell = _calc_unfallen_mass(h, level, bare)
    rose = float(np.sum(stands * np.diff(level.left, prepend=level.left[:1])))
    return rose > 0.5 * float(fell.sum())


def _calc_unfallen_mass(h: Hopper, level: _ScaleLevel, bare: _Unloaded) -> tuple[Array, Array]:
    """Return the share of each sample without material (m,), and the mass that the model meters
    there (m,), kg."""
    edges_s = np.append(h.grid.even_s, h.grid.even_s[-1] + h.grid.step_s) - 0.5 * h.grid.step_s
    stands = np.diff(bare.calc_unloaded_time(edges_s)) / h.grid.step_s
    return stands, stands * np.maximum(0.0, -np.diff(level.predicted, prepend=level.predicted[:1]))


def _find_short_bridges(h: Hopper, level: _ScaleLevel) -> tuple[Array, DirectDetection] | None:
    """Find upward steps of (reading - prediction) between the mean levels on both sides, and return
    the mass that remained (m,), kg.

    A step at an unknown time gains z^2 / 2 minus the logarithm of the number of times. The largest
    step may be a hand on the machine. Downward steps, which no bridge causes, count against upward
    steps. A loss that depends on a variable is a slope and no step (`_calc_step_gains`).
    """
    left, predicted, step_s = level.left, level.predicted, h.grid.step_s
    side, gap = max(4, round(STEP_WINDOW_S / step_s)), max(1, round(STEP_GAP_S / step_s))
    if len(left) <= 2 * side + gap:
        return None
    total = np.concatenate(([0.0], np.cumsum(left)))
    at = np.arange(side, len(left) - side - gap)
    rose = (total[at + gap + side] - total[at + gap] - total[at] + total[at - side]) / side
    rose = rose - median_filter(rose, 8 * side + 1)
    sd = ROBUST_SD * float(np.median(np.abs(rose))) + 1e-6
    near = np.zeros(len(at), bool)
    for jump in level.refilled:
        near |= np.abs(at - jump) < 2 * (side + gap)
    for end in level.after_gap:
        near |= (at - side <= end) & (end <= at + gap + side)
    # Mass that a standstill over the whole gap retains, kg.
    used = predicted[at] - predicted[at + gap]
    z = np.where((used > 0.0) & ~near, rose / (sd * level.swell[at]), 0.0)
    places = float(np.log(max(2.0, len(at) / side)))
    ups, downs = _find_score_peaks(z, side, places), _find_score_peaks(-z, side, places)
    if not len(ups):
        return None
    up, down = (0.5 * z[some] ** 2 - places for some in (ups, downs))
    kept = np.zeros(len(left))
    for k in ups:
        kept[at[k] :] += max(0.0, float(rose[k])) * np.clip(
            (np.arange(len(left) - at[k]) + 1) / gap, 0.0, 1.0
        )
    flow = np.concatenate(([0.0], np.maximum(0.0, -np.diff(predicted))))
    flowed = max(float(flow.sum()), 1e-9)
    rest = float(np.mean(left[-side:]) - np.mean(left[:side]) - kept[-1])
    # Total of standstills that are each below the noise, kg.
    unseen = rest if 0.0 < rest < len(at) / side * sd else 0.0
    # Spells too short to be detected are spread over the flow.
    kept += unseen * np.cumsum(flow) / flowed
    bridging = EffectInstance(effects.FLOW_BRIDGING.id, 100.0 * float(kept[-1]) / flowed)
    against_none = float(up.sum() - up.max() - down.sum()) + find_prior_odds(bridging)
    # A loss that depends on a variable is as probable a priori as a bridge.
    gains = _calc_step_gains(left, at[ups], side, gap, sd * level.swell[at[ups]])
    odds = -float(np.logaddexp(-against_none, float(gains.max() - gains.sum())))
    sd_share = 100.0 * (sd * (len(ups) ** 0.5 + 1.0) + UNDETECTED_SD_SHARE * unseen) / flowed
    return (
        (kept, DirectDetection(bridging, float(sd_share), odds))
        if odds > MIN_REPORT_LOG_ODDS
        else None
    )


def _calc_step_gains(
    left: Array, begins: npt.NDArray[np.int64], side: int, gap: int, sd: Array
) -> Array:
    """Return the gain in log-likelihood of a step over a slope in each window (k,): both with a
    level, fitted to `side` samples before and after `gap` samples.

    Parameters
    ----------
    left : residual of the scale (m,), kg.
    begins : first sample of each gap (k,).
    sd : s.d. of the difference of the means of both sides (k,), kg.
    """
    at = np.concatenate((np.arange(-side, 0), gap + np.arange(side)))
    windows = left[begins[:, None] + at]
    windows = windows - windows.mean(axis=1, keepdims=True)
    step = np.where(at < 0, -0.5, 0.5)
    slope = at - at.mean()
    explained = (windows @ step) ** 2 / (step @ step) - (windows @ slope) ** 2 / (slope @ slope)
    # The variance of the difference of two means of `side` samples is 2 / side of a sample's.
    return np.asarray(explained / (side * sd**2))


def _find_score_peaks(z: Array, apart: int, log_places: float) -> npt.NDArray[np.int64]:
    """Return indices of the peaks that gain more than the price of their time, at least `apart`
    from each other, highest first."""
    inner = z[1:-1]
    tops = 1 + np.flatnonzero(
        (inner > z[:-2]) & (inner >= z[2:]) & (inner >= np.sqrt(2.0 * log_places))
    )
    free = np.ones(len(z), bool)
    kept = []
    for top in tops[np.argsort(-z[tops], kind="stable")].tolist():
        if free[top]:
            kept.append(top)
            free[max(0, top - apart + 1) : top + apart] = False
    return np.array(sorted(kept), np.int64)


def _find_long_bridges(h: Hopper, level: _ScaleLevel) -> tuple[Array, DirectDetection] | None:
    """Find blocks in which the scale stood still, and return the mass that remained (m,), kg."""
    even, left, predicted = h.grid.even_s, level.left, level.predicted
    hop = max(1, round(BLOCK_S / h.grid.step_s))
    marks = np.arange(0, len(left) - hop, hop)
    if not len(marks):
        return None
    rose = left[marks + hop] - left[marks]
    rpm = np.interp(even, h.time_s[:-1] + 0.5 * h.grid.step_s, h.shaft_rpm[:-1])
    fell = np.where(
        [rpm[k : k + hop].min() > 0.0 for k in marks],
        predicted[marks] - predicted[marks + hop],
        0.0,
    )
    # The reading rises for half a minute after a refill and then settles.
    for jump in level.refilled // hop:
        fell[max(0, jump - 12) : jump + 4] = 0.0
    fell[np.clip((level.after_gap - 1) // hop, 0, len(fell) - 1)] = 0.0
    sd = level.swell[marks] * (ROBUST_SD * float(np.median(np.abs(rose - np.median(rose)))) + 1e-3)
    # Student's t is used, because a refill or an impact on the scale is far from both a bridge and
    # a normal flow.
    score = 0.5 * (FREEDOM + 1.0) * np.log1p((rose / sd) ** 2 / FREEDOM)
    score -= 0.5 * (FREEDOM + 1.0) * np.log1p(((rose - fell) / sd) ** 2 / FREEDOM)
    on, evidence = _find_spells(np.where(fell > 0.0, score, -np.inf))
    working, starts = fell > 0.0, _count_spell_starts(on)
    if starts < 2:
        return None
    bridging = EffectInstance(effects.FLOW_BRIDGING.id, 100.0 * float(on[working].mean()))
    odds = evidence + find_prior_odds(bridging)
    if odds <= MIN_REPORT_LOG_ODDS:
        return None
    stayed = np.concatenate(([0.0], np.cumsum(np.where(on, fell, 0.0))))
    times = np.append(even[marks], even[min(len(even) - 1, int(marks[-1]) + hop)])
    return np.interp(even, times, stayed), DirectDetection(
        bridging, float(100.0 * starts**0.5 / working.sum()), odds
    )


def _find_spells(score: Array) -> tuple[BoolArray, float]:
    """Return the blocks that are more likely within a spell than not, (b,), and the log evidence of
    spells.

    score : log likelihood ratio of a spell, by block (b,). The model has two states; the
    probabilities to begin and to end are averaged over (forward and backward sums: Baum and others,
    Ann. Math. Statist. 41, 1970, 164).
    """
    begins, ends = (
        grid.ravel() for grid in np.meshgrid(np.log(BEGIN_PROBS), np.log(END_PROBS), indexing="ij")
    )
    stays_off, stays_on = np.log1p(-np.exp(begins)), np.log1p(-np.exp(ends))
    count = len(score)
    ahead, behind = np.zeros((2, count, 2, len(begins)))
    off, on = stays_off, begins + score[0]
    for k in range(count):
        if k:
            off, on = (
                np.logaddexp(off + stays_off, on + ends),
                np.logaddexp(off + begins, on + stays_on) + score[k],
            )
        ahead[k] = off, on
    off = on = np.zeros(len(begins))
    for k in range(count - 1, -1, -1):
        behind[k] = off, on
        on = on + score[k]
        off, on = (
            np.logaddexp(off + stays_off, on + begins),
            np.logaddexp(off + ends, on + stays_on),
        )
    total = np.logaddexp(*ahead[-1])
    best = int(np.argmax(total))
    both = (ahead + behind)[:, :, best]
    return expit(both[:, 1] - both[:, 0]) > 0.5, _average_log(total)
