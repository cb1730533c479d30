"""Keys of the Job page and what they do."""
from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from console.app.action import JOB, Action
from console.app.pages.job.desk import JobDesk
from console.locale import N_, _

if TYPE_CHECKING:
    from console.app.pages.job.page import JobScreen


def details(page: JobScreen) -> None:
    page.show_details()


def strip(page: JobScreen) -> None:
    page.begin_or_end_strip()


def refill(page: JobScreen) -> None:
    page.ask_refill()


def _with_files(do: Callable[[JobScreen, JobDesk], None]) -> Callable[[JobScreen], None]:
    """Refused in words where this console has no files at hand."""
    def run(page: JobScreen) -> None:
        if page.desk is None:
            page.app.notice(_("files are not at hand here"))
        else:
            do(page, page.desk)

    return run


@_with_files
def job(page: JobScreen, desk: JobDesk) -> None:
    page.ask_file(desk, "job")


@_with_files
def crop(page: JobScreen, desk: JobDesk) -> None:
    page.ask_file(desk, "crop")


@_with_files
def machine(page: JobScreen, desk: JobDesk) -> None:
    page.ask_file(desk, "machine")


@_with_files
def export(page: JobScreen, desk: JobDesk) -> None:
    page.ask_export(desk)


@_with_files
def report(page: JobScreen, desk: JobDesk) -> None:
    page.begin(_("report"), desk.report)


@_with_files
def end_of_job(page: JobScreen, desk: JobDesk) -> None:
    page.ask_end(desk)


ACTIONS = (
    Action("job_details", "v", "V", N_("details"), N_("Everything that the check list has to say, in full."), details,
           JOB, 3, locked=True),
    Action("job_file", "j", "J", N_("job"), N_("Takes another job file; the control worker starts again with it."), job,
           JOB, 4),
    Action("job_crop", "c", "C", N_("crop"), N_("Takes another crop: a new job file names it."), crop, JOB, 5),
    Action("job_machine", "m", "M", N_("machine"), N_("Takes another machine file."), machine, JOB, 6),
    Action("job_strip", "n", "N", N_("N strip"),
           N_("Begins at the strip's start, ends at its end: the mean NDVI between is stored to the job."), strip, JOB,
           7),
    Action("job_refill", "f", "F", N_("refill"), N_("Records kg filled in; a step of the scale is offered by itself."),
           refill, JOB, 8),
    Action("job_export", "e", "E", N_("export"), N_("What was applied where, as a file for other programs."), export,
           JOB, 9),
    Action("job_report", "r", "R", N_("report"), N_("The job's report: sums, map, evenness."), report, JOB, 10),
    Action("job_end", "k", "K", N_("end of job"),
           N_("Export and report; the job is not offered again after a power cut."), end_of_job, JOB, 10),
)
