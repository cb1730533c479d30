"""The simulated machine as a bench: the virtual machine steps up to now, then the real drivers read its bytes."""
from __future__ import annotations

from control.readings import DriveCommand, Measurements
from drivers.cab import Cab, DeviceStatus
from drivers.virtual.machine import VirtualMachine


class SimulatedBench:
    def __init__(self, cab: Cab, machine: VirtualMachine) -> None:
        self._cab = cab
        self._machine = machine

    def measure(self, now_s: float) -> Measurements:
        self._machine.advance(now_s)
        return self._cab.measure(now_s)

    def command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        self._cab.command(now_s, command, enabled)

    def status(self, now_s: float) -> tuple[DeviceStatus, ...]:
        return self._cab.status(now_s)

    def close(self) -> None:
        self._cab.close()
        self._machine.close()
