"""The lag test as the worker runs it: the procedure's wishes become orders to the loop and to
the rig, tick by tick.

It starts no shaft by itself: it only says what a calibrating run is to do, and every rule of
such a run holds.
"""

from __future__ import annotations

from pathlib import Path

from topdress.console.frame import LagTestView
from topdress.console.worker.parts import Bench
from topdress.console.worker.side_files import SideFiles
from topdress.control.loop import ControlLoop
from topdress.control.orders import Answer, Do, Order, State
from topdress.drivers.devices.lag_run import LagPlan, LagTest, make_bench_row, make_bench_table


class LagBench:
    """Runs at most one lag test at a time. `follow_test` is called between measuring and
    deciding."""

    def __init__(self, bench: Bench, loop: ControlLoop, files: SideFiles) -> None:
        self._bench, self._loop, self._files = bench, loop, files
        self._test: LagTest | None = None
        self._table: Path | None = None
        self._written = 0
        self._said = ""
        self._phase = ""
        # as accepted; None: this calibrating run has no command yet
        self._sent_rpm: float | None = None

    @property
    def current_test(self) -> LagTest | None:
        """The lag test that runs; None without one."""
        return self._test

    def begin_lag_test(self, table: Path | None, plan: LagPlan | None = None) -> Answer:
        """Begin a test from its first run.

        table: the file to which each run is written once it is measured; None: none.
        """
        if self._bench.rig_readings is None:
            return Answer(False, "no_lag_rig")
        self._test, self._table, self._written, self._said = LagTest(plan), table, 0, ""
        if table is not None:
            self._files.queue_append(table, make_bench_table(()).encode())
        return Answer(True)

    def end_lag_test(self) -> None:
        """Stop the shaft and forget the test; the runs measured stay in their file."""
        if self._test is not None and self._sent_rpm:
            self._loop.handle_order(Order(Do.CALIBRATE_SHAFT, 0.0))
        self._test = None

    def follow_test(self, now_s: float, state: str | None) -> None:
        """Turn the procedure's wish of this tick into orders to the loop and the rig.

        state: of the newest tick, so one tick old: an order that comes too late is refused by the
        loop.
        """
        if self._test is None:
            return
        allowed = state == State.CALIBRATING
        if not allowed:
            self._sent_rpm = None
        wish = self._test.run_tick(now_s, self._bench.rig_readings, allowed)
        self._phase, self._said = wish.phase, wish.said or self._said
        self._bench.send_rig_order(wish.run, wish.arm)
        if allowed and wish.shaft_rpm != self._sent_rpm:
            answer = self._loop.handle_order(Order(Do.CALIBRATE_SHAFT, wish.shaft_rpm))
            self._sent_rpm = wish.shaft_rpm if answer.accepted else None
        self._write_new_runs()

    def describe_test(self) -> LagTestView | None:
        """The test as the frame shows it; None without one."""
        test = self._test
        if test is None:
            return None
        shaft_rpm, replicate = test.present_run
        return LagTestView(
            self._phase,
            shaft_rpm,
            replicate,
            test.progress,
            tuple((run.shaft_rpm, run.response_s, run.drop_s) for run in test.runs),
            len(test.left_out),
            self._said,
            str(self._table or ""),
        )

    def _write_new_runs(self) -> None:
        assert self._test is not None
        for run in self._test.runs[self._written :]:
            if self._table is not None:
                self._files.queue_append(self._table, make_bench_row(run).encode())
        self._written = len(self._test.runs)
