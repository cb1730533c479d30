"""Effects that make one curve, or one answer to a step, together: started together.

What a drive's zone takes away, a gain that is off gives back over most of the range, and a
curve that bends takes it away again at the top: each of them alone fits little, and the best of
three one after the other is not the best three. Nor is the best of a swing's frequency and
damping one after the other. The curves are those of the plain rival (`prediction/rival.py`), by
least squares over all rows alike; the judgement then refits them, and holds the result against
what it found one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from topdress.control.diagnosis.effects import (
    SHAFT_BACK_GAIN,
    SHAFT_BACK_ZONE,
    SHAFT_DEAD_TIME,
    SHAFT_DEAD_ZONE,
    SHAFT_GAIN,
    SHAFT_NEUTRAL,
    SHAFT_SATURATION,
    SHAFT_SECOND_ORDER,
    SHAFT_SLOW,
    find_size_range,
)
from topdress.control.machine.shaft import calc_time_constant_s

from .hypothesis import EffectInstance, Hypothesis
from .search import Search

# one answer to a step: its frequency and its damping
SWING = (SHAFT_SLOW.id, SHAFT_SECOND_ORDER.id)
FAMILY = frozenset(
    {
        *SWING,
        *(
            one.id
            for one in (
                SHAFT_GAIN,
                SHAFT_DEAD_ZONE,
                SHAFT_SATURATION,
                SHAFT_NEUTRAL,
                SHAFT_BACK_GAIN,
                SHAFT_BACK_ZONE,
                SHAFT_DEAD_TIME,
            )
        ),
    }
)
# A swing of another frequency is out of step after some 1 / (2 pi damping) periods: a fit gets
# no further than to a quarter of the way there, so that every frequency is looked at first, and
# the best of them are fitted. natural, in 1 / the machine file's time constant
FREQUENCIES = np.geomspace(0.1, 10.0, 16)
# ratios: rings long, overshoots, hardly, two time constants
DAMPINGS = (0.1, 0.3, 0.8, 2.0)
FITTED_FROM = 2  # best of these


def list_multi_effect_hypotheses(
    search: Search, now: Hypothesis, proposed: Sequence[EffectInstance]
) -> Iterator[Hypothesis]:
    """Hypotheses with several effects at once, in place of whatever of the same curve a
    hypothesis holds.

    proposed : what may be added: where a second order is among it or there, frequency and
    damping are started at once.
    """
    model = search.model
    if "shaft" not in model.names:
        return
    tried = {c.part.id for c in search.candidates if c.part.onset_s is None}
    names = {part.id for part in now}
    swings = any(
        part.id == SHAFT_SECOND_ORDER.id and part.onset_s is None for part in (*now, *proposed)
    )
    if swings and set(SWING) <= tried and not set(SWING) <= names:
        yield from _list_swing_starts(
            search, tuple(part for part in now if part.id not in (*SWING, SHAFT_DEAD_TIME.id))
        )
    if now and not model.channel("shaft").settled:
        # in a log of moves a curve's parts are also seen one by one: once will do
        return
    others = tuple(part for part in now if part.id not in FAMILY or part.onset_s is not None)
    tried -= {part.id for part in others}
    for curve in search.curves():
        parts = tuple(part for part in curve if part.id in tried)
        if not {part.id for part in parts} <= names:
            yield (*others, *parts)


def _list_swing_starts(search: Search, others: Hypothesis) -> list[Hypothesis]:
    """The best of every frequency and damping: T = 2 damping / frequency, T2 = 1 / (2 damping
    frequency)."""
    model, tau_s = search.model, calc_time_constant_s(search.model.machine.shaft)
    measured, (low, high) = (
        model.channel("shaft").measured,
        np.array([find_size_range(one, model.machine) for one in SWING]).T,
    )
    found = []
    for frequency, damping in product(FREQUENCIES, DAMPINGS):
        sizes = np.clip(
            [2.0 * damping * tau_s / frequency - tau_s, 0.5 * tau_s / (damping * frequency)],
            low,
            high,
        )
        parts = (
            *others,
            *(EffectInstance(name, size) for name, size in zip(SWING, sizes.tolist(), strict=True)),
        )
        found.append(
            (float(np.sum((measured - model.run(parts, only=("shaft",))["shaft"]) ** 2)), parts)
        )
    return [parts for _, parts in sorted(found, key=lambda one: one[0])[:FITTED_FROM]]
