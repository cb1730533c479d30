"""Effects that make one curve together, started together.

What a drive's zone takes away, a gain that is off gives back over most of the range, and a curve that bends takes it
away again at the top: each of them alone fits little, and the best of three one after the other is not the best three.
The sizes of several are therefore fitted at once, by least squares through the machine model, from a small and a large
zone (several starts: Seber and Wild, Nonlinear Regression, 1989, 15.2). The judgement then holds the result against
what it found one by one.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import (
    ROWS,
    SHAFT_BACK_GAIN,
    SHAFT_BACK_ZONE,
    SHAFT_DEAD_TIME,
    SHAFT_DEAD_ZONE,
    SHAFT_GAIN,
    SHAFT_SATURATION,
    SHAFT_SECOND_ORDER,
    SHAFT_SLOW,
    reach,
)
from control.machine.machine import Machine
from control.machine.shaft import lag_s

from .hypothesis import EffectInstance, Hypothesis, stages_of
from .search import Search

Array = npt.NDArray[np.float64]

CURVES = (                  # names that are one curve of the command
    (SHAFT_GAIN.id, SHAFT_DEAD_ZONE.id), (SHAFT_GAIN.id, SHAFT_SATURATION.id),
    (SHAFT_GAIN.id, SHAFT_DEAD_ZONE.id, SHAFT_SATURATION.id))
SWING = (SHAFT_SLOW.id, SHAFT_SECOND_ORDER.id)  # ... and one answer to a step: its frequency and its damping
BACKWARDS = (SHAFT_BACK_GAIN.id, SHAFT_BACK_ZONE.id)     # ... of another size where it turns backwards
MOVES = (SHAFT_DEAD_TIME.id, SHAFT_SLOW.id)     # how it gets there
FAMILY = frozenset({name for curve in CURVES for name in curve} | {*BACKWARDS, *MOVES, *SWING})
# A swing of another frequency is out of step after some 1 / (2 pi damping) periods: least squares gets no further than
# to a quarter of the way there, so that every frequency is looked at first, and the best of them are fitted.
FREQUENCIES = np.geomspace(0.1, 10.0, 16)   # natural, in 1 / the machine file's time constant
DAMPINGS = (0.1, 0.3, 0.8, 2.0)     # ratios: rings long, overshoots, hardly, two time constants
FITTED_FROM = 2             # best of these
ZONES = (0.05, 0.2)         # of the full command, from which a zone starts: 5 to 25 % are usual of motors by duty cycle
MOST_RUNS = 25              # steps of a start: it is refined by the judgement's own fit
NUDGE = 0.01                # of the usual size: difference for a slope
STARTS_AT = 0.2             # of the usual size: inside the bounds, where every slope can be taken


def started(search: Search, now: Hypothesis, proposed: Sequence[EffectInstance]) -> Iterator[Hypothesis]:
    """Hypotheses with several sizes fitted together, in place of whatever of the same curve a hypothesis holds.

    proposed : what may be added: where a second order is among it or there, frequency and damping are fitted at once.
    """
    model = search.model
    if "shaft" not in model.names:
        return
    tried = {c.part.id for c in search.candidates if c.part.onset_s is None}
    swings = any(part.id == SHAFT_SECOND_ORDER.id and part.onset_s is None for part in (*now, *proposed))
    if swings and set(SWING) <= tried and not set(SWING) <= {part.id for part in now}:
        yield _fitted(search, tuple(part for part in now if part.id not in (*SWING, *MOVES)), SWING)
    if now and not model.channel("shaft").settled:
        return              # in a log of moves a curve's parts are also seen one by one: once will do
    back = tuple(one for one in BACKWARDS if one in tried)
    others = tuple(part for part in now if part.id not in FAMILY or part.onset_s is not None)
    taken = {part.id for part in others}
    for curve in CURVES:
        if set(curve) <= tried - taken and not set(curve) <= {part.id for part in now}:
            for more in dict.fromkeys([(), back]):
                yield _fitted(search, others, (*curve, *more))


def _fitted(search: Search, others: Hypothesis, names: Sequence[str]) -> Hypothesis:
    """Parts of these names, fitted with the others by least squares over all rows alike."""
    from scipy.optimize import least_squares  # three tenths of a second: where it is asked for
    model, machine = search.model, search.model.machine
    channel, base = model.channel("shaft"), stages_of(machine)
    usual = np.array([ROWS[name].on(machine).usual for name in names])
    low, high = np.array([reach(name, machine) for name in names]).T

    def parts(sizes: Array) -> Hypothesis:
        return (*others, *(EffectInstance(name, float(size)) for name, size in zip(names, sizes, strict=True)))

    def left(sizes: Array) -> Array:
        return np.asarray(channel.measured - model.run(parts(sizes), base, ("shaft",))["shaft"])
    if names == SWING:
        starts = sorted(_swings(machine, low, high), key=lambda one: float(np.sum(left(one) ** 2)))[:FITTED_FROM]
    else:
        starts = _starts(names, usual, machine)
    found = [least_squares(left, one, lambda x: _slopes(left, x, NUDGE * usual, high), (low, high), x_scale=usual,
                           max_nfev=MOST_RUNS) for one in starts]
    return parts(min(found, key=lambda one: float(one.cost)).x)


def _slopes(left: Callable[[Array], Array], sizes: Array, steps: Array, high: Array) -> Array:
    """(rows, sizes), by differences away from the upper bound."""
    now, found = left(sizes), []
    for k, step in enumerate(np.where(sizes + steps <= high, steps, -steps).tolist()):
        moved = sizes.copy()
        moved[k] += step
        found.append((left(moved) - now) / step)
    return np.array(found).T


def _starts(names: Sequence[str], usual: Array, machine: Machine) -> list[Array]:
    """Sizes to start from: a zone of either share of the range, a fifth of what is usual of the rest."""
    full = machine.limits.shaft_high_rpm
    return [np.array([share * full if name == SHAFT_DEAD_ZONE.id else STARTS_AT * size
                      for name, size in zip(names, usual, strict=True)])
            for share in (ZONES if SHAFT_DEAD_ZONE.id in names else ZONES[:1])]


def _swings(machine: Machine, low: Array, high: Array) -> list[Array]:
    """Sizes of SWING of every frequency and damping: T = 2 damping / frequency, T2 = 1 / (2 damping frequency)."""
    tau_s = lag_s(machine.shaft)
    return [np.clip([2.0 * damping * tau_s / frequency - tau_s, 0.5 * tau_s / (damping * frequency)],
                    low + 1e-9, high - 1e-9) for frequency in FREQUENCIES for damping in DAMPINGS]
