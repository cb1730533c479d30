"""Actions of the Calibrate screen."""
from __future__ import annotations

from console.app.action import CALIBRATE, Action
from console.locale import N_

ACTIONS = (
    Action("cal_run", "r", "R", N_("run while held"),
           N_("Shaft and gate run while the key or the mouse button is down; letting go stops them."), CALIBRATE, 3),
    Action("cal_next", "right", ">", N_("next calibration"), N_("To the calibration on the right."), CALIBRATE, 8),
    Action("cal_previous", "left", "<", N_("previous calibration"), N_("To the calibration on the left."), CALIBRATE),
    Action("cal_ready", "y", "Y", N_("make ready"), N_("Makes the machine ready to calibrate: nothing turns."),
           CALIBRATE),
    Action("cal_shaft", "s", "S", N_("shaft speed"),
           N_("Catch test: type the shaft speed; the allowed range is shown."), CALIBRATE),
    Action("cal_opening", "o", "O", N_("opening"), N_("Catch test: type the opening; the allowed range is shown."),
           CALIBRATE),
    Action("cal_again", "z", "Z", N_("settle again"), N_("Catch test: forget what was caught and settle anew."),
           CALIBRATE),
    Action("cal_weigh", "w", "W", N_("weighed"), N_("Catch test: type what all outlets together gave."), CALIBRATE),
    Action("cal_undo", "backspace", "Bksp", N_("last point away"), N_("Catch test: takes the last point out."),
           CALIBRATE),
    Action("cal_begin", "b", "B", N_("begin / end"), N_("Lag, heads, wheel: begins or ends the measuring."), CALIBRATE),
    Action("cal_table", "t", "T", N_("bench table"), N_("Lag: takes a table that was measured before."), CALIBRATE),
    Action("cal_fit", "f", "F", N_("fit"), N_("Computes the machine's numbers from what was measured."), CALIBRATE),
    Action("cal_save", "n", "N", N_("save as new"), N_("Writes a new machine file; nothing is overwritten."),
           CALIBRATE),
)
