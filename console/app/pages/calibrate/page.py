"""Shows the Calibrate screen with five guided sequences; the shaft turns only while a key or button
is held.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple, TypeVar

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.timer import Timer
from textual.worker import Worker
from topdress.console.app import frame_words
from topdress.console.app.action import CALIBRATE, make_bindings
from topdress.console.app.held_key import HeldKey
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.calibrate.calibration import Calibration, FrameWithAge
from topdress.console.app.pages.calibrate.catch_calibration import CatchCalibration
from topdress.console.app.pages.calibrate.curve_plot import CurvePlot, CurveView
from topdress.console.app.pages.calibrate.effort_calibration import EffortCalibration
from topdress.console.app.pages.calibrate.guide_panel import GuidePanel, GuideView
from topdress.console.app.pages.calibrate.heads_calibration import HeadsCalibration
from topdress.console.app.pages.calibrate.keys import ACTIONS
from topdress.console.app.pages.calibrate.lag_calibration import LagCalibration
from topdress.console.app.pages.calibrate.progress_rows import ProgressRows
from topdress.console.app.pages.calibrate.service import CalibrateService
from topdress.console.app.pages.calibrate.wheel_calibration import WheelCalibration
from topdress.console.app.panel_views import RunView
from topdress.console.app.widgets.action_chips import Chips
from topdress.console.app.widgets.base_panel import (
    Panel,
    Picked,
    TextPart,
    find_at_cell,
    make_line,
    place_in_row,
)
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import Answer, Do, Order

# Period of repeated orders while a key is held, s. The control worker stops the shaft 0.5 s after
# the last order, so a dead console cannot leave it turning.
ORDER_REPEAT_PERIOD_S = 0.1

GiveOrder = Callable[[Order], Awaitable[Answer]]
StartTask = Callable[[Awaitable[None]], object]


class HeldRunner:
    """Turns shaft and gate while a key or button is held.

    Parameters
    ----------
    give
        Sends one order and waits for its answer.
    start
        Runs a coroutine in the background.
    """

    def __init__(self, give: GiveOrder, start: StartTask) -> None:
        self.held = HeldKey()
        # Reason why the shaft stands still, in words.
        self.standstill_reason = ""
        self._give, self._start = give, start
        self._running = False
        # Minus one period lets the first order leave at once.
        self._sent_s = -ORDER_REPEAT_PERIOD_S

    def note_key(self, now_s: float) -> None:
        """Record a press of the key."""
        self.held.note_key(now_s)
        if self.held.is_armed:
            self.standstill_reason = _(
                "Keep it pressed: the shaft turns while the key or the mouse button is down."
            )

    def note_mouse(self, down: bool) -> None:
        """Record the state of the mouse button."""
        self.held.note_mouse(down)

    def release_all(self, now_s: float, settings: Sequence[Order] = ()) -> None:
        """Release key and button, and end the run."""
        self.held.release_all()
        self.send_due(now_s, settings)

    def send_due(self, now_s: float, settings: Sequence[Order]) -> None:
        """Send the orders that are due.

        Parameters
        ----------
        now_s
            Time of the console's clock, s.
        settings
            Orders for shaft and gate at the beginning of a run.
        """
        if not self.held.is_down(now_s):
            if self._running:
                self._running = False
                self._start(self._end_run())
        elif not self._running:
            self._running, self._sent_s, self.standstill_reason = True, now_s, ""
            self._start(self._begin_run(tuple(settings), now_s))
        # The tolerance of 1 ms accepts a timer that fires slightly early.
        elif now_s - self._sent_s >= ORDER_REPEAT_PERIOD_S - 1e-3:
            self._sent_s = now_s
            self._start(self._repeat_order(now_s))

    async def _begin_run(self, settings: tuple[Order, ...], now_s: float) -> None:
        # CALIBRATE comes first: safety accepts set-points only in this state.
        """Send the orders that begin a run; a refusal ends the sequence."""
        for order in (Order(Do.CALIBRATE), *settings):
            if not self._running or not self._continues_after(await self._give(order), now_s):
                return

    async def _repeat_order(self, now_s: float) -> None:
        """Repeat the order that keeps the run alive."""
        if self._running:
            self._continues_after(await self._give(Order(Do.CALIBRATE)), now_s)

    async def _end_run(self) -> None:
        """Send the order that ends a run."""
        await self._give(Order(Do.RELEASE))

    def _continues_after(self, answer: Answer, now_s: float) -> bool:
        """Return whether the run goes on. A refusal ends the run; a late answer does not, because
        the worker's own timeout decides."""
        if answer.accepted or answer.why == "no_answer":
            return True
        if self._running:
            self._running = False
            self.standstill_reason = frame_words.describe_refusal(answer.why)
            self.held.block_repeats(now_s)
            self._start(self._end_run())
        return False


