"""Effects that come in spells at times of their own: their trace is read off the data, not off a fitted pattern.

What they account for is taken out of the data before anything else is looked for.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_opening, median_filter

from control.diagnosis import effects
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S

from .channels import hopper_channel
from .hypothesis import EffectInstance, schedule, stages_of
from .stages import Hopper, RunData, Speed

Array = npt.NDArray[np.float64]

MIN_GAIN = 60.0             # gain in twice the log-likelihood, all spells together; set on the tuning half
MAX_SHARE = 60.0            # % of the time: what stands still for longer is no bridge

# Bridges of many seconds, block by block: two states and a cost at each beginning (Viterbi's path).
BLOCK_S = 3.0               # a bridge stands at least about twice as long
BEGIN_COST = 6.0            # in log-likelihood, of each further spell
MAX_BLOCK_SCORE = 12.0      # a block counts no more than this: a refill or a knock on the scale is no bridge

# Bridges below the scale's noise, by the step that each leaves in (reading - prediction) for good.
STEP_SIDE_S = 20.0          # on each side of a step: the scale's noise remembers a second or two
STEP_GAP_S = 8.0            # left out around a step
MIN_STEP_SD = 4.0           # in s.d. of the difference between the two sides
MIN_STEPS_SEEN = 2          # and two more for each step downwards
MAX_UNSEEN = 6.0            # of the mass of the steps seen: further standstills may lie below the noise
UNSEEN_SD = 0.2             # of that mass

# Missing pulses of the wheel, as dips of its speed over the GNSS speed.
SWELL = 41                  # samples over which noise grows and shrinks
MIN_DIPS = 6                # and three more for each rise of the same size ...
LONG_DIP = 3                # ... rows of one, or of those that last so long: a reading's tail is over in one
DIP_SD = 3.5                # of wheel over GNSS speed: missing pulses show as whole parts of the speed missing
MIN_DIP = 0.1               # of the speed
USUAL_SHARE = 0.3           # of the rows, that lie closest together, are rows without a dip
CLASSES = 16                # of a variable that the dips may follow ...
FOLLOWS = 0.4               # ... where its class tells so much of when they come: missing pulses come at any time ...
BEGINS_WITH = 1.5           # ... or where the rates at which they begin differ so much from class to class (variance
BEGINS_CHI2 = 60.0          # over mean squared), by so much of chi-square: 14 logs with missing pulses had below 0.4
COMES_WITH_TIME = ("time_s", "hopper_kg", "speed_mps")      # and what changes how many pulses there are
FAST_MPS = 0.6              # below this speed a reading says little about the ratio


class ReadOff(NamedTuple):
    """An effect read off the data."""

    part: EffectInstance
    sd: float
    gain: float                 # of twice the log-likelihood


def without_spells(data: RunData, machine: Machine) -> tuple[RunData, tuple[ReadOff, ...]]:
    """The data with spells taken out, and the effects that they were."""
    found: list[ReadOff] = []
    if data.speed is not None:
        speed, seen = _without_dips(data.speed, _where(data))
        if seen is not None:
            data = data._replace(speed=speed)
            found.append(seen)
    if data.hopper is not None:
        hopper, seen = _without_bridges(data.hopper, machine)
        if seen is not None:
            data = data._replace(hopper=hopper)
            found.append(seen)
    return data, tuple(found)


def _where(data: RunData) -> list[Array]:
    """What a wheel's rolling may depend on, at the speeds' rows: what follows one of these is no missing pulse."""
    assert data.speed is not None
    return [np.interp(data.speed.time_s, data.time_s, values) for name, values in data.variables.items()
            if name not in COMES_WITH_TIME]


def _without_dips(s: Speed, where: Sequence[Array]) -> tuple[Speed, ReadOff | None]:
    """Rows in which a good part of the wheel's speed is missing are put back to the GNSS speed.

    where : variables that a wheel's rolling may depend on (rows,).
    """
    moving = (s.gnss_mps > FAST_MPS) & (s.true_mps > FAST_MPS)
    ratio = s.wheel_mps / np.maximum(s.gnss_mps, 0.1)
    if not moving.any():
        return s, None
    middle, spread = _usual(ratio[moving])
    ratio, spread = ratio / middle, spread / middle
    usual = float(np.mean(ratio[moving & (np.abs(ratio - 1.0) < DIP_SD * spread)]))
    deep = max(MIN_DIP, DIP_SD * spread)
    if not (moving & (ratio < usual - deep)).any():
        return s, None
    usually = float(np.median((usual - ratio)[moving & (ratio < usual - deep)]))
    deep = max(deep, 0.5 * usually)         # a GNSS outlier this large upwards is as odd as a dip is
    dips, rises = moving & (ratio < usual - deep), moving & (ratio > usual + deep)
    starts = _starts(dips)
    if not any(_starts(_lasting(dips, rows)) >= MIN_DIPS + 3 * _starts(_lasting(rises, rows))
               for rows in (1, LONG_DIP)):
        return s, None
    if any(_follows(dips[moving], values[moving]) for values in where):
        return s, None
    missing = np.where(dips | rises, usual - ratio, 0.0)[moving]
    share = 100.0 * float(missing.mean()) / usual
    wheel = np.where(dips, s.wheel_mps * usual / np.maximum(ratio, 0.05), s.wheel_mps)
    sd = share * np.sqrt(2.0 / starts)
    missed = EffectInstance(effects.SPEED_MISSED_PULSES.id, share)
    return s._replace(wheel_mps=wheel), ReadOff(missed, float(sd), 10.0 * starts)


def _follows(on: npt.NDArray[np.bool_], values: Array) -> bool:
    """Whether dips come in some classes of a variable and hardly in the others: how long they last there (share of the
    variance that the class tells, R squared), or how often they begin (chi-square against one rate for all)."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, CLASSES + 1)[1:-1]))
    of, share = np.searchsorted(edges, values), float(np.mean(on))
    counts = np.maximum(1, np.bincount(of, minlength=len(edges) + 1))
    shares = np.bincount(of, on, minlength=len(counts)) / counts
    follows = float(np.sum(counts * (shares - share) ** 2) / max(1e-12, len(on) * share * (1.0 - share)))
    starts_in = np.bincount(of, on & ~np.insert(on[:-1], 0, False), minlength=len(counts))
    even = counts * float(starts_in.sum()) / float(counts.sum())
    chi2 = float(np.sum((starts_in - even) ** 2 / np.maximum(even, 1e-12)))
    uneven = (chi2 - len(edges)) / max(1.0, float(starts_in.sum()))
    return follows > FOLLOWS or (chi2 > BEGINS_CHI2 and uneven > BEGINS_WITH)


