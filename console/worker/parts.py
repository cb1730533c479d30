"""What the host needs of the parts it drives: a bench of devices, the control loop, a log writer."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from console.frame import Frame, Tally
from control.agronomy.strips import Strips
from control.field.totals import Totals
from control.log_row import LogRow
from control.orders import Alarm, Answer, Order
from control.readings import DriveCommand, Measurements
from control.safety import Allowances, BenchRun
from drivers.cab_line import DeviceLine
from drivers.device_status import DeviceStatus
from drivers.devices.lag_rig import RigReadings


class Bench(Protocol):
    """The devices of one machine. No method blocks."""

    def measure(self, now_s: float) -> Measurements: ...
    def command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None: ...
    def status(self, now_s: float) -> Sequence[DeviceStatus]: ...
    def line(self, name: str) -> DeviceLine | None: ...
    @property
    def rig(self) -> RigReadings | None: ...                # newest line of the lag rig
    def order_rig(self, run: int, arm: bool) -> None: ...
    def close(self) -> None: ...


class Tick(Protocol):
    """What one control tick decided, and what the screens want to know of it (names as in `console.frame.Frame`)."""

    @property
    def row(self) -> LogRow: ...
    @property
    def command(self) -> DriveCommand: ...
    @property
    def enabled(self) -> bool: ...
    @property
    def alarms(self) -> tuple[Alarm, ...]: ...
    @property
    def dropped_heads(self) -> tuple[int, ...]: ...
    @property
    def metres_left_m(self) -> float | None: ...
    @property
    def area_ha(self) -> float: ...
    @property
    def applied_kg(self) -> float: ...
    @property
    def gnss_age_s(self) -> float | None: ...
    @property
    def gnss_hz(self) -> float | None: ...
    @property
    def usable_speed_mps(self) -> float | None: ...
    @property
    def look_ahead(self) -> bool: ...
    @property
    def flow_trim_on(self) -> bool: ...
    @property
    def place_m(self) -> tuple[float, float] | None: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def why_no_flow(self) -> tuple[str, ...]: ...
    @property
    def why_state(self) -> str: ...
    @property
    def allow(self) -> Allowances: ...
    @property
    def head_ndvi(self) -> tuple[float | None, ...]: ...
    @property
    def bench(self) -> BenchRun | None: ...
    @property
    def no_double(self) -> bool: ...
    @property
    def threshold_m(self) -> float | None: ...
    @property
    def strips(self) -> Strips: ...


TOLD = tuple(name for name in vars(Tick) if name in Frame.__dataclass_fields__)      # what a frame takes over


class Loop(Protocol):
    @property
    def totals(self) -> Totals: ...
    def order(self, order: Order) -> Answer: ...
    def tick(self, measurements: Measurements, console_age_s: float | None, log_ok: bool) -> Tick: ...


class Writer(Protocol):
    """A run log. `append` never touches the disk on the caller's thread; `trouble` is empty while rows reach it."""

    @property
    def ok(self) -> bool: ...
    @property
    def trouble(self) -> str: ...
    def append(self, row: LogRow) -> None: ...
    def close(self) -> object: ...


class Keeper(Protocol):
    """Keeps what a job needs to go on after a power cut. `take` only hands over."""

    @property
    def tally(self) -> Tally: ...
    def take(self, tick: Tick) -> None: ...
    def quit(self) -> None: ...


class Names(NamedTuple):
    """What the screens call this run."""

    job: str = ""
    machine: str = ""
    crop: str = ""
    log_path: str = ""
    simulated: bool = False


class Assembly(NamedTuple):
    """Everything one run consists of."""

    bench: Bench
    loop: Loop
    writer: Writer
    names: Names
    keeper: Keeper | None = None
