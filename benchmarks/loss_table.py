"""Every row of the loss table, provoked on the virtual machine through its bytes: `python -m
benchmarks loss_table`

The machine works on the demo field: plant, virtual board and devices, ports in memory with
faults in them, the cab's drivers, the control worker's host with its loop at 20 Hz and a real
log, all on one injected clock. Times are from the moment the fault begins to the tick whose log
row shows the reaction.
"""

from __future__ import annotations

import argparse
import errno
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from rig import DT_S, Rig
from terminals import wait
from topdress.console.worker.assemble import SimulatedBench
from topdress.console.worker.loop_host import Host
from topdress.console.worker.run_interfaces import RunAssembly, RunNames
from topdress.control.orders import Answer, Do, Order
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.files.atomic_files import NewFile
from topdress.drivers.files.run_log import RunLogWriter
from topdress.drivers.files.run_meta import make_run_meta
from verdict import exit_code

SETTLED_S = 14.0
BEGINS_S = SETTLED_S + 2.0  # an effect on top
# dead time of the shaft's drive 0.37 s, 70 r/min at 200 r/min per s, a tick
RUN_DOWN_S = 0.9


class WheelFaults:
    """Between the plant and the board's input: a wheel sensor that sticks, or counts what
    cannot be."""

    def __init__(self) -> None:
        self.stuck = self.mad = False
        self._last: SensorReadings | None = None
        self._added = 0

    def __call__(self, sensed: SensorReadings) -> SensorReadings:
        if self.stuck and self._last is not None:
            sensed = sensed._replace(
                wheel_pulses=self._last.wheel_pulses, wheel_pulse_s=self._last.wheel_pulse_s
            )
        elif self.mad:
            self._added += 500
            sensed = sensed._replace(
                wheel_pulses=sensed.wheel_pulses + self._added, wheel_pulse_s=sensed.time_s
            )
        self._last = sensed
        return sensed


class FullDisk(NewFile):
    """A disk that can be full."""

    full = False

    def write(self, data: bytearray) -> int:
        if FullDisk.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


class Hosted(Rig):
    """The rig in the control worker's host, with a real log and a console that is there or is
    not."""

    def __init__(
        self, folder: Path, effects: Iterable[str] = (), job: str = "demo", **sim: Any
    ) -> None:
        self.wheel, self.console = WheelFaults(), True
        super().__init__(
            job=job,
            dt_s=0.02,
            parks=False,
            lie=self.wheel,
            effects=effects,
            **({"begin_m": 40.0} | sim),
        )
        self.fallback_kg_ha = self.setup.crop.fallback_rate_kg_ha
        FullDisk.full = False
        self.writer = RunLogWriter(
            folder / "run.csv",
            make_run_meta(self.setup.machine, self.setup.crop, self.job),
            create=FullDisk,
            flush_s=0.01,
            sync_s=0.0,
        )
        self.host = Host(
            RunAssembly(SimulatedBench(self.cab, self.virtual), self.loop, self.writer, RunNames()),
            self.clock,
            lambda s: None,
        )
        self.row: Any = None

    def tick(self, each: Callable[[], object] = lambda: None) -> None:
        self.now_s += DT_S
        if self.console:
            self.host.note_console_heard()
        self.host.run_one_tick(self.now_s)
        assert self.host.newest_frame is not None
        self.row = self.host.newest_frame.row

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds / DT_S)):
            self.tick()

    def until(self, true: Callable[[], bool], most_s: float) -> float:
        """Seconds until it is so, infinite where it never was."""
        started_s = self.now_s
        while not true():
            if self.now_s - started_s >= most_s:
                return float("inf")
            self.tick()
        return self.now_s - started_s

    def ask(self, do: Do, value: Any = None) -> Answer:
        said: list[Answer] = []
        self.host.queue_request(Order(do, value), lambda answer, _: said.append(answer))
        self.tick()
        return said[0]

    def at_work(self, seconds: float = SETTLED_S) -> Hosted:
        self.go(0.5)
        assert self.ask(Do.READY).accepted
        self.go(0.2)
        assert self.ask(Do.START).accepted
        self.go(seconds - 0.8)
        assert self.row.state == "working" and not self.alarms, (self.row.state, self.alarms)
        assert self.rpm > 5.0
        return self

    @property
    def alarms(self) -> list[str]:
        return (self.row.alarms or "").split(";") if self.row.alarms else []

    @property
    def state(self) -> str:
        return str(self.row.state)

    def alarm(self, name: str) -> Callable[[], bool]:
        return lambda: name in self.alarms

    def no_flow_commanded(self) -> bool:
        return bool(self.row.shaft_rpm_cmd == 0.0)


