"""Defines the keys of the Job page and their functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Concatenate, Literal, ParamSpec

from topdress.console.app.action import JOB, Action, set_page
from topdress.console.app.dialogs import Choice, ChoiceDialog, TextDialog
from topdress.console.app.first_question import start_from_any_page
from topdress.console.app.impossible_reasons import explain_no_start, explain_not_ready
from topdress.console.app.pages.job.checklist import (
    STRIP_BEGINS,
    STRIP_TITLES,
    compare_strip_rates,
    describe_index_doubt,
    describe_poor_strip,
    find_strips_in_force,
)
from topdress.console.app.pages.job.service import FileChoice, JobCard, JobService
from topdress.console.app.pages.job.strip_measurement import MIN_STRIP_M, StripRun
from topdress.console.app.units import Units
from topdress.console.locale import N_, _
from topdress.control.agronomy.reference_strips import StripMean
from topdress.control.orders import Do, Order, State
from topdress.drivers.files.formats.registry import list_able

if TYPE_CHECKING:
    from topdress.console.app.pages.job.page import JobScreen

FileKind = Literal["job", "crop", "machine"]
Parameters = ParamSpec("Parameters")
# Formats of an export that need no extra; the first suits most programs.
EXPORT_FORMATS = [one for one in list_able("write_export") if not one.writing_extra]


def show_details(page: JobScreen) -> None:
    """Show all checks in full."""
    lines = []
    for check in page.list_checks():
        lines += [
            f"{check.label}: {check.text}",
            *(f"    {text}" for text in check.full if text != check.text),
        ]
    page.app.push_screen(TextDialog(_("before work"), "\n".join(lines)))


def press_strip_key(page: JobScreen) -> None:
    """Begin a strip, or end the strip in progress and use its value after a question."""
    # One key begins and ends the strip, because the operator watches the field.
    if page.strip is None:
        _begin_strip(page)
        return
    so_far = page.strip.strip
    # A strip that is too short has no usable mean; the only question is whether to cancel it.
    if not so_far.is_long_enough or so_far.ndvi is None:
        text = _("{way} with NDVI so far; at least {least} are needed.").format(
            way=page.app.units.distance.format_with_name(so_far.length_m),
            least=page.app.units.distance.format_with_name(MIN_STRIP_M),
        )
        page.app.ask_yes_no(_("Cancel the strip?"), text, lambda: _cancel_strip(page))
        return
    # The value is taken before the question, while the machine may leave the strip.
    value = page.strip.value

    def use_value() -> None:
        if value is not None:
            page.strip = None
            _use_strip_value(page, value)

    text = _(
        "Mean over {way}, CV {cv} %, standard error {se}, {samples} samples. It counts from "
        "the next decision on, "
        "and is kept with the job."
    ).format(
        way=page.app.units.distance.format_with_name(so_far.length_m),
        cv=f"{so_far.cv_percent or 0.0:.1f}",
        se="--" if so_far.se is None else f"{so_far.se:.3f}",
        samples=so_far.samples,
    )
    title = _(STRIP_TITLES[page.strip.which]).format(ndvi=f"{so_far.ndvi:.3f}")
    # The question shows the effect on the rate before the value is used.
    with_it = page.replace_strip(value)
    said = (
        compare_strip_rates(
            page.facts,
            find_strips_in_force(page.app.arrival.frame, page.facts),
            with_it,
            page.field_ndvi,
            page.app.units,
        ),
        describe_poor_strip(value, page.field_ndvi),
        describe_index_doubt(with_it),
        text,
    )
    page.app.ask_yes_no(title, "\n".join(part for part in said if part), use_value)


def _begin_strip(page: JobScreen) -> None:
    """Begin a strip. Where the field's response index matters, the operator first chooses one of
    two kinds of strip."""

    def begin_run(which: str) -> None:
        page.strip = StripRun("check" if which == "check" else "nrich")
        page.app.show_notice(
            _(STRIP_BEGINS[page.strip.which]).format(
                least=page.app.units.distance.format_with_name(MIN_STRIP_M)
            )
        )
        page.refresh_all_next_tick()

    # Only the rule with a response index of the field needs two strips.
    if page.facts is None or page.facts.setup.rule.response_rule != "field":
        begin_run("nrich")
        return
    choices = [
        Choice("nrich", _("N-rich strip: got enough nitrogen")),
        Choice("check", _("farmer check: got what the field got")),
    ]
    page.app.ask_question(ChoiceDialog(_("Which strip begins here?"), choices, ""), begin_run)


def _cancel_strip(page: JobScreen) -> None:
    """Cancel the strip in progress."""
    page.strip = None
    page.refresh_all_next_tick()


def _use_strip_value(page: JobScreen, value: StripMean) -> None:
    """Use a strip's value at once by an order, and write it to a job file for the next start. Undo
    restores both."""
    # Undo needs the value that was in force before.
    before = value._replace(
        ndvi=getattr(find_strips_in_force(page.app.arrival.frame, page.facts), value.which), se=None
    )

    def save_value(strip: StripMean) -> None:
        service = page.service
        if service is not None:
            page.save_for_next_start(lambda: service.save_strip_value(strip))

    page.app.give_orders(Order(Do.STRIP, value.event_text), also_back=lambda: save_value(before))
    save_value(value)


def _needs_files(
    do: Callable[Concatenate[JobScreen, JobService, Parameters], None],
) -> Callable[Concatenate[JobScreen, Parameters], None]:
    """Convert a function that needs the job service to an action, which reports where this console
    has no files."""

    def run_with_service(
        page: JobScreen, /, *of: Parameters.args, **named: Parameters.kwargs
    ) -> None:
        if page.service is None:
            page.app.show_notice(_("files are not available here"))
        else:
            do(page, page.service, *of, **named)

    return run_with_service


@_needs_files
def _ask_for_file(page: JobScreen, service: JobService, kind: FileKind) -> None:
    """Ask for another job, crop or machine file."""
    if page.facts is None:
        page.app.show_notice(page.trouble or _("being read"))
        return
    # The list points out the file in use.
    now = {
        "job": page.facts.job_file,
        "crop": page.facts.crop_file,
        "machine": page.facts.machine_file,
    }[kind]
    if kind == "job":
        page.app.read_for_page(
            lambda: [
                Choice(
                    file.value,
                    format_job_card(file, card, page.app.units),
                    picture=card and card.picture,
                )
                # Cards take time to read, so the list is made in a thread.
                for file, card in service.list_job_cards()
            ],
            lambda choices: _choose_file(page, service, kind, choices, now),
        )
    else:
        files = page.facts.crops if kind == "crop" else page.facts.machines
        _choose_file(page, service, kind, [Choice(one.value, one.label) for one in files], now)


def _choose_file(
    page: JobScreen, service: JobService, kind: FileKind, choices: list[Choice], now: str
) -> None:
    """Ask for one of the listed files, and choose the answer for the next start."""
    title = {"job": _("Job"), "crop": _("Crop"), "machine": _("Machine")}[kind]

    def take_choice(value: str) -> None:
        def choose_in_service() -> str:
            service.choose_file(kind, value)
            return value

        # The file in use needs no restart.
        if value != now:
            page.choose_written_file(choose_in_service)

    page.ask_path(title, choices, kind, take_choice, now)


def format_job_card(file: FileChoice, card: JobCard | None, units: Units) -> str:
    """Return the lines that describe a job in a list."""
    # An unreadable job still appears in the list by its name.
    if card is None:
        return file.label
    said = [card.title, "  ".join(part for part in (card.field, card.crop) if part)]
    if card.map:
        said.append(_("map {name}").format(name=card.map))
    said.append(
        _("{area} done, {day}").format(
            area=units.area.format_with_name(card.done_ha), day=card.worked_utc[:10]
        )
        if card.worked_utc
        else _("not worked yet")
    )
    return "\n".join(said)


@_needs_files
def ask_export(page: JobScreen, service: JobService) -> None:
    """Ask for the format, then export the applied rates."""
    choices = [
        Choice(ending := one.written_endings[0], f"{one.title} ({ending})")
        for one in EXPORT_FORMATS
    ]
    page.app.ask_question(
        ChoiceDialog(_("Export as"), choices, ""),
        lambda ending: page.begin_work(
            _("export"),
            lambda log, progress, cancelled: service.export_as_applied(
                log, ending, progress, cancelled
            ),
        ),
    )


@_needs_files
def end_job(page: JobScreen, service: JobService) -> None:
    """End the job after a question: mark its end in the log, export it and write its report."""

    def mark_and_export() -> None:
        # The mark in the log makes the job "ended", so that it is not offered again after a power
        # cut.
        # The worker's snapshot reads this event from the log.
        page.app.give_order(Do.MARK, "job finished")
        page.begin_work(
            _("export"),
            lambda log, progress, cancelled: (
                *service.export_as_applied(log, ".geojson", progress, cancelled),
                *service.write_reports(log, progress, cancelled),
            ),
        )

    page.app.ask_yes_no(
        _("End this job?"),
        _("It is exported and reported, and not offered again after a power cut."),
        mark_and_export,
    )


def explain_no_log(page: JobScreen) -> str:
    """Return why nothing can be exported: no log is written."""
    frame = page.app.arrival.frame
    return "" if frame is not None and frame.log_path else _("no log is written")


def explain_no_end(page: JobScreen) -> str:
    """Return why the job cannot be ended."""
    frame = page.app.arrival.frame
    # A job must not end while material flows.
    works = frame is not None and frame.row.state == State.WORKING and not page.app.gone
    return _("the machine works: hold or stop it first") if works else explain_no_log(page)


ACTIONS = set_page(
    JOB,
    Action(
        "job_ready",
        "r",
        "R",
        N_("ready"),
        N_("Off, held or fault: make the machine ready."),
        lambda page: page.app.give_order(Do.READY),
        # The worker decides, because a state may have changed since the newest frame.
        bar=3,
        why=lambda page: explain_not_ready(page.app),
        judged=True,
        needs_machine=True,
    ),
    Action(
        "job_start",
        "s",
        "S",
        N_("start"),
        N_("Ready or held: begins to work, from any page; asks first."),
        lambda page: start_from_any_page(page.app),
        bar=3,
        why=lambda page: explain_no_start(page.app),
        needs_machine=True,
    ),
    Action(
        "job_details",
        "v",
        "V",
        N_("details"),
        N_("The whole checklist, in full."),
        show_details,
        bar=4,
        locked=True,
    ),
    Action(
        # The letters agree with those of other pages: J opens files everywhere.
        "job_file",
        "j",
        # Another job needs another worker, and that starts in OFF.
        "J",
        N_("job"),
        N_("Changes over to another job; the machine goes to OFF for it."),
        lambda page: _ask_for_file(page, "job"),
        bar=4,
    ),
    Action(
        "job_crop",
        "q_1",
        "Q1",
        N_("crop"),
        N_("Takes another crop; the job keeps what it was before."),
        lambda page: _ask_for_file(page, "crop"),
    ),
    Action(
        "job_machine",
        "q_2",
        "Q2",
        N_("machine"),
        N_("Takes another machine file."),
        lambda page: _ask_for_file(page, "machine"),
    ),
    Action(
        # A map comes from a memory stick, so the key searches there first.
        "job_map",
        "p",
        "P",
        N_("prescription"),
        N_(
            "Picks a map from a stick or folder, shows it, takes it; column and unit can be chosen."
        ),
        _needs_files(lambda page, service: page.look_for_maps(service)),
        bar=5,
    ),
    Action(
        "job_who",
        "q_3",
        "Q3",
        N_("whose"),
        N_("Client, farm, field, product and operator of the job."),
        _needs_files(lambda page, service: page.ask_names(service)),
    ),
    Action(
        "job_strip",
        "b",
        "B",
        N_("N strip"),
        N_(
            "Begins at the strip's start, ends at its end: the mean NDVI between counts at "
            "once, and is kept."
        ),
        press_strip_key,
        bar=7,
        needs_machine=True,
    ),
    Action(
        # The scale may have seen the refill already; then its mass is proposed.
        "job_refill",
        "f",
        "F",
        N_("refill"),
        N_("Records kg filled in; a step of the scale is offered by itself."),
        lambda page: page.ask_refill(),
        bar=8,
        asks="number",
        needs_machine=True,
    ),
    Action(
        "job_export",
        "e",
        "E",
        N_("export"),
        N_("What was applied where, as a file for other programs."),
        ask_export,
        bar=9,
        why=explain_no_log,
    ),
    Action(
        "job_report",
        "q_4",
        "Q4",
        N_("report"),
        N_("The job's report: sums, map, evenness."),
        _needs_files(lambda page, service: page.begin_work(_("report"), service.write_reports)),
        why=explain_no_log,
    ),
    # Ending is separate from leaving the console: a console may close while the job continues.
    Action(
        "job_end",
        "q_5",
        "Q5",
        N_("end of job"),
        N_("Export and report; the job is not offered again after a power cut."),
        end_job,
        why=explain_no_end,
    ),
)
