"""Defines the keys of the Map page and their functions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from topdress.console.app import map_layers
from topdress.console.app.action import MAP, Action, set_page
from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.guide_line_store import make_line_record
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.map.page import MapScreen
    from topdress.console.app.pages.replay.service import LogFile


def show_next_layer(page: MapScreen) -> None:
    """Show the next layer."""
    page.shown_layer = map_layers.find_next_layer(page.shown_layer)


def show_whole_field(page: MapScreen) -> None:
    """Show the whole field."""
    page.camera, page.marked = None, False


def toggle_plan(page: MapScreen) -> None:
    """Show or hide the plan."""
    page.plan = not page.plan


def ask_overlay_file(page: MapScreen) -> None:
    """Ask for a file to overlay on the map, newest first; an entry removes the present overlay."""
    # The log that is being written is excluded: it is the work itself.
    services, frame = page.app.services.layers, page.app.arrival.frame
    running = frame.log_path if frame is not None else ""
    if services is None:
        _choose_overlay(page, ())
    else:
        page.app.read_for_page(
            partial(services.list_layer_files, running), partial(_choose_overlay, page)
        )


def _choose_overlay(page: MapScreen, listed: tuple[LogFile, ...]) -> None:
    """Ask for one of the listed files."""
    # An empty list without an overlay to remove would offer nothing.
    if not listed and not page.laid.path:
        page.app.show_notice(_("there is no file yet that could be laid on the map"))
        return
    choices = [Choice(one.path, f"{one.name}  {one.changed}  {one.size}") for one in listed]
    if page.laid.path:
        choices.append(Choice("", _("none: take the file off")))
    page.app.ask_question(
        ChoiceDialog(_("Lay a file on the map"), choices, page.laid.path), page.overlay_file
    )


def toggle_machine_or_log(page: MapScreen) -> None:
    """Switch between the machine and the replayed log."""
    page.toggle_log()
    # Both may lie in different fields, so the camera starts anew.
    page.camera, page.marked = None, False


def explain_no_plan(page: MapScreen) -> str:
    """Return why no plan can be shown."""
    # The plan belongs to the frame that the page shows, which may be of a log.
    picture = page.app.fields.find_picture(page.find_frame(page.app.clock())[0])
    return (
        _("this job has no map of planned rates")
        if picture is None or picture.planned is None
        else ""
    )


def clear_guide_line(page: MapScreen) -> None:
    """Remove the guidance line."""
    # The removal is recorded too, so that the next console does not restore the line.
    page.app.guide.clear_ends()
    page.app.keep_line_record(make_line_record(page.app.guide))


ACTIONS = set_page(
    MAP,
    # Boundary and A-B line need no lock: they are drawings and steer nothing.
    Action(
        "map_boundary",
        "b",
        "B",
        N_("boundary"),
        N_(
            "Begins at the field's edge, ends after driving round it: the job's field from then on."
        ),
        lambda page: page.press_boundary_key(),
        bar=8,
    ),
    Action(
        "map_guide",
        "n",
        "N",
        N_("A-B line"),
        N_(
            "Sets A, then B: the Run page shows how far the machine is off the line. It "
            "does not steer."
        ),
        lambda page: page.press_guide_key(),
        bar=8,
    ),
    Action(
        # Both keys delete on the keyboards of different systems.
        "map_no_guide",
        "delete,backspace",
        "Del",
        N_("no line"),
        N_("Takes the A-B line away."),
        clear_guide_line,
        why=lambda page: "" if page.app.guide.a is not None else _("there is no A-B line"),
    ),
    Action(
        "map_layer",
        "v",
        "V",
        N_("colours"),
        N_("Applied, target, error, NDVI or passes; also a click on its word."),
        show_next_layer,
        bar=3,
    ),
    Action(
        # Terminals send different keys for plus: with Shift, without Shift, and from the keypad.
        "map_in",
        "plus,equals_sign,kp_plus",
        "+",
        N_("nearer"),
        N_("Nearer; also by the wheel."),
        lambda page: page.zoom_map(1),
        bar=4,
    ),
    Action(
        "map_out",
        "minus,kp_minus",
        "-",
        N_("farther"),
        N_("Farther away; also by the wheel."),
        lambda page: page.zoom_map(-1),
        bar=5,
    ),
    Action(
        "map_follow",
        "y",
        "Y",
        N_("follow"),
        N_("Follows the machine, or stops following."),
        lambda page: page.toggle_follow(),
        bar=6,
    ),
    Action(
        "map_whole",
        "z",
        "Z",
        N_("whole field"),
        N_("The whole field and all the work on it."),
        show_whole_field,
        bar=7,
    ),
    Action(
        "map_plan",
        "p",
        "P",
        N_("plan"),
        N_("Shows or hides the planned rates of ground not yet worked."),
        toggle_plan,
        bar=8,
        why=explain_no_plan,
    ),
    Action(
        "map_file",
        "j",
        "J",
        N_("file"),
        N_("Lays a file on the map, as applied or harvested, or takes it off."),
        ask_overlay_file,
        bar=8,
    ),
    # Arrow keys move the picture in whole steps; dragging moves it freely.
    Action(
        # Each arrow key moves the view, so the ground moves in the opposite direction.
        "map_west",
        "left",
        "<",
        N_("west"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan_map(-1, 0),
    ),
    Action(
        "map_east",
        "right",
        ">",
        N_("east"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan_map(1, 0),
    ),
    Action(
        "map_north",
        "up",
        "up",
        N_("north"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan_map(0, 1),
    ),
    Action(
        "map_south",
        "down",
        "down",
        N_("south"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan_map(0, -1),
    ),
    Action(
        # The replayed log is drawn by the same page, so both can be compared.
        "map_log",
        "q_1",
        "Q1",
        N_("machine / log"),
        N_("The machine at work, or the log of the replay."),
        toggle_machine_or_log,
        why=lambda page: page.explain_no_turn(),
    ),
)
