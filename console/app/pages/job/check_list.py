"""The list before work: what is looked at, a word for how it stands, and why. A click shows it
in full."""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from topdress.console.app.pages.job.checklist import LEVEL_WORDS, LOOK, OK, STOP, Check, worst
from topdress.console.app.widgets.panel import Panel, Part, fit, line, wrapped
from topdress.console.locale import _


# What goes on at the Job screen: the strip that is driven, refills, exports and where they lie.
class JobNote(NamedTuple):
    """text: one line. loud: something is asked of the operator, or goes on."""

    text: str
    loud: bool = False


class NotesView(NamedTuple):
    notes: tuple[JobNote, ...]
    refills: tuple[str, ...]


class JobNotes(Panel[NotesView]):
    def lines(self, view: NotesView, width: int, height: int) -> list[Content]:
        texts = [(row, note.loud) for note in view.notes for row in wrapped(note.text, width - 2)]
        # give way to what is new
        older = [text for text in texts if not text[1]][: max(0, len(texts) - height)]
        rows = [
            line((fit(f" {row}", width), "bold reverse" if loud else ""))
            for row, loud in texts
            if (row, loud) not in older
        ]
        room = height - len(rows)
        if view.refills and room > 1:
            rows.append(line((fit(f" {_('refills')}", width), "bold $primary")))
            shown = view.refills[: room - 1]
            if len(shown) < len(view.refills):
                more = len(view.refills) - len(shown) + 1
                shown = (*shown[:-1], _("+{count} more").format(count=more))
            rows += [line((fit(f"   {text}", width), "")) for text in shown]
        return rows


STYLES = {
    OK: "$muted",
    LOOK: "bold $on-alarm-amber on $alarm-amber",
    STOP: "bold $on-alarm-red on $alarm-red",
}
SYMBOLS = {OK: " ", LOOK: "!", STOP: "✖"}


MOST_ROWS = 2  # of one check
REST = " ... V"  # V shows the list in full


def with_room(checks: tuple[Check, ...], rows: int, cells: int = 1000) -> tuple[Check, ...]:
    """Those that are shown in so many rows, in their order, their texts in so many cells: where
    not all have room what is well gives way first, and one row says how many are left out."""
    need = [len(_texts(check, cells)) for check in checks]
    if sum(need) <= rows:
        return checks
    kept: set[int] = set()
    for k in sorted(range(len(checks)), key=lambda k: ((STOP, LOOK, OK).index(checks[k].level), k)):
        if sum(need[one] for one in kept) + need[k] <= rows - 1:
            kept.add(k)
    return tuple(check for k, check in enumerate(checks) if k in kept)


def _columns(checks: tuple[Check, ...]) -> tuple[int, int]:
    """Cells of the labels, and of the words that say how things stand."""
    return (
        max((cell_len(check.label) for check in checks), default=0) + 2,
        max(cell_len(_(text)) for text in LEVEL_WORDS.values()) + 4,
    )


def _texts(check: Check, room: int) -> list[str]:
    """What stands on its rows: no more of them than leave the other checks theirs; then the key
    to the rest."""
    rows = wrapped(check.text, room) or [""]
    if len(rows) <= MOST_ROWS:
        return rows
    return [*rows[: MOST_ROWS - 1], wrapped(rows[MOST_ROWS - 1], room - len(REST))[0] + REST]


def _more(check: Check) -> list[str]:
    return [text for text in check.full if text not in check.text] if check.level != OK else []


def rows_of(checks: tuple[Check, ...], width: int) -> int:
    """Rows in which everything stands."""
    room = max(8, width - sum(_columns(checks)) - 1)
    return 1 + sum(
        len(_texts(check, room)) + sum(len(wrapped(one, room)) for one in _more(check))
        for check in checks
    )


class CheckList(Panel[tuple[Check, ...]]):
    def lines(self, view: tuple[Check, ...], width: int, height: int) -> list[Content]:
        said = (
            {
                OK: _("all is well"),
                LOOK: _("work is possible: look at what is marked"),
                STOP: _("not ready for work"),
            }[worst(view)]
            if view
            else _("being read")
        )
        head: list[Part] = [(f" {_('before work')} ", "bold $primary"), (f" {said}", "bold")]
        label, word = _columns(view)
        rows = [line(*head)]
        room = max(8, width - label - word - 1)
        shown = with_room(view, height - 1, room)
        spare = (
            height - 1 - sum(len(_texts(check, room)) for check in shown) - (len(shown) < len(view))
        )
        for check in shown:
            for k, text in enumerate(_texts(check, room)):
                mark = f" {SYMBOLS[check.level]} {_(LEVEL_WORDS[check.level])}"
                rows.append(
                    line(
                        (fit(f" {check.label}" if not k else "", label), "$muted"),
                        (fit(mark if not k else "", word), STYLES[check.level] if not k else ""),
                        f" {text}",
                    )
                )
            for text in (row for one in _more(check) for row in wrapped(one, room)):
                if spare > 0:
                    rows.append(line(" " * (label + word), (f" {text}", "$muted")))
                    spare -= 1
        if len(shown) < len(view):
            left = _("+{count} more: V").format(count=len(view) - len(shown))
            rows.append(line((fit(f" {left}", width), "$muted")))
        return rows

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.run_action("app.do('job_details')")
