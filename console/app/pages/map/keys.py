"""Keys of the Map page and what they do."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from topdress.console.app import layers
from topdress.console.app.action import MAP, Action, on
from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.guide_line_store import make_line_record
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.map.page import MapScreen
    from topdress.console.app.pages.replay.service import LogFile


def next_layer(page: MapScreen) -> None:
    page.shown_layer = layers.after(page.shown_layer)


def whole_field(page: MapScreen) -> None:
    page.camera, page.marked = None, False


def plan(page: MapScreen) -> None:
    page.plan = not page.plan


def lay_file(page: MapScreen) -> None:
    """Chosen from the newest; where one is laid, its place in the list takes it off."""
    services, frame = page.app.services.layers, page.app.arrival.frame
    running = frame.log_path if frame is not None else ""
    if services is None:
        _choose_laid(page, ())
    else:
        page.app.list_files(
            partial(services.list_layer_files, running), partial(_choose_laid, page)
        )


def _choose_laid(page: MapScreen, listed: tuple[LogFile, ...]) -> None:
    if not listed and not page.laid.path:
        page.app.notice(_("there is no file yet that could be laid on the map"))
        return
    choices = [Choice(one.path, f"{one.name}  {one.changed}  {one.size}") for one in listed]
    if page.laid.path:
        choices.append(Choice("", _("none: take the file off")))
    page.app.ask(ChoiceDialog(_("Lay a file on the map"), choices, page.laid.path), page.lay)


def machine_or_log(page: MapScreen) -> None:
    page.turn_log()
    page.camera, page.marked = None, False


def why_no_plan(page: MapScreen) -> str:
    picture = page.app.fields.of(page.seen(page.app.clock())[0])
    return (
        _("this job has no map of planned rates")
        if picture is None or picture.planned is None
        else ""
    )


def no_guide(page: MapScreen) -> None:
    page.app.guide.clear()
    page.app.keep_line(make_line_record(page.app.guide))


ACTIONS = on(
    MAP,
    Action(
        "map_boundary",
        "b",
        "B",
        N_("boundary"),
        N_(
            "Begins at the field's edge, ends after driving round it: the job's field from then on."
        ),
        lambda page: page.boundary_key(),
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
        lambda page: page.guide_key(),
        bar=8,
    ),
    Action(
        "map_no_guide",
        "delete,backspace",
        "Del",
        N_("no line"),
        N_("Takes the A-B line away."),
        no_guide,
        why=lambda page: "" if page.app.guide.a is not None else _("there is no A-B line"),
    ),
    Action(
        "map_layer",
        "v",
        "V",
        N_("colours"),
        N_("Applied, target, error, NDVI or passes; also a click on its word."),
        next_layer,
        bar=3,
    ),
    Action(
        "map_in",
        "plus,equals_sign,kp_plus",
        "+",
        N_("nearer"),
        N_("Nearer; also by the wheel."),
        lambda page: page.zoom(1),
        bar=4,
    ),
    Action(
        "map_out",
        "minus,kp_minus",
        "-",
        N_("farther"),
        N_("Farther away; also by the wheel."),
        lambda page: page.zoom(-1),
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
        whole_field,
        bar=7,
    ),
    Action(
        "map_plan",
        "p",
        "P",
        N_("plan"),
        N_("Shows or hides the planned rates of ground not yet worked."),
        plan,
        bar=8,
        why=why_no_plan,
    ),
    Action(
        "map_file",
        "j",
        "J",
        N_("file"),
        N_("Lays a file on the map, as applied or harvested, or takes it off."),
        lay_file,
        bar=8,
    ),
    Action(
        "map_west",
        "left",
        "<",
        N_("west"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan(-1, 0),
    ),
    Action(
        "map_east",
        "right",
        ">",
        N_("east"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan(1, 0),
    ),
    Action(
        "map_north",
        "up",
        "up",
        N_("north"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan(0, 1),
    ),
    Action(
        "map_south",
        "down",
        "down",
        N_("south"),
        N_("Moves the map; also by dragging it."),
        lambda page: page.pan(0, -1),
    ),
    Action(
        "map_log",
        "q_1",
        "Q1",
        N_("machine / log"),
        N_("The machine at work, or the log of the replay."),
        machine_or_log,
        why=lambda page: page.why_no_turn(),
    ),
)
