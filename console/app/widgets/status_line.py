"""The top row: state, strategy, source of the target, marks, time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from topdress.console.app.action import Action
from topdress.console.app.view import StatusView
from topdress.console.app.widgets.panel import (
    Panel,
    Part,
    at_cell,
    fit,
    in_row,
    line,
    spread,
    wrapped,
)
from topdress.console.locale import _


# Rows under the alarms: what the guided tour asks for, and how to skip or end it. The last row
# is clickable.
class TourView(NamedTuple):
    number: int
    of: int
    text: str


def ends(width: int) -> tuple[tuple[str, str, int], ...]:
    """What can be clicked: action id, text, first cell."""
    texts = ("tour_next", f" ^N {_('next')} "), ("tour_end", f" ^E {_('end the tour')} ")
    return in_row(texts, width - sum(cell_len(text) for _action, text in texts))


def rows_of(text: str, width: int) -> int:
    """Rows that the bar needs."""
    return max(1, len(wrapped(text, width - 2))) + 1


class TourBar(Panel[TourView | None]):
    def lines(self, view: TourView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        (_skip_id, skip, start), (_end_id, end, _start) = ends(width)
        style = "$background on $primary"
        lead = fit(f" {_('guided tour')} {view.number}/{view.of}", start)
        return [
            *(
                line((fit(f" {row}", width), f"bold {style}"))
                for row in wrapped(view.text, width - 2)
            ),
            line((lead, style), (skip, "bold reverse"), (end, "bold reverse")),
        ]

    def places(self) -> tuple[tuple[int, int], ...]:
        last = self.content_size.height - 1
        return (
            tuple((start, last) for _action, _text, start in ends(self.content_size.width))
            if self.view
            else ()
        )

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        action = (
            at_cell(ends(self.content_size.width), event.x)
            if event.y == self.content_size.height - 1
            else None
        )
        if action is not None:
            await self.run_action(f"app.do('{action}')")


# The row of pages with their F-keys, clickable; the one that is open stands out.
class PagesView(NamedTuple):
    """actions: those that open a page; where: the page that is open."""

    actions: tuple[Action, ...]
    where: str


class PageBar(Panel[PagesView]):
    def lines(self, view: PagesView, width: int, height: int) -> list[Content]:
        parts: list[Part] = [
            (text, "bold reverse" if name == f"{view.where}_screen" else "$muted")
            for name, text, _start in self._row(width)
        ]
        return [line(*parts)]

    def _row(self, width: int) -> tuple[tuple[str, str, int], ...]:
        """Ids of the actions that fit."""
        row = in_row(
            (action.id, f" {action.shown} {_(action.label)} ") for action in self.view.actions
        )
        return tuple(one for one in row if one[2] + cell_len(one[1]) <= width)

    def places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _name, _text, start in self._row(self.content_size.width))

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        name = at_cell(self._row(self.content_size.width), event.x)
        if name is not None:
            await self.run_action(f"app.do('{name}')")


GIVES_WAY: tuple[Callable[[StatusView], StatusView], ...] = (
    lambda view: view._replace(elapsed=""),
    lambda view: view._replace(clock=""),
    lambda view: view._replace(strategy=""),
    lambda view: view._replace(source=""),
)


def with_room(view: StatusView, width: int) -> StatusView:
    """What has room next to state and marks: whole words go, none is cut."""
    for without in GIVES_WAY:
        if _cells(view) <= width:
            break
        view = without(view)
    return view


def _cells(view: StatusView) -> int:
    """Of one row, blanks between its parts included."""
    chips = (view.lead, f"{view.symbol} {view.word}", view.silent, *view.marks)
    time = "  ".join(text for text in (view.elapsed, view.clock) if text)
    return (
        sum(cell_len(text) + 3 for text in chips if text)
        + sum(cell_len(text) + 2 for text in (view.strategy, view.source) if text)
        + (cell_len(time) + 1 if time else 0)
    )


class StatusLine(Panel[StatusView]):
    """One row; three where the page gives it so many: the state is read from outside the cab."""

    def lines(self, view: StatusView, width: int, height: int) -> list[Content]:
        state = view.state if view.state else "off"
        view = with_room(view, width)
        left: list[Part] = [(f" {view.lead} ", "bold reverse"), " "] if view.lead else []
        chip = (
            f"bold $on-state-{state} on $state-{state}"
            if not view.silent
            else "bold $background on $stale"
        )
        left += [(f" {view.symbol} {view.word} ", chip), " "]
        for word in (view.strategy, view.source):
            if word:
                left += [(f" {word} ", "$stale" if view.silent else "")]
        end: list[Part] = []
        if view.silent:
            end += [(f" {view.silent} ", "bold $on-alarm-red on $alarm-red"), " "]
        for mark in view.marks:
            end += [(f" {mark} ", "bold reverse"), " "]
        time = "  ".join(text for text in (view.elapsed, view.clock) if text)
        end += [(f"{time} ", "bold" if not view.silent else "$stale")] if time else []
        if height < 3:
            return [spread(left, end, width)]
        word = "  ".join(view.word) if view.word.isascii() else view.word
        chip_text = f"     {view.symbol}   {word}     "
        blank = " " * cell_len(chip_text)
        at = 2 if view.lead else 0
        return [
            line((blank, chip)),
            spread([(chip_text, chip), " ", *left[:at], *left[at + 2 :]], end, width),
            line((blank, chip)),
        ]
