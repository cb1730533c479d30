"""The top row: state, strategy, source of the target, marks, time."""
from __future__ import annotations

from collections.abc import Callable

from rich.cells import cell_len
from textual.content import Content

from console.app.view import StatusView
from console.app.widgets.panel import Panel, Part, line, spread

GIVES_WAY: tuple[Callable[[StatusView], StatusView], ...] = (
    lambda view: view._replace(elapsed=""), lambda view: view._replace(clock=""),
    lambda view: view._replace(strategy=""), lambda view: view._replace(source=""))


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
    return sum(cell_len(text) + 3 for text in chips if text) + sum(
        cell_len(text) + 2 for text in (view.strategy, view.source) if text) + (cell_len(time) + 1 if time else 0)


class StatusLine(Panel[StatusView]):
    """One row; three where the page gives it so many: the state is read from outside the cab."""

    def lines(self, view: StatusView, width: int, height: int) -> list[Content]:
        state = view.state if view.state else "off"
        view = with_room(view, width)
        left: list[Part] = [(f" {view.lead} ", "bold reverse"), " "] if view.lead else []
        chip = f"bold $on-state-{state} on $state-{state}" if not view.silent else "bold $background on $stale"
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
        return [line((blank, chip)), spread([(chip_text, chip), " ", *left[:at], *left[at + 2:]], end, width),
                line((blank, chip))]
