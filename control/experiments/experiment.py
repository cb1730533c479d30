"""Which experiments separate rival hypotheses soonest?

A measurement separates two hypotheses by d standard deviations. It decides between them where d
is large enough for the evidence to reach the odds from which a cause is named
(`judgement.prior.SEPARATION_SD`). First those are taken that settle most pairs of rivals a minute,
the greedy rule of set cover (Chvatal, Mathematics of Operations Research 4, 1979); of equal
ones, that which separates them furthest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from topdress.control.machine.machine import Machine

Array = npt.NDArray[np.float64]
Readings = TypeVar("Readings")


class Experiment(NamedTuple, Generic[Readings]):
    """Describes an experiment that a farm can make.

    plan : one sentence for people. steps : actions in their order. reads : predicts the reading
        under a machine; of a bench test (k,), in units of its own noise, of a manoeuvre the
        columns of its log, without noise."""

    id: str
    plan: str
    minutes: float
    steps: tuple[str, ...]
    predict: Callable[[Machine], Readings]


class ChosenExperiments(NamedTuple):
    """Holds the chosen experiments, which pairs (pairs,) they settle, and the least separation
    of a settled pair, standard deviations; None: no test settles any."""

    tests: tuple[int, ...]
    # Whether each pair is settled, (pairs,).
    settled: npt.NDArray[np.bool_]
    # Smallest separation of a settled pair by the tests, s.d.; None where no test settles any.
    apart_sd: float | None


def choose_experiments(
    apart_sd: Array, minutes: Sequence[float], least_sd: float, most: int
) -> ChosenExperiments:
    """Chooses at most `most` experiments, those that settle most pairs a minute.

    Parameters
    ----------
    apart_sd : (pairs, experiments) separation of each pair by each experiment, standard
        deviations.
    minutes : duration of each experiment.
    least_sd : separation that settles a pair.
    most : greatest number of experiments."""
    picked: list[int] = []
    settles = apart_sd >= least_sd
    waiting = np.ones(len(apart_sd), bool)
    while waiting.any() and len(picked) < most:
        worth = [
            (float(np.sum(settles[waiting, k])) / minutes[k], float(np.max(apart_sd[waiting, k])))
            for k in range(len(minutes))
        ]
        # Of equal ones the first is taken.
        best = max(range(len(worth)), key=worth.__getitem__)
        if worth[best][0] <= 0.0:
            break
        picked.append(best)
        waiting &= ~settles[:, best]
    clear = [
        float(np.max(row[picked]))
        for row, still in zip(apart_sd, waiting, strict=True)
        if not still
    ]
    return ChosenExperiments(tuple(picked), ~waiting, min(clear, default=None))


def join_list(values: Sequence[float]) -> str:
    """Joins numbers to a text: `10, 40 and 70`."""
    return f"{', '.join(f'{value:g}' for value in values[:-1])} and {values[-1]:g}"
