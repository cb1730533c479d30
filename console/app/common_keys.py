"""Defines the actions that every page offers, with their functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from textual.command import CommandPalette
from topdress.console.app import themes
from topdress.console.app.action import (
    CALIBRATE,
    DEVICES,
    DIAGNOSIS,
    JOB,
    MAP,
    REPLAY,
    RUN,
    SETTINGS,
    TRENDS,
    Action,
)
from topdress.console.app.alarms import make_alarm_entries
from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.dose_change_check import predict_dose_change
from topdress.console.app.first_question import start_from_any_page
from topdress.console.app.guided_tour import Tour
from topdress.console.app.impossible_reasons import (
    explain_no_acknowledge,
    explain_no_start,
    explain_no_tour,
    explain_no_undo,
)
from topdress.console.app.presence_text import describe_leaving
from topdress.console.app.screens.alarm_list import AlarmList
from topdress.console.app.screens.help_screen import HelpScreen
from topdress.console.app.screens.jump_letters import (
    JumpScreen,
    choose_label_letters,
    click_place,
    find_click_places,
    make_jump_labels,
)
from topdress.console.app.units import UNITS
from topdress.console.locale import N_, _, find_language_code, list_languages, use_language
from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.control.orders import Do, Severity, State

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp


def hold_machine(app: TopdressApp) -> None:
    """Hold the machine, or pause a log that is replayed without a machine."""
    if app.source is None and app.replay_page.job is not None:
        # The most important key of the machine is the most natural key of a player.
        app.replay_page.player.toggle_playing()
        app.replay_page.refresh_all_next_tick()
    else:
        app.give_order(Do.HOLD)


def acknowledge_alarms(app: TopdressApp) -> None:
    """Acknowledge the alarms on the screen; alarms that arrived later stay unacknowledged."""
    frame = app.arrival.frame
    # Acknowledging by id excludes an alarm that the operator has not seen.
    for alarm in frame.alarms if frame else ():
        # Amber alarms need no acknowledgement.
        if alarm.severity is Severity.RED and not alarm.acknowledged:
            app.give_order(Do.ACKNOWLEDGE, alarm.id)


def show_help(app: TopdressApp) -> None:
    """Show the keys of this screen."""
    # The same key pressed twice must not open two screens.
    if not isinstance(app.screen, HelpScreen):
        app.push_screen(HelpScreen(app.list_offered_actions(app.page.where)))


def show_alarm_list(app: TopdressApp) -> None:
    """Show the alarms of the run, or of the log that is replayed."""
    if isinstance(app.screen, AlarmList):
        return
    # The list belongs to what the page shows.
    replayed = app.page.where == REPLAY and app.replay_page.job is not None
    records: tuple[AlarmRecord, ...] = (
        app.replay_page.list_alarm_records() if replayed else app.alarm_history.records
    )
    title = _("Alarms of this log") if replayed else _("Alarms of this run")
    app.push_screen(AlarmList(title, make_alarm_entries(records, app.units, app.utc_offset_s)))


def toggle_lock(app: TopdressApp) -> None:
    """Lock the keys, or unlock them after a question."""
    if app.locked:
        app.ask_yes_no(_("Unlock the keys?"), "", lambda: app.lock_keys(False))
    else:
        app.lock_keys(True)


def choose_next_theme(app: TopdressApp) -> None:
    """Switch to the next theme."""
    # The theme changes for this session only; the settings keep their value.
    app.theme = themes.find_next_theme(app.theme)
    app.page.redraw_all()


def show_palette(app: TopdressApp) -> None:
    """Show the command palette."""
    app.push_screen(CommandPalette(placeholder=_("find an action"), id="--command-palette"))


def begin_tour(app: TopdressApp) -> None:
    """Begin the guided tour, which runs on the simulated machine only."""
    frame = app.arrival.frame
    # The tour starts and stops the machine, so it must never run on a real one.
    if frame is None or not frame.simulated or app.gone:
        app.show_notice(
            _("the tour needs the simulated machine: topdress run without a configuration")
        )
        return
    app.tour = Tour()
    app.show_changes()


def skip_tour_step(app: TopdressApp) -> None:
    """Skip to the tour's next step."""
    if app.tour is not None:
        app.tour.skip_step()
        app.show_changes()


def end_tour(app: TopdressApp) -> None:
    """End the tour."""
    app.tour = None
    app.show_changes()


def choose_next_units(app: TopdressApp) -> None:
    """Switch to the next system of units, after a question while the machine works."""

    def change_units() -> None:
        # The dict's order is the order of switching.
        names = list(UNITS)
        app.units = UNITS[names[(names.index(app.units.id) + 1) % len(names)]]
        app.show_changes()

    _ask_while_working(app, _("Other units?"), change_units)


def choose_next_language(app: TopdressApp) -> None:
    """Switch to the next language, after a question while the machine works."""

    def change_language() -> None:
        # Languages are folders of the catalogue, so a new one needs no change here.
        codes = list_languages()
        use_language(codes[(codes.index(find_language_code()) + 1) % len(codes)])
        app.page.redraw_all()
        app.show_newest()

    _ask_while_working(app, _("Another language?"), change_language)