def _usual(ratio: Array) -> tuple[float, float]:
    """Where readings lie closest together, and the s.d. above that place: up to half of them may be dips."""
    ranked = np.sort(ratio)
    count = max(2, int(np.ceil(USUAL_SHARE * len(ranked))))
    if count >= len(ranked):
        return float(np.median(ranked)), 1.4826 * float(np.median(np.abs(ranked - np.median(ranked))))
    width = ranked[count:] - ranked[:-count]
    at = int(np.argmin(width))
    middle = float(np.median(ranked[at:at + count + 1]))
    above = ranked[ranked > middle] - middle
    return middle, 1.4826 * float(np.median(above)) if len(above) else 0.0


def _lasting(on: npt.NDArray[np.bool_], rows: int) -> npt.NDArray[np.bool_]:
    """Spells of at least so many rows."""
    return np.asarray(binary_opening(on, np.ones(rows, bool)))


def _starts(on: npt.NDArray[np.bool_]) -> int:
    return int((on & ~np.insert(on[:-1], 0, False)).sum())


def _without_bridges(h: Hopper, machine: Machine) -> tuple[Hopper, ReadOff | None]:
    """Spells in which the scale stands still though the shaft turns; the mass that stayed behind is taken off.

    Long spells are seen block by block, short ones by the step that they leave in (reading - prediction) for good.
    """
    long = _long_bridges(h, machine)
    short = _short_bridges(h, machine)
    found = [one for one in (long, short) if one is not None]
    return max(found, key=lambda one: one[1].gain) if found else (h, None)


def _short_bridges(h: Hopper, machine: Machine) -> tuple[Hopper, ReadOff] | None:
    """Upward steps of (reading - prediction), each against the mean level on both of its sides."""
    channel = hopper_channel(h, machine)
    predicted = channel.predict(schedule(stages_of(machine), ()), MOST_STEP_S)
    left, step_s = channel.measured - predicted, h.grid.step_s
    side, gap = max(4, round(STEP_SIDE_S / step_s)), max(1, round(STEP_GAP_S / step_s))
    if len(left) < 20 * side:
        return None
    total = np.concatenate(([0.0], np.cumsum(left)))
    at = np.arange(side, len(left) - side - gap)
    rose = (total[at + gap + side] - total[at + gap] - total[at] + total[at - side]) / side
    rose = rose - median_filter(rose, 8 * side + 1)
    sd = 1.4826 * float(np.median(np.abs(rose))) + 1e-6
    used = predicted[at] - predicted[at + gap]              # kg that a standstill of the whole gap keeps back
    z = np.where((used > 0.0) & ~_near_refill(h, at, side + gap), rose / (sd * _swell(left)[at]), 0.0)
    ups, downs = _peaks(z, side), _peaks(-z, side)
    if len(ups) < MIN_STEPS_SEEN + 2 * len(downs):
        return None
    kept = np.zeros(len(left))
    for k in ups:
        kept[at[k]:] += max(0.0, float(rose[k])) * np.clip((np.arange(len(left) - at[k]) + 1) / gap, 0.0, 1.0)
    flow = np.concatenate(([0.0], np.maximum(0.0, -np.diff(predicted))))
    flowed = float(flow.sum())
    rest = float(np.mean(left[-side:]) - np.mean(left[:side]) - kept[-1])
    unseen = rest if 0.0 < rest < MAX_UNSEEN * kept[-1] else 0.0
    kept += unseen * np.cumsum(flow) / max(flowed, 1e-9)    # spells too short to be seen one by one
    share, gain = 100.0 * float(kept[-1]) / max(flowed, 1e-9), float(np.sum(z[ups] ** 2) - np.sum(z[downs] ** 2))
    if gain < MIN_GAIN or share > MAX_SHARE:
        return None
    middle = h.time_s[:-1] + 0.5 * step_s
    stayed = np.interp(middle, h.grid.even_s, kept)
    sd_share = 100.0 * sd * (len(ups) ** 0.5 + 1.0) / max(flowed, 1e-9) + UNSEEN_SD * 100.0 * unseen / max(flowed, 1e-9)
    seen = ReadOff(EffectInstance(effects.FLOW_BRIDGING.id, share), float(sd_share), gain)
    return h._replace(reading_kg=h.reading_kg - stayed), seen


