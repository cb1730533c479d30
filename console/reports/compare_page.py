"""Two machine files held against the same logs: in words, as data, and as one HTML page with
pictures."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.console.reports.chart import AFTER, BEFORE, INK, ChartSheet
from topdress.console.reports.diagnosis_wording import better
from topdress.console.reports.html import (
    Picture,
    escape,
    figure,
    format_paragraph,
    items,
    page,
    section,
    table,
)
from topdress.console.reports.numbers import number
from topdress.console.reports.panels import MEASURED
from topdress.control.diagnosis.runs.compared import Compared, ComparedChannel

Logs = Sequence[tuple[str, Compared]]  # path and what was found there


def plain(logs: Logs) -> dict[str, Any]:
    """As data: {"logs": [{"path", "channels": [{"channel", "unit", "old", "new", "low",
    "high"}]}]}; low and high: 90 % interval of old less new, None where the log is too short
    for it."""
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
                        "low": _known(one.low),
                        "high": _known(one.high),
                    }
                    for one in found.channels
                ],
            }
            for path, found in logs
        ]
    }


def _known(value: float) -> float | None:
    return value if isfinite(value) else None


def verdict(one: ComparedChannel) -> str:
    """Which of the two predicts the channel better, beyond the interval."""
    return better(one.old, one.new, _known(one.low), _known(one.high), "new is ")


def interval(one: ComparedChannel) -> str:
    """90 % interval of old less new."""
    return f"{number(one.low)} to {number(one.high)}" if isfinite(one.low) else ""


def summary(logs: Logs, old: str, new: str) -> list[str]:
    """Lines for a terminal."""
    lines = [
        f"old: {old}",
        f"new: {new}",
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
            f"  {one.channel:8s} {number(one.old):>10s} {number(one.new):>10s} {one.unit:6s} "
            f"{interval(one):>24s}  {verdict(one)}"
            for one in found.channels
        ]
        if not found.channels:
            lines.append("  no channel could be held against both machine files")
    return lines


Array = npt.NDArray[np.float64]

OLD, NEW = "old machine file", "new machine file"
STRETCH_ROWS = 400  # shown in full: where the two differ most
TIME_BINS = 60
ROWS_IN_BIN = 5


def compare_page(logs: Logs, old: str, new: str) -> str:
    """The page."""
    parts = [
        f"<header><h1>{escape(old)} against {escape(new)}</h1>\n"
        f'<p class="verdict">{escape(_in_short(logs))}</p></header>',
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
            (one.channel, one.unit, number(one.old), number(one.new), interval(one), verdict(one))
            for one in found.channels
        ]
        shown = table(
            ("channel", "unit", "old", "new", "old less new, 90 %", ""), rows, frozenset({2, 3, 4})
        )
        parts.append(
            section(
                path,
                shown if rows else format_paragraph("No channel could be held against both."),
                *(figure(picture_of(one)) for one in found.channels),
                items(found.findings) if found.findings else "",
            )
        )
    return page(f"{old} against {new}", "\n".join(parts))


def _in_short(logs: Logs) -> str:
    channels = [one for _, found in logs for one in found.channels]
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


def picture_of(one: ComparedChannel) -> Picture:
    """A stretch in full where the two differ most, and the error of both over the log."""
    rows = _stretch(one)
    sheet = ChartSheet(9.4, 3.4, columns=2)
    left, right = sheet.panels[0]
    at = one.time_s[rows]
    left.plot(
        at, one.measured[rows], INK, dash="", marker=".", size=7.0, opacity=0.55, label=MEASURED
    )
    left.plot(at, one.of_old[rows], BEFORE, dash="--", label=OLD)
    left.plot(at, one.of_new[rows], AFTER, label=NEW)
    left.label("time, s", f"{one.channel}, {one.unit}", "where the two differ most")
    right.draw_level(0.0)
    for series, colour, dash, label in (
        (one.of_old, BEFORE, "--", OLD),
        (one.of_new, AFTER, "-", NEW),
    ):
        times_s, errors = _over_time(one.time_s, one.measured - series)
        right.plot(times_s, errors, colour, dash=dash, width=1.4, label=label)
    right.label("time, s", one.unit, "error, r.m.s. over time")
    return sheet.make_picture(
        f"{one.channel}: measured, and predicted by both machine files",
        f"{one.channel}: error {number(one.old)} {one.unit} with the old machine file, "
        f"{number(one.new)} {one.unit} with the new one: {verdict(one)}.",
    )


def _stretch(one: ComparedChannel) -> slice:
    """Rows of the stretch over which both predictions differ most."""
    count = min(STRETCH_ROWS, len(one.time_s))
    total = np.concatenate(([0.0], np.cumsum(np.square(one.of_old - one.of_new))))
    begin = int(np.argmax(total[count:] - total[:-count])) if count < len(one.time_s) else 0
    return slice(begin, begin + count)


def _over_time(time_s: Array, errors: Array) -> tuple[Array, Array]:
    """Root mean square of errors (m,) in even bins of time: (k,), (k,)."""
    order = np.argsort(time_s, kind="stable")
    pieces = np.array_split(order, max(1, min(TIME_BINS, len(order) // ROWS_IN_BIN)))
    return (
        np.array([float(np.mean(time_s[piece])) for piece in pieces]),
        np.array([float(np.sqrt(np.mean(np.square(errors[piece])))) for piece in pieces]),
    )
