"""The control worker is gone: said at once and big, with what to do."""
from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.widgets import Button, Static

from console.app.dialogs import Dialog
from console.locale import _


class GoneScreen(Dialog[str | None]):
    """Dismissed with "start", "attach", or None: go on looking at the last values."""

    BINDINGS: ClassVar = [Binding("1", "choose_at(0)", show=False), Binding("2", "choose_at(1)", show=False)]

    def __init__(self, why: str, can_start: bool, can_attach: bool) -> None:
        super().__init__(f"✖  {_('THE CONTROL WORKER IS GONE')}", why)
        self.can = {"start": can_start, "attach": can_attach}
        self.offered = [name for name, there in self.can.items() if there]      # by their digits, from 1
        self.add_class("gone")

    def body(self) -> ComposeResult:
        yield Static(_("No order reaches the machine from here. Drives stop by themselves after about a second; "
                       "use the hard-wired stop if they do not."), classes="dialog-text", markup=False)

    def buttons(self) -> ComposeResult:
        words = {"start": _("start it again"), "attach": _("attach to one that runs")}
        for digit, name in enumerate(self.offered, 1):
            yield Button(f"{digit}  {words[name]}", id=name, classes="dialog-button")
        yield Button(f"Esc  {_('look at the last values')}", id="cancel", classes="dialog-button")

    def action_choose_at(self, at: int) -> None:
        if at < len(self.offered):
            self.dismiss(self.offered[at])

    def action_choose(self, what: str) -> None:
        if self.can[what]:
            self.dismiss(what)

    def action_yes(self) -> None:
        """Enter does nothing here: what is done must be chosen."""

    def on_button_pressed(self, event: Button.Pressed) -> None:
        if event.button.id in self.can:
            event.stop()
            self.action_choose(event.button.id)
