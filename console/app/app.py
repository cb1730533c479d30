"""The Textual app: it supervises the source of frames, turns keys into orders, and looks at
what is new."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeVar, cast

from rich.cells import cell_len
from textual import events
from textual.app import App, SystemCommand
from textual.filter import LineFilter
from textual.screen import Screen
from textual.widgets import Input
from textual.worker import Worker
from topdress.console import import_hooks
from topdress.console.app import actions, key_normaliser, themes, words
from topdress.console.app.action import ANYWHERE, JOB, MAP, REPLAY, RUN, Action, make_bindings
from topdress.console.app.alarms import Bell
from topdress.console.app.attach_notice import Joined, describe_attachment
from topdress.console.app.dialogs import Choice, ChoiceDialog, Confirm, TextDialog
from topdress.console.app.dose_change import dose_change
from topdress.console.app.fields import FieldPictures
from topdress.console.app.first_question import MAY_CHANGE, ask_first_question, restart_worker
from topdress.console.app.guide_line import GuideLine
from topdress.console.app.guide_line_store import KeptLines, make_line_record
from topdress.console.app.history import History
from topdress.console.app.keys import ACTIONS
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.all import Pages
from topdress.console.app.pages.job.checklist import file_name
from topdress.console.app.pages.job.service import Recent
from topdress.console.app.pages.page import Page
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.plain_lines import PlainLines
from topdress.console.app.presence_text import (
    CompanyView,
    arrival_words,
    company_view,
    describe_everyone,
    describe_news,
)
from topdress.console.app.reasons import find_first_key, why_no_machine
from topdress.console.app.refresh_rates import NUMBERS_S
from topdress.console.app.screens.alarm_list import AlarmList
from topdress.console.app.screens.help import HelpScreen
from topdress.console.app.screens.worker_lost_screen import GoneScreen
from topdress.console.app.services import Services
from topdress.console.app.settings import apply, find_rate_limits, make_theme
from topdress.console.app.source import FrameArrival, FrameSource
from topdress.console.app.terminal import Takes, find_terminal
from topdress.console.app.tour import Tour
from topdress.console.app.type_ahead_guard import HeldEnter, StrayTyping
from topdress.console.app.undo import Undo, Undoable, describe_undo, reverse_orders
from topdress.console.app.units import METRIC, Units
from topdress.console.app.view import format_local_time
from topdress.console.app.widgets.key_bar import URGENT, KeyBar
from topdress.console.frame import Frame
from topdress.console.gc_tuning import FreezeSchedule
from topdress.console.link import Link, WorkerGone
from topdress.console.locale import N_, _, use_language
from topdress.console.running import WorkerFailed
from topdress.console.worker.resume_alarms import AlarmHistory
from topdress.control.orders import Answer, Do, Order, State
from topdress.drivers import day_clock
from topdress.drivers.files.settings import Rates

if TYPE_CHECKING:
    from topdress.console.app.pages.job.page import JobScreen
    from topdress.console.app.pages.job.service import AtWork, JobService, Offer
    from topdress.console.app.pages.map.page import MapScreen
    from topdress.console.app.pages.replay.page import ReplayScreen
    from topdress.control.machine.machine import Machine

LEADS_TO = {Do.START: State.WORKING, Do.CALIBRATE: State.CALIBRATING, Do.READY: State.READY}
NOTES = (TextDialog, HelpScreen, AlarmList)  # nothing is asked in them
NOTICE_S = 4.0
COMES_BACK = N_("the machine comes back with the new files: a moment")
# between two strokes of the bell: closer ones are one on some terminals
STROKE_S = 0.35
FIRST_S = 0.02  # how often the first frame is looked for
# after the first frame: its picture is drawn, and the other pages are made ready, ...
SEEN_S = 0.5
BREATHER_S = 0.05  # ... so far apart that keys come between them
# Textual's, once it needs them
LATE_MODULES = ("rich.traceback", "textual.scrollbar", "textual.system_commands")
# the first character that is not ASCII has Rich read its table of widths
WIDE = "\u80a5"
_HERE = Path(__file__).parent
T = TypeVar("T")
Connect = Callable[[], Awaitable[FrameSource]]


def _ordered(order: Order, source: FrameSource) -> Awaitable[Answer]:
    return source.send_order(order)


class TopdressApp(App[None], inherit_bindings=False):
    """The console.

    source: the control worker's link, or None for a replay alone. clock: s, as time.monotonic.
    start, attach: make a new source when the worker is gone; their errors (OSError,
    RuntimeError) are one line. replay: a log to open. units, language, theme, keymap: instead
    of the settings' own. keymap: action id -> keys. limits_kg_ha: the range that a manual rate
    may have. live: False for tests and pictures: nothing moves but by `tick`. tour: begin with
    the guided tour. joined: `source` is of a machine that ran already. ask_job: once it is
    seen, ask which of the jobs that were worked lately.
    """

    CSS_PATH: ClassVar = [_HERE / "style.tcss", *sorted((_HERE / "pages").glob("*/style.tcss"))]
    TITLE = "topdress"
    ENABLE_COMMAND_PALETTE = False  # Textual's own key for it would pass by the lock
    BINDINGS: ClassVar = make_bindings(ACTIONS)
    # the machine is held where no such console is open
    keeps_working: ClassVar[bool] = True

    def __init__(
        self,
        source: FrameSource | None,
        clock: Callable[[], float] = time.monotonic,
        *,
        start: Connect | None = None,
        attach: Connect | None = None,
        replay: ReplayJob | None = None,
        units: Units | None = None,
        language: str | None = None,
        theme: str | None = None,
        keymap: Mapping[str, str] | None = None,
        utc_offset_s: float | None = None,
        limits_kg_ha: tuple[float, float] = (0.0, 600.0),
        hopper_kg: float = 300.0,
        live: bool = True,
        services: Services | None = None,
        tour: bool = False,
        joined: Joined | None = None,
        ask_job: bool = False,
    ) -> None:
        self._plain_lines = PlainLines()
        super().__init__()
        self.source, self.clock = source, clock
        self.start, self.attach = start, attach
        self.units = METRIC
        self.utc_offset_s = day_clock.read_utc_offset_s() if utc_offset_s is None else utc_offset_s
        self.limits_kg_ha, self.crop_limits_kg_ha, self.hopper_kg = (
            limits_kg_ha,
            limits_kg_ha,
            hopper_kg,
        )
        self.machine: Machine | None = None  # that runs; None: not known
        self.presets_kg_ha = (100.0, 150.0, 200.0)  # the settings' own take their place
        self.guide = GuideLine()
        self.sound = live
        # strokes of the bell -> the command in their place
        self.sounds: dict[int, str] = {}
        self.alarm_book, self.ring = AlarmHistory(), Bell()
        self.live = live
        self.services = services or Services()
        self.fields = FieldPictures(self, self.services.field)
        self.tour = Tour() if tour else None
        self.sweeps = FreezeSchedule()
        self.joined = joined
        self._to_say = joined  # with the first frame, before all else
        self.ask_job = ask_job
        self.locked = False
        self.stray, self.held_enter, self.undo = StrayTyping(), HeldEnter(), Undo()
        self.asked_by = ""  # the key that was pressed last on a page
        self.gone = ""
        # why the worker that this console began with never came up
        self.not_started = ""
        self.arrival, self.history = FrameArrival(), History()
        self.notice_text, self._notice_until_s = "", 0.0
        # the newest of those that are shown when they come ...
        self._first_shown: Frame | None = None
        self._first_s = 0.0  # ... from then on
        self.rates = Rates()
        self.pages = Pages(replay, self.services, self._page_made)
        self.page_actions = actions.pages()
        self._loop_here: asyncio.AbstractEventLoop | None = None
        self._supervisor: Worker[None] | None = None
        self._restarting = False
        self._earlier_of = ""
        self._frame_before: Frame | None = None
        for one in themes.THEMES:
            self.register_theme(one)
        self.theme = themes.DAY.name
        self.use_keymap({})
        self.use_settings()
        if units is not None:
            self.units = units
        if language is not None:
            use_language(language)
        if theme is not None:
            self.theme = theme
        if keymap is not None:
            self.use_keymap(keymap)

    def use_keymap(self, keys: Mapping[str, str]) -> None:
        """From now on these keys, and the built-in ones for all other actions."""
        self.set_keymap(dict(keys))
        actions.remap_actions(keys)
        self.bound_keys = {
            where: actions.find_bound_keys(where, keys)
            for where in {one.where for one in actions.ACTIONS}
        }
        self.bound_by = {one.id: actions.find_keys(one, keys) for one in actions.ACTIONS}
        self._page_keys = {
            key: one.id for one in actions.pages() for key in actions.find_keys(one, keys)
        }
        self._hold_keys = frozenset(actions.find_keys(actions.BY_ID["hold"], keys))
        self._urgent_keys = self._hold_keys.union(actions.find_keys(actions.BY_ID["stop"], keys))

    def use_settings(self) -> None:
        """Make the user's settings take effect; what of them cannot be used is said."""
        store = self.services.settings
        if store is not None:
            for data in store.themes:
                self.register_theme(make_theme(data))
            store.trouble = store.trouble or apply(self, store.settings)

    def get_default_screen(self) -> Screen[None]:
        return self.pages[
            RUN if self.source is not None or self.replay_page.job is None else REPLAY
        ]

    @property
    def replay_page(self) -> ReplayScreen:
        return cast("ReplayScreen", self.pages[REPLAY])

    @property
    def map_page(self) -> MapScreen:
        return cast("MapScreen", self.pages[MAP])

    @property
    def job_page(self) -> JobScreen:
        return cast("JobScreen", self.pages[JOB])

    def _page_made(self, where: str, page: Page) -> None:
        self.pace(page)
        if self.arrival.frame is not None:
            page.gather(self.arrival.frame)
        if self.is_running:  # the first page is the app's own screen
            self.install_screen(page, where)

    def pace(self, page: Page) -> None:
        """How often its panels are looked at, as the settings have it."""
        rates = self.rates
        page.numbers.every_s, page.plots.every_s = 1.0 / rates.numbers_hz, 1.0 / rates.plots_hz
        page.maps.every_s = 1.0 / rates.maps_hz

    def leave_from_thread(self) -> None:
        """Ends the console from another thread, without a question: its terminal is gone."""
        if self._loop_here is not None:
            self._loop_here.call_soon_threadsafe(self.exit)

    def on_mount(self) -> None:
        self._loop_here = asyncio.get_running_loop()
        for where, page in (self.pages.made if self.live else self.pages).items():
            if page is not self.screen and not self.is_screen_installed(page):
                self.install_screen(page, where)
        self._supervise()
        store = self.services.settings
        if said := store.trouble if store is not None and store.trouble else self.services.missing:
            self.call_after_refresh(self.notice, said)
        if self.source is None and self.services.job is not None and self.replay_page.job is None:
            self.ask_to_go_on(self.services.job)
        if self.live:
            self._until_first = self.set_interval(FIRST_S, self._first)
            self.set_interval(NUMBERS_S, self.tick)
            self.call_after_refresh(import_hooks.end_imports)
        self.call_after_refresh(self.tick)

    async def on_event(self, event: events.Event) -> None:
        """A key as it is meant; a click on hold and STOP in sight works also while a dialog is
        open."""
        if isinstance(event, events.Key) and not event.is_forwarded and self.screen_stack:
            if await self._is_done(event):
                return
            key = self._meant(event)
            if key != event.key and not isinstance(self.focused, Input):
                event = events.Key(key, key if len(key) == 1 else None)
        elif (
            isinstance(event, events.MouseDown | events.MouseUp)
            and not event.is_forwarded
            and self.screen_stack
        ):
            name = self._urgent_under(event)
            if name:
                if isinstance(event, events.MouseDown):
                    await self.action_do(name)
                return
        await super().on_event(event)

    def _meant(self, event: events.Key) -> str:
        return key_normaliser.meant(event.key, self.bound_keys[self.page.where], self._urgent_keys)

    async def _is_done(self, event: events.Key) -> bool:
        """A key that goes no further. F12, and Ctrl with the key of hold, come first even where
        a text field has the focus, which takes what can be printed; a note that is read gives
        way to a page."""
        key, typing = self._meant(event), isinstance(self.focused, Input)
        if isinstance(self.screen, NameDialog) and self.screen.types_early(event):
            return True
        if key == key_normaliser.ALWAYS_STOP or (
            typing and key in self._hold_keys and not event.is_printable
        ):
            await self.action_do("stop" if key == key_normaliser.ALWAYS_STOP else "hold")
            return True
        if self.screen is self.page:
            self.asked_by = key
            if key not in self._urgent_keys and self.stray.swallows(key, self.clock()):
                return True
            if key.isalpha() and len(key) == 1 and key not in self.bound_keys[self.page.where]:
                self._say_where(key)
        elif (
            isinstance(self.screen, NOTES)
            and key in self._page_keys
            and not (typing and event.is_printable)
        ):
            self.screen.dismiss(None)
            await self.action_do(self._page_keys[key])
            return True
        return key == "enter" and self.live and self.held_enter.repeats(self.screen, self.clock())

    def _say_where(self, key: str) -> None:
        """A letter that means something on other pages alone; START, asked, has a key of every
        page."""
        pages = {one.id.removesuffix("_screen"): one for one in self.page_actions}
        there = [
            one
            for one in actions.ACTIONS
            if one.where in pages and key in self.bound_by.get(one.id, ())
        ]
        if there:
            places = ", ".join(
                _("{action} on {page} ({open})").format(
                    action=_(one.label),
                    page=_(pages[one.where].label),
                    open=self.shown_key(pages[one.where].id),
                )
                for one in there
            )
            here = _("; {key} starts from here").format(key=self.shown_key("start_anywhere"))
            start = any(one.id == "start" for one in there)
            self.notice(f"{self.shown_key(there[0].id)}: {places}{here if start else ''}")

    def _urgent_under(self, event: events.MouseEvent) -> str:
        """hold or stop where a dialog leaves it in sight at this place; "" elsewhere and
        without a dialog."""
        if self.screen is self.page or not self.page.is_mounted:
            return ""
        x, y = int(event.screen_x), int(event.screen_y)
        bar = self.page.query_one("#keys", KeyBar)
        if not bar.region.contains(x, y) or self.screen.get_widget_at(x, y)[0] is not self.screen:
            return ""
        name = bar.action_at(x - bar.content_region.x)
        return name if name in URGENT else ""

    # --- frames
    # ----------------------------------------------------------------------------------------------

    @property
    def page(self) -> Page:
        """The screen under any dialogs."""
        return next(screen for screen in reversed(self.screen_stack) if isinstance(screen, Page))

    def tick(self) -> None:
        """Take the newest frame and show what is due; 5 times a second, or by hand in tests."""
        # it closes, and its page may never have been composed
        if self.not_started:
            return
        now_s = self.clock()
        if (
            self.source is not None
            and self.arrival.see(self.source.newest, now_s)
            and self.arrival.frame is not None
        ):
            self.history.add(self.arrival.frame)
            self._note_others(self.arrival.frame)
            self._note_alarms(self.arrival.frame, now_s)
            for page in self.pages.made.values():
                page.gather(self.arrival.frame)
        if self.notice_text and now_s >= self._notice_until_s:
            self.notice_text = ""
        if self.tour is not None:
            self.tour.see(self.arrival.frame, self.page.where, now_s)
            if self.tour.over:
                self.tour = None
                self.notice(_("That was the tour. Ctrl+T shows it again."))
        # not between its being turned to and its being composed
        if self.page.is_mounted:
            self.page.tick(now_s)
        if self.live:
            self.sweeps.freeze_after_sweep()

    def _first(self) -> None:
        """The first frames are shown when they come, not with the next of the ticks, until one
        has the receiver's."""
        frame, now_s = None if self.source is None else self.source.newest, self.clock()
        if frame is None or frame is self._first_shown:
            return
        begins, self._first_shown = self._first_shown is None, frame
        self._first_s = now_s if begins else self._first_s
        if frame.gnss_age_s is not None or now_s - self._first_s >= SEEN_S:
            self._until_first.stop()
        self.page.hurry()
        self.tick()
        if begins:
            if self.ask_job and self.services.job is not None:
                ask_first_question(self, self.services.job)
            self.set_timer(
                SEEN_S,
                lambda: self.run_worker(self._make_pages(), group="pages", exit_on_error=False),
            )

    async def _make_pages(self) -> None:
        """The other pages come up once the first one is seen; their modules are read by a
        thread."""
        await asyncio.to_thread(self.services.make)
        for where in self.pages:
            await asyncio.to_thread(self.pages.read, where)
            self.pages[where]
            await asyncio.sleep(BREATHER_S)
        for module in LATE_MODULES:
            await asyncio.to_thread(import_module, module)
        await asyncio.to_thread(cell_len, WIDE)
        import_hooks.end_imports()

    @property
    def own_name(self) -> str:
        """How the others at this machine have this console; empty without one that listens."""
        return str(getattr(self.source, "name", ""))

    def company_view(self) -> CompanyView | None:
        """The row that says who else is at this machine."""
        return company_view(
            None if self.gone else self.arrival.frame, self.own_name, self.utc_offset_s
        )

    def action_company(self) -> None:
        """Everybody who is attached, and the latest orders."""
        frame = self.arrival.frame
        if frame is None or self.gone or self.source is None:
            self.notice(_("no machine is connected"))
        else:
            self.push_screen(
                TextDialog(
                    _("At this machine"), describe_everyone(frame, self.own_name, self.utc_offset_s)
                )
            )

    def _note_others(self, frame: Frame) -> None:
        """Who came, went, fell silent or ordered is said by the others; who has just come hears
        whom it found."""
        before, self._frame_before = self._frame_before, frame
        if before is None:
            found = " ".join(arrival_words(frame, self.own_name, self.utc_offset_s))
            joined, self._to_say = self._to_say, None
            if joined is not None:
                self._say_joined(joined, found, frame)
            elif found:
                self.notice(found)
        elif frame.attached:
            said = describe_news(before, frame, self.own_name)
            if said:
                self.notice(said)
        # a worker that does not tell who is attached
        elif 0 < frame.consoles < before.consoles:
            self.notice(
                _("another console has ended or is silent; open now: {count}").format(
                    count=frame.consoles
                )
            )

    def _say_joined(self, joined: Joined, found: str, frame: Frame) -> None:
        """With files of its own on the command line this console may take the machine's place."""
        heading = _("A machine runs already: this console has joined it")
        text = f"{describe_attachment(joined, self.utc_offset_s)}\n{found}".rstrip()
        if not (joined.unused and joined.named) or self.services.job is None:
            self.push_screen(TextDialog(heading, text))
            return

        works = frame.row.state not in MAY_CHANGE
        mine = _("end that machine and use {files}").format(
            files=", ".join(map(file_name, joined.named))
        )
        self.ask(
            ChoiceDialog(
                heading,
                (
                    Choice("theirs", _("go on with that machine")),
                    Choice("mine", mine, _("it works: hold or stop it first") if works else ""),
                ),
                "",
                text,
            ),
            lambda which: self._use_named(joined) if which == "mine" else None,
        )

    def _use_named(self, joined: Joined) -> None:
        if self.services.job is not None:
            self.joined = None
            restart_worker(self, self.services.job, Recent(joined.named, ""))

    def _note_alarms(self, frame: Frame, now_s: float) -> None:
        if frame.log_path != self._earlier_of:
            self._earlier_of = frame.log_path
            self.call_after_refresh(
                lambda: self.run_worker(
                    self._learn_earlier(frame.log_path),
                    group="earlier",
                    # once the numbers are seen
                    exit_on_error=False,
                )
            )
        self.alarm_book.add_row_alarms(frame.row.time_s, frame.row.utc, frame.alarms)
        strokes = self.ring.due(now_s, frame.alarms)
        command, play = self.sounds.get(strokes, ""), self.services.play
        if strokes and self.sound and command and play is not None:
            self.run_worker(
                self._played(play, command, strokes), group="sound", exit_on_error=False
            )
        elif strokes and self.sound:
            self._strike(strokes)

    async def _played(self, play: Callable[[str], str], command: str, strokes: int) -> None:
        why = await asyncio.to_thread(play, command)
        if why:
            self._strike(strokes)
            self.notice(_("no sound: {why}").format(why=why))

    def _strike(self, strokes: int) -> None:
        self.bell()
        for number in range(1, strokes):
            self.set_timer(number * STROKE_S, self.bell)

    async def _learn_earlier(self, log_path: str) -> None:
        """What the machine goes by that writes this log; alarms, track and lines from before
        this console looked."""
        look_back = self.services.earlier
        if self.services.at_work is not None:
            await self._learn_limits(self.services.at_work, log_path)
        earlier = await asyncio.to_thread(look_back, log_path) if look_back is not None else None
        if earlier is not None:
            self.alarm_book.add_earlier_records(earlier.alarms)
            self.history.add_before(earlier.track)
            self.page.hurry()
        if self.services.lines is not None:
            self._take_lines(await asyncio.to_thread(self.services.lines.read_lines, log_path))

    async def _learn_limits(self, at_work: Callable[[str], AtWork | None], log_path: str) -> None:
        limits = await asyncio.to_thread(at_work, log_path)
        if limits is not None:
            self.crop_limits_kg_ha, self.hopper_kg = (0.0, limits.most_rate_kg_ha), limits.hopper_kg
            self.machine = limits.machine
            store = self.services.settings
            find_rate_limits(self, None if store is None else store.settings.manual_rate)

    def keep_line(self, record: str) -> None:
        """Of the A-B line or a boundary that is being driven: the next console on this log has
        it too."""
        frame, files = self.arrival.frame, self.services.lines
        if files is not None and frame is not None and frame.log_path:
            files.append_record(frame.log_path, record)

    def _take_lines(self, kept: KeptLines) -> None:
        """Those of the console before; a log that has none has this console's from now on."""
        if kept.guide.a is not None and not kept.of_day:
            self.guide = kept.guide
        elif self.guide.a is not None:
            self.keep_line(make_line_record(self.guide))
        elif kept.of_day:
            self.guide = kept.guide
            self.keep_line(make_line_record(self.guide))
            away = actions.shown_key(actions.BY_ID["map_no_guide"])
            self.notice(
                _(
                    "the A-B line of this field's job of {day} is here again; {key} on the "
                    "Map page takes it "
                    "away"
                ).format(day=kept.of_day[:10], key=away)
            )
        if kept.drive is not None and self.map_page.drive is None:
            self.map_page.go_on_driving(kept.drive, kept.way)

    def marks(self) -> tuple[str, ...]:
        """Words about this console itself for the status line."""
        return ()

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Textual's own, and last the one that lets nothing steer the terminal."""
        return (*super().get_line_filters(), self._plain_lines)

    def offered(self, where: str) -> tuple[Action, ...]:
        """The actions that key bar, help and palette of a screen show."""
        shown = actions.at(where)
        return actions.without_machine(shown) if self.disconnected else shown

    def menu(self) -> tuple[Action, ...]:
        """What Q lists on this page."""
        offered = {action.id for action in self.offered(self.page.where)}
        return tuple(action for action in actions.menu(self.page.where) if action.id in offered)

    def ask(self, question: Screen[T | None], then: Callable[[T], object]) -> None:
        """`then` has the answer; one that was not given is nobody's concern."""

        def answered(answer: T | None) -> None:
            if answer is not None:
                then(answer)

        self.push_screen(question, answered)

    def confirm(self, title: str, text: str, then: Callable[[], object]) -> None:
        """A yes or nothing."""
        self.ask(Confirm(title, text), lambda _yes: then())

    def why_no_stop(self) -> str:
        """One line for the key bar where hold and STOP are not offered."""
        return _("STOP: at machine") if self.disconnected else ""

    def notice(self, text: str) -> None:
        """Say something in the key bar for some seconds."""
        self.notice_text, self._notice_until_s = text, self.clock() + NOTICE_S
        if self.page.is_mounted:
            self.page.show_keys()

    def list_files(self, work: Callable[[], T], then: Callable[[T], object]) -> None:
        """What is asked about after files are looked at: `then` has it, if the page is still
        the one that is seen. As `with_files` for the rest."""
        page = self.page
        self.with_files(work, lambda found: then(found) if self.page is page else None)

    def with_files(
        self,
        work: Callable[[], T],
        then: Callable[[T], object],
        failed: Callable[[str], object] | None = None,
        *,
        group: str = "files",
        exclusive: bool = True,
    ) -> Worker[None]:
        """Files and long work in a thread, for a disk may take its time. An error is one line,
        to `failed` or in the key bar. One that is cancelled is not heard of any more; work that
        goes on long asks `get_current_worker()` whether it was. exclusive: a second one of the
        group takes the place of one that is not done."""
        return self.run_worker(
            self._with_files(work, then, failed or self.notice),
            group=group,
            exclusive=exclusive,
            exit_on_error=False,
        )

    @staticmethod
    async def _with_files(
        work: Callable[[], T], then: Callable[[T], object], failed: Callable[[str], object]
    ) -> None:
        try:
            found = await asyncio.to_thread(work)
        # whatever it is, nobody must wait for an answer that never comes
        except Exception as error:
            failed((str(error).splitlines() or [type(error).__name__])[0])
        else:
            then(found)

    # --- the other end
    # ------------------------------------------------------------------------------------------

    def _supervise(self) -> None:
        if self._supervisor is not None:
            self._supervisor.cancel()
        self._supervisor = None
        if self.source is not None:
            self._supervisor = self.run_worker(
                self._run_source(self.source), group="source", exit_on_error=False
            )

    async def _run_source(self, source: FrameSource) -> None:
        if isinstance(source, Link) and not self.is_headless:
            source.shows = Takes(find_terminal())
        try:
            await source.run_connection()
        except WorkerFailed as error:
            self.not_started = str(error)
            self.exit()
        except WorkerGone as error:
            self._say_gone(str(error))
        # a link that fails in any other way is as useless as one that is gone
        except Exception as error:
            self._say_gone(f"{type(error).__name__}: {error}")

    @property
    def disconnected(self) -> bool:
        """Whether no order reaches a machine; a log that is played alone waits for none."""
        return bool(self.gone) or (self.source is None and self.replay_page.job is None)

    def _say_gone(self, why: str) -> None:
        if self.gone or self._restarting:
            return
        self.gone = why or "gone"
        self._show_gone(self.gone)

    def _show_gone(self, why: str) -> None:
        self.page.hurry()
        self.page.tick(self.clock())
        if not isinstance(self.screen, GoneScreen):
            self.push_screen(
                GoneScreen(why, self.start is not None, self.attach is not None), self._reconnect
            )

    def _reconnect(self, how: str | None) -> None:
        if how == "start" and self.joined is not None and self.joined.unused and self.joined.named:
            self._use_named(self.joined)
            return
        if how == "start" and self.services.job is not None:
            self.ask_to_go_on(self.services.job)
            return
        self.connect({"start": self.start, "attach": self.attach}.get(how or ""))

    def connect(self, connect: Connect | None) -> None:
        """Go on with another source; None: stay without one."""
        if connect is not None:
            self.notice(_("connecting to the machine"))
            self.run_worker(
                self._connect(connect), group="connect", exclusive=True, exit_on_error=False
            )

    def ask_to_go_on(self, service: JobService) -> None:
        """Go on with the job that was cut off, or begin anew: asked. Without such a job: begin."""
        self.with_files(service.find_offer, lambda offer: self._ask_to_go_on(service, offer))

    def _ask_to_go_on(self, service: JobService, offer: Offer | None) -> None:
        if offer is None:
            self.connect(self.start)
            return
        cut_off = offer

        def answer(value: str | None) -> None:
            if value == "resume":
                self.connect(lambda: service.resume_job(cut_off))
            elif value == "anew":
                self.connect(lambda: service.start_anew(cut_off))
            else:
                self.notice(why_no_machine(self))

        self.push_screen(
            self.pass_question(
                offer,
                _("A job was left at {time}: {job}").format(
                    time=format_local_time(offer.saved_utc, self.utc_offset_s)[:5], job=offer.job
                ),
            ),
            answer,
        )

    def pass_question(self, offer: Offer, heading: str) -> ChoiceDialog:
        """What is spread twice on purpose is asked: "resume" or "anew"."""
        resume = _("resume the job of {time} ({area} done)").format(
            time=format_local_time(offer.began_utc, self.utc_offset_s)[:5],
            area=self.units.area.full(offer.area_ha),
        )
        wanted = ", ".join(map(file_name, offer.others))
        by = (
            "\n" + _("Either way it goes by {files} from now on.").format(files=wanted)
            if wanted
            else ""
        )
        return ChoiceDialog(
            heading,
            (Choice("resume", resume), Choice("anew", _("begin anew"))),
            "",
            _(
                "Resumed, totals go on and the ground that is done gets nothing a second "
                "time. Anew, that job is ended, "
                "and its ground gets material again. The machine is off until you start it."
            )
            + by,
        )

    def restart(self, start: Connect) -> None:
        """End the worker that runs, then start one anew."""

        async def change() -> None:
            self._restarting = True
            try:
                end = getattr(self.source, "stop_worker", None)
                if end is not None:
                    await end()
                await self._connect(start)
            except (OSError, TimeoutError) as error:
                self.notice(_("the machine cannot be changed over: {why}").format(why=error))
            finally:
                self._restarting = False

        self.notice(_(COMES_BACK))
        self.run_worker(change(), group="connect", exclusive=True, exit_on_error=False)

    async def _connect(self, connect: Connect) -> None:
        try:
            self.source = await connect()
            if connect is self.attach:
                self.joined = Joined()
                self.notice(_("joined the machine that runs already"))
            else:
                self.joined = None
        except (OSError, RuntimeError, ValueError) as error:
            if self._restarting:
                self.gone = str(error)
            self._show_gone(str(error))
            return
        self.gone = ""
        if isinstance(self.screen, GoneScreen):
            self.screen.dismiss(None)
        self.arrival, self.alarm_book = FrameArrival(), AlarmHistory()
        self.history = History()
        self._earlier_of = ""
        self._frame_before = None
        self.undo.forget()
        self._supervise()
        self.page.hurry()

    def give(self, do: Do, value: str | float | bool | None = None) -> None:
        """One order; as `give_all`."""
        self.give_all(Order(do, value))

    def give_all(
        self,
        *orders: Order,
        also_back: Callable[[], None] = lambda: None,
        dose_is_asked: bool = False,
    ) -> None:
        """Send orders that are one change, one after the other; a refusal or a missing answer
        is said in the key bar and ends them. Those that were followed are the newest change
        that can be taken back. also_back: what taking them back does besides. dose_is_asked:
        the operator said yes to the dose before and after; else a large change of it is asked
        here."""
        if self.source is None:
            self.notice(_("no machine is connected"))
            return
        change = None if dose_is_asked else dose_change(self.arrival.frame, orders)
        if change is not None and change.is_large:
            self.confirm(
                change.question(self.units),
                change.text(self.units),
                lambda: self.give_all(*orders, also_back=also_back, dose_is_asked=True),
            )
            return
        self.run_worker(
            self._give(orders, self.arrival.frame, also_back), group="orders", exit_on_error=False
        )

    async def _give(
        self, orders: tuple[Order, ...], before: Frame | None, also_back: Callable[[], None]
    ) -> None:
        followed: list[Order] = []
        for order in orders:
            if not (await self.asked(partial(_ordered, order), do=order.do)).accepted:
                break
            followed.append(order)
        back = reverse_orders(followed, before)
        if back:

            def take_back() -> None:
                self.run_worker(
                    self._give(back, None, also_back), group="orders", exit_on_error=False
                )
                also_back()

            self.undo.add(Undoable(describe_undo(back, self.units), take_back, back))

    async def asked(
        self,
        ask: Callable[[FrameSource], Awaitable[Answer]],
        quiet: bool = False,
        do: Do | None = None,
    ) -> Answer:
        """Ask something of the source; a refusal or a missing answer is said in the key bar
        unless `quiet`. do: what was ordered: where its state is wrong, the key that comes first
        is said.

        `why` of the answer is then as from the worker, or gone, no_answer, no_machine.
        """
        if self.source is None:
            return self._refused(Answer(False, "no_machine"), quiet)
        try:
            answer = await ask(self.source)
        except WorkerGone as error:
            self._say_gone(str(error))
            if not quiet:
                self.ask_connection()
            return Answer(False, "gone")
        except (TimeoutError, OSError):
            return self._refused(Answer(False, "no_answer"), quiet)
        return answer if answer.accepted else self._refused(answer, quiet, do)

    def _refused(self, answer: Answer, quiet: bool, do: Do | None = None) -> Answer:
        if not quiet:
            frame = self.arrival.frame
            said = words.describe_refusal(answer.why, frame.alarms if frame is not None else ())
            wanted = None if do is None else LEADS_TO.get(do)
            name, _mark, state = answer.why.partition(";state=")
            first = (
                find_first_key(self, wanted, state)
                if wanted is not None and name == "not_from_state"
                else ""
            )
            if first:
                said = f"{said} {_('Press {key} first.').format(key=first)}"
            self.notice(said if answer.why == "no_answer" else _("refused: {why}").format(why=said))
        return answer

    def shown_key(self, name: str) -> str:
        """The key of an action as the key bar shows it."""
        return actions.shown_key(actions.BY_ID[name])

    # --- actions
    # ----------------------------------------------------------------------------------------------

    async def action_do(self, name: str) -> None:
        """One of the table's actions, if it belongs to this screen and is not locked."""
        action, before = actions.BY_ID[name], self.screen
        if action.where not in (ANYWHERE, self.page.where):
            return
        why = (
            _("locked: F8 unlocks; hold and stop work")
            if self.locked and not action.locked
            else self.why_not(action, judged=action.judged)
        )
        if why:
            self.notice(why)
        elif name in URGENT and self.disconnected:
            self.ask_connection()
        elif action.where == ANYWHERE:
            action.do(self)
        else:
            self.page.perform(action)
        if action.asks and self.screen is before is self.page:
            self.stray.refused(action.asks, self.clock())

    def why_not(self, action: Action, judged: bool = False) -> str:
        """Why this cannot be done now, in one line; empty where it can, or where nobody here
        knows. judged: by the worker, where one is connected."""
        why = why_no_machine(self) if action.needs_machine else ""
        if why or judged or action.why is None:
            return why
        return action.why(self if action.where == ANYWHERE else self.pages[action.where])

    def turn_to(self, where: str) -> None:
        """One page is the app's first screen, another lies over it while it is looked at."""
        page = self.pages[where]
        while not isinstance(self.screen, Page):
            self.pop_screen()
        if self.page is page:
            return
        if len(self.screen_stack) > 1:
            self.pop_screen()
        if self.page is not page:
            self.push_screen(page)
        page.hurry()
        # else it shows for a moment what it showed when it was left
        if page.is_mounted:
            self.tick()
        self.call_after_refresh(self.tick)

    def lock_keys(self, locked: bool) -> None:
        self.locked = locked
        self.look()

    def look(self) -> None:
        """Show at once what has changed."""
        self.page.hurry()
        self.tick()

    def ask_connection(self) -> None:
        """Where the worker is gone: ask what to do."""
        if self._restarting:
            self.notice(_(COMES_BACK))
        elif self.gone:
            self._show_gone(self.gone)
        elif self.source is None and (self.start or self.attach):
            self._show_gone(_("no machine is connected"))
        else:
            self.notice(
                _("no machine is connected")
                if self.source is None
                else _("the machine is connected")
            )

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        yield SystemCommand(
            _("who is at this machine"),
            _("All consoles and tablets, and who ordered what."),
            self.action_company,
        )
        for action in self.offered(self.page.where):
            if action.id != "palette":
                why = self.why_not(action)
                said = _("not now: {why}").format(why=why) if why else _(action.help)
                yield SystemCommand(
                    _(action.label), f"{action.shown}  {said}", partial(self.action_do, action.id)
                )
