"""How far long work is: stage, bar, share, time left, how to cancel it."""
from __future__ import annotations

from typing import NamedTuple

from textual.content import Content

from console.app.view import duration
from console.app.widgets.panel import Panel, fit, line, solid
from console.locale import _


class WorkView(NamedTuple):
    """percent, left_s: rounded to what is shown; left_s None where it takes longer than was thought."""

    title: str
    stage: str
    percent: int
    left_s: int | None


class WorkBar(Panel[WorkView | None]):
    """Three rows; nothing where the view is None."""

    def lines(self, view: WorkView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        left = f"   {_('longer than expected')}" if view.left_s is None else (
            f"   {_('about {time} left').format(time=duration(view.left_s))}")
        room = max(10, min(60, width - 12))
        full = round(room * view.percent / 100)
        return [line((fit(f" {view.title}", width), "bold $primary")),
                line(" ", *solid("█" * full, "$target"), *solid("░" * (room - full), "$muted"),
                     (f" {view.percent:3d} %", "bold")),
                line((fit(f" {view.stage}{left}   {_('Esc cancels')}", width), ""))]
