"""Defines the Textual app, which supervises the source of frames, converts keys into orders and
refreshes what is due.
"""

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
from topdress.console import fast_imports
from topdress.console.app import actions, frame_words, key_normaliser, themes
from topdress.console.app.action import ANYWHERE, JOB, MAP, REPLAY, RUN, Action, make_bindings
from topdress.console.app.alarms import AlarmBell
from topdress.console.app.attach_notice import JoinedMachineFacts, describe_attachment
from topdress.console.app.common_keys import ACTIONS
from topdress.console.app.dialogs import Choice, ChoiceDialog, Confirm, TextDialog
from topdress.console.app.dose_change_check import predict_dose_change
from topdress.console.app.first_question import (
    CHANGEABLE_STATES,
    ask_first_question,
    restart_worker,
)
from topdress.console.app.frame_history import LiveHistory
from topdress.console.app.frame_source import FrameArrival, FrameSource
from topdress.console.app.guide_line import GuideLine
from topdress.console.app.guide_line_store import StoredLines, make_line_record
from topdress.console.app.guided_tour import Tour
from topdress.console.app.impossible_reasons import explain_no_machine, find_first_key
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.job.checklist import find_file_name
from topdress.console.app.pages.job.service import RecentSet
from topdress.console.app.pages.page_registry import Pages
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.panel_views import format_local_time
from topdress.console.app.picture_cache import FieldPictures
from topdress.console.app.plain_lines import ControlCharacterFilter
from topdress.console.app.presence_text import (
    PresenceView,
    describe_arrival,
    describe_everyone,
    describe_presence_changes,
    make_presence_view,
)
from topdress.console.app.refresh_rates import NUMBERS_PERIOD_S
from topdress.console.app.screens.alarm_list import AlarmList
from topdress.console.app.screens.help_screen import HelpScreen
from topdress.console.app.screens.worker_lost_screen import WorkerLostScreen
from topdress.console.app.services import Services
from topdress.console.app.settings import apply_settings, make_theme, set_rate_limits
from topdress.console.app.terminal import TerminalPulse, find_terminal
from topdress.console.app.type_ahead_guard import HeldEnter, TypeAheadGuard
from topdress.console.app.undo_stack import UndoableChange, UndoStack, describe_undo, reverse_orders
from topdress.console.app.units import METRIC, Units
from topdress.console.app.widgets.key_bar import URGENT_ACTIONS, KeyBar
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
    from topdress.console.app.pages.job.service import JobOffer, JobService, RunningLimits
    from topdress.console.app.pages.map.page import MapScreen
    from topdress.console.app.pages.replay.page import ReplayScreen
    from topdress.control.machine.machine import Machine

# State that the machine has after an order; a refusal is explained by the key that leads to this
# state.
STATE_AFTER_ORDER = {
    Do.START: State.WORKING,
    Do.CALIBRATE: State.CALIBRATING,
    Do.READY: State.READY,
}
# Screens without a question. The key of a page closes them and opens the page.
READ_ONLY_SCREENS = (TextDialog, HelpScreen, AlarmList)
# Time for which a notice stays in the key bar, s.
NOTICE_DURATION_S = 4.0
RESTART_NOTICE = N_("the machine comes back with the new files: a moment")
# Time between two strokes of the bell, s; some terminals merge closer strokes into one.
STROKE_GAP_S = 0.35
# Period of the poll for the first frame, s; the first picture must not wait for the slower regular
# tick.
FIRST_FRAME_POLL_S = 0.02
# Time from the first frame until the other pages are built, s: the first picture is drawn before.
FIRST_PICTURE_DELAY_S = 0.5
# Pause between two pages that are built, s, so that key presses are handled in between.
PAGE_BUILD_PAUSE_S = 0.05
# Modules that Textual and Rich import only on first use. Early import in a thread avoids a pause
# while the operator works.
PRELOADED_MODULES = ("rich.traceback", "textual.scrollbar", "textual.system_commands")
# The first character outside ASCII makes Rich read its table of character widths; measuring this
# character early avoids the pause later.
WIDE_CHARACTER = "\u80a5"
_HERE = Path(__file__).parent
Value = TypeVar("Value")
Connector = Callable[[], Awaitable[FrameSource]]


def _send_to_source(order: Order, source: FrameSource) -> Awaitable[Answer]:
    """Send an order to a source; a module-level function for `partial`."""
    return source.send_order(order)


