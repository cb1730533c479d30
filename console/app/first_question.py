"""Asks at the start for field and job, most recent first; one key accepts the last set
unchanged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.pages.job.checklist import find_file_name
from topdress.console.app.panel_views import format_local_time
from topdress.console.locale import _
from topdress.control.orders import Do

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp
    from topdress.console.app.pages.job.service import JobOffer, JobService, RecentSet

# States in which a restart of the machine loses nothing.
CHANGEABLE_STATES = (None, "off")


def ask_first_question(app: TopdressApp, service: JobService) -> None:
    """Ask for the job if there are recent jobs. Meanwhile the machine is connected and off, so
    nothing depends on the answer."""

    def show_choices(found: tuple[RecentSet, ...]) -> None:
        # The operator may have opened a dialog or switched the machine on while the files were
        # read.
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

    # The lambda looks the method up in the thread, where the service imports its modules.
    app.read_for_page(lambda: service.list_recent(), show_choices)


def restart_worker(app: TopdressApp, service: JobService, files: RecentSet) -> None:
    """Restart the machine with a set of files, unless it works."""

    def begin_if_idle() -> None:
        frame = app.arrival.frame
        if frame is not None and not app.gone and frame.row.state not in CHANGEABLE_STATES:
            # A choice that is not used now must not take effect at a later start.
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
    """Start the machine; ask first if a job on the chosen field was interrupted."""

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
    """Return three lines about a recent job: time and field, job and area done, machine."""
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
    """Ask before START on a page that does not show the machine's numbers."""
    app.ask_yes_no(
        _("Start to work?"),
        _("The machine begins to spread as soon as it moves."),
        lambda: app.give_order(Do.START),
    )
