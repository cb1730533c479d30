"""How does one day run? The worker whole (assembly, host, loop, safety, log, keeper, resume, link)
in virtual time, through every event of the day."""

from __future__ import annotations

import contextlib
import datetime as dt
import hashlib
import io
import itertools
import math
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import topdress.console.worker.assemble as assembling
from topdress.console.frame import Frame
from topdress.console.link import KEEP_ALIVE_PERIOD_S
from topdress.console.worker import resume
from topdress.console.worker.link_server import LinkServer
from topdress.console.worker.loop_host import Host
from topdress.console.worker.options import Options
from topdress.console.worker.side_files import SideFiles
from topdress.control.orders import Do, Order, State
from topdress.drivers import day_clock
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_log import FLUSH_PERIOD_S, RunLogWriter
from topdress.drivers.files.run_meta import read_sidecar_meta

from world.disk import FaultyDisk, PowerCut
from world.farm import BIN_M, PARKED_STATES, FarmMachine, load_farm, make_files
from world.invariants import (
    FLOW_ENDS_S,
    LASTING_INTERLOCKS,
    NO_FLOW_KG_S,
    RECOVERS_S,
    STOP_S,
    TWICE_M,
    AnsweredOrder,
    Broken,
    Moment,
    Promises,
)
from world.network import Listener, Selector, SimulatedConsole
from world.plan import Day, Event

BEGIN = dt.datetime(2026, 4, 1, 6, 0, 0, tzinfo=dt.UTC)
TOKEN = "0123456789abcdef0123456789abcdef"
# Interval of the link's turns, s.
LINK_PERIOD_S = 0.04
CONSOLES = 6
# Time after which an operator has started the program again, s.
START_AGAIN_S = 0.5
# Time that a gate which ran away needs to return to its place, s.
SETTLES_S = 12.0
# Speed of reversing, m/s.
BACK_MPS = -1.5
# Time that a tick takes, s: ticks that catch up are never in the same millisecond.
TICK_COST_S = 0.002
# Time until the tractor stands, s.
STANDS_S = 5.0
# Interval of keys that follow each other, s.
KEYS_S = 0.8
# Interval at which a console repeats the order of a button that is down, s.
REPEAT_S = 0.2


class DirectFiles(SideFiles):
    """Appends at once, as no thread can."""

    def queue_append(self, path: Path, data: bytes) -> None:
        """Appends bytes."""
        with contextlib.suppress(OSError), open(path, "ab") as file:
            file.write(data)


class Visits(Protocol):
    """Declares what takes the names that a day visits."""

    def note(self, kind: str, name: str) -> None: ...
    def end_day(self) -> None: ...


class NoVisits:
    """Takes names and keeps none."""

    def note(self, kind: str, name: str) -> None:
        """Does nothing."""

    def end_day(self) -> None:
        """Does nothing."""


class InjectedError(Exception):
    """Stands for a fault of the program or of a driver."""


class Outcome(NamedTuple):
    """Holds what a run showed: "" or the broken promise, and digests of rows, files and frames."""

    broken: str
    simulated_s: float
    parts: int
    true_kg: float
    counted_kg: float
    digests: tuple[str, str, str]
    trace: tuple[str, ...]


