"""Pictures of a bench table: its points, the nominal and the extended machine, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from console.reports.figure import AFTER, BEFORE, DIM, INK, PAPER, drawn, svg
from console.reports.html import Picture, escape
from console.reports.panels import EXTENDED, MEASURED, NOMINAL, legend_below, smooth_line, zero_line
from console.reports.table_views import Group, MeasuredColumn
from console.reports.variables import recorded
from control.diagnosis.result import Unexplained

Array = npt.NDArray[np.float64]

# lines of one model in a panel; more settings are shown as measured against predicted
MOST_LINES = 4
# of a step between values: so far replicates and labels are set apart
SPREAD = 0.2
MARKERS = ("o", "s", "^", "D", "v", "P")
PHASES = 12


def table_picture(view: MeasuredColumn, name: str) -> Picture:
    """Points with both models' lines above, residuals before and after below."""
    named = any(group.held for group in view.groups)
    labels = [group for group in view.groups if group.label]
    with drawn(
        9.4 if len(labels) > 1 else 6.6, 5.6, columns=max(1, len(labels)), rows=2, sharey="row"
    ) as (figure, grid):
        for column, group in enumerate(view.groups):
            top, bottom = grid[0, column], grid[1, column]
            _models(top, view, group, named, first=column == 0)
            _left(bottom, view, group, named, first=column == 0)
            if group.label:
                top.set_title(group.label)
        legend_below(figure, grid)
        text = svg(figure, name, escape(f"{view.name}: points, model lines and residuals"))
    return Picture(text, _caption(view, named))


def _caption(view: MeasuredColumn, named: bool) -> str:
    path, column = view.table, view.column
    table = path.replace("\\", "/").rsplit("/", 1)[-1]
    models = (
        "the nominal machine and the machine with the causes" if named else "the nominal machine"
    )
    said = [
        *([f"{table}."] if table else []),
        f"Above: {column} as measured, with {models}.",
        "Below: measured less predicted; the larger marks are means of rows set alike.",
    ]
    if column == "lag_m":
        said.append("Distances are divided by the written speed.")
    said += [
        f"In the rows of {group.label}, {' and '.join(group.not_held)} is not held."
        for group in view.groups
        if group.not_held
    ]
    return " ".join(said)


def _models(axes: Any, view: MeasuredColumn, group: Group, named: bool, first: bool) -> None:
    rows = group.rows
    sets = _settings(view, rows)
    if view.main and len(sets) <= MOST_LINES:
        x = view.variables[view.main]
        for k, (words, inside) in enumerate(sets):
            marker = MARKERS[k % len(MARKERS)]
            axes.plot(
                x[inside],
                view.observed[inside],
                linestyle="none",
                marker=marker,
                markersize=4.5,
                color=INK,
                markerfacecolor="none",
                alpha=0.8,
                label=f"{MEASURED}{words}",
            )
            for series, colour, line, label in _lines(view, named):
                at, mean = _by_value(x[inside], series[inside])
                axes.plot(at, mean, color=colour, linestyle=line, linewidth=1.8, label=label)
        axes.set_xlabel(recorded(view.main, "table").label)
        if first:
            axes.set_ylabel(f"{view.column}, {view.unit}")
        return
    for series, colour, _, label in _lines(view, named):
        hollow = colour == BEFORE
        axes.plot(
            series[rows],
            view.observed[rows],
            linestyle="none",
            marker="o" if hollow else "s",
            markersize=4.5,
            color=colour,
            markerfacecolor=PAPER if hollow else colour,
            label=label,
        )
    both = np.concatenate([view.observed[rows], view.nominal[rows]])
    ends = [float(both.min()), float(both.max())]
    axes.plot(ends, ends, color=DIM, linewidth=0.9)
    axes.set_xlabel(f"predicted, {view.unit}")
    if first:
        axes.set_ylabel(f"{MEASURED}, {view.unit}")


def _lines(view: MeasuredColumn, named: bool) -> list[tuple[Array, str, str, str]]:
    lines = [(view.nominal, BEFORE, "--", NOMINAL)]
    return [*lines, (view.extended, AFTER, "-", EXTENDED)] if named else lines


def _settings(
    view: MeasuredColumn, rows: npt.NDArray[np.bool_]
) -> list[tuple[str, npt.NDArray[np.bool_]]]:
    """Rows that differ in nothing that moves the model but the main variable, with words where
    there are several."""
    others = [name for name in view.variables if name not in (view.main, "replicate")]
    moving = [name for name in others if not _follows(view, name)]
    keys = (
        list(zip(*[np.round(view.variables[name], 9).tolist() for name in moving], strict=True))
        if moving
        else [()] * len(rows)
    )
    kinds = sorted({key for key, inside in zip(keys, rows.tolist(), strict=True) if inside})
    found = []
    for kind in kinds:
        words = ", ".join(
            f"{recorded(n, 'table').name} {v:g}" for n, v in zip(moving, kind, strict=True)
        )
        inside = rows & np.array([key == kind for key in keys])
        found.append((f" ({words})" if len(kinds) > 1 else "", inside))
    return found


