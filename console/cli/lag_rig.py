"""`topdress calibrate lag --rig URL`: the lag test on real bytes, to a lag bench table."""
from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from console.app.held_key import HeldKey
from console.app.words import alarm_words, answer_words
from console.cli.plain_errors import CommandError
from console.frame import Frame, LagTestView
from control.log_row import LogRow
from control.orders import Answer, Do, Order, State
from drivers import day_clock

if TYPE_CHECKING:
    from console.worker.host import Host


# Keys of the terminal as they are pressed, without waiting for a line; POSIX and Windows.
class Keys:
    """`pressed`: what was typed since the last call, as text. Nothing where standard input is no terminal."""

    def __init__(self, there: bool) -> None:
        self.there = there

    def pressed(self) -> str:
        if not self.there:
            return ""
        if sys.platform == "win32":
            import msvcrt
            typed = ""
            while msvcrt.kbhit():
                typed += msvcrt.getwch()
            return typed
        ready = select.select([sys.stdin], [], [], 0.0)[0]
        return os.read(sys.stdin.fileno(), 256).decode(errors="replace") if ready else ""


@contextlib.contextmanager
def keys() -> Iterator[Keys]:
    """The keyboard until the end of the block; Ctrl+C still interrupts."""
    if not sys.stdin.isatty():
        yield Keys(False)
        return
    if sys.platform == "win32":
        yield Keys(True)
        return
    import termios
    import tty
    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield Keys(True)
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


HZ = 50.0
HEARD_WITHIN_S = 10.0           # every device must have been heard by then
REPEAT_S = 0.2                  # the held button is confirmed this often
PATIENCE_S = 5.0                # without a key: a refusal that lasts ends the test
KEY = " "


class Unlogged:
    """A log writer that keeps nothing: the table is the record of this test."""

    ok = True
    trouble = ""
    path, cut_short = Path(), None

    def append(self, row: LogRow) -> None:
        pass

    def close(self) -> None:
        pass


def measure_lag(rig: str, board: str | None, gnss: str | None, *, machine: str, out: Path, speeds_rpm: Sequence[float],
                repeats: int, opening_mm: float | None, no_key: bool) -> None:
    """Run the procedure and write `out`. Raises CommandError; interrupted, what was measured stays in the table.

    Without a board the machine's own drive turns the shaft: `repeats` runs, drop times only.
    """
    if board is None:
        from console.cli.drop_by_hand import measure_drop
        measure_drop(rig, out, repeats)
        return
    if not (no_key or sys.stdin.isatty()):
        raise CommandError("lag test: the shaft turns only while the space bar is held down, and there is no keyboard "
                           "here: allowed is --no-key, with somebody at the hard-wired stop")
    from drivers.devices.lag_test import Plan
    plan = Plan(shaft_rpm=tuple(speeds_rpm) or Plan().shaft_rpm, repeats=repeats)
    with keys() as keyboard:
        attended = Attended(keyboard, out, plan, opening_mm=opening_mm, no_key=no_key, with_gnss=gnss is not None)
        began = time.monotonic()
        host = _host(rig, board, gnss, machine, lambda: time.monotonic() - began, attended.between)
        attended.host = host
        try:
            host.run()
        finally:
            sys.stderr.write("\r\x1b[K" if sys.stderr.isatty() else "")
            if out.exists() and not attended.measured:
                out.unlink()
            elif attended.measured:
                typer.echo(f"{attended.measured} of {len(plan.shaft_rpm) * repeats} runs: {out}")
    if attended.trouble:
        raise CommandError(f"lag test: {attended.trouble}")
    for line in attended.left_out:
        typer.echo(f"left out: {line}")


def _host(rig: str, board: str, gnss: str | None, machine: str, clock: Any, between: Any) -> Host:
    from console.worker.host import Host
    from console.worker.parts import Assembly, Names
    from control.loop import ControlLoop
    from control.safety import SafetyLimits
    from drivers.cab import Cab, CabConfig
    from drivers.files.setup import load_setup
    setup = load_setup(machine, "demo", day_clock.today())
    limits = setup.machine.limits
    devices: dict[str, Any] = {
        "lag_rig": {"port": rig},
        "board": {"port": board, "max_shaft_rpm": limits.shaft_high_rpm, "max_opening_mm": limits.opening_high_mm,
                  "wheel_circumference_m": setup.machine.speed.wheel_circumference_m,
                  "wheel_pulses_per_turn": setup.machine.speed.pulses_per_turn}}
    if gnss is not None:
        devices["gnss"] = {"port": gnss}
    loop = ControlLoop(setup.machine, setup.crop, setup.rule, setup.job,
                       safety_limits=SafetyLimits(both_speeds_to_start=gnss is not None))
    return Host(Assembly(Cab(CabConfig.model_validate(devices), clock), loop, Unlogged(), Names()), clock, between,
                hz=HZ)


