"""The run that would tell rivals apart: why, its steps, how to go on."""

from __future__ import annotations

from typing import NamedTuple

from textual.content import Content
from topdress.console.app.widgets.panel import Panel, fit, line, wrapped
from topdress.console.locale import _


class PlanView(NamedTuple):
    why: str
    steps: tuple[str, ...]
    how: str
    language: str


class RunPlanPanel(Panel[PlanView]):
    def lines(self, view: PlanView, width: int, height: int) -> list[Content]:
        rows = [line((fit(f" {_('separating run')}", width), "bold $primary"))]
        rows += [line((f" {row}", "$muted")) for row in wrapped(view.why, width - 2)]
        for number, step in enumerate(view.steps, 1):
            rows += [
                line((f" {number}. {row}" if not k else f"    {row}", "bold"))
                for k, row in enumerate(wrapped(step, width - 5))
            ]
        return [*rows, *(line(f" {row}") for row in wrapped(view.how, width - 2))]
