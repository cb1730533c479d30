"""Actions of the Job screen."""
from __future__ import annotations

from console.app.action import JOB, Action
from console.locale import N_

ACTIONS = (
    Action("job_details", "v", "V", N_("details"), N_("Everything that the check list has to say, in full."), JOB, 3,
           locked=True),
    Action("job_file", "j", "J", N_("job"), N_("Takes another job file; the control worker starts again with it."), JOB,
           4),
    Action("job_crop", "c", "C", N_("crop"), N_("Takes another crop: a new job file names it."), JOB, 5),
    Action("job_machine", "m", "M", N_("machine"), N_("Takes another machine file."), JOB, 6),
    Action("job_strip", "n", "N", N_("N strip"),
           N_("Begins at the strip's start, ends at its end: the mean NDVI between is stored to the job."), JOB, 7),
    Action("job_refill", "f", "F", N_("refill"), N_("Records kg filled in; a step of the scale is offered by itself."),
           JOB, 8),
    Action("job_export", "e", "E", N_("export"), N_("What was applied where, as a file for other programs."), JOB, 9),
    Action("job_report", "r", "R", N_("report"), N_("The job's report: sums, map, evenness."), JOB, 10),
    Action("job_end", "k", "K", N_("end of job"), N_("Export and report; the job is not offered again after a power "
                                                    "cut."), JOB, 10),
)