class Attended:
    """Stands for the person at the bench: between ticks it holds the button down while the key is, and tells how far
    the test is. `trouble`: why it was given up; `measured`: runs in the table."""

    host: Host

    def __init__(self, keyboard: Keys, out: Path, plan: Any, *, opening_mm: float | None, no_key: bool,
                 with_gnss: bool, clock: Callable[[], float] = time.monotonic,
                 sleep: Callable[[float], None] = time.sleep) -> None:
        self._clock, self._sleep = clock, sleep
        self.trouble = ""
        self.measured = 0
        self.left_out: list[str] = []
        self._keyboard, self._out, self._plan, self._opening_mm = keyboard, out, plan, opening_mm
        self._no_key, self._with_gnss = no_key, with_gnss
        self._held = HeldKey()
        self._confirmed_s = -1.0
        self._refused_since_s: float | None = None
        self._refusal = ""
        self._opened = self._started = self._was_down = False
        self._said = ""
        self._shown_s = -1.0
        self._runs_started_s: float | None = None

    def between(self, seconds: float) -> None:
        """The host's pause between two ticks."""
        self._sleep(seconds)
        frame = self.host.newest
        self.host.console_heard()
        if KEY in self._keyboard.pressed():
            self._held.key(self._clock())
        if frame is None:
            return
        now_s = frame.at_s
        if frame.row.state == State.OFF:
            self._make_ready(frame, now_s)
        elif frame.row.state == State.FAULT:
            words = "; ".join(alarm_words(alarm).text for alarm in frame.alarms) or frame.why_state
            self._give_up(words)
        else:
            self._go_on(frame, now_s)

    def _make_ready(self, frame: Frame, now_s: float) -> None:
        silent = [one.name for one in frame.devices if not one.accepted]
        if not silent:
            self._order(Order(Do.READY))
        elif now_s > HEARD_WITHIN_S:
            said = next(one for one in frame.devices if one.name == silent[0])
            self._give_up(f"{said.name} at {said.port} is silent: {said.last_error or said.last_raw or 'no byte'}")

    def _go_on(self, frame: Frame, now_s: float) -> None:
        view = frame.lag_test
        if not self._started:
            answer = self.host.lag.begin(self._out, self._plan)
            self._started = answer.accepted
            if not self._started:
                self._give_up(answer_words(answer.why))
        if view is None:
            return
        self.measured = len(view.runs)
        if view.said and view.said != self._said:
            self._said = view.said
            self._line(f"failed: {view.said}\n")
        if view.phase == "done":
            test = self.host.lag.test
            self.left_out = [f"{rpm:g} r/min, repeat {n}: {why}" for rpm, n, why in (test.left_out if test else ())]
            self.host.stop("done")
            return
        self._hold(frame, now_s)
        self._tell(frame, view, now_s)

    def _hold(self, frame: Frame, now_s: float) -> None:
        calibrating = frame.row.state == State.CALIBRATING
        if calibrating and self._opening_mm is not None and not self._opened:
            self._order(Order(Do.CALIBRATE_OPENING, self._opening_mm))
        self._opened = calibrating
        down = self._no_key or self._held.down(self._clock())
        if self._was_down and not down:
            self._order(Order(Do.RELEASE))
        self._was_down = down
        if not down or now_s - self._confirmed_s < REPEAT_S:
            return
        self._confirmed_s = now_s
        if self._no_key and frame.why_state == "calibration_time":      # the next two minutes
            self._order(Order(Do.RELEASE))
        self.host.ask(Order(Do.CALIBRATE), lambda answer, _: self._heard(answer, now_s))

    def _heard(self, answer: Answer, now_s: float) -> None:
        self._refusal = "" if answer.accepted else answer_words(answer.why)
        if answer.accepted:
            self._refused_since_s = None
            return
        self._held.block(self._clock())
        if self._refused_since_s is None:
            self._refused_since_s = now_s
        if self._no_key and now_s - self._refused_since_s > PATIENCE_S:
            self._give_up(self._refusal)

    def _tell(self, frame: Frame, view: LagTestView, now_s: float) -> None:
        if now_s - self._shown_s < 0.2 or not sys.stderr.isatty():
            return
        self._shown_s = now_s
        if self._runs_started_s is None and frame.row.state == State.CALIBRATING:
            self._runs_started_s = now_s
        left = ""
        if view.progress and self._runs_started_s is not None:
            left_s = (now_s - self._runs_started_s) * (1.0 - view.progress) / view.progress
            left = f", about {left_s / 60.0:.0f} min left"
        what = (f"{view.shaft_rpm:g} r/min, repeat {view.replicate}, {view.phase}"
                if frame.row.state == State.CALIBRATING else self._refusal or "hold the space bar down")
        standing = "" if self._with_gnss else " (standing by the wheel alone)"
        self._line(f"lag test {100 * view.progress:.0f} %: {what}{left}{standing}; Ctrl-C ends ")

    def _line(self, text: str) -> None:
        sys.stderr.write(f"\r\x1b[K{text}" if sys.stderr.isatty() else text)
        sys.stderr.flush()

    def _order(self, order: Order) -> None:
        self.host.ask(order, lambda answer, _: None)

    def _give_up(self, why: str) -> None:
        self.trouble = self.trouble or why
        self.host.stop("trouble")
