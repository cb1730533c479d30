"""A port with something wrong with it: what happens to cables, plugs and cheap adapters."""
from __future__ import annotations

import random
from collections import deque
from typing import NamedTuple

from drivers.ports import Clock, Port, PortState


class PortFaults(NamedTuple):
    """What is wrong with the line towards the reader. All neutral: nothing. Shares are per line, 0 to 1."""

    unplugged: bool = False             # nothing in, nothing out, not connected
    frozen: bool = False                # the line goes on, but repeats what it said before
    delay_s: float = 0.0                # everything arrives this much later
    garbage_share: float = 0.0          # random bytes in front of a line
    half_share: float = 0.0             # a line loses its second half, its line end included
    duplicate_share: float = 0.0        # a line comes twice
    bit_flip_share: float = 0.0         # one bit of a line is turned over


class FaultyPort:
    """Wraps a port; set `faults` at any time. Deterministic: the same seed spoils the same lines.

    Only what is read is spoilt. Writes pass, unless the port is unplugged.
    """

    def __init__(self, inner: Port, clock: Clock, faults: PortFaults = PortFaults(), seed: int = 0) -> None:  # noqa: B008
        self.faults = faults
        self._inner = inner
        self._clock = clock
        self._random = random.Random(seed)
        self._rest = b""
        self._last_line = b""
        self._delayed: deque[tuple[float, bytes]] = deque()

    @property
    def name(self) -> str:
        return self._inner.name

    def read(self) -> bytes:
        data = self._inner.read()
        if self.faults.unplugged:
            self._rest = b""
            self._delayed.clear()
            return b""
        now_s = self._clock()
        *lines, self._rest = (self._rest + data).split(b"\n")
        spoilt = b"".join(self._spoil(line + b"\n") for line in lines)
        if spoilt:
            self._delayed.append((now_s + self.faults.delay_s, spoilt))
        due = []
        while self._delayed and self._delayed[0][0] <= now_s:
            due.append(self._delayed.popleft()[1])
        return b"".join(due)

    def write(self, data: bytes) -> None:
        if not self.faults.unplugged:
            self._inner.write(data)

    def state(self) -> PortState:
        state = self._inner.state()
        return state._replace(connected=False, last_error="unplugged") if self.faults.unplugged else state

    def close(self) -> None:
        self._inner.close()

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
        return line
