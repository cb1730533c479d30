"""Whether what is left of a group's channels is noise, and which of its names are only suspected.

Noise, of healthy logs of the benchmark's tuning half: a fast part, and a drift whose s.d. was at most the fast part's;
no single frequency stood out. Anything else is said: as unexplained where no name holds, as something else that it
could be where one does.
"""
from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.diagnosis.result import Gain
from control.machine.machine import bounds

from . import noise as noises
from .channels import ChannelSeries
from .likelihood import problem, solved
from .noise import series_of
from .selection import THRESHOLD, Doubt, Judged, Refused

Array = npt.NDArray[np.float64]

MAX_DRIFT = 1.2             # of the scatter within DRIFT_S; largest of 24 healthy channels that drift: 0.86 ...
MAX_SCALE_DRIFT = 2.0       # ... but of the scale, whose readings are means already: 1.37
DRIFT_S = 30.0
MIN_BLOCKS = 8              # of DRIFT_S
MAX_LINE = 45.0             # power of one frequency over that of the noise (chi-square, one degree of freedom);
                            # largest of 60 healthy channels: 29
MIN_PERIOD_S = 3.0          # quicker than that a sensor hums, and no dose follows it on the ground
MIN_SHARE = 0.05            # of what the names explain: less is how forms differ
AT_BOUND = 0.01             # of a size's range: closer to its bound, the size is not known
OTHERWISE = 0.5             # probability of something else beside a name that is only suspected


class Remains(NamedTuple):
    """What is left of one channel and is not noise."""

    channel: str
    why: Literal["drift", "line", "refused"]
    hint: str = ""              # the effect that comes nearest
    from_s: float | None = None
    period_s: float | None = None


def remains(one: Judged) -> list[Remains]:
    """What the channels of a group have left, once their named effects and tolerances are off, that is not noise."""
    found = [Remains(ROWS[r.part.id].channels[0], "refused", r.part.id, r.part.onset_s) for r in _evidence(one)[:1]]
    rest = _rest(one)
    for channel in one.search.model.channels:
        if channel.copies > 1:
            continue
        limit = MAX_SCALE_DRIFT if channel.name == "scale" else MAX_DRIFT
        if _drifts(series_of(rest[channel.name], channel.cut), channel.grid.step_s) > limit:
            found.append(Remains(channel.name, "drift"))
        period_s = _line(one, channel, rest[channel.name])
        if period_s is not None:
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
    left = {name: values.copy() for name, values in banded.items()}
    for size, column in zip(amplitude, base, strict=True):
        for name, values in column.coefficients.items():
            left[name] -= size * values
    return left


def _drifts(left: Array, step_s: float) -> float:
    """S.d. of means over DRIFT_S, beyond what the scatter within them gives, over that scatter; 0 of a short series."""
    rows = max(2, round(DRIFT_S / step_s))
    blocks = len(left) // rows
    if blocks < MIN_BLOCKS:
        return 0.0
    cut = left[:blocks * rows].reshape(blocks, rows)
    within = float(np.sqrt(np.mean(np.var(cut, axis=1, ddof=1))))
    between = float(np.var(cut.mean(axis=1), ddof=1)) - within ** 2 / rows
    return float(np.sqrt(max(0.0, between)) / within) if within > 0.0 else 0.0


def _evidence(one: Judged) -> list[Refused]:
    """Refused parts whose evidence is neither drift nor a tolerance, strongest first."""
    explained = 2.0 * (one.found.log_likelihood - one.null.log_likelihood)
    least = max(THRESHOLD, MIN_SHARE * explained)
    return sorted((r for r in one.refused if r.doubt in (Doubt.STRETCH, Doubt.CHANCE) and r.gain > least),
                  key=lambda r: -r.gain)


def _line(one: Judged, channel: ChannelSeries, left: Array) -> float | None:
    """Period of a frequency that stands out of the noise that a hypothesis leaves, s; None where none does."""
    noise = np.array(one.found.noise[channel.name].theta)
    strength = noises.spectrum(noise, channel.prior, channel.cut, channel.grid.step_s)
    power = left ** 2 / np.repeat(strength, channel.cut.members.astype(np.int64))
    at = int(np.argmax(power))
    omega = np.concatenate([np.pi * np.arange(end - begin) / (end - begin) for begin, end in channel.cut.bounds])
    highest = float(omega[channel.cut.order][at])
    explained = max(0.0, 2.0 * (one.found.log_likelihood - one.null.log_likelihood))
    if highest <= 0.0 or power[at] < max(MAX_LINE, MIN_SHARE * explained):
        return None
    period_s = float(2.0 * np.pi / highest * channel.grid.step_s)
    return period_s if period_s > MIN_PERIOD_S else None


def suspected(one: Judged, k: int, left: list[Remains], gains: list[Gain]) -> bool:
    """Whether the k-th name may be something else: its channel's rest is not noise, its size stands at a bound, or it
    makes rows worse that it was not fitted to (by the 90 % interval: a drift hides what a small effect gains)."""
    part = one.found.parts[k]
    channels = ROWS[part.id].channels
    if any(r.channel in channels for r in left):
        return True
    low, high = bounds(part.id, one.search.model.machine)
    reach = AT_BOUND * (high - low)
    if ROWS[part.id].has_slope and (part.size > high - reach or (low < 0.0 and part.size < low + reach)):
        return True
    shown = {"flow" if channel == "scale" else channel for channel in channels}
    return any(g.low >= g.before for g in gains if g.of == "names" and g.channel in shown)
