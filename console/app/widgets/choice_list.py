"""One list for all questions: numbered lines, as many as there is room for around the marked one, a bar and a count
where there are more. A click marks."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.geometry import Size
from textual.message import Message

from console.app.widgets.panel import Panel, Picked, fit, line, right, wrapped
from console.locale import _


class Choice(NamedTuple):
    """why: why it cannot be taken now, and how it could be; empty where it can. A label may have several lines."""

    value: str
    label: str
    why: str = ""


class ChoicesView(NamedTuple):
    """at: which is marked, -1: none yet. now: the value in force. wrong: what was typed and is no number of a line."""

    choices: tuple[Choice, ...]
    at: int
    now: str
    wrong: str = ""


class ChoiceList(Panel[ChoicesView]):
    """Off lines, which cannot be taken, are muted. Posts Picked."""

    class Wheeled(Message):
        def __init__(self, lines: int) -> None:
            super().__init__()
            self.lines = lines

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        return len(self._rows(self.view, width)) + bool(self.view.wrong)

    def lines(self, view: ChoicesView, width: int, height: int) -> list[Content]:
        rows, first, room = self._window(view, width, height)
        scrolls = room < len(rows)
        shown = []
        bar = _bar(first, room, len(rows)) if scrolls else ()
        for row, (index, text) in enumerate(rows[first:first + room]):
            style = "bold $on-select on $select" if index == view.at else "$muted" if view.choices[index].why else ""
            shown.append(line((fit(text, width - scrolls), style), (bar[row], "$muted") if scrolls else ""))
        if view.wrong:
            said = _("no line {typed} here: 1 to {count}").format(typed=view.wrong, count=len(view.choices))
            shown.append(line((fit(f" ! {said}", width), "bold $on-alarm-red on $alarm-red")))
        elif scrolls:
            at = "--" if view.at < 0 else f"{view.at + 1}"
            shown.append(line((right(_("{at} of {count}").format(at=at, count=len(view.choices)), width), "$muted")))
        return shown

    def _rows(self, view: ChoicesView, width: int) -> list[tuple[int, str]]:
        """(which choice, text) of every row of the whole list."""
        digits = len(str(len(view.choices)))
        indent = 4 + digits
        found = []
        for index, choice in enumerate(view.choices):
            now = f"  ({_('now')})" if choice.value == view.now else ""
            label = f"({choice.label}: {choice.why})" if choice.why else f"{choice.label}{now}"
            head = f"{'>' if index == view.at else ' '} {index + 1:>{digits}}  "
            for text in label.split("\n"):
                whole = cell_len(text) <= width - indent - 1        # drawn lines keep their blanks
                for row in (text,) if whole else wrapped(text, width - indent - 1):
                    found.append((index, head + row))
                    head = " " * indent
        return found

    def _window(self, view: ChoicesView, width: int, height: int) -> tuple[list[tuple[int, str]], int, int]:
        """All rows, the first that is shown, and how many are: the marked one is among them with all its lines."""
        rows = self._rows(view, width)
        room = height if len(rows) + bool(view.wrong) <= height else height - 1
        marked = [row for row, (index, _text) in enumerate(rows) if index == max(0, view.at)]
        middle = (marked[0] + marked[-1]) // 2 if marked else 0
        return rows, max(0, min(middle - room // 2, len(rows) - room)), room

    def _shown(self) -> list[tuple[int, str]]:
        rows, first, room = self._window(self.view, *self.content_size)
        return rows[first:first + room]

    def places(self) -> tuple[tuple[int, int], ...]:
        shown = [index for index, _text in self._shown()]
        return tuple((0, shown.index(index)) for index in dict.fromkeys(shown))

    def on_click(self, event: events.Click) -> None:
        event.stop()
        shown = self._shown()
        if 0 <= event.y < len(shown):
            self.post_message(Picked(shown[event.y][0]))

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        event.stop()
        self.post_message(self.Wheeled(1))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        event.stop()
        self.post_message(self.Wheeled(-1))


def _bar(first: int, room: int, count: int) -> tuple[str, ...]:
    """A scroll bar of `room` cells: which part of `count` rows is shown."""
    length = max(1, room * room // count)
    top = round((room - length) * first / max(1, count - room))
    return tuple("█" if top <= row < top + length else "│" for row in range(room))
