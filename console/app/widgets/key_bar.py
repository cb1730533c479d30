"""Shows the bottom row: clickable keys with their words; for some seconds, a notice about a refusal
or result.
"""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from topdress.console.app.action import Action
from topdress.console.app.widgets.base_panel import Panel, fit_text_width, make_line
from topdress.console.locale import _


class KeysView(NamedTuple):
    """Holds the key bar."""

    actions: tuple[Action, ...]
    locked: bool
    notice: str
    # Reason why hold and STOP are not among the actions.
    why_none: str = ""
    # Ids of actions that are impossible now.
    off: frozenset[str] = frozenset()


# These actions stay in place next to a notice and under a dialog.
URGENT_ACTIONS = ("hold", "stop")
# The last two actions make everything else reachable by mouse at any width.
PERMANENT_ACTIONS = (*URGENT_ACTIONS, "pages", "palette")


def place_actions(actions: tuple[Action, ...], width: int) -> tuple[tuple[Action, int, int], ...]:
    """Return the actions that fit, most important first, with first cell and width of each."""
    ordered = sorted((a for a in actions if a.bar), key=lambda a: a.bar)
    cells = {action.id: cell_len(f" {action.shown} {_(action.label)} ") for action in ordered}
    always = [name for name in PERMANENT_ACTIONS if name in cells]
    while len(always) > len(URGENT_ACTIONS) and sum(cells[name] for name in always) > width:
        # The palette also leads to the pages, so the key of the pages is dropped first.
        always.remove(always[-2] if always[-1] == "palette" else always[-1])
    room = width - sum(cells[name] for name in always)
    placed, start = [], 0
    for action in ordered:
        if action.id not in always:
            if cells[action.id] > room:
                continue
            room -= cells[action.id]
        if start + cells[action.id] <= width:
            placed.append((action, start, cells[action.id]))
            start += cells[action.id]
    return tuple(placed)


def _format_why_none(view: KeysView) -> str:
    """Return the text that replaces hold and STOP."""
    return f" {view.why_none}  " if view.why_none else ""


class KeyBar(Panel[KeysView]):
    """Shows the keys."""

    def draw_rows(self, view: KeysView, width: int, height: int) -> list[Content]:
        placed = self._place_keys(view, width)
        parts: list[tuple[str, str]] = []
        if placed and placed[0][1]:
            parts.append(
                (fit_text_width(_format_why_none(view), placed[0][1]), "bold $on-keybar on $keybar")
            )
        for action, _start, _cells in placed:
            off = action.id in view.off or (view.locked and not action.locked)
            first, last = ("(", ")") if off else (" ", " ")
            key = "$stale on $keybar" if off else "bold $keybar-key on $keybar"
            word = "$stale on $keybar" if off else "$on-keybar on $keybar"
            if action.id == "stop" and not view.why_none:
                key = word = "bold $on-stop on $stop"
            parts += [(f"{first}{action.shown} ", key), (f"{_(action.label)}{last}", word)]
        left = max(0, width - (placed[-1][1] + placed[-1][2] if placed else 0))
        # A longer notice has rows of its own above this row.
        said = view.notice and cell_len(view.notice) < left
        rest = (
            (fit_text_width(f" {view.notice}", left), "bold reverse")
            if said
            else (" " * left, "on $keybar")
        )
        air = make_line(*((" " * cell_len(text), style) for text, style in (*parts, rest)))
        # On a tablet the bar is higher than its text, because a finger is wider than a row of
        # letters.
        return [*[air] * (height - 1), make_line(*parts, rest)]

    @staticmethod
    def _place_keys(view: KeysView, width: int) -> tuple[tuple[Action, int, int], ...]:
        """Return the placed keys. Next to a notice only hold and STOP remain, at their usual
        positions. The reason for their absence also comes first."""
        if view.notice:
            return tuple(
                one for one in place_actions(view.actions, width) if one[0].id in URGENT_ACTIONS
            )
        kept = place_actions(
            tuple(action for action in view.actions if action.id in PERMANENT_ACTIONS), width
        )
        start = min(
            cell_len(_format_why_none(view)), width - sum(cells for _action, _start, cells in kept)
        )
        return tuple(
            (action, start + at, cells)
            for action, at, cells in place_actions(view.actions, width - start)
        )

    def count_notice_cells(self, actions: tuple[Action, ...]) -> int:
        """Return the number of cells next to hold and STOP."""
        width = self.content_size.width
        urgent = [one for one in place_actions(actions, width) if one[0].id in URGENT_ACTIONS]
        return width - sum(cells for _action, _start, cells in urgent)

    def find_action(self, x: int) -> str:
        """Return the id of the action at a column of the content, or ""."""
        for action, start, cells in self._place_keys(self.view, self.content_size.width):
            if start <= x < start + cells:
                return action.id
        return ""

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        """Return the cells of all actions except hold and STOP, whose keys always work and are
        never covered."""
        return tuple(
            (start, 0)
            for action, start, _cells in self._place_keys(self.view, self.content_size.width)
            if action.id not in URGENT_ACTIONS
        )

    async def on_click(self, event: events.Click) -> None:
        """Perform the clicked action."""
        event.stop()
        name = self.find_action(event.x)
        if name:
            await self.run_action(f"app.do('{name}')")
