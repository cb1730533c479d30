"""Shows the plan of the separating run: its reason, its steps, and how to proceed."""

from __future__ import annotations

from typing import NamedTuple

from textual.content import Content
from topdress.console.app.widgets.base_panel import Panel, fit_text_width, make_line, wrap_text
from topdress.console.locale import _


class PlanView(NamedTuple):
    """Holds the plan."""

    why: str
    steps: tuple[str, ...]
    how: str
    language: str


class RunPlanPanel(Panel[PlanView]):
    """Shows the plan."""

    def draw_rows(self, view: PlanView, width: int, height: int) -> list[Content]:
        rows = [make_line((fit_text_width(f" {_('separating run')}", width), "bold $primary"))]
        rows += [make_line((f" {row}", "$muted")) for row in wrap_text(view.why, width - 2)]
        for number, step in enumerate(view.steps, 1):
            rows += [
                make_line((f" {number}. {row}" if not k else f"    {row}", "bold"))
                for k, row in enumerate(wrap_text(step, width - 5))
            ]
        return [*rows, *(make_line(f" {row}") for row in wrap_text(view.how, width - 2))]
