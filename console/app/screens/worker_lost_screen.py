"""Shows at once and in large letters that the control worker is lost, and how to proceed."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.widgets import Button, Static
from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.locale import _


class WorkerLostScreen(ChoiceDialog):
    """Asks how to proceed. The answer is "start", "attach", or None to stay with the last values.
    No entry is marked at first, so a typed-ahead Enter does nothing."""

    def __init__(self, why: str, can_start: bool, can_attach: bool) -> None:
        offered = (
            (can_start, Choice("start", _("start it again"))),
            (can_attach, Choice("attach", _("join the one that runs"))),
        )
        super().__init__(
            f"✖  {_('NO CONNECTION TO THE MACHINE')}",
            [one for there, one in offered if there],
            "",
            why,
            at=-1,
        )
        self.add_class("gone")

    def compose_body(self) -> ComposeResult:
        yield Static(
            _(
                "No order reaches the machine from here. Drives stop by themselves after "
                "about a second; "
                "use the hard-wired stop if they do not."
            ),
            classes="dialog-text",
            markup=False,
        )
        yield from super().compose_body()

    def compose_buttons(self) -> ComposeResult:
        if self.choices:
            yield Button(f"{_('Enter')}  {_('do it')}", id="yes", classes="dialog-button")
        yield Button(f"Esc  {_('look at the last values')}", id="cancel", classes="dialog-button")