class Found(NamedTuple):
    row: str
    expected: str
    limit_s: float
    measured_s: float
    happened: str
    other: bool = True  # whatever else had to be so

    @property
    def ok(self) -> bool:
        return self.measured_s <= self.limit_s and self.other


def ndvi_silent(rig: Hosted) -> Found:
    rig.unplug(*rig.heads)
    alarm_s = rig.until(rig.alarm("ndvi_silent"), 5.0)
    fallback_s = alarm_s + rig.until(lambda: rig.row.target_source == "fallback", 15.0)
    kept = rig.state == "working" and rig.row.target_rate_kg_ha == rig.fallback_kg_ha
    rig.go(3.0)
    flows = rig.rpm > 5.0
    rig.plug_in(*rig.heads)
    back_s = rig.until(lambda: rig.row.target_source == "canopy" and not rig.alarms, 15.0)
    return Found(
        "NDVI silent",
        "amber after 2 s; last decision 2 s on, then the fallback rate",
        2.05,
        alarm_s,
        f"ndvi_silent; fallback {rig.fallback_kg_ha:g} kg/ha commanded after "
        f"{fallback_s:.1f} s, where "
        f"the ground sensed and held ends; plugged in: canopy again after {back_s:.1f} s",
        kept and flows and fallback_s < 2.0 + 8.0 / 1.2 and back_s < 8.0,
    )


def heads_few(rig: Hosted) -> Found:
    rig.unplug("head_1", "head_2")
    rig.go(3.0)
    four_is_enough = not rig.alarms and rig.host.newest_frame.dropped_heads == (1, 2)  # type: ignore[union-attr]
    rig.unplug("head_5")
    measured_s = rig.until(rig.alarm("heads_few"), 5.0)
    rig.go(5.0)
    return Found(
        "fewer than four heads",
        "degraded, named",
        2.0,
        measured_s,
        f"heads_few; dropped {rig.host.newest_frame.dropped_heads}; state {rig.state}, target "  # type: ignore[union-attr]
        f"{rig.row.target_source}",
        four_is_enough and rig.state == "working" and rig.row.target_source == "canopy",
    )


def gnss_silent(rig: Hosted) -> Found:
    rig.unplug("gnss")
    measured_s = rig.until(rig.alarm("gnss_silent"), 5.0)
    rig.go(1.0)
    rig.go(20.0)
    off = abs(rig.row.speed_used_mps / rig.truth.speed_mps - 1.0)
    return Found(
        "GNSS silent, canopy mode",
        "amber after max(0.5 s, 2.5 periods); wheel speed; work goes on",
        0.65,
        measured_s,
        f"gnss_silent; 20 s later {rig.state}, shaft {rig.rpm:.0f} r/min, wheel's speed "
        f"{100 * off:.1f} % off",
        rig.state == "working" and rig.rpm > 5.0 and off < 0.03,
    )


def gnss_silent_map(rig: Hosted) -> Found:
    """The shipped map job, its map and its position through the bytes."""
    by_map = rig.row.target_source == "map"
    rig.unplug("gnss")
    rig.go(1.5)
    reckoned = rig.rpm > 5.0 and rig.row.target_source == "map" and rig.alarms == ["gnss_silent"]
    measured_s = 1.5 + rig.until(rig.no_flow_commanded, 6.0)
    why = ", ".join(rig.host.newest_frame.why_no_flow)  # type: ignore[union-attr]
    alarms = ", ".join(rig.alarms)
    still_s = measured_s + rig.until(lambda: rig.rpm < 1.0, 3.0)
    rig.plug_in("gnss")
    back_s = rig.until(lambda: rig.row.target_source == "map" and rig.rpm > 5.0, 10.0)
    return Found(
        "GNSS silent, map mode",
        "dead reckoning while its place is good (9.8 m), then no flow",
        8.0,
        measured_s,
        f"on the map by dead reckoning until then; no flow: {why}; {alarms}; the shaft stands "
        f"after {still_s:.2f} s; plugged in: on the map again after {back_s:.1f} s",
        by_map
        and reckoned
        and why == "position_lost"
        and still_s < measured_s + RUN_DOWN_S
        and back_s < 3.0,
    )


def wheel_stuck(rig: Hosted) -> Found:
    rig.wheel.stuck = True
    measured_s = rig.until(rig.no_flow_commanded, 5.0)
    alarm_s = measured_s + rig.until(rig.alarm("wheel_fault"), 5.0)
    held_s = alarm_s + rig.until(lambda: rig.state == "held", 20.0)
    return Found(
        "wheel: no pulse while moving",
        "standstill after 0.8 s: no flow; sensor fault",
        1.05,
        measured_s,
        f"shaft commanded to 0; wheel_fault (red) after {alarm_s:.2f} s; held after "
        f"{held_s:.1f} s of "
        "standstill",
        alarm_s < 1.6 and held_s < 11.2,
    )


