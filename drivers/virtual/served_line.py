"""One device's byte line as the virtual machine serves it, spoilt on its way."""
from __future__ import annotations

from collections.abc import Sequence

from drivers.ports import Clock, Port, PortState
from drivers.virtual.faults import PortFaults, Spoiler


class ServedLine:
    """One device's line on all its ends: what it says goes, spoilt, to each; what any of them says is heard."""

    def __init__(self, ends: Sequence[Port], clock: Clock, seed: int) -> None:
        self._ends = tuple(ends)
        self._spoiler = Spoiler(clock, seed=seed)

    @property
    def name(self) -> str:
        return self._ends[0].name

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(end.name for end in self._ends)

    def fault(self, faults: PortFaults) -> None:
        """From now on this is wrong with the line."""
        for end in self._ends:
            if faults.unplugged != self._spoiler.faults.unplugged:
                end.plug(not faults.unplugged)
        self._spoiler.faults = faults

    def plug(self, plugged: bool) -> None:
        for end in self._ends:
            end.plug(plugged)

    def read(self) -> bytes:
        self.push()
        return b"".join(end.read() for end in self._ends)

    def write(self, data: bytes) -> None:
        self._spoiler.put(data)
        self.push()

    def push(self) -> None:
        """Send what is due."""
        due = b"".join(self._spoiler.due())
        for end in self._ends:
            if due:
                end.write(due)

    def state(self) -> PortState:
        states = [end.state() for end in self._ends]
        return next((state for state in states if state.connected), states[0])

    def close(self) -> None:
        for end in self._ends:
            end.close()
