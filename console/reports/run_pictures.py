"""Which pictures show a run? They show each cause and the remaining residual, intervals in full,
and every channel over time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from topdress.console.reports.binned_means import ResidualAxis, calc_shown_share
from topdress.console.reports.chart import (
    AFTER_COLOUR,
    BEFORE_COLOUR,
    DIM_COLOUR,
    INK_COLOUR,
    PAPER_COLOUR,
    THIRD_COLOUR,
    ChartPanel,
    ChartSheet,
)
from topdress.console.reports.html import Picture
from topdress.console.reports.panels import (
    EXTENDED_LABEL,
    MEASURED_LABEL,
    NOMINAL_LABEL,
    OTHER_CAUSES_LABEL,
    draw_residual_panel,
    draw_smooth_line,
)
from topdress.console.reports.run_views import ChannelView, find_view
from topdress.control.diagnosis.result import UnexplainedCurve, UnexplainedStructure
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.machine.machine import CATALOGUE

Array = npt.NDArray[np.float64]

# Share of an effect below which means over the axis do not show it.
MIN_EFFECT_SHARE_IN_MEANS = 0.25
# Share from which means alone are sufficient.
SUFFICIENT_EFFECT_SHARE_IN_MEANS = 0.8
# The lengths show several responses of each drive: shaft and gate react faster than the speed
# changes.
# Lengths of the intervals that are shown in full, by view, s.
INTERVAL_S_OF_VIEW = {"shaft": 12.0, "gate": 20.0, "speed": 40.0}
# 90 bins give each some 7 points of width in a picture of 9.4 inches.
TIME_BINS = 90
# A rate needs longer bins.
RATE_BINS = 24
# Change of an effect's strength in an interval below which it counts as constant.
MIN_STRENGTH_CHANGE = 0.01
BAND_NOTE = "The band is the 90 % interval of each mean."


def draw_cause(
    views: Sequence[ChannelView], parts: Sequence[EffectInstance], part: EffectInstance
) -> list[Picture]:
    """Returns the pictures of one cause: its residual before and after along its most telling
    variable, and the interval in which it is most visible."""
    found = find_view(views, parts, part)
    if found is None:
        return []
    view, effect = found
    # The other causes are applied in both curves, so that only this cause makes the difference.
    others = tuple(one for one in view.select_own_parts(parts) if one != part)
    first = OTHER_CAUSES_LABEL if others else NOMINAL_LABEL
    before, after = view.calc_residual(others), view.calc_residual(parts)
    axis = view.find_effect_axis(part, effect)
    panels = _choose_panels(view, axis, calc_shown_share(axis, effect), part)
    sheet = ChartSheet(6.4 if panels == ["means"] else 9.4, 3.4, columns=len(panels))
    for panel, kind in zip(sheet.panels[0], panels, strict=True):
        if kind == "means":
            # Noise of neighbouring rows is correlated; the intervals would be too narrow without
            # this memory.
            memory = view.calc_noise_memory(after)
            draw_residual_panel(
                panel,
                axis,
                view.calc_axis_means(axis, before, memory),
                view.calc_axis_means(axis, after, memory),
                view.unit,
                first,
            )
            panel.label(title="residual: measured less predicted")
        else:
            _draw_stretch(panel, view, others, effect, part)
    title = f"{CATALOGUE[part.id].effect.title}: {view.title}, before and after"
    sentences = []
    if "means" in panels:
        where = axis.label
        nominal = (
            "with the nominal machine and with the causes in it"
            if not others
            else "with the other causes in the machine and with this one, too"
        )
        sentences.append(
            f"{_capitalise_first(view.title)}, against {where}, {nominal}. {BAND_NOTE}"
        )
    if "stretch" in panels:
        sentences.append(
            "The stretch is the one in which the effect does most."
            if part.onset_s is None
            else "The stretch is the one about the onset."
        )
    return [sheet.make_picture(title, " ".join(sentences))]


def _choose_panels(
    view: ChannelView, axis: ResidualAxis, share: float, part: EffectInstance
) -> list[str]:
    """Returns the panels: means over the axis where they show the effect; an interval in full where
    means do not show all of it, or time matters."""
    # Only drives and speed respond within seconds; the other channels show nothing in a short
    # interval.
    stretch = view.name in INTERVAL_S_OF_VIEW and (
        share < SUFFICIENT_EFFECT_SHARE_IN_MEANS
        or part.onset_s is not None
        or axis.sign is not None
    )
    # At least one panel is drawn.
    means = share >= MIN_EFFECT_SHARE_IN_MEANS or not stretch
    return [word for word, wanted in (("means", means), ("stretch", stretch)) if wanted]


def _draw_stretch(
    panel: ChartPanel,
    view: ChannelView,
    others: tuple[EffectInstance, ...],
    effect: Array,
    part: EffectInstance,
) -> None:
    wide = INTERVAL_S_OF_VIEW[view.name]
    step = float(np.median(np.diff(view.time_s)))
    # At least 8 rows show a course even in a log with a long row interval.
    count = min(len(effect), max(8, int(round(wide / step))))
    if part.onset_s is None:
        begin = _find_telling_rows(effect, count)
    else:
        begin = int(np.searchsorted(view.time_s, part.onset_s - 0.5 * wide))
    # An onset near the beginning or end would leave the log.
    begin = max(0, min(begin, len(effect) - count))
    rows = slice(begin, begin + count)
    at = view.time_s[rows]
    panel.plot(
        at,
        view.measured[rows],
        INK_COLOUR,
        dash="",
        marker=".",
        size=7.0,
        opacity=0.55,
        label=MEASURED_LABEL,
    )
    panel.plot(
        at,
        view.predict(others)[rows],
        BEFORE_COLOUR,
        dash="--",
        label=OTHER_CAUSES_LABEL if others else NOMINAL_LABEL,
    )
    panel.plot(at, view.predict((*others, part))[rows], AFTER_COLOUR, label=EXTENDED_LABEL)
    panel.label("time, s", f"{view.quantity}, {view.unit}", "a stretch of the log")
    if part.onset_s is not None:
        panel.draw_moment(part.onset_s, label="onset")


def _find_telling_rows(effect: Array, count: int) -> int:
    """Returns the first of the `count` rows in which the effect changes most or, for a constant
    effect, is strongest."""
    if count >= len(effect):
        return 0

    def sum_windows(series: Array) -> Array:
        # Differences of the cumulated sum give every window's sum in one pass.
        total = np.concatenate(([0.0], np.cumsum(series)))
        return np.asarray(total[count:] - total[:-count])

    strong = sum_windows(effect**2)
    # The sum of squares about the window's mean measures how much the effect changes in it.
    changing = strong - sum_windows(effect) ** 2 / count
    return int(
        np.argmax(changing if changing.max() > MIN_STRENGTH_CHANGE * strong.max() else strong)
    )


def draw_unexplained(
    views: Sequence[ChannelView],
    parts: Sequence[EffectInstance],
    left: UnexplainedStructure,
    fit: UnexplainedCurve | None,
) -> Picture | None:
    """Returns the residual that no effect explains, along the named variable, with the smooth
    function that fits it."""
    view = next((v for v in views if v.name == left.channel and left.variable in v.axes), None)
    if view is None:
        return None
    axis = view.axes[left.variable]
    after = view.calc_residual(parts)
    named = bool(view.select_own_parts(parts))
    sheet = ChartSheet(9.4 if fit else 6.4, 3.4, columns=2 if fit else 1)
    panel, colour = sheet.panel, AFTER_COLOUR if named else BEFORE_COLOUR
    panel.draw_level(0.0)
    means = view.calc_axis_means(axis, after, view.calc_noise_memory(after))
    panel.plot_intervals(
        means.at,
        means.mean,
        means.half,
        colour,
        label=EXTENDED_LABEL if named else NOMINAL_LABEL,
        marker="s" if named else "o",
        fill=colour if named else PAPER_COLOUR,
    )
    panel.label(axis.label, f"residual, {view.unit}", "residual: measured less predicted")
    if fit:
        _draw_extension(sheet.panels[0][1], fit, axis)
    # A channel of segments has too few points for a smooth function.
    elif not axis.names and view.segments is None:
        known = np.isfinite(axis.values)
        draw_smooth_line(panel, axis.values[known], after[known])
    title = f"{view.title}, against {axis.label}"
    return sheet.make_picture(
        title,
        f"{_capitalise_first(view.title)}, against {axis.label}: what is left"
        f"{' along with the causes named' if named else ''}, and the smooth function that fits it. "
        f"{BAND_NOTE}",
    )


def _draw_extension(panel: ChartPanel, fit: UnexplainedCurve, axis: ResidualAxis) -> None:
    # The units are those of the extension in the machine file.
    unit = {"gate": "mm", "scale": "kg"}.get(fit.stage, "%")
    # The axis of time is in minutes, the nodes are in seconds.
    nodes = np.array(fit.nodes) / (60.0 if fit.variable == "time_s" else 1.0)
    panel.draw_level(0.0)
    panel.plot(
        nodes, fit.values, THIRD_COLOUR, marker="o", size=4.0, width=2.0, label="smooth function"
    )
    panel.label(
        axis.label,
        f"{fit.stage} more than nominal, {unit}",
        "the extension, between its nodes",
    )


def draw_time_lines(
    views: Sequence[ChannelView], parts: Sequence[EffectInstance]
) -> Picture | None:
    """Returns the residual of every channel over the run, for the unchanged and the extended
    machine file, with the onsets."""
    if not views:
        return None
    sheet = ChartSheet(9.4, 1.1 + 1.35 * len(views), rows=len(views), shares_x=True)
    for (panel,), view in zip(sheet.panels, views, strict=True):
        _draw_time_line(panel, view, view.select_own_parts(parts), parts)
    sheet.panels[-1][0].label("time since the log began, min")
    title = "residual of every channel over time"
    return sheet.make_picture(
        title, "Residual of every channel over the run, in means of equal times. " + BAND_NOTE
    )


def _draw_time_line(
    panel: ChartPanel,
    view: ChannelView,
    own: Sequence[EffectInstance],
    parts: Sequence[EffectInstance],
) -> None:
    rows, title = _select_time_rows(view, own)
    before = view.calc_residual(())[rows]
    after = view.calc_residual(parts)[rows] if own else None
    # A file that was extended in another way, e.g. by terms, has predictions of its own.
    if view.of_file is not None and (own or bool(np.any(view.of_file != view.predict(())))):
        after = (view.measured - view.of_file)[rows]
    memory = view.calc_noise_memory(before if after is None else after)
    even = _make_bin_means(view, view.time_s[rows] / 60.0)
    panel.draw_level(0.0)
    for series, colour, dash, label in (
        (before, BEFORE_COLOUR, "--", NOMINAL_LABEL),
        (after, AFTER_COLOUR, "-", EXTENDED_LABEL),
    ):
        if series is not None:
            at, mean, half = even(series, memory)
            panel.fill_between(at, mean - half, mean + half, colour)
            panel.plot(at, mean, colour, dash=dash, width=1.2, label=label)
    for part in own:
        if part.onset_s is not None:
            panel.draw_moment(part.onset_s / 60.0, label="onset", words=part.id)
    panel.label(title=f"{title}, {view.unit}")
    # Channels without a cause are dimmed, so that the eye finds the others.
    panel.title_colour = INK_COLOUR if own else DIM_COLOUR


def _select_time_rows(
    view: ChannelView, own: Sequence[EffectInstance]
) -> tuple[npt.NDArray[np.bool_], str]:
    """Returns all rows; for the heads the rows of the named head, or of the head with the largest
    deviation."""
    if view.member is None:
        return np.ones(len(view.measured), bool), view.quantity
    heads = np.unique(view.member).tolist()
    named = [part.member for part in own if part.member in heads]
    off = view.calc_residual(())
    # A named head is drawn; otherwise the head that deviates most.
    head = named[0] if named else max(heads, key=lambda k: abs(float(off[view.member == k].mean())))
    return view.member == head, f"head {head} less the mean of all heads"


def _make_bin_means(
    view: ChannelView, minutes: Array
) -> Callable[[Array, float], tuple[Array, Array, Array]]:
    """Returns a function for the middle of each bin, its mean and half of its interval, NaN for an
    empty bin."""
    cell, middle = view.make_even_bins(minutes, TIME_BINS if view.segments is None else RATE_BINS)
    count = len(middle)

    def calc_bin_means(series: Array, memory: float) -> tuple[Array, Array, Array]:
        found = view.calc_axis_means(cell, series, memory)
        places = np.round(found.at).astype(int)
        mean, half = np.full(count, np.nan), np.full(count, np.nan)
        mean[places], half[places] = found.mean, found.half
        return middle, mean, half

    return calc_bin_means


def _capitalise_first(text: str) -> str:
    return text[0].upper() + text[1:]