def both_speeds(rig: Hosted) -> Found:
    rig.unplug("gnss")
    rig.wheel.mad = True
    stopped_s = rig.until(rig.no_flow_commanded, 6.0)
    measured_s = stopped_s + rig.until(lambda: rig.state == "held", 10.0)
    return Found(
        "both speeds silent",
        "last speed for at most 2 s, then held",
        2.15,
        measured_s,
        f"no flow after {stopped_s:.2f} s; {', '.join(rig.alarms)}; {rig.state}",
        stopped_s <= 2.0 and "speed_silent" in rig.alarms,
    )


def board_unplugged(rig: Hosted) -> Found:
    rig.unplug("board")
    measured_s = rig.until(lambda: rig.state == "fault", 3.0)
    board_s = measured_s + rig.until(
        lambda: not rig.virtual.board.find_set_points(rig.now_s)[1], 5.0
    )
    still_s = board_s + rig.until(lambda: rig.rpm < 1.0, 5.0)
    refused = rig.ask(Do.READY).why
    rig.plug_in("board")
    rig.go(1.0)
    rig.ask(Do.ACKNOWLEDGE, "")
    again = rig.ask(Do.READY).accepted and rig.ask(Do.START).accepted
    rig.go(6.0)
    return Found(
        "drive silent (line unplugged)",
        "fault after 0.5 s; the board stops by itself after 1 s",
        0.6,
        measured_s,
        f"shaft_silent, gate_silent; board off after {board_s:.2f} s, the true shaft stands "
        f"after {still_s:.2f} s; ready refused ({refused}); plugged in and acknowledged: "
        "works again",
        board_s < 1.1
        and still_s < board_s + RUN_DOWN_S
        and refused.startswith("cause_lives")
        and again
        and rig.state == "working"
        and rig.rpm > 5.0,
    )


def host_silent(rig: Hosted) -> Found:
    """The control worker itself hangs: nobody sends anything."""
    started_s, off_s, stands_s = rig.now_s, float("inf"), float("inf")
    while rig.now_s - started_s < 2.0:
        rig.now_s += DT_S
        rig.virtual.advance_to(rig.now_s)
        if not rig.virtual.board.find_set_points(rig.now_s)[1]:
            off_s = min(off_s, rig.now_s - started_s)
        if rig.rpm < 1.0:
            stands_s = min(stands_s, rig.now_s - started_s)
    fault_s = rig.until(lambda: rig.state == "fault", 2.0)
    rig.go(0.2)
    rig.ask(Do.ACKNOWLEDGE, "")
    again = rig.ask(Do.READY).accepted and rig.ask(Do.START).accepted
    rig.go(6.0)
    return Found(
        "host silent (worker hangs 2 s)",
        "the board stops the drives by itself after 1 s",
        1.05,
        off_s,
        f"board off; the true shaft stands after {stands_s:.2f} s; the host, awake again, "
        "finds it within "
        f"{fault_s:.2f} s: drive_stopped, fault; acknowledged: works again",
        stands_s < off_s + RUN_DOWN_S
        and fault_s <= 0.1
        and again
        and rig.state == "working"
        and rig.rpm > 5.0,
    )


def driver_fault(rig: Hosted) -> Found:
    rig.virtual.board.driver_fault = True
    measured_s = rig.until(lambda: rig.state == "fault", 2.0)
    alarms = list(rig.alarms)
    refused = rig.ask(Do.READY).why
    rig.virtual.board.driver_fault = False
    rig.go(0.2)
    again = rig.ask(Do.READY).accepted
    return Found(
        "motor driver reports a fault",
        "fault",
        0.1,
        measured_s,
        f"{', '.join(alarms)}; ready refused ({refused}) until it is gone",
        alarms == ["drive_fault"] and refused == "cause_lives;alarm=drive_fault" and again,
    )


def console_silent(rig: Hosted) -> Found:
    rig.console = False
    measured_s = rig.until(lambda: rig.state == "held", 5.0)
    stopped = rig.no_flow_commanded()
    rig.go(20.0)
    rig.console = True
    rig.tick()
    rig.ask(Do.ACKNOWLEDGE, "")
    again = rig.ask(Do.START).accepted
    rig.go(2.0)
    return Found(
        "console silent 2 s",
        "held, logging on; within 60 s it may come back",
        2.1,
        measured_s,
        f"{rig.row.state if not again else 'held'}, no flow; back after 22 s: acknowledged, "
        "started, "
        f"{rig.state}",
        stopped and again and rig.state == "working",
    )


