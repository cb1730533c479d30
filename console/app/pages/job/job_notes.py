"""What goes on at the Job screen: the strip that is driven, refills, exports and where they lie."""
from __future__ import annotations

from typing import NamedTuple

from textual.content import Content

from console.app.widgets.panel import Panel, fit, line, wrapped
from console.locale import _


class JobNote(NamedTuple):
    """text: one line. loud: something is asked of the operator, or goes on."""

    text: str
    loud: bool = False


class NotesView(NamedTuple):
    notes: tuple[JobNote, ...]
    refills: tuple[str, ...]


class JobNotes(Panel[NotesView]):
    def lines(self, view: NotesView, width: int, height: int) -> list[Content]:
        texts = [(row, note.loud) for note in view.notes for row in wrapped(note.text, width - 2)]
        older = [text for text in texts if not text[1]][:max(0, len(texts) - height)]       # give way to what is new
        rows = [line((fit(f" {row}", width), "bold reverse" if loud else "")) for row, loud in texts
                if (row, loud) not in older]
        room = height - len(rows)
        if view.refills and room > 1:
            rows.append(line((fit(f" {_('refills')}", width), "bold $primary")))
            shown = view.refills[:room - 1]
            if len(shown) < len(view.refills):
                more = len(view.refills) - len(shown) + 1
                shown = (*shown[:-1], _("+{count} more").format(count=more))
            rows += [line((fit(f"   {text}", width), "")) for text in shown]
        return rows
