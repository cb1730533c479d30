"""How does `topdress calibrate encoder --board URL` count pulses per turn of the metering shaft,
and print a line for the board's settings?
"""

from __future__ import annotations

import time
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from topdress.console.cli.bench_session import (
    DEVICE_TIMEOUT_S,
    BenchOperator,
    Keyboard,
    end_on_signals,
    make_host,
    open_keyboard,
    print_stderr_line,
    run_attended,
    show_progress,
)
from topdress.console.cli.inputs import load_machine
from topdress.console.cli.plain_errors import CommandError
from topdress.console.frame import Frame
from topdress.control.orders import Do, Order, State
from topdress.drivers import day_clock
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.board_frames import COUNTER_MODULUS, ShaftTurned
from topdress.drivers.files.atomic_files import write_atomically

if TYPE_CHECKING:
    from topdress.control.calibration.least_squares import FittedInterval

TICK_PERIOD_S = 0.02
# Time-out for an answer of a board that sends status lines, s: some 40 requests.
ANSWER_TIMEOUT_S = 2.0
# Fields of `ShaftTurned`, with the board's setting for each.
SHAFT_COUNTERS = (("counts", "counts_per_turn"), ("steps", "dose_steps_per_turn"))
# Duration of a press at the machine's slowest speed, s: a short press turns some 15 degrees.
CREEP_PRESS_S = 1.0
ENTER_KEYS = "\r\n"


def count_encoder(
    board: str, *, turns: int, repeats: int, rpm: float | None, machine: str, out: Path
) -> None:
    """Counts, prints and writes. Raises CommandError and ValueError with one line; nothing is
    written then."""
    # The keyboard is opened first: without a terminal nobody can confirm a mark.
    with open_keyboard() as keyboard:
        if not keyboard.there:
            raise CommandError(
                "calibrate encoder: Enter says that the mark is at the pointer, and there is no "
                "keyboard here: allowed is a terminal"
            )
        # A shaft that is turned by hand sends no stepper steps.
        count = MarkCounter(board, turns, repeats, by_hand=rpm is None)
        if rpm is None:
            _count_by_hand(board, count, keyboard)
        else:
            _count_by_drive(board, count, keyboard, machine, rpm)
    from topdress.control.calibration.encoder_fit import fit_counts

    lines = [
        _print_setting(setting, fit_counts(runs, turns), believed)
        for setting, runs, believed in count.list_counts()
    ]
    day = day_clock.read_today().isoformat()
    # The file is written only after all runs, so an interrupted count leaves no settings.
    write_atomically(
        out, f"# topdress calibrate encoder, {day}: {repeats} x {turns} turns\n" + "".join(lines)
    )
    typer.echo(f"settings of the board: {out}")


def _print_setting(setting: str, fit: FittedInterval, believed: float) -> str:
    """Returns the line for the board, which is also printed."""
    typer.echo(
        f"{setting}  {fit.value:.2f} (90 %: {fit.low:.2f} to {fit.high:.2f}); the board "
        f"takes {believed:g}, "
        f"{100.0 * (believed / fit.value - 1.0):+.2f} %"
    )
    return f"{setting} = {fit.value:.2f}     # 90 %: {fit.low:.2f} to {fit.high:.2f}\n"


