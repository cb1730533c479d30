"""Declares the parts that a host drives: a bench of devices, control loop, log writer, snapshot
keeper.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from topdress.console.frame import Frame
from topdress.control.log_row import LogRow
from topdress.control.loop import ControlLoop, Tick
from topdress.control.readings import DriveCommand, Measurements
from topdress.drivers.cab_line import DeviceLine
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.lag_rig import RigReadings

if TYPE_CHECKING:
    from topdress.console.worker.resume_keeper import SnapshotKeeper


class MachineDevices(Protocol):
    """Declares the devices of one machine. No method blocks."""

    def read_measurements(self, now_s: float) -> Measurements: ...
    def send_command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None: ...
    def list_device_status(self, now_s: float) -> Sequence[DeviceStatus]: ...
    def find_device_line(self, name: str) -> DeviceLine | None: ...
    @property
    def rig_readings(self) -> RigReadings | None: ...  # newest line of the lag rig
    def send_rig_order(self, run: int, arm: bool) -> None: ...
    def close_devices(self) -> None: ...


# Fields that a frame copies from a tick under the same names.
FRAME_FIELDS = tuple(name for name in Frame.__dataclass_fields__ if hasattr(Tick, name))


class RunLogWriter(Protocol):
    """Declares a run log. `append` never touches the disk in the caller's thread; `trouble` is ""
    while rows reach the disk."""

    @property
    def ok(self) -> bool: ...
    @property
    def trouble(self) -> str: ...
    @property
    def path(self) -> Path: ...
    @property
    # Former log, which another program has truncated, or None.
    def cut_short(self) -> Path | None: ...
    def append(self, row: LogRow) -> None: ...
    def close(self) -> object: ...


class RunNames(NamedTuple):
    """Holds the names of this run's parts for the screens."""

    job: str = ""
    machine: str = ""
    crop: str = ""
    log_path: str = ""
    simulated: bool = False


class RunAssembly(NamedTuple):
    """Holds the parts of one run."""

    bench: MachineDevices
    loop: ControlLoop
    writer: RunLogWriter
    names: RunNames
    keeper: SnapshotKeeper | None = None
