"""Summarises the information of one log on every effect in a few numbers, so that logs are combined
without reading them again.

For effects that are linear in their size, the log-likelihood of a log near its null model is a
quadratic form: right' x - x' normal x / 2, with x the sizes, after projection of noise, tolerances
and unknown levels (score and information; Cox and Hinkley, Theoretical Statistics, 1974, ch. 9).
Sums of such forms over logs are the joint likelihood, so an effect too weak for any single log
shows in many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.evidence import (
    Column,
    ColumnRole,
    fit_amplitudes_and_noise,
    limit_slow_noise,
)
from topdress.control.diagnosis.judgement.gaussian import Array, ColumnProducts, Indices
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.runs.cost import calc_field_cost
from topdress.control.diagnosis.runs.diagnose import judge_run
from topdress.control.diagnosis.runs.selection import GroupResult
from topdress.control.diagnosis.runs.stages import RunData
from topdress.control.machine.machine import Machine, describe_unit

Columns = Mapping[str, npt.NDArray[Any]]
# Share of a full hopper below which an operator should have refilled.
LOW_HOPPER_SHARE = 0.05
# Minimum speed of a moving machine, m/s.
MIN_MOVING_MPS = 0.3
# Minimum eigenvalue as a share of a form's largest: a smaller eigenvalue has no information.
MIN_EIGENVALUE_SHARE = 1e-9
# Minimum share of a log's variance that is not due to the machine's tolerances.
MIN_VARIANCE_SHARE_BEYOND_TOLERANCES = 1e-3


class QuadraticForm(NamedTuple):
    """Quadratic form of one group of channels. names: effects, with `#k` after those of a member.

    A machine keeps its tolerances: the deviation that a single log counts as noise is the same in
    all logs of the machine.
    """

    names: tuple[str, ...]
    # Information matrix (q, q), per squared unit of the catalogue.
    normal: tuple[tuple[float, ...], ...]
    # Score, (q,).
    right: tuple[float, ...]
    # Nominal values and sensor errors that belong to the machine, (t,).
    open: tuple[str, ...] = ()
    # Change of `right` for one s.d. of each, (q, t).
    pulls: tuple[tuple[float, ...], ...] = ()


class LogWork(NamedTuple):
    """Work of a log: hours, mass, area, and the operator's refills."""

    # Hours of work.
    hours: float
    applied_kg: float
    area_ha: float
    # Minutes of work with the hopper below LOW_HOPPER_SHARE.
    low_minutes: float
    refills: int


class LogEvidence(NamedTuple):
    """Evidence of one log. percent: error of the dose for one unit of an effect, at this log's
    operating points; absent where unknown."""

    found: Diagnosis
    forms: tuple[QuadraticForm, ...]
    percent: dict[str, float]
    units: dict[str, str]
    worked: LogWork


def collect_log_evidence(columns: Columns, machine: Machine, path: str = "") -> LogEvidence:
    """Return a full diagnosis with the quadratic forms. Raises ValueError as `diagnose_run`
    does."""
    run = judge_run(columns, machine, path=path)
    forms = tuple(form for one in run.groups if (form := _make_quadratic_form(one)) is not None)
    percent, units = {}, {}
    for form in forms:
        for k, name in enumerate(form.names):
            effect_id = name.split("#")[0]
            units[name] = describe_unit(effect_id, machine)
            cost = (
                _calc_dose_percent(effect_id, machine, run.data)
                if form.normal[k][k] > 0.0
                else None
            )
            if cost is not None:
                percent[name] = cost
    return LogEvidence(run.found, forms, percent, units, sum_log_work(columns, machine))


