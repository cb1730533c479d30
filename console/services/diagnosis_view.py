"""How is a diagnosis prepared for the Diagnosis page? The view has curves, errors with the causes
applied, and effects that may be adopted.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from topdress.console.app.pages.diagnosis.service import CauseCurves, DiagnosisView, ResidualCurve
from topdress.console.reports.binned_means import Array, BinnedMeans, ResidualAxis
from topdress.console.reports.diagnosis_wording import sort_adoptable, sort_headlines
from topdress.console.reports.run_views import (
    ChannelView,
    find_view,
    list_effect_instances,
    make_run_views,
)
from topdress.console.reports.table_views import MeasuredColumn, make_table_views
from topdress.console.services.separating_run import is_drivable
from topdress.control.diagnosis.result import Cause, Diagnosis
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.machine.machine import CATALOGUE, Machine

# Numbers of bins: 40 are as wide as a terminal draws curves; a rate needs longer bins.
TIME_BINS, RATE_BINS = 40, 16


def make_diagnosis_view(
    found: Diagnosis,
    tools: Mapping[str, Any],
    name: str,
    mean_target_kg_ha: float | None,
    planted: tuple[str, ...] = (),
) -> DiagnosisView:
    """Returns the diagnosis as the page shows it.

    `tools` are those of the report: {"columns", "machine"} or {"tables", "machine"}.
    """
    # The rows of the log stay out of the view, because the view is sent as JSON to another process.
    found = dataclasses.replace(sort_headlines(found), seen_with=None)
    machine: Machine = tools["machine"]
    views: tuple[ChannelView, ...] = (
        make_run_views(tools["columns"], machine) if "columns" in tools else ()
    )
    tables = make_table_views(tools["tables"], machine, found.causes) if "tables" in tools else ()
    parts = list_effect_instances(found.causes)
    after = {
        view.name: _calc_rms(view.calc_residual(parts)) for view in views if view.segments is None
    }
    after |= {table.channel: _calc_rms(table.after) for table in tables}
    kept, refused = sort_adoptable(found)
    run = found.next_run
    return DiagnosisView(
        name,
        found,
        tuple(_find_cause_curves(cause, views, tables, parts) for cause in found.causes),
        after if found.causes else {},
        kept,
        refused,
        # The page offers to drive only those runs that the simulated machine can drive.
        run.id if run is not None and is_drivable(run.id) else "",
        _find_unexplained_curve(found, views, parts),
        mean_target_kg_ha,
        planted=planted,
    )


def _calc_rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    # The mean is removed: a constant offset is reported as bias.
    return float(np.sqrt(np.mean((known - known.mean()) ** 2))) if len(known) else 0.0


def _find_cause_curves(
    cause: Cause,
    views: Sequence[ChannelView],
    tables: Sequence[MeasuredColumn],
    parts: tuple[EffectInstance, ...],
) -> CauseCurves:
    own = list_effect_instances([cause])
    if not own:
        return CauseCurves()
    # A bench table has no course over time.
    if tables:
        return CauseCurves(_make_table_curve(cause, tables))
    shown = find_view(views, parts, own[0])
    if shown is None:
        return CauseCurves()
    view, effect = shown
    # The curves of time are in minutes.
    onset = None if own[0].onset_s is None else own[0].onset_s / 60.0
    return CauseCurves(
        _make_axis_curve(view, view.find_effect_axis(own[0], effect), parts),
        _make_time_curve(view, parts, onset),
    )


def _find_unexplained_curve(
    found: Diagnosis, views: Sequence[ChannelView], parts: tuple[EffectInstance, ...]
) -> ResidualCurve | None:
    if not found.unexplained:
        return None
    left = found.unexplained[0]
    view = next((v for v in views if v.name == left.channel and left.variable in v.axes), None)
    return None if view is None else _make_axis_curve(view, view.axes[left.variable], parts)


def _make_axis_curve(
    view: ChannelView, axis: ResidualAxis, parts: tuple[EffectInstance, ...]
) -> ResidualCurve | None:
    before, after = view.calc_residual(()), view.calc_residual(parts)
    memory = view.calc_noise_memory(after)
    return _make_residual_curve(
        view,
        axis.variable,
        view.calc_axis_means(axis, before, memory),
        view.calc_axis_means(axis, after, memory),
        axis.names,
    )


def _make_time_curve(
    view: ChannelView, parts: tuple[EffectInstance, ...], onset_min: float | None
) -> ResidualCurve | None:
    """Returns means over equal bins of the log's time, in minutes; of one head alone where the
    heads differ."""
    cell, middle = view.make_even_bins(
        view.time_s / 60.0, TIME_BINS if view.segments is None else RATE_BINS
    )
    before, after = view.calc_residual(()), view.calc_residual(parts)
    memory = view.calc_noise_memory(after)
    curve = _make_residual_curve(
        view,
        "time_s",
        view.calc_axis_means(cell, before, memory),
        view.calc_axis_means(cell, after, memory),
        (),
        onset_min,
    )
    if curve is None:
        return None
    return curve._replace(at=tuple(round(float(middle[round(place)]), 3) for place in curve.at))


def _make_residual_curve(
    view: ChannelView,
    variable: str,
    before: BinnedMeans,
    after: BinnedMeans,
    names: tuple[str, ...],
    onset: float | None = None,
) -> ResidualCurve | None:
    """Returns errors before and after applying the cause, at the places that both have."""
    mine = {round(float(x), 9): float(y) for x, y in zip(before.at, before.mean, strict=True)}
    rows = [
        (float(x), mine[round(float(x), 9)], float(y), float(h))
        for x, y, h in zip(after.at, after.mean, after.half, strict=True)
        if round(float(x), 9) in mine
    ]
    rows = [row for row in rows if all(math.isfinite(value) for value in row)]
    # A curve needs two points.
    if len(rows) < 2:
        return None
    at, old, new, half = zip(*sorted(rows), strict=True)
    return ResidualCurve(view.name, view.unit, variable, at, old, new, half, names, onset)


def _make_table_curve(cause: Cause, tables: Sequence[MeasuredColumn]) -> ResidualCurve | None:
    """Returns a bench table's errors along its main variable: means at each value, with the
    standard error as half width."""
    stage = CATALOGUE[cause.id].stage
    usable = [table for table in tables if table.main and np.any(table.extended != table.nominal)]
    # Tables of the cause's own stage come first; sort() keeps the order of the others.
    usable.sort(key=lambda table: table.channel != stage)
    if not usable:
        return None
    table = usable[0]
    variable = np.asarray(table.variables[table.main], np.float64)
    kinds, index = np.unique(variable, return_inverse=True)
    if len(kinds) < 2:
        return None

    def calc_kind_means(values: Array) -> Array:
        return np.asarray(np.bincount(index, values) / np.bincount(index))

    after = calc_kind_means(table.after)
    spread = np.sqrt(np.bincount(index, (table.after - after[index]) ** 2)) / np.bincount(index)
    return ResidualCurve(
        table.channel,
        table.unit,
        table.main,
        tuple(kinds.tolist()),
        tuple(calc_kind_means(table.before).tolist()),
        tuple(after.tolist()),
        # 1.645 standard errors are half of a 90 % interval.
        tuple((1.645 * spread).tolist()),
    )


def calc_mean_target(columns: Mapping[str, Any]) -> float | None:
    """Returns the mean of the target rate while it was above zero, kg/ha; None for a log without a
    target."""
    wanted = columns.get("target_rate_kg_ha")
    if wanted is None:
        return None
    wanted = np.asarray(wanted, np.float64)
    # A target of zero means that nothing was to be applied, and would lower the mean dose.
    wanted = wanted[np.isfinite(wanted) & (wanted > 0.0)]
    return float(wanted.mean()) if len(wanted) else None
