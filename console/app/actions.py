"""Every action once: its key, its words, where it applies. Bindings, key bar, help and palette are read off it."""
from __future__ import annotations

from typing import NamedTuple

from textual.binding import Binding

from console.locale import N_

ANYWHERE, RUN, REPLAY = "anywhere", "run", "replay"


class Action(NamedTuple):
    """id: also the key for a keymap. bar: place in the key bar, 0 = not there. locked: still works in lock mode."""

    id: str
    keys: str
    shown: str
    label: str
    help: str
    where: str = ANYWHERE
    bar: int = 0
    locked: bool = False
    priority: bool = False


ACTIONS = (
    Action("hold", "space", "Space", N_("hold"), N_("Flow to zero at once; start goes on. In a replay alone: pause."),
           bar=1, locked=True, priority=True),
    Action("stop", "x,f12", "X", N_("STOP"), N_("Machine off, from any state and on every screen (also F12)."),
           bar=2, locked=True, priority=True),
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
    Action("acknowledge", "a", "A", N_("acknowledge"), N_("Acknowledges the alarms that are shown."), bar=9),
    Action("play", "p", "P", N_("play / pause"), N_("Plays or pauses the log."), REPLAY, 3),
    Action("step_back", "left", "<", N_("back"), N_("One row back."), REPLAY, 4),
    Action("step_on", "right", ">", N_("on"), N_("One row on."), REPLAY, 5),
    Action("seek_back", "pageup,shift+left", "PgUp", N_("-30 s"), N_("30 s back."), REPLAY, 6),
    Action("seek_on", "pagedown,shift+right", "PgDn", N_("+30 s"), N_("30 s on."), REPLAY, 7),
    Action("seek_start", "home", "Home", N_("start of log"), N_("To the first row."), REPLAY),
    Action("seek_end", "end", "End", N_("end of log"), N_("To the last row."), REPLAY),
    Action("slower", "comma,left_square_bracket", ",", N_("slower"), N_("Half as fast, down to 0.1x."), REPLAY, 8),
    Action("faster", "full_stop,right_square_bracket", ".", N_("faster"), N_("Twice as fast, up to 1000x."), REPLAY, 8),
    Action("next_alarm", "n", "N", N_("next alarm"), N_("To the next row on which a new alarm stands."), REPLAY),
    Action("what_if", "i", "I", N_("what if"), N_("The same log with another strategy, crop or machine."), REPLAY, 8),
    Action("as_recorded", "b", "B", N_("as recorded"), N_("Back to the log as it was recorded."), REPLAY),
    Action("findings", "v", "V", N_("findings"), N_("What was found in this log when it was opened."), REPLAY),
    Action("help", "f1", "F1", N_("help"), N_("This page."), bar=3, locked=True),
    Action("run_screen", "f2", "F2", N_("run"), N_("The machine at work."), bar=10, locked=True),
    Action("replay_screen", "f7", "F7", N_("replay"), N_("A log, played again."), bar=10, locked=True),
    Action("lock", "f8", "F8", N_("lock"), N_("Only hold and stop stay; unlocking is asked once."), bar=11,
           locked=True),
    Action("theme", "d", "D", N_("day / night"), N_("Day, night, high contrast."), bar=12, locked=True),
    Action("connect", "c", "C", N_("connect"), N_("Control worker gone: start it again or attach to one that runs."),
           RUN, locked=True),
    Action("palette", "ctrl+p", "^P", N_("all actions"), N_("Find any action by its name."), bar=13),
    Action("units", "u", "U", N_("units"), N_("Metric, or mph and lb/ac.")),
    Action("language", "g", "G", N_("language"), N_("English, Chinese.")),
    Action("quit", "ctrl+q,ctrl+c", "^Q", N_("quit"), N_("Leaves the console; asked once while the machine works.")),
)
BY_ID = {action.id: action for action in ACTIONS}


def bindings() -> list[Binding]:
    """All actions as Textual bindings, each with its action's id, so that a keymap can move them."""
    return [Binding(action.keys, f"app.do('{action.id}')", action.label, id=action.id, priority=action.priority,
                    show=False) for action in ACTIONS]


def at(where: str) -> tuple[Action, ...]:
    """The actions of one screen: its own and those of every screen."""
    return tuple(action for action in ACTIONS if action.where in (ANYWHERE, where))
