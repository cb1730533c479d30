"""A worker whose machine is a fake: the real program around it. Run as a program, or loaded by
conftest.

The fake log says what the loop was told: one JSON line a tick, written by a thread of its own
as the real log is.
"""

from __future__ import annotations

import json
import queue
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from topdress.console.worker.options import Options
from topdress.console.worker.program import Clock, run_worker_program
from topdress.console.worker.run_interfaces import RunAssembly, RunNames
from topdress.control.agronomy.reference_strips import ReferenceStrips
from topdress.control.field.job_totals import Totaliser, Totals
from topdress.control.log_row import LogRow
from topdress.control.orders import Alarm, Answer, Do, Order, SectionState, Severity
from topdress.control.readings import (
    NO_EFFORT_FINDING,
    DriveCommand,
    EffortFinding,
    Measurements,
    Reading,
)
from topdress.control.safety import Allowances, BenchRun
from topdress.drivers.cab_line import DeviceLine
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.lag_rig import RigReadings

HELD_AFTER_S = 2.0


@dataclass(frozen=True)
class FakeTick:
    row: LogRow
    command: DriveCommand
    is_enabled: bool
    alarms: tuple[Alarm, ...] = ()
    dropped_heads: tuple[int, ...] = (3,)
    metres_left_m: float | None = 120.0
    area_ha: float = 1.25
    applied_kg: float = 300.0
    gnss_age_s: float | None = 0.1
    gnss_hz: float | None = 10.0
    usable_speed_mps: float | None = None
    look_ahead: bool = True
    flow_trim_on: bool = False
    place_m: tuple[float, float] | None = (1.0, 2.0)
    notes: tuple[str, ...] = ("note",)
    why_no_flow: tuple[str, ...] = ("low_speed",)
    why_state: str = "start"
    allow: Allowances = field(default_factory=lambda: Allowances(outside=True))
    head_ndvi: tuple[float | None, ...] = (0.5, None)
    bench: BenchRun | None = field(default_factory=lambda: BenchRun(50.0, 20.0, 3.0, 117.0))
    no_double: bool = False
    threshold_m: float | None = -0.12
    sections: tuple[SectionState, ...] = (SectionState(True), SectionState(False, "done"))
    strips: ReferenceStrips = field(default_factory=lambda: ReferenceStrips(0.66, None))
    sources: tuple[str, ...] = ("canopy", "manual")
    source_rates: tuple[float | None, ...] = (310.0, 90.0)
    effort: EffortFinding = NO_EFFORT_FINDING
    ordered_source: str = "map"
    manual_rate_kg_ha: float = 90.0


class FakeBench:
    def __init__(self) -> None:
        self.commands: list[tuple[float, DriveCommand | None, bool]] = []
        self.closed = False
        self.lines: dict[str, DeviceLine] = {}
        self.rig_readings: RigReadings | None = None
        self.rig_orders: list[tuple[int, bool]] = []

    def read_measurements(self, now_s: float) -> Measurements:
        return Measurements(now_s, shaft_rpm=Reading(50.0, now_s))

    def send_command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        self.commands.append((now_s, command, enabled))
        del self.commands[:-1000]

    def find_device_line(self, name: str) -> DeviceLine | None:
        return self.lines.get(name)

    def send_rig_order(self, run: int, arm: bool) -> None:
        self.rig_orders.append((run, arm))

    def list_device_status(self, now_s: float) -> tuple[DeviceStatus, ...]:
        return (DeviceStatus("board", "memory", "fake", True, 0.01, 20.0, 7, 1, "$"),)

    def close_devices(self) -> None:
        self.closed = True


