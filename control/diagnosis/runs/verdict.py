"""Whether what is left of a group's channels is noise, and which of its names are only suspected.

Noise, of healthy logs of the benchmark's tuning half: a fast part, and a drift whose s.d. was at most the fast part's;
no single frequency stood out. Anything else is said: as unexplained where no name holds, as something else that it
could be where one does.
"""
from __future__ import annotations

from collections.abc import Collection
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.diagnosis.result import Gain
from control.machine.machine import bounds

from .channels import ChannelSeries
from .hum import QUICK_S
from .likelihood import problem, solved, taken_off
from .names_or_terms import overshadowed
from .noise import series_of, strengths
from .selection import THRESHOLD, Doubt, Judged, Refused

Array = npt.NDArray[np.float64]

MAX_DRIFT = 1.2             # of the scatter within DRIFT_S; largest of 24 healthy channels that drift: 0.86 ...
MAX_SCALE_DRIFT = 2.0       # ... but of the scale, whose readings are means already: 1.37
DRIFT_S = 30.0
MIN_BLOCKS = 8              # of DRIFT_S
MAX_LINE = 45.0             # power of one frequency over that of the noise (chi-square, one degree of freedom);
                            # largest of 60 healthy channels: 29
MIN_PERIODS = 5.0           # of a line within the log: what comes round less often is drift
MAX_LOUD = 8.0              # of the machine file's noise: sensors are not worse by more (healthy loud logs: 5)
MAX_SHORT_DRIFT = 3.0       # of the noise, for the r.m.s. of a log shorter than MIN_BLOCKS
MIN_SHARE = 0.05            # of what the names explain: less is how forms differ
LIKE = 0.4                  # of the variance left, for an effect to be called the nearest
AT_BOUND = 0.01             # of a size's range: closer to its bound, the size is not known
OTHERWISE = 0.5             # probability of something else beside a name that is only suspected


class Remains(NamedTuple):
    """What is left of one channel and is not noise."""

    channel: str
    why: Literal["drift", "line", "loud", "refused"]
    hint: str = ""              # the effect that comes nearest
    from_s: float | None = None
    period_s: float | None = None


def remains(one: Judged, read_off: Collection[str] = ()) -> list[Remains]:
    """What the channels of a group have left, once their named effects and tolerances are off, that is not noise.

    read_off : channels whose spells were taken out before the search: the short ones, unseen, leave a drift behind.
    """
    found = [Remains(ROWS[r.part.id].channels[0], "refused", r.part.id, r.part.onset_s) for r in _evidence(one)[:1]]
    rest = _rest(one)
    for channel in one.search.model.channels:
        if channel.copies > 1:
            continue
        if channel.name not in read_off and _drifts(one, channel, series_of(rest[channel.name], channel.cut)):
            found.append(Remains(channel.name, "drift", _nearest(one, channel, rest[channel.name])))
        period_s = _line(one, channel, rest[channel.name])
        if one.found.noise[channel.name].fast_sd > MAX_LOUD * channel.prior.fast_sd:
            found.append(Remains(channel.name, "loud", _nearest(one, channel, rest[channel.name])))
        if period_s is not None and period_s > QUICK_S:
            found.append(Remains(channel.name, "line", period_s=period_s))
    best: dict[str, Remains] = {}
    for each in found:
        best.setdefault(each.channel, each)
    return list(best.values())


def _rest(one: Judged) -> dict[str, Array]:
    """Banded coefficients (m,) by channel, with all taken off that the hypothesis can take up."""
    columns, parts = one.search.columns, one.found.parts
    base, banded = columns.of_hypothesis(parts), columns.model.banded_residual(parts)
    base = [*base, *(column for term in one.terms for column in term.columns)]
    amplitude, _ = solved(problem(columns.model.channels, banded, base), np.arange(len(base)), one.found.noise)
    return taken_off(banded, base, amplitude)


