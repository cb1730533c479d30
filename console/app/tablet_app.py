"""Runs the console in a browser tab: it attaches to the running worker and is view-only until the
tablet's key is entered.

Two barriers protect the machine. This module refuses actions that change something. The link has no
token of the worker, so the worker refuses whatever this module misses.
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
from topdress.console.app.frame_source import FrameSource
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.widgets.key_bar import URGENT_ACTIONS
from topdress.console.locale import N_, _

# Pages that write files; a view-only tab cannot open them.
WRITING_PAGES = frozenset({CALIBRATE, DIAGNOSIS, SETTINGS})
# Pages whose own actions change the view only.
VIEW_ONLY_PAGES = frozenset({MAP, TRENDS, REPLAY})
# Actions of every page that change the view only.
VIEW_ONLY_ACTIONS = frozenset(
    {"help", "theme", "units", "language", "palette", "quit", "alarm_list", "menu"}
)
# Wait after a wrong key, s; it doubles with each wrong key up to the limit.
WRONG_KEY_WAIT_S, MAX_KEY_WAIT_S = 1.0, 10.0
# Margin after a wait, s, for clocks that differ slightly.
KEY_RETRY_MARGIN_S = 0.2

NO_MACHINE_TEXT = N_("The console on the machine is not running: start it there, then join here.")

# True opens the link with the worker's token.
LinkMaker = Callable[[bool], Awaitable[FrameSource]]


class KeyWaits(Protocol):
    """Stores the waits after wrong keys: duration, s, and end on the clock. All tabs of an address
    share one store."""

    def take_lock(self) -> AbstractContextManager[KeyWaits | None]:
        """Lock the waits for this tab while a key is checked; None means that another tab has the
        lock."""
        ...

    def read_wait(self) -> tuple[float, float]: ...
    def write_wait(self, wait_s: float, until_s: float) -> None: ...


class OwnKeyWaits:
    """Stores the waits of a single tab."""

    def __init__(self) -> None:
        self._announced = 0.0, float("-inf")

    def take_lock(self) -> AbstractContextManager[KeyWaits | None]:
        return nullcontext(self)

    def read_wait(self) -> tuple[float, float]:
        return self._announced

    def write_wait(self, wait_s: float, until_s: float) -> None:
        self._announced = wait_s, until_s


class TabletKey:
    """Checks the tablet's key. A text of None means that no key opens the machine.

    A key that comes too soon is checked when the wait that it found is over, whatever other tabs
    enter meanwhile. Wrong keys elsewhere therefore delay the right key by at most `MAX_KEY_WAIT_S`.
    """

    def __init__(
        self, text: str | None, clock: Callable[[], float], waits: KeyWaits | None = None
    ) -> None:
        self._text, self._clock, self._waits = text, clock, waits or OwnKeyWaits()
        # Time at which a key that came too soon is checked.
        self._judged_s: float | None = None

    @property
    def wait_left_s(self) -> float | None:
        """Seconds until the entered key is checked; None without a wait."""
        return None if self._judged_s is None else max(0.0, self._judged_s - self._clock())

    @property
    def is_set(self) -> bool:
        """Whether a key exists."""
        return self._text is not None

    def find_fault(self, typed: str) -> str:
        """Return why an entered key does not open the machine, in one line; "" if it does."""
        if self._text is None:
            return _("There is no key: this server was started for viewing only.")
        with self._waits.take_lock() as waits:
            # Another tab's key is being checked at this moment.
            if waits is None:
                self._judged_s = self._clock()
                return _("The last key was wrong: wait {seconds} s.").format(seconds=1)
            return self._check_key(typed, self._text, waits)

    def _check_key(self, typed: str, text: str, waits: KeyWaits) -> str:
        """Check a key under the lock."""
        now_s = self._clock()
        wait_s, until_s = waits.read_wait()
        # A longer wait was stored by a clock that has been changed since.
        if self._judged_s is None and until_s - now_s <= MAX_KEY_WAIT_S:
            self._judged_s = until_s
        if self._judged_s is not None and self._judged_s > now_s:
            return _("The last key was wrong: wait {seconds} s.").format(
                seconds=int(self._judged_s - now_s) + 1
            )
        self._judged_s = None
        # The comparison takes constant time, so its duration reveals nothing about the key.
        if hmac.compare_digest(typed.strip().encode(errors="replace"), text.encode()):
            waits.write_wait(0.0, now_s)
            return ""
        wait_s = min(MAX_KEY_WAIT_S, 2.0 * wait_s or WRONG_KEY_WAIT_S)
        waits.write_wait(wait_s, now_s + wait_s)
        return _("This is not the tablet's key.")


class KeyDialog(NameDialog):
    """Asks for the key, hidden. A key that has to wait is tried again automatically."""

    def __init__(self, title: str, text: str, key: TabletKey) -> None:
        super().__init__(title, "", text, key.find_fault)
        self._key = key
        self._again: Timer | None = None

    def on_input_changed(self) -> None:
        """Stop the automatic retry, because the text has changed."""
        if self._again is not None:
            self._again.stop()
            self._again = None

    def action_yes(self) -> None:
        """Try the key."""
        self.on_input_changed()
        super().action_yes()
        if self.is_attached and self._key.wait_left_s is not None:
            self._again = self.set_timer(
                self._key.wait_left_s + KEY_RETRY_MARGIN_S, self.action_yes
            )

    def compose_body(self) -> ComposeResult:
        yield Input("", password=True, id="name-input", classes="name-input", compact=True)
        yield Static("", id="name-wrong", classes="dialog-value", markup=False)


class TabletApp(TopdressApp):
    """Shows the console in a tab.

    Parameters
    ----------
    link_to
        Opens a link to the running worker; errors (OSError, RuntimeError) have one line.
    key
        Key of the tablet, see `TabletKey`.
    """

    BINDINGS: ClassVar = [Binding("asterisk", "tab_key", show=False)]
    keeps_working: ClassVar[bool] = False

    def __init__(
        self, source: FrameSource | None, link_to: LinkMaker, key: TabletKey, **options: Any
    ) -> None:
        self.is_view_only = True
        self.key = key
        self._link_to = link_to
        super().__init__(source, attach=self._attach_tab, **options)
        # Style sheets make keys larger for fingers.
        self.add_class("-touch")

    async def _attach_tab(self) -> FrameSource:
        """Attach to the running worker, with the token once the tab may operate."""
        return await self._link_to(not self.is_view_only)

    def on_mount(self) -> None:
        """Report that no machine runs. Textual also calls the base class's `on_mount`."""
        if self.source is None:
            self.call_after_refresh(self._note_worker_lost, _(NO_MACHINE_TEXT))

    def list_status_marks(self) -> tuple[str, ...]:
        return (_("VIEW ONLY"),) if self.is_view_only else (_("TABLET"),)

    async def action_do(self, name: str) -> None:
        """Perform an action if this tab is permitted to."""
        if self.is_view_only and name in URGENT_ACTIONS:
            # A question would cover the screen while the machine runs.
            self.show_notice(self.explain_no_stop())
        elif self.is_view_only and not self.is_allowed(actions.BY_ID[name]):
            self.refuse_action()
        else:
            await super().action_do(name)

    def list_offered_actions(self, where: str) -> tuple[Action, ...]:
        """Return the actions; a view-only tab offers none that it would refuse, above all not
        STOP."""
        shown = super().list_offered_actions(where)
        return (
            tuple(action for action in shown if self.is_allowed(action))
            if self.is_view_only
            else shown
        )

    def explain_no_stop(self) -> str:
        return (
            _("hold and STOP: at the machine") if self.is_view_only else super().explain_no_stop()
        )

    def is_allowed(self, action: Action) -> bool:
        """Return whether a view-only tab may perform this action."""
        if action.where == ANYWHERE:
            # Opening a page is an action of every screen.
            page = action.id.removesuffix("_screen")
            return (
                page not in WRITING_PAGES if page in self.pages else action.id in VIEW_ONLY_ACTIONS
            )
        return action.where in VIEW_ONLY_PAGES or action.id == "connect"

    def turn_to_page(self, where: str) -> None:
        if self.is_view_only and where in WRITING_PAGES:
            self.refuse_action()
        else:
            super().turn_to_page(where)

    def refuse_action(self) -> None:
        """Report that this tab changes nothing; ask for the key if a key exists."""
        if self.key.is_set:
            self.action_tab_key()
        else:
            self.show_notice(_("view only: hold, stop and all else are at the machine's console"))

    def action_tab_key(self) -> None:
        """Ask for the key, which lets a view-only tab operate the machine."""
        if not self.is_view_only:
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
        """Operate the machine; the dialog closes with a right key only."""
        if typed is not None:
            self.is_view_only = False
            self.page.refresh_all_next_tick()
            self.connect_source(self._attach_tab)

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        yield SystemCommand(_(KEY_LABEL), f"*  {_(KEY_HELP)}", self.action_tab_key)
        yield from super().get_system_commands(screen)


KEY_LABEL, KEY_HELP = N_("operate from this tab"), N_("Asks for the tablet's key.")
