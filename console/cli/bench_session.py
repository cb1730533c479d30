"""How does a person at the bench turn the shaft? It turns under the control loop's interlocks, and
only while a key is held down.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from topdress.console.app.frame_words import describe_alarm, describe_refusal
from topdress.console.app.held_key import HeldKey
from topdress.console.frame import Frame
from topdress.control.log_row import LogRow
from topdress.control.orders import Answer, Do, Order, State
from topdress.drivers import day_clock

if TYPE_CHECKING:
    from topdress.console.worker.loop_host import Host
    from topdress.drivers.cab import Cab


# Keys of the terminal are read at once, without waiting for a line, on POSIX and Windows.
class Keyboard:
    """Reads keys without waiting for a line.

    `read_pressed` returns the text typed since the last call; empty where standard input is no
    terminal. It raises KeyboardInterrupt for a terminal that was closed.
    """

    def __init__(self, there: bool) -> None:
        self.there = there

    def read_pressed(self) -> str:
        """Returns the text typed since the last call."""
        if not self.there:
            return ""
        if sys.platform == "win32":
            import msvcrt

            typed = ""
            while msvcrt.kbhit():
                typed += msvcrt.getwch()
            return typed
        if not select.select([sys.stdin], [], [], 0.0)[0]:
            return ""
        typed = os.read(sys.stdin.fileno(), 256)
        # After the end of the file a release of the key cannot be detected any more.
        if not typed:
            raise KeyboardInterrupt
        return typed.decode(errors="replace")


@contextlib.contextmanager
def open_keyboard() -> Iterator[Keyboard]:
    """Yields the open keyboard until the end of the block; Ctrl+C still interrupts."""
    if not sys.stdin.isatty():
        yield Keyboard(False)
        return
    if sys.platform == "win32":
        yield Keyboard(True)
        return
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield Keyboard(True)
    finally:
        # A closed terminal has no settings to restore.
        with contextlib.suppress(termios.error):
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


ENDING_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


@contextlib.contextmanager
def end_on_signals() -> Iterator[None]:
    """Ends a command at the bench by an exception on any signal, as on Ctrl+C, so that the last
    command to the drives is a stop.

    A second signal does not interrupt that stop. Raises KeyboardInterrupt.
    """
    is_ending = False

    def raise_interrupt(*_: object) -> None:
        nonlocal is_ending
        if not is_ending:
            is_ending = True
            raise KeyboardInterrupt

    numbers = [getattr(signal, name) for name in ENDING_SIGNALS if hasattr(signal, name)]
    before = {
        number: signal.signal(number, raise_interrupt)
        for number in numbers
        if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_attended(host: Host) -> None:
    """Runs the control loop to its end; in every case a command stops the drives, before their own
    second of silence would. Raises KeyboardInterrupt."""
    with end_on_signals():
        host.run_until_stopped()


BENCH_HZ = 50.0
# Time by which every device must have sent a message, s.
DEVICE_TIMEOUT_S = 10.0
# Interval at which the held button is confirmed, s.
CONFIRM_PERIOD_S = 0.2
# Without a key, a refusal that lasts for this time ends the test, s.
REFUSAL_TIMEOUT_S = 5.0
HOLD_KEY = " "


class NullLogWriter:
    """Stores no log, because the table is the record of this test."""

    ok = True
    trouble = ""
    path, cut_short = Path(), None

    def append(self, row: LogRow) -> None:
        """Discards the row."""

    def close(self) -> None:
        """Does nothing."""


def make_host(
    urls: Mapping[str, str | None],
    machine: str,
    clock: Callable[[], float],
    between: Callable[[float], None],
) -> tuple[Host, Cab]:
    """Returns the control loop with every interlock, and its cab.

    The devices are those of a cab file that exist (`urls` by name); the board has the machine's
    limits. Nothing is logged.
    """
    from topdress.console.worker.loop_host import Host
    from topdress.console.worker.run_interfaces import RunAssembly, RunNames
    from topdress.control.loop import ControlLoop
    from topdress.control.safety import SafetyLimits
    from topdress.drivers.cab import Cab
    from topdress.drivers.cab_config import CabConfig
    from topdress.drivers.files.run_setup import load_setup

    setup = load_setup(machine, "demo", day_clock.read_today())
    limits = setup.machine.limits
    devices: dict[str, dict[str, Any]] = {
        name: {"port": url} for name, url in urls.items() if url is not None
    }
    devices["board"] |= {
        "max_shaft_rpm": limits.shaft_high_rpm,
        "max_opening_mm": limits.opening_high_mm,
        "wheel_circumference_m": setup.machine.speed.wheel_circumference_m,
        "wheel_pulses_per_turn": setup.machine.speed.pulses_per_turn,
    }
    loop = ControlLoop(
        setup.machine,
        setup.crop,
        setup.rule,
        setup.job,
        safety_limits=SafetyLimits(both_speeds_to_start="gnss" in devices),
    )
    cab = Cab(CabConfig.model_validate(devices), clock)
    return Host(
        RunAssembly(cab, loop, NullLogWriter(), RunNames()), clock, between, hz=BENCH_HZ
    ), cab


def show_progress(text: str) -> None:
    """Shows a text on stderr in place of the previous text, on a terminal only."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