def _nearest(one: Judged, channel: ChannelSeries, left: Array) -> str:
    """The effect whose trace is most like what is `left` of a channel (m,), noise apart; "" where none is like it."""
    best, like = "", LIKE
    for candidate in one.search.candidates:
        column = one.search.columns.of_candidate(one.found.parts, candidate.part).coefficients.get(channel.name)
        if column is None or not np.any(column):
            continue
        size = float(np.clip(left @ column / (column @ column), candidate.low, candidate.high))
        if ROWS[candidate.part.id].threshold:
            size = candidate.part.size
        share = 1.0 - float(np.sum((left - size * column) ** 2) / np.sum(left ** 2))
        if share > like:
            best, like = candidate.part.id, share
    return best


def _drifts(one: Judged, channel: ChannelSeries, left: Array) -> bool:
    """Whether what is `left` of a channel (m,) drifts by more than a sensor does."""
    if channel.prior.walk_sd > 0.0:         # between its rows more was metered than they say
        return False
    rows = max(2, round(DRIFT_S / channel.grid.step_s))
    blocks = len(left) // rows
    if blocks < MIN_BLOCKS:
        noise = np.hypot(one.found.noise[channel.name].fast_sd, channel.prior.floor_sd)
        return channel.name != "scale" and bool(np.sqrt(np.mean(left ** 2)) > MAX_SHORT_DRIFT * noise)
    if channel.name == "scale":                 # its level is free: a hopper begins with what is in it
        return drift_of(left - left.mean(), rows) > MAX_SCALE_DRIFT
    return drift_of(left, rows) > MAX_DRIFT


def drift_of(left: Array, rows: int) -> float:
    """R.m.s. of means over so many rows, beyond what the scatter within them gives, over that scatter."""
    blocks = len(left) // rows
    cut = left[:blocks * rows].reshape(blocks, rows)
    within = float(np.sqrt(np.mean(np.var(cut, axis=1, ddof=1))))
    between = float(np.mean(cut.mean(axis=1) ** 2)) - within ** 2 / rows
    return float(np.sqrt(max(0.0, between)) / within) if within > 0.0 else 0.0


def _evidence(one: Judged) -> list[Refused]:
    """Refused parts whose evidence is neither drift nor a tolerance, strongest first."""
    explained = 2.0 * (one.found.log_likelihood - one.null.log_likelihood)
    least = max(THRESHOLD, MIN_SHARE * explained)
    return sorted((r for r in one.refused if r.doubt in (Doubt.STRETCH, Doubt.CHANCE) and r.beyond > least),
                  key=lambda r: -r.beyond)


def _line(one: Judged, channel: ChannelSeries, left: Array) -> float | None:
    """Period of a frequency that stands out of the noise that a hypothesis leaves, s; None where none does."""
    power = left ** 2 / strengths(one.found.noise[channel.name], channel.prior, channel.cut, channel.grid.step_s)
    omega = np.concatenate([np.pi * np.arange(end - begin) / (end - begin) for begin, end in channel.cut.bounds])
    omega = omega[channel.cut.order]
    power = np.where(omega * channel.cut.length > 2.0 * np.pi * MIN_PERIODS, power, 0.0)
    at = int(np.argmax(power))
    highest = float(omega[at])
    explained = max(0.0, 2.0 * (one.found.log_likelihood - one.null.log_likelihood))
    if highest <= 0.0 or power[at] < max(MAX_LINE, MIN_SHARE * explained):
        return None
    return float(2.0 * np.pi / highest * channel.grid.step_s)


def suspected(one: Judged, k: int, left: list[Remains], gains: list[Gain]) -> bool:
    """Whether the k-th name may be something else.

    It is, where its channel's rest is not noise or shows a term, a box in time explains as much, its size stands at a
    bound, or it makes rows worse that it was not fitted to (by the 90 % interval: a drift hides what a small effect
    gains).
    """
    part = one.found.parts[k]
    channels = ROWS[part.id].channels
    if any(r.channel in channels for r in left) or part.id in [box.id for box in one.or_boxes]:
        return True
    if overshadowed(part, one.gains[k], one.terms):
        return True
    low, high = bounds(part.id, one.search.model.machine)
    reach = AT_BOUND * (high - low)
    if ROWS[part.id].has_slope and (part.size > high - reach or (low < 0.0 and part.size < low + reach)):
        return True
    shown = {"flow" if channel == "scale" else channel for channel in channels}
    return any(g.low >= g.before for g in gains if g.of == "names" and g.channel in shown)
