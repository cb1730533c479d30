"""Actions of every screen."""
from __future__ import annotations

from console.app.action import Action
from console.locale import N_

ACTIONS = (
    Action("hold", "space", "Space", N_("hold"), N_("Flow to zero at once; start goes on. In a replay alone: pause."),
           bar=1, locked=True, priority=True),
    Action("stop", "x,f12", "X", N_("STOP"), N_("Machine off, from any state and on every screen (also F12)."),
           bar=2, locked=True, priority=True),
    Action("acknowledge", "a", "A", N_("acknowledge"), N_("Acknowledges the alarms that are shown."), bar=9),
    Action("help", "f1", "F1", N_("help"), N_("This page."), bar=3, locked=True),
    Action("run_screen", "f2,2", "F2", N_("run"), N_("The machine at work."), locked=True),
    Action("map_screen", "f3,3", "F3", N_("map"), N_("The field: applied, target, error, NDVI, plan."), locked=True),
    Action("trends_screen", "f4,4", "F4", N_("trends"), N_("Any channel over any span; freeze, read at a time."),
           locked=True),
    Action("devices_screen", "f5,5", "F5", N_("devices"), N_("Every line, what it says; test, write raw."),
           locked=True),
    Action("calibrate_screen", "f6,6", "F6", N_("calibrate"), N_("Catch test, lag test, heads check, wheel."),
           locked=True),
    Action("replay_screen", "f7,7", "F7", N_("replay"), N_("A log, played again."), locked=True),
    Action("diagnosis_screen", "f9,9", "F9", N_("diagnosis"),
           N_("What is wrong with the machine, and why: from its logs."), locked=True),
    Action("job_screen", "f10,0", "F10", N_("job"), N_("Before work, totals, refills, N-rich strip, end of the job."),
           locked=True),
    Action("settings_screen", "f11", "F11", N_("settings"), N_("Units, language, look, sound, limits, keys."),
           locked=True),
    Action("alarm_list", "exclamation_mark", "!", N_("alarms"), N_("All alarms of the run or log, with what to do."),
           locked=True),
    Action("lock", "f8", "F8", N_("lock"), N_("Only hold and stop stay; unlocking is asked once."), bar=11,
           locked=True),
    Action("theme", "d", "D", N_("day / night"), N_("Day, night, high contrast."), bar=12, locked=True),
    Action("palette", "ctrl+p", "^P", N_("all actions"), N_("Find any action by its name."), bar=13),
    Action("tour", "ctrl+t", "^T", N_("guided tour"), N_("A minute on the simulated machine, key by key.")),
    Action("tour_next", "ctrl+n", "^N", N_("tour: next"), N_("Skips a step of the guided tour.")),
    Action("tour_end", "ctrl+e", "^E", N_("tour: end"), N_("Ends the guided tour.")),
    Action("units", "u", "U", N_("units"), N_("Metric, or mph and lb/ac.")),
    Action("language", "g", "G", N_("language"), N_("English, Chinese.")),
    Action("quit", "ctrl+q,ctrl+c", "^Q", N_("quit"), N_("Leaves the console; asked once while the machine works.")),
)
