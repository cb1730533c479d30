"""Actions of the Run screen."""
from __future__ import annotations

from console.app.action import RUN, Action
from console.locale import N_

ACTIONS = (
    Action("start", "s", "S", N_("start"), N_("Ready or held: begin to work."), RUN, 3),
    Action("ready", "r", "R", N_("ready"), N_("Off, held or fault: make the machine ready."), RUN, 4),
    Action("nudge_up", "plus,equals_sign,kp_plus", "+", N_("more"),
           N_("More than the target, in steps of 5 %; asked once."), RUN, 5),
    Action("nudge_down", "minus,kp_minus", "-", N_("less"), N_("Less than the target, in steps of 5 %; asked once."),
           RUN, 6),
    Action("strategy", "t", "T", N_("strategy"), N_("Opening first, speed first or balanced; asked once."), RUN, 7),
    Action("source", "o", "O", N_("target from"), N_("Canopy, map, plants, manual or fallback rate; asked once."),
           RUN, 8),
    Action("manual_rate", "m", "M", N_("manual rate"), N_("Type a rate; the allowed range is shown."), RUN),
    Action("refill", "f", "F", N_("refill"), N_("Type how much was filled in; the log keeps it."), RUN),
    Action("mark", "k", "K", N_("mark"), N_("A mark in the log's events at this moment."), RUN),
    Action("look_ahead", "l", "L", N_("look-ahead"), N_("Switches the lag correction; asked once."), RUN),
    Action("flow_trim", "w", "W", N_("scale trim"), N_("Lets the hopper scale correct the flow model; asked once."),
           RUN),
    Action("allow", "h", "H", N_("allow"), N_("Reversing, outside the field, without a log; asked once."), RUN),
    Action("connect", "c", "C", N_("connect"), N_("Control worker gone: start it again or attach to one that runs."),
           RUN, locked=True),
)
