"""Draws the list of all questions: numbered entries around the marked entry, and a bar with a count
where more exist. A click marks.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.geometry import Size
from textual.message import Message
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.map_ink import draw_small_map
from topdress.console.app.widgets.base_panel import (
    PickList,
    align_text_right,
    fit_text_width,
    make_line,
    wrap_text,
)
from topdress.console.locale import _

# Columns and rows of a field's picture, and blanks between picture and label.
THUMBNAIL_CELLS, THUMBNAIL_GAP_CELLS = (9, 4), 2


class Choice(NamedTuple):
    """Holds one entry.

    Attributes
    ----------
    value
        Answer of the dialog.
    label
        Text of one or more lines.
    why
        Reason why the entry is impossible now, with a remedy; "" where it is possible.
    picture
        Field drawn next to the label.
    """

    value: str
    label: str
    why: str = ""
    picture: FieldPicture | None = None


class _ChoiceRow(NamedTuple):
    """Holds one row; `choice` is the index of its entry, `drawn` a row of its picture."""

    choice: int
    head: str
    drawn: list[tuple[str, str]]
    text: str


class ChoicesView(NamedTuple):
    """Holds a list.

    Attributes
    ----------
    at
        Index of the marked entry; -1 means none.
    now
        Value in force.
    wrong
        Typed number that no entry has.
    """

    choices: tuple[Choice, ...]
    at: int
    now: str
    wrong: str = ""


class ChoiceList(PickList[ChoicesView]):
    """Shows the list; impossible entries are muted."""

    def __init__(self, view: ChoicesView, *, id: str | None = None) -> None:
        super().__init__(view, id=id)
        # Pictures are drawn once per theme, because drawing costs more than scrolling.
        self._thumbs: dict[object, list[list[tuple[str, str]]]] = {}

    class Wheeled(Message):
        """Reports a turn of the mouse wheel by lines."""

        def __init__(self, lines: int) -> None:
            super().__init__()
            self.lines = lines

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """Return the number of rows of the whole list."""
        return len(self._make_rows(self.view, width)) + bool(self.view.wrong)

    def draw_rows(self, view: ChoicesView, width: int, height: int) -> list[Content]:
        # The window moves with the mark, so no scrolling state is needed.
        rows, first, room = self._find_window(view, width, height)
        scrolls = room < len(rows)
        shown = []
        bar = _draw_scroll_bar(first, room, len(rows)) if scrolls else ()
        for place, (index, head, drawn, text) in enumerate(rows[first : first + room]):
            style = (
                "bold $on-select on $select"
                if index == view.at
                else "$muted"
                if view.choices[index].why
                else ""
            )
            on_mark = index == view.at
            shown.append(
                make_line(
                    (head, style),
                    *(
                        # The mark colours the row, except cells of the picture that have a
                        # background.
                        (cell, style if not own or (on_mark and " on " not in own) else own)
                        for cell, own in drawn
                    ),
                    (
                        fit_text_width(text, max(0, width - scrolls - cell_len(head) - len(drawn))),
                        style,
                    ),
                    (bar[place], "$muted") if scrolls else "",
                )
            )
        # The reason replaces the count, because both need the last row.
        if view.wrong:
            said = _("no line {typed} here: 1 to {count}").format(
                typed=view.wrong, count=len(view.choices)
            )
            shown.append(
                make_line((fit_text_width(f" ! {said}", width), "bold $on-alarm-red on $alarm-red"))
            )
        elif scrolls:
            at = "--" if view.at < 0 else f"{view.at + 1}"
            shown.append(
                make_line(
                    (
                        align_text_right(
                            _("{at} of {count}").format(at=at, count=len(view.choices)), width
                        ),
                        "$muted",
                    )
                )
            )
        return shown

    def _make_rows(self, view: ChoicesView, width: int) -> list[_ChoiceRow]:
        """Return every row of the whole list."""
        # Numbers are aligned right, so that labels begin in one column.
        digits = len(str(len(view.choices)))
        indent = 4 + digits
        blank: list[tuple[str, str]] = []
        if any(choice.picture is not None for choice in view.choices):
            # Entries without a picture are indented like those with one.
            blank = [(" ", "")] * (THUMBNAIL_CELLS[0] + THUMBNAIL_GAP_CELLS)
        room = width - indent - len(blank) - 1
        found = []
        for index, choice in enumerate(view.choices):
            now = f"  ({_('now')})" if choice.value == view.now else ""
            label = f"({choice.label}: {choice.why})" if choice.why else f"{choice.label}{now}"
            head = f"{'>' if index == view.at else ' '} {index + 1:>{digits}}  "
            # Explicit line breaks of a label are kept.
            texts = [row for text in label.split("\n") for row in wrap_text(text, room)]
            for drawn, text in zip_longest(self._draw_thumb(choice.picture), texts):
                found.append(
                    _ChoiceRow(
                        index,
                        head,
                        blank if drawn is None else [*drawn, *blank[THUMBNAIL_CELLS[0] :]],
                        text or "",
                    )
                )
                # Only the first row of an entry has its number.
                head = " " * indent
        return found

    def _draw_thumb(self, picture: FieldPicture | None) -> list[list[tuple[str, str]]]:
        """Return the rows of a field's picture, from the cache."""
        # The colours of a picture depend on the theme.
        key = picture, self.app.theme
        if key not in self._thumbs:
            self._thumbs[key] = draw_small_map(self, picture, *THUMBNAIL_CELLS)
        return self._thumbs[key]

    def _find_window(
        self, view: ChoicesView, width: int, height: int
    ) -> tuple[list[_ChoiceRow], int, int]:
        """Return all rows, the first visible row and the number of visible rows, such that the
        marked entry is visible with all its lines."""
        rows = self._make_rows(view, width)
        room = height if len(rows) + bool(view.wrong) <= height else height - 1
        marked = [row for row, (index, *_rest) in enumerate(rows) if index == max(0, view.at)]
        middle = (marked[0] + marked[-1]) // 2 if marked else 0
        return rows, max(0, min(middle - room // 2, len(rows) - room)), room

    def list_row_items(self) -> Sequence[int | None]:
        """Return the index of the entry of each visible row."""
        rows, first, room = self._find_window(self.view, *self.content_size)
        return [row.choice for row in rows[first : first + room]]

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Scroll down."""
        event.stop()
        self.post_message(self.Wheeled(1))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Scroll up."""
        event.stop()
        self.post_message(self.Wheeled(-1))


def _draw_scroll_bar(first: int, room: int, count: int) -> tuple[str, ...]:
    """Return a scroll bar of `room` cells for the visible part of `count` rows."""
    length = max(1, room * room // count)
    top = round((room - length) * first / max(1, count - room))
    return tuple("█" if top <= row < top + length else "│" for row in range(room))
