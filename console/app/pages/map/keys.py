"""Actions of the Map screen."""
from __future__ import annotations

from console.app.action import MAP, Action
from console.locale import N_

ACTIONS = (
    Action("map_layer", "l", "L", N_("colours"), N_("Applied, target, error or NDVI; also a click on its word."), MAP,
           3),
    Action("map_in", "plus,equals_sign,kp_plus", "+", N_("nearer"), N_("Nearer; also by the wheel."), MAP, 4),
    Action("map_out", "minus,kp_minus", "-", N_("farther"), N_("Farther away; also by the wheel."), MAP, 5),
    Action("map_follow", "f", "F", N_("follow"), N_("Keeps the machine in sight, or lets it go."), MAP, 6),
    Action("map_whole", "w", "W", N_("whole field"), N_("All of the field and of the work."), MAP, 7),
    Action("map_plan", "p", "P", N_("plan"), N_("Shows or hides the planned rates of ground not yet worked."), MAP, 8),
    Action("map_west", "left", "<", N_("west"), N_("Moves the map; also by dragging it."), MAP),
    Action("map_east", "right", ">", N_("east"), N_("Moves the map; also by dragging it."), MAP),
    Action("map_north", "up", "up", N_("north"), N_("Moves the map; also by dragging it."), MAP),
    Action("map_south", "down", "down", N_("south"), N_("Moves the map; also by dragging it."), MAP),
    Action("map_log", "o", "O", N_("machine / log"), N_("The machine at work, or the log of the replay."), MAP),
)
