"""A line with something wrong with it: what happens to cables, plugs and cheap adapters."""
from __future__ import annotations

import random
from collections import deque
from typing import NamedTuple

from drivers.ports import Clock, Port, PortState

WRONG_BAUD_RATIO = 2.0              # sent at twice the rate at which it is read


class PortFaults(NamedTuple):
    """What is wrong with the line towards the reader. All neutral: nothing. Shares are per line, 0 to 1."""

    unplugged: bool = False             # nothing in, nothing out, not connected
    frozen: bool = False                # the line goes on, but repeats what it said before
    delay_s: float = 0.0                # everything arrives this much later
    garbage_share: float = 0.0          # random bytes in front of a line
    half_share: float = 0.0             # a line loses its second half, its line end included
    duplicate_share: float = 0.0        # a line comes twice
    bit_flip_share: float = 0.0         # one bit of a line is turned over
    wrong_baud: bool = False            # read at half the rate at which it is sent


class Spoiler:
    """What becomes of a stream on its way. Deterministic: the same seed spoils the same lines.

    `by_lines` False: every piece given is one datagram and is spoilt as a line would be.
    """

    def __init__(self, clock: Clock, faults: PortFaults = PortFaults(), seed: int = 0,  # noqa: B008
                 by_lines: bool = True) -> None:
        self.faults = faults
        self._clock = clock
        self._random = random.Random(seed)
        self._by_lines = by_lines
        self._rest = b""
        self._last_line = b""
        self._delayed: deque[tuple[float, bytes]] = deque()

    def put(self, data: bytes) -> None:
        """What was sent. A line is passed on when it is whole."""
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
            self._delayed.append((self._clock() + self.faults.delay_s, self._spoil(line)))

    def due(self) -> list[bytes]:
        """What arrives now, a line or datagram each."""
        now_s, found = self._clock(), []
        while self._delayed and self._delayed[0][0] <= now_s:
            found.append(self._delayed.popleft()[1])
        return [piece for piece in found if piece]

    def _spoil(self, line: bytes) -> bytes:
        faults, chance = self.faults, self._random.random
        if faults.frozen and self._last_line:
            return self._last_line
        self._last_line = line
        if chance() < faults.bit_flip_share:
            place = self._random.randrange(len(line))
            line = line[:place] + bytes([line[place] ^ 1 << self._random.randrange(8)]) + line[place + 1:]
        if chance() < faults.half_share:
            line = line[:len(line) // 2]
        if chance() < faults.duplicate_share:
            line += line
        if chance() < faults.garbage_share:
            line = self._random.randbytes(self._random.randrange(1, 40)) + line
        return at_wrong_baud(line) if faults.wrong_baud else line


class FaultyPort:
    """Wraps a port; set `faults` at any time.

    Only what is read is spoilt. Writes pass, unless the port is unplugged.
    """

    def __init__(self, inner: Port, clock: Clock, faults: PortFaults = PortFaults(), seed: int = 0) -> None:  # noqa: B008
        self._inner = inner
        self._spoiler = Spoiler(clock, faults, seed)

    @property
    def name(self) -> str:
        return self._inner.name

    @property
    def faults(self) -> PortFaults:
        return self._spoiler.faults

    @faults.setter
    def faults(self, faults: PortFaults) -> None:
        self._spoiler.faults = faults

    def read(self) -> bytes:
        self._spoiler.put(self._inner.read())
        return b"" if self.faults.unplugged else b"".join(self._spoiler.due())

    def write(self, data: bytes) -> None:
        if not self.faults.unplugged:
            self._inner.write(data)

    def state(self) -> PortState:
        state = self._inner.state()
        return state._replace(connected=False, last_error="unplugged") if self.faults.unplugged else state

    def close(self) -> None:
        self._inner.close()


def at_wrong_baud(data: bytes, ratio: float = WRONG_BAUD_RATIO) -> bytes:
    """What a receiver reads that samples `ratio` times more slowly than the sender sends (8N1, least bit first)."""
    bits = [bit for byte in data for bit in (0, *(byte >> place & 1 for place in range(8)), 1)]
    found = bytearray()
    at = 0.0
    while (start := next((place for place in range(int(at), len(bits)) if bits[place] == 0), None)) is not None:
        samples = [start + (place + 0.5) * ratio for place in range(1, 10)]
        read = [bits[int(sample)] if sample < len(bits) else 1 for sample in samples]
        found.append(sum(bit << place for place, bit in enumerate(read[:8])))
        at = samples[-1] + (0.5 * ratio if read[8] else 1.0)        # a missing stop bit: looks for the next start
    return bytes(found)
