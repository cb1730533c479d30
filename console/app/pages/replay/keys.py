"""Actions of the Replay screen."""
from __future__ import annotations

from console.app.action import REPLAY, Action
from console.locale import N_

ACTIONS = (
    Action("open_log", "o", "O", N_("open"), N_("Another log, the newest first."), REPLAY, 3),
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
    Action("cancel_what_if", "escape", "Esc", N_("cancel"), N_("Stops computing a what-if."), REPLAY),
    Action("as_recorded", "b", "B", N_("as recorded"), N_("Back to the log as it was recorded."), REPLAY),
    Action("findings", "v", "V", N_("findings"), N_("What was found in this log when it was opened."), REPLAY),
)
