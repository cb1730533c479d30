"""Which faults can a line or a drive have? Cables, plugs and cheap adapters fail, and drives
disobey. A time line lists the faults: `KIND:DEVICE@FROM_S[+FOR_S]`.
"""

from __future__ import annotations

import math
import random
import re
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from topdress.control.readings import DriveCommand
from topdress.drivers.ports import Clock, Port, PortState
from topdress.drivers.virtual.virtual_devices import MachineExtra

# The sender uses twice the baud rate of the reader.
WRONG_BAUD_RATIO = 2.0


class PortFaults(NamedTuple):
    """Holds the faults of a line towards the reader; the defaults mean no fault. Shares are per
    line, 0 to 1."""

    # No bytes pass in either direction and the port is not connected.
    unplugged: bool = False
    # The line stays alive but repeats its last message.
    frozen: bool = False
    # Delay of all bytes, s.
    delay_s: float = 0.0
    # Share of lines preceded by random bytes.
    garbage_share: float = 0.0
    # Share of lines that lose their second half, line end included.
    half_share: float = 0.0
    # Share of lines that arrive twice.
    duplicate_share: float = 0.0
    # Share of lines in which one bit is inverted.
    bit_flip_share: float = 0.0
    # The line is read at half of the rate at which it is sent.
    wrong_baud: bool = False