def console_gone(rig: Hosted) -> Found:
    rig.console = False
    measured_s = rig.until(lambda: rig.state == "off", 70.0)
    return Found(
        "console gone 60 s",
        "off",
        60.1,
        measured_s,
        f"{rig.state}; true shaft {rig.rpm:.1f} r/min",
        measured_s > 59.9,
    )


def rate_amber(rig: Hosted) -> Found:
    rig.until(lambda: rig.now_s >= BEGINS_S - 1e-6, 5.0)
    measured_s = rig.until(rig.alarm("shaft_off"), 15.0)
    return Found(
        "shaft off by 5 % for 10 s",
        "amber (24 % slow; the gate makes up for what its trim leaves)",
        10.6,
        measured_s,
        f"{', '.join(rig.alarms)}; {rig.state}",
        rig.state == "working" and rig.alarms == ["shaft_off"],
    )


def rate_red(rig: Hosted) -> Found:
    rig.until(lambda: rig.now_s >= BEGINS_S - 1e-6, 5.0)
    measured_s = rig.until(rig.alarm("rate_far_off"), 10.0)
    return Found(
        "rate off by 20 % for 2 s",
        "red; of a shaft that does not follow (45 % slow): fault",
        2.6,
        measured_s,
        f"{', '.join(rig.alarms)}; {rig.state}",
        rig.state == "fault" and "shaft_far_off" in rig.alarms,
    )


def bridging(rig: Hosted) -> Found:
    rig.until(lambda: rig.now_s >= BEGINS_S - 1e-6, 5.0)
    measured_s = rig.until(lambda: rig.state == "held", 60.0)
    return Found(
        "scale flow below 50 % (bridged)",
        "red, held after 24 s of flow (90 % of the time bridged)",
        50.0,
        measured_s,
        f"{', '.join(rig.alarms)}; {rig.state}",
        "flow_missing" in rig.alarms,
    )


def hopper_empty(rig: Hosted) -> Found:
    low_s = rig.until(rig.alarm("hopper_low"), 30.0)
    left = next(a for a in rig.host.newest_frame.alarms if a.id == "hopper_low").details  # type: ignore[union-attr]
    at_low_kg = rig.hopper_kg
    # most of it is let out: the test is shorter
    rig.plant._flow = rig.plant._flow._replace(hopper_kg=0.8)
    rig.until(lambda: rig.hopper_kg <= 0.5, 20.0)
    measured_s = rig.until(lambda: rig.state == "held", 30.0)
    return Found(
        "hopper empty",
        "red, held (empty: 0.5 kg or less for 1 s, scale noise 0.15 kg)",
        6.0,
        measured_s,
        f"{', '.join(rig.alarms)}; {rig.state}; before, at {at_low_kg:.1f} kg: hopper_low, "
        f"{dict(left).get('metres_left')} m left",
        low_s < 30.0 and "hopper_empty" in rig.alarms,
    )


def hopper_low(rig: Hosted) -> Found:
    rig.until(lambda: rig.hopper_kg <= 15.0, 30.0)
    measured_s = rig.until(rig.alarm("hopper_low"), 30.0)
    left = next(a for a in rig.host.newest_frame.alarms if a.id == "hopper_low").details  # type: ignore[union-attr]
    expected_m = 15.0 / (rig.row.target_rate_kg_ha * 2.4 / 10_000.0)
    metres = dict(left)["metres_left"]
    return Found(
        "hopper below limit (15 kg)",
        "amber with metres left",
        4.0,
        measured_s,
        f"hopper_low, {metres} m left; {rig.state}",
        rig.state == "working" and abs(float(metres) - expected_m) < 20.0,
    )


def lead_short(rig: Hosted) -> Found:
    heads_m = rig.loop.machine.geometry.heads_m
    rig.until(lambda: rig.row.speed_used_mps > heads_m / (rig.row.lag_s + 1.5), 20.0)
    measured_s = rig.until(rig.alarm("lead_short"), 5.0)
    usable = rig.host.newest_frame.usable_speed_mps  # type: ignore[union-attr]
    return Found(
        "needed lead exceeds the heads'",
        "amber, highest usable speed shown",
        0.1,
        measured_s,
        f"lead_short; at most {3.6 * (usable or 0.0):.2f} km/h at "
        f"{3.6 * rig.row.speed_used_mps:.2f} "
        f"km/h; {rig.state}",
        usable is not None and rig.state == "working",
    )


