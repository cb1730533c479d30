"""Starts hypotheses of several effects that together form one drive curve or one step response.

A gain error compensates a dead zone over most of the range, and a saturation removes the excess at
the top. Each effect alone fits little, and a greedy selection of three does not find the best
three. Frequency and damping of an oscillation must be started together as well. The curves are
those of the plain rival (`prediction/plain_rival.py`), fitted by least squares over all rows. The
judgement then refits the curves and compares the result with its own stepwise result.
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

# Frequency and damping of one step response.
SECOND_ORDER_IDS = (SHAFT_SLOW.id, SHAFT_SECOND_ORDER.id)
CURVE_EFFECT_IDS = frozenset(
    {
        *SECOND_ORDER_IDS,
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
# Trial natural frequencies, in 1 / the machine file's time constant. An oscillation of another
# frequency loses phase after some 1 / (2 pi damping) periods, so a local fit converges only from
# within a quarter of that. Every frequency is evaluated first, and the best are fitted.
TRIAL_FREQUENCIES = np.geomspace(0.1, 10.0, 16)
# Trial damping ratios: long oscillation, overshoot, slight overshoot, two time constants.
TRIAL_DAMPINGS = (0.1, 0.3, 0.8, 2.0)
# Number of best starts that are fitted.
FITTED_START_COUNT = 2


def list_multi_effect_hypotheses(
    search: Search, now: Hypothesis, proposed: Sequence[EffectInstance]
) -> Iterator[Hypothesis]:
    """Yield hypotheses with several effects at once, which replace all effects of the same curve in
    a hypothesis.

    proposed : the effects that may be added. Where these or the hypothesis contain a second order,
    frequency and damping are started together.
    """
    model = search.model
    if "shaft" not in model.names:
        return
    tried = {c.part.id for c in search.candidates if c.part.onset_s is None}
    names = {part.id for part in now}
    swings = any(
        part.id == SHAFT_SECOND_ORDER.id and part.onset_s is None for part in (*now, *proposed)
    )
    if swings and set(SECOND_ORDER_IDS) <= tried and not set(SECOND_ORDER_IDS) <= names:
        yield from _list_second_order_starts(
            search,
            tuple(part for part in now if part.id not in (*SECOND_ORDER_IDS, SHAFT_DEAD_TIME.id)),
        )
    if now and not model.find_channel("shaft").settled:
        # A log of moves shows the effects of a curve separately as well, so a single joint start is
        # enough.
        return
    others = tuple(
        part for part in now if part.id not in CURVE_EFFECT_IDS or part.onset_s is not None
    )
    tried -= {part.id for part in others}
    for curve in search.curves():
        parts = tuple(part for part in curve if part.id in tried)
        if not {part.id for part in parts} <= names:
            yield (*others, *parts)


def _list_second_order_starts(search: Search, others: Hypothesis) -> list[Hypothesis]:
    """Return the best starts over all frequencies and dampings: T = 2 damping / frequency, T2 = 1 /
    (2 damping frequency)."""
    model, tau_s = search.model, calc_time_constant_s(search.model.machine.shaft)
    measured, (low, high) = (
        model.find_channel("shaft").measured,
        np.array([find_size_range(one, model.machine) for one in SECOND_ORDER_IDS]).T,
    )
    found = []
    for frequency, damping in product(TRIAL_FREQUENCIES, TRIAL_DAMPINGS):
        sizes = np.clip(
            [2.0 * damping * tau_s / frequency - tau_s, 0.5 * tau_s / (damping * frequency)],
            low,
            high,
        )
        parts = (
            *others,
            *(
                EffectInstance(name, size)
                for name, size in zip(SECOND_ORDER_IDS, sizes.tolist(), strict=True)
            ),
        )
        found.append(
            (
                float(np.sum((measured - model.run_model(parts, only=("shaft",))["shaft"]) ** 2)),
                parts,
            )
        )
    return [parts for _, parts in sorted(found, key=lambda one: one[0])[:FITTED_START_COUNT]]
