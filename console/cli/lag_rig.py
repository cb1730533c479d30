"""How does `topdress calibrate lag --rig URL` run the lag test on real devices and write a lag
bench table?
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import typer
from topdress.console.app.frame_words import describe_refusal
from topdress.console.cli.bench_session import (
    BenchOperator,
    Keyboard,
    end_on_signals,
    make_host,
    open_keyboard,
    print_stderr_line,
    run_attended,
    show_progress,
)
from topdress.console.cli.plain_errors import CommandError
from topdress.console.frame import Frame, LagTestView
from topdress.control.orders import Do, Order, State


def measure_lag(
    rig: str,
    board: str | None,
    gnss: str | None,
    *,
    machine: str,
    out: Path,
    speeds_rpm: Sequence[float],
    repeats: int,
    opening_mm: float | None,
    no_key: bool,
) -> None:
    """Runs the procedure and writes `out`. Raises CommandError; after an interruption the measured
    runs stay in the table.

    Without a board the machine's own drive turns the shaft: `repeats` runs, drop times only.
    """
    if board is None:
        from topdress.console.cli.drop_test import measure_drop

        with end_on_signals():
            measure_drop(rig, out, repeats)
        return
    if not (no_key or sys.stdin.isatty()):
        raise CommandError(
            "lag test: the shaft turns only while the space bar is held down, and there is "
            "no keyboard "
            "here: allowed is --no-key, with somebody at the hard-wired stop"
        )
    from topdress.drivers.devices.lag_run import LagTestPlan

    plan = LagTestPlan(shaft_rpm=tuple(speeds_rpm) or LagTestPlan().shaft_rpm, repeats=repeats)
    with open_keyboard() as keyboard:
        attended = LagOperator(
            keyboard, out, plan, opening_mm=opening_mm, no_key=no_key, with_gnss=gnss is not None
        )
        began = time.monotonic()
        host, _ = make_host(
            {"lag_rig": rig, "board": board, "gnss": gnss},
            machine,
            lambda: time.monotonic() - began,
            attended.pause_between_ticks,
        )
        attended.host = host
        try:
            run_attended(host)
        finally:
            show_progress("")
            if out.exists() and not attended.measured:
                out.unlink()
            elif attended.measured:
                typer.echo(f"{attended.measured} of {len(plan.shaft_rpm) * repeats} runs: {out}")
    if attended.trouble:
        raise CommandError(f"lag test: {attended.trouble}")
    for line in attended.left_out:
        typer.echo(f"left out: {line}")


class LagOperator(BenchOperator):
    """Runs the lag test at the bench. `measured` is the number of runs in the table; `left_out`
    holds the reasons of the abandoned runs."""

    def __init__(
        self,
        keyboard: Keyboard,
        out: Path,
        plan: Any,
        *,
        opening_mm: float | None,
        no_key: bool,
        with_gnss: bool,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(keyboard, no_key, clock, sleep)
        self.measured = 0
        self.left_out: list[str] = []
        self._out, self._plan, self._opening_mm = out, plan, opening_mm
        self._with_gnss = with_gnss
        self._started = False
        self._said = ""
        self._shown_s = -1.0
        self._runs_started_s: float | None = None

    def list_set_points(self) -> Sequence[Order]:
        return () if self._opening_mm is None else (Order(Do.CALIBRATE_OPENING, self._opening_mm),)

    def follow_frame(self, frame: Frame, now_s: float, pressed: str) -> None:
        view = frame.lag_test
        if not self._started:
            answer = self.host.lag.begin_lag_test(self._out, self._plan)
            self._started = answer.accepted
            if not self._started:
                self.give_up(describe_refusal(answer.why))
        if view is None:
            return
        self.measured = len(view.runs)
        if view.said and view.said != self._said:
            self._said = view.said
            print_stderr_line(f"failed: {view.said}")
        if view.phase == "done":
            test = self.host.lag.current_test
            self.left_out = [
                f"{rpm:g} r/min, repeat {n}: {why}"
                for rpm, n, why in (test.left_out if test else ())
            ]
            self.host.request_stop("done")
            return
        self.hold_button(frame, now_s)
        self._show_test(frame, view, now_s)

    def _show_test(self, frame: Frame, view: LagTestView, now_s: float) -> None:
        if now_s - self._shown_s < 0.2:
            return
        self._shown_s = now_s
        if self._runs_started_s is None and frame.row.state == State.CALIBRATING:
            self._runs_started_s = now_s
        left = ""
        if view.progress and self._runs_started_s is not None:
            left_s = (now_s - self._runs_started_s) * (1.0 - view.progress) / view.progress
            left = f", about {left_s / 60.0:.0f} min left"
        what = (
            f"{view.shaft_rpm:g} r/min, repeat {view.replicate}, {view.phase}"
            if frame.row.state == State.CALIBRATING
            else self.refusal or "hold the space bar down"
        )
        standing = "" if self._with_gnss else " (standing by the wheel alone)"
        show_progress(f"lag test {100 * view.progress:.0f} %: {what}{left}{standing}; Ctrl-C ends ")