def _ask_while_working(app: TopdressApp, question: str, change: Callable[[], None]) -> None:
    """Ask before a change of every number or word on the screen while the machine works."""
    frame = app.arrival.frame
    if frame is None or app.gone or frame.row.state != State.WORKING:
        change()
    else:
        app.ask_yes_no(
            question, _("The machine works. Everything on the screen is written anew."), change
        )


def ask_for_page(app: TopdressApp) -> None:
    """Ask which page to open."""
    choices = [
        # The id of the action contains the name of its page.
        Choice(one.id.removesuffix("_screen"), f"{_(one.label)}  ({one.shown})")
        for one in app.page_actions
    ]
    app.ask_question(
        ChoiceDialog(_("Go to which page?"), choices, app.page.where), app.turn_to_page
    )


def show_page_menu(app: TopdressApp) -> None:
    """Show the page's menu of actions without a letter key. A letter has the same meaning on all
    pages, so letters are scarce."""
    choices = [Choice(one.id, _(one.label), app.explain_not_now(one)) for one in app.list_menu()]
    app.ask_question(
        ChoiceDialog(_("What else this page does"), choices, ""),
        # The action runs after the dialog has closed, because an action may open a dialog itself.
        lambda name: app.call_later(app.action_do, name),
    )


def show_jump_letters(app: TopdressApp) -> None:
    """Show letters over everything clickable on the screen, also in a dialog."""
    if isinstance(app.screen, JumpScreen):
        return
    # The positions are those of the visible screen, so they are found before the letters cover it.
    places = find_click_places(app.screen)
    app.ask_question(
        JumpScreen(places, make_jump_labels(len(places), choose_label_letters(app.bound_keys))),
        click_place,
    )


def ask_to_undo(app: TopdressApp) -> None:
    """Undo the newest change, after a question."""
    change = app.undo.newest
    # The action's `why` has excluded an empty stack before this function runs.
    assert change is not None, "said by why_no_undo"

    def undo_newest() -> None:
        app.undo.pop_newest()
        change.back()

    # Undoing an order may change the dose, which the question must show.
    dose = predict_dose_change(app.arrival.frame, change.orders)
    said = _("It goes back to: {what}").format(what=change.what)
    app.ask_yes_no(
        _("Take the last change back?"),
        said if dose is None else f"{said}\n{dose.format_change(app.units)}",
        undo_newest,
    )


def copy_screen_text(app: TopdressApp) -> None:
    """Copy text through the terminal's own clipboard (escape sequence OSC 52), which also works
    over ssh."""
    frame, screen = app.arrival.frame, app.screen
    text = (
        # A selection is more specific than the text of a dialog, and a dialog more than the log's
        # path.
        screen.get_selected_text()
        or getattr(screen, "text", "")
        or ("" if frame is None else frame.log_path)
    )
    # An empty clipboard would only erase what it contains.
    if text:
        app.copy_to_clipboard(text)
        app.show_notice(_("copied: {text}").format(text=text.splitlines()[0]))


def leave_console(app: TopdressApp) -> None:
    """Close the console, after a question while the machine works."""
    frame = app.arrival.frame
    if app.gone or app.source is None or (frame is not None and frame.row.state != "working"):
        app.exit()
    else:
        text = "" if frame is None else describe_leaving(frame, app.own_name, app.keeps_working)
        app.ask_yes_no(_("Leave the console?"), text, app.exit)