class FakeLoop:
    """Follows start, hold and stop; holds when the console is silent for two seconds; keeps
    what it was told."""

    def __init__(self) -> None:
        self.state = "ready"
        self.orders: list[Order] = []
        self.ages: list[float | None] = []
        self.log_oks: list[bool] = []
        self.logs_cut: list[str] = []
        self.events: list[str] = []  # of the next row
        self.break_at_tick: int | None = None
        self.not_finite = False
        self.totaliser = Totaliser(2.4, 0.46)

    @property
    def totals(self) -> Totals:
        return self.totaliser.make_totals()

    def add_event(self, event: str) -> None:
        self.events.append(event)

    def handle_order(self, order: Order, by: str = "") -> Answer:
        self.orders.append(order)
        if order.do is Do.REFILL:
            raise RuntimeError("cannot digest")
        if order.do is Do.MANUAL_RATE and isinstance(order.value, float) and order.value > 600.0:
            return Answer(False, "rate_above_limit")
        self.state = {Do.START: "working", Do.HOLD: "held", Do.STOP: "off"}.get(
            order.do, self.state
        )
        self.events += [order.do.value, f"{order.do.value}_by {by}"]
        return Answer(True)

    def run_tick(
        self, measurements: Measurements, console_age_s: float | None, log_ok: bool
    ) -> FakeTick:
        if self.break_at_tick == len(self.ages):
            raise RuntimeError("the loop broke")
        self.ages.append(console_age_s)
        self.log_oks.append(log_ok)
        self.logs_cut.append(measurements.log_cut)
        alarms: tuple[Alarm, ...] = ()
        if console_age_s is not None and console_age_s > HELD_AFTER_S and self.state == "working":
            self.state = "held"
        if self.state == "held":
            alarms = (
                Alarm(
                    "console_silent", Severity.RED, measurements.time_s, details=(("age_s", 2.0),)
                ),
            )
        working = self.state == "working"
        events, self.events = self.events, []
        row = LogRow(
            measurements.time_s,
            state=self.state,
            shaft_rpm=float("nan") if self.not_finite else 50.0,
            # the fake log has no column for the console's age
            speed_mps=console_age_s,
            events=";".join(events) or None,
        )
        return FakeTick(row, DriveCommand(70.0 if working else 0.0, 20.0), working, alarms)


class FakeWriter:
    """Memory only; `fail` makes it report trouble."""

    def __init__(self) -> None:
        self.rows: list[LogRow] = []
        self.trouble = ""
        self.closed = False
        self.path, self.cut_short = Path(), None

    @property
    def ok(self) -> bool:
        return not self.trouble

    def append(self, row: LogRow) -> None:
        self.rows.append(row)

    def close(self) -> None:
        self.closed = True


class LineWriter(FakeWriter):
    """On disk, by a thread of its own, a batch every half second: rows not flushed at the end
    would be missing."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self._queue: queue.SimpleQueue[LogRow | None] = queue.SimpleQueue()
        self._file = open(path, "w", encoding="utf-8")  # noqa: SIM115
        self._thread = threading.Thread(target=self._work, name="log")
        self._thread.start()

    def append(self, row: LogRow) -> None:
        self._queue.put(row)

    def close(self) -> None:
        self._queue.put(None)
        self._thread.join()

    def _work(self) -> None:
        while True:
            row = self._queue.get()
            if row is None:
                self._file.write("end\n")
                self._file.close()
                return
            self._file.write(
                json.dumps(
                    {
                        "time_s": row.time_s,
                        "state": row.state,
                        "age_s": row.speed_mps,
                        "events": row.events,
                    }
                )
                + "\n"
            )
            if self._queue.empty():
                time.sleep(0.1)
                self._file.flush()


def assemble(options: Options, clock: Clock) -> RunAssembly:
    if "refuse" in options.config:
        raise ValueError("cab.yaml: key gnss.port: value 7: allowed: a port name")
    writer = LineWriter(options.log) if options.log else FakeWriter()
    return RunAssembly(
        FakeBench(),
        FakeLoop(),
        writer,
        RunNames("job", "huanghai", "wheat", options.log or "", True),
    )


if __name__ == "__main__":
    sys.exit(run_worker_program(sys.argv[1:], assemble))
