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


def with_room(checks: tuple[Check, ...], rows: int) -> tuple[Check, ...]:
    """Those that are shown in so many rows, in their order: where not all have room what is well gives way first, and
    one row says how many are left out."""
    if len(checks) <= rows:
        return checks
    ranked = sorted(range(len(checks)), key=lambda k: ((STOP, LOOK, OK).index(checks[k].level), k))
    kept = set(ranked[:max(0, rows - 1)])
    return tuple(check for k, check in enumerate(checks) if k in kept)


class CheckList(Panel[ChecksView]):
    def lines(self, view: ChecksView, width: int, height: int) -> list[Content]:
        said = {OK: _("all is well"), LOOK: _("work is possible: look at what is marked"),
                STOP: _("not ready for work")}[worst(view.checks)] if view.checks else _("being read")
        head: list[Part] = [(f" {_('before work')} ", "bold $primary"), (f" {said}", "bold")]
        label = max((cell_len(check.label) for check in view.checks), default=0) + 2
        word = max(cell_len(_(text)) for text in LEVEL_WORDS.values()) + 4
        rows = [line(*head)]
        shown = with_room(view.checks, height - 1)
        spare = height - 1 - len(shown) - (len(shown) < len(view.checks))
        for check in shown:
            rows.append(line((fit(f" {check.label}", label), "$muted"),
                             (fit(f" {SYMBOLS[check.level]} {_(LEVEL_WORDS[check.level])}", word), STYLES[check.level]),
                             (fit(f" {check.text}", width - label - word), "")))
            more = [text for text in check.full if text not in check.text] if check.level != OK else []
            for text in more[:max(0, spare)]:
                rows.append(line(" " * (label + word), (fit(f" {text}", width - label - word), "$muted")))
            spare -= len(more)
        if len(shown) < len(view.checks):
            left = _("+{count} more").format(count=len(view.checks) - len(shown))
            rows.append(line((fit(f" {left}", width), "$muted")))
        return rows

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.run_action("app.do('job_details')")