def print_stderr_line(text: str) -> None:
    """Prints a permanent line on stderr in place of the progress text."""
    show_progress("")
    typer.echo(text, err=True)


class BenchOperator:
    """Acts for the person at the bench: between ticks it holds the button down while the space bar
    is pressed.

    `trouble` is the reason why the test ended, `refusal` the reason why the held key turns nothing.
    A subclass defines in `follow_frame` the actions once the machine is ready.
    """

    host: Host

    def __init__(
        self,
        keyboard: Keyboard,
        no_key: bool,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self.trouble = ""
        self._keyboard, self._no_key = keyboard, no_key
        self._held = HeldKey()
        self._confirmed_s = -1.0
        self._refused_since_s: float | None = None
        self.refusal = ""
        self._was_down = self._calibrated = False

    def follow_frame(self, frame: Frame, now_s: float, pressed: str) -> None:
        """Acts on a tick in which the machine is neither off nor in fault; `pressed` are keys since
        the last tick."""
        raise NotImplementedError

    def list_set_points(self) -> Sequence[Order]:
        """Returns orders that are given whenever the shaft is about to turn."""
        return ()

    def pause_between_ticks(self, seconds: float) -> None:
        """Waits in the host's pause between two ticks, then acts on the newest frame."""
        self._sleep(seconds)
        frame = self.host.newest_frame
        self.host.note_console_heard()
        pressed = self._keyboard.read_pressed()
        if HOLD_KEY in pressed:
            self._held.note_key(self._clock())
        if frame is None:
            return
        now_s = frame.at_s
        if frame.row.state == State.OFF:
            self._order_ready(frame, now_s)
        elif frame.row.state == State.FAULT:
            words = (
                "; ".join(describe_alarm(alarm).text for alarm in frame.alarms) or frame.why_state
            )
            self.give_up(words)
        else:
            self.follow_frame(frame, now_s, pressed)

    def _order_ready(self, frame: Frame, now_s: float) -> None:
        silent = [one.name for one in frame.devices if not one.accepted]
        if not silent:
            self.send_order(Order(Do.READY))
        elif now_s > DEVICE_TIMEOUT_S:
            said = next(one for one in frame.devices if one.name == silent[0])
            self.give_up(
                f"{said.name} at {said.port} is silent: "
                f"{said.last_error or said.last_raw or 'no byte'}"
            )

    def hold_button(self, frame: Frame, now_s: float) -> None:
        """Presses or releases the button, according to the key."""
        calibrating = frame.row.state == State.CALIBRATING
        for order in self.list_set_points() if calibrating and not self._calibrated else ():
            self.send_order(order)
        self._calibrated = calibrating
        down = self._no_key or self._held.is_down(self._clock())
        if self._was_down and not down:
            self.send_order(Order(Do.RELEASE))
        self._was_down = down
        if not down or now_s - self._confirmed_s < CONFIRM_PERIOD_S:
            return
        self._confirmed_s = now_s
        # A calibration run lasts two minutes, so the next one begins.
        if self._no_key and frame.why_state == "calibration_time":
            self.send_order(Order(Do.RELEASE))
        self.host.queue_request(
            Order(Do.CALIBRATE), lambda answer, _: self._take_answer(answer, now_s)
        )

    def _take_answer(self, answer: Answer, now_s: float) -> None:
        self.refusal = "" if answer.accepted else describe_refusal(answer.why)
        if answer.accepted:
            self._refused_since_s = None
            return
        self._held.block_repeats(self._clock())
        if self._refused_since_s is None:
            self._refused_since_s = now_s
        if self._no_key and now_s - self._refused_since_s > REFUSAL_TIMEOUT_S:
            self.give_up(self.refusal)

    def send_order(self, order: Order) -> None:
        """Gives an order and ignores the answer."""
        self.host.queue_request(order, lambda answer, _: None)

    def give_up(self, why: str) -> None:
        """Ends the test; the first reason counts."""
        self.trouble = self.trouble or why
        self.host.request_stop("trouble")
