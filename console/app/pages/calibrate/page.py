"""The Calibrate screen: four guided sequences; what turns the shaft turns it only while a key or button is held."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen
from textual.timer import Timer
from textual.worker import Worker, WorkerState

from console.app.action import CALIBRATE, Action, bindings
from console.app.name_dialog import NameDialog
from console.app.pages.calibrate.calibration import Calibration, FrameSeen
from console.app.pages.calibrate.catch_calibration import CatchCalibration
from console.app.pages.calibrate.curve import Curve, CurveView
from console.app.pages.calibrate.guide import Guide, GuideView
from console.app.pages.calibrate.heads_calibration import HeadsCalibration
from console.app.pages.calibrate.job import CalibrateJob
from console.app.pages.calibrate.keys import ACTIONS
from console.app.pages.calibrate.lag_calibration import LagCalibration
from console.app.pages.calibrate.runner import Runner
from console.app.pages.calibrate.sheet import Sheet
from console.app.pages.calibrate.tabs_row import TabsRow, TabsView
from console.app.pages.calibrate.wheel_calibration import WheelCalibration
from console.app.pages.page import Page
from console.app.units import Units
from console.app.view import RunView
from console.app.widgets.chips import Chips
from console.frame import Frame
from console.locale import _
from control.orders import Do, Order

WATCH_S = 0.05                # how often a held key is looked at


class CalibrateScreen(Page):
    where: ClassVar[str] = CALIBRATE
    BINDINGS: ClassVar = bindings(ACTIONS)

    def __init__(self, job: CalibrateJob | None = None) -> None:
        super().__init__()
        self.job = job
        self.busy = ""
        self.runner = Runner(self._give, lambda asked: self.run_worker(asked, group="held", exit_on_error=False))
        self.calibrations: tuple[Calibration, ...] = (
            CatchCalibration(self), LagCalibration(self), HeadsCalibration(self), WheelCalibration(self))
        self.at = 0
        self._computing: Worker[Any] | None = None
        self._computed: Callable[[Any], None] | None = None
        self._watch: Timer | None = None

    # --- what it shows -------------------------------------------------------------------------------------------

    def body(self) -> ComposeResult:
        with Vertical(id="calibrate"):
            yield TabsRow(TabsView((), 0), id="cal-tabs")
            with Horizontal(id="cal-middle"):
                yield Guide(GuideView("", ()), id="cal-guide")
                with Vertical(id="cal-right"):
                    yield Sheet((), id="cal-sheet")
                    yield Curve(CurveView("", ""), id="cal-curve")
            yield Chips((), id="cal-chips")

    def on_mount(self) -> None:
        if self.app.live:
            self._watch = self.set_interval(WATCH_S, self.watch_hold)

    @property
    def calibration(self) -> Calibration:
        return self.calibrations[self.at]

    @property
    def units(self) -> Units:
        return self.app.units

    def now(self) -> FrameSeen:
        now_s = self.app.clock()
        frame, age_s = self.seen(now_s)
        return FrameSeen(frame, age_s, now_s)

    def watch_hold(self) -> None:
        """Orders go out and come to an end at this pace, however slowly the screen is drawn."""
        if self.app.locked:
            self.runner.held.let_go()
        self.runner.tick(self.app.clock(), self.calibration.settings())

    def gather(self, frame: Frame) -> None:
        seen = FrameSeen(frame, 0.0, self.app.clock())
        for calibration in self.calibrations:
            calibration.see(seen)

    def tick(self, now_s: float) -> None:
        self.watch_hold()
        super().tick(now_s)
        if self.plots.due(now_s):
            view = self.calibration.curve()
            if view is not None:
                self.query_one("#cal-curve", Curve).show(view)

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        self._show()

    def _show(self) -> None:
        seen = self.now()
        self.query_one("#cal-tabs", TabsRow).show(TabsView(
            tuple(calibration.title() for calibration in self.calibrations), self.at, "< >"))
        guide = self.calibration.guide(seen, self.busy or self.runner.said)
        self.query_one("#cal-guide", Guide).show(guide)
        self.query_one("#cal-sheet", Sheet).show(self.calibration.sheet(seen))
        chips = self.calibration.chips(seen)
        if self.app.locked:
            chips = tuple(chip._replace(on=False, lead=False) for chip in chips)
        self.query_one("#cal-chips", Chips).show(chips)
        self.query_one("#cal-curve", Curve).display = self.calibration.curve() is not None

    def redraw(self) -> None:
        super().redraw()
        self._show()

    # --- what is done --------------------------------------------------------------------------------------------

    def perform(self, action: Action) -> None:
        super().perform(action)
        self.hurry()
        self.app.tick()

    def hold_key(self) -> None:
        if not self.calibration.holds:
            self.tell(_("nothing turns in this calibration"))
            return
        self.runner.key(self.now().now_s)
        self.watch_hold()

    def turn(self, index: int) -> None:
        """Another calibration; a held run ends."""
        self.runner.let_go(self.app.clock())
        self.runner.said = ""
        self.at = index % len(self.calibrations)

    def on_tabs_row_picked(self, event: TabsRow.Picked) -> None:
        self.turn(event.index)
        self.hurry()
        self.app.tick()

    def on_chips_held(self, event: Chips.Held) -> None:
        if event.down and self.app.locked:
            self.tell(_("locked: F8 unlocks; hold and stop work"))
            return
        self.runner.mouse(event.down)
        self.watch_hold()

    def on_screen_suspend(self) -> None:
        self.runner.let_go(self.app.clock())
        if self._watch is not None:
            self._watch.pause()

    def on_screen_resume(self) -> None:
        if self._watch is not None:
            self._watch.resume()

    def on_app_blur(self, event: events.AppBlur) -> None:
        self.runner.let_go(self.app.clock())

    async def _give(self, order: Order) -> Any:
        return await self.app.asked(lambda source: source.order(order), quiet=True)

    # --- for the calibrations ------------------------------------------------------------------------------------

    def give(self, do: Do, value: float | None = None) -> None:
        self.app.give(do, value)

    def ask(self, dialog: ModalScreen[Any], answered: Callable[[Any], None]) -> None:
        def then(answer: Any) -> None:
            answered(answer)
            self.hurry()
            self.app.tick()

        self.runner.let_go(self.app.clock())
        self.app.push_screen(dialog, then)

    def tell(self, text: str) -> None:
        self.app.notice(text)

    def lag_test(self, begin: bool) -> None:
        self.app.run_worker(self.app.asked(lambda source: source.lag_test(begin)), group="orders", exit_on_error=False)

    def compute(self, what: Callable[[], Any], done: Callable[[Any], None]) -> None:
        """Long work in a thread; Escape forgets it, an error is one line in the key bar."""
        self._cancel()
        self.busy, self._computed = _("computing, Esc cancels"), done
        self._computing = self.run_worker(what, group="calibrate", thread=True, exit_on_error=False)

    def ask_name(self) -> None:
        job, fitted, calibration = self.job, self.calibration.fitted, self.calibration
        if job is None or fitted is None or calibration.saved:
            self.tell(_("nothing new to save: measure and fit first"))
            return

        def saved(path: str) -> None:
            calibration.saved = path
            if self.app.services.job is not None:
                self.app.job_page.ask_use(path)

        def named(name: str | None) -> None:
            if name is not None:
                self.compute(lambda: job.save(fitted, name), saved)

        text = _("Calibrated from {machine}; nothing is overwritten, the machine at work stays as it is.").format(
            machine=job.machine)
        self.ask(NameDialog(_("Name of the new machine file"), job.name_for(fitted.kind), text, _wrong_name), named)

    def key_escape(self) -> None:
        if self.busy:
            self._cancel()
            self.tell(_("cancelled"))

    def _cancel(self) -> None:
        if self._computing is not None:
            self._computing.cancel()
        self._computing, self.busy = None, ""

    def on_worker_state_changed(self, event: Worker.StateChanged) -> None:
        if event.worker is not self._computing:
            return
        if event.state is WorkerState.SUCCESS and self._computed is not None:
            self._computing, self.busy = None, ""
            self._computed(event.worker.result)
        elif event.state is WorkerState.ERROR:
            self._computing, self.busy = None, ""
            self.tell(str(event.worker.error).splitlines()[0] if str(event.worker.error) else
                      type(event.worker.error).__name__)
        else:
            return
        self.hurry()
        self.app.tick()


def _wrong_name(name: str) -> str:
    if not name or any(not (letter.isalnum() or letter in "-_.") for letter in name) or name.startswith("."):
        return _("letters, digits, - and _ only")
    return ""