def _make_quadratic_form(one: GroupResult) -> QuadraticForm | None:
    """Return the quadratic form of one group near its null model.

    The noise is fitted with every effect free and the found effects included. Noise fitted to the
    residual of an omitted effect would grow with the effect, and the log would count less the more
    information it has.
    """
    columns, model = one.search.columns, one.search.model
    # Nominal values are those of the file; their tolerances are projected out.
    model.set_offsets({})
    straight = [
        c.part
        for c in one.search.candidates
        if EFFECT_ROWS[c.part.id].probe is not None and c.part.onset_s is None
    ]
    parts = {part.id + (f"#{part.member}" if part.member else ""): part for part in straight}
    if not parts:
        return None
    others = [
        part
        for part in one.found.parts
        if part.onset_s is not None or EFFECT_ROWS[part.id].probe is None
    ]
    p, before = columns.compress_hypothesis(
        (), [columns.make_candidate_column((), part) for part in (*parts.values(), *others)]
    )
    noise = fit_amplitudes_and_noise(
        p, np.arange(len(p.labels)), limit_slow_noise(one.found.noise, model.channels)
    ).noise
    every, base = p.weigh_columns(noise), np.arange(before)
    here, sizes = np.arange(before, before + len(parts)), p.fit_sizes(base, noise)
    cross = every.A[here, :before]
    left = every.select_columns(here).project_out(cross, sizes)
    # Readings of the machine, without the log's own level.
    own = [
        k
        for k, column in enumerate(columns.list_fixed_columns())
        if column.label.role is not ColumnRole.READING or "scale" not in column.coefficients
    ]
    pulls = cross @ sizes.cov[:, own] / p.sd[own]
    return QuadraticForm(
        tuple(parts),
        _list_form_rows(left.A),
        tuple(left.s.tolist()),
        _name_tolerances([columns.list_fixed_columns()[k] for k in own]),
        _list_form_rows(pulls),
    )


def _name_tolerances(of: Sequence[Column]) -> tuple[str, ...]:
    """Return a name for each tolerance that is the same in every log of a machine."""
    names: list[str] = []
    for column in of:
        name = (
            f"{column.label.role.name.lower()} {column.label.name or '+'.join(column.coefficients)}"
        )
        names.append(f"{name} {sum(one.startswith(name) for one in names)}")
    return tuple(names)


def _list_form_rows(of: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, of.tolist()))


def _calc_dose_percent(effect_id: str, machine: Machine, data: RunData) -> float | None:
    from topdress.control.diagnosis.runs.hypothesis import EffectInstance

    probe = EFFECT_ROWS[effect_id].scale_to_machine(machine).probe
    assert probe is not None
    # The value is rounded.
    error = calc_field_cost(
        EffectInstance(effect_id, 4.0 * probe), machine, data
    ).rate_error_percent
    return None if error is None else error / (4.0 * probe)


def sum_log_work(columns: Columns, machine: Machine) -> LogWork:
    """Return sums over a log; missing values count as zero."""
    time_s = np.asarray(columns["time_s"], np.float64)
    step_s = np.minimum(np.diff(time_s, append=time_s[-1]), 5.0)

    def known(name: str) -> Array:
        return (
            np.nan_to_num(np.asarray(columns[name], np.float64))
            if name in columns
            else np.zeros(len(time_s))
        )

    state = columns.get("state")
    speed = known("speed_used_mps") if "speed_used_mps" in columns else known("speed_mps")
    applied = known("applied_rate_kg_ha")
    works = (
        state == "working"
        if state is not None and np.any(state != "")
        else known("shaft_rpm") > 2.0
    )
    works = works & (speed > MIN_MOVING_MPS) if np.any(speed) else works
    ground_ha = speed * machine.geometry.working_width_m * step_s * works / 10_000.0
    hopper = columns.get("hopper_kg")
    low = (
        np.asarray(hopper, np.float64) < LOW_HOPPER_SHARE * machine.flow.full_kg
        if hopper is not None
        else np.zeros(len(time_s), bool)
    )
    events = columns.get("events")
    refills = 0 if events is None else sum("refill" in str(text) for text in events[events != ""])
    return LogWork(
        float(np.sum(step_s * works)) / 3600.0,
        float(np.sum(applied * ground_ha)),
        float(np.sum(ground_ha * (applied > 0.0))),
        float(np.sum(step_s * works * low)) / 60.0,
        refills,
    )


class SeasonLog(NamedTuple):
    """A log of the season. time_d: days from any origin, the same for all logs."""

    key: str
    machine: str
    time_d: float
    forms: tuple[QuadraticForm, ...]
    # Level of each factor (product, operator, field); "" where unknown.
    shared: Mapping[str, str] = {}