def _follows(view: MeasuredColumn, name: str) -> bool:
    """Whether both models are the same wherever the main variable is, whatever this one is."""
    if not view.main:
        return False
    x = view.variables[view.main]
    for series in (view.nominal, view.extended):
        for value in np.unique(x):
            same = series[x == value]
            if np.ptp(same) > 1e-6 * (1.0 + float(np.abs(same).max())):
                return False
    return True


def _left(axes: Any, view: MeasuredColumn, group: Group, named: bool, first: bool) -> None:
    rows = group.rows
    x = view.variables[view.main] if view.main else np.arange(len(view.observed), dtype=float)
    step = _step(x)
    zero_line(axes)
    series = [(view.before, BEFORE, "o", "--", NOMINAL, -1.0)]
    if named:
        series.append((view.after, AFTER, "s", "-", EXTENDED, 1.0))
    for values, colour, marker, line, label, side in series:
        shift = side * SPREAD * 0.5 * step if named else 0.0
        axes.plot(
            x[rows] + shift,
            values[rows],
            linestyle="none",
            marker=marker,
            markersize=3.0,
            color=colour,
            alpha=0.55,
            markerfacecolor="none" if side < 0 else colour,
        )
        at, mean = _by_value(x[rows], values[rows])
        axes.plot(
            at + shift,
            mean,
            color=colour,
            marker=marker,
            linestyle=line,
            linewidth=1.4,
            markersize=6.0,
            markerfacecolor=PAPER if side < 0 else colour,
            label=label,
        )
    axes.set_xlabel(recorded(view.main, "table").label if view.main else "row")
    if first:
        axes.set_ylabel(f"residual, {view.unit}")


def _step(x: Array) -> float:
    kinds = np.unique(x)
    return float(np.min(np.diff(kinds))) if len(kinds) > 1 else 1.0


def _by_value(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of y at each value of x."""
    kinds, index = np.unique(x, return_inverse=True)
    return kinds, np.bincount(index, y) / np.bincount(index)


def left_picture(views: Sequence[MeasuredColumn], left: Unexplained, name: str) -> Picture | None:
    """What no effect explains, along the setting that is named, with the smooth function
    through it."""
    view = next(
        (
            v
            for v in views
            if v.channel == left.channel
            and (left.variable in v.variables or left.variable in ("label", "constant"))
        ),
        None,
    )
    if view is None:
        return None
    named = any(group.held for group in view.groups)
    colour = AFTER if named else BEFORE
    with drawn(6.4, 3.4) as (figure, grid):
        axes = grid[0, 0]
        zero_line(axes)
        if left.variable in view.variables:
            x = view.variables[left.variable]
            label = recorded(left.variable, "table").label
        else:
            x = np.zeros(len(view.observed))
            for k, group in enumerate(view.groups):
                x[group.rows] = k
            axes.set_xticks(
                range(len(view.groups)), [group.label or "all rows" for group in view.groups]
            )
            label = "rows of"
        axes.plot(
            x,
            view.after,
            linestyle="none",
            marker="s" if named else "o",
            color=colour,
            markersize=4.5,
            markerfacecolor=colour if named else PAPER,
            label=EXTENDED if named else NOMINAL,
        )
        if left.variable in view.variables and len(np.unique(x)) > 2:
            smooth_line(axes, x, view.after)
        axes.set(xlabel=label, ylabel=f"residual, {view.unit}")
        legend_below(figure, grid)
        text = svg(figure, name, escape(f"{view.name}: what is left along {left.variable}"))
    return Picture(
        text,
        f"What is left of {view.name}{' along with the causes named' if named else ''}, against "
        f"{label}, and the smooth function through it.",
    )


def phase_picture(views: Sequence[MeasuredColumn], step_s: float, name: str) -> Picture | None:
    """Where within a step of a coarse clock the times lie: even, if there is none."""
    view = next((v for v in views if v.unit == "s"), None)
    if view is None or step_s <= 0.0:
        return None
    phase = np.mod(view.observed / step_s + 0.5, 1.0) - 0.5
    with drawn(6.4, 2.8) as (figure, grid):
        axes = grid[0, 0]
        axes.hist(
            phase,
            bins=np.linspace(-0.5, 0.5, PHASES + 1),
            color=AFTER,
            edgecolor=PAPER,
            label=MEASURED,
        )
        axes.axhline(
            len(phase) / PHASES,
            color=BEFORE,
            linestyle="--",
            linewidth=1.6,
            label="expected without steps",
        )
        axes.set(
            xlabel=f"time less the nearest multiple of {step_s:.4f} s, in steps", ylabel="rows"
        )
        legend_below(figure, grid)
        text = svg(figure, name, "times within a step of the clock")
    return Picture(text, "Times that come in steps heap about the multiples of the step.")