class LineCorrupter:
    """Corrupts a byte stream on its way. The same seed corrupts the same lines.

    With `by_lines` False every piece is a datagram and is corrupted like a line.
    """

    def __init__(self, clock: Clock, seed: int = 0, by_lines: bool = True) -> None:
        self.faults = PortFaults()
        self._clock = clock
        self._random = random.Random(seed)
        self._by_lines = by_lines
        self._rest = b""
        self._last_line = b""
        self._delayed: deque[tuple[float, bytes]] = deque()

    def put_bytes(self, data: bytes) -> None:
        """Takes sent bytes. A line is passed on when it is complete."""
        if self.faults.unplugged:
            self._rest = b""
            self._delayed.clear()
            return
        if self._by_lines:
            *ended, self._rest = (self._rest + data).split(b"\n")
            lines = [line + b"\n" for line in ended]
        else:
            lines = [data] if data else []
        for line in lines:
            self._delayed.append((self._clock() + self.faults.delay_s, self._corrupt_line(line)))

    def take_due(self) -> list[bytes]:
        """Returns the lines or datagrams that arrive now."""
        now_s, found = self._clock(), []
        while self._delayed and self._delayed[0][0] <= now_s:
            found.append(self._delayed.popleft()[1])
        return [piece for piece in found if piece]

    def _corrupt_line(self, line: bytes) -> bytes:
        faults, chance = self.faults, self._random.random
        if faults.frozen and self._last_line:
            return self._last_line
        self._last_line = line
        if chance() < faults.bit_flip_share:
            place = self._random.randrange(len(line))
            line = (
                line[:place]
                + bytes([line[place] ^ 1 << self._random.randrange(8)])
                + line[place + 1 :]
            )
        if chance() < faults.half_share:
            line = line[: len(line) // 2]
        if chance() < faults.duplicate_share:
            line += line
        if chance() < faults.garbage_share:
            line = self._random.randbytes(self._random.randrange(1, 40)) + line
        return read_at_wrong_baud(line) if faults.wrong_baud else line


def read_at_wrong_baud(data: bytes, ratio: float = WRONG_BAUD_RATIO) -> bytes:
    """Returns the bytes that a receiver reads which samples `ratio` times more slowly than the
    sender sends (8N1, least significant bit first)."""
    bits = [bit for byte in data for bit in (0, *(byte >> place & 1 for place in range(8)), 1)]
    found = bytearray()
    at = 0.0
    while (
        start := next((place for place in range(int(at), len(bits)) if bits[place] == 0), None)
    ) is not None:
        samples = [start + (place + 0.5) * ratio for place in range(1, 10)]
        read = [bits[int(sample)] if sample < len(bits) else 1 for sample in samples]
        found.append(sum(bit << place for place, bit in enumerate(read[:8])))
        # After a missing stop bit a UART looks for the next start bit.
        at = samples[-1] + (0.5 * ratio if read[8] else 1.0)
    return bytes(found)


# The set-point of the nominal machine, r/min.
RUNAWAY_SHAFT_RPM = 70.0
# The gate of the nominal machine is fully open, mm.
RUNAWAY_OPENING_MM = 60.0


class DriveRunaway(NamedTuple):
    """Holds the movement of the drives without a command; None means that the drive follows its
    command."""

    shaft_rpm: float | None = None
    opening_mm: float | None = None


class VirtualRunaway(MachineExtra):
    """Overrides shaft and gate while `at` returns a runaway; `at` is called at every step with the
    time since `start_s`, s."""

    def __init__(self, at: Callable[[float], DriveRunaway], start_s: float) -> None:
        self._at = at
        self._start_s = start_s

    def alter_command(
        self, begin_s: float, command: DriveCommand, enabled: bool
    ) -> tuple[DriveCommand, bool]:
        """Returns the command with the drives that run away."""
        now = self._at(begin_s - self._start_s)
        if now.opening_mm is not None:
            command = command._replace(opening_mm=now.opening_mm)
        if now.shaft_rpm is None:
            return command, enabled
        return command._replace(shaft_rpm=now.shaft_rpm), True


LINE_FAULTS: dict[str, PortFaults] = {
    "unplug": PortFaults(unplugged=True),
    "garbage": PortFaults(garbage_share=0.5),
    "half_lines": PortFaults(half_share=0.5),
    "frozen": PortFaults(frozen=True),
    "delayed": PortFaults(delay_s=1.0),
    "duplicated": PortFaults(duplicate_share=1.0),
    "bit_flips": PortFaults(bit_flip_share=0.3),
    "wrong_baud": PortFaults(wrong_baud=True),
}
# Faults of the board's drives instead of its line.
DRIVE_FAULTS: dict[str, DriveRunaway] = {
    "shaft_turns": DriveRunaway(shaft_rpm=RUNAWAY_SHAFT_RPM),
    "gate_opens": DriveRunaway(opening_mm=RUNAWAY_OPENING_MM),
}
_FAULT_GRAMMAR = re.compile(
    r"(?P<kind>[a-z_]+):(?P<device>[a-z_0-9]+)@(?P<begin>[\d.]+)(\+(?P<lasts>[\d.]+))?"
)


class TimedFault(NamedTuple):
    """Holds one entry of the time line."""

    kind: str
    # The name of a device, or `heads` for all heads.
    device: str
    begin_s: float
    end_s: float = math.inf


def parse_fault(text: str, devices: Sequence[str]) -> TimedFault:
    """Returns the fault that one `--fault` describes. Raises ValueError with one plain line."""
    match = _FAULT_GRAMMAR.fullmatch(text.strip())
    if match is None:
        raise ValueError(
            f"fault {text!r}: not understood: allowed KIND:DEVICE@FROM_S[+FOR_S], e.g. "
            "unplug:gnss@60+10"
        )
    kinds = [*LINE_FAULTS, *DRIVE_FAULTS]
    if match["kind"] not in kinds:
        raise ValueError(
            f"fault {text!r}: unknown kind {match['kind']}: allowed {', '.join(kinds)}"
        )
    if match["kind"] in DRIVE_FAULTS and match["device"] != "board":
        raise ValueError(
            f"fault {text!r}: {match['kind']} is one of the board's drives: allowed "
            f"{match['kind']}:board"
        )
    known = [*devices, "heads"] if any(map(_is_head_name, devices)) else list(devices)
    if match["device"] not in known:
        raise ValueError(
            f"fault {text!r}: unknown device {match['device']}: allowed {', '.join(known)}"
        )
    try:
        begin_s = float(match["begin"])
        lasts_s = float(match["lasts"]) if match["lasts"] else math.inf
    except ValueError:
        raise ValueError(f"fault {text!r}: FROM_S and FOR_S must be numbers of seconds") from None
    return TimedFault(match["kind"], match["device"], begin_s, begin_s + lasts_s)


def find_faults(timeline: Iterable[TimedFault], device: str, at_s: float) -> PortFaults:
    """Returns the faults of one device's line at `at_s`; of several faults of one kind the worst
    counts."""
    found = PortFaults()
    for fault in timeline:
        names = (device, "heads" if _is_head_name(device) else device)
        if (
            fault.kind in LINE_FAULTS
            and fault.begin_s <= at_s < fault.end_s
            and fault.device in names
        ):
            worse = {
                name: max(value, getattr(found, name))
                for name, value in LINE_FAULTS[fault.kind]._asdict().items()
            }
            found = PortFaults(**worse)
    return found


def find_runaway(timeline: Iterable[TimedFault], at_s: float) -> DriveRunaway:
    """Returns the movement of the board's drives without a command at `at_s`."""
    found = DriveRunaway()
    for fault in timeline:
        if fault.kind in DRIVE_FAULTS and fault.begin_s <= at_s < fault.end_s:
            found = found._replace(
                **{
                    name: value
                    for name, value in DRIVE_FAULTS[fault.kind]._asdict().items()
                    if value is not None
                }
            )
    return found


def _is_head_name(device: str) -> bool:
    return device.startswith("head_")


class ServedLine:
    """Serves one device's byte line on all its ends: the device's bytes go to each end with the
    faults of the line, and bytes from any end are read."""

    def __init__(self, ends: Sequence[Port], clock: Clock, seed: int) -> None:
        self._ends = tuple(ends)
        self._spoiler = LineCorrupter(clock, seed=seed)

    @property
    def name(self) -> str:
        """Address of the line."""
        return self._ends[0].name

    @property
    def names(self) -> tuple[str, ...]:
        """Addresses of all ends of the line."""
        return tuple(end.name for end in self._ends)

    def set_faults(self, faults: PortFaults) -> None:
        """Sets the faults of the line from now on."""
        for end in self._ends:
            if faults.unplugged != self._spoiler.faults.unplugged:
                end.plug(not faults.unplugged)
        self._spoiler.faults = faults

    def plug(self, plugged: bool) -> None:
        """Plugs the line in or unplugs it."""
        for end in self._ends:
            end.plug(plugged)

    def read(self) -> bytes:
        """Returns the bytes that the console has sent."""
        self.send_due()
        return b"".join(end.read() for end in self._ends)

    def write(self, data: bytes) -> None:
        """Sends bytes with the faults of the line."""
        self._spoiler.put_bytes(data)
        self.send_due()

    def send_due(self) -> None:
        """Sends the bytes that are due."""
        due = b"".join(self._spoiler.take_due())
        for end in self._ends:
            if due:
                end.write(due)

    def state(self) -> PortState:
        """Returns whether the line is connected, and its traffic."""
        states = [end.state() for end in self._ends]
        return next((state for state in states if state.connected), states[0])

    def close(self) -> None:
        """Closes the machine's end."""
        for end in self._ends:
            end.close()
