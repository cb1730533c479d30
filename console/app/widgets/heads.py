"""The NDVI heads as small bars, the dropped ones marked, with the fused value that the decision used."""
from __future__ import annotations

from textual.content import Content

from console.app.view import Head, HeadsView
from console.app.widgets.panel import Panel, Part, fit, line, spread
from console.locale import _


def bar(share: float, width: int) -> tuple[str, str]:
    """The filled and the empty part of a bar of `width` cells: half as high as its row, so that bars stay apart."""
    full = round(max(0.0, min(1.0, share)) * width)
    return "▄" * full, "▁" * (width - full)


class HeadsPanel(Panel[HeadsView]):
    """A heading and three rows of two heads."""

    def lines(self, view: HeadsView, width: int, height: int) -> list[Content]:
        style = "$stale" if view.fused.stale else "bold"
        rows = [spread([(" NDVI ", "bold"), (view.fused.text, style)], [(f"{view.valid} ", "$muted")], width)]
        half = width // 2
        count = (len(view.heads) + 1) // 2
        for row in range(count):
            parts: list[Part] = []
            for head in (view.heads[row], view.heads[row + count]) if row + count < len(view.heads) else (
                    view.heads[row],):
                parts += self._head(head, half, view.fused.stale)
            rows.append(line(*parts))
        return rows

    @staticmethod
    def _head(head: Head, width: int, stale: bool) -> list[Part]:
        room = width - 11
        if head.dropped:
            word = f" ✖ {_('dropped')} "
            return [(f" {head.number} ", "bold $on-alarm-amber on $alarm-amber"), " ",
                    (fit(word, room), "$on-alarm-amber on $alarm-amber"), (f" {head.value:>5} ", "$stale")]
        style = "$stale" if stale else "$target"
        full, rest = bar(head.share or 0.0, room)
        return [(f" {head.number} ", "bold"), " ", (full, style), (rest, "$muted"),
                (f" {head.value:>5} ", "$stale" if stale else "")]

