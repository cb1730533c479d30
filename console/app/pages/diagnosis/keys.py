"""Defines the keys of the Diagnosis page and their functions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from topdress.console.app.action import DIAGNOSIS, Action
from topdress.console.app.dialogs import Choice, ChoiceDialog, Confirm, TextDialog
from topdress.console.app.name_dialog import NameDialog
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.diagnosis.page import DiagnosisScreen
    from topdress.console.app.pages.diagnosis.service import Adoption, DiagnosisView
    from topdress.control.diagnosis.result import Cause


# Value of the choice that asks for a path.
TYPED_PATH = "typed"
# Expected duration of a comparison on two cores, s: two predictions of a log and their pictures.
# Progress bars use these durations.
COMPARE_DURATION_S = 10.0
# Expected duration of an installation, s: download and unpack 70 MB.
INSTALL_DURATION_S = 40.0
# Expected duration of a simulated run on two cores, s per minute of the run, with its diagnosis.
DRIVE_S_PER_MIN = 1.5


def move_mark_up(page: DiagnosisScreen) -> None:
    """Move the mark up."""
    page.move_mark(-1)


def move_mark_down(page: DiagnosisScreen) -> None:
    """Move the mark down."""
    page.move_mark(1)


def diagnose_chosen(page: DiagnosisScreen) -> None:
    """Diagnose the marked data."""
    # The key stays visible without the packages, because its notice tells how to install them.
    if not page.installed:
        page.app.show_notice(_("not installed: Q8 installs the diagnosis"))
    elif page.shown is None and page.sources:
        page.diagnose_source(page.sources[page.at])


def install_extra(page: DiagnosisScreen) -> None:
    """Install the optional packages of the diagnosis."""
    if not page.installed:
        page.begin_work(
            _("Installing the diagnosis"), page.required_service.install_extra, INSTALL_DURATION_S
        )


def choose_other_data(page: DiagnosisScreen) -> None:
    """Return to the list of data, which is read again."""
    page.show_data_list()
    page.sources = None


def ask_data_path(page: DiagnosisScreen) -> None:
    """Ask for a path, then diagnose its data."""
    service = page.required_service

    def find_fault(text: str) -> str:
        try:
            service.find_source(text)
        except ValueError as error:
            return str(error)
        return ""

    def diagnose_typed(path: str | None) -> None:
        if path is not None:
            page.diagnose_source(service.find_source(path))

    # Every kind of data has the same door: the service recognises the kind.
    what = _("A run log, a bench table, or the log of another machine")
    page.app.push_screen(NameDialog(_("Which file?"), "", what, find_fault), diagnose_typed)


def choose_machine(page: DiagnosisScreen) -> None:
    """Choose the machine file with which the data is compared."""
    choices = [
        Choice("", _("as the log says")),
        # The list shows eight files, because a digit chooses an entry.
        *(Choice(name, Path(name).stem) for name in page.machines[:8]),
    ]

    def take_choice(name: str | None) -> None:
        if name is not None:
            page.machine = name or None
            page.show_changes()

    page.app.push_screen(
        ChoiceDialog(_("Compare against which machine file?"), choices, page.machine or ""),
        take_choice,
    )


def show_next_view(page: DiagnosisScreen) -> None:
    """Switch to the next view."""
    # The order of the views depends on the size of the screen.
    views = page.list_views()
    page.visible_view = (
        views[(views.index(page.visible_view) + 1) % len(views)]
        if page.visible_view in views
        else views[0]
    )


def _needs_diagnosis(
    do: Callable[[DiagnosisScreen, DiagnosisView], None],
) -> Callable[[DiagnosisScreen], None]:
    """Convert a function of the displayed diagnosis to an action; `explain_no_diagnosis` excludes
    that none is displayed."""

    def run_on_shown(page: DiagnosisScreen) -> None:
        assert page.shown is not None
        do(page, page.shown)

    return run_on_shown


def explain_no_diagnosis(page: DiagnosisScreen) -> str:
    """Return why nothing can be done while nothing is diagnosed."""
    return _("choose data and press Enter first") if page.shown is None else ""


def explain_no_drive(page: DiagnosisScreen) -> str:
    """Return why no run that separates the causes can be driven; empty if one can."""
    return explain_no_diagnosis(page) or (
        ""
        if page.shown is not None and page.shown.drives
        else _("there is no separating run that can be driven here")
    )


@_needs_diagnosis
def ask_to_adopt(page: DiagnosisScreen, found: DiagnosisView) -> None:
    """Ask which causes to adopt, then write the machine file."""
    if not found.adoptable:
        # The reasons why nothing can be adopted are part of the result.
        why = "\n".join(found.refused) or _("nothing was found that can go into a machine file")
        page.app.push_screen(TextDialog(_("Not adopted"), why))
        return
    # Modules of the diagnosis are imported on use, so that the console starts without them.
    from topdress.console.app.pages.diagnosis.adoption import list_undecided

    _ask_next_cause(page, found, list_undecided(found), ())


# Answer that adopts none of the rival causes.
NO_CAUSE_CHOICE = ""


def _ask_next_cause(
    page: DiagnosisScreen, found: DiagnosisView, open_: tuple[Cause, ...], picked: tuple[str, ...]
) -> None:
    """Ask about one undecided cause after the other. None is adopted unless the operator picks it
    by name."""
    # Every undecided cause was asked; the choice is complete.
    if not open_:
        _ask_for_reason(page, found, picked)
        return
    from topdress.console.reports.diagnosis_wording import (
        find_cause_title,
        find_effect_title,
        list_rivals,
    )
    from topdress.console.reports.number_text import format_percent

    cause, rest = open_[0], open_[1:]
    # A rival has no estimated size, so a machine file cannot contain it.
    unsized = _("its size is not known before the separating run")
    choices = (
        Choice(NO_CAUSE_CHOICE, _("none of these: the next test is driven first")),
        Choice(cause.id, f"{find_cause_title(cause)} {format_percent(cause.probability)}"),
        *(
            Choice(f"rival {rival}", f"{find_effect_title(rival)} {format_percent(share)}", unsized)
            for rival, share in list_rivals(cause)
        ),
    )

    def take_choice(value: str | None) -> None:
        if value is not None:
            _ask_next_cause(
                page, found, rest, (*picked, value) if value != NO_CAUSE_CHOICE else picked
            )

    # The question differs between a cause without rivals and causes that the data cannot separate.
    question = _("Undecided: this is only suspected. Is it adopted all the same?")
    if list_rivals(cause):
        question = _(
            "Undecided: this data cannot tell these apart. Is one of them adopted all the same?"
        )
    page.app.push_screen(ChoiceDialog(question, choices, ""), take_choice)


def _ask_for_reason(page: DiagnosisScreen, found: DiagnosisView, picked: tuple[str, ...]) -> None:
    """Ask for the reason of a pick that the data does not support; the machine file stores the
    reason."""
    from topdress.console.app.pages.diagnosis.adoption import merge_picked_ids
    from topdress.console.app.pages.diagnosis.service import Adoption

    ids = merge_picked_ids(found, picked)
    # Nothing was picked and nothing was decided.
    if not ids:
        page.app.show_notice(_("nothing is adopted: the next test decides"))
    # Decided causes alone need no reason by the operator.
    elif not picked:
        _ask_to_write(page, found, Adoption(ids))
    else:

        def take_reason(text: str | None) -> None:
            if text is not None:
                _ask_to_write(page, found, Adoption(ids, text))

        page.app.push_screen(
            NameDialog(
                _("Why this one?"),
                "",
                _("It is kept in the machine file, for whoever reads it later."),
            ),
            take_reason,
        )


def _ask_to_write(page: DiagnosisScreen, found: DiagnosisView, chosen: Adoption) -> None:
    """Show what the new machine file would contain, and write it after a yes."""
    from topdress.console.app.pages.diagnosis import diagnosis_words
    from topdress.console.app.pages.diagnosis.adoption import find_offer, list_undecided
    from topdress.console.reports.diagnosis_wording import find_cause_title

    # The files were prepared with the diagnosis, so the changes can be shown before writing.
    offer = find_offer(found, chosen.ids)
    left = [find_cause_title(one) for one in list_undecided(found) if one.id not in chosen.ids]
    lines = [
        _("Adopted: {what}").format(
            what=", ".join(diagnosis_words.find_adopted_title(found, one) for one in chosen.ids)
        )
    ]
    lines += (
        [_("Machine file, before -> after:"), *offer.changes]
        if offer is not None and offer.changes
        else []
    )
    lines += [_("Not adopted, undecided: {what}").format(what=", ".join(left))] if left else []
    # Causes may exclude each other only in combination.
    refused = offer.refused if offer is not None else ()
    lines += [_("Not adopted: {why}").format(why=why) for why in (*refused, *found.refused)]
    # A refused combination has no file to write.
    if offer is not None and not offer.file:
        page.app.push_screen(TextDialog(_("Not adopted"), "\n".join(refused)))
        return
    lines.append(
        _(
            "The running job keeps its machine file; the next one may use the new file. Del "
            "takes it back."
        )
    )

    def write_if_yes(yes: bool | None) -> None:
        if yes:
            page.write_file(
                _("The new machine file"),
                partial(page.required_service.adopt_effects, found, chosen),
                True,
            )

    page.app.push_screen(Confirm(_("Write a new machine file?"), "\n".join(lines)), write_if_yes)


def undo_adoption(page: DiagnosisScreen) -> None:
    """Undo the last change of the machine file that was adopted here, else of the file in
    comparison."""
    # The file that was written here last is the one an operator wants to correct.
    machine = page.adopted or page.machine
    page.app.read_for_page(
        partial(page.required_service.describe_last_change, machine),
        partial(_ask_to_undo, page, machine),
    )


def _ask_to_undo(page: DiagnosisScreen, machine: str | None, lines: tuple[str, ...]) -> None:
    """Show the change that would be undone, and undo it after a yes."""
    # A file without changes by a diagnosis has nothing to undo.
    if not lines:
        page.app.show_notice(_("no diagnosis changed this machine file: nothing to take back"))
        return

    def undo_if_yes(yes: bool | None) -> None:
        if yes:
            page.write_file(
                _("The machine file without it"),
                partial(page.required_service.undo_last_change, machine),
                True,
            )

    text = [*lines, _("A new machine file is written without this; the one that has it stays.")]
    page.app.push_screen(Confirm(_("Take the last change back?"), "\n".join(text)), undo_if_yes)


def compare_before_after(page: DiagnosisScreen) -> None:
    """Compare the adopted machine file before and after, on a log of another day."""
    # The log of the diagnosis itself is excluded: on its own data every fit looks better.
    logs = [
        one
        # The log that the worker still writes is incomplete.
        for one in page.sources or ()
        if one.kind == "run"
        and not one.working
        and one.path not in [one.found.data.path for one in page.found]
    ]
    choices = [
        *(Choice(one.path, f"{one.name}  {one.changed}") for one in logs),
        Choice(TYPED_PATH, _("another file: type its path")),
    ]

    def take_choice(path: str | None) -> None:
        if path == TYPED_PATH:
            page.app.push_screen(
                NameDialog(_("Which file?"), "", _("A run log of the same machine"), find_fault),
                compare_on,
            )
        elif path is not None:
            compare_on(path)

    def find_fault(text: str) -> str:
        try:
            kind = page.required_service.find_source(text).kind
        except ValueError as error:
            return str(error)
        # Only a run log contains all channels that the comparison predicts.
        return "" if kind == "run" else _("no run log: diagnose it first, then it is one")

    def compare_on(path: str | None) -> None:
        if path is not None:
            source = page.required_service.find_source(path)
            page.begin_work(
                _("Before and after, on {name}").format(name=source.name),
                partial(page.required_service.compare_machines, page.adopted, source),
                COMPARE_DURATION_S,
            )

    page.app.push_screen(
        ChoiceDialog(_("On which log? One that the machine file was not made from."), choices, ""),
        take_choice,
    )


@_needs_diagnosis
def write_report(page: DiagnosisScreen, found: DiagnosisView) -> None:
    """Write the report as HTML."""
    page.write_file(_("The report"), partial(page.required_service.export_result, found, "report"))


@_needs_diagnosis
def write_result_data(page: DiagnosisScreen, found: DiagnosisView) -> None:
    """Write the result as JSON."""
    page.write_file(
        _("The result as data"), partial(page.required_service.export_result, found, "data")
    )


@_needs_diagnosis
def write_job_file(page: DiagnosisScreen, found: DiagnosisView) -> None:
    """Write the separating run as a job file."""
    page.write_file(
        _("The separating run as a job file"),
        partial(page.required_service.write_separating_job, found),
    )


@_needs_diagnosis
def drive_separating_run(page: DiagnosisScreen, found: DiagnosisView) -> None:
    """Drive the separating run on a simulated machine, after a question."""
    from topdress.console.reports.diagnosis_wording import list_next_steps

    # The operator must know that no real machine moves.
    text = _(
        "{minutes} minutes of simulated time, in seconds. Only a simulated machine moves; "
        "the real one and "
        "its job are left alone."
    ).format(minutes=f"{found.minutes:g}")

    def drive_if_yes(yes: bool | None) -> None:
        if yes:
            page.begin_work(
                _("Separating run, simulated"),
                partial(page.required_service.drive_separating_run, found),
                DRIVE_S_PER_MIN * found.minutes,
            )

    page.app.push_screen(
        Confirm(_("Drive the separating run?"), "\n".join((*list_next_steps(found.found), text))),
        drive_if_yes,
    )


@_needs_diagnosis
def show_other_log(page: DiagnosisScreen, found: DiagnosisView) -> None:
    """Show the next of several diagnosed logs."""
    # The marked cause belongs to the former log.
    page.which, page.cause = (page.which + 1) % len(page.found), 0


ACTIONS = (
    Action(
        "dia_up",
        "up",
        "Up",
        N_("above"),
        N_("Moves up one file or cause."),
        move_mark_up,
        DIAGNOSIS,
    ),
    Action(
        "dia_down",
        "down",
        "Down",
        N_("below"),
        N_("Moves down one file or cause."),
        move_mark_down,
        DIAGNOSIS,
    ),
    Action(
        "dia_begin",
        "enter",
        "Enter",
        N_("diagnose"),
        N_("Checks the chosen file; nothing on the machine is touched."),
        diagnose_chosen,
        DIAGNOSIS,
        3,
    ),
    Action(
        # The diagnosis needs 210 MB of packages, which the console itself does without.
        "dia_install",
        "q_8",
        "Q8",
        N_("install"),
        N_("Installs what computes a diagnosis, where it is not there."),
        install_extra,
        DIAGNOSIS,
    ),
    Action(
        # Files may have appeared since the list was read.
        "dia_pick",
        "j",
        "J",
        N_("other data"),
        N_("Back to the list of files, read anew."),
        choose_other_data,
        DIAGNOSIS,
        4,
    ),
    Action(
        "dia_path",
        "q_2",
        "Q2",
        N_("type a path"),
        N_("A file that is not in the list."),
        ask_data_path,
        DIAGNOSIS,
        asks="text",
    ),
    Action(
        "dia_machine",
        "q_3",
        "Q3",
        N_("against"),
        N_("The machine file that the data is compared with."),
        choose_machine,
        DIAGNOSIS,
    ),
    Action(
        "dia_view",
        "v",
        "V",
        N_("next view"),
        N_("Causes, channels, plots, the separating run, in turn."),
        show_next_view,
        DIAGNOSIS,
        5,
    ),
    Action(
        # Adopting writes a new file and changes no machine, so it needs no connection.
        "dia_adopt",
        "q_1",
        "Q1",
        N_("adopt"),
        N_(
            "Writes a new machine file with what is decided, and what you pick by name; Del "
            "takes it back."
        ),
        ask_to_adopt,
        DIAGNOSIS,
        why=explain_no_diagnosis,
    ),
    Action(
        # Both keys delete on the keyboards of different systems.
        "dia_back",
        "delete,backspace",
        "Del",
        N_("take back"),
        N_("Writes the machine file without what was adopted last; asks first."),
        undo_adoption,
        DIAGNOSIS,
    ),
    Action(
        "dia_compare",
        "q_4",
        "Q4",
        N_("compare"),
        N_("Says on another log whether the adopted machine file predicts better than before."),
        compare_before_after,
        DIAGNOSIS,
        why=lambda page: (
            ""
            if page.adopted
            else _("adopt something first: it is compared on a log that it was not made from")
        ),
    ),
    Action(
        "dia_report",
        "e",
        "E",
        N_("report"),
        N_("Writes a page with pictures (HTML)."),
        write_report,
        DIAGNOSIS,
        7,
        why=explain_no_diagnosis,
    ),
    Action(
        "dia_data",
        "q_6",
        "Q6",
        N_("data"),
        N_("Writes the result as data (JSON)."),
        write_result_data,
        DIAGNOSIS,
        why=explain_no_diagnosis,
    ),
    Action(
        "dia_run_file",
        "q_7",
        "Q7",
        N_("job file"),
        N_("Writes the separating run as a job file."),
        write_job_file,
        DIAGNOSIS,
        why=explain_no_drive,
    ),
    Action(
        # Only the simulated machine is driven: a real run needs a driver on the tractor.
        "dia_drive",
        "q_5",
        "Q5",
        N_("drive it, simulated"),
        N_("Drives the separating run on a simulated machine and diagnoses it too."),
        drive_separating_run,
        DIAGNOSIS,
        why=explain_no_drive,
    ),
    Action(
        "dia_other",
        "right,left",
        ">",
        N_("other log"),
        N_("From the log to the separating run and back."),
        show_other_log,
        DIAGNOSIS,
        why=explain_no_diagnosis,
    ),
)