ACTIONS = (
    # Hold and STOP work in every state and while the keys are locked.
    Action(
        "hold",
        "space",
        "Space",
        N_("hold"),
        N_("Stops the flow at once; Start resumes. In a replay alone: pause."),
        hold_machine,
        bar=1,
        locked=True,
        priority=True,
    ),
    Action(
        "stop",
        "x,f12",
        "X",
        N_("STOP"),
        N_("Machine off, from any state and on every screen (also F12)."),
        lambda app: app.give_order(Do.STOP),
        bar=2,
        locked=True,
        priority=True,
    ),
    # Acknowledging is locked with the other keys: a locked console must not silence an alarm by
    # accident.
    Action(
        "acknowledge",
        "a",
        "A",
        N_("acknowledge"),
        N_("Acknowledges the alarms that are shown."),
        acknowledge_alarms,
        bar=9,
        why=explain_no_acknowledge,
        needs_machine=True,
    ),
    Action(
        "menu",
        "q",
        "Q",
        N_("menu"),
        N_("What else this page does: a list; digit or arrow, then Enter."),
        show_page_menu,
        bar=3,
        why=lambda app: (
            "" if app.list_menu() else _("this page has no menu: all its keys are in F1")
        ),
    ),
    # Help, pages and themes change nothing on the machine, so they work while the keys are locked.
    Action("help", "f1", "F1", N_("help"), N_("This page."), show_help, bar=3, locked=True),
    Action(
        "run_screen",
        "f2",
        "F2",
        N_("run"),
        N_("The machine at work."),
        lambda app: app.turn_to_page(RUN),
        locked=True,
    ),
    Action(
        "map_screen",
        "f3",
        "F3",
        N_("map"),
        N_("The field: applied, target, error, NDVI, plan."),
        lambda app: app.turn_to_page(MAP),
        locked=True,
    ),
    Action(
        "trends_screen",
        "f4",
        "F4",
        N_("trends"),
        N_("Any channel over any time span; freeze it, read off values."),
        lambda app: app.turn_to_page(TRENDS),
        locked=True,
    ),
    Action(
        "devices_screen",
        "f5",
        "F5",
        N_("devices"),
        N_("Every port and what it sends; test it, record raw data."),
        lambda app: app.turn_to_page(DEVICES),
        locked=True,
    ),
    Action(
        "calibrate_screen",
        "f6",
        "F6",
        N_("calibrate"),
        N_("Catch test, lag test, heads check, wheel, effort."),
        lambda app: app.turn_to_page(CALIBRATE),
        locked=True,
    ),
    Action(
        "replay_screen",
        "f7",
        "F7",
        N_("replay"),
        N_("A log, played again."),
        lambda app: app.turn_to_page(REPLAY),
        locked=True,
    ),
    Action(
        "diagnosis_screen",
        "f9",
        "F9",
        N_("diagnosis"),
        N_("What is wrong with the machine, and why: from its logs."),
        lambda app: app.turn_to_page(DIAGNOSIS),
        locked=True,
    ),
    Action(
        "job_screen",
        "f10",
        "F10",
        N_("job"),
        N_("Before work, totals, refills, N-rich strip, end of the job."),
        lambda app: app.turn_to_page(JOB),
        locked=True,
    ),
    Action(
        "settings_screen",
        "f11",
        "F11",
        N_("settings"),
        N_("Units, language, look, sound, limits, keys."),
        lambda app: app.turn_to_page(SETTINGS),
        locked=True,
    ),
    # Some terminals use F-keys themselves; this list replaces them.
    Action(
        "pages",
        "tab",
        "Tab",
        N_("pages"),
        N_("Goes to a page, where the terminal keeps the F-keys to itself."),
        ask_for_page,
        bar=10,
        locked=True,
    ),
    # A question protects START here, because the page may not show the machine's numbers.
    Action(
        "start_anywhere",
        "ctrl+s",
        "^S",
        N_("start, asked"),
        N_("Ready or held: begins to work, from any page; asks first."),
        lambda app: start_from_any_page(app),
        bar=2,
        why=explain_no_start,
        needs_machine=True,
    ),
    Action(
        "undo",
        "ctrl+z",
        "^Z",
        N_("undo"),
        N_(
            "Takes the last change back: dose, target, strategy, strip, switch, refill, "
            "setting; asks first."
        ),
        ask_to_undo,
        why=explain_no_undo,
    ),
    Action(
        "alarm_list",
        "exclamation_mark",
        "!",
        N_("alarms"),
        N_("All alarms of the run or log, with what to do."),
        show_alarm_list,
        locked=True,
    ),
    Action(
        "lock",
        "f8",
        "F8",
        N_("lock"),
        N_("Only hold and stop stay; unlocking asks first."),
        toggle_lock,
        bar=11,
        locked=True,
    ),
    Action(
        "theme",
        "d",
        "D",
        N_("day / night"),
        N_("Day, night, high contrast."),
        choose_next_theme,
        bar=12,
        locked=True,
    ),
    Action(
        "palette",
        "ctrl+p",
        "^P",
        N_("all actions"),
        N_("Find any action by its name."),
        show_palette,
        bar=13,
    ),
    Action(
        "jump",
        "apostrophe",
        "'",
        N_("letters"),
        N_("Letters over what can be clicked; typing them clicks it."),
        show_jump_letters,
        locked=True,
    ),
    Action(
        # The keys of the tour are Ctrl combinations, because its steps use the plain letters.
        "tour",
        "ctrl+t",
        "^T",
        N_("guided tour"),
        N_("A minute on the simulated machine, key by key."),
        begin_tour,
    ),
    Action(
        "tour_next",
        "ctrl+n",
        "^N",
        N_("tour: next"),
        N_("Skips a step of the guided tour."),
        skip_tour_step,
        why=explain_no_tour,
    ),
    Action(
        "tour_end",
        "ctrl+e",
        "^E",
        N_("tour: end"),
        N_("Ends the guided tour."),
        end_tour,
        why=explain_no_tour,
    ),
    # Units and language are asked while working: every number on the screen would change its
    # meaning.
    Action("units", "u", "U", N_("units"), N_("Metric, or mph and lb/ac."), choose_next_units),
    Action("language", "g", "G", N_("language"), N_("English, Chinese."), choose_next_language),
    Action(
        "copy",
        "ctrl+y",
        "^Y",
        N_("copy"),
        N_("The list of alarms, the text of a dialog, or the path of the log."),
        copy_screen_text,
    ),
    # Ctrl+C is what an operator of terminals tries first, so it asks like Ctrl+Q instead of ending
    # the program.
    Action(
        "quit",
        "ctrl+q,ctrl+c",
        "^Q",
        N_("quit"),
        N_("Leaves the console; asks first while the machine works."),
        leave_console,
    ),
)
