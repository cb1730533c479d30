"""Actions of the Diagnosis screen."""
from __future__ import annotations

from console.app.action import DIAGNOSIS, Action
from console.locale import N_

ACTIONS = (
    Action("dia_up", "up", "Up", N_("above"), N_("The file, or the cause, above."), DIAGNOSIS),
    Action("dia_down", "down", "Down", N_("below"), N_("The file, or the cause, below."), DIAGNOSIS),
    Action("dia_begin", "enter", "Enter", N_("diagnose"), N_("Looks at the chosen file; nothing of the machine is "
                                                             "touched."), DIAGNOSIS, 3),
    Action("dia_pick", "p", "P", N_("other data"), N_("Back to the list of files, read anew."), DIAGNOSIS, 4),
    Action("dia_path", "t", "T", N_("type a path"), N_("A file that is not in the list."), DIAGNOSIS),
    Action("dia_machine", "m", "M", N_("against"), N_("The machine file that the data is held against."), DIAGNOSIS),
    Action("dia_view", "v", "V", N_("next view"), N_("Causes, channels, plots, the separating run, in turn."),
           DIAGNOSIS, 5),
    Action("dia_adopt", "k", "K", N_("adopt"), N_("Writes a new machine file with what was found; asked once. The "
                                                  "running job keeps its own."), DIAGNOSIS, 6),
    Action("dia_report", "e", "E", N_("report"), N_("Writes a page with pictures (HTML)."), DIAGNOSIS, 7),
    Action("dia_data", "j", "J", N_("data"), N_("Writes the result as data (JSON)."), DIAGNOSIS),
    Action("dia_run_file", "w", "W", N_("job file"), N_("Writes the separating run as a job file."), DIAGNOSIS),
    Action("dia_drive", "i", "I", N_("drive it, simulated"), N_("Drives the separating run on a simulated machine and "
                                                                "diagnoses it too."), DIAGNOSIS, 8),
    Action("dia_other", "b", "B", N_("other log"), N_("From the log to the separating run and back."), DIAGNOSIS),
)
