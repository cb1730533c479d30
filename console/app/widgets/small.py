"""The machine's numbers where the terminal is too small for a page: rates first, the rest as far as there is room."""
from __future__ import annotations

from typing import NamedTuple

from textual.content import Content

from console.app.digits import ROWS, draw, largest
from console.app.view import RatesView, Tile
from console.app.widgets.panel import Panel, fit, fullest, line, solid, wrapped
from console.locale import _


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
        rows = [line((fit(f" {_('target')} {rates.unit}", half), "bold $target"),
                     (fit(f" {_('applied')}{error}", width - half), "bold $applied"))]
        shown = (rates.target, "$target"), (rates.applied, "$applied")
        if height >= 2 + ROWS[1]:
            scale = largest((rates.target.text, rates.applied.text), half, height - 3)
            drawn = [(draw(one.text, scale), "$stale" if one.stale else colour) for one, colour in shown]
            rows += [line(*(part for (numeral, colour) in drawn for part in (
                " ", *solid(fit(numeral[row], half - 1), colour)))) for row in range(ROWS[scale])]
        else:
            rows.append(line(*((fit(f" {one.text}", half), "bold $stale" if one.stale else f"bold {colour}")
                               for one, colour in shown)))
        if rates.notes:
            rows += [line((fit(f" {row}", width), "bold $on-alarm-amber on $alarm-amber"))
                     for row in wrapped(", ".join(rates.notes), width - 2)[:2]]
        each = (width - 1) // 2
        for left in range(0, len(view.tiles), 2):
            rows.append(line(*((fit(fullest((f" {tile.label} {tile.value.text} {tile.unit}  {tile.below}",
                                             f" {tile.label} {tile.value.text} {tile.unit}"), each), each),
                                "bold $on-alarm-amber on $alarm-amber" if tile.level else
                                "$stale" if tile.value.stale else "bold") for tile in view.tiles[left:left + 2])))
        return [*rows, line((fit(f" {view.hint}", width), "$muted"))]
