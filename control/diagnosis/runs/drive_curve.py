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
    SHAFT_STICTION,
    find_size_range,
)
from topdress.control.machine.shaft import calc_time_constant_s

from .hypothesis import EffectInstance, Hypothesis
from .search import Search, find_command_range

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
# Trial stick bands, as shares of the range of the commands.
TRIAL_STICKS = np.linspace(0.05, 0.95, 19)


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
    if SHAFT_STICTION.id in tried - names:
        yield from _list_stiction_starts(
            search,
            tuple(part for part in now if part.id not in (SHAFT_SLOW.id, SHAFT_DEAD_TIME.id)),
            SHAFT_SLOW.id in tried,
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


def _list_stiction_starts(search: Search, others: Hypothesis, lags: bool) -> list[Hypothesis]:
    """Return the best starts of a drive that sticks and, of a drive alone, answers slowly.

    A jump is seen where the lag after it is known, and the lag where the jump is known. The
    criterion is that of noise that drifts: squares of the residual's differences.
    """
    model, row = search.model, SHAFT_SLOW.scale_to_machine(search.model.machine)
    part = EffectInstance(SHAFT_STICTION.id, 0.0)
    times_s = (0.0, *row.trial_sizes) if lags and row.longer else (0.0,)
    sticks = find_command_range(part, model.data) * TRIAL_STICKS
    measured = model.find_channel("shaft").measured
    found = []
    for stick, time_s in product((0.0, *sticks.tolist()), times_s):
        lag = (EffectInstance(SHAFT_SLOW.id, time_s),) if time_s > 0.0 else ()
        parts = (*others, *lag, *((part._replace(size=stick),) if stick > 0.0 else ()))
        left = measured - model.run_model(parts, only=("shaft",))["shaft"]
        found.append((float(np.sum(np.diff(left) ** 2)), stick, parts))
    free = min(square for square, stick, _ in found if stick == 0.0)
    best = sorted((one for one in found if one[1] > 0.0), key=lambda one: one[0])
    return [parts for square, _, parts in best[:FITTED_START_COUNT] if square < free]
