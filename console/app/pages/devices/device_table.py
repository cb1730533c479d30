"""One row a device: symbol and word, rate, age, accepted, rejected, protocol, port. A click
picks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.panel import Part, PickList, choose_fullest, fit, line, right
from topdress.console.locale import _


class ShownDevice(NamedTuple):
    """level: "", amber, red. Texts as shown."""

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
    marks: str  # captured, being tested
    stale: bool = False


class TableView(NamedTuple):
    lines: tuple[ShownDevice, ...]
    picked: int


class DeviceTable(PickList[TableView]):
    def first_shown(self) -> int:
        """Index of the device in the row below the heading: the picked one is always in sight."""
        room = max(1, self.content_size.height - 1)
        return max(0, min(self.view.picked - room + 1, len(self.view.lines) - room))

    def lines(self, view: TableView, width: int, height: int) -> list[Content]:
        if not view.lines:
            return [
                line(
                    (fit(f"   {_('no device is known: is a machine connected?')}", width), "$muted")
                )
            ]
        names = max(10, max(cell_len(one.name) for one in view.lines) + 1)
        states = max(cell_len(one.word) for one in view.lines) + 4
        heads = (
            (fit(f"   {_('device')}", names + 3), ""),
            (fit(f" {_('state')}", states), ""),
            (right(_("Hz"), 6), ""),
            (right(_("age"), 8), ""),
            (right(_("accepted"), 10), ""),
            (right(_("rejected"), 10), ""),
            (f"  {_('protocol, port')}", ""),
        )
        rows = [line(*((text, "$muted") for text, _style in heads))]
        first = self.first_shown()
        for index, one in enumerate(view.lines[first : first + height - 1], first):
            rows.append(self._row(one, index == view.picked, names, states, width))
        return rows

    @staticmethod
    def _row(one: ShownDevice, picked: bool, names: int, states: int, width: int) -> Content:
        plain = "$stale" if one.stale else ""
        chip = f"bold $on-alarm-{one.level} on $alarm-{one.level}" if one.level else "bold"
        name = "bold $on-select on $select" if picked else "bold"
        used = names + 3 + states + 34
        # the picked device's protocol and port stand in full below
        end = one.port.rpartition("/")[2]
        rest = choose_fullest(
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
        cells: list[Part] = [
            (f" {'>' if picked else ' '} {fit(one.name, names)}", name),
            (fit(f" {one.symbol} {one.word}", states), chip),
            (right(one.hz, 6), plain),
            (right(one.age, 8), plain),
            (right(one.accepted, 10), plain),
            (right(one.rejected, 10), plain or ("bold" if one.rejected != "0" else "")),
            (fit(f"  {rest}", width - used), "$muted" if not one.marks else "bold"),
        ]
        return line(*cells)

    def things(self) -> Sequence[int | None]:
        first, room = self.first_shown(), max(1, self.content_size.height - 1)
        return [None, *range(first, min(first + room, len(self.view.lines)))]
