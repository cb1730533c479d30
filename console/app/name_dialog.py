"""A line of text is asked for: a file's name, a path."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.widgets import Input, Static
from topdress.console.app.dialogs import Dialog
from topdress.console.locale import _


class NameDialog(Dialog[str | None]):
    """Asks for a line of text. wrong: the fault of a text in one line, or "" when it will do.
    Ctrl+Space (hold) and F12 (stop) work as ever."""

    AUTO_FOCUS = "#name-input"
    BINDINGS: ClassVar = [Binding("escape", "cancel", show=False, priority=True)]

    def __init__(
        self, title: str, begin: str, text: str = "", wrong: Callable[[str], str] = lambda text: ""
    ) -> None:
        super().__init__(title, text)
        self.begin, self.wrong = begin, wrong
        self._up = False  # the field has the focus, or had it

    def take_early_key(self, event: events.Key) -> bool:
        """Take a character that is typed before the field is up as part of the name, not as hold or
        a letter's action; false for F12 and Ctrl+Space."""
        if self._up or event.key == "escape" or not (event.is_printable or event.key == "enter"):
            return False
        self.begin += event.character if event.is_printable and event.character else ""
        return True

    def compose_body(self) -> ComposeResult:
        yield Input(
            self.begin, id="name-input", classes="name-input", compact=True, select_on_focus=False
        )
        yield Static("", id="name-wrong", classes="dialog-value", markup=False)
        yield Static(
            _("Ctrl+Space holds, F12 stops, also while typing."),
            classes="dialog-hint",
            markup=False,
        )

    def on_mount(self) -> None:
        self.query_one("#name-wrong", Static).display = False
        field = self.query_one("#name-input", Input)
        field.value, field.cursor_position, self._up = self.begin, len(self.begin), True
        self.set_focus(field)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Answer with Enter."""
        event.stop()
        self.action_yes()

    def action_yes(self) -> None:
        """Answer with the text, if nothing is wrong with it."""
        typed = self.query_one("#name-input", Input).value.strip()
        wrong = self.wrong(typed)
        if typed and not wrong:
            self.dismiss(typed)
            return
        said = self.query_one("#name-wrong", Static)
        said.update(f"! {wrong}")
        said.set_class(bool(wrong), "-refused")
        said.display = bool(wrong)
