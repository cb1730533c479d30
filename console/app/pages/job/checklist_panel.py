"""Draws the list of checks before work: subject, word for its state, reason. A click shows the list
in full.
"""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from topdress.console.app.pages.job.checklist import (
    LEVEL_WORDS,
    LOOK,
    OK,
    STOP,
    JobCheck,
    find_worst_level,
)
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    fit_text_width,
    make_line,
    wrap_text,
)
from topdress.console.locale import _


# Notes report events of the Job screen: strip in progress, refills, exports and their paths.
class JobNote(NamedTuple):
    """Holds a note of one line; `loud` marks a question to the operator, or work in progress."""

    text: str
    loud: bool = False


class NotesView(NamedTuple):
    """Holds notes and refills."""

    notes: tuple[JobNote, ...]
    refills: tuple[str, ...]


class JobNotes(Panel[NotesView]):
    """Shows notes and refills."""

    def draw_rows(self, view: NotesView, width: int, height: int) -> list[Content]:
        texts = [(row, note.loud) for note in view.notes for row in wrap_text(note.text, width - 2)]
        # Where rows are scarce, quiet notes are dropped before loud notes.
        older = [text for text in texts if not text[1]][: max(0, len(texts) - height)]
        rows = [
            make_line((fit_text_width(f" {row}", width), "bold reverse" if loud else ""))
            for row, loud in texts
            if (row, loud) not in older
        ]
        room = height - len(rows)
        if view.refills and room > 1:
            rows.append(make_line((fit_text_width(f" {_('refills')}", width), "bold $primary")))
            shown = view.refills[: room - 1]
            if len(shown) < len(view.refills):
                more = len(view.refills) - len(shown) + 1
                shown = (*shown[:-1], _("+{count} more").format(count=more))
            rows += [make_line((fit_text_width(f"   {text}", width), "")) for text in shown]
        return rows


# Green would suggest safety that the console cannot promise, so "ok" is muted.
LEVEL_STYLES = {
    OK: "$muted",
    LOOK: "bold $on-alarm-amber on $alarm-amber",
    STOP: "bold $on-alarm-red on $alarm-red",
}
LEVEL_SYMBOLS = {OK: " ", LOOK: "!", STOP: "✖"}


# Rows of a single check in the list.
MAX_CHECK_ROWS = 2
# Sign of a shortened text; key V shows the list in full.
TRUNCATION_MARK = " ... V"


def fit_checks(checks: tuple[JobCheck, ...], rows: int, cells: int = 1000) -> tuple[JobCheck, ...]:
    """Return the checks that fit into the rows, in their order. Checks that are ok are dropped
    first, and one row reports the number of dropped checks.

    Parameters
    ----------
    checks
        All checks.
    rows, cells
        Size of the list, and width of a text, in terminal cells.
    """
    # A long text needs two rows.
    need = [len(_wrap_check(check, cells)) for check in checks]
    if sum(need) <= rows:
        return checks
    kept: set[int] = set()
    # Stops come first, then warnings, then checks that are ok.
    for k in sorted(range(len(checks)), key=lambda k: ((STOP, LOOK, OK).index(checks[k].level), k)):
        if sum(need[one] for one in kept) + need[k] <= rows - 1:
            kept.add(k)
    return tuple(check for k, check in enumerate(checks) if k in kept)


def _find_column_widths(checks: tuple[JobCheck, ...]) -> tuple[int, int]:
    """Return the cells of the labels and of the words of the levels."""
    return (
        max((cell_len(check.label) for check in checks), default=0) + 2,
        max(cell_len(_(text)) for text in LEVEL_WORDS.values()) + 4,
    )


def _wrap_check(check: JobCheck, room: int) -> list[str]:
    """Return the rows of a check; a long text ends with the key that shows the list in full."""
    rows = wrap_text(check.text, room) or [""]
    if len(rows) <= MAX_CHECK_ROWS:
        return rows
    return [
        *rows[: MAX_CHECK_ROWS - 1],
        wrap_text(rows[MAX_CHECK_ROWS - 1], room - len(TRUNCATION_MARK))[0] + TRUNCATION_MARK,
    ]


def _list_more_texts(check: JobCheck) -> list[str]:
    """Return the further texts of a check that is not ok."""
    return [text for text in check.full if text not in check.text] if check.level != OK else []


def count_check_rows(checks: tuple[JobCheck, ...], width: int) -> int:
    """Return the number of rows that show everything."""
    # Eight cells are the shortest useful text.
    room = max(8, width - sum(_find_column_widths(checks)) - 1)
    return 1 + sum(
        len(_wrap_check(check, room))
        + sum(len(wrap_text(one, room)) for one in _list_more_texts(check))
        for check in checks
    )


class CheckList(Panel[tuple[JobCheck, ...]]):
    """Shows the checks."""

    def draw_rows(self, view: tuple[JobCheck, ...], width: int, height: int) -> list[Content]:
        said = (
            {
                OK: _("all is well"),
                LOOK: _("work is possible: look at what is marked"),
                STOP: _("not ready for work"),
            }[find_worst_level(view)]
            if view
            else _("being read")
        )
        head: list[TextPart] = [(f" {_('before work')} ", "bold $primary"), (f" {said}", "bold")]
        label, word = _find_column_widths(view)
        rows = [make_line(*head)]
        room = max(8, width - label - word - 1)
        # One row is the heading.
        shown = fit_checks(view, height - 1, room)
        spare = (
            height
            - 1
            - sum(len(_wrap_check(check, room)) for check in shown)
            - (len(shown) < len(view))
        )
        for check in shown:
            for k, text in enumerate(_wrap_check(check, room)):
                mark = f" {LEVEL_SYMBOLS[check.level]} {_(LEVEL_WORDS[check.level])}"
                rows.append(
                    make_line(
                        (fit_text_width(f" {check.label}" if not k else "", label), "$muted"),
                        (
                            fit_text_width(mark if not k else "", word),
                            LEVEL_STYLES[check.level] if not k else "",
                        ),
                        f" {text}",
                    )
                )
            for text in (row for one in _list_more_texts(check) for row in wrap_text(one, room)):
                if spare > 0:
                    rows.append(make_line(" " * (label + word), (f" {text}", "$muted")))
                    spare -= 1
        if len(shown) < len(view):
            left = _("+{count} more: V").format(count=len(view) - len(shown))
            rows.append(make_line((fit_text_width(f" {left}", width), "$muted")))
        return rows

    async def on_click(self, event: events.Click) -> None:
        """Show the list in full."""
        event.stop()
        await self.run_action("app.do('job_details')")
