"""What orders that were recorded on the board's line and are played in again do: `python -m
benchmarks old_orders`

The worker's loop, cab and drivers against the virtual machine's bytes, on an injected clock.
Everything that the console sends to the board is recorded; somebody on the line plays it in
again for 30 s. Printed: the fastest that the shaft turned from the sixth second on, what left
the machine (plant), the alarms.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NamedTuple

from rig import DT_S, Rig
from topdress.control.orders import Do
from topdress.drivers.virtual.board import VirtualBoard
from verdict import exit_code

LASTS_S = 30.0
# frames: beyond the 16 that a board holds for a doubled line
OLDER_BY = 40
# a shaft that still slows down when the attack begins
STOPS_WITHIN_S = 6.0


class Tape:
    """The machine's end of the board's line, with a stranger on it."""

    def __init__(self, it: Rig) -> None:
        self.lines: list[bytes] = []
        self._from = it.board_line.read
        it.board_line.read = self.read  # type: ignore[method-assign]
        self.play: Callable[[], bytes] = bytes

    def read(self) -> bytes:
        data = self._from()
        self.lines += data.splitlines(keepends=True)
        return data + self.play()

    def enabled(self) -> list[bytes]:
        """Those that turn the shaft, older than the newest by more than what a board holds."""
        old = (line.split(b"*")[0].split(b",") for line in self.lines[:-OLDER_BY])
        return [
            line
            for line, fields in zip(self.lines, old, strict=False)
            if fields[0][:2] == b"$T" and fields[4] == b"1" and float(fields[2]) > 20.0
        ]

    def again(self, lines: list[bytes]) -> None:
        """One behind each of the console's, in their order, over and over."""
        turn = iter(lines * (1 + int(LASTS_S / DT_S) // len(lines)))
        self.play = lambda: next(turn, b"")


def off(it: Rig, tape: Tape) -> None:
    it.work()
    it.order(Do.STOP)
    it.run(8.0)
    tape.again(tape.enabled())


def working(it: Rig, tape: Tape) -> None:
    it.work()
    tape.again(tape.enabled())


def console_again(it: Rig, tape: Tape) -> None:
    """The whole of an earlier session, from its first order on, behind those of the console
    that was started again."""
    it.work()
    it.order(Do.STOP)
    it.run(8.0)
    lines = list(tape.lines)
    for _ in range(40):  # two seconds without a console
        it.now_s += DT_S
        it.virtual.advance_to(it.now_s)
    it.cab = it.fresh_cab()
    it.run(2.0)
    tape.again(lines)


def no_console(it: Rig, tape: Tape) -> None:
    """The board is switched off and on, no console runs, and an earlier session is played from
    its first order on."""
    it.work()
    it.order(Do.STOP)
    it.run(8.0)
    lines = list(tape.lines)
    it.virtual.board = VirtualBoard(it.ticks[-1].row.opening_mm)
    it.cab.send_command = lambda *_: None  # type: ignore[method-assign]
    tape.again(lines)


CASES = {
    "off": off,
    "working": working,
    "off, console started again": console_again,
    "board started again, no console": no_console,
}


class Found(NamedTuple):
    fastest_rpm: float
    plant_kg: float
    alarms: list[str]
    state: str


def played_in(name: str) -> Found:
    it = Rig()
    CASES[name](it, Tape(it))
    first, from_kg = len(it.ticks), it.hopper_kg
    it.run(LASTS_S)
    seen = it.ticks[first:]
    fastest_rpm = max(abs(tick.row.shaft_rpm or 0.0) for tick in seen[int(STOPS_WITHIN_S / DT_S) :])
    return Found(
        fastest_rpm,
        from_kg - it.hopper_kg,
        sorted({alarm.id for tick in seen for alarm in tick.alarms}),
        str(seen[-1].row.state),
    )


def promised(name: str, found: Found) -> dict[str, object]:
    return {
        f"{name}: the shaft stands, {found.fastest_rpm:.0f} r/min": found.fastest_rpm < 2.0,
        f"{name}: old_orders is said, {found.alarms}": "old_orders" in found.alarms
        or name.endswith("no console"),
    }


def main() -> int:
    promises: dict[str, object] = {}
    print(
        "| played in again | fastest shaft, r/min | kg by the plant | alarms | state then "
        "|\n|---|---|---|---|---|"
    )
    for name in CASES:
        found = played_in(name)
        print(
            f"| {name} | {found.fastest_rpm:.0f} | {found.plant_kg:.2f} | "
            f"{', '.join(found.alarms) or 'none'} | "
            f"{found.state} |",
            flush=True,
        )
        promises |= promised(name, found)
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())
