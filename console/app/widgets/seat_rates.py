"""Target and applied rate, to be read from the seat, where a page shows something else: stacked, or in a strip."""
from __future__ import annotations

from textual.content import Content

from console.app.digits import ROWS, draw, largest
from console.app.view import RatesView
from console.app.widgets.panel import Panel, Part, fit, line, solid
from console.locale import _


class SeatRates(Panel[RatesView]):
    """A strip of 4 rows, or 12 rows where there is the height."""

    def lines(self, view: RatesView, width: int, height: int) -> list[Content]:
        stacked = height >= 2 * (1 + ROWS[2])
        each = width if stacked else width // 2
        scale = largest((view.target.text, view.applied.text), each, height // 2 - 1 if stacked else height - 1)
        error = f"  {view.error.text}" if view.error.text != "--" else ""
        loud = view.level and not view.error.stale
        level = f"bold $on-alarm-{view.level} on $alarm-{view.level}" if loud else "$muted"
        parts: list[list[list[Part]]] = []
        for shown, label, colour, end in ((view.target, _("target"), "$target", ""),
                                          (view.applied, _("applied"), "$applied", error)):
            name = f" {label} {view.unit}"
            head: list[Part] = [(fit(name, each - len(end)), f"bold {colour}"), (end, level)]
            body: list[list[Part]] = [[" ", *solid(fit(row, each - 1), "$stale" if shown.stale else colour)]
                    for row in draw(shown.text, scale)]
            parts.append([head, *body])
        if stacked:
            return [line(*row) for part in parts for row in part]
        return [line(*left, *right) for left, right in zip(*parts, strict=True)]
