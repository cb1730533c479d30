"""Where has material landed while the machine reverses without permission to spread? The class
prevents that ground is spread twice automatically.
"""

from __future__ import annotations

from math import inf

from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.readings import Reading
from topdress.control.sensing import SensedMotion, predict_way_ahead_m
from topdress.control.targets.canopy_target import STRAIGHT_BELOW_DEG_S


class ReversingWatch:
    """Monitors the direction. `spread_to_m`: no further material up to this position of the
    track."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        # Whether the machine reversed in the last tick.
        self._backed = False
        # Farthest position at which material has landed, m.
        self._landed_to_m = -inf
        # That position at the last change of direction, m.
        self.spread_to_m = -inf

    def forget_landings(self) -> None:
        """Clears the landed material, because the operator wants flow from here on or the
        machine has left its line."""
        self._landed_to_m = self.spread_to_m = -inf

    def update_direction(self, sensed: SensedMotion, may_reverse: bool) -> bool:
        """Returns whether the machine has changed its direction and must not spread while
        reversing."""
        if abs(sensed.turn_deg_s) > STRAIGHT_BELOW_DEG_S:
            self.forget_landings()
        turned_round = sensed.backwards != self._backed and not may_reverse
        if turned_round:
            self.spread_to_m = max(self.spread_to_m, self._landed_to_m)
        self._backed = sensed.backwards
        return turned_round

    def note_landing(self, shaft_rpm: Reading | None, sensed: SensedMotion) -> None:
        """Records the landing position of material released now, a drop time later."""
        if shaft_rpm is None or not shaft_rpm.value >= 0.5 * self._machine.limits.shaft_low_rpm:
            return
        falls_s = calc_drop_s(self._machine.fall, shaft_rpm.value)
        falls_m = predict_way_ahead_m(sensed.speed_mps or 0.0, sensed.acceleration_mps2, falls_s)
        self._landed_to_m = max(self._landed_to_m, sensed.track_m + falls_m)