def log_failed(rig: Hosted) -> Found:
    FullDisk.full = True
    rig.tick()
    # its thread lives on the real clock
    wait(lambda: not rig.writer.ok, 5.0, "a log that fails")
    measured_s = rig.until(rig.no_flow_commanded, 5.0)
    alarm = "log_failed" in rig.alarms
    rig.go(1.0)
    goes_on = rig.ask(Do.GO_ON_UNLOGGED, True).accepted
    on_s = rig.until(lambda: not rig.no_flow_commanded(), 3.0)
    FullDisk.full = False
    wait(lambda: rig.writer.ok, 5.0, "a log that is written again")
    rig.go(1.0)
    rig.ask(Do.ACKNOWLEDGE, "log_failed")
    rig.go(1.5)
    whole, ticks = not rig.alarms, round(rig.now_s / DT_S)
    rig.host.close_run("done")
    from topdress.drivers.files.read_log import read_log

    rows = sum(1 for _ in read_log(rig.writer.path).rows())
    return Found(
        "disk full, log not writable",
        "red, no flow; on only if the operator says so",
        0.1,
        measured_s,
        f"log_failed, no flow; ordered to go on: flow after {on_s:.2f} s; space again: "
        f"{rows} rows of {ticks} "
        "ticks in the log",
        alarm and goes_on and on_s < 1.0 and whole and rows == ticks,
    )


def acknowledge(rig: Hosted) -> Found:
    rig.console = False
    rig.until(lambda: rig.state == "held", 5.0)
    rig.console = True
    rig.go(5.0)
    latched = rig.alarms == ["console_silent"]
    refused = rig.ask(Do.START).why
    rig.ask(Do.ACKNOWLEDGE, "console_silent")
    measured_s = rig.until(lambda: not rig.alarms, 3.0)
    started = rig.ask(Do.START).accepted
    return Found(
        "red alarm",
        "stays until acknowledged; start waits for it",
        1.1,
        measured_s,
        f"5 s after its cause it still stands; start refused ({refused}); acknowledged: "
        "gone, started",
        latched and refused == "acknowledge_first;alarm=console_silent" and started,
    )


# Each with how its rig is made, and for how many seconds it is at work before.
LITTLE_LEFT = {"hopper_kg": 16.2, "refill_at_kg": 0.0, "seconds": 6.0}
FAST = [{"at_s": 0, "speed_kmh": 6.0}, {"at_s": SETTLED_S, "speed_kmh": 10.0}]
ROWS: dict[Callable[[Hosted], Found], dict[str, Any]] = {
    ndvi_silent: {},
    heads_few: {},
    gnss_silent: {},
    gnss_silent_map: {"job": "map_demo"},
    wheel_stuck: {},
    both_speeds: {},
    board_unplugged: {},
    host_silent: {},
    driver_fault: {},
    console_silent: {},
    console_gone: {},
    rate_amber: {"effects": [f"shaft.gain=-24@{BEGINS_S}"]},
    rate_red: {"effects": [f"shaft.gain=-45@{BEGINS_S}"]},
    bridging: {"effects": [f"flow.bridging=90@{BEGINS_S}"]},
    hopper_empty: LITTLE_LEFT,
    hopper_low: LITTLE_LEFT,
    lead_short: {"speed_changes": FAST},
    log_failed: {},
    acknowledge: {},
}


def provoke(row: Callable[[Hosted], Found]) -> Found:
    of = dict(ROWS[row])
    seconds = of.pop("seconds", SETTLED_S)
    with tempfile.TemporaryDirectory() as folder:
        rig = Hosted(Path(folder), **of)
        try:
            return row(rig.at_work(seconds))
        finally:
            rig.host.close_run("done")


def run() -> None:
    parser = argparse.ArgumentParser(
        description="Provoke every row of the loss table through bytes."
    )
    parser.add_argument("--only", default="", help="rows whose name contains this")
    given = parser.parse_args()
    found = []
    for row in ROWS:
        if given.only in row.__name__:
            found.append(provoke(row))
            f = found[-1]
            print(
                f"{f.row:34}{f.measured_s:7.2f} s (at most {f.limit_s:5.2f} s)  "
                f"{'ok' if f.ok else 'SHORT':6}"
                f"expected: {f.expected}\n{'':65}happened: {f.happened}",
                flush=True,
            )
    short = [f.row for f in found if not f.ok]
    print(
        f"{len(found) - len(short)} of {len(found)} as they should be"
        + (f"; short: {', '.join(short)}" if short else "")
    )
    sys.exit(exit_code({f"{f.row}: as expected": f.ok for f in found}))


if __name__ == "__main__":
    run()
