"""The control loop's host: one tick after the other at absolute deadlines.

Nothing here touches a socket or a disk. Others reach the host by three things only: `inbox`
(requests with the function that takes the answer), `note_console_heard` (an operating console was
heard just now) and `newest` (the newest frame).
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

from topdress.console.attached import LATEST, Attached, Ordered, read_orders
from topdress.console.frame import DeviceView, Frame
from topdress.console.worker.device_service import DeviceService
from topdress.console.worker.lag_bench import LagBench
from topdress.console.worker.limits import (
    CATCH_UP_PERIODS,
    DEVICES_S,
    FRAME_HZ,
    HZ_DEFAULT,
    ORPHAN_S,
    REPORTED_KINDS,
    REQUESTS_A_TICK,
    REQUESTS_WAITING,
    SAID_S,
    TEXT_CHARACTERS,
    TOTALS_S,
)
from topdress.console.worker.parts import FRAME_FIELDS, Assembly
from topdress.console.worker.requests import DeviceOrder, Question, RequestContent
from topdress.console.worker.side_files import SideFiles
from topdress.control.field.totals import Totals
from topdress.control.loop import Tick
from topdress.control.orders import Alarm, Answer, Do, Order, Severity
from topdress.drivers.device_status import DeviceStatus

# How punctual the loop is: a histogram of fixed size, so that eight hours cost no more than a
# second.
SMALLEST_DURATION_S = 1e-6
BINS_PER_E_FOLD = 40  # bin edges 2.5 % apart
DURATION_BINS = BINS_PER_E_FOLD * 18 + 1  # up to SMALLEST_S x e^18, about 65 s


class DurationHistogram:
    """Counts durations in bins 2.5 % wide, from 1 us to 65 s; the longest is kept as it is."""

    def __init__(self) -> None:
        self._counts = [0] * DURATION_BINS
        self.n = 0
        self.longest_s = 0.0

    def add_duration(self, duration_s: float) -> None:
        """Count one duration, s; a negative one counts by its size."""
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
        """Duration, s, that `share` (0 to 1) of all do not exceed, to 2.5 %; 0 where nothing was
        counted."""
        wanted, seen = share * self.n, 0
        for place, count in enumerate(self._counts):
            seen += count
            if count and seen >= wanted:
                return min(
                    SMALLEST_DURATION_S * math.exp((place + 1) / BINS_PER_E_FOLD), self.longest_s
                )
        return 0.0


class TickPunctuality:
    """Measures period errors |interval between ticks - period|, time spent in ticks, and ticks
    skipped."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.errors = DurationHistogram()
        self.busy = DurationHistogram()
        self.skipped = 0
        self._last_s: float | None = None

    def note_tick_begin(self, now_s: float) -> None:
        """Count the error of the period that ended with this tick's begin, `now_s`."""
        if self._last_s is not None:
            self.errors.add_duration(now_s - self._last_s - self.period_s)
        self._last_s = now_s

    def note_tick_end(self, began_s: float, now_s: float) -> None:
        """Count the time that a tick took, s."""
        self.busy.add_duration(now_s - began_s)

    def summarise_ms(self) -> dict[str, float]:
        """Milliseconds: p50, p99, p99.9 and largest period error; median and longest tick; ticks
        run and skipped."""
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


# A yes that flickers is a no. Pure.
# a disk that fails twice within it is believed again after as long without
SETTLED_S = 60.0


class FlickerFilter:
    """Filters a yes that flickers.

    Fed at each change; the answer is no at once, and yes again at once where that was the first no
    for long, else after `SETTLED_STEP_S` of yes: flow that is switched off and on by itself lays
    stripes.
    """

    def __init__(self) -> None:
        # bad_s: seen bad then the last time
        self._good, self._flickers, self._bad_s = True, False, -inf

    def filter_flicker(self, now_s: float, good: bool) -> bool:
        """Answer at `now_s`, s, for a condition that is `good` or not."""
        lately = now_s - self._bad_s < SETTLED_S
        if not good:
            self._flickers = lately and (self._good or self._flickers)
            self._bad_s = now_s
        self._good = good
        return good and not (self._flickers and lately)