class StackedLogs(NamedTuple):
    """Logs (n) in the order of machine and time; the last t of q + t columns are tolerances; zeros
    where a log has no information."""

    logs: tuple[SeasonLog, ...]
    # Times in days, (n,).
    times_d: Array
    machines: tuple[str, ...]
    # Indices into machines, (n,).
    machine: Indices
    # Names of the effects, (q,).
    names: tuple[str, ...]
    # Products of shapes (n, q + t, q + t) and (n, q + t).
    every: ColumnProducts

    def find_slice(self, machine: int) -> slice:
        """Return the slice of a machine's logs, which are adjacent."""
        return slice(*np.searchsorted(self.machine, [machine, machine + 1]).tolist())


def stack_logs(logs: Sequence[SeasonLog]) -> StackedLogs:
    """Return the logs of a season as arrays: each a Gaussian likelihood of all sizes, with its
    machine's tolerances separate.

    A log's form states for the sizes x: right' x - x' normal x / 2, with the deviations of the
    machine within its tolerances counted as noise of the log. Over many logs of one machine this is
    no noise: the deviation u, one s.d. each, is the same in all of them. `pulls` gives the change
    of `right` by u. It converts the form to a form of (x, u), from which the season's model
    integrates u once for each machine instead of once for each log.
    """
    every = sorted(logs, key=lambda one: (one.machine, one.time_d, one.key))
    names = sorted({name for log in every for form in log.forms for name in form.names})
    open_ = sorted({name for log in every for form in log.forms for name in form.open})
    place = {name: k for k, name in enumerate(names)}
    at_open = {name: len(names) + k for k, name in enumerate(open_)}
    machines = sorted({log.machine for log in every})
    width = len(names) + len(open_)
    normal, right = np.zeros((len(every), width, width)), np.zeros((len(every), width))
    for j, log in enumerate(every):
        for form in log.forms:
            here = [*(place[name] for name in form.names), *(at_open[name] for name in form.open)]
            part, score = _decompose_form(form)
            normal[np.ix_([j], here, here)] += part
            right[j, here] += score
    number = {name: k for k, name in enumerate(machines)}
    return StackedLogs(
        tuple(every),
        np.array([log.time_d for log in every]),
        tuple(machines),
        np.array([number[log.machine] for log in every], np.int64),
        tuple(names),
        ColumnProducts(normal, right),
    )


def _decompose_form(form: QuadraticForm) -> tuple[Array, Array]:
    """Return normal and right of (x, u): in the directions with information, y = A x + W u + e,
    cov(W u + e) = 1."""
    values, vectors = np.linalg.eigh(np.array(form.normal, np.float64))
    known = values > MIN_EIGENVALUE_SHARE * max(float(values[-1]), 1e-300)
    root = np.sqrt(values[known])
    if not len(root):
        return np.zeros((len(form.names) + len(form.open),) * 2), np.zeros(
            len(form.names) + len(form.open)
        )
    seen = vectors[:, known].T
    pulls = np.array(form.pulls, np.float64).reshape(len(form.names), len(form.open))
    both = np.concatenate([root[:, None] * seen, seen @ pulls / root[:, None]], axis=1)
    own = np.eye(len(root)) - both[:, len(form.names) :] @ both[:, len(form.names) :].T
    shares, axes = np.linalg.eigh(own)
    weighted = (axes / np.maximum(shares, MIN_VARIANCE_SHARE_BEYOND_TOLERANCES)) @ axes.T @ both
    return both.T @ weighted, weighted.T @ (seen @ np.array(form.right) / root)


def add_scatter(every: ColumnProducts, variance: Array) -> ColumnProducts:
    """Return the logs' products (n, w, w) and (n, w) when each size also scatters by `variance` (n,
    w) from log to log."""
    here = np.flatnonzero(np.any(variance > 0.0, axis=0))
    return every.project_out(
        every.A[:, :, here], every.select_columns(here).fit(np.sqrt(variance[:, here]))
    )
