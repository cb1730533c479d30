"""The simulated machine as a bench: stepped by the loop's own ticks, reached through the same bytes as a real one."""
from __future__ import annotations

from collections.abc import Callable, Sequence

from control.orders import State
from control.readings import DriveCommand, Measurements
from control.simulation.plant import Plant
from drivers.cab import Cab
from drivers.cab_line import DeviceLine
from drivers.device_status import DeviceStatus
from drivers.devices.lag_rig import RigReadings
from drivers.virtual.machine import VirtualMachine

PARKED = (State.OFF, State.READY, State.CALIBRATING)


class SimulatedBench:
    """A cab plugged into a virtual machine that is brought up to the tick's time before it is read.

    Where the plant is given, its driver stands while the machine is off, ready or calibrating, and drives once it
    works: `state` tells which.
    """

    def __init__(self, cab: Cab, machine: VirtualMachine, plant: Plant | None = None) -> None:
        self._cab = cab
        self._machine = machine
        self._plant = plant
        self.state: Callable[[], State] = lambda: State.OFF

    def measure(self, now_s: float) -> Measurements:
        if self._plant is not None:
            self._plant.parked = self.state() in PARKED
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
