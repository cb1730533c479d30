"""Hosts the control loop: it runs one tick after the other at absolute deadlines.

Nothing here touches a socket or a disk. Other threads reach the host by three functions or values
only: `queue_request` (a request with the function that receives the answer), `note_console_heard`
(an operating console was just heard) and `newest_frame`.
"""

from __future__ import annotations

import math
import sys
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from math import ceil, inf
from pathlib import Path
from typing import Any, NamedTuple

from topdress.console.attached_consoles import (
    MAX_LATEST_ORDERS,
    AttachedConsole,
    ExecutedOrder,
    read_orders,
)
from topdress.console.frame import DeviceView, Frame
from topdress.console.worker.device_service import DeviceService, RunAside, run_in_thread
from topdress.console.worker.lag_bench import LagBench
from topdress.console.worker.limits import (
    DEFAULT_TICK_HZ,
    DEVICE_LIST_PERIOD_S,
    LOG_CUT_NOTICE_S,
    MAX_CATCH_UP_PERIODS,
    MAX_FRAME_HZ,
    MAX_REPORTED_FAILURES,
    MAX_REQUESTS_PER_TICK,
    MAX_TEXT_CHARACTERS,
    MAX_WAITING_REQUESTS,
    ORPHAN_TIMEOUT_S,
    TOTALS_PERIOD_S,
)
from topdress.console.worker.requests import ClientQuestion, DeviceOrder, RequestContent
from topdress.console.worker.run_interfaces import FRAME_FIELDS, RunAssembly
from topdress.console.worker.side_files import SideFiles
from topdress.control.field.job_totals import Totals
from topdress.control.loop import Tick
from topdress.control.orders import Alarm, Answer, Do, Order, Severity
from topdress.drivers.device_status import DeviceStatus

# The loop's punctuality is measured by histograms of fixed size, so that eight hours cost no more
# memory than a second. Shortest duration that is distinguished, s.
SMALLEST_DURATION_S = 1e-6
# Bins per factor e; the edges are 2.5 % apart.
BINS_PER_E_FOLD = 40
# Bins up to SMALLEST_DURATION_S x e^18, about 65 s.
DURATION_BINS = BINS_PER_E_FOLD * 18 + 1


class DurationHistogram:
    """Counts durations in bins 2.5 % wide, from 1 us to 65 s; the longest is stored exactly."""

    def __init__(self) -> None:
        self._counts = [0] * DURATION_BINS
        self.n = 0
        self.longest_s = 0.0

    def add_duration(self, duration_s: float) -> None:
        """Count one duration, s; a negative duration counts by its absolute value."""
        size_s = abs(duration_s)
        place = (
            int(math.log(size_s / SMALLEST_DURATION_S) * BINS_PER_E_FOLD)
            if size_s > SMALLEST_DURATION_S
            else 0
        )
        self._counts[min(place, DURATION_BINS - 1)] += 1
        self.n += 1
        self.longest_s = max(self.longest_s, size_s)

    def find_quantile_s(self, share: float) -> float:
        """Return the duration, s, that a `share` (0 to 1) of all durations does not exceed, to 2.5
        %; 0 without durations."""
        wanted, seen = share * self.n, 0
        for place, count in enumerate(self._counts):
            seen += count
            if count and seen >= wanted:
                return min(
                    SMALLEST_DURATION_S * math.exp((place + 1) / BINS_PER_E_FOLD), self.longest_s
                )
        return 0.0


