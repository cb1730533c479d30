"""The console in a browser's tab: it attaches to the worker that runs and only looks, until the
tablet's key is typed.

Two doors: what changes something is refused here in words, and the link is opened without the
worker's token, so that the worker refuses what slips through.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, ClassVar, Protocol

from textual.app import ComposeResult, SystemCommand
from textual.binding import Binding
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Input, Static
from topdress.console.app import actions
from topdress.console.app.action import (
    ANYWHERE,
    CALIBRATE,
    DIAGNOSIS,
    MAP,
    REPLAY,
    SETTINGS,
    TRENDS,
    Action,
)
from topdress.console.app.app import TopdressApp
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.source import FrameSource
from topdress.console.app.widgets.key_bar import URGENT_ACTIONS
from topdress.console.locale import N_, _

# pages that write files, closed while the tab only looks
WRITING_PAGES = frozenset({CALIBRATE, DIAGNOSIS, SETTINGS})
# pages whose own actions change nothing but the view
VIEW_ONLY_PAGES = frozenset({MAP, TRENDS, REPLAY})
VIEW_ONLY_ACTIONS = frozenset(
    {"help", "theme", "units", "language", "palette", "quit", "alarm_list", "menu"}
)
WAIT_S, MOST_WAIT_S = 1.0, 10.0  # after a wrong key; twice as long each time
RETRY_S = 0.2  # after a wait, until it is over on every clock

NONE_RUNS = N_("The console on the machine is not running: start it there, then join here.")

LinkMaker = Callable[[bool], Awaitable[FrameSource]]  # True: with the worker's token


class KeyWaits(Protocol):
    """Keeps the waits after wrong keys: seconds, and until when on the clock. One for all tabs of
    an address."""

    def take_lock(self) -> AbstractContextManager[KeyWaits | None]:
        """Hold the waits for this tab alone while a key is judged; None: another tab has them just
        now."""
        ...

    def read_wait(self) -> tuple[float, float]: ...
    def write_wait(self, wait_s: float, until_s: float) -> None: ...


class OwnKeyWaits:
    """Keeps the waits of one tab by itself."""

    def __init__(self) -> None:
        self._announced = 0.0, float("-inf")

    def take_lock(self) -> AbstractContextManager[KeyWaits | None]:
        return nullcontext(self)

    def read_wait(self) -> tuple[float, float]:
        return self._announced

    def write_wait(self, wait_s: float, until_s: float) -> None:
        self._announced = wait_s, until_s


class TabletKey:
    """Judges the tablet's key. text None: no key opens anything.

    A key that comes too soon is judged when the wait that it found is over, whatever else is typed
    at other tabs meanwhile: so no wrong keys of others keep the right one out for longer than
    `MOST_WAIT_S`.
    """

    def __init__(
        self, text: str | None, clock: Callable[[], float], waits: KeyWaits | None = None
    ) -> None:
        self._text, self._clock, self._waits = text, clock, waits or OwnKeyWaits()
        self._judged_s: float | None = None  # of the key that was typed too soon

    @property
    def wait_left_s(self) -> float | None:
        """Seconds until the typed key is judged; None: nothing waits."""
        return None if self._judged_s is None else max(0.0, self._judged_s - self._clock())

    @property
    def is_set(self) -> bool:
        """Whether there is a key."""
        return self._text is not None

    def find_fault(self, typed: str) -> str:
        """Why this does not open the machine, in one line; empty where it does."""
        if self._text is None:
            return _("There is no key: this server was started for viewing only.")
        with self._waits.take_lock() as waits:
            if waits is None:  # another tab's is judged just now
                self._judged_s = self._clock()
                return _("The last key was wrong: wait {seconds} s.").format(seconds=1)
            return self._judge_key(typed, self._text, waits)

    def _judge_key(self, typed: str, text: str, waits: KeyWaits) -> str:
        now_s = self._clock()
        wait_s, until_s = waits.read_wait()
        # more was reported by the clock of another day
        if self._judged_s is None and until_s - now_s <= MOST_WAIT_S:
            self._judged_s = until_s
        if self._judged_s is not None and self._judged_s > now_s:
            return _("The last key was wrong: wait {seconds} s.").format(
                seconds=int(self._judged_s - now_s) + 1
            )
        self._judged_s = None
        if hmac.compare_digest(typed.strip().encode(errors="replace"), text.encode()):
            waits.write_wait(0.0, now_s)
            return ""
        wait_s = min(MOST_WAIT_S, 2.0 * wait_s or WAIT_S)
        waits.write_wait(wait_s, now_s + wait_s)
        return _("This is not the tablet's key.")


class KeyDialog(NameDialog):
    """Asks for the key, hidden. A key that has to wait is tried again by itself."""

    def __init__(self, title: str, text: str, key: TabletKey) -> None:
        super().__init__(title, "", text, key.find_fault)
        self._key = key
        self._again: Timer | None = None

    def on_input_changed(self) -> None:
        """Stop the retry: the new text is tried when it is entered, no sooner."""
        if self._again is not None:
            self._again.stop()
            self._again = None

    def action_yes(self) -> None:
        """Try the key."""
        self.on_input_changed()
        super().action_yes()
        if self.is_attached and self._key.wait_left_s is not None:
            self._again = self.set_timer(self._key.wait_left_s + RETRY_S, self.action_yes)

    def compose_body(self) -> ComposeResult:
        yield Input("", password=True, id="name-input", classes="name-input", compact=True)
        yield Static("", id="name-wrong", classes="dialog-value", markup=False)


class TabletApp(TopdressApp):
    """Shows the console in a tab. link_to: a link to the worker that runs; its errors are one line
    (OSError, RuntimeError). key: see `TabletKey`."""

    BINDINGS: ClassVar = [Binding("asterisk", "tab_key", show=False)]
    keeps_working: ClassVar[bool] = False

    def __init__(
        self, source: FrameSource | None, link_to: LinkMaker, key: TabletKey, **options: Any
    ) -> None:
        self.looking = True
        self.key = key
        self._link_to = link_to
        super().__init__(source, attach=self._attach_tab, **options)
        self.add_class("-touch")

    async def _attach_tab(self) -> FrameSource:
        return await self._link_to(not self.looking)

    def on_mount(self) -> None:
        """After the parent's, which Textual calls by itself."""
        if self.source is None:
            self.call_after_refresh(self._note_gone, _(NONE_RUNS))

    def list_status_marks(self) -> tuple[str, ...]:
        return (_("VIEW ONLY"),) if self.looking else (_("TABLET"),)

    async def action_do(self, name: str) -> None:
        """Do an action, if this tab may."""
        if self.looking and name in URGENT_ACTIONS:
            self.show_notice(self.explain_no_stop())  # no question while the machine runs
        elif self.looking and not self.is_allowed(actions.BY_ID[name]):
            self.refuse_action()
        else:
            await super().action_do(name)

    def list_offered_actions(self, where: str) -> tuple[Action, ...]:
        """The actions; a tab that only looks shows nothing that it would refuse, STOP above all."""
        shown = super().list_offered_actions(where)
        return (
            tuple(action for action in shown if self.is_allowed(action)) if self.looking else shown
        )

    def explain_no_stop(self) -> str:
        return _("hold and STOP: at the machine") if self.looking else super().explain_no_stop()

    def is_allowed(self, action: Action) -> bool:
        """Whether a tab that only looks may do this."""
        if action.where == ANYWHERE:
            page = action.id.removesuffix("_screen")
            return (
                page not in WRITING_PAGES if page in self.pages else action.id in VIEW_ONLY_ACTIONS
            )
        return action.where in VIEW_ONLY_PAGES or action.id == "connect"

    def turn_to_page(self, where: str) -> None:
        if self.looking and where in WRITING_PAGES:
            self.refuse_action()
        else:
            super().turn_to_page(where)

    def refuse_action(self) -> None:
        """Report that nothing is changed from here; ask for the key, where there is one."""
        if self.key.is_set:
            self.action_tab_key()
        else:
            self.show_notice(_("view only: hold, stop and all else are at the machine's console"))

    def action_tab_key(self) -> None:
        """Ask for the key, which turns a tab that looks into one that operates."""
        if not self.looking:
            self.show_notice(_("this tab operates the machine"))
        elif not self.key.is_set:
            self.refuse_action()
        elif not isinstance(self.screen, KeyDialog):
            self.push_screen(
                KeyDialog(
                    _("This tab is for viewing only"),
                    _(
                        "The tablet's key lets it operate the machine. Hold and stop, too, "
                        "are at the machine's console until "
                        "then. Esc: go on looking."
                    ),
                    self.key,
                ),
                self._begin_operating,
            )

    def _begin_operating(self, typed: str | None) -> None:
        """Operate: the dialog is only left with a right key."""
        if typed is not None:
            self.looking = False
            self.page.refresh_all_next_tick()
            self.connect_source(self._attach_tab)

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        yield SystemCommand(_(KEY_LABEL), f"*  {_(KEY_HELP)}", self.action_tab_key)
        yield from super().get_system_commands(screen)


KEY_LABEL, KEY_HELP = N_("operate from this tab"), N_("Asks for the tablet's key.")