class MarkCounter:
    """Counts between presses of Enter: the turn of the shaft from a mark to the same mark after
    `turns` turns, `repeats` times."""

    def __init__(self, board: str, turns: int, repeats: int, *, by_hand: bool) -> None:
        # The progress since the newest mark, as displayed.
        self._shown = ""
        self._board, self._turns, self._repeats, self._by_hand = board, turns, repeats, by_hand
        self._marks: list[ShaftTurned] = []
        self._newest: ShaftTurned | None = None
        self._entered = False
        self._began_s: float | None = None
        self._heard_s: float | None = None
        self._connects = 0
        print_stderr_line(
            "set a mark on the shaft to a pointer, then Enter (Ctrl+C ends, nothing is written)"
        )

    @property
    def is_done(self) -> bool:
        """Whether all runs are counted."""
        # One mark begins the first run, and each further mark ends a run.
        return len(self._marks) > self._repeats

    def list_counts(self) -> list[tuple[str, list[int], float]]:
        """Returns for encoder and stepper, if they are fitted: the setting, the counts of each run,
        and the counts per turn in the board's settings."""
        return [
            (
                setting,
                [_calc_counts(one, next_one, name) for one, next_one in pairwise(self._marks)],
                getattr(self._marks[0], name + "_per_turn"),
            )
            for name, setting in self._find_counters(self._marks[0])
        ]

    def follow_tick(self, cab: Cab, now_s: float, pressed: str, refusal: str = "") -> None:
        """Requests the counts, handles the answer and the keys, and shows the progress. Raises
        CommandError."""
        turned, line = cab.request_turned(), cab.find_device_line("board")
        assert line is not None
        state = line.port.state()
        if turned is None:
            self._refuse_silence(now_s, line.make_status(now_s).accepted, state.last_error)
            return
        # A reconnected board may have restarted, and its counters begin at zero.
        if self._marks and state.connects != self._connects:
            raise CommandError(
                "calibrate encoder: the board was lost, and its count with it: begin again"
            )
        self._connects = state.connects
        self._entered = self._entered or any(key in pressed for key in ENTER_KEYS)
        before, self._newest = self._newest, turned
        # Two answers are needed to see whether the shaft still turns.
        if before is None or turned is before:
            return
        if self._entered:
            self._entered = False
            if any(_calc_counts(before, turned, name) for name, _ in self._find_counters(turned)):
                print_stderr_line("the shaft still turns: Enter when it stands")
            else:
                self._add_mark(turned)
        shown = ", ".join(
            [
                f"{_calc_counts(self._marks[-1], turned, name):+d} {name}"
                for name, _ in self._find_counters(turned)
                if self._marks
            ]
            + [refusal] * bool(refusal)
        )
        # An unchanged line is not written again, because the terminal would flicker.
        if shown != self._shown:
            self._shown = shown
            show_progress(shown)

    def _find_counters(self, turned: ShaftTurned) -> list[tuple[str, str]]:
        """Returns the counters that count. Raises CommandError if none does."""
        found = [
            (name, setting)
            for name, setting in SHAFT_COUNTERS
            if getattr(turned, name) is not None and not (self._by_hand and name == "steps")
        ]
        if not found:
            raise CommandError(
                "calibrate encoder: this board has no encoder (counts_per_turn 0): the "
                "steps of its "
                "stepper are counted with --rpm"
            )
        return found

    def _add_mark(self, turned: ShaftTurned) -> None:
        self._marks.append(turned)
        if not self.is_done:
            how = "by hand" if self._by_hand else "the space bar held down"
            print_stderr_line(
                f"run {len(self._marks)} of {self._repeats}: {self._turns} whole turns "
                f"forwards, {how}, until the mark "
                "is at the pointer again, then Enter"
            )

    def _refuse_silence(self, now_s: float, heard: int, error: str) -> None:
        self._began_s = now_s if self._began_s is None else self._began_s
        if heard and self._heard_s is None:
            self._heard_s = now_s
        if self._heard_s is not None and now_s - self._heard_s > ANSWER_TIMEOUT_S:
            raise CommandError(
                f"calibrate encoder: the board at {self._board} does not say how far its "
                "shaft turned: "
                "its program is older than this: put the new one on it (docs/wiring.md)"
            )
        if self._heard_s is None and now_s - self._began_s > DEVICE_TIMEOUT_S:
            raise CommandError(
                f"calibrate encoder: board at {self._board} is silent: {error or 'no byte'}"
            )


def _calc_counts(one: ShaftTurned, later: ShaftTurned, name: str) -> int:
    """Returns the counts or steps between two answers, across their wrap."""
    # The counters wrap at the modulus; less than half a cycle lies between two answers.
    way: int = (getattr(later, name) - getattr(one, name)) % COUNTER_MODULUS
    return way - COUNTER_MODULUS if way >= COUNTER_MODULUS // 2 else way


def _count_by_hand(board: str, count: MarkCounter, keyboard: Keyboard) -> None:
    """Counts while the shaft is turned by hand; no command that turns it is sent."""
    cab = Cab(CabConfig.model_validate({"board": {"port": board}}), time.monotonic)
    with end_on_signals():
        try:
            while not count.is_done:
                now_s = time.monotonic()
                cab.read_measurements(now_s)
                count.follow_tick(cab, now_s, keyboard.read_pressed())
                time.sleep(TICK_PERIOD_S)
        # The line is released at every end, also after Ctrl-C.
        finally:
            cab.close_devices()
            show_progress("")


class DriveOperator(BenchOperator):
    """Turns the shaft by the drive while the space bar is held, under the control loop's
    interlocks; a short press moves it slowly to the mark."""

    cab: Cab
    error: CommandError | None = None
    _creeps_until_s = inf

    def __init__(
        self, keyboard: Keyboard, count: MarkCounter, creep_rpm: float, rpm: float
    ) -> None:
        super().__init__(keyboard, no_key=False)
        self._count, self._creep_rpm, self._rpm = count, creep_rpm, rpm

    def list_set_points(self) -> tuple[Order, ...]:
        # Each press begins at creep speed, so that a short press only moves the shaft to the mark.
        return (Order(Do.CALIBRATE_SHAFT, self._creep_rpm),)

    def follow_frame(self, frame: Frame, now_s: float, pressed: str) -> None:
        try:
            self._count.follow_tick(self.cab, now_s, pressed, self.refusal)
        except CommandError as error:
            self.error = error
            # The error ends the loop in order: raising here would leave the drive turning.
            self.host.request_stop("trouble")
            return
        if self._count.is_done:
            self.host.request_stop("done")
            return
        if frame.row.state != State.CALIBRATING:
            self._creeps_until_s = now_s + CREEP_PRESS_S
        elif self._creeps_until_s <= now_s:
            self._creeps_until_s = inf
            self.send_order(Order(Do.CALIBRATE_SHAFT, self._rpm))
        self.hold_button(frame, now_s)


def _count_by_drive(
    board: str, count: MarkCounter, keyboard: Keyboard, machine: str, rpm: float
) -> None:
    began_s = time.monotonic()
    person = DriveOperator(keyboard, count, load_machine(machine).limits.shaft_low_rpm, rpm)
    person.host, person.cab = make_host(
        {"board": board}, machine, lambda: time.monotonic() - began_s, person.pause_between_ticks
    )
    run_attended(person.host)
    show_progress("")
    if person.error is not None:
        raise person.error
    if person.trouble:
        raise CommandError(f"calibrate encoder: {person.trouble}")
