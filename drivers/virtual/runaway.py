"""Drives that do not do what they are commanded: the shaft turns, the gate opens, whatever the board was sent."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from control.readings import DriveCommand
from control.simulation.plant import SensorReadings

RUNAWAY_RPM = 70.0          # the nominal machine's set-point
RUNAWAY_MM = 60.0           # wide open


class Runaway(NamedTuple):
    """What the drives do by themselves; None: as commanded."""

    shaft_rpm: float | None = None
    opening_mm: float | None = None


class VirtualRunaway:
    """Has the last word on shaft and gate while `at` says so; asked with the time since `start_s` of every step."""

    def __init__(self, at: Callable[[float], Runaway], start_s: float) -> None:
        self._at = at
        self._start_s = start_s

    def before(self, begin_s: float, command: DriveCommand, enabled: bool) -> tuple[DriveCommand, bool]:
        now = self._at(begin_s - self._start_s)
        if now.opening_mm is not None:
            command = command._replace(opening_mm=now.opening_mm)
        if now.shaft_rpm is None:
            return command, enabled
        return command._replace(shaft_rpm=now.shaft_rpm), True

    def after(self, sensed: SensorReadings, begin_s: float) -> None:
        """It listens to no sensor."""
