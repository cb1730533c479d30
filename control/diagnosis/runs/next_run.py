"""Which cheap run would tell rivals apart: each manoeuvre is played through the model with each rival, and compared."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from control.diagnosis.effects import ROWS
from control.diagnosis.judgement.evidence import projected
from control.diagnosis.judgement.prior import APART_SD
from control.diagnosis.result import Cause, NextRun
from control.experiments.experiment import Experiment, chosen
from control.experiments.manoeuvres import Columns, manoeuvres
from control.machine.machine import CATALOGUE, Machine

from .channels import channels
from .hypothesis import EffectInstance
from .log import gate
from .model import GROUPS
from .search import Search
from .stages import run_data


def next_run(causes: Sequence[Cause], machine: Machine) -> NextRun | None:
    """The shortest manoeuvre that separates the worst pair of rivals; the effect's own experiment where none does."""
    doubtful = [c for c in causes if c.rivals]
    if not doubtful:
        return None
    cause = max(doubtful, key=lambda c: c.rivals[0].probability)
    rival = cause.rivals[0].id
    value = cause.size.value or ROWS[cause.id].probe or 1.0
    every = manoeuvres(machine)
    apart = np.array([[separation(one, machine, EffectInstance(cause.id, value, None, cause.member), rival)
                       for one in every]])
    best = chosen(apart, [one.minutes for one in every], APART_SD, 1).tests
    why = f"this data cannot tell {cause.id} from {', '.join(r.id for r in cause.rivals)}"
    if not best:
        return NextRun(why, CATALOGUE[cause.id].effect.separate)
    run = every[best[0]]
    return NextRun(why, run.plan, run.id, run.minutes, run.steps)


def separation(manoeuvre: Experiment[Columns], machine: Machine, part: EffectInstance, rival_id: str) -> float:
    """What is left of an effect's trace, in standard deviations, once its rival is fitted to the manoeuvre's log."""
    log = gate(manoeuvre.reads(machine))
    data = run_data(log, machine)
    seen = channels(data, machine)
    names = next(names for names in GROUPS.values() if ROWS[part.id].channels[0] in names)
    members = [seen[n] for n in names if n in seen]
    if not members:
        return 0.0
    search = Search(members, machine, data)
    wanted = [c for c in search.candidates if c.part.id in (part.id, rival_id)]
    if {c.part.id for c in wanted} != {part.id, rival_id}:
        return 0.0
    own = min((c for c in wanted if c.part.id == part.id), key=lambda c: abs(c.part.size - part.size))
    other = next(c for c in wanted if c.part.id == rival_id)
    p, before = search.columns.compressed((), [search.columns.of_candidate((), c.part) for c in (other, own)])
    left = projected(p, np.arange(before + 1), search.model.noise).A[-1, -1]
    return float(abs(part.size) * np.sqrt(max(0.0, left)))
