"""The simulated machine as a bench: stepped by the loop's own ticks, reached through the same bytes as a real one."""
from __future__ import annotations

from collections.abc import Sequence

from control.readings import DriveCommand, Measurements
from drivers.cab import Cab
from drivers.cab_line import DeviceLine, DeviceStatus
from drivers.devices.lag_rig import RigReadings
from drivers.virtual.machine import VirtualMachine


class SimulatedBench:
    """A cab plugged into a virtual machine that is brought up to the tick's time before it is read."""

    def __init__(self, cab: Cab, machine: VirtualMachine) -> None:
        self._cab = cab
        self._machine = machine

    def measure(self, now_s: float) -> Measurements:
        self._machine.advance(now_s)
        return self._cab.measure(now_s)

    def command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        self._cab.command(now_s, command, enabled)

    def status(self, now_s: float) -> Sequence[DeviceStatus]:
        return self._cab.status(now_s)

    def line(self, name: str) -> DeviceLine | None:
        return self._cab.line(name)

    @property
    def rig(self) -> RigReadings | None:
        return self._cab.rig

    def order_rig(self, run: int, arm: bool) -> None:
        self._cab.order_rig(run, arm)

    def close(self) -> None:
        self._cab.close()
        self._machine.close()