class World:
    """Runs one day in a folder of its own."""

    def __init__(self, day: Day, folder: Path, coverage: Visits) -> None:
        self.day, self.folder, self.coverage = day, folder, coverage
        self.now_s = 0.0
        self.trace: list[str] = []
        self.promises = Promises()
        self.parts = 0
        self._events = list(day.events)
        self._utc_jump_s = 0.0
        self._part_begin_s = 0.0
        # Time that the program's clock did not count, s.
        self._suspended_s = 0.0
        self._late_s, self._late_end_s = 0.0, -math.inf
        self._is_suspended = False
        self._disk_until_s, self._hangs_until_s = -math.inf, -math.inf
        self._faulty_until_s = -math.inf
        self._held_keys: list[tuple[float, str, Any]] = []
        self._repeat_due_s = 0.0
        self._heard_s = -math.inf
        self._orders: list[AnsweredOrder] = []
        self._state_before: str | None = None
        self._judged = 0
        self._kg_at_cut = 0.0
        self._cut: tuple[float, int, float] | None = None
        self._farm = day.farm
        self._wants_farm = ""
        self._recovery: float | None = None
        self._is_over = False
        self._disk_was_struck = False
        self._files = make_files(folder, self._farm, day.simulated)
        self._setup = load_farm(self._files)
        self.machine = FarmMachine(self._setup, day.seed, day.hz, lambda: self.now_s)
        self.disk = FaultyDisk(folder, day.seed, lambda: self.read_utc().timestamp())
        self.consoles = [
            SimulatedConsole(f"console {number}", TOKEN, number > 2, str(folder))
            for number in range(CONSOLES)
        ]
        self._stranger = SimulatedConsole("stranger", "wrong")
        self._leaves_s = [math.inf, *[-math.inf] * (CONSOLES - 1)]
        self._rows = hashlib.sha256()
        self.log_paths: list[Path] = []

    def read_utc(self) -> dt.datetime:
        """Returns the computer's date and time."""
        return BEGIN + dt.timedelta(seconds=self.now_s + self._utc_jump_s)

    def read_clock(self) -> float:
        """Returns the program's time, s."""
        return self.now_s - self._part_begin_s - self._suspended_s

    # The following methods begin and end the parts of a day.

    def run_day(self) -> None:
        """Runs all parts of the day. Raises Broken."""
        while not self._is_over:
            self._begin_part()
            try:
                self.host.run_until_stopped()
                self._end_part()
            except PowerCut:
                self._lose_power()
        self._check_ground()

    def _begin_part(self) -> None:
        self.parts += 1
        self._part_begin_s, self._suspended_s = self.now_s, 0.0
        self._heard_s = self._late_end_s = self.now_s
        log = self.folder / "logs" / f"run{self.parts}.csv"
        log.parent.mkdir(exist_ok=True)
        earlier = next(resume.find_open_jobs(log.parent, self.read_utc()), None)
        if self._wants_farm:
            earlier = earlier if self._wants_farm == self._farm else None
            self._farm, self._wants_farm = self._wants_farm, ""
            self._files = make_files(self.folder, self._farm, self.day.simulated)
        options = Options(
            self._files,
            self.folder / "worker.json",
            hz=self.day.hz,
            log=str(log),
            seed=self.day.seed,
            resume=None if earlier is None or self._setup.job.field.boundary_m else earlier[0],
        )
        assembly = assembling.assemble_run(
            options,
            self.read_clock,
            lambda path, meta: RunLogWriter(path, meta, clock=self.read_clock, threaded=False),
            self.machine.open_port,
        )
        self.assembly = assembly
        real_send = assembly.bench.send_command
        self._command: tuple[Any, bool] = (None, False)

        def send_command(now_s: float, command: Any, enabled: bool) -> None:
            self._command = command, enabled
            real_send(now_s, command, enabled)

        assembly.bench.send_command = send_command  # type: ignore[method-assign]
        self.host = Host(
            assembly,
            self.read_clock,
            self.sleep,
            hz=self.day.hz,
            run_aside=lambda do, _name: do(),
            files=DirectFiles(),
        )
        self.host.queue_request = self._note_answers(self.host.queue_request)  # type: ignore[method-assign]
        self._listener = Listener()
        self.link = LinkServer(
            self.host,
            TOKEN,
            self.read_clock,
            self._listener,  # type: ignore[arg-type]
            Selector,  # type: ignore[arg-type]
        )
        for number, console in enumerate(self.consoles):
            console.detach()
            if self._leaves_s[number] > self.now_s:
                console.attach(self._listener, self.now_s)
        self._link_due_s = self._log_due_s = self.now_s
        self._state_before, self._judged, self._failed_ticks = None, 0, 0
        self.machine.ground.part = self.parts
        self.promises.begin_part(self.now_s)
        self._check_resumed(earlier is not None)

    def _note_answers(self, queue: Callable[..., bool]) -> Callable[..., bool]:
        def queue_request(what: Any, reply: Any, by: str = "") -> bool:
            sent_s = self.now_s
            if isinstance(what, Order) and not by.startswith("console"):
                raise Broken("orders_need_the_key", f"{what} by {by}")

            def noted(answer: Any, extra: dict[str, Any]) -> None:
                if isinstance(what, Order):
                    self._orders.append(
                        AnsweredOrder(
                            sent_s, self.now_s, what.do, what.value, answer.accepted, answer.why
                        )
                    )
                elif answer.why:
                    self.coverage.note("refusal", answer.why.partition(";")[0])
                reply(answer, extra)

            return queue(what, noted, by)

        return queue_request

    def _check_resumed(self, found: bool) -> None:
        """A resumed job has what was done before the cut."""
        kg = self.assembly.loop.totals.applied_kg
        lost = self._kg_at_cut - kg
        if self.parts > 1 and lost > max(0.5, 0.02 * self._kg_at_cut) and self._is_same_job:
            raise Broken(
                "at_most_a_second_is_lost",
                f"{lost:.3f} of {self._kg_at_cut:.3f} kg at {self.now_s:.1f} s, found {found}",
            )
        self.promises._kg = min(self.promises._kg, kg)
        self.promises._ha = min(self.promises._ha, self.assembly.loop.totals.area_ha)

    def _end_part(self) -> None:
        """Ends a part whose worker has ended in order."""
        self.link.close_link()
        self.link.run()
        stays = self._wants_farm in ("", self._farm)
        self._is_same_job = not self._disk_was_struck and stays
        self._kg_at_cut = self.assembly.loop.totals.applied_kg
        self._check_log(full=not self._disk_was_struck)
        self.machine.cut_lines()
        self.trace.append(f"{self.now_s:7.2f} worker ended: {self.host.ended}")
        if not self._is_over:
            self._pass_time(START_AGAIN_S)

    def _lose_power(self) -> None:
        """Ends a part as a power cut does."""
        assert self._cut is not None
        self.coverage.note("end", "power cut")
        self._kg_at_cut = self.promises._kg
        self.disk.lose_unsynced()
        self.trace.append(f"{self.now_s:7.2f} POWER CUT")
        self._check_log(full=False)
        self._check_files()
        self._is_same_job = not self._disk_was_struck
        away_s, _, back_s = self._cut
        self._cut = None
        self.machine.cut_lines()
        self._pass_time(away_s)
        if back_s:
            # The driver goes back to where the work ended.
            self.machine.lying.wanted_mps = BACK_MPS
            self._pass_time(back_s)
            self.machine.lying.wanted_mps = None

    def _pass_time(self, seconds: float) -> None:
        """Lets time pass without a worker: nothing may flow after 3 s."""
        end_s = self.now_s + seconds
        self.disk.broken_errno = 0
        self._hangs_until_s = self._disk_until_s = -math.inf
        self._disk_was_struck = self.disk.is_struck = False
        begin_s = self.now_s
        while self.now_s < end_s:
            self.now_s += 0.1
            self.machine.advance(True)
            flow = self.machine.ground.flow_kg_s
            since_s = max(begin_s, self.machine.disobeyed_s)
            if self.now_s - since_s > FLOW_ENDS_S and flow > NO_FLOW_KG_S:
                raise Broken("a_dead_worker_means_no_flow", f"{flow:.4f} kg/s")
        while self._events and self._events[0].at_s < self.now_s:
            self._drop_event(self._events.pop(0))

    def _drop_event(self, event: Event) -> None:
        """Performs an event that needs no worker."""
        if event.kind in ("lie", "line", "reset", "asked_rate", "clock", "pour"):
            self._act(event)

    def _check_log(self, full: bool) -> None:
        """The log is readable; at most a second of rows is lost."""
        path = self.assembly.writer.path
        self.log_paths.append(path)
        if not path.exists():
            if full:
                raise Broken("log_is_readable", f"{path.name} does not exist")
            return
        try:
            log = read_log(path)
        except ValueError as error:
            if self._disk_was_struck or self.host._ticks < 2.5 * self.day.hz:
                return
            raise Broken("log_is_readable", str(error)) from None
        times = log.columns["time_s"]
        self._rows.update(times.tobytes())
        missing = self.host._ticks - self._failed_ticks - len(times)
        if not self._disk_was_struck and missing > (1 if full else 2.0 * self.day.hz):
            raise Broken("log_is_readable", f"{missing} rows of {self.host._ticks} missing")

    def _check_files(self) -> None:
        """Every snapshot is readable after a cut, and every log of more than 2 s has its
        description."""
        if self._disk_struck_ever:
            return
        for path in self.log_paths[-1].parent.glob("*.resume.json"):
            try:
                resume.read_snapshot(path)
            except ValueError as error:
                raise Broken("files_are_readable", str(error)) from None
        log = self.log_paths[-1]
        old = self.host._ticks > 2.5 * self.day.hz
        if old and log.exists() and read_sidecar_meta(log) is None:
            raise Broken("files_are_readable", f"{log.name} has no description")

    def _check_ground(self) -> None:
        """No ground of an earlier part of the job gets material again, beyond 2 m for each cut.
        (Within a part START releases the ground under the machine.)"""
        if self._may_double or self._farm != self.day.farm or self._disk_struck_ever:
            return
        twice: dict[int, int] = {}
        usual_kg = self._usual_kg
        for parts in self.machine.ground.bins.values():
            for (_, kg), (part, more_kg) in itertools.pairwise(sorted(parts.items())):
                if min(kg, more_kg) > 0.5 * usual_kg:
                    twice[part] = twice.get(part, 0) + 1
        for part, bins in twice.items():
            if bins * BIN_M > TWICE_M + 1.0:
                raise Broken("no_ground_twice", f"{bins * BIN_M:.1f} m again in part {part}")
        self._check_left_out(usual_kg)

    def _check_left_out(self, usual_kg: float) -> None:
        """Ground that the program calls done has its material, beyond 2 m for each part."""
        bins, machine = self.machine.ground.bins, self.machine.lying.plant
        coverage = self.assembly.loop._ahead.overlap.coverage
        if not bins or self._hopper_was_empty or self._setup.machine.switched_strips:
            return
        empty = [
            place
            for place in range(min(bins), max(bins))
            if sum(bins.get(place, {}).values()) < 0.05 * usual_kg
        ]
        poses = [machine._path.find_pose(BIN_M * (place + 0.5)) for place in empty]
        done = (
            coverage.find_covered([(pose.east_m, pose.north_m) for pose in poses]) if poses else ()
        )
        left_m = BIN_M * sum(map(bool, done))
        if left_m > TWICE_M * self.parts + 1.0:
            raise Broken("no_ground_left_out", f"{left_m:.1f} m called done without material")

    @property
    def _hopper_was_empty(self) -> bool:
        truth = self.machine.ground.newest
        return truth is not None and truth.hopper_kg < 2.0

    @property
    def _may_double(self) -> bool:
        """Whether an order, a lie or a fault may have let the program lose its ground."""
        return any(
            (event.kind == "order" and event.what[1] in ("no_double", "allow_outside"))
            or (event.kind == "line" and event.what[0] in ("gnss", "board"))
            or event.kind in ("lie", "clock", "raises", "restart")
            for event in self.day.events
        )

    @property
    def _disk_struck_ever(self) -> bool:
        return any(event.kind == "disk" for event in self.day.events)

    @property
    def _usual_kg(self) -> float:
        found = sorted(sum(parts.values()) for parts in self.machine.ground.bins.values())
        return found[len(found) // 2] if found else 1.0

    # The following methods let time pass while a worker runs.

    def sleep(self, seconds: float) -> None:
        """Lets time pass for the loop: link, log, devices, consoles and events have their turns."""
        self._judge_tick()
        until_s = self.now_s + max(seconds, TICK_COST_S)
        while True:
            event_s = self._events[0].at_s if self._events else math.inf
            next_s = min(until_s, event_s, self._link_due_s, self._log_due_s)
            self.now_s = max(self.now_s, next_s)
            if event_s <= self.now_s:
                self._act(self._events.pop(0))
                if self._late_s:
                    self._be_late()
                    break
                continue
            if self._link_due_s <= self.now_s:
                self._link_due_s = self.now_s + LINK_PERIOD_S
                self._run_link()
            elif self._log_due_s <= self.now_s:
                self._log_due_s = self.now_s + FLUSH_PERIOD_S
                self._run_log()
            else:
                break
        self._end_faults()
        self.machine.ground.tray = self.host._state == State.CALIBRATING
        self.machine.advance((self.host._state or "off") in PARKED_STATES)
        if self._recovery is None and self.now_s >= self.day.faults_end_s:
            self._begin_recovery()
        if self.now_s >= self.day.end_s and not self._is_over:
            self._is_over = True
            self.host.request_stop("end of the day")

    def _be_late(self) -> None:
        """Lets the whole computer stand for some seconds."""
        end_s, self._late_s = self.now_s + self._late_s, 0.0
        while self.now_s < end_s:
            self.now_s = min(end_s, self.now_s + 0.25)
            self.machine.advance((self.host._state or "off") in PARKED_STATES)
            self._check_orphaned_flow(end_s)
        self._late_end_s = self.now_s
        self._link_due_s = self._log_due_s = self.now_s

    def _check_orphaned_flow(self, _end_s: float) -> None:
        """Does nothing yet; `no_flow_but_where_allowed` sees the flow after the computer's
        return."""

    def _run_link(self) -> None:
        selector = self.link._authorised_selector
        self.link.serve_turn(selector.select(0.0))
        for number, console in enumerate(self.consoles):
            if self._leaves_s[number] <= self.now_s:
                if console.is_attached:
                    console.detach()
                continue
            if not console.is_attached:
                console.attach(self._listener, self.now_s)
            if console.run_turn(self.now_s, not console.tablet, KEEP_ALIVE_PERIOD_S):
                self._heard_s = self.now_s
            self._check_stops(console)
        if self._held_keys and self.now_s >= self._repeat_due_s:
            self._repeat_due_s = self.now_s + REPEAT_S
            self._held_keys = [held for held in self._held_keys if held[0] > self.now_s]
            for _end_s, do, value in self._held_keys:
                self._send_order(0, do, value)

    def _check_stops(self, console: SimulatedConsole) -> None:
        """Every STOP is answered within 0.5 s."""
        for question, answer in console.answers:
            self._note_answer(question.text, answer)
        console.answers.clear()
        for question in console.waiting.values():
            if question.text.get("do") != Do.STOP.value or console.silent_until_s > self.now_s:
                continue
            since_s = max(question.at_s, self._late_end_s, console.silent_until_s)
            if self.now_s - since_s > STOP_S + LINK_PERIOD_S:
                raise Broken("stop_is_obeyed", f"no answer to {console.name} for {STOP_S} s")

    def _note_answer(self, text: dict[str, Any], answer: dict[str, Any]) -> None:
        what = text.get("do") or text.get("ask") or text.get("act")
        if answer["accepted"]:
            self.coverage.note("order", str(what))
        self.trace.append(
            f"{self.now_s:7.2f} {what} {text.get('value')!r}: {answer['accepted']} {answer['why']}"
        )

    def _run_log(self) -> None:
        if self.now_s < self._hangs_until_s:
            return
        self.assembly.writer.write_round(False)
        self._disk_was_struck |= self.disk.is_struck

    def _end_faults(self) -> None:
        if self.disk.broken_errno and self.now_s >= self._disk_until_s:
            self.disk.broken_errno = 0
        if self.machine.lying.wanted_mps is not None and self.now_s >= self._driver_until_s:
            self.machine.lying.wanted_mps = None

    # The following methods perform the events.

    def _act(self, event: Event) -> None:
        self.coverage.note("event", event.kind)
        self.trace.append(str(event))
        # A computer that stood performs an event late; the event ends when it would have ended.
        lasts_s = max(0.0, event.at_s + event.lasts_s - self.now_s)
        if event.kind not in ("late", "suspend"):
            event = event._replace(lasts_s=lasts_s)
        getattr(self, f"_act_{event.kind}")(event)

    def _send_order(self, number: int, do: str, value: Any) -> None:
        console = self.consoles[number]
        if console.is_attached and console.silent_until_s <= self.now_s:
            console.send_request(self.now_s, {"do": do, "value": value})

    def _act_key(self, event: Event) -> None:
        self._send_order(0, event.what, "" if event.what == "acknowledge" else None)

    def _act_keys(self, event: Event) -> None:
        """Presses keys soon after each other."""
        self._events += [
            Event(self.now_s + KEYS_S * number, "key", key) for number, key in enumerate(event.what)
        ]
        self._events.sort(key=lambda one: one.at_s)

    def _act_order(self, event: Event) -> None:
        self._send_order(*event.what)

    def _act_burst(self, event: Event) -> None:
        """Sends many orders at once, and STOP behind them."""
        for number in range(event.what):
            self._send_order(0, "mark", f"burst {number}")
        self._send_order(0, "stop", None)

    def _act_silent(self, event: Event) -> None:
        self.consoles[event.what].silent_until_s = self.now_s + event.lasts_s

    def _act_attach(self, event: Event) -> None:
        self._leaves_s[event.what] = self.now_s + event.lasts_s

    def _act_line(self, event: Event) -> None:
        self.machine.begin_line_fault(*event.what, event.lasts_s)
        self._faulty_until_s = max(self._faulty_until_s, self.now_s + event.lasts_s)
        self.coverage.note("line", event.what[1])

    def _act_lie(self, event: Event) -> None:
        self.machine.begin_lie(*event.what, event.lasts_s)
        self._faulty_until_s = max(self._faulty_until_s, self.now_s + event.lasts_s)
        self.coverage.note("lie", event.what[0])

    def _act_late(self, event: Event) -> None:
        # An event of a time at which the computer stood is none.
        if self.now_s < event.at_s + 0.5:
            self._late_s = event.lasts_s

    def _act_suspend(self, event: Event) -> None:
        self._act_late(event)
        self._suspended_s += self._late_s

    def _act_clock(self, event: Event) -> None:
        self._utc_jump_s += event.what

    def _act_reset(self, _event: Event) -> None:
        self.machine.restart_board()

    def _act_pour(self, event: Event) -> None:
        self.machine.pour(event.what)
        self._faulty_until_s = max(self._faulty_until_s, self.now_s)

    def _act_asked_rate(self, event: Event) -> None:
        self.machine.asked_kg_ha = event.what
        self._events.append(Event(self.now_s + event.lasts_s, "asks_again"))
        self._events.sort(key=lambda one: one.at_s)

    def _act_asks_again(self, _event: Event) -> None:
        self.machine.asked_kg_ha = 180.0

    def _act_drive(self, event: Event) -> None:
        self.machine.lying.wanted_mps = event.what
        self._driver_until_s = self.now_s + event.lasts_s

    def _act_held_start(self, event: Event) -> None:
        self._act_hold_key(event._replace(what=["start", True]))

    def _act_calibrate(self, event: Event) -> None:
        """Makes a catch test: STOP, READY at standstill, and the button held down."""
        seconds, rpm, mm = event.what
        begin_s = self.now_s + STANDS_S
        event = event._replace(lasts_s=min(event.lasts_s, self.day.faults_end_s - begin_s))
        if event.lasts_s <= 0.0:
            return
        self._events += [
            Event(self.now_s, "key", "stop"),
            Event(begin_s - 0.6, "key", "acknowledge"),
            Event(begin_s - 0.3, "key", "ready"),
            Event(begin_s, "hold_key", ["calibrate", seconds], event.lasts_s),
            *(
                Event(begin_s + 0.4, "order", [0, do, value])
                for do, value in (("calibrate_shaft", rpm), ("calibrate_opening", mm))
                if value is not None
            ),
            Event(begin_s + event.lasts_s + 0.05, "key", "release"),
        ]
        self._events.sort(key=lambda one: one.at_s)

    def _act_hold_key(self, event: Event) -> None:
        do, value = event.what
        self._held_keys.append((self.now_s + event.lasts_s, do, value))

    def _act_ask(self, event: Event) -> None:
        self.consoles[0].send_request(self.now_s, {"ask": event.what})

    def _act_device(self, event: Event) -> None:
        number, device, act = event.what
        if self.consoles[number].is_attached:
            self.consoles[number].send_request(self.now_s, {"device": device, "act": act})

    def _act_stranger(self, event: Event) -> None:
        stranger = self._stranger
        stranger.attach(self._listener, self.now_s)
        kinds: dict[str, bytes] = {
            "garbage": b"\xff\x00{[\n" * 3,
            "wrong_key": b'{"id":1,"token":"wrong","do":"start","value":null}\n',
            "long": b"x" * 100_000,
            "half": b'{"id":1,"tok',
            "flood": b'{"id":1,"token":"wrong","ask":"alive"}\n' * 200,
            "look": b'{"id":1,"token":null,"ask":"look"}\n',
        }
        stranger.send_bytes(kinds[event.what])

    def _act_disk(self, event: Event) -> None:
        kind, calls = event.what
        self.coverage.note("disk", kind)
        end_s = self.now_s + event.lasts_s
        self._disk_was_struck = True
        if kind in ("fails", "tears"):
            self.disk.fail_later(kind, calls)
        elif kind == "hangs":
            self._hangs_until_s = end_s
        elif kind in ("full", "readonly"):
            self.disk.broken_errno = 28 if kind == "full" else 30
            self._disk_until_s = end_s
        else:
            path = self.assembly.writer.path
            if path.exists() and kind == "deleted":
                path.unlink()
            elif path.exists():
                size = path.stat().st_size
                with open(path, "r+b") as file:
                    file.truncate(size * calls // 8)

    def _act_cut(self, event: Event) -> None:
        away_s, calls, back_s = event.what
        self._cut = away_s, calls, back_s
        self.host.close_run = lambda _why: None  # type: ignore[method-assign]
        if not self._cut[1]:
            raise PowerCut
        self.disk.cuts_at = self.disk.calls + self._cut[1]

    def _act_raises(self, event: Event) -> None:
        """Lets the next tick of the loop, or the next reading of the receiver, fail."""
        owner, name = self.assembly.loop, "run_tick"
        if event.what == "device":
            owner, name = self.assembly.bench._devices["gnss"], "read_values"  # type: ignore[attr-defined]
        self._faulty_until_s = max(self._faulty_until_s, self.now_s)

        def fail(*_given: Any) -> None:
            delattr(owner, name)
            raise InjectedError

        setattr(owner, name, fail)

    def _act_replay(self, event: Event) -> None:
        self.machine.replay_orders(event.lasts_s)
        self._faulty_until_s = max(self._faulty_until_s, self.now_s + event.lasts_s)

    def _act_restart(self, event: Event) -> None:
        self._wants_farm = event.what or self._farm
        self.consoles[0].send_request(self.now_s, {"ask": "quit"})

    # The following methods judge.

    def _begin_recovery(self) -> None:
        """Presses the operator's keys after the end of all faults."""
        if self.day.calm:
            self._recovery = math.inf
            return
        self._recovery = self.now_s + SETTLES_S
        driver, consoles = self.machine.lying, self.consoles
        driver.wanted_mps = None
        consoles[0].silent_until_s = -1.0
        self.machine.asked_kg_ha = 180.0
        keys = [
            (0.0, "connect", ""),
            (0.6, "release", None),
            (0.7, "section", "all auto"),
            (0.8, "nudge", 0.0),
            (SETTLES_S, "acknowledge", ""),
            (SETTLES_S + 0.3, "ready", None),
            (SETTLES_S + 0.6, "start", None),
        ]
        for after_s, do, value in keys:
            if do == "connect":
                self._events += [
                    Event(self.now_s + 0.1, "device", [0, name, do]) for name in CONNECTED
                ]
            else:
                self._events.append(Event(self.now_s + after_s, "order", [0, do, value]))
        self._events.sort(key=lambda one: one.at_s)

    def _judge_tick(self) -> None:
        frame = self.host.newest_frame
        if frame is None or self.host._ticks == self._judged:
            return
        self._judged = self.host._ticks
        if frame.seq != self.host._ticks - 1 or self.host._failed:
            self._note_failed_tick(frame)
            return
        ground, limits = self.machine.ground, self._setup.machine.limits
        command, enabled = self._command
        state = str(self.host._state)
        moment = Moment(
            self.now_s,
            self._part_begin_s,
            self._late_end_s,
            frame,
            state,
            self._state_before,
            command,
            enabled,
            tuple(self._orders),
            self._heard_s,
            ground.flow_kg_s,
            ground.kg,
            ground.speed_mps,
            self.machine.active_lies,
            self.machine.disobeyed_s,
            self.machine.active_faults,
            self._disk_was_struck,
            frozenset(one for one in self.host._reported if "InjectedError" not in one),
            self.link.counts,
            self._setup.machine.geometry.working_width_m,
            limits.shaft_high_rpm,
            limits.opening_high_mm,
            self.day.calm,
            self.now_s - self._faulty_until_s,
            self.assembly.writer.ok,
            self._find_outside_m(),
        )
        if state != self._state_before:
            self.trace.append(
                f"{self.now_s:7.2f} {self._state_before} -> {state} {frame.why_state} "
                f"{frame.why_no_flow} {[alarm.id for alarm in frame.alarms]}"
            )
        self._note_coverage(moment)
        self._orders.clear()
        self.promises.check_tick(moment)
        self._state_before = state
        self._check_recovery(moment)

    def _find_outside_m(self) -> float:
        """Returns how far the outlets are outside the field, m; negative inside."""
        truth, corners = self.machine.ground.newest, self._setup.job.field.boundary_m
        if truth is None or not corners or self._farm != self.day.farm:
            return -math.inf
        east, north = zip(*corners, strict=True)
        return max(
            min(east) - truth.east_m,
            truth.east_m - max(east),
            min(north) - truth.north_m,
            truth.north_m - max(north),
        )

    def _note_failed_tick(self, frame: Frame) -> None:
        """A failed tick stops the drives at once, and has no row."""
        self._failed_ticks += 1
        for alarm in frame.alarms:
            self.coverage.note("alarm", alarm.id)
        command, enabled = self._command
        if enabled or (command is not None and command.shaft_rpm > 0.0):
            raise Broken("a_failed_tick_stops_the_drives", f"{command}")
        self._orders.clear()
        self._state_before = None

    def _note_coverage(self, m: Moment) -> None:
        note = self.coverage.note
        note("state", m.state)
        if m.state_before not in (None, m.state):
            note("change", f"{m.state_before} -> {m.state}")
        for alarm in m.frame.alarms:
            note("alarm", alarm.id)
        for why in m.frame.why_no_flow:
            note("interlock", why)
        for one in m.orders:
            if not one.accepted:
                note("refusal", one.why.partition(";")[0])

    def _check_recovery(self, m: Moment) -> None:
        """The operator's three keys bring the machine back to work within 10 s."""
        if self._recovery is None or self.now_s < self._recovery + RECOVERS_S:
            return
        self._recovery = math.inf
        if m.state != State.WORKING and m.frame.why_state != "standstill":
            raise Broken(
                "work_returns",
                f"{m.state} ({m.frame.why_state}) {RECOVERS_S:.0f} s after the keys, alarms "
                f"{[alarm.id for alarm in m.frame.alarms]}, {m.frame.why_no_flow}",
            )
        odd = set(m.frame.why_no_flow) - LASTING_INTERLOCKS
        if odd and m.state == State.WORKING:
            raise Broken("work_returns", f"no flow by {sorted(odd)}")


CONNECTED = ("gnss", "board", *(f"head_{number}" for number in range(1, 7)))


@contextlib.contextmanager
def replaced_clock(world: World) -> Iterator[None]:
    """Gives the program the world's date."""
    before = day_clock._read_epoch_s
    day_clock._read_epoch_s = lambda: world.read_utc().timestamp()  # type: ignore[assignment]
    try:
        yield
    finally:
        day_clock._read_epoch_s = before


def run_day(day: Day, coverage: Visits | None = None) -> Outcome:
    """Runs a day and returns what it showed."""
    folder = Path(tempfile.mkdtemp(prefix="world-"))
    coverage = coverage or NoVisits()
    world: World | None = None
    broken = ""
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            world = World(day, folder, coverage)
            with replaced_clock(world), world.disk.installed():
                world.run_day()
    except Broken as error:
        broken = str(error)
    except Exception as error:
        broken = "nothing_is_raised: " + "".join(traceback.format_exception(error)[-4:]).strip()
    finally:
        coverage.end_day()
    try:
        return _make_outcome(world, folder, broken)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _make_outcome(world: World | None, folder: Path, broken: str) -> Outcome:
    if world is None:
        return Outcome(broken, 0.0, 0, 0.0, 0.0, ("", "", ""), ())
    rows, files, frames = hashlib.sha256(), hashlib.sha256(), hashlib.sha256()
    own = str(folder).encode()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            content = path.read_bytes().replace(own, b"")
            (rows if path.suffix == ".csv" else files).update(
                path.name.encode() + hashlib.sha256(content).digest()
            )
    for console in world.consoles:
        frames.update(console.digest.digest())
    return Outcome(
        broken,
        world.now_s,
        world.parts,
        world.machine.ground.kg,
        world.promises._kg,
        (rows.hexdigest(), files.hexdigest(), frames.hexdigest()),
        tuple(world.trace),
    )
