"""The person at the bench: the shaft turns under the control loop's interlocks, and only while
a key is held."""

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
from topdress.console.app.held_key import HeldKey
from topdress.console.app.words import describe_alarm, describe_refusal
from topdress.console.frame import Frame
from topdress.control.log_row import LogRow
from topdress.control.orders import Answer, Do, Order, State
from topdress.drivers import day_clock

if TYPE_CHECKING:
    from topdress.console.worker.host import Host
    from topdress.drivers.cab import Cab


# Keys of the terminal as they are pressed, without waiting for a line; POSIX and Windows.
class Keys:
    """`pressed`: what was typed since the last call, as text. Nothing where standard input is
    no terminal; raises KeyboardInterrupt where that terminal has hung up."""

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
        if not select.select([sys.stdin], [], [], 0.0)[0]:
            return ""
        typed = os.read(sys.stdin.fileno(), 256)
        # the end of file: nobody can let go of the key any more
        if not typed:
            raise KeyboardInterrupt
        return typed.decode(errors="replace")


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
        # one that has hung up has nothing to get back
        with contextlib.suppress(termios.error):
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


ENDING_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Whatever ends a command at the bench ends it as Ctrl+C does, by an exception: the last
    command to the drives is a stop. A second signal does not interrupt that stop. Raises
    KeyboardInterrupt."""
    is_ending = False

    def end(*_: object) -> None:
        nonlocal is_ending
        if not is_ending:
            is_ending = True
            raise KeyboardInterrupt

    numbers = [getattr(signal, name) for name in ENDING_SIGNALS if hasattr(signal, name)]
    before = {
        number: signal.signal(number, end)
        for number in numbers
        if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_attended(host: Host) -> None:
    """Runs the control loop to its end; however that comes, the drives are stopped by a command
    and not by their own second of silence. Raises KeyboardInterrupt."""
    with stopped_by_signals():
        host.run()


HZ = 50.0
HEARD_WITHIN_S = 10.0  # every device must have been heard by then
REPEAT_S = 0.2  # the held button is confirmed this often
# without a key: a refusal that lasts ends the test
PATIENCE_S = 5.0
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


def make_host(
    urls: Mapping[str, str | None],
    machine: str,
    clock: Callable[[], float],
    between: Callable[[float], None],
) -> tuple[Host, Cab]:
    """The control loop with every interlock on the devices of a cab file that are there (`urls`
    by name), its board with the machine's limits; and the cab that it has. Nothing is logged."""
    from topdress.console.worker.host import Host
    from topdress.console.worker.parts import Assembly, Names
    from topdress.control.loop import ControlLoop
    from topdress.control.safety import SafetyLimits
    from topdress.drivers.cab import Cab, CabConfig
    from topdress.drivers.files.setup import load_setup

    setup = load_setup(machine, "demo", day_clock.today())
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
    return Host(Assembly(cab, loop, Unlogged(), Names()), clock, between, hz=HZ), cab


def show(text: str) -> None:
    """On stderr, in place of what was shown before where somebody looks on; else not at all."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


def say(text: str) -> None:
    """On stderr, a line that stays, in place of what was shown."""
    show("")
    typer.echo(text, err=True)


class AtTheBench:
    """Stands for the person at the bench: between ticks it holds the button down while the
    space bar is. `trouble`: why it was given up; `refusal`: why the held key turns nothing. Who
    inherits says in `go_on` what is done once the machine is ready."""

    host: Host

    def __init__(
        self,
        keyboard: Keys,
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

    def go_on(self, frame: Frame, now_s: float, pressed: str) -> None:
        """Every tick in which the machine is neither off nor in fault; `pressed`: keys since
        the last one."""
        raise NotImplementedError

    def settings(self) -> Sequence[Order]:
        """Ordered whenever the shaft is about to turn."""
        return ()

    def between(self, seconds: float) -> None:
        """The host's pause between two ticks."""
        self._sleep(seconds)
        frame = self.host.newest
        self.host.console_heard()
        pressed = self._keyboard.pressed()
        if KEY in pressed:
            self._held.key(self._clock())
        if frame is None:
            return
        now_s = frame.at_s
        if frame.row.state == State.OFF:
            self._make_ready(frame, now_s)
        elif frame.row.state == State.FAULT:
            words = (
                "; ".join(describe_alarm(alarm).text for alarm in frame.alarms) or frame.why_state
            )
            self.give_up(words)
        else:
            self.go_on(frame, now_s, pressed)

    def _make_ready(self, frame: Frame, now_s: float) -> None:
        silent = [one.name for one in frame.devices if not one.accepted]
        if not silent:
            self.order(Order(Do.READY))
        elif now_s > HEARD_WITHIN_S:
            said = next(one for one in frame.devices if one.name == silent[0])
            self.give_up(
                f"{said.name} at {said.port} is silent: "
                f"{said.last_error or said.last_raw or 'no byte'}"
            )

    def hold(self, frame: Frame, now_s: float) -> None:
        """The button, as the key is now."""
        calibrating = frame.row.state == State.CALIBRATING
        for order in self.settings() if calibrating and not self._calibrated else ():
            self.order(order)
        self._calibrated = calibrating
        down = self._no_key or self._held.down(self._clock())
        if self._was_down and not down:
            self.order(Order(Do.RELEASE))
        self._was_down = down
        if not down or now_s - self._confirmed_s < REPEAT_S:
            return
        self._confirmed_s = now_s
        if self._no_key and frame.why_state == "calibration_time":  # the next two minutes
            self.order(Order(Do.RELEASE))
        self.host.ask(Order(Do.CALIBRATE), lambda answer, _: self._heard(answer, now_s))

    def _heard(self, answer: Answer, now_s: float) -> None:
        self.refusal = "" if answer.accepted else describe_refusal(answer.why)
        if answer.accepted:
            self._refused_since_s = None
            return
        self._held.block(self._clock())
        if self._refused_since_s is None:
            self._refused_since_s = now_s
        if self._no_key and now_s - self._refused_since_s > PATIENCE_S:
            self.give_up(self.refusal)

    def order(self, order: Order) -> None:
        """Whatever is answered."""
        self.host.ask(order, lambda answer, _: None)

    def give_up(self, why: str) -> None:
        """The first reason counts."""
        self.trouble = self.trouble or why
        self.host.stop("trouble")
