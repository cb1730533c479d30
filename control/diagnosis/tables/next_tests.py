"""Which bench tests would tell rivals apart: each is read off the machine with each rival, and compared."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from control.diagnosis.judgement.prior import APART_SD
from control.experiments.bench_tests import bench_tests
from control.experiments.experiment import Experiment, chosen
from control.machine.machine import Machine

from .piece import Array, SizedEffect, with_effects

MAX_TESTS = 3               # an afternoon's work

Pair = tuple[SizedEffect, SizedEffect]


class NextTests(NamedTuple):
    """`pairs`: what this data cannot tell apart. `unsettled`: those of them that no test of the plan separates."""

    tests: tuple[Experiment[Array], ...]
    pairs: tuple[Pair, ...]
    unsettled: tuple[Pair, ...]
    apart_sd: float | None          # the least that the tests set a settled pair apart; None: no test does


def separating(machine: Machine, rivals: Sequence[Sequence[SizedEffect]]) -> NextTests | None:
    """The tests that tell the rivals of each cause apart, chosen by what each would read under each of them.

    `rivals`: for each ambiguous cause, its members at their fitted sizes. None where there is nothing to separate.
    """
    pairs = tuple((a, b) for members in rivals for i, a in enumerate(members) for b in members[i + 1:])
    if not pairs:
        return None
    every = bench_tests(machine)
    readings = {effect: [one.reads(with_effects(machine, (effect,))) for one in every]
                for pair in pairs for effect in pair}
    apart = np.array([[float(np.linalg.norm(readings[a][k] - readings[b][k])) for k in range(len(every))]
                      for a, b in pairs])
    found = chosen(apart, [one.minutes for one in every], APART_SD, MAX_TESTS)
    return NextTests(tuple(every[k] for k in found.tests), pairs,
                     tuple(pair for pair, settled in zip(pairs, found.settled, strict=True) if not settled),
                     found.apart_sd)
