"""Actions of the Devices screen."""
from __future__ import annotations

from console.app.action import DEVICES, Action
from console.locale import N_

ACTIONS = (
    Action("dev_up", "up", "Up", N_("device above"), N_("Picks the device above."), DEVICES),
    Action("dev_down", "down", "Down", N_("device below"), N_("Picks the device below."), DEVICES),
    Action("dev_test", "t", "T", N_("test"), N_("Listens what speaks on this line; nothing is sent."), DEVICES, 4),
    Action("dev_capture", "w", "W", N_("write raw"), N_("Writes what comes and goes into a file beside the log; again: "
                                                        "ends it."), DEVICES, 5),
    Action("dev_plug", "c", "C", N_("connect / disconnect"), N_("Takes the line or lets go of it; letting go is asked "
                                                                "once and refused while working."), DEVICES, 6),
)
