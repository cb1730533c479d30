"""Which pictures show a bench table? They show its points, the nominal and the extended machine,
and the remaining residual.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from topdress.console.reports.chart import (
    AFTER_COLOUR,
    BEFORE_COLOUR,
    DIM_COLOUR,
    INK_COLOUR,
    PAPER_COLOUR,
    ChartPanel,
    ChartSheet,
)
from topdress.console.reports.html import Picture
from topdress.console.reports.panels import (
    EXTENDED_LABEL,
    MEASURED_LABEL,
    NOMINAL_LABEL,
    draw_smooth_line,
)
from topdress.console.reports.table_views import MeasuredColumn, RowGroup
from topdress.console.reports.variable_names import find_variable
from topdress.control.diagnosis.result import UnexplainedStructure

Array = npt.NDArray[np.float64]

# Number of lines of one model in a panel; more settings are shown as measured against predicted.
MAX_MODEL_LINES = 4
# Share of the distance between values by which replicates and labels are offset.
JITTER_SHARE = 0.2
SERIES_MARKERS = ("o", "s", "^", "D", "v", "P")
# A step of the clock is divided into 12 bins: enough to see a peak, few enough for a small table.
PHASE_BINS = 12


def draw_table_column(view: MeasuredColumn) -> Picture:
    """Returns points with both models' lines above, and residuals before and after below."""
    # Without a named cause both models are equal, and one line is drawn.
    named = any(group.held for group in view.groups)
    columns = max(1, sum(bool(group.label) for group in view.groups))
    # Several groups of rows share the y axis, so that their levels can be compared.
    sheet = ChartSheet(9.4 if columns > 1 else 6.6, 5.6, 2, columns, shares_y=True)
    for column, group in enumerate(view.groups):
        above, below = sheet.panels[0][column], sheet.panels[1][column]
        _draw_models(above, view, group, named, first=column == 0)
        _draw_residuals(below, view, group, named, first=column == 0)
        above.label(title=group.label)
    title = f"{view.name}: points, model lines and residuals"
    return sheet.make_picture(title, _format_caption(view, named))


def _format_caption(view: MeasuredColumn, named: bool) -> str:
    path, column = view.table, view.column
    # Paths of Windows have backslashes, also in a file that is read elsewhere.
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


def _draw_models(
    panel: ChartPanel, view: MeasuredColumn, group: RowGroup, named: bool, first: bool
) -> None:
    rows = group.rows
    sets = _split_settings(view, rows)
    # With many settings the lines would cross everywhere; measured against predicted stays
    # readable.
    if view.main and len(sets) <= MAX_MODEL_LINES:
        x = view.variables[view.main]
        for k, (words, inside) in enumerate(sets):
            marker = SERIES_MARKERS[k % len(SERIES_MARKERS)]
            panel.plot(
                x[inside],
                view.observed[inside],
                INK_COLOUR,
                dash="",
                marker=marker,
                size=4.5,
                fill="none",
                opacity=0.8,
                label=f"{MEASURED_LABEL}{words}",
            )
            for series, colour, line, label in _list_model_lines(view, named):
                # Replicates share a setting, so the model's line has one point for each.
                at, mean = _calc_value_means(x[inside], series[inside])
                panel.plot(at, mean, colour, dash=line, width=1.8, label=label)
        panel.label(
            find_variable(view.main, "table").label, f"{view.column}, {view.unit}" if first else ""
        )
        return
    for series, colour, _, label in _list_model_lines(view, named):
        # Hollow markers of the nominal machine stay visible below the filled ones.
        hollow = colour == BEFORE_COLOUR
        panel.plot(
            series[rows],
            view.observed[rows],
            colour,
            dash="",
            marker="o" if hollow else "s",
            size=4.5,
            fill=PAPER_COLOUR if hollow else colour,
            label=label,
        )
    both = np.concatenate([view.observed[rows], view.nominal[rows]])
    ends = [float(both.min()), float(both.max())]
    # On the diagonal measured and predicted are equal.
    panel.plot(ends, ends, DIM_COLOUR, width=0.9)
    panel.label(f"predicted, {view.unit}", f"{MEASURED_LABEL}, {view.unit}" if first else "")


def _list_model_lines(view: MeasuredColumn, named: bool) -> list[tuple[Array, str, str, str]]:
    lines = [(view.nominal, BEFORE_COLOUR, "--", NOMINAL_LABEL)]
    return [*lines, (view.extended, AFTER_COLOUR, "-", EXTENDED_LABEL)] if named else lines


def _split_settings(
    view: MeasuredColumn, rows: npt.NDArray[np.bool_]
) -> list[tuple[str, npt.NDArray[np.bool_]]]:
    """Returns groups of rows in which all variables that affect the model, except the main
    variable, are equal, with words where several groups exist."""
    # A replicate is a repetition and no setting.
    others = [name for name in view.variables if name not in (view.main, "replicate")]
    moving = [name for name in others if not _is_without_effect(view, name)]
    keys = (
        # Rounding to 9 decimals makes equal settings of a computed column equal.
        list(zip(*[np.round(view.variables[name], 9).tolist() for name in moving], strict=True))
        if moving
        else [()] * len(rows)
    )
    # Settings without a row in this group would add empty entries to the legend.
    kinds = sorted({key for key, inside in zip(keys, rows.tolist(), strict=True) if inside})
    found = []
    for kind in kinds:
        words = ", ".join(
            f"{find_variable(n, 'table').name} {v:g}" for n, v in zip(moving, kind, strict=True)
        )
        inside = rows & np.array([key == kind for key in keys])
        found.append((f" ({words})" if len(kinds) > 1 else "", inside))
    return found


