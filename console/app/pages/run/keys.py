"""Defines the keys of the Run page, which send orders to the machine; changes of the dose are asked
first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from topdress.console.app import frame_words
from topdress.console.app.action import RUN, Action, set_page
from topdress.console.app.dialogs import Choice, ChoiceDialog, NudgeDialog
from topdress.console.app.dose_change_check import find_source_rate, predict_dose_change
from topdress.console.app.impossible_reasons import explain_no_start, explain_not_ready
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.run.section_bar import list_section_choices
from topdress.console.app.typed_number import format_with_unit, round_inwards
from topdress.console.app.undo_stack import find_ordered_source
from topdress.console.frame import Frame
from topdress.console.locale import N_, _
from topdress.control.orders import MAP_SOURCES, STRATEGIES, Do, Order, Strategy, TargetSource
from topdress.control.safety import Allowances

# Each entry of the dialog reverses one allowance.
# Value of an entry that is no order: it asks for a section.
SECTIONS_CHOICE = "sections"


class Allowance(NamedTuple):
    """Describes an allowance in words, whether it is given, and the order that reverses it."""

    words: str
    allowed: bool
    do: Do
    to: bool


def list_allowances(frame: Frame | None) -> dict[str, Allowance]:
    """Return the allowances by the name of their order. A second dose is allowed by switching off
    the guard against it."""
    # Before the first frame nothing is allowed, and the guard is on.
    allow, no_double = (frame.allow, frame.no_double) if frame is not None else (Allowances(), True)
    found = (
        # The order is that of the dialog.
        (Do.ALLOW_REVERSE, _("flow while reversing"), allow.reverse),
        (Do.ALLOW_OUTSIDE, _("flow outside the field"), allow.outside),
        (Do.GO_ON_UNLOGGED, _("work without a log"), allow.unlogged),
        (Do.NO_DOUBLE, _("a second dose on done ground"), not no_double),
        (
            Do.ALLOW_MAP_ELSEWHERE,
            _("spreading by a map that lies somewhere else"),
            allow.map_elsewhere,
        ),
        (Do.ALLOW_NO_WHEEL, _("work by GNSS alone where the wheel sensor is dead"), allow.no_wheel),
    )
    return {
        # The guard is an order of its own sense: True forbids, so its value is not negated.
        do.value: Allowance(what, allowed, do, allowed if do is Do.NO_DOUBLE else not allowed)
        for do, what, allowed in found
    }


def list_allow_choices(frame: Frame | None) -> tuple[Choice, ...]:
    """Return an entry per allowance; its value is the name in `list_allowances`, or
    `SECTIONS_CHOICE`."""
    # A machine without section valves has no such entry.
    sections = (
        (Choice(SECTIONS_CHOICE, _("sections by hand: close or give back ...")),)
        if frame and frame.sections
        else ()
    )
    return (
        *(
            Choice(name, _format_allowance(one.words, one.allowed))
            for name, one in list_allowances(frame).items()
        ),
        *sections,
    )


def _format_allowance(what: str, allowed: bool) -> str:
    """Return the text of an entry that allows or forbids."""
    said = _("forbid again (now allowed): {what}") if allowed else _("allow: {what}")
    return said.format(what=what)


# Cells of the trend by which its cursor moves with Shift.
CURSOR_FAR_STEP_CELLS = 10
# Below this speed, m/s, figures are calculated for 4.5 km/h, the speed of the papers.
MIN_WORKING_SPEED_MPS = 1.25

if TYPE_CHECKING:
    from topdress.console.app.pages.run.page import RunScreen


def give_start_order(page: RunScreen) -> None:
    """Give START. Repeats of the key tell the worker that it is held, which permits flow before the
    machine moves."""
    # Times of key presses decide whether the key is held.
    now_s = page.app.clock()
    page.start_key.note_key(now_s)
    page.app.give_order(Do.START, True if page.start_key.is_down(now_s) else None)


def _ask_nudge(page: RunScreen, first: int) -> None:
    """Ask for a nudge; `first` is the first step of the key."""
    frame = page.app.arrival.frame
    # A nudge that no frame reports is zero.
    now = (frame.row.nudge_percent if frame else None) or 0.0

    page.app.ask_question(
        NudgeDialog(now, first), lambda percent: _give_changed_order(page, Do.NUDGE, percent, now)
    )


def _give_changed_order(page: RunScreen, do: Do, value: str | float, now: str | float) -> None:
    """Give an order unless its value is already in force."""
    if value != now:
        page.app.give_order(do, value)


def _describe_reach(page: RunScreen, by: Strategy) -> str:
    """Describe the range of a strategy on the running machine, at the present target and speed, or
    at usual values."""
    frame, machine, units = page.app.arrival.frame, page.app.machine, page.app.units
    if frame is None or machine is None:
        return ""
    # Imported on use, because the metering model is large and rarely asked.
    from topdress.control.metering.strategies import describe_reach

    # Figures for a rate of zero would be meaningless, so the manual rate replaces it.
    rate_kg_ha = frame.row.target_rate_kg_ha or frame.manual_rate_kg_ha or 0.0
    mps = max(frame.row.speed_used_mps or 0.0, MIN_WORKING_SPEED_MPS)
    of = describe_reach(machine, by, rate_kg_ha, mps)
    return (
        ""
        if of is None
        else "\n   "
        + _(
            "{low} to {high}; at {rate} and {speed}: steps of {step} %, lumps along a row "
            "{lumps} apart, 1 mm of the gate "
            "is {mm} %, 1 r/min {rpm} %"
        ).format(
            low=units.rate.format_value(of.low_kg_ha),
            high=units.rate.format_with_name(of.high_kg_ha),
            rate=units.rate.format_with_name(rate_kg_ha),
            speed=units.speed.format_with_name(mps),
            step=f"{of.step_percent:.1f}",
            lumps=f"{of.lumps_m:.2f} m",
            mm=f"{of.percent_mm:.1f}",
            rpm=f"{of.percent_rpm:.1f}",
        )
    )


def ask_strategy(page: RunScreen) -> None:
    """Ask for the strategy."""
    frame = page.app.arrival.frame
    choices = [Choice(one.value, frame_words.name_strategy(one.value)) for one in STRATEGIES]
    # The present set-points tell which drive each strategy would keep.
    units, row = page.app.units, frame.row if frame else None
    text = "\n".join(
        (
            _(
                "opening first: the gate makes the rate, the shaft keeps its speed while it "
                "can (now {shaft})"
            ).format(shaft=units.shaft.format_with_name(row.shaft_rpm_cmd if row else None))
            + _describe_reach(page, Strategy.OPENING_FIRST),
            _(
                "speed first: the shaft makes the rate, the gate keeps its width while it "
                "can (now {opening})"
            ).format(opening=units.opening.format_with_name(row.opening_mm_cmd if row else None))
            + _describe_reach(page, Strategy.SPEED_FIRST),
        )
    )
    _ask_choice(
        page,
        ChoiceDialog(_("Strategy"), choices, (row.strategy if row else None) or "", text),
        Do.STRATEGY,
    )


def ask_target_source(page: RunScreen) -> None:
    """Ask for the source of the target."""
    frame = page.app.arrival.frame
    # An older worker does not report its sources, so the field's picture decides about the map.
    picture = page.app.fields.find_picture(frame)
    has = frame.sources if frame is not None else ()
    no_map = (
        ""
        if picture is None or picture.planned is not None
        else _("this job has no map; F10, P takes one")
    )
    lacks = {one: no_map for one in MAP_SOURCES}
    # A worker that reports its sources knows better than this console's files.
    if has:
        lacks = {
            one: _("this job has no map; F10, P takes one") for one in MAP_SOURCES if one not in has
        }
        lacks |= (
            {} if TargetSource.POINT in has else {TargetSource.POINT: _("this job has no plants")}
        )
        lacks |= (
            {}
            if TargetSource.EXTERNAL in has
            else {TargetSource.EXTERNAL: _("this job has no other display")}
        )
    choices = [
        Choice(one.value, _format_source(page, one), lacks.get(one, ""))
        for one in TargetSource
        # No target and the map of another program are no choices of an operator.
        if one not in (TargetSource.NONE, TargetSource.INDEX_MAP)
    ]
    _ask_choice(
        page, ChoiceDialog(_("Target from"), choices, find_ordered_source(frame)), Do.SOURCE
    )


def _format_source(page: RunScreen, source: TargetSource) -> str:
    """Return the word of a source and its rate at this position, where known."""
    frame, word = page.app.arrival.frame, frame_words.name_source(source.value)
    rate = None if frame is None else find_source_rate(frame, source.value)
    return word if rate is None else f"{word}  {page.app.units.rate.format_with_name(rate)}"


def _ask_choice(page: RunScreen, dialog: ChoiceDialog, do: Do) -> None:
    """Show a list, and give the order of the chosen entry."""
    page.app.ask_question(dialog, lambda value: _give_changed_order(page, do, value, dialog.now))


def ask_manual_rate(page: RunScreen) -> None:
    """Ask for the manual rate."""
    unit = page.app.units.rate
    # The limits of the settings lie within those of the crop.
    low, high = round_inwards(unit, *page.app.limits_kg_ha, 0)

    def give_rate(rate_kg_ha: float) -> None:
        # The rate alone changes nothing while another source is in force, so its use is asked next.
        page.app.give_order(Do.MANUAL_RATE, rate_kg_ha)
        if find_ordered_source(page.app.arrival.frame) != TargetSource.MANUAL:
            _ask_to_use_rate(page, rate_kg_ha, Order(Do.SOURCE, TargetSource.MANUAL.value))

    page.app.ask_question(
        NumberDialog(_("Manual rate"), unit.name, low, high, to_si=unit.convert_to_si), give_rate
    )


def make_preset_action(number: int) -> Callable[[RunScreen], None]:
    """Return an action that uses a preset rate everywhere, after one question."""

    def give_preset(page: RunScreen) -> None:
        # The preset is read when the key is pressed, because the settings may have changed.
        app, rate_kg_ha = page.app, page.app.presets_kg_ha[number]
        unit, (low, high) = app.units.rate, app.limits_kg_ha
        # The limits may have changed since the preset was entered.
        if not low <= rate_kg_ha <= high:
            app.show_notice(
                _("preset {rate}: allowed is {low} to {high} (F11 changes both)").format(
                    rate=unit.format_with_name(rate_kg_ha),
                    low=unit.format_with_name(low),
                    high=unit.format_with_name(high),
                )
            )
            return

        _ask_to_use_rate(
            page,
            rate_kg_ha,
            Order(Do.MANUAL_RATE, rate_kg_ha),
            Order(Do.SOURCE, TargetSource.MANUAL.value),
        )

    return give_preset


def _ask_to_use_rate(page: RunScreen, rate_kg_ha: float, *orders: Order) -> None:
    """Ask whether to use the manual rate now, with the change of dose."""
    app = page.app
    change = predict_dose_change(
        app.arrival.frame,
        (
            Order(Do.MANUAL_RATE, rate_kg_ha),
            Order(Do.SOURCE, TargetSource.MANUAL.value),
        ),
    )
    # The operator must know that the canopy no longer controls the rate.
    place = _("It takes the place of canopy or map, everywhere.")
    app.ask_yes_no(
        _("Use the manual rate of {rate} now?").format(
            rate=format_with_unit(app.units.rate, rate_kg_ha)
        ),
        place if change is None else f"{change.format_change(app.units)}\n{place}",
        # This question already shows the change of dose, so a second question would be redundant.
        lambda: app.give_orders(*orders, dose_is_asked=True),
    )


def toggle_look_ahead(page: RunScreen) -> None:
    """Switch the look-ahead, after a question."""
    frame = page.app.arrival.frame
    # Without a frame the usual state is assumed.
    on = frame.look_ahead if frame else True
    title = _("Switch the look-ahead off?") if on else _("Switch the look-ahead on?")
    # The distance shows what the look-ahead compensates at the present speed.
    lag_m = frame.row.lag_m if frame else None
    page.app.ask_yes_no(
        title,
        _(
            "Granules take their time to the ground. With it a change of the rate is ordered {lag} "
            "earlier and lands in its place; without it, it lands {lag} late."
        ).format(lag=page.app.units.fine_distance.format_with_name(lag_m)),
        lambda: page.app.give_order(Do.LOOK_AHEAD, not on),
    )


def toggle_flow_trim(page: RunScreen) -> None:
    """Switch the correction of flow by the scale, after a question."""
    frame = page.app.arrival.frame
    on = frame.flow_trim_on if frame else True
    title = (
        _("Stop correcting the flow by the hopper scale?")
        if on
        else _("Correct the flow by the hopper scale?")
    )
    # The present correction shows what would change.
    trim = frame.row.flow_trim if frame else None
    page.app.ask_yes_no(
        title,
        _(
            "By what the scale loses, {percent} % more flows now than the machine file "
            "says. On, the "
            "gate is set by that; off, by the machine file alone."
        ).format(percent="--" if trim is None else f"{100.0 * (trim - 1.0):+.1f}"),
        lambda: page.app.give_order(Do.FLOW_TRIM, not on),
    )


def ask_allowance(page: RunScreen) -> None:
    """Ask which allowance to reverse."""

    def turn_allowance(value: str) -> None:
        if value == SECTIONS_CHOICE:
            page.app.ask_question(
                ChoiceDialog(
                    _("Sections"),
                    list_section_choices(page.app.arrival.frame),
                    "",
                    _("A section closed by hand stays closed until it is given back."),
                ),
                lambda value: page.app.give_order(Do.SECTION, value),
            )
        else:
            page.app.give_order(offered[value].do, offered[value].to)

    frame = page.app.arrival.frame
    # The choices are fixed when the dialog opens: a frame in between must not change their meaning.
    offered = list_allowances(frame)
    page.app.ask_question(
        ChoiceDialog(
            _("Allow"),
            list_allow_choices(frame),
            "",
            _("STOP forbids all of them again, except a second dose on done ground."),
        ),
        turn_allowance,
    )


def ask_dose_error(page: RunScreen) -> None:
    """Ask for the error of the newest dose, as somebody measured it behind the machine."""
    # The limit is imported on use, because few jobs have single doses.
    from topdress.control.targets.plant_doser import OTHER_PLANT_DISTANCE_M

    def ask_distance(side: str) -> None:
        # Late is positive, as in the order.
        unit, sign = page.app.units.fine_distance, 1.0 if side == "late" else -1.0
        page.app.ask_question(
            NumberDialog(
                _("How far from its plant?"),
                unit.name,
                0.0,
                OTHER_PLANT_DISTANCE_M * unit.per_si,
                to_si=unit.convert_to_si,
            ),
            lambda error_m: page.app.give_order(Do.DOSE_ERROR, sign * error_m),
        )

    page.app.ask_question(
        ChoiceDialog(
            _("The newest dose lies"),
            [
                Choice("late", _("late: beyond its plant")),
                Choice("early", _("early: before its plant")),
            ],
            "",
            _("Later doses are ordered by what is measured: sooner where they fell late."),
        ),
        ask_distance,
    )


def _explain_no_dose(page: RunScreen) -> str:
    """Return why no dose error can be entered."""
    frame = page.app.arrival.frame
    return (
        ""
        if frame is not None and TargetSource.POINT in frame.sources
        else _("this job has no plants")
    )


ACTIONS = set_page(
    RUN,
    Action(
        "start",
        "s",
        "S",
        N_("start"),
        N_("Ready or held: begin to work."),
        give_start_order,
        bar=3,
        # `judged`: the worker decides, because a state may have changed since the newest frame.
        why=lambda page: explain_no_start(page.app),
        judged=True,
        needs_machine=True,
    ),
    Action(
        "ready",
        "r",
        "R",
        N_("ready"),
        N_("Off, held or fault: make the machine ready."),
        lambda page: page.app.give_order(Do.READY),
        bar=4,
        why=lambda page: explain_not_ready(page.app),
        judged=True,
        needs_machine=True,
    ),
    Action(
        # A nudge is asked even for one step, because it changes the dose of the whole field.
        "nudge_up",
        # Terminals send different keys for plus: with Shift, without Shift, and from the keypad.
        "plus,equals_sign,kp_plus",
        "+",
        N_("more"),
        N_("More than the target, in steps of 5 %; asks first."),
        lambda page: _ask_nudge(page, 1),
        bar=5,
        asks="number",
        needs_machine=True,
    ),
    Action(
        "nudge_down",
        "minus,kp_minus",
        "-",
        N_("less"),
        N_("Less than the target, in steps of 5 %; asks first."),
        lambda page: _ask_nudge(page, -1),
        bar=6,
        asks="number",
        needs_machine=True,
    ),
    Action(
        "strategy",
        "t",
        "T",
        N_("strategy"),
        N_("Opening first or speed first; asks first."),
        ask_strategy,
        bar=7,
        needs_machine=True,
    ),
    Action(
        "source",
        "o",
        "O",
        N_("target from"),
        N_("Canopy, map, plants, manual or fallback rate; asks first."),
        ask_target_source,
        bar=8,
        needs_machine=True,
    ),
    Action(
        "manual_rate",
        "m",
        "M",
        N_("manual rate"),
        N_("Type a rate; the allowed range is shown."),
        ask_manual_rate,
        bar=8,
        asks="number",
        needs_machine=True,
    ),
    Action(
        "preset_1",
        "comma",
        ",",
        N_("preset 1"),
        N_("The first preset rate of the settings; asks first."),
        make_preset_action(0),
        bar=9,
        needs_machine=True,
    ),
    Action(
        "preset_2",
        "full_stop",
        ".",
        N_("preset 2"),
        N_("The second preset rate of the settings; asks first."),
        make_preset_action(1),
        bar=9,
        needs_machine=True,
    ),
    Action(
        "preset_3",
        "slash",
        "/",
        N_("preset 3"),
        N_("The third preset rate of the settings; asks first."),
        make_preset_action(2),
        bar=9,
        needs_machine=True,
    ),
    Action(
        # The refill is a page of the job, but an operator needs its key at work.
        "refill",
        "f",
        "F",
        N_("refill"),
        N_("Type how much was filled in; the log keeps it."),
        lambda page: page.app.job_page.ask_refill(),
        bar=8,
        asks="number",
        needs_machine=True,
    ),
    # Marks let an operator find a position in the log later.
    Action(
        "mark",
        "k",
        "K",
        N_("mark"),
        N_("A mark in the log's events at this moment."),
        lambda page: page.app.give_order(Do.MARK, "mark"),
        needs_machine=True,
    ),
    Action(
        "dose_error",
        "semicolon",
        ";",
        N_("dose error"),
        N_("Point mode: how far the newest dose lies from its plant."),
        ask_dose_error,
        why=_explain_no_dose,
        asks="number",
        needs_machine=True,
    ),
    Action(
        # The switch serves comparisons in the field: with and without the correction.
        "look_ahead",
        "l",
        "L",
        N_("look-ahead"),
        N_("Switches the lag correction; asks first."),
        toggle_look_ahead,
        needs_machine=True,
    ),
    Action(
        "flow_trim",
        "w",
        "W",
        N_("scale trim"),
        N_("Lets the hopper scale correct the flow model; asks first."),
        toggle_flow_trim,
        needs_machine=True,
    ),
    Action(
        "allow",
        "h",
        "H",
        N_("allow"),
        N_("Reversing, outside the field, without a log; asks first."),
        ask_allowance,
        bar=9,
        needs_machine=True,
    ),
    # The cursor of the trend reads values and changes nothing, so these keys need no machine.
    Action(
        "trend_left",
        "left",
        "<",
        N_("cursor back"),
        N_("Reads the trend at a time; also a click in it."),
        lambda page: page.move_cursor(-1),
        why=lambda page: page.explain_no_cursor(),
    ),
    Action(
        "trend_right",
        "right",
        ">",
        N_("cursor on"),
        N_("Reads the trend at a time; also a click in it."),
        lambda page: page.move_cursor(1),
        why=lambda page: page.explain_no_cursor(),
    ),
    Action(
        "trend_far_left",
        "shift+left",
        "S-<",
        N_("cursor far back"),
        N_("Ten steps at once."),
        lambda page: page.move_cursor(-CURSOR_FAR_STEP_CELLS),
        why=lambda page: page.explain_no_cursor(),
    ),
    Action(
        "trend_far_right",
        "shift+right",
        "S->",
        N_("cursor far on"),
        N_("Ten steps at once."),
        lambda page: page.move_cursor(CURSOR_FAR_STEP_CELLS),
        why=lambda page: page.explain_no_cursor(),
    ),
    Action(
        "trend_cursor_off",
        "escape",
        "Esc",
        N_("cursor away"),
        N_("Ends reading the trend."),
        lambda page: page.drop_cursor(),
        why=lambda page: _("no cursor is set") if page.cursor_s is None else "",
    ),
    Action(
        # This key works while the keys are locked, because a lost machine must be found again.
        "connect",
        "c",
        "C",
        N_("connect"),
        N_("No connection to the machine: start it again, or join one that runs."),
        lambda page: page.app.ask_connection(),
        locked=True,
    ),
)
