"""The Calibrate screen: five guided sequences; what turns the shaft turns it only while a key
or button is held."""

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
from topdress.console.app import words
from topdress.console.app.action import CALIBRATE, make_bindings
from topdress.console.app.held_key import HeldKey
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.calibrate.calibration import Calibration, FrameSeen
from topdress.console.app.pages.calibrate.catch_calibration import CatchCalibration
from topdress.console.app.pages.calibrate.curve import Curve, CurveView
from topdress.console.app.pages.calibrate.effort_calibration import EffortCalibration
from topdress.console.app.pages.calibrate.guide import Guide, GuideView
from topdress.console.app.pages.calibrate.heads_calibration import HeadsCalibration
from topdress.console.app.pages.calibrate.keys import ACTIONS
from topdress.console.app.pages.calibrate.lag_calibration import LagCalibration
from topdress.console.app.pages.calibrate.progress_rows import Sheet
from topdress.console.app.pages.calibrate.service import CalibrateService
from topdress.console.app.pages.calibrate.wheel_calibration import WheelCalibration
from topdress.console.app.pages.page import Page
from topdress.console.app.view import RunView
from topdress.console.app.widgets.chips import Chips
from topdress.console.app.widgets.panel import Panel, Part, Picked, at_cell, in_row, line
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import Answer, Do, Order

# Runs shaft and gate while a key or button is held: orders out, repeated, and a release the
# moment it is let go. the control worker stops 0.5 s after the last one
REPEAT_S = 0.1

Give = Callable[[Order], Awaitable[Answer]]
Start = Callable[[Awaitable[None]], object]


class Runner:
    """give: sends one order and waits for its answer. start: runs a coroutine in the background."""

    def __init__(self, give: Give, start: Start) -> None:
        self.held = HeldKey()
        self.said = ""  # why it does not run, in words
        self._give, self._start = give, start
        self._running = False
        self._sent_s = -REPEAT_S

    def key(self, now_s: float) -> None:
        self.held.key(now_s)
        if self.held.armed:
            self.said = _(
                "Keep it pressed: the shaft turns while the key or the mouse button is down."
            )

    def mouse(self, down: bool) -> None:
        self.held.mouse(down)

    def let_go(self, now_s: float, settings: Sequence[Order] = ()) -> None:
        self.held.let_go()
        self.tick(now_s, settings)

    def tick(self, now_s: float, settings: Sequence[Order]) -> None:
        """Send what is due; settings: orders for shaft and gate at the beginning of a run."""
        if not self.held.down(now_s):
            if self._running:
                self._running = False
                self._start(self._end())
        elif not self._running:
            self._running, self._sent_s, self.said = True, now_s, ""
            self._start(self._begin(tuple(settings), now_s))
        elif now_s - self._sent_s >= REPEAT_S - 1e-3:
            self._sent_s = now_s
            self._start(self._repeat(now_s))

    async def _begin(self, settings: tuple[Order, ...], now_s: float) -> None:
        for order in (Order(Do.CALIBRATE), *settings):
            if not self._running or not self._kept(await self._give(order), now_s):
                return

    async def _repeat(self, now_s: float) -> None:
        if self._running:
            self._kept(await self._give(Order(Do.CALIBRATE)), now_s)

    async def _end(self) -> None:
        await self._give(Order(Do.RELEASE))

    def _kept(self, answer: Answer, now_s: float) -> bool:
        """A refusal ends the run; a late answer does not, the worker's own watch decides."""
        if answer.accepted or answer.why == "no_answer":
            return True
        if self._running:
            self._running = False
            self.said = words.describe_refusal(answer.why)
            self.held.block(now_s)
            self._start(self._end())
        return False


# A row of choices, one of them open; a click or the arrows take another.
class TabsView(NamedTuple):
    names: tuple[str, ...]
    at: int
    hint: str = ""


class TabsRow(Panel[TabsView]):
    """Posts Picked."""

    def _row(self) -> tuple[tuple[int, str, int], ...]:
        texts = (
            f"[{name}]" if index == self.view.at else f" {name} "
            for index, name in enumerate(self.view.names)
        )
        # gaps
        return tuple(
            (index, text, start + index) for index, text, start in in_row(enumerate(texts), 1)
        )

    def lines(self, view: TabsView, width: int, height: int) -> list[Content]:
        parts: list[Part] = [" "]
        for index, text, _start in self._row():
            parts += [(text, "bold reverse" if index == view.at else ""), " "]
        return [line(*parts, (view.hint, "$muted"))]

    def places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _index, _text, start in self._row())

    def on_click(self, event: events.Click) -> None:
        event.stop()
        index = at_cell(self._row(), event.x)
        if index is not None:
            self.post_message(Picked(index))


