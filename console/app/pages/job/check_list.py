"""The list before work: what is looked at, a word for how it stands, and why. A click shows it in full."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.pages.job.day import LEVEL_WORDS, LOOK, OK, STOP, Check, worst
from console.app.widgets.panel import Panel, Part, fit, line
from console.locale import _

STYLES = {OK: "$muted", LOOK: "bold $on-alarm-amber on $alarm-amber", STOP: "bold $on-alarm-red on $alarm-red"}
SYMBOLS = {OK: " ", LOOK: "!", STOP: "✖"}


class ChecksView(NamedTuple):
    checks: tuple[Check, ...]
    language: str


class CheckList(Panel[ChecksView]):
    def lines(self, view: ChecksView, width: int, height: int) -> list[Content]:
        said = {OK: _("all is well"), LOOK: _("work is possible: look at what is marked"),
                STOP: _("not ready for work")}[worst(view.checks)]
        head: list[Part] = [(f" {_('before work')} ", "bold $primary"), (f" {said}", "bold")]
        label = max((cell_len(check.label) for check in view.checks), default=0) + 2
        word = max(cell_len(_(text)) for text in LEVEL_WORDS.values()) + 4
        rows = [line(*head)]
        spare = height - 1 - len(view.checks)
        for check in view.checks:
            rows.append(line((fit(f" {check.label}", label), "$muted"),
                             (fit(f" {SYMBOLS[check.level]} {_(LEVEL_WORDS[check.level])}", word), STYLES[check.level]),
                             (fit(f" {check.text}", width - label - word), "")))
            more = [text for text in check.full if text not in check.text] if check.level != OK else []
            for text in more[:max(0, spare)]:
                rows.append(line(" " * (label + word), (fit(f" {text}", width - label - word), "$muted")))
            spare -= len(more)
        return rows

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.run_action("app.do('job_details')")
