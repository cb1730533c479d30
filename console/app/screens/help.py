"""F1: what every key does, and what the signs mean; a word typed after / leaves the lines that hold it."""
from __future__ import annotations

from typing import ClassVar

from rich.cells import cell_len
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from console.app.action import Action
from console.app.widgets.panel import Part, fit
from console.locale import _


class HelpScreen(ModalScreen[None]):
    AUTO_FOCUS = "#help-scroll"
    BINDINGS: ClassVar = [Binding("escape,f1,enter", "close", show=False), Binding("slash", "search", show=False)]

    def __init__(self, shown: tuple[Action, ...]) -> None:
        super().__init__()
        self.shown = shown

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="help-scroll", classes="dialog wide"):
            yield Static(_("Keys of this screen"), classes="dialog-title", markup=False)
            yield Input("", placeholder=_("/ searches"), id="help-search", classes="name-input", compact=True)
            yield Static(self._keys(), id="help-keys")
            yield Static(_("Signs"), classes="dialog-title", markup=False)
            yield Static("\n".join((
                _("Orange, ✖, ALARM: flow is stopped or about to be; acknowledge it.  Blue, !, CAUTION: work goes on."),
                _("Grey: older than 1 s.  --: not known.  The error bar is full at 30 %."),
                _("The console is not a safety part: the machine needs a hard-wired stop."),
            )), markup=False)
            yield Static(f"Esc  {_('close')}", classes="dialog-hint", markup=False)

    def action_search(self) -> None:
        self.query_one("#help-search", Input).focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        self.query_one("#help-keys", Static).update(self._keys(event.value))

    def on_input_submitted(self) -> None:
        """Enter ends the typing: letters are keys again, the lines stay."""
        self.query_one("#help-scroll").focus()

    def _keys(self, wanted: str = "") -> Content:
        """The lines that hold every word that is wanted, in key, name or what it does."""
        words = wanted.lower().split()
        shown = [action for action in self.shown
                 if all(word in f"{action.shown} {_(action.label)} {_(action.help)}".lower() for word in words)]
        if not shown:
            return Content(_("no key does this on this page"))
        width = max(cell_len(_(action.label)) for action in self.shown) + 3
        parts: list[Part] = []
        for action in shown:
            parts += [(fit(f" {action.shown}", 7), "bold $primary"), (fit(_(action.label), width), "bold"),
                      f"{_(action.help)}\n"]
        return Content.assemble(*parts)

    def action_close(self) -> None:
        self.dismiss(None)
