"""Shows target and applied rate, the largest numbers on the screen, and the bar of their
difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.block_digits import ROWS_AT_SCALE, draw_digits, find_largest_scale
from topdress.console.app.panel_views import ERROR_BAR_END_SHARE, RatesView, TileView
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    choose_longest_fit,
    fit_text_width,
    make_line,
    make_solid_parts,
    wrap_text,
)
from topdress.console.locale import _


class SmallView(NamedTuple):
    """Holds the numbers of a small terminal; `page` names the open page where it differs from these
    numbers."""

    rates: RatesView
    tiles: tuple[TileView, ...]
    hint: str
    page: str = ""


# The panel shows the machine's numbers where the terminal is too small for a page: rates first,
# then the rest as far as it fits.
class SmallPanel(Panel[SmallView]):
    """Shows the rates first, then the rest as far as it fits."""

    def draw_rows(self, view: SmallView, width: int, height: int) -> list[Content]:
        """Return the rows. A page that does not fit is named at the top, with the size that would
        show it."""
        # The name of the hidden page takes the first row, and the numbers the rest.
        if view.page:
            said = make_line((fit_text_width(f" {view.page}: {view.hint}", width), "bold reverse"))
            return [said, *self.draw_rows(view._replace(page="", hint=""), width, height - 1)]
        rates, half = view.rates, width // 2
        error = f"  {rates.error.text}" if rates.error.text != "--" else ""
        rows = [
            make_line(
                (fit_text_width(f" {_('target')} {rates.unit}", half), "bold $target"),
                (fit_text_width(f" {_('applied')}{error}", width - half), "bold $applied"),
            )
        ]
        shown = (rates.target, "$target"), (rates.applied, "$applied")
        # Large numerals need three rows; with fewer rows plain digits must do.
        if height >= 2 + ROWS_AT_SCALE[1]:
            scale = find_largest_scale((rates.target.text, rates.applied.text), half, height - 3)
            drawn = [
                (draw_digits(one.text, scale), "$stale" if one.stale else colour)
                for one, colour in shown
            ]
            rows += [
                make_line(
                    *(
                        part
                        for (numeral, colour) in drawn
                        for part in (
                            " ",
                            *make_solid_parts(fit_text_width(numeral[row], half - 1), colour),
                        )
                    )
                )
                for row in range(ROWS_AT_SCALE[scale])
            ]
        else:
            rows.append(
                make_line(
                    *(
                        (
                            fit_text_width(f" {one.text}", half),
                            "bold $stale" if one.stale else f"bold {colour}",
                        )
                        for one, colour in shown
                    )
                )
            )
        if rates.notes:
            rows += [
                make_line(
                    (fit_text_width(f" {row}", width), "bold $on-alarm-amber on $alarm-amber")
                )
                for row in wrap_text(", ".join(rates.notes), width - 2)[:2]
            ]
        each = (width - 1) // 2
        # Two tiles share a row.
        for left in range(0, len(view.tiles), 2):
            rows.append(
                make_line(
                    *(
                        (
                            fit_text_width(
                                choose_longest_fit(
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
        return [*rows, make_line((fit_text_width(f" {view.hint}", width), "$muted"))]


# The panel shows target and applied rate, readable from the seat, on pages with other contents:
# stacked, or side by side.
class SeatRates(Panel[RatesView]):
    """Shows the rates in a strip of 4 rows, or in 12 rows where the height allows."""

    def draw_rows(self, view: RatesView, width: int, height: int) -> list[Content]:
        # Stacked numerals can be twice as wide.
        stacked = height >= 2 * (1 + ROWS_AT_SCALE[2])
        each = width if stacked else width // 2
        scale = find_largest_scale(
            (view.target.text, view.applied.text), each, height // 2 - 1 if stacked else height - 1
        )
        error = f"  {view.error.text}" if view.error.text != "--" else ""
        # A stale error must not alarm.
        loud = view.level and not view.error.stale
        level = f"bold $on-alarm-{view.level} on $alarm-{view.level}" if loud else "$muted"
        parts: list[list[list[TextPart]]] = []
        for shown, label, colour, end in (
            (view.target, _("target"), "$target", ""),
            (view.applied, _("applied"), "$applied", error),
        ):
            name = f" {label} {view.unit}"
            head: list[TextPart] = [
                (fit_text_width(name, each - len(end)), f"bold {colour}"),
                (end, level),
            ]
            body: list[list[TextPart]] = [
                [
                    " ",
                    *make_solid_parts(
                        fit_text_width(row, each - 1), "$stale" if shown.stale else colour
                    ),
                ]
                for row in draw_digits(shown.text, scale)
            ]
            parts.append([head, *body])
        if stacked:
            return [make_line(*row) for part in parts for row in part]
        return [make_line(*left, *right) for left, right in zip(*parts, strict=True)]


_ERROR_LEVEL_COLOURS = {"": "$target", "amber": "$alarm-amber", "red": "$alarm-red"}
_ERROR_LEVEL_MARKS = {"": " ", "amber": "!", "red": "✖"}


def list_shorter_notes(notes: Sequence[str]) -> tuple[str, ...]:
    """Return all reasons in one text; then the texts without the last reasons, which are
    counted."""
    return tuple(
        ", ".join(notes[:kept]) + (f"  +{len(notes) - kept}" if kept < len(notes) else "")
        for kept in range(len(notes), 0, -1)
    )


class RatesPanel(Panel[RatesView]):
    """Shows labels, numerals as large as the room allows (7 rows in all with numerals of 5 rows),
    and the error bar."""

    def draw_rows(self, view: RatesView, width: int, height: int) -> list[Content]:
        half = width // 2
        nudge = f" {_('nudge')} {view.nudge} " if view.nudge else ""
        label = f" {_('target')} "
        used = cell_len(label) + cell_len(view.unit) + 2 + cell_len(nudge)
        # The reason stands behind the label of the applied rate.
        room = width - half - cell_len(f" {_('applied')} {view.unit}  ")
        note = f" {', '.join(view.notes)} " if view.notes else ""
        # A reason that does not fit next to the labels needs a row of its own.
        low = cell_len(note) > room
        note = "" if low else note
        rows = [
            make_line(
                (label, "bold $target"),
                (f"{view.unit}  ", "$muted"),
                (nudge, "bold reverse"),
                " " * max(0, half - used),
                (f" {_('applied')} ", "bold $applied"),
                (f"{view.unit}  ", "$muted"),
                (note, "bold $on-alarm-amber on $alarm-amber"),
            )
        ]
        scale = find_largest_scale((view.target.text, view.applied.text), half, height - 2)
        target, applied = (
            draw_digits(view.target.text, scale),
            draw_digits(view.applied.text, scale),
        )
        target_style = "$stale" if view.target.stale else "$target"
        applied_style = "$stale" if view.applied.stale else "$applied"
        rows += [
            make_line(
                " ",
                *make_solid_parts(fit_text_width(a, half - 1), target_style),
                " ",
                *make_solid_parts(fit_text_width(b, width - half - 1), applied_style),
            )
            for a, b in zip(target, applied, strict=True)
        ]
        # A free row separates numerals and bar, or shows the reason.
        if height > ROWS_AT_SCALE[scale] + 2:
            rows.append(self._draw_note(view, width) if low else make_line(""))
            low = False
        rows.append(
            self._draw_note(view, width, error=True) if low else self._draw_error_bar(view, width)
        )
        return rows

    @staticmethod
    def _draw_note(view: RatesView, width: int, error: bool = False) -> Content:
        """Return the reason for a different rate in a row of its own; with `error` it replaces the
        bar and includes the bar's value."""
        end = f"  {_('error')} {view.error.text} " if error and view.error.text != "--" else ""
        note = choose_longest_fit(
            (f" {note} " for note in list_shorter_notes(view.notes)), width - cell_len(end)
        )
        note = fit_text_width(note, min(cell_len(note), width - cell_len(end)))
        return make_line(
            (note, "bold $on-alarm-amber on $alarm-amber"),
            " " * (width - cell_len(note) - cell_len(end)),
            (end, "bold"),
        )

    @staticmethod
    def _draw_error_bar(view: RatesView, width: int) -> Content:
        """Return the bar `error  -30 % [      |###     ] +30 %   +12 % !`, filled from the centre,
        so that sign and size are visible together."""
        style = "$stale" if view.error.stale else _ERROR_LEVEL_COLOURS[view.level]
        # A stale error must not alarm.
        chip = (
            f"bold $on-alarm-{view.level} on $alarm-{view.level}"
            if view.level and not view.error.stale
            else (f"bold {style}")
        )
        label = f" {_('error')} "
        value = f"{_ERROR_LEVEL_MARKS[view.level]}{view.error.text:>6} "
        low, high = f"-{ERROR_BAR_END_SHARE:.0%} ", f" +{ERROR_BAR_END_SHARE:.0%}"
        room = width - sum(cell_len(part) for part in (label, " ", value, low, high))
        # Both sides have the same length, so that zero is in the centre.
        arm = max(2, (room - 1) // 2)
        share = view.error_share or 0.0
        filled = min(arm, round(abs(share) * arm))
        left = " " * (arm - filled) + "█" * filled if share < 0 else " " * arm
        right = "█" * filled + " " * (arm - filled) if share > 0 else " " * arm
        return make_line(
            (label, "$muted"),
            (low, "$muted"),
            *make_solid_parts(left, style, "$track"),
            ("┃", "bold on $track"),
            *make_solid_parts(right, style, "$track"),
            (high, "$muted"),
            " ",
            (value, chip),
        )
