"""The Run screen: the machine at work."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, NamedTuple

from rich.cells import cell_len
from textual.app import ComposeResult
from textual.content import Content
from topdress.console.app.action import RUN, Action, make_bindings
from topdress.console.app.guide_line import GuideLine
from topdress.console.app.held_key import HeldKey
from topdress.console.app.pages.panel_page import PanelScreen
from topdress.console.app.pages.run.keys import ACTIONS
from topdress.console.app.pages.run.section_bar import SectionBar
from topdress.console.app.units import Units
from topdress.console.app.view import (
    AlarmsView,
    RunView,
    ShownText,
    format_duration,
    format_local_time,
)
from topdress.console.app.widgets.panel import Panel, TextPart, choose_fullest, fit_width, make_line
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import State

if TYPE_CHECKING:
    from topdress.control.diagnosis.result import Departure


# One line on the Run page: how the machine departs from its model, since when, probably why.
#
# It is empty while the machine turns; at hold it also says what can be done about it.
class ModelCheck(Panel[tuple[str, ...]]):
    """Shows the line, in the fullest of its forms that fits; hidden by the page while it is
    empty."""

    def draw_rows(self, view: tuple[str, ...], width: int, height: int) -> list[Content]:
        text = next((text for text in view if cell_len(text) <= width), view[-1] if view else "")
        return [make_line((fit_width(text, width), "$warning" if text else ""))]


def list_model_check_texts(found: Departure, frame: Frame, utc_offset_s: float) -> tuple[str, ...]:
    """The texts, the fullest form first; none while the machine turns. utc_offset_s: local time
    minus UTC.

    At work the name counts for more than the time; at hold the remedy counts for more than both.
    """
    if is_turning(frame):
        return ()
    from topdress.console.reports.live_words import (
        describe_next_step,
        describe_offer,
        format_departure,
    )

    since = ""
    if found.since_s is not None:
        since = format_local_time(frame.row.utc, utc_offset_s, frame.row.time_s - found.since_s)[
            :5
        ] or format_duration(found.since_s)
    full, named, dated, plain = (
        format_departure(found, time, why)
        for time, why in ((since, True), ("", True), (since, False), ("", False))
    )
    if frame.row.state == State.HELD:
        pairs = [
            (full, describe_next_step(found)),
            (full, describe_offer(found)),
            (named, describe_offer(found)),
            (dated, describe_offer(found)),
            (plain, describe_offer(found)),
        ]
    else:
        pairs = [(said, "F9") for said in (full, named, dated, plain)]
    forms = [_("check: {said}; {todo}").format(said=said, todo=end) for said, end in pairs]
    return (*forms, _("check: {said}; {todo}").format(said=plain, todo="F9"))


def is_turning(frame: Frame) -> bool:
    """Whether the machine works and yet spreads nothing here: a headland, a turn."""
    row = frame.row
    return row.state == State.WORKING and (row.work_switch == 0 or not row.target_rate_kg_ha)


# One row on the Run page: how far the machine is off the A-B line, as lights to either side. It
# does not steer. of each light: a tenth of a metre, as the light bars of other makers are set
# at first
LIGHT_STEP_M = 0.1
LIGHTS_A_SIDE = 8  # to either side
LIT, DARK = "█", "·"


class LightView(NamedTuple):
    """Holds the lights. lights: to the left negative, to the right positive, 0: on the line. said:
    the distance from it in words."""

    lights: int
    said: ShownText
    track: str


def make_light_view(
    guide: GuideLine, frame: Frame | None, stale: bool, units: Units
) -> LightView | None:
    """The lights; None while there is no line, or no place."""
    if frame is None or frame.place_m is None:
        return None
    off = guide.find_offset(frame.place_m, frame.row.heading_deg)
    if off is None:
        return None
    near = units.fine_distance._replace(decimals=2 if units.id == "metric" else 1)
    lights = max(-LIGHTS_A_SIDE, min(LIGHTS_A_SIDE, round(off.right_m / LIGHT_STEP_M)))
    text = near.format_with_name(abs(off.right_m))
    said = (
        _("{distance} right of the line")
        if lights > 0
        else _("{distance} left of the line")
        if lights < 0
        else _("on the line, {distance}")
    ).format(distance=text)
    return LightView(
        lights,
        ShownText(said, stale),
        _("track {number}").format(number=f"{off.number:+d}" if off.number else "A-B"),
    )


class LightBar(Panel[LightView | None]):
    """Shows lights on the side where the machine is: steer away from them."""

    def draw_rows(self, view: LightView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        left = DARK * (LIGHTS_A_SIDE + min(0, view.lights)) + LIT * max(0, -view.lights)
        after = LIT * max(0, view.lights) + DARK * (LIGHTS_A_SIDE - max(0, view.lights))
        lit = "$stale" if view.said.stale else "$alarm-amber" if view.lights else "$target"
        middle: TextPart = (" ◆ " if not view.lights else " ┃ ", f"bold {lit}")
        bar = 2 * LIGHTS_A_SIDE + 3
        text = f" {view.said.text}"
        track = choose_fullest((f"{view.track} ", ""), width - bar - cell_len(text) - 2)
        gap = " " * max(0, width - bar - cell_len(text) - cell_len(track) - 1)
        return [
            make_line(
                " ",
                (left, f"bold {lit}"),
                middle,
                (after, f"bold {lit}"),
                (text, "$stale" if view.said.stale else "bold"),
                gap,
                (track, "$muted"),
            )
        ]


class RunScreen(PanelScreen):
    """Shows the machine at work."""

    where: ClassVar[str] = RUN
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        # held down it lets the flow begin with the creep: the launch
        self.start_key = HeldKey()

    def perform_action(self, action: Action) -> None:
        """Do an action: an order waits for nothing to be drawn."""
        action.do(self)

    def compose_extra(self) -> ComposeResult:
        yield ModelCheck((), id="model-check")
        yield SectionBar((), id="section-bar")
        yield LightBar(None, id="light-bar")

    def show_numbers(self, view: RunView) -> None:
        """Show model check, sections and lights too."""
        super().show_numbers(view)
        frame, checked = self.app.arrival.frame, self.app.services.model_check
        lights = self.query_one("#light-bar", LightBar)
        light = make_light_view(self.app.guide, frame, view.status.silent != "", self.app.units)
        lights.display = light is not None
        lights.show_view(light)
        found = None if frame is None or checked is None else checked(frame.log_path)
        sections = self.query_one("#section-bar", SectionBar)
        sections.display = frame is not None and bool(frame.sections)
        sections.show_view(() if frame is None else frame.sections)
        bar = self.query_one("#model-check", ModelCheck)
        low = self.has_class("-low")
        # where rows are few alarms and the line come first
        bar.display = found is not None and not (low and (view.alarms.lines or lights.display))
        self.set_class(bar.display or lights.display, "-checked")
        if found is not None and frame is not None:
            bar.show_view(list_model_check_texts(found, frame, self.app.utc_offset_s))

    def make_view(self, frame: Frame | None, age_s: float) -> RunView:
        view = super().make_view(frame, age_s)
        if frame is None or view.alarms.lines or view.alarms.urgent:
            return view
        about = tuple(
            part for part in (frame.machine, frame.crop, frame.job, frame.log_path) if part
        )
        return view._replace(alarms=AlarmsView((), view.alarms.calm, about=about))