class TopdressApp(App[None], inherit_bindings=False):
    """Shows the console.

    Parameters
    ----------
    source
        Link to the control worker, or None for a replay without a machine.
    clock
        Returns s, as `time.monotonic`.
    start, attach
        Make a new source after the worker is lost; the text of their errors (OSError, RuntimeError)
        is one line.
    replay
        Log to open on the Replay page.
    units, language, theme, keymap
        Values that override those of the user's settings. keymap maps an action's id to keys.
    limits_kg_ha
        Range of a manual rate, kg/ha.
    live
        False for tests and pictures: only `show_newest` refreshes the screen.
    tour
        True: begin with the guided tour.
    joined
        Description of the machine if `source` belongs to a machine that ran before this console.
    ask_job
        True: after the first frame, ask which of the recent jobs to open.
    """

    CSS_PATH: ClassVar = [_HERE / "style.tcss", *sorted((_HERE / "pages").glob("*/style.tcss"))]
    TITLE = "topdress"
    ENABLE_COMMAND_PALETTE = False  # Textual's own key for it would pass by the lock
    BINDINGS: ClassVar = make_bindings(ACTIONS)
    # A browser tab's console overrides this: the machine stops where the last such console closes.
    keeps_working: ClassVar[bool] = True

    def __init__(
        self,
        source: FrameSource | None,
        clock: Callable[[], float] = time.monotonic,
        *,
        start: Connector | None = None,
        attach: Connector | None = None,
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
        joined: JoinedMachineFacts | None = None,
        ask_job: bool = False,
    ) -> None:
        # Textual's constructor already asks for the line filters, so this filter exists first.
        self._plain_lines = ControlCharacterFilter()
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
        # Type of the running machine. None means that the machine is unknown so far.
        self.machine: Machine | None = None
        # Default presets, kg/ha; the settings replace them.
        self.presets_kg_ha = (100.0, 150.0, 200.0)
        self.guide = GuideLine()
        self.sound = live
        # Maps a number of bell strokes to the sound command that replaces them.
        self.sounds: dict[int, str] = {}
        self.alarm_history, self.ring = AlarmHistory(), AlarmBell()
        self.live = live
        self.services = services or Services()
        self.fields = FieldPictures(self, self.services.field)
        self.tour = Tour() if tour else None
        self.freeze_schedule = FreezeSchedule()
        self.joined = joined
        # Notice about the joined machine, shown with the first frame before all other notices.
        self._pending_attach_notice = joined
        self.ask_job = ask_job
        self.locked = False
        self.type_ahead_guard, self.held_enter, self.undo = (
            TypeAheadGuard(),
            HeldEnter(),
            UndoStack(),
        )
        # Key that was pressed last on a page.
        self.asked_by = ""
        # Reason why the worker is lost; empty while the link works.
        self.gone = ""
        # Reason why the worker that this console started never became ready.
        self.not_started = ""
        self.arrival, self.history = FrameArrival(), LiveHistory()
        self.notice_text, self._notice_until_s = "", 0.0
        # Newest frame that was shown on arrival, before the regular tick.
        self._first_shown: Frame | None = None
        # Time of the first frame, s.
        self._first_s = 0.0
        self.rates = Rates()
        self.pages = Pages(replay, self.services, self._prepare_page)
        self.page_actions = actions.list_page_openers()
        self._loop_here: asyncio.AbstractEventLoop | None = None
        self._supervisor: Worker[None] | None = None
        self._restarting = False
        self._earlier_log_path = ""
        self._frame_before: Frame | None = None
        for one in themes.THEMES:
            self.register_theme(one)
        self.theme = themes.DAY_THEME.name
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
        """Apply a keymap from now on; actions that it does not name have their built-in keys."""
        self.set_keymap(dict(keys))
        actions.remap_actions(keys)
        self.bound_keys = {
            where: actions.find_bound_keys(where, keys)
            for where in {one.where for one in actions.ACTIONS}
        }
        self.bound_by = {one.id: actions.find_keys(one, keys) for one in actions.ACTIONS}
        self._page_keys = {
            key: one.id
            for one in actions.list_page_openers()
            for key in actions.find_keys(one, keys)
        }
        self._hold_keys = frozenset(actions.find_keys(actions.BY_ID["hold"], keys))
        self._urgent_keys = self._hold_keys.union(actions.find_keys(actions.BY_ID["stop"], keys))

    def use_settings(self) -> None:
        """Apply the user's settings; invalid settings are reported in the key bar."""
        store = self.services.settings
        if store is not None:
            for data in store.themes:
                self.register_theme(make_theme(data))
            store.trouble = store.trouble or apply_settings(self, store.settings)

    def get_default_screen(self) -> Screen[None]:
        """Return the first page: Replay if the console has only a log, else Run."""
        return self.pages[
            RUN if self.source is not None or self.replay_page.job is None else REPLAY
        ]

    @property
    def replay_page(self) -> ReplayScreen:
        """Replay page."""
        return cast("ReplayScreen", self.pages[REPLAY])

    @property
    def map_page(self) -> MapScreen:
        """Map page."""
        return cast("MapScreen", self.pages[MAP])

    @property
    def job_page(self) -> JobScreen:
        """Job page."""
        return cast("JobScreen", self.pages[JOB])

    def _prepare_page(self, where: str, page: Page) -> None:
        """Prepare a page that was just built: refresh rates, newest frame, installation."""
        self.set_refresh_rates(page)
        if self.arrival.frame is not None:
            page.gather_frame(self.arrival.frame)
        # Textual installs the first page itself, because it is the app's default screen.
        if self.is_running:
            self.install_screen(page, where)

    def set_refresh_rates(self, page: Page) -> None:
        """Set the refresh rate of each kind of panel of a page to the user's settings."""
        rates = self.rates
        page.numbers.every_s, page.plots.every_s = 1.0 / rates.numbers_hz, 1.0 / rates.plots_hz
        page.maps.every_s = 1.0 / rates.maps_hz

    def leave_from_thread(self) -> None:
        """End the console from another thread without a question, because its terminal is gone."""
        if self._loop_here is not None:
            self._loop_here.call_soon_threadsafe(self.exit)

    def on_mount(self) -> None:
        """Install the pages and start the timers."""
        self._loop_here = asyncio.get_running_loop()
        # Tests and pictures need every page at once; a live console builds them after the first
        # frame.
        for where, page in (self.pages.made if self.live else self.pages).items():
            if page is not self.screen and not self.is_screen_installed(page):
                self.install_screen(page, where)
        self._supervise_source()
        store = self.services.settings
        if said := store.trouble if store is not None and store.trouble else self.services.missing:
            self.call_after_refresh(self.show_notice, said)
        # Without a worker and without a replay, the operator first decides whether an interrupted
        # job is resumed.
        if self.source is None and self.services.job is not None and self.replay_page.job is None:
            self.ask_to_resume_job(self.services.job)
        if self.live:
            self._until_first = self.set_interval(FIRST_FRAME_POLL_S, self._show_first_frames)
            self.set_interval(NUMBERS_PERIOD_S, self.show_newest)
            self.call_after_refresh(fast_imports.resume_gc)
        self.call_after_refresh(self.show_newest)

    async def on_event(self, event: events.Event) -> None:
        """Handle a key or click before Textual does: normalise keys, and let hold and STOP work
        under a dialog."""
        if isinstance(event, events.Key) and not event.is_forwarded and self.screen_stack:
            if await self._handle_early_key(event):
                return
            # A text field needs the character that was typed, not the key that the layout stands
            # for.
            key = self._normalise_key(event)
            if key != event.key and not isinstance(self.focused, Input):
                event = events.Key(key, key if len(key) == 1 else None)
        elif (
            isinstance(event, events.MouseDown | events.MouseUp)
            and not event.is_forwarded
            and self.screen_stack
        ):
            name = self._find_urgent_key_under(event)
            if name:
                if isinstance(event, events.MouseDown):
                    await self.action_do(name)
                return
        await super().on_event(event)

    def _normalise_key(self, event: events.Key) -> str:
        """Return the key that a keyboard layout's character stands for."""
        return key_normaliser.normalise_key(
            event.key, self.bound_keys[self.page.where], self._urgent_keys
        )

    async def _handle_early_key(self, event: events.Key) -> bool:
        """Return whether a key was handled before its screen receives it.

        F12 and Ctrl with the key of hold act even where a text field has the focus, which consumes
        printable characters. A page's key closes a screen without a question.
        """
        key, typing = self._normalise_key(event), isinstance(self.focused, Input)
        if isinstance(self.screen, NameDialog) and self.screen.take_early_key(event):
            return True
        if key == key_normaliser.STOP_KEY or (
            typing and key in self._hold_keys and not event.is_printable
        ):
            await self.action_do("stop" if key == key_normaliser.STOP_KEY else "hold")
            return True
        # Keys on a page itself: a swallowed key belongs to a question that was refused before.
        if self.screen is self.page:
            self.asked_by = key
            if key not in self._urgent_keys and self.type_ahead_guard.is_swallowed(
                key, self.clock()
            ):
                return True
            if key.isalpha() and len(key) == 1 and key not in self.bound_keys[self.page.where]:
                self._notice_other_pages(key)
        elif (
            isinstance(self.screen, READ_ONLY_SCREENS)
            and key in self._page_keys
            and not (typing and event.is_printable)
        ):
            self.screen.dismiss(None)
            await self.action_do(self._page_keys[key])
            return True
        return key == "enter" and self.live and self.held_enter.is_repeat(self.screen, self.clock())

    def _notice_other_pages(self, key: str) -> None:
        """Notify the operator that a letter works on other pages only. START is the exception: one
        key starts from every page."""
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
                    open=self.find_shown_key(pages[one.where].id),
                )
                for one in there
            )
            here = _("; {key} starts from here").format(key=self.find_shown_key("start_anywhere"))
            start = any(one.id == "start" for one in there)
            self.show_notice(f"{self.find_shown_key(there[0].id)}: {places}{here if start else ''}")

    def _find_urgent_key_under(self, event: events.MouseEvent) -> str:
        """Return "hold" or "stop" where a click hits that key next to an open dialog, else ""."""
        if self.screen is self.page or not self.page.is_mounted:
            return ""
        x, y = int(event.screen_x), int(event.screen_y)
        bar = self.page.query_one("#keys", KeyBar)
        # A dialog that covers the key at this position receives the click.
        if not bar.region.contains(x, y) or self.screen.get_widget_at(x, y)[0] is not self.screen:
            return ""
        name = bar.find_action(x - bar.content_region.x)
        return name if name in URGENT_ACTIONS else ""

    # The following methods take frames and show what is new.

    @property
    def page(self) -> Page:
        """Page below any open dialogs."""
        return next(screen for screen in reversed(self.screen_stack) if isinstance(screen, Page))

    def show_newest(self) -> None:
        """Take the newest frame and refresh what is due: 5 times a second, or on demand in
        tests."""
        # The app is closing, and its page may never have been composed.
        if self.not_started:
            return
        now_s = self.clock()
        if (
            self.source is not None
            and self.arrival.take_frame(self.source.current_frame, now_s)
            and self.arrival.frame is not None
        ):
            self.history.add_frame(self.arrival.frame)
            self._notice_others(self.arrival.frame)
            self._note_alarms(self.arrival.frame, now_s)
            # Every page collects the frame, also a hidden one: its plots must have no gap when it
            # opens.
            for page in self.pages.made.values():
                page.gather_frame(self.arrival.frame)
        if self.notice_text and now_s >= self._notice_until_s:
            self.notice_text = ""
        if self.tour is not None:
            self.tour.follow_frame(self.arrival.frame, self.page.where, now_s)
            if self.tour.is_over:
                self.tour = None
                self.show_notice(_("That was the tour. Ctrl+T shows it again."))
        # A page that was opened but not yet composed has no panels to refresh.
        if self.page.is_mounted:
            self.page.show_due(now_s)
        if self.live:
            self.freeze_schedule.freeze_after_sweep()

    def _show_first_frames(self) -> None:
        """Show the first frames on arrival, before the regular tick, until a frame has a GNSS
        fix."""
        frame, now_s = None if self.source is None else self.source.current_frame, self.clock()
        if frame is None or frame is self._first_shown:
            return
        begins, self._first_shown = self._first_shown is None, frame
        self._first_s = now_s if begins else self._first_s
        # A start without a receiver ends the poll after `FIRST_PICTURE_DELAY_S`.
        if frame.gnss_age_s is not None or now_s - self._first_s >= FIRST_PICTURE_DELAY_S:
            self._until_first.stop()
        self.page.refresh_all_next_tick()
        self.show_newest()
        if begins:
            if self.ask_job and self.services.job is not None:
                ask_first_question(self, self.services.job)
            self.set_timer(
                FIRST_PICTURE_DELAY_S,
                lambda: self.run_worker(
                    self._make_other_pages(), group="pages", exit_on_error=False
                ),
            )

    async def _make_other_pages(self) -> None:
        """Build the other pages after the first frame is visible; a thread imports their
        modules."""
        await asyncio.to_thread(self.services.make_late_services)
        for where in self.pages:
            await asyncio.to_thread(self.pages.import_page, where)
            # `self.pages[where]` builds the page, here because Textual widgets belong to the thread
            # of the event loop.
            self.pages[where]
            await asyncio.sleep(PAGE_BUILD_PAUSE_S)
        for module in PRELOADED_MODULES:
            await asyncio.to_thread(import_module, module)
        await asyncio.to_thread(cell_len, WIDE_CHARACTER)
        fast_imports.resume_gc()

    @property
    def own_name(self) -> str:
        """Name under which other consoles at this machine list this console; empty without a
        link."""
        return str(getattr(self.source, "name", ""))

    def make_presence_view(self) -> PresenceView | None:
        """Return the row that names the other consoles at this machine."""
        return make_presence_view(
            None if self.gone else self.arrival.frame, self.own_name, self.utc_offset_s
        )

    def action_company(self) -> None:
        """Show every attached console and the latest orders."""
        frame = self.arrival.frame
        if frame is None or self.gone or self.source is None:
            self.show_notice(_("no machine is connected"))
        else:
            self.push_screen(
                TextDialog(
                    _("At this machine"), describe_everyone(frame, self.own_name, self.utc_offset_s)
                )
            )

    def _notice_others(self, frame: Frame) -> None:
        """Report consoles that came, left, fell silent or gave an order. A console that has just
        come reports whom it found."""
        before, self._frame_before = self._frame_before, frame
        if before is None:
            found = " ".join(describe_arrival(frame, self.own_name, self.utc_offset_s))
            joined, self._pending_attach_notice = self._pending_attach_notice, None
            if joined is not None:
                self._show_joined(joined, found, frame)
            elif found:
                self.show_notice(found)
        elif frame.attached:
            said = describe_presence_changes(before, frame, self.own_name)
            if said:
                self.show_notice(said)
        # A worker of an older version sends the number of consoles, without their names.
        elif 0 < frame.consoles < before.consoles:
            self.show_notice(
                _("another console has ended or is silent; open now: {count}").format(
                    count=frame.consoles
                )
            )

    def _show_joined(self, joined: JoinedMachineFacts, found: str, frame: Frame) -> None:
        """Show the joined machine's files. If this command line names other files, offer to replace
        that machine."""
        heading = _("A machine runs already: this console has joined it")
        text = f"{describe_attachment(joined, self.utc_offset_s)}\n{found}".rstrip()
        if not (joined.unused and joined.named) or self.services.job is None:
            self.push_screen(TextDialog(heading, text))
            return

        works = frame.row.state not in CHANGEABLE_STATES
        mine = _("end that machine and use {files}").format(
            files=", ".join(map(find_file_name, joined.named))
        )
        self.ask_question(
            ChoiceDialog(
                heading,
                (
                    Choice("theirs", _("go on with that machine")),
                    Choice("mine", mine, _("it works: hold or stop it first") if works else ""),
                ),
                "",
                text,
            ),
            lambda which: self._use_named_files(joined) if which == "mine" else None,
        )

    def _use_named_files(self, joined: JoinedMachineFacts) -> None:
        """Restart the worker with the files of this console's command line."""
        if self.services.job is not None:
            self.joined = None
            restart_worker(self, self.services.job, RecentSet(joined.named, ""))

    def _note_alarms(self, frame: Frame, now_s: float) -> None:
        """Record the frame's alarms, and ring the bell or play the sound that is due."""
        if frame.log_path != self._earlier_log_path:
            self._earlier_log_path = frame.log_path
            self.call_after_refresh(
                lambda: self.run_worker(
                    self._read_earlier_run(frame.log_path),
                    group="earlier",
                    # These files are read after the first numbers are visible.
                    exit_on_error=False,
                )
            )
        self.alarm_history.add_row_alarms(frame.row.time_s, frame.row.utc, frame.alarms)
        strokes = self.ring.count_strokes_due(now_s, frame.alarms)
        command, play = self.sounds.get(strokes, ""), self.services.play
        if strokes and self.sound and command and play is not None:
            self.run_worker(
                self._play_sound(play, command, strokes), group="sound", exit_on_error=False
            )
        elif strokes and self.sound:
            self._strike_bell(strokes)

    async def _play_sound(self, play: Callable[[str], str], command: str, strokes: int) -> None:
        why = await asyncio.to_thread(play, command)
        if why:
            # An alarm must be audible: the bell replaces a sound that could not be played.
            self._strike_bell(strokes)
            self.show_notice(_("no sound: {why}").format(why=why))

    def _strike_bell(self, strokes: int) -> None:
        self.bell()
        for number in range(1, strokes):
            self.set_timer(number * STROKE_GAP_S, self.bell)

    async def _read_earlier_run(self, log_path: str) -> None:
        """Read what precedes this console's first frame: machine limits, alarms, track and guidance
        lines of the log."""
        look_back = self.services.earlier
        if self.services.at_work is not None:
            await self._read_machine_limits(self.services.at_work, log_path)
        earlier = await asyncio.to_thread(look_back, log_path) if look_back is not None else None
        if earlier is not None:
            self.alarm_history.add_earlier_records(earlier.alarms)
            self.history.add_earlier_ground(earlier.track)
            # The ground covered before this console started was added, so all maps are drawn anew.
            self.page.refresh_all_next_tick()
        if self.services.lines is not None:
            self._adopt_stored_lines(
                await asyncio.to_thread(self.services.lines.read_lines, log_path)
            )

    async def _read_machine_limits(
        self, at_work: Callable[[str], RunningLimits | None], log_path: str
    ) -> None:
        limits = await asyncio.to_thread(at_work, log_path)
        if limits is not None:
            self.crop_limits_kg_ha, self.hopper_kg = (0.0, limits.most_rate_kg_ha), limits.hopper_kg
            self.machine = limits.machine
            store = self.services.settings
            set_rate_limits(self, None if store is None else store.settings.manual_rate)

    def keep_line_record(self, record: str) -> None:
        """Append a record of the A-B line or the driven boundary to the log's side file, where the
        next console reads it."""
        frame, files = self.arrival.frame, self.services.lines
        if files is not None and frame is not None and frame.log_path:
            files.append_record(frame.log_path, record)

    def _adopt_stored_lines(self, kept: StoredLines) -> None:
        """Adopt the stored lines of this log. If the log has none, store this console's line."""
        if kept.guide.a is not None and not kept.of_day:
            self.guide = kept.guide
        elif self.guide.a is not None:
            self.keep_line_record(make_line_record(self.guide))
        elif kept.of_day:
            self.guide = kept.guide
            self.keep_line_record(make_line_record(self.guide))
            away = actions.find_shown_key(actions.BY_ID["map_no_guide"])
            self.show_notice(
                _(
                    "the A-B line of this field's job of {day} is here again; {key} on the "
                    "Map page takes it "
                    "away"
                ).format(day=kept.of_day[:10], key=away)
            )
        if kept.drive is not None and self.map_page.drive is None:
            self.map_page.resume_drive(kept.drive, kept.way)

    def list_status_marks(self) -> tuple[str, ...]:
        """Return words about this console itself for the status line."""
        return ()

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return Textual's line filters and, last, the filter that removes terminal control
        characters."""
        return (*super().get_line_filters(), self._plain_lines)

    def list_offered_actions(self, where: str) -> tuple[Action, ...]:
        """Return the actions that key bar, help and palette of a screen show."""
        shown = actions.list_page_actions(where)
        return actions.drop_machine_actions(shown) if self.is_disconnected else shown

    def list_menu(self) -> tuple[Action, ...]:
        """Return the actions that the menu (Q) lists on this page."""
        offered = {action.id for action in self.list_offered_actions(self.page.where)}
        return tuple(
            action for action in actions.list_menu_actions(self.page.where) if action.id in offered
        )

    def ask_question(self, question: Screen[Value | None], then: Callable[[Value], object]) -> None:
        """Show a question; `then` receives the answer, unless the dialog was cancelled."""

        def take_answer(answer: Value | None) -> None:
            if answer is not None:
                then(answer)

        self.push_screen(question, take_answer)

    def ask_yes_no(self, title: str, text: str, then: Callable[[], object]) -> None:
        """Show a yes/no question; `then` runs after a yes."""
        self.ask_question(Confirm(title, text), lambda _yes: then())

    def explain_no_stop(self) -> str:
        """Return one line for the key bar in place of hold and STOP while no machine is
        connected."""
        return _("STOP: at machine") if self.is_disconnected else ""

    def show_notice(self, text: str) -> None:
        """Show a text in the key bar for `NOTICE_DURATION_S` seconds."""
        self.notice_text, self._notice_until_s = text, self.clock() + NOTICE_DURATION_S
        if self.page.is_mounted:
            self.page.show_keys()

    def read_for_page(self, work: Callable[[], Value], then: Callable[[Value], object]) -> None:
        """Read files in a thread before a question; `then` takes the result only if the page is
        still open. Errors are handled as in `run_with_files`."""
        page = self.page
        self.run_with_files(work, lambda found: then(found) if self.page is page else None)

    def run_with_files(
        self,
        work: Callable[[], Value],
        then: Callable[[Value], object],
        failed: Callable[[str], object] | None = None,
        *,
        group: str = "files",
        exclusive: bool = True,
    ) -> Worker[None]:
        """Run work on files or long work in a thread, so that a slow disk does not stop the screen.

        Parameters
        ----------
        work
            Function that runs in the thread. Long work polls `get_current_worker()` for
            cancellation.
        then
            Receives the result; a cancelled work calls nothing.
        failed
            Receives the first line of an error; None shows it in the key bar.
        group
            Name of the group of Textual workers.
        exclusive
            True: new work of the group cancels unfinished work of the group.
        """
        return self.run_worker(
            self._await_work(work, then, failed or self.show_notice),
            group=group,
            exclusive=exclusive,
            exit_on_error=False,
        )

    @staticmethod
    async def _await_work(
        work: Callable[[], Value], then: Callable[[Value], object], failed: Callable[[str], object]
    ) -> None:
        try:
            found = await asyncio.to_thread(work)
        # Every kind of error is caught, because nobody must wait for an answer that never comes.
        except Exception as error:
            failed((str(error).splitlines() or [type(error).__name__])[0])
        else:
            then(found)

    # The following methods connect to the worker, lose it and find it again.

    def _supervise_source(self) -> None:
        """Run the source's connection in a worker of its own, in place of the former source's."""
        if self._supervisor is not None:
            self._supervisor.cancel()
        self._supervisor = None
        if self.source is not None:
            self._supervisor = self.run_worker(
                self._run_source(self.source), group="source", exit_on_error=False
            )

    async def _run_source(self, source: FrameSource) -> None:
        if isinstance(source, Link) and not self.is_headless:
            source.shows = TerminalPulse(find_terminal())
        try:
            await source.run_connection()
        except WorkerFailed as error:
            self.not_started = str(error)
            self.exit()
        except WorkerGone as error:
            self._note_worker_lost(str(error))
        # A link that fails in any other way is as unusable as a lost worker.
        except Exception as error:
            self._note_worker_lost(f"{type(error).__name__}: {error}")

    @property
    def is_disconnected(self) -> bool:
        """Whether no order reaches a machine. A replay without a machine counts as connected,
        because it needs none."""
        return bool(self.gone) or (self.source is None and self.replay_page.job is None)

    def _note_worker_lost(self, why: str) -> None:
        """Record that the worker is lost and ask how to go on. An intended restart is no loss."""
        if self.gone or self._restarting:
            return
        self.gone = why or "gone"
        self._show_worker_lost(self.gone)

    def _show_worker_lost(self, why: str) -> None:
        self.page.refresh_all_next_tick()
        self.page.show_due(self.clock())
        if not isinstance(self.screen, WorkerLostScreen):
            self.push_screen(
                WorkerLostScreen(why, self.start is not None, self.attach is not None),
                self._reconnect_as_chosen,
            )

    def _reconnect_as_chosen(self, how: str | None) -> None:
        """Connect again in the way that the operator chose."""
        if how == "start" and self.joined is not None and self.joined.unused and self.joined.named:
            self._use_named_files(self.joined)
            return
        if how == "start" and self.services.job is not None:
            self.ask_to_resume_job(self.services.job)
            return
        self.connect_source({"start": self.start, "attach": self.attach}.get(how or ""))

    def connect_source(self, connect: Connector | None) -> None:
        """Connect to a new source; None stays without a source."""
        if connect is not None:
            self.show_notice(_("connecting to the machine"))
            self.run_worker(
                self._await_connection(connect),
                group="connect",
                exclusive=True,
                exit_on_error=False,
            )

    def ask_to_resume_job(self, service: JobService) -> None:
        """Ask whether to resume an interrupted job or begin a new job; without an interrupted job,
        start the machine."""
        self.run_with_files(service.find_offer, lambda offer: self._ask_about_offer(service, offer))

    def _ask_about_offer(self, service: JobService, offer: JobOffer | None) -> None:
        if offer is None:
            self.connect_source(self.start)
            return
        cut_off = offer

        def take_choice(value: str | None) -> None:
            if value == "resume":
                self.connect_source(lambda: service.resume_job(cut_off))
            elif value == "anew":
                self.connect_source(lambda: service.start_anew(cut_off))
            else:
                self.show_notice(explain_no_machine(self))

        self.push_screen(
            self.make_pass_question(
                offer,
                _("A job was left at {time}: {job}").format(
                    time=format_local_time(offer.saved_utc, self.utc_offset_s)[:5], job=offer.job
                ),
            ),
            take_choice,
        )

    def make_pass_question(self, offer: JobOffer, heading: str) -> ChoiceDialog:
        """Return the question whether to resume a job. Spreading on finished ground again is
        allowed only after this question."""
        resume = _("resume the job of {time} ({area} done)").format(
            time=format_local_time(offer.began_utc, self.utc_offset_s)[:5],
            area=self.units.area.format_with_name(offer.area_ha),
        )
        wanted = ", ".join(map(find_file_name, offer.others))
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

    def restart_source(self, start: Connector) -> None:
        """End the running worker and start a new worker."""

        async def end_and_start() -> None:
            # While the flag is set, the expected end of the old worker is not reported as a loss.
            self._restarting = True
            try:
                end = getattr(self.source, "stop_worker", None)
                if end is not None:
                    await end()
                await self._await_connection(start)
            except (OSError, TimeoutError) as error:
                self.show_notice(_("the machine cannot be changed over: {why}").format(why=error))
            finally:
                self._restarting = False

        self.show_notice(_(RESTART_NOTICE))
        self.run_worker(end_and_start(), group="connect", exclusive=True, exit_on_error=False)

    async def _await_connection(self, connect: Connector) -> None:
        """Await a new source and reset everything that belonged to the former machine."""
        try:
            self.source = await connect()
            if connect is self.attach:
                self.joined = JoinedMachineFacts()
                self.show_notice(_("joined the machine that runs already"))
            else:
                self.joined = None
        except (OSError, RuntimeError, ValueError) as error:
            if self._restarting:
                self.gone = str(error)
            self._show_worker_lost(str(error))
            return
        self.gone = ""
        if isinstance(self.screen, WorkerLostScreen):
            self.screen.dismiss(None)
        self.arrival, self.alarm_history = FrameArrival(), AlarmHistory()
        self.history = LiveHistory()
        self._earlier_log_path = ""
        self._frame_before = None
        self.undo.forget_changes()
        self._supervise_source()
        self.page.refresh_all_next_tick()

    def give_order(self, do: Do, value: str | float | bool | None = None) -> None:
        """Give one order, as `give_orders` does."""
        self.give_orders(Order(do, value))

    def give_orders(
        self,
        *orders: Order,
        also_back: Callable[[], None] = lambda: None,
        dose_is_asked: bool = False,
    ) -> None:
        """Send orders that form one change, in sequence; the first refusal or missing answer is
        shown and ends the sequence.

        Accepted orders become the newest change that can be undone.

        Parameters
        ----------
        orders
            Orders to send, in order of sending.
        also_back
            Runs when the change is undone.
        dose_is_asked
            True if the operator has already confirmed the dose; otherwise a large change of dose is
            asked here.
        """
        if self.source is None:
            self.show_notice(_("no machine is connected"))
            return
        # The question comes before the first order: half of a change must not reach the machine.
        change = None if dose_is_asked else predict_dose_change(self.arrival.frame, orders)
        if change is not None and change.is_large:
            self.ask_yes_no(
                change.format_question(self.units),
                change.format_change(self.units),
                lambda: self.give_orders(*orders, also_back=also_back, dose_is_asked=True),
            )
            return
        self.run_worker(
            self._send_orders_in_turn(orders, self.arrival.frame, also_back),
            group="orders",
            exit_on_error=False,
        )

    async def _send_orders_in_turn(
        self, orders: tuple[Order, ...], before: Frame | None, also_back: Callable[[], None]
    ) -> None:
        followed: list[Order] = []
        for order in orders:
            if not (await self.ask_source(partial(_send_to_source, order), do=order.do)).accepted:
                break
            followed.append(order)
        # Only accepted orders are reversed; the frame from before has the former values.
        back = reverse_orders(followed, before)
        if back:

            def undo_change() -> None:
                self.run_worker(
                    self._send_orders_in_turn(back, None, also_back),
                    group="orders",
                    exit_on_error=False,
                )
                also_back()

            self.undo.add_change(UndoableChange(describe_undo(back, self.units), undo_change, back))

    async def ask_source(
        self,
        ask: Callable[[FrameSource], Awaitable[Answer]],
        quiet: bool = False,
        do: Do | None = None,
    ) -> Answer:
        """Send a request to the source; show a refusal or a missing answer in the key bar unless
        `quiet`.

        Parameters
        ----------
        ask
            Function that sends the request.
        quiet
            True: show nothing.
        do
            Kind of order. Where the machine's state forbids the order, the notice names the key
            that must come first.

        Returns
        -------
        Answer
            The worker's answer; without a connection `why` is "gone", "no_answer" or "no_machine".
        """
        if self.source is None:
            return self._show_refusal(Answer(False, "no_machine"), quiet)
        try:
            answer = await ask(self.source)
        except WorkerGone as error:
            self._note_worker_lost(str(error))
            if not quiet:
                self.ask_connection()
            return Answer(False, "gone")
        except (TimeoutError, OSError):
            return self._show_refusal(Answer(False, "no_answer"), quiet)
        return answer if answer.accepted else self._show_refusal(answer, quiet, do)

    def _show_refusal(self, answer: Answer, quiet: bool, do: Do | None = None) -> Answer:
        if not quiet:
            frame = self.arrival.frame
            said = frame_words.describe_refusal(
                answer.why, frame.alarms if frame is not None else ()
            )
            wanted = None if do is None else STATE_AFTER_ORDER.get(do)
            name, _mark, state = answer.why.partition(";state=")
            first = (
                find_first_key(self, wanted, state)
                if wanted is not None and name == "not_from_state"
                else ""
            )
            if first:
                said = f"{said} {_('Press {key} first.').format(key=first)}"
            self.show_notice(
                said if answer.why == "no_answer" else _("refused: {why}").format(why=said)
            )
        return answer

    def find_shown_key(self, name: str) -> str:
        """Return the key of an action as the key bar prints it."""
        return actions.find_shown_key(actions.BY_ID[name])

    # The following methods perform the actions of the table.

    async def action_do(self, name: str) -> None:
        """Perform an action of the table if it belongs to this screen and the keys are not
        locked."""
        action, before = actions.BY_ID[name], self.screen
        if action.where not in (ANYWHERE, self.page.where):
            return
        why = (
            _("locked: F8 unlocks; hold and stop work")
            if self.locked and not action.locked
            else self.explain_not_now(action, judged=action.judged)
        )
        if why:
            self.show_notice(why)
        # Without a connection STOP leads to the connection dialog: an operator who presses it must
        # not believe that the machine stops.
        elif name in URGENT_ACTIONS and self.is_disconnected:
            self.ask_connection()
        elif action.where == ANYWHERE:
            action.do(self)
        else:
            self.page.perform_action(action)
        # The question was refused, so the characters that the operator types next belong to no
        # field.
        if action.asks and self.screen is before is self.page:
            self.type_ahead_guard.note_refusal(action.asks, self.clock())

    def explain_not_now(self, action: Action, judged: bool = False) -> str:
        """Return why an action is impossible now, in one line; "" where it is possible or unknown.

        Parameters
        ----------
        action
            Action of the table.
        judged
            True: skip the local check, because a connected worker decides.
        """
        why = explain_no_machine(self) if action.needs_machine else ""
        if why or judged or action.why is None:
            return why
        return action.why(self if action.where == ANYWHERE else self.pages[action.where])

    def turn_to_page(self, where: str) -> None:
        """Open a page. The app's default page lies at the bottom of the stack, and any other page
        lies on it."""
        page = self.pages[where]
        while not isinstance(self.screen, Page):
            self.pop_screen()
        if self.page is page:
            return
        if len(self.screen_stack) > 1:
            self.pop_screen()
        if self.page is not page:
            self.push_screen(page)
        page.refresh_all_next_tick()
        # Without this call the page shows its former contents for a moment.
        if page.is_mounted:
            self.show_newest()
        self.call_after_refresh(self.show_newest)

    def lock_keys(self, locked: bool) -> None:
        """Lock or unlock the keys."""
        self.locked = locked
        self.show_changes()

    def show_changes(self) -> None:
        """Refresh every panel at once, after a change."""
        self.page.refresh_all_next_tick()
        self.show_newest()

    def ask_connection(self) -> None:
        """Ask how to connect where no worker is reachable; otherwise report the state of the
        connection."""
        if self._restarting:
            self.show_notice(_(RESTART_NOTICE))
        elif self.gone:
            self._show_worker_lost(self.gone)
        elif self.source is None and (self.start or self.attach):
            self._show_worker_lost(_("no machine is connected"))
        else:
            self.show_notice(
                _("no machine is connected")
                if self.source is None
                else _("the machine is connected")
            )

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Yield the commands of the palette, with the reason where an action is impossible now."""
        yield SystemCommand(
            _("who is at this machine"),
            _("All consoles and tablets, and who ordered what."),
            self.action_company,
        )
        for action in self.list_offered_actions(self.page.where):
            if action.id != "palette":
                why = self.explain_not_now(action)
                said = _("not now: {why}").format(why=why) if why else _(action.help)
                yield SystemCommand(
                    _(action.label), f"{action.shown}  {said}", partial(self.action_do, action.id)
                )
