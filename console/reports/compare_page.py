"""How are two machine files compared on the same logs? The result is given in words, as data, and
as one HTML page with pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.console.reports.chart import AFTER_COLOUR, BEFORE_COLOUR, INK_COLOUR, ChartSheet
from topdress.console.reports.diagnosis_wording import describe_improvement
from topdress.console.reports.html import (
    Picture,
    escape_text,
    format_figure,
    format_list,
    format_paragraph,
    format_section,
    format_table,
    make_page,
)
from topdress.console.reports.number_text import format_number
from topdress.console.reports.panels import MEASURED_LABEL
from topdress.control.diagnosis.runs.compared import Compared, ComparedChannel

# Path of each log and the comparison of its channels.
ComparedLogs = Sequence[tuple[str, Compared]]


def list_plain_data(logs: ComparedLogs) -> dict[str, Any]:
    """Returns the comparison as data: {"logs": [{"path", "channels": [{"channel", "unit", "old",
    "new", "low", "high"}]}]}.

    `low` and `high` are the 90 % interval of old minus new, None for a log that is too short.
    """
    return {
        "logs": [
            {
                "path": path,
                "channels": [
                    {
                        "channel": one.channel,
                        "unit": one.unit,
                        "old": one.old,
                        "new": one.new,
                        "low": _replace_not_finite(one.low),
                        "high": _replace_not_finite(one.high),
                    }
                    for one in found.channels
                ],
            }
            for path, found in logs
        ]
    }


def _replace_not_finite(value: float) -> float | None:
    # JSON has no NaN or infinity.
    return value if isfinite(value) else None


def describe_better(one: ComparedChannel) -> str:
    """Returns which machine file predicts the channel better, beyond the interval, in words."""
    return describe_improvement(
        one.old, one.new, _replace_not_finite(one.low), _replace_not_finite(one.high), "new is "
    )


def format_interval(one: ComparedChannel) -> str:
    """Returns the 90 % interval of old minus new."""
    return f"{format_number(one.low)} to {format_number(one.high)}" if isfinite(one.low) else ""


def summarise_terminal(logs: ComparedLogs, old: str, new: str) -> list[str]:
    """Returns lines for a terminal."""
    lines = [
        f"old: {old}",
        f"new: {new}",
        # Both files are fixed before these logs, so the comparison is free of overfitting.
        "r.m.s. of measured less predicted; nothing is fitted to these logs",
    ]
    for path, found in logs:
        lines += ["", path]
        if found.channels:
            lines.append(
                f"  {'channel':8s} {'old':>10s} {'new':>10s} {'unit':6s} "
                f"{'old less new, 90 %':>24s}"
            )
        lines += [
            f"  {one.channel:8s} {format_number(one.old):>10s} {format_number(one.new):>10s} "
            f"{one.unit:6s} "
            f"{format_interval(one):>24s}  {describe_better(one)}"
            for one in found.channels
        ]
        if not found.channels:
            lines.append("  no channel could be held against both machine files")
    return lines


Array = npt.NDArray[np.float64]

OLD_LABEL, NEW_LABEL = "old machine file", "new machine file"
# Number of rows shown in full, where the two predictions differ most.
MAX_SHOWN_ROWS = 400
# 60 bins are wide enough to average noise and narrow enough to show a change.
TIME_BINS = 60
# A root mean square of fewer rows scatters too much.
MIN_ROWS_IN_BIN = 5


def make_compare_page(logs: ComparedLogs, old: str, new: str) -> str:
    """Returns the page as HTML."""
    parts = [
        f"<header><h1>{escape_text(old)} against {escape_text(new)}</h1>\n"
        f'<p class="verdict">{escape_text(_describe_in_short(logs))}</p></header>',
        format_paragraph(
            "Errors are root mean squares of measured less predicted. No size is fitted to "
            "these logs: both "
            "machine files predict as they stand. The interval is of old less new, 90 %, by "
            "blocks of time.",
            "dim",
        ),
    ]
    for path, found in logs:
        rows = [
            (
                one.channel,
                one.unit,
                format_number(one.old),
                format_number(one.new),
                format_interval(one),
                describe_better(one),
            )
            for one in found.channels
        ]
        shown = format_table(
            ("channel", "unit", "old", "new", "old less new, 90 %", ""), rows, frozenset({2, 3, 4})
        )
        parts.append(
            format_section(
                path,
                shown if rows else format_paragraph("No channel could be held against both."),
                *(format_figure(draw_comparison(one)) for one in found.channels),
                format_list(found.findings) if found.findings else "",
            )
        )
    return make_page(f"{old} against {new}", "\n".join(parts))


def _describe_in_short(logs: ComparedLogs) -> str:
    channels = [one for _, found in logs for one in found.channels]
    # An interval with zero inside counts as no difference.
    better = sum(one.low > 0.0 for one in channels)
    worse = sum(one.high < 0.0 for one in channels)
    if not channels:
        return "No channel of these logs could be held against both machine files."
    alike = len(channels) - better - worse
    return (
        f"Of {len(channels)} channels in {len(logs)} log{'s' if len(logs) != 1 else ''} the "
        "new machine file "
        f"predicts {better} better, {worse} worse and {alike} no differently beyond chance."
    )


def draw_comparison(one: ComparedChannel) -> Picture:
    """Returns the picture of an interval in full where the two differ most, and of the error of
    both over the log."""
    rows = _find_stretch(one)
    sheet = ChartSheet(9.4, 3.4, columns=2)
    left, right = sheet.panels[0]
    at = one.time_s[rows]
    left.plot(
        at,
        one.measured[rows],
        INK_COLOUR,
        dash="",
        marker=".",
        size=7.0,
        opacity=0.55,
        label=MEASURED_LABEL,
    )
    left.plot(at, one.of_old[rows], BEFORE_COLOUR, dash="--", label=OLD_LABEL)
    left.plot(at, one.of_new[rows], AFTER_COLOUR, label=NEW_LABEL)
    left.label("time, s", f"{one.channel}, {one.unit}", "where the two differ most")
    right.draw_level(0.0)
    for series, colour, dash, label in (
        (one.of_old, BEFORE_COLOUR, "--", OLD_LABEL),
        (one.of_new, AFTER_COLOUR, "-", NEW_LABEL),
    ):
        times_s, errors = _calc_rms_over_time(one.time_s, one.measured - series)
        right.plot(times_s, errors, colour, dash=dash, width=1.4, label=label)
    right.label("time, s", one.unit, "error, r.m.s. over time")
    return sheet.make_picture(
        f"{one.channel}: measured, and predicted by both machine files",
        f"{one.channel}: error {format_number(one.old)} {one.unit} with the old machine file, "
        f"{format_number(one.new)} {one.unit} with the new one: {describe_better(one)}.",
    )


def _find_stretch(one: ComparedChannel) -> slice:
    """Returns the rows of the interval in which both predictions differ most."""
    count = min(MAX_SHOWN_ROWS, len(one.time_s))
    # The cumulated sum gives each window's squared difference in one pass.
    total = np.concatenate(([0.0], np.cumsum(np.square(one.of_old - one.of_new))))
    begin = int(np.argmax(total[count:] - total[:-count])) if count < len(one.time_s) else 0
    return slice(begin, begin + count)


def _calc_rms_over_time(time_s: Array, errors: Array) -> tuple[Array, Array]:
    """Returns the root mean square of errors (m,) in equal bins of time: times (k,) and values
    (k,)."""
    # Rows of bench tables or joined logs may be out of order; a stable sort keeps equal times in
    # place.
    order = np.argsort(time_s, kind="stable")
    pieces = np.array_split(order, max(1, min(TIME_BINS, len(order) // MIN_ROWS_IN_BIN)))
    return (
        np.array([float(np.mean(time_s[piece])) for piece in pieces]),
        np.array([float(np.sqrt(np.mean(np.square(errors[piece])))) for piece in pieces]),
    )
