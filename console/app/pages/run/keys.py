"""Keys of the Run page and what they do: orders to the machine; what changes the dose asks
first."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from topdress.console.app import words
from topdress.console.app.action import RUN, Action, on
from topdress.console.app.dialogs import Choice, ChoiceDialog, NudgeDialog
from topdress.console.app.dose_change import dose_change, find_source_rate
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.run.section_bar import section_choices
from topdress.console.app.reasons import why_no_start, why_not_ready
from topdress.console.app.typed_number import in_words, inside
from topdress.console.app.undo import ordered_source
from topdress.console.frame import Frame
from topdress.console.locale import N_, _
from topdress.control.orders import MAP_SOURCES, STRATEGIES, Do, Order, Strategy, TargetSource
from topdress.control.safety import Allowances

# What the operator may allow, with what is allowed now: each line of the dialog turns one into
# its opposite.
SECTIONS = "sections"  # not an order: asks which section


class Allowance(NamedTuple):
    """One thing that may be allowed, in words; whether it is now; the order that turns it into
    its opposite."""

    words: str
    allowed: bool
    do: Do
    to: bool


def allowances(frame: Frame | None) -> dict[str, Allowance]:
    """By the name of the order. A second dose is allowed by switching off the guard against it."""
    allow, no_double = (frame.allow, frame.no_double) if frame is not None else (Allowances(), True)
    found = (
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
        do.value: Allowance(what, allowed, do, allowed if do is Do.NO_DOUBLE else not allowed)
        for do, what, allowed in found
    }


def allow_choices(frame: Frame | None) -> tuple[Choice, ...]:
    """A line for each; the value is its name in `allowances`, or `SECTIONS_FILE`."""
    sections = (
        (Choice(SECTIONS, _("sections by hand: close or give back ...")),)
        if frame and frame.sections
        else ()
    )
    return (
        *(Choice(name, _line(one.words, one.allowed)) for name, one in allowances(frame).items()),
        *sections,
    )


def _line(what: str, allowed: bool) -> str:
    said = _("forbid again (now allowed): {what}") if allowed else _("allow: {what}")
    return said.format(what=what)


FAR_CELLS = 10  # of the trend, by which its cursor goes far
# slower, or standing: the figures are for 4.5 km/h, the papers' speed
SLOWEST_WORK_MPS = 1.25

if TYPE_CHECKING:
    from topdress.console.app.pages.run.page import RunScreen


def start(page: RunScreen) -> None:
    """A press is START; the repeats of a key that stays down say that it is held."""
    now_s = page.app.clock()
    page.start_key.key(now_s)
    page.app.give(Do.START, True if page.start_key.down(now_s) else None)


def _ask_nudge(page: RunScreen, first: int) -> None:
    frame = page.app.arrival.frame
    now = (frame.row.nudge_percent if frame else None) or 0.0

    page.app.ask(NudgeDialog(now, first), lambda percent: _give_new(page, Do.NUDGE, percent, now))


def _give_new(page: RunScreen, do: Do, value: str | float, now: str | float) -> None:
    """What holds already is no order."""
    if value != now:
        page.app.give(do, value)


def _reach_text(page: RunScreen, by: Strategy) -> str:
    """What a strategy comes to on the machine that runs, at the target and the speed of now, or
    at a usual one."""
    frame, machine, units = page.app.arrival.frame, page.app.machine, page.app.units
    if frame is None or machine is None:
        return ""
    from topdress.control.metering.strategies import describe_reach

    rate_kg_ha = frame.row.target_rate_kg_ha or frame.manual_rate_kg_ha or 0.0
    mps = max(frame.row.speed_used_mps or 0.0, SLOWEST_WORK_MPS)
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
            low=units.rate.text(of.low_kg_ha),
            high=units.rate.full(of.high_kg_ha),
            rate=units.rate.full(rate_kg_ha),
            speed=units.speed.full(mps),
            step=f"{of.step_percent:.1f}",
            lumps=f"{of.lumps_m:.2f} m",
            mm=f"{of.percent_mm:.1f}",
            rpm=f"{of.percent_rpm:.1f}",
        )
    )


def strategy(page: RunScreen) -> None:
    frame = page.app.arrival.frame
    choices = [Choice(one.value, words.strategy_word(one.value)) for one in STRATEGIES]
    units, row = page.app.units, frame.row if frame else None
    text = "\n".join(
        (
            _(
                "opening first: the gate makes the rate, the shaft keeps its speed while it "
                "can (now {shaft})"
            ).format(shaft=units.shaft.full(row.shaft_rpm_cmd if row else None))
            + _reach_text(page, Strategy.OPENING_FIRST),
            _(
                "speed first: the shaft makes the rate, the gate keeps its width while it "
                "can (now {opening})"
            ).format(opening=units.opening.full(row.opening_mm_cmd if row else None))
            + _reach_text(page, Strategy.SPEED_FIRST),
        )
    )
    _ask_choice(
        page,
        ChoiceDialog(_("Strategy"), choices, (row.strategy if row else None) or "", text),
        Do.STRATEGY,
    )


def source(page: RunScreen) -> None:
    frame = page.app.arrival.frame
    picture = page.app.fields.of(frame)
    has = frame.sources if frame is not None else ()
    no_map = (
        ""
        if picture is None or picture.planned is not None
        else _("this job has no map; F10, P takes one")
    )
    lacks = {one: no_map for one in MAP_SOURCES}
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
        Choice(one.value, _source_line(page, one), lacks.get(one, ""))
        for one in TargetSource
        if one not in (TargetSource.NONE, TargetSource.INDEX_MAP)
    ]
    _ask_choice(page, ChoiceDialog(_("Target from"), choices, ordered_source(frame)), Do.SOURCE)


def _source_line(page: RunScreen, source: TargetSource) -> str:
    """Its word, and the rate that it gives here, where that is known."""
    frame, word = page.app.arrival.frame, words.name_source(source.value)
    rate = None if frame is None else find_source_rate(frame, source.value)
    return word if rate is None else f"{word}  {page.app.units.rate.full(rate)}"


def _ask_choice(page: RunScreen, dialog: ChoiceDialog, do: Do) -> None:
    page.app.ask(dialog, lambda value: _give_new(page, do, value, dialog.now))


def manual_rate(page: RunScreen) -> None:
    unit = page.app.units.rate
    low, high = inside(unit, *page.app.limits_kg_ha, 0)

    def give(rate_kg_ha: float) -> None:
        page.app.give(Do.MANUAL_RATE, rate_kg_ha)
        if ordered_source(page.app.arrival.frame) != TargetSource.MANUAL:
            _ask_to_use(page, rate_kg_ha, Order(Do.SOURCE, TargetSource.MANUAL.value))

    page.app.ask(NumberDialog(_("Manual rate"), unit.name, low, high, to_si=unit.to_si), give)


def preset(number: int) -> Callable[[RunScreen], None]:
    """One of the settings' rates, everywhere; asked once."""

    def take(page: RunScreen) -> None:
        app, rate_kg_ha = page.app, page.app.presets_kg_ha[number]
        unit, (low, high) = app.units.rate, app.limits_kg_ha
        if not low <= rate_kg_ha <= high:
            app.notice(
                _("preset {rate}: allowed is {low} to {high} (F11 changes both)").format(
                    rate=unit.full(rate_kg_ha), low=unit.full(low), high=unit.full(high)
                )
            )
            return

        _ask_to_use(
            page,
            rate_kg_ha,
            Order(Do.MANUAL_RATE, rate_kg_ha),
            Order(Do.SOURCE, TargetSource.MANUAL.value),
        )

    return take


