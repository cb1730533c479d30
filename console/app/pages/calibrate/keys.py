"""Keys of the Calibrate page and what they do; most are for the calibration that is open."""
from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from console.app.action import CALIBRATE, Action
from console.locale import N_, _
from control.orders import Do

if TYPE_CHECKING:
    from console.app.pages.calibrate.page import CalibrateScreen


def run_while_held(page: CalibrateScreen) -> None:
    page.hold_key()


def next_calibration(page: CalibrateScreen) -> None:
    page.turn(page.at + 1)


def previous_calibration(page: CalibrateScreen) -> None:
    page.turn(page.at - 1)


def make_ready(page: CalibrateScreen) -> None:
    page.give(Do.READY)


def begin_or_end(page: CalibrateScreen) -> None:
    page.calibration.begin(page.now())


def settle_again(page: CalibrateScreen) -> None:
    page.calibration.again(page.now())


def undo(page: CalibrateScreen) -> None:
    page.calibration.undo()


def save_as_new(page: CalibrateScreen) -> None:
    page.ask_name()


def _with_files(do: Callable[[CalibrateScreen], None]) -> Callable[[CalibrateScreen], None]:
    """Refused in words where this console cannot compute and save."""
    def run(page: CalibrateScreen) -> None:
        if page.job is None:
            page.tell(_("calibration is not available here: start topdress run"))
        else:
            do(page)

    return run


@_with_files
def shaft_speed(page: CalibrateScreen) -> None:
    page.calibration.ask_shaft(page.now())


@_with_files
def opening(page: CalibrateScreen) -> None:
    page.calibration.ask_opening(page.now())


@_with_files
def weighed(page: CalibrateScreen) -> None:
    page.calibration.ask_mass(page.now())


@_with_files
def bench_table(page: CalibrateScreen) -> None:
    page.calibration.ask_table()


def fit(page: CalibrateScreen) -> None:
    if page.busy:
        page.tell(page.busy)
    else:
        _fit(page)


@_with_files
def _fit(page: CalibrateScreen) -> None:
    page.calibration.fit()


ACTIONS = (
    Action("cal_run", "i", "I", N_("run while held"),
           N_("Shaft and gate run while the key or the mouse button is down; letting go stops them."), run_while_held,
           CALIBRATE, 3),
    Action("cal_next", "right", ">", N_("next calibration"), N_("To the calibration on the right."), next_calibration,
           CALIBRATE, 8),
    Action("cal_previous", "left", "<", N_("previous calibration"), N_("To the calibration on the left."),
           previous_calibration, CALIBRATE),
    Action("cal_ready", "r", "R", N_("ready"), N_("Makes the machine ready to calibrate: nothing turns."),
           make_ready, CALIBRATE),
    Action("cal_shaft", "q_1", "Q1", N_("shaft speed"),
           N_("Catch test: type the shaft speed; the allowed range is shown."), shaft_speed,
           CALIBRATE, asks="number"),
    Action("cal_opening", "q_2", "Q2", N_("opening"), N_("Catch test: type the opening; the allowed range is shown."),
           opening,
           CALIBRATE, asks="number"),
    Action("cal_again", "q_4", "Q4", N_("settle again"), N_("Catch test: forget what was caught and settle anew."),
           settle_again, CALIBRATE),
    Action("cal_weigh", "q_3", "Q3", N_("weighed"), N_("Catch test: type what all outlets together gave."), weighed,
           CALIBRATE, asks="number"),
    Action("cal_undo", "backspace", "Bksp", N_("drop last point"), N_("Catch test: takes the last point out."), undo,
           CALIBRATE),
    Action("cal_begin", "b", "B", N_("begin / end"), N_("Lag, heads, wheel: begins or ends the measuring."),
           begin_or_end, CALIBRATE),
    Action("cal_table", "j", "J", N_("bench table"), N_("Lag: takes a table that was measured before."), bench_table,
           CALIBRATE),
    Action("cal_fit", "q_5", "Q5", N_("fit"), N_("Computes the machine's numbers from what was measured."), fit,
           CALIBRATE),
    Action("cal_save", "e", "E", N_("save as new"), N_("Writes a new machine file; nothing is overwritten."),
           save_as_new, CALIBRATE, asks="text"),
)
