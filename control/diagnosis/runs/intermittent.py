"""Effects that come in spells at times of their own: their trace is read off the data, not off
a fitted pattern.

What they account for is taken out of the data before anything else is looked for. Each is
weighed as every other effect: log evidence plus its log prior odds, against nothing in its
place (`prior.py`), and taken from `SAID` on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, binary_opening, median_filter
from scipy.special import betainc, betaln, expit, gammaln
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.effects import ROWS
from topdress.control.diagnosis.judgement.prior import (
    COURSE,
    ROBUST_SD,
    SAID,
    UNKNOWN,
    calc_log_prior_odds,
)
from topdress.control.machine.machine import Machine
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import make_hopper_channel, predict_binned_effort
from .effort import EFFORT, DriveEffort
from .hopper import Hopper
from .hypothesis import EffectInstance, list_stages, make_schedule
from .model import GROUPS
from .robust import FREEDOM
from .search import DIPS_WITHIN_S
from .speed_and_heads import TwoSpeeds
from .stages import RunData

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SWELL = 41  # samples over which noise grows and shrinks

# Bridges that stand for many seconds, block by block.
BLOCK_S = 3.0  # a bridge stands at least about twice as long
# chance that a bridge begins in a block: one in a quarter of an hour to all day
BEGINS = (0.003, 0.01, 0.03, 0.1)
# ... and that it ends in one: it stands for some ten or some five seconds
ENDS = (0.2, 0.5)

# Bridges below the scale's noise, by the step that each leaves in (reading - prediction) for good.
# on each side of a step: the scale's noise remembers a second or two
STEP_SIDE_S = 20.0
STEP_GAP_S = 8.0  # left out around a step

# Missing pulses of the wheel, as dips of its speed over the GNSS speed.
# rows: a reading's tail is over in one, and outliers are as often above as below
LONG_DIP = 3
# of wheel over GNSS speed: a reading further off is an outlier (Iglewicz and Hoaglin, 1993)
DIP_SD = 3.5
# of the rows, that lie closest together, are rows without a dip
USUAL_SHARE = 0.3
CLASSES = 16  # of a variable that the dips may follow ...
# ... times as many samples as there are classes: rates alike within 1 / sqrt(4) of each
ALIKE = 4.0
# below this speed a reading says little about the ratio
FAST_MPS = 0.6
# what changes how many pulses there are
COMES_WITH_TIME = ("time_s", "hopper_kg", "speed_mps")

# s.d. of what spells too short to be seen make, as a share of what was seen
UNSEEN_SD = 0.2


class ReadOff(NamedTuple):
    """An effect read off the data."""

    part: EffectInstance
    sd: float
    log_odds: float  # posterior, against nothing in its place


def find_prior_odds(part: EffectInstance) -> float:
    """Log prior odds of an effect that is read off, among those of its group of channels."""
    channel = ROWS[part.id].channels[0]
    names = {
        name
        for names in GROUPS.values()
        if channel in names
        for name in names
        if name not in EFFORT
    }
    rivals = sum(bool(row.channels) and row.channels[0] in names for row in ROWS.values())
    return calc_log_prior_odds("steady" if part.onset_s is None else "begins", rivals)


def without_spells(data: RunData, machine: Machine) -> tuple[RunData, tuple[ReadOff, ...]]:
    """The data with spells taken out, and the effects that they were."""
    found: list[ReadOff] = []
    if data.speed is not None:
        speed, seen = _without_dips(data.speed, _list_where_variables(data))
        if seen is not None:
            data = data._replace(speed=speed)
            found.append(seen)
    bare = None
    for k, effort in enumerate(data.efforts):
        if effort.name == "effort" and (bare := _without_load(effort, machine)) is not None:
            data = data._replace(efforts=(*data.efforts[:k], bare.left, *data.efforts[k + 1 :]))
    seen = None
    if data.hopper is not None:
        hopper, seen = _without_bridges(data.hopper, machine, bare)
        data = data._replace(hopper=hopper)
    if (
        seen := max(
            (one for one in (seen, bare and bare.seen) if one is not None),
            key=lambda one: one.log_odds,
            default=None,
        )
    ) is not None:
        found.append(seen)
    return data, tuple(found)


class _Unloaded(NamedTuple):
    """Spells in which the rollers turned without material: when, and the drive's effort without
    them."""

    begin_s: Array
    end_s: Array
    left: DriveEffort
    seen: ReadOff

    def stood_s(self, time_s: Array) -> Array:
        """For how long there was none until each time, s."""
        return np.asarray(
            np.sum(np.clip(time_s[:, None] - self.begin_s, 0.0, self.end_s - self.begin_s), axis=1)
        )


def _without_load(e: DriveEffort, machine: Machine) -> _Unloaded | None:
    """Spells in which the material's load was gone, one of which ended at least: an empty
    hopper's does not."""
    bins, stages = predict_binned_effort(e), list_stages(machine)
    full = bins(make_schedule(stages, ()))
    gone = bins(make_schedule(stages.put("effort", load=0.0), ())) - full
    known = e.members > 0
    left = e.bin_row_means(e.measured) - full
    # From bin to bin: a load that grew for good is no noise.
    sd = ROBUST_SD * float(np.nanmedian(np.abs(np.diff(left)))) / np.sqrt(
        2.0
    ) + machine.noise.effort / np.sqrt(e.rows_a_bin)
    loaded = known & (gone < -sd)
    if not loaded.any():
        return None
    # a load that is less, or more, for good is no bridge
    usual = float(np.median(left[loaded] / gone[loaded]))

    def unlike(share: float) -> Array:
        """Student's t, as of the scale: a stone between the rollers is far from all."""
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
    bridging = EffectInstance(effects.FLOW_BRIDGING.id, 100.0 * float(on[known].mean()))
    odds = evidence + find_prior_odds(bridging)
    if not ended or odds <= SAID:
        return None
    half_s = 0.5 * e.grid.step_s
    return _Unloaded(
        e.middle_s[begins] - half_s,
        e.middle_s[ends - 1] + half_s,
        e.without(binary_dilation(on)),
        ReadOff(bridging, float(100.0 * len(begins) ** 0.5 / known.sum()), odds),
    )


