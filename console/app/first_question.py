"""Which field and job, asked at the start: what was worked lately first, one key for all as it
is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.pages.job.checklist import file_name
from topdress.console.app.view import format_local_time
from topdress.console.locale import _
from topdress.control.orders import Do

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp
    from topdress.console.app.pages.job.service import JobService, Offer, Recent

# states in which nothing is lost by another start
MAY_CHANGE = (None, "off")


def ask_first_question(app: TopdressApp, service: JobService) -> None:
    """Asks when there is something to choose from. The machine is there meanwhile, off: nothing
    waits for an answer."""

    def listed(found: tuple[Recent, ...]) -> None:
        frame = app.arrival.frame
        if found and app.screen is app.page and (frame is None or frame.row.state in MAY_CHANGE):
            now = _("Esc: it stays as it is now, {job} on {machine}.").format(
                job=frame.job if frame is not None else "--",
                machine=frame.machine if frame is not None else "--",
            )
            choices = [
                Choice(str(number), _words(one, app), picture=one.card and one.card.picture)
                for number, one in enumerate(found)
            ]
            app.ask(
                ChoiceDialog(_("Which field and job?"), choices, "", now),
                lambda number: restart_worker(app, service, found[int(number)]),
            )

    app.list_files(lambda: service.list_recent(), listed)  # made in the thread


def restart_worker(app: TopdressApp, service: JobService, files: Recent) -> None:
    """The machine that runs is ended and starts anew with these, unless it works."""

    def begin() -> None:
        frame = app.arrival.frame
        if frame is not None and not app.gone and frame.row.state not in MAY_CHANGE:
            service.drop_choices()
            app.notice(_("the machine works: stop it first, then choose again to start with it"))
        else:
            app.with_files(service.find_offer, lambda left: _start(app, service, left), app.notice)

    app.with_files(lambda: service.choose_recent(files), lambda _nothing: begin(), app.notice)


def _start(app: TopdressApp, service: JobService, left: Offer | None) -> None:
    """left: a job that has spread on the field that was chosen."""

    def answer(how: str | None) -> None:
        if how is None:
            service.drop_choices()
        else:
            app.restart(lambda: service.restart_worker(how == "anew"))

    if left is None:
        app.restart(service.restart_worker)
    else:
        app.push_screen(app.pass_question(left, _("A job was left on this field")), answer)


def _words(one: Recent, app: TopdressApp) -> str:
    day = one.began_utc[:10]
    since = (
        f"{day} {format_local_time(one.began_utc, app.utc_offset_s)[:5]}"
        if day
        else _("not worked yet")
    )
    done = (
        _("{area} done").format(area=app.units.area.full(one.card.done_ha))
        if one.card and one.card.done_ha
        else ""
    )
    rows = (
        (since, one.field or _("no field")),
        (one.job or file_name(one.files[0]), done),
        (one.machine,),
    )
    return "\n".join("  ".join(part for part in row if part) for row in rows).strip()


def start_from_any_page(app: TopdressApp) -> None:
    """Where the numbers of the machine are not in sight, START is asked."""
    app.confirm(
        _("Start to work?"),
        _("The machine begins to spread as soon as it moves."),
        lambda: app.give(Do.START),
    )
