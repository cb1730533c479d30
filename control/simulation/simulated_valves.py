"""How do the valves of a simulated machine share the metered material? The open outlets get
equal parts."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from topdress.control.machine.machine import Machine
from topdress.control.machine.sections import Valve


class SimulatedValves:
    """Simulates the valves. `stuck`: sections, counted from 1, whose valve does not move, and
    whether it stands open."""

    def __init__(self, machine: Machine) -> None:
        self.stuck: dict[int, bool] = {}
        self._valves = [section.valve or Valve() for section in machine.sections]
        self._shares = [strip.share for strip in machine.switched_strips]
        # Times of the changes, and the new positions.
        self._to_come: list[deque[tuple[float, bool]]] = [deque() for _ in self._valves]
        self._commanded = [False] * len(self._valves)
        self._open = [False] * len(self._valves)
        self._kg = [0.0] * len(self._valves)
        self._step_shares: list[float] = []

    def command_valves(self, now_s: float, valves: Sequence[bool]) -> None:
        """Takes the commands from now on; empty: no power, and they close."""
        for k, valve in enumerate(self._valves):
            on = k < len(valves) and valves[k]
            if on is not self._commanded[k]:
                self._commanded[k] = on
                self._to_come[k].append((now_s + (valve.open_s if on else valve.close_s), on))

    @property
    def open_valves(self) -> tuple[bool, ...]:
        """Returns the position of each valve, as a switch on it would show."""
        return tuple(self._open)

    def is_any_open(self, now_s: float) -> bool:
        """Moves the valves to the present, and returns whether any is open."""
        for k, turns in enumerate(self._to_come):
            while turns and turns[0][0] <= now_s:
                self._open[k] = turns.popleft()[1]
            self._open[k] = self.stuck.get(k + 1, self._open[k])
        self._step_shares.append(self._calc_open_share())
        return any(self._open)

    def distribute_kg(self, kg: float) -> None:
        """Distributes the metered mass over the open outlets; with all of them closed it stays."""
        share = self._calc_open_share()
        for k, on in enumerate(self._open):
            if on:
                self._kg[k] += kg * self._shares[k] / share

    def take_kg(self) -> tuple[float, ...]:
        """Returns the mass that each section has passed since the last call, kg."""
        kg, self._kg = tuple(self._kg), [0.0] * len(self._kg)
        return kg

    def take_share(self) -> float:
        """Returns the mean open share of the width since the last call."""
        shares, self._step_shares = self._step_shares, []
        return sum(shares) / len(shares) if shares else 0.0

    def _calc_open_share(self) -> float:
        return sum(share for share, on in zip(self._shares, self._open, strict=True) if on)