def _list_where_variables(data: RunData) -> list[Array]:
    """What a wheel's rolling may depend on, at the speeds' rows: what follows one of these is
    no missing pulse."""
    assert data.speed is not None
    return [
        np.interp(data.speed.time_s, data.time_s, values)
        for name, values in data.variables.items()
        if name not in COMES_WITH_TIME
    ]


def _without_dips(s: TwoSpeeds, where: Sequence[Array]) -> tuple[TwoSpeeds, ReadOff | None]:
    """Rows in which a good part of the wheel's speed is missing are put back to the GNSS speed.

    where : variables that a wheel's rolling may depend on (rows,).
    """
    moving = (s.gnss_mps > FAST_MPS) & (s.true_mps > FAST_MPS)
    ratio = s.wheel_mps / np.maximum(s.gnss_mps, FAST_MPS)
    if not moving.any():
        return s, None
    middle, spread = _find_usual_ratio(ratio[moving])
    ratio, spread = ratio / middle, spread / middle
    usual = float(np.mean(ratio[moving & (np.abs(ratio - 1.0) < DIP_SD * spread)]))
    deep = DIP_SD * spread
    if not (moving & (ratio < usual - deep)).any():
        return s, None
    usually = float(np.median((usual - ratio)[moving & (ratio < usual - deep)]))
    # a GNSS outlier this large upwards is as odd as a dip is
    deep = max(deep, 0.5 * usually)
    dips, rises = moving & (ratio < usual - deep), moving & (ratio > usual + deep)
    pulse_rows = max(1.0, DIPS_WITHIN_S / s.grid.step_s)
    missing = np.where(dips | rises, usual - ratio, 0.0)[moving]
    share = 100.0 * float(missing.mean()) / usual
    missed = EffectInstance(effects.SPEED_MISSED_PULSES.id, share)
    evidence = max(
        _calc_dip_evidence(
            *(
                _count_pulses(binary_opening(one, np.ones(rows, bool)), pulse_rows)
                for one in (dips, rises)
            )
        )
        for rows in (1, LONG_DIP)
    )
    odds = evidence - float(np.log(2.0)) + find_prior_odds(missed)  # two ways to count them
    followed = [_calc_class_evidence(dips[moving], values[moving], pulse_rows) for values in where]
    # some of what follows a variable comes for a while: so may pulses that are missing
    if followed:
        steady = COURSE["steady"]
        for_a_while = np.log(1.0 - steady) + _calc_class_evidence(
            dips[moving], np.arange(float(moving.sum())), pulse_rows
        )
        alone = find_prior_odds(missed) + float(np.logaddexp(np.log(steady), for_a_while))
        odds = min(
            odds,
            alone - float(np.logaddexp.reduce(followed)) - float(np.log(UNKNOWN / len(followed))),
        )
    if odds <= SAID:
        return s, None
    wheel = np.where(dips, s.wheel_mps * usual / np.maximum(ratio, 0.05), s.wheel_mps)
    sd = share * np.sqrt(2.0 / _count_spell_starts(dips))
    return s._replace(wheel_mps=wheel, unseen_percent=UNSEEN_SD * share), ReadOff(
        missed, float(sd), odds
    )