def _ask_to_use(page: RunScreen, rate_kg_ha: float, *orders: Order) -> None:
    app = page.app
    change = dose_change(
        app.arrival.frame,
        (
            Order(Do.MANUAL_RATE, rate_kg_ha),
            Order(Do.SOURCE, TargetSource.MANUAL.value),
        ),
    )
    place = _("It takes the place of canopy or map, everywhere.")
    app.confirm(
        _("Use the manual rate of {rate} now?").format(rate=in_words(app.units.rate, rate_kg_ha)),
        place if change is None else f"{change.text(app.units)}\n{place}",
        lambda: app.give_all(*orders, dose_is_asked=True),
    )


def look_ahead(page: RunScreen) -> None:
    frame = page.app.arrival.frame
    on = frame.look_ahead if frame else True
    title = _("Switch the look-ahead off?") if on else _("Switch the look-ahead on?")
    lag_m = frame.row.lag_m if frame else None
    page.app.confirm(
        title,
        _(
            "Granules take their time to the ground. With it a change of the rate is ordered {lag} "
            "earlier and lands in its place; without it, it lands {lag} late."
        ).format(lag=page.app.units.fine_distance.full(lag_m)),
        lambda: page.app.give(Do.LOOK_AHEAD, not on),
    )


def flow_trim(page: RunScreen) -> None:
    frame = page.app.arrival.frame
    on = frame.flow_trim_on if frame else True
    title = (
        _("Stop correcting the flow by the hopper scale?")
        if on
        else _("Correct the flow by the hopper scale?")
    )
    trim = frame.row.flow_trim if frame else None
    page.app.confirm(
        title,
        _(
            "By what the scale loses, {percent} % more flows now than the machine file "
            "says. On, the "
            "gate is set by that; off, by the machine file alone."
        ).format(percent="--" if trim is None else f"{100.0 * (trim - 1.0):+.1f}"),
        lambda: page.app.give(Do.FLOW_TRIM, not on),
    )


def allow(page: RunScreen) -> None:
    def turn(value: str) -> None:
        if value == SECTIONS:
            page.app.ask(
                ChoiceDialog(
                    _("Sections"),
                    section_choices(page.app.arrival.frame),
                    "",
                    _("A section closed by hand stays closed until it is given back."),
                ),
                lambda value: page.app.give(Do.SECTION, value),
            )
        else:
            page.app.give(offered[value].do, offered[value].to)

    frame = page.app.arrival.frame
    offered = allowances(frame)
    page.app.ask(
        ChoiceDialog(
            _("Allow"),
            allow_choices(frame),
            "",
            _("STOP forbids all of them again, except a second dose on done ground."),
        ),
        turn,
    )


