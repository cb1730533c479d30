"""Actions of the Trends screen."""
from __future__ import annotations

from console.app.action import TRENDS, Action
from console.locale import N_

ACTIONS = (
    Action("trends_channels", "c", "C", N_("channels"), N_("What is plotted, up to three; also a click on a name."),
           TRENDS, 3),
    Action("trends_shorter", "plus,equals_sign,kp_plus", "+", N_("shorter"), N_("A shorter span; also by the wheel."),
           TRENDS, 4),
    Action("trends_longer", "minus,kp_minus", "-", N_("longer"), N_("A longer span; also by the wheel."), TRENDS, 5),
    Action("trends_freeze", "f", "F", N_("freeze"), N_("Stands still, or runs on."), TRENDS, 6),
    Action("trends_whole", "w", "W", N_("whole run"), N_("All of the run or log."), TRENDS, 7),
    Action("trends_scale", "s", "S", N_("fixed scale"), N_("Keeps the scales as they are, or fits them to the values."),
           TRENDS, 8),
    Action("trends_left", "left", "<", N_("cursor back"), N_("Reads the values at a time; also a click in the plot."),
           TRENDS),
    Action("trends_right", "right", ">", N_("cursor on"), N_("Reads the values at a time; also a click in the plot."),
           TRENDS),
    Action("trends_far_left", "shift+left", "S-<", N_("cursor far back"), N_("A tenth of the span at once."), TRENDS),
    Action("trends_far_right", "shift+right", "S->", N_("cursor far on"), N_("A tenth of the span at once."), TRENDS),
    Action("trends_cursor_off", "escape", "Esc", N_("cursor away"), N_("Values are the newest again."), TRENDS),
    Action("trends_earlier", "pageup", "PgUp", N_("earlier"), N_("Half a span back; the plots stand still."), TRENDS),
    Action("trends_later", "pagedown", "PgDn", N_("later"), N_("Half a span on."), TRENDS),
    Action("trends_log", "o", "O", N_("machine / log"), N_("The machine at work, or the log of the replay."), TRENDS),
)