def _count_pulses(on: BoolArray, rows: float) -> float:
    """How many pulses spells are worth: one each, or one for each `rows` of them."""
    return max(float(_count_spell_starts(on)), float(on.sum()) / rows)


def _calc_dip_evidence(dips: float, rises: float) -> float:
    """Log evidence for dips that are likelier than rises of the same size, over outliers, of
    which either is as likely: a binomial, its share integrated over the upper half under
    Jeffreys' prior."""
    upper = max(1.0 - float(betainc(dips + 0.5, rises + 0.5, 0.5)), 1e-300)
    return float(
        np.log(2.0 * upper / np.pi) + betaln(dips + 0.5, rises + 0.5) + (dips + rises) * np.log(2.0)
    )


def _calc_class_evidence(on: BoolArray, values: Array, rows: float) -> float:
    """Log evidence for spells that come in some classes of a variable more than in others, over
    such as come at any time: at rates that are alike from class to class within half of
    themselves (1 s.d.).

    Shares of the classes with a Dirichlet prior, integrated. rows : of one pulse that is
    missing.
    """
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, CLASSES + 1)[1:-1]))
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
        - evidence(ALIKE * len(expected))
    )


def _find_usual_ratio(ratio: Array) -> tuple[float, float]:
    """Where readings lie closest together, and the s.d. above that place: up to half of them
    may be dips."""
    ranked = np.sort(ratio)
    count = max(2, int(np.ceil(USUAL_SHARE * len(ranked))))
    if count >= len(ranked):
        return float(np.median(ranked)), ROBUST_SD * float(
            np.median(np.abs(ranked - np.median(ranked)))
        )
    width = ranked[count:] - ranked[:-count]
    at = int(np.argmin(width))
    middle = float(np.median(ranked[at : at + count + 1]))
    above = ranked[ranked > middle] - middle
    return middle, ROBUST_SD * float(np.median(above)) if len(above) else 0.0


def _count_spell_starts(on: BoolArray) -> int:
    return int((on & ~np.insert(on[:-1], 0, False)).sum())


class _ScaleLevel(NamedTuple):
    """What the nominal machine leaves of a scale, at the even grid (m,)."""

    predicted: Array
    left: Array
    # how much louder the noise is around each sample than usually, at least 1
    swell: Array
    refilled: npt.NDArray[np.int64]  # samples at which the hopper is filled
    # samples before which rows are missing for long: the level is open there
    after_gap: npt.NDArray[np.int64]


def _without_bridges(
    h: Hopper, machine: Machine, bare: _Unloaded | None
) -> tuple[Hopper, ReadOff | None]:
    """Spells in which the scale stands still though the shaft turns; the mass that stayed
    behind is taken off.

    Long spells are seen block by block, short ones by the step that they leave in (reading -
    prediction) for good. bare : what the drive tells of them: to the half second, and taken
    where the scale bears it out.
    """
    channel = make_hopper_channel(h, machine)
    predicted = channel.predict(make_schedule(list_stages(machine), ()), MAX_MODEL_STEP_S)
    left = channel.measured - predicted
    steps = np.abs(np.diff(left, append=left[-1:]))
    swell = np.maximum(1.0, median_filter(steps, SWELL) / max(float(np.median(steps)), 1e-9))
    level = _ScaleLevel(
        predicted,
        left,
        swell,
        *(
            np.searchsorted(h.grid.even_s, h.time_s[list(bins)])
            for bins in (h.jumps, [end for end, _ in h.gaps])
        ),
    )
    found = [
        one
        for one in (
            _long_bridges(h, level),
            _short_bridges(h, level),
            _find_load_spells(h, level, bare),
        )
        if one is not None
    ]
    if not found:
        return h, None
    stayed_kg, seen = max(found, key=lambda one: one[1].log_odds)
    at_s = h.time_s[:-1] + 0.5 * h.grid.step_s
    return h._replace(reading_kg=h.reading_kg - np.interp(at_s, h.grid.even_s, stayed_kg)), seen


