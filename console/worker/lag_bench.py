"""Runs the lag test in the worker: tick by tick, requests of the procedure become orders to the
loop and to the rig.

This module starts no shaft by itself: it defines what a calibration run does, and all rules of such
a run apply.
"""

from __future__ import annotations

from pathlib import Path

from topdress.console.frame import LagTestView
from topdress.console.worker.run_interfaces import MachineDevices
from topdress.console.worker.side_files import SideFiles
from topdress.control.loop import ControlLoop
from topdress.control.orders import Answer, Do, Order, State
from topdress.drivers.devices.lag_run import (
    LagProcedure,
    LagTestPlan,
    make_bench_row,
    make_bench_table,
)


class LagBench:
    """Runs at most one lag test at a time. `follow_test` runs between measuring and deciding."""

    def __init__(self, bench: MachineDevices, loop: ControlLoop, files: SideFiles) -> None:
        self._bench, self._loop, self._files = bench, loop, files
        self._test: LagProcedure | None = None
        self._table: Path | None = None
        self._written = 0
        self._said = ""
        self._phase = ""
        # Shaft speed that the loop accepted last, r/min; None while this calibration run has no
        # command.
        self._sent_rpm: float | None = None

    @property
    def current_test(self) -> LagProcedure | None:
        """Lag test in progress, or None."""
        return self._test

    def begin_lag_test(self, table: Path | None, plan: LagTestPlan | None = None) -> Answer:
        """Begin a test with its first run.

        Parameters
        ----------
        table
            File to which each measured run is written, or None.
        plan
            Runs of the test; None means the standard plan.
        """
        if self._bench.rig_readings is None:
            return Answer(False, "no_lag_rig")
        self._test, self._table, self._written, self._said = LagProcedure(plan), table, 0, ""
        if table is not None:
            self._files.queue_append(table, make_bench_table(()).encode())
        return Answer(True)

    def end_lag_test(self) -> None:
        """Stop the shaft and end the test; measured runs remain in their file."""
        if self._test is not None and self._sent_rpm:
            self._loop.handle_order(Order(Do.CALIBRATE_SHAFT, 0.0))
        self._test = None

    def follow_test(self, now_s: float, state: str | None) -> None:
        """Convert the procedure's request of this tick to orders for the loop and the rig.

        Parameters
        ----------
        now_s
            Run time, s.
        state
            State at the newest tick, which is one tick old; the loop refuses an order that comes
            too late.
        """
        if self._test is None:
            return
        allowed = state == State.CALIBRATING
        if not allowed:
            # A new calibration run starts without a command, so the next one must be sent again.
            self._sent_rpm = None
        wish = self._test.run_tick(now_s, self._bench.rig_readings, allowed)
        self._phase, self._said = wish.phase, wish.failure or self._said
        self._bench.send_rig_order(wish.run, wish.arm)
        if allowed and wish.shaft_rpm != self._sent_rpm:
            answer = self._loop.handle_order(Order(Do.CALIBRATE_SHAFT, wish.shaft_rpm))
            self._sent_rpm = wish.shaft_rpm if answer.accepted else None
        self._write_new_runs()

    def describe_test(self) -> LagTestView | None:
        """Return the test for the frame; None without a test."""
        test = self._test
        if test is None:
            return None
        shaft_rpm, replicate = test.find_present_run
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
        """Append the runs measured since the last call to the table."""
        assert self._test is not None
        for run in self._test.runs[self._written :]:
            if self._table is not None:
                self._files.queue_append(self._table, make_bench_row(run).encode())
        self._written = len(self._test.runs)
