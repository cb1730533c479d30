"""What one log says of every effect, in a few numbers: enough to add logs up without opening them again.

For the effects that are a straight line in their size, the log-likelihood of a log near its null is a quadratic form:
right' x - x' normal x / 2, with x the sizes, once noise, tolerances and unknown levels are projected out (score and
information; Cox and Hinkley, Theoretical Statistics, 1974, ch. 9). Sums over logs of such forms are the joint
likelihood, so that an effect too weak for any one log shows in many.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.diagnosis.judgement.evidence import Column, Role, calm, fitted
from control.diagnosis.result import Diagnosis
from control.diagnosis.runs.cost import field_cost
from control.diagnosis.runs.diagnose import judged_run
from control.diagnosis.runs.selection import GroupResult
from control.diagnosis.runs.stages import RunData
from control.machine.machine import Machine, unit_of

Array = npt.NDArray[np.float64]
Columns = Mapping[str, npt.NDArray[Any]]

LOW_SHARE = 0.05            # of a full hopper: below it an operator should have filled up
MOVING_MPS = 0.3


class QuadraticForm(NamedTuple):
    """The quadratic form of one group of channels. names: effects, with `#k` behind those of a member.

    A machine keeps its tolerances: what one log counts as noise of its own is the same in all logs of the machine.
    """

    names: tuple[str, ...]
    normal: tuple[tuple[float, ...], ...]       # (q, q), per unit of the catalogue squared
    right: tuple[float, ...]                    # (q,)
    open: tuple[str, ...] = ()                  # (t,) nominal values and sensors' own errors that are the machine's
    pulls: tuple[tuple[float, ...], ...] = ()   # (q, t): how far one s.d. of each moves `right`


class LogWork(NamedTuple):
    """What was done in a log, and how."""

    hours: float                # of work
    applied_kg: float
    area_ha: float
    low_minutes: float          # of work with the hopper below LOW_SHARE
    refills: int


class LogEvidence(NamedTuple):
    """percent: error of the dose for one unit of an effect, at this log's operating points; absent: not known."""

    found: Diagnosis
    forms: tuple[QuadraticForm, ...]
    percent: dict[str, float]
    units: dict[str, str]
    worked: LogWork


def evidence(columns: Columns, machine: Machine, path: str = "") -> LogEvidence:
    """A full diagnosis, and the forms along with it. Raises ValueError as `diagnose_run` does."""
    run = judged_run(columns, machine, path=path)
    forms = tuple(form for one in run.groups if (form := _form(one)) is not None)
    percent, units = {}, {}
    for form in forms:
        for k, name in enumerate(form.names):
            effect_id = name.split("#")[0]
            units[name] = unit_of(effect_id, machine)
            cost = _percent(effect_id, machine, run.data) if form.normal[k][k] > 0.0 else None
            if cost is not None:
                percent[name] = cost
    return LogEvidence(run.found, forms, percent, units, worked(columns, machine))


def _form(one: GroupResult) -> QuadraticForm | None:
    """Of one group, near nothing wrong.

    The noise is fitted with every effect free and what was found in place: noise fitted to what an effect has left
    grows with the effect, and a log would count for the less the more it has to tell.
    """
    columns, model = one.search.columns, one.search.model
    model.move({})              # nominal values as the file has them: what they may be off is projected out
    straight = [c.part for c in one.search.candidates if ROWS[c.part.id].probe is not None and c.part.onset_s is None]
    parts = {part.id + (f"#{part.member}" if part.member else ""): part for part in straight}
    if not parts:
        return None
    others = [part for part in one.found.parts if part.onset_s is not None or ROWS[part.id].probe is None]
    p, before = columns.compressed((), [columns.of_candidate((), part) for part in (*parts.values(), *others)])
    noise = fitted(p, np.arange(len(p.labels)), calm(one.found.noise, model.channels)).noise
    every, base = p.under(noise), np.arange(before)
    here, sizes = np.arange(before, before + len(parts)), p.sizes(base, noise)
    cross = every.A[here, :before]
    left = every.of(here).beyond(cross, sizes)
    own = [k for k, column in enumerate(columns.fixed())        # the machine's, not the log's own level
           if column.label.role is not Role.READING or "scale" not in column.coefficients]
    pulls = cross @ sizes.cov[:, own] / p.sd[own]
    return QuadraticForm(tuple(parts), _rows(left.A), tuple(left.s.tolist()),
                         _named([columns.fixed()[k] for k in own]), _rows(pulls))


def _named(of: Sequence[Column]) -> tuple[str, ...]:
    """A name for each that is the same in every log of a machine."""
    names: list[str] = []
    for column in of:
        name = f"{column.label.role.name.lower()} {column.label.name or '+'.join(column.coefficients)}"
        names.append(f"{name} {sum(one.startswith(name) for one in names)}")
    return tuple(names)


def _rows(of: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, of.tolist()))


def _percent(effect_id: str, machine: Machine, data: RunData) -> float | None:
    from control.diagnosis.runs.hypothesis import EffectInstance
    probe = ROWS[effect_id].on(machine).probe
    assert probe is not None
    error = field_cost(EffectInstance(effect_id, 4.0 * probe), machine, data).rate_error_percent      # it is rounded
    return None if error is None else error / (4.0 * probe)


def worked(columns: Columns, machine: Machine) -> LogWork:
    """Sums over a log; what it does not tell counts as nothing."""
    time_s = np.asarray(columns["time_s"], np.float64)
    step_s = np.minimum(np.diff(time_s, append=time_s[-1]), 5.0)

    def known(name: str) -> Array:
        return np.nan_to_num(np.asarray(columns[name], np.float64)) if name in columns else np.zeros(len(time_s))
    state = columns.get("state")
    speed = known("speed_used_mps") if "speed_used_mps" in columns else known("speed_mps")
    applied = known("applied_rate_kg_ha")
    works = state == "working" if state is not None and np.any(state != "") else known("shaft_rpm") > 2.0
    works = works & (speed > MOVING_MPS) if np.any(speed) else works
    ground_ha = speed * machine.geometry.working_width_m * step_s * works / 10_000.0
    hopper = columns.get("hopper_kg")
    low = np.asarray(hopper, np.float64) < LOW_SHARE * machine.flow.full_kg if hopper is not None else \
        np.zeros(len(time_s), bool)
    events = columns.get("events")
    refills = 0 if events is None else sum("refill" in str(text) for text in events[events != ""])
    return LogWork(float(np.sum(step_s * works)) / 3600.0, float(np.sum(applied * ground_ha)),
                   float(np.sum(ground_ha * (applied > 0.0))), float(np.sum(step_s * works * low)) / 60.0, refills)
