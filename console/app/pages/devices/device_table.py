"""Shows one row per device: symbol and word, rate, age, accepted, rejected, protocol, port. A click
picks a device.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.base_panel import (
    PickList,
    TextPart,
    align_text_right,
    choose_longest_fit,
    fit_text_width,
    make_line,
)
from topdress.console.locale import _


class ShownDevice(NamedTuple):
    """Holds one row; texts as displayed. `level` is "", amber or red."""

    name: str
    symbol: str
    word: str
    level: str
    hz: str
    age: str
    accepted: str
    rejected: str
    protocol: str
    port: str
    # Signs of a raw capture or a test in progress.
    marks: str
    stale: bool = False


class TableView(NamedTuple):
    """Holds the table and the index of the picked device."""

    lines: tuple[ShownDevice, ...]
    picked: int


class DeviceTable(PickList[TableView]):
    """Shows the devices."""

    def find_first_shown(self) -> int:
        """Return the index of the device in the first row below the heading, such that the picked
        device is visible."""
        room = max(1, self.content_size.height - 1)
        return max(0, min(self.view.picked - room + 1, len(self.view.lines) - room))

    def draw_rows(self, view: TableView, width: int, height: int) -> list[Content]:
        if not view.lines:
            return [
                make_line(
                    (
                        fit_text_width(
                            f"   {_('no device is known: is a machine connected?')}", width
                        ),
                        "$muted",
                    )
                )
            ]
        # The column of names grows with the longest name.
        names = max(10, max(cell_len(one.name) for one in view.lines) + 1)
        states = max(cell_len(one.word) for one in view.lines) + 4
        heads = (
            (fit_text_width(f"   {_('device')}", names + 3), ""),
            (fit_text_width(f" {_('state')}", states), ""),
            (align_text_right(_("Hz"), 6), ""),
            (align_text_right(_("age"), 8), ""),
            (align_text_right(_("accepted"), 10), ""),
            (align_text_right(_("rejected"), 10), ""),
            (f"  {_('protocol, port')}", ""),
        )
        rows = [make_line(*((text, "$muted") for text, _style in heads))]
        first = self.find_first_shown()
        for index, one in enumerate(view.lines[first : first + height - 1], first):
            rows.append(self._draw_device(one, index == view.picked, names, states, width))
        return rows

    @staticmethod
    def _draw_device(
        one: ShownDevice, picked: bool, names: int, states: int, width: int
    ) -> Content:
        """Return the line of one device."""
        plain = "$stale" if one.stale else ""
        chip = f"bold $on-alarm-{one.level} on $alarm-{one.level}" if one.level else "bold"
        name = "bold $on-select on $select" if picked else "bold"
        # 34 cells are the four columns of numbers.
        used = names + 3 + states + 34
        # The details below show protocol and port of the picked device in full, so shortening is
        # harmless here.
        end = one.port.rpartition("/")[2]
        rest = choose_longest_fit(
            (
                "  ".join(part for part in parts if part)
                for parts in (
                    (one.marks, one.protocol, one.port),
                    (one.marks, one.port),
                    (one.marks, end),
                    (one.marks or end,),
                )
            ),
            width - used - 2,
        )
        cells: list[TextPart] = [
            (f" {'>' if picked else ' '} {fit_text_width(one.name, names)}", name),
            (fit_text_width(f" {one.symbol} {one.word}", states), chip),
            (align_text_right(one.hz, 6), plain),
            (align_text_right(one.age, 8), plain),
            (align_text_right(one.accepted, 10), plain),
            (align_text_right(one.rejected, 10), plain or ("bold" if one.rejected != "0" else "")),
            (fit_text_width(f"  {rest}", width - used), "$muted" if not one.marks else "bold"),
        ]
        return make_line(*cells)

    def list_row_items(self) -> Sequence[int | None]:
        first, room = self.find_first_shown(), max(1, self.content_size.height - 1)
        return [None, *range(first, min(first + room, len(self.view.lines)))]
