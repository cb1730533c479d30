"""Shows possible actions as keys with words over one or more rows. A click performs an action; one
kind runs while it is held.
"""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.message import Message
from topdress.console.app.widgets.base_panel import Panel, TextPart, make_line


class ActionChip(NamedTuple):
    """Holds one key with its word.

    Attributes
    ----------
    action
        Id of the action.
    on
        True if the action is possible now.
    lead
        True for the next action to take.
    held
        True if the action runs while the mouse button is down.
    """

    action: str
    key: str
    label: str
    on: bool = True
    lead: bool = False
    held: bool = False


def place_chips(
    chips: tuple[ActionChip, ...], width: int
) -> tuple[tuple[ActionChip, int, int, int], ...]:
    """Return each chip with row, first cell and width; a chip that does not fit begins the next
    row."""
    found, row, start = [], 0, 0
    for chip in chips:
        cells = cell_len(format_chip(chip))
        # A chip wider than the row stays in the first column.
        if start and start + cells > width:
            row, start = row + 1, 0
        found.append((chip, row, start, cells))
        start += cells + 1
    return tuple(found)


def format_chip(chip: ActionChip) -> str:
    """Return the text of a chip: ` Y make ready `, `>Y make ready ` for the next action, `(Y make
    ready)` for an impossible action."""
    # The state has a sign besides its colour, for terminals with few colours and for colour-blind
    # operators.
    first, last = ("(", ")") if not chip.on else (">", " ") if chip.lead else (" ", " ")
    return f"{first}{chip.key} {chip.label}{last}"


# Rows of a large chip: a blank row above and below the word.
LARGE_CHIP_ROWS = 3


def _choose_chip_style(chip: ActionChip) -> str:
    """Return the style of a chip."""
    if not chip.on:
        return "$stale on $keybar"
    return "bold $background on $primary" if chip.lead else "$on-keybar on $keybar"


class Chips(Panel[tuple[ActionChip, ...]]):
    """Shows chips; a click performs the action."""

    class Held(Message):
        """Reports that the mouse button went down on a held chip, was released, or left the
        chip."""

        def __init__(self, action: str, down: bool) -> None:
            super().__init__()
            self.action, self.down = action, down

    _held = ""

    def __init__(
        self,
        view: tuple[ActionChip, ...],
        *,
        id: str | None = None,
        classes: str | None = None,
        large: bool = False,
    ) -> None:
        """Create the chips; `large` places them in one row, three rows high where possible."""
        super().__init__(view, id=id, classes=classes)
        self.large = large

    def _is_tall(self, height: int) -> bool:
        """Return whether chips are drawn large."""
        return self.large and height >= LARGE_CHIP_ROWS

    def draw_rows(self, view: tuple[ActionChip, ...], width: int, height: int) -> list[Content]:
        if self._is_tall(height):
            return self._draw_large(view, width)
        rows: list[list[TextPart]] = [[] for _row in range(height)]
        for chip, row, _start, _cells in place_chips(view, width):
            # Rows beyond the panel are not visible.
            if row < height:
                rows[row] += [(format_chip(chip), _choose_chip_style(chip)), " "]
        return [make_line(*row) for row in rows]

    @staticmethod
    def _draw_large(view: tuple[ActionChip, ...], width: int) -> list[Content]:
        """Return the three rows of large chips."""
        blank: list[TextPart] = []
        words: list[TextPart] = []
        for chip, row, _start, cells in place_chips(view, width):
            if row == 0:
                blank += [(" " * cells, _choose_chip_style(chip)), " "]
                words += [(format_chip(chip), _choose_chip_style(chip)), " "]
        return [make_line(*blank), make_line(*words), make_line(*blank)]

    def find_chip(self, x: int, y: int) -> ActionChip | None:
        """Return the chip at a cell, or None."""
        # All three rows of a large chip are clickable.
        y = 0 if self._is_tall(self.content_size.height) else y
        return next(
            (
                chip
                for chip, row, start, cells in place_chips(self.view, self.content_size.width)
                if row == y and start <= x < start + cells
            ),
            None,
        )

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        """Return the cells of the chips except held chips: the jump letters click only briefly."""
        return tuple(
            (start, row)
            for chip, row, start, _cells in place_chips(self.view, self.content_size.width)
            if not chip.held and row < self.content_size.height
        )

    async def on_click(self, event: events.Click) -> None:
        """Perform the chip's action."""
        event.stop()
        chip = self.find_chip(event.x, event.y)
        if chip is not None and not chip.held:
            await self.run_action(f"app.do('{chip.action}')")

    def on_mouse_down(self, event: events.MouseDown) -> None:
        """Begin a held chip."""
        chip = self.find_chip(event.x, event.y)
        if chip is not None and chip.held:
            event.stop()
            self._held = chip.action
            # With the capture, a release outside the widget still arrives; otherwise the shaft
            # would go on turning.
            self.capture_mouse()
            self.post_message(self.Held(chip.action, True))

    def on_mouse_move(self, event: events.MouseMove) -> None:
        """End a held chip that the mouse leaves."""
        chip = self.find_chip(event.x, event.y)
        # Leaving the chip releases it, as with a real push button.
        if self._held and (chip is None or chip.action != self._held):
            self._release_chip()

    def on_mouse_up(self, event: events.MouseUp) -> None:
        """End a held chip."""
        self._release_chip()

    def on_mouse_release(self, event: events.MouseRelease) -> None:
        """End a held chip."""
        self._release_chip()

    def _release_chip(self) -> None:
        """Report the end of the held chip once."""
        if self._held:
            held, self._held = self._held, ""
            self.release_mouse()
            self.post_message(self.Held(held, False))