class TickPunctuality:
    """Measures period errors |interval between ticks - period|, time spent in ticks, and skipped
    ticks."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.errors = DurationHistogram()
        self.busy = DurationHistogram()
        self.skipped = 0
        self._last_s: float | None = None

    def note_tick_begin(self, now_s: float) -> None:
        """Count the error of the period that ends with the beginning of this tick, `now_s`."""
        if self._last_s is not None:
            self.errors.add_duration(now_s - self._last_s - self.period_s)
        self._last_s = now_s

    def note_tick_end(self, began_s: float, now_s: float) -> None:
        """Count the duration of a tick, s."""
        self.busy.add_duration(now_s - began_s)

    def summarise_ms(self) -> dict[str, float]:
        """Return figures in ms: p50, p99, p99.9 and largest period error; median and longest tick;
        ticks run and skipped."""
        ms = 1000.0
        return {
            "hz": 1.0 / self.period_s,
            "ticks": self.busy.n,
            "skipped": self.skipped,
            "p50_ms": self.errors.find_quantile_s(0.5) * ms,
            "p99_ms": self.errors.find_quantile_s(0.99) * ms,
            "p999_ms": self.errors.find_quantile_s(0.999) * ms,
            "max_ms": self.errors.longest_s * ms,
            "busy_p50_ms": self.busy.find_quantile_s(0.5) * ms,
            "busy_max_ms": self.busy.longest_s * ms,
        }


# A condition that flickers counts as false. A disk that fails twice within this time, s, is trusted
# again only after the same time without a failure. Pure.
FLICKER_SETTLING_S = 60.0


class FlickerFilter:
    """Filters a condition that flickers.

    The filter is fed at each change. False passes at once. True passes at once after the first
    failure for long, else after `FLICKER_SETTLING_S` of True: flow that switches off and on by
    itself would produce stripes.
    """

    def __init__(self) -> None:
        # Time of the last False, s.
        self._good, self._flickers, self._bad_s = True, False, -inf

    def filter_flicker(self, now_s: float, good: bool) -> bool:
        """Return the filtered condition at `now_s`, s."""
        lately = now_s - self._bad_s < FLICKER_SETTLING_S
        if not good:
            self._flickers = lately and (self._good or self._flickers)
            self._bad_s = now_s
        self._good = good
        return good and not (self._flickers and lately)


# Reason of a run's end when a client asked the worker to quit.
QUIT_REASON = "asked to quit"
# Name of whoever stops a run that no client has stopped.
WORKER_NAME = "control worker"
# Receives the answer and its additions; must return at once.
Reply = Callable[[Answer, dict[str, Any]], None]


class QueuedRequest(NamedTuple):
    """Holds a request with the function that receives the answer."""

    what: RequestContent
    reply: Reply
    # Name of the client.
    by: str = ""


class Host:
    """Runs one assembly until a stop is requested, or until no operating console was heard for
    `orphan_s`.

    Parameters
    ----------
    assembly
        Parts of the run.
    clock
        Returns seconds since the start of the run, the time base of log and measurements.
    sleep
        Waits a number of seconds.
    hz
        Ticks per second.
    orphan_s
        Longest time without an operating console, s.
    run_aside
        Runs slow work outside of the loop; a simulation runs it at once.
    files
        Writes captures and lag tables; a simulation gives files without a thread.
    """

    def __init__(
        self,
        assembly: RunAssembly,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
        *,
        hz: float = DEFAULT_TICK_HZ,
        orphan_s: float = ORPHAN_TIMEOUT_S,
        run_aside: RunAside = run_in_thread,
        files: SideFiles | None = None,
    ) -> None:
        self.newest_frame: Frame | None = None
        # Attached consoles, as the link reports them.
        self.attached: tuple[AttachedConsole, ...] = ()
        self._ordered: deque[ExecutedOrder] = deque(maxlen=MAX_LATEST_ORDERS)
        # Events of the link for the log.
        self._notes: deque[str] = deque()
        # Reason why the run ended; "" while it runs.
        self.ended = ""
        self.period = TickPunctuality(1.0 / hz)
        self._bench, self._loop, self._writer, self._run_names, self._keeper = assembly
        self._clock, self._sleep = clock, sleep
        self._orphan_s = orphan_s
        self._ticks_a_frame = ceil(hz / MAX_FRAME_HZ - 1e-9)
        # Other threads append to this queue.
        self._inbox: deque[QueuedRequest] = deque()
        # Requests that the loop has taken from the inbox but not yet answered.
        self._waiting: list[QueuedRequest] = []
        self._heard_s = clock()
        # Time of the newest tick, s.
        self._now_s = -inf
        self._ticks = 0
        # State at the newest tick.
        self._state: str | None = None
        self._files = files or SideFiles()
        self._device_service = DeviceService(
            self._bench, self._run_names.log_path, self._files, run_aside=run_aside
        )
        self.lag = LagBench(self._bench, self._loop, self._files)
        self._lag_tests = 0
        self._devices: tuple[DeviceView, ...] = ()
        self._devices_due_s = -inf
        self._totals: Totals | None = None
        self._totals_due_s = -inf
        # Reason why the run is to end.
        self._stop = ""
        self._stopped_by = ""
        # True after the last tick, in which the loop was stopped.
        self._has_run_last_tick = False
        self._log = FlickerFilter()
        # Former log, which another program has truncated.
        self._cut_short: Path | None = None
        self._cut_s = -inf
        # Reason why the last tick failed; "" for a finished tick.
        self._failed = ""
        # Failures that were already printed to stderr.
        self._reported: set[str] = set()

    # Other threads may call the following methods.

    def note_event(self, event: str) -> None:
        """Queue an event for the log's next row."""
        self._notes.append(event)

    def queue_request(self, what: RequestContent, reply: Reply, by: str = "") -> bool:
        """Queue a request; return False when too many are waiting. The next tick's thread gives the
        answer.

        A request that stops the machine is never refused and never waits: the next tick answers
        everything that arrived before it.

        Parameters
        ----------
        what
            Order or question.
        reply
            Receives the answer; must return at once.
        by
            Name of the client.
        """
        if len(self._inbox) + len(self._waiting) >= MAX_WAITING_REQUESTS and not _is_stop_request(
            what
        ):
            return False
        self._inbox.append(QueuedRequest(what, reply, by))
        return True

    def note_console_heard(self) -> None:
        """Record that an operating console was just heard."""
        self._heard_s = self._clock()

    def request_stop(self, why: str, by: str = WORKER_NAME) -> None:
        """End the run after one more tick, in which the loop is stopped. A signal handler may call
        this function."""
        if not self._stop:
            self._stop, self._stopped_by = why, by

    # The following methods run the ticks, in the thread of the loop.

    def run_until_stopped(self) -> str:
        """Run ticks until stopped or orphaned, and return the reason. Drives are switched off and
        the log is closed in any case."""
        why = "failed"
        try:
            due_s = self._clock()
            while not self._has_run_last_tick:
                # Deadlines are absolute, so that a late tick does not shift all later ticks.
                self._sleep(max(0.0, due_s - self._clock()))
                now_s = self._clock()
                self.period.note_tick_begin(now_s)
                if now_s - self._heard_s > self._orphan_s:
                    self.request_stop("orphaned")
                self.run_one_tick(now_s)
                self.period.note_tick_end(now_s, self._clock())
                due_s = self._find_next_due_s(due_s, now_s)
            why = self._stop
        finally:
            self.close_run(why)
        return why

    def run_one_tick(self, now_s: float) -> None:
        """Take orders, measure, decide, command the drives, log, make the frame, in this order.

        This function never raises: a tick that fails stops the drives, and the next tick goes on. A
        clock that is set back counts as standing: rows, frames and captures never go back in time.
        """
        now_s = self._now_s = max(self._now_s, now_s)
        for waiting in self._take_due_requests():
            self._answer_request(waiting, now_s)
        self._has_run_last_tick = bool(self._stop)
        try:
            if self._stop:
                self._loop.handle_order(Order(Do.STOP), self._stopped_by)
            self._control_machine(now_s)
        except Exception as error:
            self._stop_after_failure(now_s, error)
        self._ticks += 1

    def _control_machine(self, now_s: float) -> None:
        """Run one tick of measuring, deciding and commanding."""
        measurements = self._bench.read_measurements(now_s)
        if self._failed:
            measurements = measurements._replace(control_failed=True)
        self._run_guarded(lambda: self._follow_new_log(now_s))
        if now_s - self._cut_s < LOG_CUT_NOTICE_S:
            measurements = measurements._replace(log_cut=Path(self._run_names.log_path).name)
        while self._notes:
            self._loop.add_event(self._notes.popleft())
        for service in (self._device_service.end_due_work, self.lag.follow_test):
            self._run_guarded(lambda service=service: service(now_s, self._state))  # type: ignore[misc]
        log_ok = self._log.filter_flicker(now_s, self._writer.ok)
        tick = self._loop.run_tick(measurements, now_s - self._heard_s, log_ok)
        # Commands precede the log and the frame, so that neither delays the drives.
        self._bench.send_command(now_s, tick.command, tick.is_enabled)
        self._state, self._failed = tick.row.state, ""
        self._run_guarded(lambda: self._record_tick(tick))
        self._ordered.extend(read_orders(tick.row.events, tick.row.time_s))
        if self._ticks % self._ticks_a_frame == 0 or self._has_run_last_tick:
            self.newest_frame = self._make_frame(now_s, tick)

    def _follow_new_log(self, now_s: float) -> None:
        """Follow the writer to a new log after another program has truncated the old log."""
        cut_short = self._writer.cut_short
        if cut_short != self._cut_short:
            self._cut_short, self._cut_s = cut_short, now_s
            self._run_names = self._run_names._replace(log_path=str(self._writer.path))
            self._notes.append(f"log_cut_short {cut_short}")
            if self._keeper is not None:
                self._keeper.follow_log(self._run_names.log_path)

    def _record_tick(self, tick: Tick) -> None:
        """Hand the tick to the snapshot and the log."""
        if self._keeper is not None:
            self._keeper.take_tick(tick)
        self._writer.append(tick.row)

    def _stop_after_failure(self, now_s: float, error: Exception) -> None:
        """Stop drives and loop after a failed tick and inform the console, even if everything else
        fails."""
        # The drives come first and are reached without the loop, which may be the cause of the
        # failure.
        self._run_guarded(lambda: self._bench.send_command(now_s, None, False))
        self._run_guarded(lambda: self._loop.handle_order(Order(Do.STOP), WORKER_NAME))
        self._failed = self._report_error_once(error)
        if self.newest_frame is not None:
            alarm = Alarm("control_failed", Severity.RED, now_s, False)
            others = tuple(one for one in self.newest_frame.alarms if one.id != alarm.id)
            self.newest_frame = replace(
                self.newest_frame,
                seq=self._ticks,
                at_s=now_s,
                alarms=(alarm, *others),
                why_no_flow=("not_working",),
            )

    def _run_guarded(self, do: Callable[[], object]) -> None:
        """Run work that may fail without costing the tick; a failure is reported once."""
        try:
            do()
        except Exception as error:
            self._report_error_once(error)

    def _report_error_once(self, error: Exception) -> str:
        """Print a failure to stderr once, and return it as one line."""
        said = f"{type(error).__name__}: {error}"[:MAX_TEXT_CHARACTERS]
        # A failure of every tick would fill the disk with messages.
        if said not in self._reported and len(self._reported) < MAX_REPORTED_FAILURES:
            self._reported.add(said)
            print(
                "topdress worker:",
                "".join(traceback.format_exception(error)),
                file=sys.stderr,
                flush=True,
            )
        return said

    def close_run(self, why: str) -> None:
        """Switch the drives off, end the log, close the devices; each step runs even if the step
        before fails. A second call does nothing."""
        if self.ended:
            return
        self.ended = why
        if self._keeper is not None and why == QUIT_REASON:
            self._keeper.note_quit()
        try:
            self._bench.send_command(self._clock(), None, False)
        finally:
            try:
                self._writer.close()
            finally:
                self._files.close_files()
                self._bench.close_devices()

    # The following methods are private to the host.

    def _find_next_due_s(self, due_s: float, now_s: float) -> float:
        """Return the time of the next tick; missed ticks are skipped."""
        period_s = self.period.period_s
        due_s += period_s
        if now_s - due_s <= MAX_CATCH_UP_PERIODS * period_s:
            return due_s
        missed = int((now_s - due_s) / period_s) + 1
        self.period.skipped += missed
        return due_s + missed * period_s

    def _take_due_requests(self) -> list[QueuedRequest]:
        """Return the requests of this tick in the order of arrival: a bounded number, but always up
        to the last request that stops."""
        while self._inbox:
            self._waiting.append(self._inbox.popleft())
        stop = max(
            (
                number
                for number, one in enumerate(self._waiting, start=1)
                if _is_stop_request(one.what)
            ),
            default=0,
        )
        count = max(MAX_REQUESTS_PER_TICK, stop)
        due, self._waiting = self._waiting[:count], self._waiting[count:]
        return due

    def _answer_request(self, waiting: QueuedRequest, now_s: float) -> None:
        """Answer one request."""
        extra: dict[str, Any] = {}
        if isinstance(waiting.what, Order):
            answer = self._obey_loop_order(waiting.what, waiting.by)
        elif isinstance(waiting.what, DeviceOrder):
            answer = self._obey_device_order(waiting.what, now_s)
        else:
            answer = Answer(True)
            if waiting.what is ClientQuestion.LAG_TEST:
                answer = self._begin_lag_test()
            elif waiting.what is ClientQuestion.END_LAG_TEST:
                self.lag.end_lag_test()
            elif waiting.what is ClientQuestion.STATS:
                extra["stats"] = self.period.summarise_ms()
            elif waiting.what is ClientQuestion.QUIT:
                self.request_stop(QUIT_REASON, waiting.by)
        self._run_guarded(lambda: waiting.reply(answer, extra))

    def _begin_lag_test(self) -> Answer:
        """Begin a lag test with a table next to the log."""
        log = self._run_names.log_path
        self._lag_tests += 1
        return self.lag.begin_lag_test(
            Path(log).with_suffix(f".lag.{self._lag_tests}.csv") if log else None
        )

    def _obey_loop_order(self, order: Order, by: str) -> Answer:
        """Pass an order to the loop."""
        try:
            return self._loop.handle_order(order, by)
        # An order that the loop cannot process must not stop a machine in the field.
        except Exception as error:
            return Answer(
                False,
                f"internal_error: {order.do} {order.value!r}: {type(error).__name__}: {error}",
            )

    def _obey_device_order(self, order: DeviceOrder, now_s: float) -> Answer:
        """Pass an order to the device service."""
        try:
            return self._device_service.obey_device_order(order, now_s, self._state)
        except Exception as error:
            return Answer(False, f"internal_error: {order.do}: {self._report_error_once(error)}")

    def _make_frame(self, now_s: float, tick: Tick) -> Frame:
        """Make the frame of a tick."""
        names = self._run_names
        # The list of devices is expensive and changes slowly, so it has a period of its own.
        if now_s >= self._devices_due_s:
            self._devices_due_s = now_s + DEVICE_LIST_PERIOD_S
            self._devices = tuple(
                map(self._make_device_view, self._bench.list_device_status(now_s))
            )
        if now_s >= self._totals_due_s:
            self._totals, self._totals_due_s = self._loop.totals, now_s + TOTALS_PERIOD_S
        shown: dict[str, Any] = {name: getattr(tick, name) for name in FRAME_FIELDS}
        return Frame(
            seq=self._ticks,
            at_s=now_s,
            job=names.job,
            machine=names.machine,
            crop=names.crop,
            log_path=names.log_path,
            simulated=names.simulated,
            devices=self._devices,
            totals=self._totals,
            lag_test=self.lag.describe_test(),
            consoles=sum(one.keeps for one in self.attached),
            attached=self.attached,
            ordered=tuple(self._ordered),
            tally=None if self._keeper is None else self._keeper.tally,
            **shown,
        )

    def _make_device_view(self, status: DeviceStatus) -> DeviceView:
        """Return a device's status with plug, capture and test."""
        known = {name: getattr(status, name) for name in DeviceStatus.__dataclass_fields__}
        line = self._bench.find_device_line(status.name)
        return DeviceView(
            **known,
            plugged=line is None or line.plugged,
            capture_path=self._device_service.find_capture_path(status.name),
            test=self._device_service.find_test_result(status.name),
        )


def _is_stop_request(what: RequestContent) -> bool:
    """Return whether a request stops flow or worker; such a request is never refused for lack of
    room."""
    return what is ClientQuestion.QUIT or (
        isinstance(what, Order) and what.do in (Do.STOP, Do.HOLD, Do.RELEASE)
    )
