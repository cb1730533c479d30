"""Shows the Run screen: the machine at work."""

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
from topdress.console.app.panel_views import (
    AgedText,
    AlarmsView,
    RunView,
    format_duration,
    format_local_time,
)
from topdress.console.app.units import Units
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    choose_longest_fit,
    fit_text_width,
    make_line,
)
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import State

if TYPE_CHECKING:
    from topdress.control.diagnosis.result import ModelDeviation


# One line shows how the machine deviates from its model, since when, and the probable cause.
#
# The line is empty while the machine turns; on hold it also names a remedy.
class ModelCheck(Panel[tuple[str, ...]]):
    """Shows the line in the fullest form that fits; the page hides the empty line."""

    def draw_rows(self, view: tuple[str, ...], width: int, height: int) -> list[Content]:
        text = next((text for text in view if cell_len(text) <= width), view[-1] if view else "")
        return [make_line((fit_text_width(text, width), "$warning" if text else ""))]


def list_model_check_texts(
    found: ModelDeviation, frame: Frame, utc_offset_s: float
) -> tuple[str, ...]:
    """Return the texts, fullest first; () while the machine turns.

    At work the cause matters more than the time. On hold, when the operator can act, the remedy
    matters more than both.

    Parameters
    ----------
    found
        Deviation from the model.
    frame
        Newest frame.
    utc_offset_s
        Local time minus UTC, s.
    """
    if is_turning(frame):
        return ()
    # These words are imported on use, because a sound machine never needs them.
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
    """Return whether the machine works but spreads nothing at this position, as on a headland."""
    row = frame.row
    return row.state == State.WORKING and (row.work_switch == 0 or not row.target_rate_kg_ha)


# One row shows the offset from the A-B line as lights on either side. The step of a light, m, is a
# tenth of a metre, the initial setting of other makers' light bars.
LIGHT_STEP_M = 0.1
# Lights on each side of the centre.
LIGHTS_PER_SIDE = 8
LIT_SIGN, DARK_SIGN = "█", "·"


class LightView(NamedTuple):
    """Holds the lights: negative to the left, positive to the right, 0 on the line; `said` is the
    distance in words."""

    lights: int
    said: AgedText
    track: str


def make_light_view(
    guide: GuideLine, frame: Frame | None, stale: bool, units: Units
) -> LightView | None:
    """Return the lights; None without a line or position."""
    if frame is None or frame.place_m is None:
        return None
    off = guide.find_offset(frame.place_m, frame.row.heading_deg)
    if off is None:
        return None
    # Two decimals of a metre, or one of a foot, suit the accuracy of RTK.
    near = units.fine_distance._replace(decimals=2 if units.id == "metric" else 1)
    lights = max(-LIGHTS_PER_SIDE, min(LIGHTS_PER_SIDE, round(off.right_m / LIGHT_STEP_M)))
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
        AgedText(said, stale),
        _("track {number}").format(number=f"{off.number:+d}" if off.number else "A-B"),
    )


class LightBar(Panel[LightView | None]):
    """Shows lights on the side where the machine is: the operator steers away from them."""

    def draw_rows(self, view: LightView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        left = DARK_SIGN * (LIGHTS_PER_SIDE + min(0, view.lights)) + LIT_SIGN * max(0, -view.lights)
        after = LIT_SIGN * max(0, view.lights) + DARK_SIGN * (LIGHTS_PER_SIDE - max(0, view.lights))
        lit = "$stale" if view.said.stale else "$alarm-amber" if view.lights else "$target"
        middle: TextPart = (" ◆ " if not view.lights else " ┃ ", f"bold {lit}")
        bar = 2 * LIGHTS_PER_SIDE + 3
        text = f" {view.said.text}"
        track = choose_longest_fit((f"{view.track} ", ""), width - bar - cell_len(text) - 2)
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
        # The launch: a START key that is held lets the flow begin before the machine moves.
        self.start_key = HeldKey()

    def perform_action(self, action: Action) -> None:
        """Perform an action without a refresh, because an order must not wait for drawing."""
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
        # Where rows are scarce, alarms and lights have priority.
        bar.display = found is not None and not (low and (view.alarms.lines or lights.display))
        self.set_class(bar.display or lights.display, "-checked")
        if found is not None and frame is not None:
            bar.show_view(list_model_check_texts(found, frame, self.app.utc_offset_s))

    def make_view(self, frame: Frame | None, age_s: float) -> RunView:
        """Return the view; without alarms their rows name machine, crop, job and log."""
        view = super().make_view(frame, age_s)
        if frame is None or view.alarms.lines or view.alarms.urgent:
            return view
        about = tuple(
            part for part in (frame.machine, frame.crop, frame.job, frame.log_path) if part
        )
        return view._replace(alarms=AlarmsView((), view.alarms.calm, about=about))
