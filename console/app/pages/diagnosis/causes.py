"""Shows every cause: name, size, probability, alternatives, cost. One cause is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.base_panel import PickList, fit_text_width, make_line, wrap_text
from topdress.console.locale import _


class CauseLine(NamedTuple):
    """Holds one cause in words."""

    title: str
    size: str
    sure: str
    rivals: str
    cost: str
    advice: str
    # Low, value and high as shares of the bar, -1 to 1.
    interval: tuple[float, float, float] | None
    # Title and probability of each of several causes that the data cannot separate.
    tied: tuple[tuple[str, str], ...] = ()


class CausesView(NamedTuple):
    """Holds the causes."""

    causes: tuple[CauseLine, ...]
    at: int
    # Text that replaces the list if no cause was found.
    calm: tuple[str, ...]
    language: str


# Width of the bar of an interval, in cells.
INTERVAL_BAR_CELLS = 24


def draw_interval_bar(interval: tuple[float, float, float]) -> str:
    """Draw an interval of -1 to 1 on `INTERVAL_BAR_CELLS` cells: `|` is zero, `=` the interval, `#`
    the value."""

    def find_cell(share: float) -> int:
        return round((share + 1.0) / 2.0 * (INTERVAL_BAR_CELLS - 1))

    low, value, high = map(find_cell, interval)
    marks = ["."] * INTERVAL_BAR_CELLS
    for at in range(low, high + 1):
        marks[at] = "="
    marks[find_cell(0.0)] = "|"
    marks[value] = "#"
    return "".join(marks)


class CauseList(PickList[CausesView]):
    """Shows the causes."""

    def __init__(self, view: CausesView, *, id: str | None = None) -> None:
        super().__init__(view, id=id)
        self._row_of: list[int | None] = []

    def draw_rows(self, view: CausesView, width: int, height: int) -> list[Content]:
        rows = [make_line((fit_text_width(f" {_('causes')}", width), "bold $primary"))]
        self._row_of = [None]
        if not view.causes:
            return [
                *rows,
                *(make_line(f" {row}") for text in view.calm for row in wrap_text(text, width - 2)),
            ]
        blocks = [
            self._draw_cause(cause, index == view.at, width)
            for index, cause in enumerate(view.causes)
        ]
        # The chosen cause is shown whole; the others lose rows until all titles fit.
        shown: list[list[Content]] = []
        for index, block in enumerate(blocks):
            left = height - 1 - sum(map(len, shown)) - (len(blocks) - index - 1)
            shown.append(block if index == view.at else block[: max(1, min(len(block), left))])
        room = height - 1
        while sum(map(len, shown)) > room and any(
            len(b) > 1 for k, b in enumerate(shown) if k != view.at
        ):
            longest = max(
                (k for k in range(len(shown)) if k != view.at), key=lambda k: len(shown[k])
            )
            shown[longest] = shown[longest][:-1]
        for index, block in enumerate(shown):
            rows += block
            self._row_of += [index] * len(block)
        return rows

    def _draw_cause(self, cause: CauseLine, chosen: bool, width: int) -> list[Content]:
        """Return the lines of one cause."""
        label = (
            max(
                cell_len(word) for word in (_("size"), _("sure"), _("or else"), _("costs"), _("do"))
            )
            + 5
        )
        mark = ">" if chosen else " "
        heads = wrap_text(cause.title, width - 4)
        block = [
            make_line(
                (
                    fit_text_width(f" {mark if not k else ' '} {head}", width),
                    "bold $on-select on $select" if chosen else "bold",
                )
            )
            for k, head in enumerate(heads)
        ]

        def add_row(name: str, text: str, style: str = "") -> None:
            for k, part in enumerate(wrap_text(text, width - label)):
                block.append(
                    make_line(
                        (fit_text_width(f"   {name}" if not k else "", label), "$muted"),
                        (part, style),
                    )
                )

        for name, sure in cause.tied:
            for k, part in enumerate(wrap_text(name, width - 14)):
                block.append(
                    make_line(
                        (fit_text_width(f"   {'o' if not k else ' '} {part}", width - 8), "bold"),
                        (f"{sure if not k else '':>6}", ""),
                    )
                )
        # The size belongs to the first of the inseparable causes.
        add_row(_("size"), f"{cause.size}   {_('(of the first)')}" if cause.tied else cause.size)
        if cause.interval is not None and width - label >= INTERVAL_BAR_CELLS:
            block.append(make_line(" " * label, (draw_interval_bar(cause.interval), "$target")))
        if not cause.tied:
            add_row(_("sure"), cause.sure)
            if cause.rivals:
                add_row(_("or else"), cause.rivals)
        add_row(_("costs"), cause.cost, "bold")
        add_row(_("do"), cause.advice)
        return block

    def list_row_items(self) -> Sequence[int | None]:
        return self._row_of
