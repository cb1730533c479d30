"""The row above the plots: how long a span is seen, and whether it runs or stands."""
from __future__ import annotations

from typing import NamedTuple

from textual.content import Content

from console.app.widgets.panel import Panel, spread


class SpanView(NamedTuple):
    span: str
    states: tuple[str, ...]
    standing: bool


class SpanBar(Panel[SpanView]):
    def lines(self, view: SpanView, width: int, height: int) -> list[Content]:
        style = "bold reverse" if view.standing else "$muted"
        return [spread([(f" {view.span} ", "bold")], [(f" {'   '.join(view.states)} ", style)], width)]
