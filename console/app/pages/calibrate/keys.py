"""Defines the keys of the Calibrate page; most belong to the calibration that is open."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from topdress.console.app.action import CALIBRATE, Action, set_page
from topdress.console.locale import N_
from topdress.control.orders import Do

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen


def make_page_action(name: str) -> Callable[[CalibrateScreen], None]:
    """Return a function that runs the open calibration's function for an action."""
    return lambda page: page.run_calibration_key(name)


ACTIONS = set_page(
    CALIBRATE,
    # The shaft may turn only while this key is down, so it has no toggle.
    Action(
        "cal_run",
        "i",
        "I",
        N_("run while held"),
        N_("Shaft and gate run while the key or the mouse button is down; letting go stops them."),
        lambda page: page.press_hold_key(),
        bar=3,
        needs_machine=True,
    ),
    Action(
        "cal_next",
        "right",
        ">",
        N_("next calibration"),
        N_("To the calibration on the right."),
        lambda page: page.choose_calibration(page.at + 1),
        bar=8,
    ),
    Action(
        "cal_previous",
        "left",
        "<",
        N_("previous calibration"),
        N_("To the calibration on the left."),
        lambda page: page.choose_calibration(page.at - 1),
    ),
    Action(
        "cal_ready",
        "r",
        "R",
        N_("ready"),
        N_("Makes the machine ready to calibrate: nothing turns."),
        lambda page: page.app.give_order(Do.READY),
        needs_machine=True,
    ),
    # The same keys serve all calibrations: each calibration lists those that it uses as chips.
    Action(
        # Numbers that a test needs are typed in dialogs, which stop a turning shaft first.
        "cal_shaft",
        "q_1",
        "Q1",
        N_("shaft speed"),
        N_("Catch test: type the shaft speed; the allowed range is shown."),
        make_page_action("cal_shaft"),
        asks="number",
    ),
    Action(
        "cal_opening",
        "q_2",
        "Q2",
        N_("opening"),
        N_("Catch test: type the opening; the allowed range is shown."),
        make_page_action("cal_opening"),
        asks="number",
    ),
    Action(
        "cal_again",
        "q_4",
        "Q4",
        N_("settle again"),
        N_("Catch test: forget what was caught and settle anew."),
        make_page_action("cal_again"),
    ),
    Action(
        "cal_weigh",
        "q_3",
        "Q3",
        N_("weighed"),
        N_("Catch test: type what all outlets together gave."),
        make_page_action("cal_weigh"),
        asks="number",
    ),
    Action(
        # A wrong mass is noticed at once, so the last point only can be removed.
        "cal_undo",
        "backspace",
        "Bksp",
        N_("drop last point"),
        N_("Catch test: takes the last point out."),
        make_page_action("cal_undo"),
    ),
    Action(
        "cal_begin",
        "b",
        "B",
        N_("begin / end"),
        N_("Lag, heads, wheel: begins or ends the measuring."),
        make_page_action("cal_begin"),
        needs_machine=True,
    ),
    Action(
        # A bench table lets the lag be fitted without a rig on the machine.
        "cal_table",
        "j",
        "J",
        N_("bench table"),
        N_("Lag: takes a table that was measured before."),
        make_page_action("cal_table"),
    ),
    Action(
        "cal_fit",
        "q_5",
        "Q5",
        N_("fit"),
        N_("Computes the machine's numbers from what was measured."),
        make_page_action("cal_fit"),
    ),
    # A machine file in use must not change under the running job; saving always writes a new file.
    Action(
        "cal_save",
        "e",
        "E",
        N_("save as new"),
        N_("Writes a new machine file; nothing is overwritten."),
        lambda page: page.ask_file_name(),
        asks="text",
    ),
)