QUIT = "asked to quit"
WORKER = "control worker"  # by whom a run is stopped that nobody stopped
# must return at once; the second part goes with the answer
Reply = Callable[[Answer, dict[str, Any]], None]


class QueuedRequest(NamedTuple):
    what: RequestContent
    reply: Reply
    by: str = ""  # the name of who asks


class Host:
    """Runs one assembly until asked to stop, or until no operating console was heard for
    `orphan_s`.

    `clock` gives seconds since the start of the run (the time base of log and measurements),
    `sleep` waits seconds.
    """

    def __init__(
        self,
        assembly: Assembly,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
        *,
        hz: float = HZ_DEFAULT,
        orphan_s: float = ORPHAN_S,
    ) -> None:
        self.newest: Frame | None = None
        self.attached: tuple[Attached, ...] = ()  # reported by the link
        self._ordered: deque[Ordered] = deque(maxlen=LATEST)
        self._notes: deque[str] = deque()  # events that the link has for the log
        self.ended = ""  # why the run ended; empty while it runs
        self.period = TickPunctuality(1.0 / hz)
        self._bench, self._loop, self._writer, self._names, self._keeper = assembly
        self._clock, self._sleep = clock, sleep
        self._orphan_s = orphan_s
        self._ticks_a_frame = ceil(hz / FRAME_HZ - 1e-9)
        self._inbox: deque[QueuedRequest] = deque()  # filled by other threads
        # taken from there by the loop, and not yet answered
        self._waiting: list[QueuedRequest] = []
        self._heard_s = clock()
        self._now_s = -inf  # of the newest tick
        self._ticks = 0
        self._state: str | None = None  # of the newest tick
        self._files = SideFiles()
        self._device_service = DeviceService(self._bench, self._names.log_path, self._files)
        self.lag = LagBench(self._bench, self._loop, self._files)
        self._lag_tests = 0
        self._devices: tuple[DeviceView, ...] = ()
        self._devices_due_s = -inf
        self._totals: Totals | None = None
        self._totals_due_s = -inf
        self._stop = ""  # why the run shall end
        self._stopped_by = ""
        self._off = False  # the last tick, with the loop stopped, was run
        self._log = FlickerFilter()
        # the log before this one, which another program has cut short
        self._cut_short: Path | None = None
        self._cut_s = -inf
        # why the last tick could not be finished; empty: it was
        self._failed = ""
        self._reported: set[str] = set()  # failures that stderr has heard of

    # --- called from other threads
    # -----------------------------------------------------------------------------------

    def note_event(self, event: str) -> None:
        """Queue an event for the log's next row."""
        self._notes.append(event)

    def queue_request(self, what: RequestContent, reply: Reply, by: str = "") -> bool:
        """Queue a request; False when too many are waiting. The answer comes with the next tick, on
        its thread.

        A request that stops the machine is never refused, and never waits: the next tick answers
        all that came before it.

        Parameters
        ----------
        what: the order or question.
        reply: takes the answer; it must return at once.
        by: the name of the client.
        """
        if len(self._inbox) + len(self._waiting) >= REQUESTS_WAITING and not _is_stop_request(what):
            return False
        self._inbox.append(QueuedRequest(what, reply, by))
        return True

    def note_console_heard(self) -> None:
        """Note that an operating console was heard just now."""
        self._heard_s = self._clock()

    def request_stop(self, why: str, by: str = WORKER) -> None:
        """End the run: one more tick, with the loop ordered to stop (also safe in a signal
        handler)."""
        if not self._stop:
            self._stop, self._stopped_by = why, by

    # --- the run
    # ----------------------------------------------------------------------------------------------

    def run_until_stopped(self) -> str:
        """Tick until stopped or orphaned; returns why. Drives are off and the log is closed however
        this ends."""
        why = "failed"
        try:
            due_s = self._clock()
            while not self._off:
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
        """Take orders, measure, decide, command the drives, log, make the frame: in this order.

        Never raises: a tick that fails stops the drives, and the next one goes on. A clock that is
        set back stands still: rows, frames and captures never go back in time.
        """
        now_s = self._now_s = max(self._now_s, now_s)
        for waiting in self._take_due_requests():
            self._answer_request(waiting, now_s)
        self._off = bool(self._stop)
        try:
            if self._stop:
                self._loop.handle_order(Order(Do.STOP), self._stopped_by)
            self._control_machine(now_s)
        except Exception as error:
            self._stop_after_failure(now_s, error)
        self._ticks += 1

    def _control_machine(self, now_s: float) -> None:
        measurements = self._bench.read_measurements(now_s)
        if self._failed:
            measurements = measurements._replace(control_failed=True)
        self._run_guarded(lambda: self._follow_new_log(now_s))
        if now_s - self._cut_s < SAID_S:
            measurements = measurements._replace(log_cut=Path(self._names.log_path).name)
        while self._notes:
            self._loop.add_event(self._notes.popleft())
        for service in (self._device_service.end_due_work, self.lag.follow_test):
            self._run_guarded(lambda service=service: service(now_s, self._state))  # type: ignore[misc]
        log_ok = self._log.filter_flicker(now_s, self._writer.ok)
        tick = self._loop.run_tick(measurements, now_s - self._heard_s, log_ok)
        self._bench.send_command(now_s, tick.command, tick.is_enabled)
        self._state, self._failed = tick.row.state, ""
        self._run_guarded(lambda: self._record_tick(tick))
        self._ordered.extend(read_orders(tick.row.events, tick.row.time_s))
        if self._ticks % self._ticks_a_frame == 0 or self._off:
            self.newest = self._make_frame(now_s, tick)

    def _follow_new_log(self, now_s: float) -> None:
        """Follow the writer to a new log after another program has cut the old one short."""
        cut_short = self._writer.cut_short
        if cut_short != self._cut_short:
            self._cut_short, self._cut_s = cut_short, now_s
            self._names = self._names._replace(log_path=str(self._writer.path))
            self._notes.append(f"log_cut_short {cut_short}")
            if self._keeper is not None:
                self._keeper.follow_log(self._names.log_path)

    def _record_tick(self, tick: Tick) -> None:
        if self._keeper is not None:
            self._keeper.take_tick(tick)
        self._writer.append(tick.row)

    def _stop_after_failure(self, now_s: float, error: Exception) -> None:
        """Stop the drives and the loop after a tick that failed and inform the console, even where
        all else fails."""
        self._run_guarded(lambda: self._bench.send_command(now_s, None, False))
        self._run_guarded(lambda: self._loop.handle_order(Order(Do.STOP), WORKER))
        self._failed = self._report_error_once(error)
        if self.newest is not None:
            alarm = Alarm("control_failed", Severity.RED, now_s, False)
            others = tuple(one for one in self.newest.alarms if one.id != alarm.id)
            self.newest = replace(
                self.newest,
                seq=self._ticks,
                at_s=now_s,
                alarms=(alarm, *others),
                why_no_flow=("not_working",),
            )

    def _run_guarded(self, do: Callable[[], object]) -> None:
        """Run what may fail without costing the tick; a failure is reported once."""
        try:
            do()
        except Exception as error:
            self._report_error_once(error)

    def _report_error_once(self, error: Exception) -> str:
        said = f"{type(error).__name__}: {error}"[:TEXT_CHARACTERS]
        if said not in self._reported and len(self._reported) < REPORTED_KINDS:
            self._reported.add(said)
            print(
                "topdress worker:",
                "".join(traceback.format_exception(error)),
                file=sys.stderr,
                flush=True,
            )
        return said

    def close_run(self, why: str) -> None:
        """Switch the drives off, end the log, close the devices: each even where the step before
        fails. A second call does nothing."""
        if self.ended:
            return
        self.ended = why
        if self._keeper is not None and why == QUIT:
            self._keeper.note_quit()
        try:
            self._bench.send_command(self._clock(), None, False)
        finally:
            try:
                self._writer.close()
            finally:
                self._files.close_files()
                self._bench.close_devices()

    # --- inside
    # ----------------------------------------------------------------------------------------------

    def _find_next_due_s(self, due_s: float, now_s: float) -> float:
        period_s = self.period.period_s
        due_s += period_s
        if now_s - due_s <= CATCH_UP_PERIODS * period_s:
            return due_s
        missed = int((now_s - due_s) / period_s) + 1
        self.period.skipped += missed
        return due_s + missed * period_s

    def _take_due_requests(self) -> list[QueuedRequest]:
        """The requests of this tick in the order they came: a bounded number, but always up to the
        last that stops."""
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
        count = max(REQUESTS_A_TICK, stop)
        due, self._waiting = self._waiting[:count], self._waiting[count:]
        return due

    def _answer_request(self, waiting: QueuedRequest, now_s: float) -> None:
        extra: dict[str, Any] = {}
        if isinstance(waiting.what, Order):
            answer = self._obey_loop_order(waiting.what, waiting.by)
        elif isinstance(waiting.what, DeviceOrder):
            answer = self._obey_device_order(waiting.what, now_s)
        else:
            answer = Answer(True)
            if waiting.what is Question.LAG_TEST:
                answer = self._begin_lag_test()
            elif waiting.what is Question.END_LAG_TEST:
                self.lag.end_lag_test()
            elif waiting.what is Question.STATS:
                extra["stats"] = self.period.summarise_ms()
            elif waiting.what is Question.QUIT:
                self.request_stop(QUIT, waiting.by)
        self._run_guarded(lambda: waiting.reply(answer, extra))

    def _begin_lag_test(self) -> Answer:
        log = self._names.log_path
        self._lag_tests += 1
        return self.lag.begin_lag_test(
            Path(log).with_suffix(f".lag.{self._lag_tests}.csv") if log else None
        )

    def _obey_loop_order(self, order: Order, by: str) -> Answer:
        try:
            return self._loop.handle_order(order, by)
        # an order that the loop cannot digest stops no machine in the field
        except Exception as error:
            return Answer(
                False,
                f"internal_error: {order.do} {order.value!r}: {type(error).__name__}: {error}",
            )

    def _obey_device_order(self, order: DeviceOrder, now_s: float) -> Answer:
        try:
            return self._device_service.obey_device_order(order, now_s, self._state)
        except Exception as error:
            return Answer(False, f"internal_error: {order.do}: {self._report_error_once(error)}")

    def _make_frame(self, now_s: float, tick: Tick) -> Frame:
        names = self._names
        if now_s >= self._devices_due_s:
            self._devices_due_s = now_s + DEVICES_S
            self._devices = tuple(
                map(self._make_device_view, self._bench.list_device_status(now_s))
            )
        if now_s >= self._totals_due_s:
            self._totals, self._totals_due_s = self._loop.totals, now_s + TOTALS_S
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
        known = {name: getattr(status, name) for name in DeviceStatus.__dataclass_fields__}
        line = self._bench.find_device_line(status.name)
        return DeviceView(
            **known,
            plugged=line is None or line.plugged,
            capture_path=self._device_service.find_capture_path(status.name),
            test=self._device_service.find_test_result(status.name),
        )


def _is_stop_request(what: RequestContent) -> bool:
    return what is Question.QUIT or (
        isinstance(what, Order) and what.do in (Do.STOP, Do.HOLD, Do.RELEASE)
    )