WATCH_S = 0.05  # how often a held key is looked at
# by the machine's file
COMPUTED = frozenset({"cal_shaft", "cal_opening", "cal_weigh", "cal_table", "cal_fit"})
T = TypeVar("T")


class CalibrateScreen(Page):
    where: ClassVar[str] = CALIBRATE
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self, service: CalibrateService | None = None) -> None:
        super().__init__()
        self.service = service
        self.busy = ""
        self.runner = Runner(
            self._give, lambda asked: self.run_worker(asked, group="held", exit_on_error=False)
        )
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

    # --- what it shows
    # -------------------------------------------------------------------------------------------

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
    def served(self) -> CalibrateService:
        """For what is done only where this console can compute and save."""
        assert self.service is not None
        return self.service

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
        seen = self.now()
        self.query_one("#cal-tabs", TabsRow).show(
            TabsView(
                tuple(_(calibration.name) for calibration in self.calibrations), self.at, "< >"
            )
        )
        guide = self.calibration.guide(seen, self.busy or self.runner.said)
        self.query_one("#cal-guide", Guide).show(guide)
        self.query_one("#cal-sheet", Sheet).show(self.calibration.sheet(seen))
        chips = self.calibration.chips(seen)
        if self.app.locked:
            chips = tuple(chip._replace(on=False, lead=False) for chip in chips)
        self.query_one("#cal-chips", Chips).show(chips)
        self.query_one("#cal-curve", Curve).display = self.calibration.curve() is not None

    # --- what is done
    # --------------------------------------------------------------------------------------------

    def do(self, name: str) -> None:
        """What a key does in the calibration that is open."""
        deed = self.calibration.deeds.get(name)
        if name == "cal_fit" and self.busy:
            self.app.notice(self.busy)
        elif name in COMPUTED and self.service is None:
            self.app.notice(_("calibration is not available here: start topdress run"))
        elif deed is None:
            self.app.notice(_("this key belongs to another calibration"))
        else:
            deed(self.now())

    def hold_key(self) -> None:
        if not self.calibration.holds:
            self.app.notice(_("nothing turns in this calibration"))
            return
        self.runner.key(self.now().now_s)
        self.watch_hold()

    def turn(self, index: int) -> None:
        """Another calibration; a held run ends."""
        self.runner.let_go(self.app.clock())
        self.runner.said = ""
        self.at = index % len(self.calibrations)

    def on_picked(self, event: Picked) -> None:
        self.turn(event.index)
        self.app.look()

    def on_chips_held(self, event: Chips.Held) -> None:
        if event.down and self.app.locked:
            self.app.notice(_("locked: F8 unlocks; hold and stop work"))
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
        return await self.app.asked(lambda source: source.send_order(order), quiet=True)

    # --- for the calibrations
    # ------------------------------------------------------------------------------------

    def ask(self, question: ModalScreen[T | None], then: Callable[[T], object]) -> None:
        """The shaft stands while something is asked."""

        def answered(answer: T) -> None:
            then(answer)
            self.app.look()

        self.runner.let_go(self.app.clock())
        self.app.ask(question, answered)

    def compute(self, what: Callable[[], T], then: Callable[[T], object]) -> None:
        """Long work in a thread; Escape forgets it, an error is one line in the key bar."""

        def ended(say: Callable[[Any], object], found: Any) -> None:
            self.busy = ""
            say(found)
            self.app.look()

        self.busy = _("computing, Esc cancels")
        self._computing = self.app.with_files(
            what, partial(ended, then), partial(ended, self.app.notice), group="calibrate"
        )

    def ask_name(self) -> None:
        service, fitted, calibration = self.service, self.calibration.fitted, self.calibration
        if service is None or fitted is None or calibration.saved:
            self.app.notice(_("nothing new to save: measure and fit first"))
            return

        def saved(path: str) -> None:
            calibration.saved = path
            if self.app.services.job is not None:
                self.app.job_page.ask_use(path)

        text = _(
            "Calibrated from {machine}; nothing is overwritten, the machine at work stays as it is."
        ).format(machine=service.machine)
        self.ask(
            NameDialog(
                _("Name of the new machine file"), service.name_for(fitted.kind), text, _wrong_name
            ),
            lambda name: self.compute(lambda: service.save(fitted, name), saved),
        )

    def key_escape(self) -> None:
        if self.busy and self._computing is not None:
            self._computing.cancel()
            self.busy = ""
            self.app.notice(_("cancelled"))


def _wrong_name(name: str) -> str:
    if (
        not name
        or any(not (letter.isalnum() or letter in "-_.") for letter in name)
        or name.startswith(".")
    ):
        return _("letters, digits, - and _ only")
    return ""
