"""F1: what every key does, and what the signs mean."""
from __future__ import annotations

from typing import ClassVar

from rich.cells import cell_len
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Static

from console.app.action import Action
from console.app.widgets.panel import Part, fit
from console.locale import _


class HelpScreen(ModalScreen[None]):
    AUTO_FOCUS = "#help-scroll"
    BINDINGS: ClassVar = [Binding("escape,f1,enter", "close", show=False)]

    def __init__(self, shown: tuple[Action, ...]) -> None:
        super().__init__()
        self.shown = shown

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="help-scroll", classes="dialog wide"):
            yield Static(_("Keys of this screen"), classes="dialog-title", markup=False)
            yield Static(self._keys())
            yield Static(_("Signs"), classes="dialog-title", markup=False)
            yield Static("\n".join((
                _("Orange, ✖, ALARM: flow is stopped or about to be; acknowledge it.  Blue, !, CAUTION: work goes on."),
                _("Grey: older than 1 s.  --: not known.  The error bar is full at 30 %."),
                _("The console is not a safety part: the machine needs a hard-wired stop."),
            )), markup=False)
            yield Static(f"Esc  {_('close')}", classes="dialog-hint", markup=False)

    def _keys(self) -> Content:
        shown = self.shown
        width = max(cell_len(_(action.label)) for action in shown) + 3
        parts: list[Part] = []
        for action in shown:
            parts += [(fit(f" {action.shown}", 7), "bold $primary"), (fit(_(action.label), width), "bold"),
                      f"{_(action.help)}\n"]
        return Content.assemble(*parts)

    def action_close(self) -> None:
        self.dismiss(None)