# The tabs form one row, of which one entry is open.
class TabsView(NamedTuple):
    """Holds a row of tabs."""

    names: tuple[str, ...]
    at: int
    hint: str = ""


class TabsRow(Panel[TabsView]):
    """Shows the tabs; a click posts `Picked`."""

    def _place_tabs(self) -> tuple[tuple[int, str, int], ...]:
        """Return index, text and first column of each tab."""
        texts = (
            f"[{name}]" if index == self.view.at else f" {name} "
            for index, name in enumerate(self.view.names)
        )
        # One empty column separates two tabs.
        return tuple(
            (index, text, start + index) for index, text, start in place_in_row(enumerate(texts), 1)
        )

    def draw_rows(self, view: TabsView, width: int, height: int) -> list[Content]:
        parts: list[TextPart] = [" "]
        for index, text, _start in self._place_tabs():
            parts += [(text, "bold reverse" if index == view.at else ""), " "]
        return [make_line(*parts, (view.hint, "$muted"))]

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _index, _text, start in self._place_tabs())

    def on_click(self, event: events.Click) -> None:
        """Pick the clicked tab."""
        event.stop()
        index = find_at_cell(self._place_tabs(), event.x)
        if index is not None:
            self.post_message(Picked(index))


# Period at which a held key is checked, s.
HELD_KEY_PERIOD_S = 0.05
# Actions that need the ranges or the model of the machine's file.
SERVICE_ACTIONS = frozenset({"cal_shaft", "cal_opening", "cal_weigh", "cal_table", "cal_fit"})
T = TypeVar("T")


