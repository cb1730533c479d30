"""Data to diagnose, newest first: a row a file. A click chooses, a second one on the same row begins."""
from __future__ import annotations

from typing import NamedTuple

from textual import events
from textual.content import Content
from textual.message import Message

from console.app.pages.diagnosis.service import DiagnosisSource
from console.app.pages.diagnosis.words import KINDS
from console.app.widgets.panel import Panel, fit, line, right
from console.locale import _

HEAD_ROWS = 2


class SourcesView(NamedTuple):
    sources: tuple[DiagnosisSource, ...]
    at: int
    looking: bool               # True while the folders are read
    language: str


def first_row(at: int, count: int, room: int) -> int:
    """First file shown so that the chosen one is in sight."""
    return max(0, min(at - room // 2, count - room))


class SourceList(Panel[SourcesView]):
    class Picked(Message):
        def __init__(self, index: int) -> None:
            super().__init__()
            self.index = index

    def lines(self, view: SourcesView, width: int, height: int) -> list[Content]:
        rows = [line((fit(f" {_('Which data is to be checked?')}", width), "bold $primary"))]
        if not view.sources:
            said = _("reading the folders") if view.looking else _("no log or table here; / types a path")
            return [*rows, line((f" {said}", "$muted"))]
        rows.append(line((self._row(_("changed"), _("kind"), _("size"), _("file"), width), "$muted")))
        room = max(1, height - HEAD_ROWS)
        first = first_row(view.at, len(view.sources), room)
        for index, source in enumerate(view.sources[first:first + room], first):
            mark = f"  < {_('now')}" if source.working else ""
            text = self._row(source.changed, _(KINDS.get(source.kind, source.kind)), source.size, source.name + mark,
                             width, ">" if index == view.at else " ")
            rows.append(line((text, "bold $on-select on $select" if index == view.at else "")))
        return rows

    @staticmethod
    def _row(changed: str, kind: str, size: str, name: str, width: int, mark: str = " ") -> str:
        return fit(f"{mark}{fit(changed, 17)} {fit(kind, 13)} {right(size, 9)}  {name}", width)

    def places(self) -> tuple[tuple[int, int], ...]:
        shown = min(len(self.view.sources), max(1, self.content_size.height - HEAD_ROWS))
        return tuple((0, HEAD_ROWS + row) for row in range(shown))

    def on_click(self, event: events.Click) -> None:
        event.stop()
        room = max(1, self.content_size.height - HEAD_ROWS)
        index = first_row(self.view.at, len(self.view.sources), room) + event.y - HEAD_ROWS
        if event.y >= HEAD_ROWS and index < len(self.view.sources):
            self.post_message(self.Picked(index))
