"""The smallest size of each effect that these rows would have shown."""
from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from control.diagnosis.result import Detectable, NotShown
from control.machine.machine import CATALOGUE

from .algebra import orthonormal, without
from .problem import Problem
from .selection import LEVEL, Named

POWER = 0.9             # of showing an effect of the size given
CLOCK = "lag.coarse_clock"


def not_shown(problem: Problem, named: Named, told: frozenset[str],
              smallest_clock_s: float | None) -> tuple[NotShown, ...]:
    """Every catalogued effect that is neither named nor a rival (`told`). None: these rows cannot show it at all."""
    space = named.space
    index = [problem.choices.index(part.choice) for part in named.parts]
    basis = orthonormal(np.column_stack([space.basis, space.x[:, index]]))
    dof = max(1.0, named.dof)
    wanted = float(student.ppf(1.0 - LEVEL / 2.0 / max(1, len(problem.choices)), dof) + student.ppf(POWER, dof))
    sd = np.sqrt(named.subset.variance) * named.widened_by
    smallest: dict[str, float] = {}
    for k, choice in enumerate(problem.choices):
        if choice.scope is not None:
            continue
        left = float(np.linalg.norm(without(basis, space.x[:, [k]])))
        entry = CATALOGUE[choice.id]
        size = float(wanted * sd / left) if left > 1e-9 else np.inf
        if size < max(abs(entry.high - entry.neutral), abs(entry.low - entry.neutral)):
            smallest[choice.id] = max(size, smallest.get(choice.id, 0.0))
    if smallest_clock_s is not None:
        smallest[CLOCK] = smallest_clock_s
    return tuple(NotShown(effect_id, Detectable(smallest.get(effect_id), entry.effect.unit))
                 for effect_id, entry in CATALOGUE.items() if effect_id not in told)
