"""The top row: state, strategy, source of the target, marks, time."""
from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content

from console.app.view import StatusView
from console.app.widgets.panel import Panel, Part, line, spread


class StatusLine(Panel[StatusView]):
    """One row; three where the page gives it so many: the state is read from outside the cab."""

    def lines(self, view: StatusView, width: int, height: int) -> list[Content]:
        state = view.state if view.state else "off"
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
        end += [(f"{view.elapsed}  {view.clock} ", "bold" if not view.silent else "$stale")]
        if height < 3:
            return [spread(left, end, width)]
        word = "  ".join(view.word) if view.word.isascii() else view.word
        chip_text = f"     {view.symbol}   {word}     "
        blank = " " * cell_len(chip_text)
        at = 2 if view.lead else 0
        return [line((blank, chip)), spread([(chip_text, chip), " ", *left[:at], *left[at + 2:]], end, width),
                line((blank, chip))]
