"""Backing up without leave to spread: what has landed is not spread upon again by itself."""

from __future__ import annotations

from math import inf

from topdress.control.machine.fall import drop_s
from topdress.control.machine.machine import Machine
from topdress.control.readings import Reading
from topdress.control.sensing import Sensed, travelled_ahead_m
from topdress.control.targets.canopy import STRAIGHT_DEG_S


class Backing:
    """`spread_to_m`: nothing more up to this place of the track."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._backed = False  # backwards at the tick before
        self._landed_to_m = -inf  # farthest place at which material has landed
        self.spread_to_m = -inf  # the same when the machine last turned round

    def forget(self) -> None:
        """The operator wants flow from here on, or the machine has left its line."""
        self._landed_to_m = self.spread_to_m = -inf

    def look(self, sensed: Sensed, may_reverse: bool) -> bool:
        """True where the machine has started to back up or to go on, and may not spread while
        it backs up."""
        if abs(sensed.turn_deg_s) > STRAIGHT_DEG_S:
            self.forget()
        turned_round = sensed.backwards != self._backed and not may_reverse
        if turned_round:
            self.spread_to_m = max(self.spread_to_m, self._landed_to_m)
        self._backed = sensed.backwards
        return turned_round

    def note_landing(self, shaft_rpm: Reading | None, sensed: Sensed) -> None:
        """What is released now lands a drop time later."""
        if shaft_rpm is None or not shaft_rpm.value >= 0.5 * self._machine.limits.shaft_low_rpm:
            return
        falls_s = drop_s(self._machine.fall, shaft_rpm.value)
        falls_m = travelled_ahead_m(sensed.speed_mps or 0.0, sensed.acceleration_mps2, falls_s)
        self._landed_to_m = max(self._landed_to_m, sensed.track_m + falls_m)
