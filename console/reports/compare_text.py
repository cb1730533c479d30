"""Two machine files held against the same logs, in words and as data."""
from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

from console.reports.numbers import number
from console.reports.said import better
from control.diagnosis.runs.compared import Compared, ComparedChannel

Logs = Sequence[tuple[str, Compared]]       # path and what was found there


def plain(logs: Logs) -> dict[str, Any]:
    """As data: {"logs": [{"path", "channels": [{"channel", "unit", "old", "new", "low", "high"}]}]}; low and high: 90 %
    interval of old less new, None where the log is too short for it."""
    return {"logs": [{"path": path, "channels": [
        {"channel": one.channel, "unit": one.unit, "old": one.old, "new": one.new, "low": _known(one.low),
         "high": _known(one.high)} for one in found.channels]} for path, found in logs]}


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
    lines = [f"old: {old}", f"new: {new}", "r.m.s. of measured less predicted; nothing is fitted to these logs"]
    for path, found in logs:
        lines += ["", path]
        if found.channels:
            lines.append(f"  {'channel':8s} {'old':>10s} {'new':>10s} {'unit':6s} {'old less new, 90 %':>24s}")
        lines += [f"  {one.channel:8s} {number(one.old):>10s} {number(one.new):>10s} {one.unit:6s} "
                  f"{interval(one):>24s}  {verdict(one)}" for one in found.channels]
        if not found.channels:
            lines.append("  no channel could be held against both machine files")
    return lines