def _find_load_spells(
    h: Hopper, level: _ScaleLevel, bare: _Unloaded | None
) -> tuple[Array, ReadOff] | None:
    """The spells that the drive tells: what stayed behind (m,), kg. None where the scale fell
    meanwhile."""
    if bare is None:
        return None
    edges_s = np.append(h.grid.even_s, h.grid.even_s[-1] + h.grid.step_s) - 0.5 * h.grid.step_s
    stands = np.diff(bare.stood_s(edges_s)) / h.grid.step_s
    fell = stands * np.maximum(0.0, -np.diff(level.predicted, prepend=level.predicted[:1]))
    rose = float(np.sum(stands * np.diff(level.left, prepend=level.left[:1])))
    return (np.cumsum(fell), bare.seen) if rose > 0.5 * float(fell.sum()) else None


def _short_bridges(h: Hopper, level: _ScaleLevel) -> tuple[Array, ReadOff] | None:
    """Upward steps of (reading - prediction), each against the mean level on both of its sides:
    what stayed behind (m,), kg.

    A step at an unknown place gains z^2 / 2 less the logarithm of how many places there are.
    The clearest one may be a hand on the machine, and steps downwards, which no bridge leaves,
    speak against those upwards.
    """
    left, predicted, step_s = level.left, level.predicted, h.grid.step_s
    side, gap = max(4, round(STEP_SIDE_S / step_s)), max(1, round(STEP_GAP_S / step_s))
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
    # kg that a standstill of the whole gap keeps back
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
    # a standstill in every place, each below its noise
    unseen = rest if 0.0 < rest < len(at) / side * sd else 0.0
    kept += unseen * np.cumsum(flow) / flowed  # spells too short to be seen one by one
    bridging = EffectInstance(effects.FLOW_BRIDGING.id, 100.0 * float(kept[-1]) / flowed)
    odds = float(up.sum() - up.max() - down.sum()) + find_prior_odds(bridging)
    sd_share = 100.0 * (sd * (len(ups) ** 0.5 + 1.0) + UNSEEN_SD * unseen) / flowed
    return (kept, ReadOff(bridging, float(sd_share), odds)) if odds > SAID else None


def _find_score_peaks(z: Array, apart: int, log_places: float) -> npt.NDArray[np.int64]:
    """Peaks that gain more than their place costs, at least `apart` from each other, the higher
    ones first: places."""
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


def _long_bridges(h: Hopper, level: _ScaleLevel) -> tuple[Array, ReadOff] | None:
    """Blocks in which the scale stood still: what stayed behind (m,), kg."""
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
    # the reading rises for half a minute, and settles
    for jump in level.refilled // hop:
        fell[max(0, jump - 12) : jump + 4] = 0.0
    fell[np.clip((level.after_gap - 1) // hop, 0, len(fell) - 1)] = 0.0
    sd = level.swell[marks] * (ROBUST_SD * float(np.median(np.abs(rose - np.median(rose)))) + 1e-3)
    # Student's t: a refill or a knock on the scale is far from a bridge and from none alike.
    score = 0.5 * (FREEDOM + 1.0) * np.log1p((rose / sd) ** 2 / FREEDOM)
    score -= 0.5 * (FREEDOM + 1.0) * np.log1p(((rose - fell) / sd) ** 2 / FREEDOM)
    on, evidence = _find_spells(np.where(fell > 0.0, score, -np.inf))
    working, starts = fell > 0.0, _count_spell_starts(on)
    if starts < 2:
        return None
    bridging = EffectInstance(effects.FLOW_BRIDGING.id, 100.0 * float(on[working].mean()))
    odds = evidence + find_prior_odds(bridging)
    if odds <= SAID:
        return None
    stayed = np.concatenate(([0.0], np.cumsum(np.where(on, fell, 0.0))))
    times = np.append(even[marks], even[min(len(even) - 1, int(marks[-1]) + hop)])
    return np.interp(even, times, stayed), ReadOff(
        bridging, float(100.0 * starts**0.5 / working.sum()), odds
    )


def _find_spells(score: Array) -> tuple[BoolArray, float]:
    """Blocks that are likelier within a spell than not, (b,), and the log evidence of spells
    over none.

    score : log likelihood ratio of a spell over none, by block (b,). Two states; the chances to
    begin and to end are averaged over (forward and backward sums: Baum and others, Ann. Math.
    Statist. 41, 1970, 164).
    """
    begins, ends = (
        grid.ravel() for grid in np.meshgrid(np.log(BEGINS), np.log(ENDS), indexing="ij")
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
    return expit(both[:, 1] - both[:, 0]) > 0.5, float(np.logaddexp.reduce(total)) - float(
        np.log(len(total))
    )
