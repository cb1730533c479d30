"""Target and applied rate, the largest things on the screen, and the bar of their difference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.digits import ROWS, draw, largest
from topdress.console.app.view import ERROR_SPAN, RatesView, Tile
from topdress.console.app.widgets.panel import (
    Panel,
    Part,
    choose_fullest,
    fit,
    line,
    solid,
    wrapped,
)
from topdress.console.locale import _


# The machine's numbers where the terminal is too small for a page: rates first, the rest as far
# as there is room.
class SmallView(NamedTuple):
    """page: which one is open, where it shows something else than these numbers."""

    rates: RatesView
    tiles: tuple[Tile, ...]
    hint: str
    page: str = ""


class Small(Panel[SmallView]):
    def lines(self, view: SmallView, width: int, height: int) -> list[Content]:
        """A page that is not seen says at the top that it is open, and what would show it."""
        if view.page:
            said = line((fit(f" {view.page}: {view.hint}", width), "bold reverse"))
            return [said, *self.lines(view._replace(page="", hint=""), width, height - 1)]
        rates, half = view.rates, width // 2
        error = f"  {rates.error.text}" if rates.error.text != "--" else ""
        rows = [
            line(
                (fit(f" {_('target')} {rates.unit}", half), "bold $target"),
                (fit(f" {_('applied')}{error}", width - half), "bold $applied"),
            )
        ]
        shown = (rates.target, "$target"), (rates.applied, "$applied")
        if height >= 2 + ROWS[1]:
            scale = largest((rates.target.text, rates.applied.text), half, height - 3)
            drawn = [
                (draw(one.text, scale), "$stale" if one.stale else colour) for one, colour in shown
            ]
            rows += [
                line(
                    *(
                        part
                        for (numeral, colour) in drawn
                        for part in (" ", *solid(fit(numeral[row], half - 1), colour))
                    )
                )
                for row in range(ROWS[scale])
            ]
        else:
            rows.append(
                line(
                    *(
                        (
                            fit(f" {one.text}", half),
                            "bold $stale" if one.stale else f"bold {colour}",
                        )
                        for one, colour in shown
                    )
                )
            )
        if rates.notes:
            rows += [
                line((fit(f" {row}", width), "bold $on-alarm-amber on $alarm-amber"))
                for row in wrapped(", ".join(rates.notes), width - 2)[:2]
            ]
        each = (width - 1) // 2
        for left in range(0, len(view.tiles), 2):
            rows.append(
                line(
                    *(
                        (
                            fit(
                                choose_fullest(
                                    (
                                        f" {tile.label} {tile.value.text} {tile.unit}  "
                                        f"{tile.below}",
                                        f" {tile.label} {tile.value.text} {tile.unit}",
                                    ),
                                    each,
                                ),
                                each,
                            ),
                            "bold $on-alarm-amber on $alarm-amber"
                            if tile.level
                            else "$stale"
                            if tile.value.stale
                            else "bold",
                        )
                        for tile in view.tiles[left : left + 2]
                    )
                )
            )
        return [*rows, line((fit(f" {view.hint}", width), "$muted"))]


# Target and applied rate, to be read from the seat, where a page shows something else: stacked,
# or in a strip.
class SeatRates(Panel[RatesView]):
    """A strip of 4 rows, or 12 rows where there is the height."""

    def lines(self, view: RatesView, width: int, height: int) -> list[Content]:
        stacked = height >= 2 * (1 + ROWS[2])
        each = width if stacked else width // 2
        scale = largest(
            (view.target.text, view.applied.text), each, height // 2 - 1 if stacked else height - 1
        )
        error = f"  {view.error.text}" if view.error.text != "--" else ""
        loud = view.level and not view.error.stale
        level = f"bold $on-alarm-{view.level} on $alarm-{view.level}" if loud else "$muted"
        parts: list[list[list[Part]]] = []
        for shown, label, colour, end in (
            (view.target, _("target"), "$target", ""),
            (view.applied, _("applied"), "$applied", error),
        ):
            name = f" {label} {view.unit}"
            head: list[Part] = [(fit(name, each - len(end)), f"bold {colour}"), (end, level)]
            body: list[list[Part]] = [
                [" ", *solid(fit(row, each - 1), "$stale" if shown.stale else colour)]
                for row in draw(shown.text, scale)
            ]
            parts.append([head, *body])
        if stacked:
            return [line(*row) for part in parts for row in part]
        return [line(*left, *right) for left, right in zip(*parts, strict=True)]


_LEVELS = {"": "$target", "amber": "$alarm-amber", "red": "$alarm-red"}
_MARKS = {"": " ", "amber": "!", "red": "✖"}


def fewer(notes: Sequence[str]) -> tuple[str, ...]:
    """All reasons; then without the last ones, which are counted."""
    return tuple(
        ", ".join(notes[:kept]) + (f"  +{len(notes) - kept}" if kept < len(notes) else "")
        for kept in range(len(notes), 0, -1)
    )


class Rates(Panel[RatesView]):
    """Labels, numerals as large as the room allows (7 rows in all at 5 rows each), the error
    bar."""

    def lines(self, view: RatesView, width: int, height: int) -> list[Content]:
        half = width // 2
        nudge = f" {_('nudge')} {view.nudge} " if view.nudge else ""
        label = f" {_('target')} "
        used = cell_len(label) + cell_len(view.unit) + 2 + cell_len(nudge)
        room = width - half - cell_len(f" {_('applied')} {view.unit}  ")
        note = f" {', '.join(view.notes)} " if view.notes else ""
        low = cell_len(note) > room  # a row of its own then
        note = "" if low else note
        rows = [
            line(
                (label, "bold $target"),
                (f"{view.unit}  ", "$muted"),
                (nudge, "bold reverse"),
                " " * max(0, half - used),
                (f" {_('applied')} ", "bold $applied"),
                (f"{view.unit}  ", "$muted"),
                (note, "bold $on-alarm-amber on $alarm-amber"),
            )
        ]
        scale = largest((view.target.text, view.applied.text), half, height - 2)
        target, applied = draw(view.target.text, scale), draw(view.applied.text, scale)
        target_style = "$stale" if view.target.stale else "$target"
        applied_style = "$stale" if view.applied.stale else "$applied"
        rows += [
            line(
                " ",
                *solid(fit(a, half - 1), target_style),
                " ",
                *solid(fit(b, width - half - 1), applied_style),
            )
            for a, b in zip(target, applied, strict=True)
        ]
        if height > ROWS[scale] + 2:
            rows.append(self._note(view, width) if low else line(""))
            low = False
        rows.append(self._note(view, width, error=True) if low else self._bar(view, width))
        return rows

    @staticmethod
    def _note(view: RatesView, width: int, error: bool = False) -> Content:
        """Why the rate is another one, in a row of its own; with `error` in the place of the
        bar, whose value stays."""
        end = f"  {_('error')} {view.error.text} " if error and view.error.text != "--" else ""
        note = choose_fullest((f" {note} " for note in fewer(view.notes)), width - cell_len(end))
        note = fit(note, min(cell_len(note), width - cell_len(end)))
        return line(
            (note, "bold $on-alarm-amber on $alarm-amber"),
            " " * (width - cell_len(note) - cell_len(end)),
            (end, "bold"),
        )

    @staticmethod
    def _bar(view: RatesView, width: int) -> Content:
        """`error  -30 % [      |###     ] +30 %   +12 % !`: filled from the middle, sign and
        size in one look."""
        style = "$stale" if view.error.stale else _LEVELS[view.level]
        chip = (
            f"bold $on-alarm-{view.level} on $alarm-{view.level}"
            if view.level and not view.error.stale
            else (f"bold {style}")
        )
        label = f" {_('error')} "
        value = f"{_MARKS[view.level]}{view.error.text:>6} "
        low, high = f"-{ERROR_SPAN:.0%} ", f" +{ERROR_SPAN:.0%}"
        room = width - sum(cell_len(part) for part in (label, " ", value, low, high))
        arm = max(2, (room - 1) // 2)
        share = view.error_share or 0.0
        filled = min(arm, round(abs(share) * arm))
        left = " " * (arm - filled) + "█" * filled if share < 0 else " " * arm
        right = "█" * filled + " " * (arm - filled) if share > 0 else " " * arm
        return line(
            (label, "$muted"),
            (low, "$muted"),
            *solid(left, style, "$track"),
            ("┃", "bold on $track"),
            *solid(right, style, "$track"),
            (high, "$muted"),
            " ",
            (value, chip),
        )