def dose_error(page: RunScreen) -> None:
    """Of the newest dose that has landed, as somebody measured it behind the machine."""
    from topdress.control.targets.point_source import MAX_DOSE_ERROR_M

    def ask(side: str) -> None:
        unit, sign = page.app.units.fine_distance, 1.0 if side == "late" else -1.0
        page.app.ask(
            NumberDialog(
                _("How far from its plant?"),
                unit.name,
                0.0,
                MAX_DOSE_ERROR_M * unit.per_si,
                to_si=unit.to_si,
            ),
            lambda error_m: page.app.give(Do.DOSE_ERROR, sign * error_m),
        )

    page.app.ask(
        ChoiceDialog(
            _("The newest dose lies"),
            [
                Choice("late", _("late: beyond its plant")),
                Choice("early", _("early: before its plant")),
            ],
            "",
            _("Later doses are ordered by what is measured: sooner where they fell late."),
        ),
        ask,
    )


def _why_no_dose(page: RunScreen) -> str:
    frame = page.app.arrival.frame
    return (
        ""
        if frame is not None and TargetSource.POINT in frame.sources
        else _("this job has no plants")
    )


ACTIONS = on(
    RUN,
    Action(
        "start",
        "s",
        "S",
        N_("start"),
        N_("Ready or held: begin to work."),
        start,
        bar=3,
        why=lambda page: why_no_start(page.app),
        judged=True,
        needs_machine=True,
    ),
    Action(
        "ready",
        "r",
        "R",
        N_("ready"),
        N_("Off, held or fault: make the machine ready."),
        lambda page: page.app.give(Do.READY),
        bar=4,
        why=lambda page: why_not_ready(page.app),
        judged=True,
        needs_machine=True,
    ),
    Action(
        "nudge_up",
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
        strategy,
        bar=7,
        needs_machine=True,
    ),
    Action(
        "source",
        "o",
        "O",
        N_("target from"),
        N_("Canopy, map, plants, manual or fallback rate; asks first."),
        source,
        bar=8,
        needs_machine=True,
    ),
    Action(
        "manual_rate",
        "m",
        "M",
        N_("manual rate"),
        N_("Type a rate; the allowed range is shown."),
        manual_rate,
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
        preset(0),
        bar=9,
        needs_machine=True,
    ),
    Action(
        "preset_2",
        "full_stop",
        ".",
        N_("preset 2"),
        N_("The second preset rate of the settings; asks first."),
        preset(1),
        bar=9,
        needs_machine=True,
    ),
    Action(
        "preset_3",
        "slash",
        "/",
        N_("preset 3"),
        N_("The third preset rate of the settings; asks first."),
        preset(2),
        bar=9,
        needs_machine=True,
    ),
    Action(
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
    Action(
        "mark",
        "k",
        "K",
        N_("mark"),
        N_("A mark in the log's events at this moment."),
        lambda page: page.app.give(Do.MARK, "mark"),
        needs_machine=True,
    ),
    Action(
        "dose_error",
        "semicolon",
        ";",
        N_("dose error"),
        N_("Point mode: how far the newest dose lies from its plant."),
        dose_error,
        why=_why_no_dose,
        asks="number",
        needs_machine=True,
    ),
    Action(
        "look_ahead",
        "l",
        "L",
        N_("look-ahead"),
        N_("Switches the lag correction; asks first."),
        look_ahead,
        needs_machine=True,
    ),
    Action(
        "flow_trim",
        "w",
        "W",
        N_("scale trim"),
        N_("Lets the hopper scale correct the flow model; asks first."),
        flow_trim,
        needs_machine=True,
    ),
    Action(
        "allow",
        "h",
        "H",
        N_("allow"),
        N_("Reversing, outside the field, without a log; asks first."),
        allow,
        bar=9,
        needs_machine=True,
    ),
    Action(
        "trend_left",
        "left",
        "<",
        N_("cursor back"),
        N_("Reads the trend at a time; also a click in it."),
        lambda page: page.move_cursor(-1),
        why=lambda page: page.why_no_cursor(),
    ),
    Action(
        "trend_right",
        "right",
        ">",
        N_("cursor on"),
        N_("Reads the trend at a time; also a click in it."),
        lambda page: page.move_cursor(1),
        why=lambda page: page.why_no_cursor(),
    ),
    Action(
        "trend_far_left",
        "shift+left",
        "S-<",
        N_("cursor far back"),
        N_("Ten steps at once."),
        lambda page: page.move_cursor(-FAR_CELLS),
        why=lambda page: page.why_no_cursor(),
    ),
    Action(
        "trend_far_right",
        "shift+right",
        "S->",
        N_("cursor far on"),
        N_("Ten steps at once."),
        lambda page: page.move_cursor(FAR_CELLS),
        why=lambda page: page.why_no_cursor(),
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
        "connect",
        "c",
        "C",
        N_("connect"),
        N_("No connection to the machine: start it again, or join one that runs."),
        lambda page: page.app.ask_connection(),
        locked=True,
    ),
)
