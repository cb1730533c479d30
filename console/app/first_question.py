"""Which field and job, asked at the start: what was worked lately first, one key for all as it
is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.pages.job.checklist import find_file_name
from topdress.console.app.view import format_local_time
from topdress.console.locale import _
from topdress.control.orders import Do

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp
    from topdress.console.app.pages.job.service import JobOffer, JobService, RecentSet

# states in which nothing is lost by another start
CHANGEABLE_STATES = (None, "off")


def ask_first_question(app: TopdressApp, service: JobService) -> None:
    """Ask for the job when there is something to choose from. The machine is there meanwhile, off:
    nothing waits for an answer."""

    def show_choices(found: tuple[RecentSet, ...]) -> None:
        frame = app.arrival.frame
        if (
            found
            and app.screen is app.page
            and (frame is None or frame.row.state in CHANGEABLE_STATES)
        ):
            now = _("Esc: it stays as it is now, {job} on {machine}.").format(
                job=frame.job if frame is not None else "--",
                machine=frame.machine if frame is not None else "--",
            )
            choices = [
                Choice(
                    str(number), _describe_recent(one, app), picture=one.card and one.card.picture
                )
                for number, one in enumerate(found)
            ]
            app.ask_question(
                ChoiceDialog(_("Which field and job?"), choices, "", now),
                lambda number: restart_worker(app, service, found[int(number)]),
            )

    app.read_for_page(lambda: service.list_recent(), show_choices)  # made in the thread


def restart_worker(app: TopdressApp, service: JobService, files: RecentSet) -> None:
    """End the machine that runs and start it anew with these files, unless it works."""

    def begin_if_idle() -> None:
        frame = app.arrival.frame
        if frame is not None and not app.gone and frame.row.state not in CHANGEABLE_STATES:
            service.drop_choices()
            app.show_notice(
                _("the machine works: stop it first, then choose again to start with it")
            )
        else:
            app.run_with_files(
                service.find_offer,
                lambda left: _start_with_choice(app, service, left),
                app.show_notice,
            )

    app.run_with_files(
        lambda: service.choose_recent(files), lambda _nothing: begin_if_idle(), app.show_notice
    )


def _start_with_choice(app: TopdressApp, service: JobService, left: JobOffer | None) -> None:
    """Start, asking first about a job that was left on the chosen field."""

    def take_choice(how: str | None) -> None:
        if how is None:
            service.drop_choices()
        else:
            app.restart_source(lambda: service.restart_worker(how == "anew"))

    if left is None:
        app.restart_source(service.restart_worker)
    else:
        app.push_screen(
            app.make_pass_question(left, _("A job was left on this field")), take_choice
        )


def _describe_recent(one: RecentSet, app: TopdressApp) -> str:
    day = one.began_utc[:10]
    since = (
        f"{day} {format_local_time(one.began_utc, app.utc_offset_s)[:5]}"
        if day
        else _("not worked yet")
    )
    done = (
        _("{area} done").format(area=app.units.area.format_with_name(one.card.done_ha))
        if one.card and one.card.done_ha
        else ""
    )
    rows = (
        (since, one.field or _("no field")),
        (one.job or find_file_name(one.files[0]), done),
        (one.machine,),
    )
    return "\n".join("  ".join(part for part in row if part) for row in rows).strip()


def start_from_any_page(app: TopdressApp) -> None:
    """Ask before START where the numbers of the machine are not in sight."""
    app.ask_yes_no(
        _("Start to work?"),
        _("The machine begins to spread as soon as it moves."),
        lambda: app.give_order(Do.START),
    )
