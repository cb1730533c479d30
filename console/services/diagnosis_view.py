"""A diagnosis as the Diagnosis page has it: along with curves, errors after the causes, and
what may be adopted."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from topdress.console.app.pages.diagnosis.service import DiagnosisView, Drawn, ResidualCurve
from topdress.console.reports.binned import Array, Axis, Binned
from topdress.console.reports.diagnosis_wording import headlines_first, sort_adoptable
from topdress.console.reports.run_views import View, find_view, parts_of, run_views
from topdress.console.reports.table_views import MeasuredColumn, table_views
from topdress.console.services.separating_run import is_drivable
from topdress.control.diagnosis.result import Cause, Diagnosis
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.machine.machine import CATALOGUE, Machine

# as wide as a terminal draws them; a rate needs longer
TIME_BINS, RATE_BINS = 40, 16


def found_of(
    found: Diagnosis,
    tools: Mapping[str, Any],
    name: str,
    mean_target_kg_ha: float | None,
    planted: tuple[str, ...] = (),
) -> DiagnosisView:
    """`tools`: as for the report, {"columns", "machine"} or {"tables", "machine"}."""
    found = dataclasses.replace(headlines_first(found), seen_with=None)
    machine: Machine = tools["machine"]
    views: tuple[View, ...] = run_views(tools["columns"], machine) if "columns" in tools else ()
    tables = table_views(tools["tables"], machine, found.causes) if "tables" in tools else ()
    parts = parts_of(found.causes)
    after = {view.name: _rms(view.residual(parts)) for view in views if view.segments is None}
    after |= {table.channel: _rms(table.after) for table in tables}
    kept, refused = sort_adoptable(found)
    run = found.next_run
    return DiagnosisView(
        name,
        found,
        tuple(_curves(cause, views, tables, parts) for cause in found.causes),
        after if found.causes else {},
        kept,
        refused,
        run.id if run is not None and is_drivable(run.id) else "",
        _left_curve(found, views, parts),
        mean_target_kg_ha,
        planted=planted,
    )


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean((known - known.mean()) ** 2))) if len(known) else 0.0


def _curves(
    cause: Cause,
    views: Sequence[View],
    tables: Sequence[MeasuredColumn],
    parts: tuple[EffectInstance, ...],
) -> Drawn:
    own = parts_of([cause])
    if not own:
        return Drawn()
    if tables:
        return Drawn(_of_table(cause, tables))
    shown = find_view(views, parts, own[0])
    if shown is None:
        return Drawn()
    view, effect = shown
    onset = None if own[0].onset_s is None else own[0].onset_s / 60.0
    return Drawn(_curve(view, view.axis_of(own[0], effect), parts), _over_time(view, parts, onset))


def _left_curve(
    found: Diagnosis, views: Sequence[View], parts: tuple[EffectInstance, ...]
) -> ResidualCurve | None:
    if not found.unexplained:
        return None
    left = found.unexplained[0]
    view = next((v for v in views if v.name == left.channel and left.variable in v.axes), None)
    return None if view is None else _curve(view, view.axes[left.variable], parts)


def _curve(view: View, axis: Axis, parts: tuple[EffectInstance, ...]) -> ResidualCurve | None:
    before, after = view.residual(()), view.residual(parts)
    memory = view.memory(after)
    return _drawn(
        view,
        axis.variable,
        view.means(axis, before, memory),
        view.means(axis, after, memory),
        axis.names,
    )


def _over_time(
    view: View, parts: tuple[EffectInstance, ...], onset_min: float | None
) -> ResidualCurve | None:
    """Means over even bins of the log's time, in minutes; of one head alone where the heads
    differ."""
    cell, middle = view.even_bins(
        view.time_s / 60.0, TIME_BINS if view.segments is None else RATE_BINS
    )
    before, after = view.residual(()), view.residual(parts)
    memory = view.memory(after)
    curve = _drawn(
        view,
        "time_s",
        view.means(cell, before, memory),
        view.means(cell, after, memory),
        (),
        onset_min,
    )
    if curve is None:
        return None
    return curve._replace(at=tuple(round(float(middle[round(place)]), 3) for place in curve.at))


def _drawn(
    view: View,
    variable: str,
    before: Binned,
    after: Binned,
    names: tuple[str, ...],
    onset: float | None = None,
) -> ResidualCurve | None:
    """Both at the same places: those that both have."""
    mine = {round(float(x), 9): float(y) for x, y in zip(before.at, before.mean, strict=True)}
    rows = [
        (float(x), mine[round(float(x), 9)], float(y), float(h))
        for x, y, h in zip(after.at, after.mean, after.half, strict=True)
        if round(float(x), 9) in mine
    ]
    rows = [row for row in rows if all(math.isfinite(value) for value in row)]
    if len(rows) < 2:
        return None
    at, old, new, half = zip(*sorted(rows), strict=True)
    return ResidualCurve(view.name, view.unit, variable, at, old, new, half, names, onset)


def _of_table(cause: Cause, tables: Sequence[MeasuredColumn]) -> ResidualCurve | None:
    """A bench table's misses along its main variable: means at each value, the spread of a mean
    as half."""
    stage = CATALOGUE[cause.id].stage
    usable = [table for table in tables if table.main and np.any(table.extended != table.nominal)]
    usable.sort(key=lambda table: table.channel != stage)
    if not usable:
        return None
    table = usable[0]
    variable = np.asarray(table.variables[table.main], np.float64)
    kinds, index = np.unique(variable, return_inverse=True)
    if len(kinds) < 2:
        return None

    def means(values: Array) -> Array:
        return np.asarray(np.bincount(index, values) / np.bincount(index))

    after = means(table.after)
    spread = np.sqrt(np.bincount(index, (table.after - after[index]) ** 2)) / np.bincount(index)
    return ResidualCurve(
        table.channel,
        table.unit,
        table.main,
        tuple(kinds.tolist()),
        tuple(means(table.before).tolist()),
        tuple(after.tolist()),
        tuple((1.645 * spread).tolist()),
    )


def mean_target(columns: Mapping[str, Any]) -> float | None:
    """Mean of the wanted rate while it was above zero, kg/ha; None where the log has none."""
    wanted = columns.get("target_rate_kg_ha")
    if wanted is None:
        return None
    wanted = np.asarray(wanted, np.float64)
    wanted = wanted[np.isfinite(wanted) & (wanted > 0.0)]
    return float(wanted.mean()) if len(wanted) else None
