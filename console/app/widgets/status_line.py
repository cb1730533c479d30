"""The top row: state, strategy, source of the target, marks, time."""
from __future__ import annotations

from textual.content import Content

from console.app.view import StatusView
from console.app.widgets.panel import Panel, Part, spread


class StatusLine(Panel[StatusView]):
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
        return [spread(left, end, width)]