class CalibrateScreen(Page):
    """Shows the five calibrations."""

    where: ClassVar[str] = CALIBRATE
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self, service: CalibrateService | None = None) -> None:
        super().__init__()
        self.service = service
        self.busy = ""
        self.runner = HeldRunner(
            self._send_order,
            lambda asked: self.run_worker(asked, group="held", exit_on_error=False),
        )
        # The order is that of the tabs: flow and lag come first, because the dose depends on them.
        self.calibrations: tuple[Calibration, ...] = (
            CatchCalibration(self),
            LagCalibration(self),
            HeadsCalibration(self),
            WheelCalibration(self),
            EffortCalibration(self),
        )
        self.at = 0
        self._computing: Worker[None] | None = None
        self._watch: Timer | None = None

    # The following methods show the page.

    def compose_body(self) -> ComposeResult:
        with Vertical(id="calibrate"):
            yield TabsRow(TabsView((), 0), id="cal-tabs")
            with Horizontal(id="cal-middle"):
                yield GuidePanel(GuideView("", ()), id="cal-guide")
                with Vertical(id="cal-right"):
                    yield ProgressRows((), id="cal-sheet")
                    yield CurvePlot(CurveView("", ""), id="cal-curve")
            yield Chips((), id="cal-chips")

    def on_mount(self) -> None:
        """Start the timer that checks the held key."""
        if self.app.live:
            self._watch = self.set_interval(HELD_KEY_PERIOD_S, self.watch_hold)

    @property
    def calibration(self) -> Calibration:
        """Calibration that is open."""
        return self.calibrations[self.at]

    @property
    def required_service(self) -> CalibrateService:
        """Service, for actions that need one; `run_calibration_key` has excluded None."""
        assert self.service is not None
        return self.service

    def make_frame_seen(self) -> FrameWithAge:
        """Return the newest frame with its age and the clock."""
        now_s = self.app.clock()
        frame, age_s = self.find_frame(now_s)
        return FrameWithAge(frame, age_s, now_s)

    def watch_hold(self) -> None:
        """Send and end held orders, independently of how slowly the screen is drawn."""
        # A lock of the keys releases a held key too.
        if self.app.locked:
            self.runner.held.release_all()
        self.runner.send_due(self.app.clock(), self.calibration.list_set_points())

    def gather_frame(self, frame: Frame) -> None:
        seen = FrameWithAge(frame, 0.0, self.app.clock())
        # Every calibration receives the frame: a heads check continues while another tab is open.
        for calibration in self.calibrations:
            calibration.take_frame(seen)

    def show_due(self, now_s: float) -> None:
        # Held orders come before drawing, which may be slow.
        self.watch_hold()
        super().show_due(now_s)
        if self.plots.is_due(now_s):
            view = self.calibration.make_curve()
            if view is not None:
                self.query_one("#cal-curve", CurvePlot).show_view(view)

    def show_numbers(self, view: RunView) -> None:
        """Show the open calibration."""
        super().show_numbers(view)
        seen = self.make_frame_seen()
        self.query_one("#cal-tabs", TabsRow).show_view(
            TabsView(
                tuple(_(calibration.name) for calibration in self.calibrations), self.at, "< >"
            )
        )
        guide = self.calibration.make_guide(seen, self.busy or self.runner.standstill_reason)
        self.query_one("#cal-guide", GuidePanel).show_view(guide)
        self.query_one("#cal-sheet", ProgressRows).show_view(
            self.calibration.list_progress_rows(seen)
        )
        chips = self.calibration.list_chips(seen)
        if self.app.locked:
            chips = tuple(chip._replace(on=False, lead=False) for chip in chips)
        self.query_one("#cal-chips", Chips).show_view(chips)
        self.query_one("#cal-curve", CurvePlot).display = self.calibration.make_curve() is not None

    # The following methods react to keys and clicks.

    def run_calibration_key(self, name: str) -> None:
        """Run the open calibration's function for a key, or explain why it has none."""
        deed = self.calibration.key_actions.get(name)
        if name == "cal_fit" and self.busy:
            self.app.show_notice(self.busy)
        elif name in SERVICE_ACTIONS and self.service is None:
            self.app.show_notice(_("calibration is not available here: start topdress run"))
        elif deed is None:
            self.app.show_notice(_("this key belongs to another calibration"))
        else:
            deed(self.make_frame_seen())

    def press_hold_key(self) -> None:
        """Process a press of the key that turns the shaft while it is held."""
        if not self.calibration.holds:
            self.app.show_notice(_("nothing turns in this calibration"))
            return
        self.runner.note_key(self.make_frame_seen().now_s)
        self.watch_hold()

    def choose_calibration(self, index: int) -> None:
        """Open another calibration; a held run ends."""
        self.runner.release_all(self.app.clock())
        self.runner.standstill_reason = ""
        self.at = index % len(self.calibrations)

    def on_picked(self, event: Picked) -> None:
        """Open the clicked calibration."""
        self.choose_calibration(event.index)
        self.app.show_changes()

    def on_chips_held(self, event: Chips.Held) -> None:
        """Turn the shaft while the chip on the screen is held."""
        if event.down and self.app.locked:
            self.app.show_notice(_("locked: F8 unlocks; hold and stop work"))
            return
        self.runner.note_mouse(event.down)
        self.watch_hold()

    def on_screen_suspend(self) -> None:
        """Release the key and pause the timer when another page opens."""
        self.runner.release_all(self.app.clock())
        if self._watch is not None:
            self._watch.pause()

    def on_screen_resume(self) -> None:
        """Resume the timer."""
        if self._watch is not None:
            self._watch.resume()

    def on_app_blur(self, event: events.AppBlur) -> None:
        """Release the key, because a terminal without the focus reports no keys."""
        self.runner.release_all(self.app.clock())

    async def _send_order(self, order: Order) -> Any:
        """Send an order without a notice; the guide shows a refusal."""
        return await self.app.ask_source(lambda source: source.send_order(order), quiet=True)

    # The following methods serve the calibrations.

    def ask_question(self, question: ModalScreen[T | None], then: Callable[[T], object]) -> None:
        """Ask a question; the shaft stands meanwhile."""

        def take_answer(answer: T) -> None:
            then(answer)
            self.app.show_changes()

        self.runner.release_all(self.app.clock())
        self.app.ask_question(question, take_answer)

    def compute_in_thread(self, what: Callable[[], T], then: Callable[[T], object]) -> None:
        """Compute in a thread. Escape abandons the work; an error is shown as one line in the key
        bar."""

        def end_work(say: Callable[[Any], object], found: Any) -> None:
            self.busy = ""
            say(found)
            self.app.show_changes()

        self.busy = _("computing, Esc cancels")
        self._computing = self.app.run_with_files(
            what,
            partial(end_work, then),
            partial(end_work, self.app.show_notice),
            group="calibrate",
        )

    def ask_file_name(self) -> None:
        """Ask for the name of the new machine file, then write the file."""
        service, fitted, calibration = self.service, self.calibration.fitted, self.calibration
        if service is None or fitted is None or calibration.saved:
            self.app.show_notice(_("nothing new to save: measure and fit first"))
            return

        def note_saved(path: str) -> None:
            calibration.saved = path
            if self.app.services.job is not None:
                self.app.job_page.ask_to_use_machine(path)

        text = _(
            "Calibrated from {machine}; nothing is overwritten, the machine at work stays as it is."
        ).format(machine=service.machine)
        self.ask_question(
            NameDialog(
                _("Name of the new machine file"),
                service.name_for(fitted.kind),
                text,
                _explain_wrong_name,
            ),
            lambda name: self.compute_in_thread(lambda: service.save(fitted, name), note_saved),
        )

    def key_escape(self) -> None:
        """Cancel the work in progress."""
        if self.busy and self._computing is not None:
            self._computing.cancel()
            self.busy = ""
            self.app.show_notice(_("cancelled"))


def _explain_wrong_name(name: str) -> str:
    """Return the fault of a file name, or "". The name must be portable and must not escape the
    folder."""
    if (
        not name
        or any(not (letter.isalnum() or letter in "-_.") for letter in name)
        or name.startswith(".")
    ):
        return _("letters, digits, - and _ only")
    return ""