def _swell(left: Array) -> Array:
    """How much louder the noise is around each sample of a residual (m,) than usually, at least 1: (m,)."""
    steps = np.abs(np.diff(left, append=left[-1:]))
    return np.asarray(np.maximum(1.0, median_filter(steps, SWELL) / max(float(np.median(steps)), 1e-9)))


def _near_refill(h: Hopper, at: npt.NDArray[np.int64], reach: int) -> npt.NDArray[np.bool_]:
    near = np.zeros(len(at), bool)
    for jump in h.jumps:
        place = int(np.searchsorted(h.grid.even_s, h.time_s[jump]))
        near |= np.abs(at - place) < 2 * reach
    return near


def _peaks(z: Array, apart: int) -> npt.NDArray[np.int64]:
    """Places of peaks above MIN_STEP_SD, at least `apart` from each other: the higher ones first."""
    inner = z[1:-1]
    tops = 1 + np.flatnonzero((inner > z[:-2]) & (inner >= z[2:]) & (inner >= MIN_STEP_SD))
    free = np.ones(len(z), bool)
    kept = []
    for top in tops[np.argsort(-z[tops], kind="stable")].tolist():
        if free[top]:
            kept.append(top)
            free[max(0, top - apart + 1):top + apart] = False
    return np.array(sorted(kept), np.int64)


def _long_bridges(h: Hopper, machine: Machine) -> tuple[Hopper, ReadOff] | None:
    """Blocks in which the scale stood still."""
    channel = hopper_channel(h, machine)
    even = h.grid.even_s
    predicted = channel.predict(schedule(stages_of(machine), ()), MOST_STEP_S)
    left = channel.measured - predicted
    hop = max(1, round(BLOCK_S / h.grid.step_s))
    marks = np.arange(0, len(left) - hop, hop)
    if not len(marks):
        return None
    rose = left[marks + hop] - left[marks]
    rpm = np.interp(even, h.time_s[:-1] + 0.5 * h.grid.step_s, h.shaft_rpm[:-1])
    fell = np.where([rpm[k:k + hop].min() > 0.0 for k in marks], predicted[marks] - predicted[marks + hop], 0.0)
    jumps = [int(np.argmin(np.abs(even[marks] - h.time_s[j]))) for j in h.jumps]
    for j in jumps:
        fell[max(0, j - 12):j + 4] = 0.0
    sd = 1.4826 * float(np.median(np.abs(rose - np.median(rose)))) + 0.02
    score = (2.0 * rose * fell - fell ** 2) / (2.0 * (sd * _swell(left)[marks]) ** 2)
    score = np.clip(np.where(fell > sd, score, -1.0), -MAX_BLOCK_SCORE, MAX_BLOCK_SCORE)
    on, gain = _spells(score)
    starts = int((on & ~np.insert(on[:-1], 0, False)).sum())
    if starts < 2 or 2.0 * gain < MIN_GAIN:
        return None
    working = fell > 0.0
    share = 100.0 * float(on[working].mean())
    if share > MAX_SHARE:
        return None
    kept = np.concatenate(([0.0], np.cumsum(np.where(on, fell, 0.0))))
    times = np.append(even[marks], even[min(len(even) - 1, int(marks[-1]) + hop)])
    stayed = np.interp(h.time_s[:-1] + 0.5 * h.grid.step_s, times, kept)
    sd_share = 100.0 * starts ** 0.5 * hop * h.grid.step_s / (working.sum() * hop * h.grid.step_s)
    return (h._replace(reading_kg=h.reading_kg - stayed),
            ReadOff(EffectInstance(effects.FLOW_BRIDGING.id, share), float(sd_share), 2.0 * gain))


def _spells(score: Array) -> tuple[npt.NDArray[np.bool_], float]:
    """Blocks of the most probable spells, and their log-likelihood: two states, a cost at each beginning."""
    off, on = 0.0, -BEGIN_COST
    back = np.zeros((len(score), 2), bool)          # whether the other state came before
    for k, value in enumerate(score):
        back[k] = (on > off, off - BEGIN_COST > on)
        off, on = max(off, on), max(on, off - BEGIN_COST) + value
    state = 1 if on > off else 0
    total = max(on, off)
    path = np.zeros(len(score), bool)
    for k in range(len(score) - 1, -1, -1):
        path[k] = state == 1
        if back[k, state]:
            state = 1 - state
    return path, float(total)