def _is_without_effect(view: MeasuredColumn, name: str) -> bool:
    """Returns whether both models are the same at each value of the main variable, whatever this
    variable is."""
    if not view.main:
        return False
    x = view.variables[view.main]
    for series in (view.nominal, view.extended):
        for value in np.unique(x):
            same = series[x == value]
            # The tolerance is relative, because columns have units from seconds to kilograms.
            if np.ptp(same) > 1e-6 * (1.0 + float(np.abs(same).max())):
                return False
    return True


def _draw_residuals(
    panel: ChartPanel, view: MeasuredColumn, group: RowGroup, named: bool, first: bool
) -> None:
    rows = group.rows
    # A table without a main variable is drawn by row number.
    x = view.variables[view.main] if view.main else np.arange(len(view.observed), dtype=float)
    step = _find_value_step(x)
    panel.draw_level(0.0)
    series = [(view.before, BEFORE_COLOUR, "o", "--", NOMINAL_LABEL, -1.0)]
    if named:
        series.append((view.after, AFTER_COLOUR, "s", "-", EXTENDED_LABEL, 1.0))
    for values, colour, marker, line, label, side in series:
        # Both models' points are shifted to either side, so that they do not hide each other.
        shift = side * JITTER_SHARE * 0.5 * step if named else 0.0
        fill = PAPER_COLOUR if side < 0 else colour
        panel.plot(
            x[rows] + shift,
            values[rows],
            colour,
            dash="",
            marker=marker,
            size=3.0,
            opacity=0.55,
            fill="none" if side < 0 else colour,
        )
        at, mean = _calc_value_means(x[rows], values[rows])
        panel.plot(
            at + shift, mean, colour, dash=line, width=1.4, marker=marker, fill=fill, label=label
        )
    panel.label(
        find_variable(view.main, "table").label if view.main else "row",
        f"residual, {view.unit}" if first else "",
    )


def _find_value_step(x: Array) -> float:
    kinds = np.unique(x)
    return float(np.min(np.diff(kinds))) if len(kinds) > 1 else 1.0


def _calc_value_means(x: Array, y: Array) -> tuple[Array, Array]:
    """Returns means of y at each value of x."""
    kinds, index = np.unique(x, return_inverse=True)
    return kinds, np.bincount(index, y) / np.bincount(index)


def draw_table_unexplained(
    views: Sequence[MeasuredColumn], left: UnexplainedStructure
) -> Picture | None:
    """Returns the part that no effect explains, along the named setting, with the smooth function
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
    colour = AFTER_COLOUR if named else BEFORE_COLOUR
    sheet = ChartSheet(6.4, 3.4)
    panel = sheet.panel
    panel.draw_level(0.0)
    if left.variable in view.variables:
        x = view.variables[left.variable]
        label = find_variable(left.variable, "table").label
    else:
        # A label has no number: its groups get positions 0, 1, 2 with names.
        x = np.zeros(len(view.observed))
        for k, group in enumerate(view.groups):
            x[group.rows] = k
        names = [group.label or "all rows" for group in view.groups]
        panel.x_names = tuple((float(k), name) for k, name in enumerate(names))
        label = "rows of"
    panel.plot(
        x,
        view.after,
        colour,
        dash="",
        marker="s" if named else "o",
        size=4.5,
        fill=colour if named else PAPER_COLOUR,
        label=EXTENDED_LABEL if named else NOMINAL_LABEL,
    )
    # A smooth function through two values would only be a line.
    if left.variable in view.variables and len(np.unique(x)) > 2:
        draw_smooth_line(panel, x, view.after)
    panel.label(label, f"residual, {view.unit}")
    return sheet.make_picture(
        f"{view.name}: what is left along {left.variable}",
        f"What is left of {view.name}{' along with the causes named' if named else ''}, against "
        f"{label}, and the smooth function through it.",
    )


def draw_clock_phases(views: Sequence[MeasuredColumn], step_s: float) -> Picture | None:
    """Returns the distribution of times within a step of a coarse clock: uniform without such a
    clock."""
    view = next((v for v in views if v.unit == "s"), None)
    if view is None or step_s <= 0.0:
        return None
    # The half step centres the phases: times on the clock's steps lie at zero.
    phase = np.mod(view.observed / step_s + 0.5, 1.0) - 0.5
    sheet = ChartSheet(6.4, 2.8)
    edges = np.linspace(-0.5, 0.5, PHASE_BINS + 1)
    heights = np.histogram(phase, edges)[0]
    sheet.panel.draw_bars(
        edges, heights, AFTER_COLOUR, edge_colour=PAPER_COLOUR, label=MEASURED_LABEL
    )
    expected = len(phase) / PHASE_BINS
    sheet.panel.draw_level(
        expected, BEFORE_COLOUR, dash="--", width=1.6, label="expected without steps"
    )
    sheet.panel.label(f"time less the nearest multiple of {step_s:.4f} s, in steps", "rows")
    title = "times within a step of the clock"
    return sheet.make_picture(
        title, "Times that come in steps heap about the multiples of the step."
    )
