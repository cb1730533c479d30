"""One row: what lies at a place of the map; what does not fit is left out from the end."""
from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content

from console.app.pages.map.reading import Reading
from console.app.widgets.panel import Panel, Part, line


class ReadingLine(Panel[Reading]):
    def lines(self, view: Reading, width: int, height: int) -> list[Content]:
        where = f" {view.where}"
        parts: list[Part] = [(where, "bold")]
        used = cell_len(where)
        for part in view.parts:
            label, text = f"   {part.label} ", part.text
            used += cell_len(label) + cell_len(text)
            if used > width:
                break
            parts += [(label, "$muted"), (text, "bold")]
        return [line(*parts)]
