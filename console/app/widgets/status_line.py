"""Shows the top row: state, strategy, source of the target, marks, time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from topdress.console.app.action import Action
from topdress.console.app.panel_views import StatusView
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    find_at_cell,
    fit_text_width,
    make_line,
    place_in_row,
    spread_parts,
    wrap_text,
)
from topdress.console.locale import _


# The rows below the alarms show the request of the guided tour, and how to skip or end the tour.
# The last row is clickable.
class TourView(NamedTuple):
    """Holds a step of the tour."""

    number: int
    of: int
    text: str


def place_tour_keys(width: int) -> tuple[tuple[str, str, int], ...]:
    """Return the clickable keys: action id, text, first cell."""
    texts = ("tour_next", f" ^N {_('next')} "), ("tour_end", f" ^E {_('end the tour')} ")
    return place_in_row(texts, width - sum(cell_len(text) for _action, text in texts))


def count_tour_rows(text: str, width: int) -> int:
    """Return the number of rows that the bar needs."""
    return max(1, len(wrap_text(text, width - 2))) + 1


class TourBar(Panel[TourView | None]):
    """Shows a step of the tour."""

    def draw_rows(self, view: TourView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        (_skip_id, skip, start), (_end_id, end, _start) = place_tour_keys(width)
        style = "$background on $primary"
        # The number of the step shows how long the tour still takes.
        lead = fit_text_width(f" {_('guided tour')} {view.number}/{view.of}", start)
        return [
            *(
                make_line((fit_text_width(f" {row}", width), f"bold {style}"))
                for row in wrap_text(view.text, width - 2)
            ),
            make_line((lead, style), (skip, "bold reverse"), (end, "bold reverse")),
        ]

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        last = self.content_size.height - 1
        return (
            tuple(
                (start, last) for _action, _text, start in place_tour_keys(self.content_size.width)
            )
            if self.view
            else ()
        )

    async def on_click(self, event: events.Click) -> None:
        """Skip a step, or end the tour."""
        event.stop()
        action = (
            find_at_cell(place_tour_keys(self.content_size.width), event.x)
            # Only the last row has keys.
            if event.y == self.content_size.height - 1
            else None
        )
        if action is not None:
            await self.run_action(f"app.do('{action}')")


# The row lists the pages with their F-keys, clickable; the open page is inverted.
class PagesView(NamedTuple):
    """Holds the pages: actions that open a page, and the open page."""

    actions: tuple[Action, ...]
    where: str


class PageBar(Panel[PagesView]):
    """Shows the pages with their keys."""

    def draw_rows(self, view: PagesView, width: int, height: int) -> list[Content]:
        parts: list[TextPart] = [
            (text, "bold reverse" if name == f"{view.where}_screen" else "$muted")
            # The open page is inverted.
            for name, text, _start in self._place_pages(width)
        ]
        return [make_line(*parts)]

    def _place_pages(self, width: int) -> tuple[tuple[str, str, int], ...]:
        """Return id, text and first cell of the pages that fit."""
        row = place_in_row(
            (action.id, f" {action.shown} {_(action.label)} ") for action in self.view.actions
        )
        return tuple(one for one in row if one[2] + cell_len(one[1]) <= width)

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        return tuple(
            (start, 0) for _name, _text, start in self._place_pages(self.content_size.width)
        )

    async def on_click(self, event: events.Click) -> None:
        """Open the clicked page."""
        event.stop()
        name = find_at_cell(self._place_pages(self.content_size.width), event.x)
        if name is not None:
            await self.run_action(f"app.do('{name}')")


# Parts that are dropped in this order where the row is too short; state and marks always stay.
STATUS_SHORTENINGS: tuple[Callable[[StatusView], StatusView], ...] = (
    lambda view: view._replace(elapsed=""),
    lambda view: view._replace(clock=""),
    lambda view: view._replace(strategy=""),
    lambda view: view._replace(source=""),
)


def fit_status(view: StatusView, width: int) -> StatusView:
    """Return the parts that fit next to state and marks: whole words are dropped, none is cut."""
    for without in STATUS_SHORTENINGS:
        if _count_status_cells(view) <= width:
            break
        view = without(view)
    return view


def _count_status_cells(view: StatusView) -> int:
    """Return the cells of the row, including blanks between its parts."""
    # Parts with a background need a blank on each side.
    chips = (view.lead, f"{view.symbol} {view.word}", view.silent, *view.marks)
    time = "  ".join(text for text in (view.elapsed, view.clock) if text)
    return (
        sum(cell_len(text) + 3 for text in chips if text)
        + sum(cell_len(text) + 2 for text in (view.strategy, view.source) if text)
        + (cell_len(time) + 1 if time else 0)
    )


class StatusLine(Panel[StatusView]):
    """Shows one row, or three where the page provides them: then the state is readable from outside
    the cab."""

    def draw_rows(self, view: StatusView, width: int, height: int) -> list[Content]:
        state = view.state if view.state else "off"
        view = fit_status(view, width)
        left: list[TextPart] = [(f" {view.lead} ", "bold reverse"), " "] if view.lead else []
        chip = (
            f"bold $on-state-{state} on $state-{state}"
            # Without values the state is grey: it may have changed.
            if not view.silent
            else "bold $background on $stale"
        )
        left += [(f" {view.symbol} {view.word} ", chip), " "]
        for word in (view.strategy, view.source):
            if word:
                left += [(f" {word} ", "$stale" if view.silent else "")]
        end: list[TextPart] = []
        if view.silent:
            end += [(f" {view.silent} ", "bold $on-alarm-red on $alarm-red"), " "]
        for mark in view.marks:
            end += [(f" {mark} ", "bold reverse"), " "]
        time = "  ".join(text for text in (view.elapsed, view.clock) if text)
        end += [(f"{time} ", "bold" if not view.silent else "$stale")] if time else []
        if height < 3:
            return [spread_parts(left, end, width)]
        # Letters with gaps look larger; Chinese characters already have the width of two cells.
        word = "  ".join(view.word) if view.word.isascii() else view.word
        chip_text = f"     {view.symbol}   {word}     "
        blank = " " * cell_len(chip_text)
        at = 2 if view.lead else 0
        return [
            make_line((blank, chip)),
            spread_parts([(chip_text, chip), " ", *left[:at], *left[at + 2 :]], end, width),
            make_line((blank, chip)),
        ]
