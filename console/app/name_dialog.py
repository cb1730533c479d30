"""Defines the dialog that asks for a line of text, such as a file name or path."""

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
    """Asks for a line of text. Ctrl+Space (hold) and F12 (STOP) still work.

    Parameters
    ----------
    begin
        Text in the field at first.
    wrong
        Returns the fault of a text in one line, "" for a valid text.
    """

    AUTO_FOCUS = "#name-input"
    # The priority lets Escape close the dialog although the text field has the focus.
    BINDINGS: ClassVar = [Binding("escape", "cancel", show=False, priority=True)]

    def __init__(
        self, title: str, begin: str, text: str = "", wrong: Callable[[str], str] = lambda text: ""
    ) -> None:
        super().__init__(title, text)
        self.initial_text, self.find_fault = begin, wrong
        # True once the text field has received the focus.
        self._field_is_focused = False

    def take_early_key(self, event: events.Key) -> bool:
        """Take a character that is typed before the field has the focus as part of the name.

        Returns
        -------
        bool
            False for keys that are no text, such as F12 and Ctrl+Space.
        """
        if (
            self._field_is_focused
            or event.key == "escape"
            or not (event.is_printable or event.key == "enter")
        ):
            return False
        self.initial_text += event.character if event.is_printable and event.character else ""
        return True

    def compose_body(self) -> ComposeResult:
        yield Input(
            self.initial_text,
            id="name-input",
            classes="name-input",
            compact=True,
            select_on_focus=False,
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
        # The value is set here again, because early keys have extended it since `compose_body`.
        field.value, field.cursor_position, self._field_is_focused = (
            self.initial_text,
            len(self.initial_text),
            True,
        )
        self.set_focus(field)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Answer with Enter."""
        event.stop()
        self.action_yes()

    def action_yes(self) -> None:
        """Answer with the text if it has no fault."""
        typed = self.query_one("#name-input", Input).value.strip()
        wrong = self.find_fault(typed)
        if typed and not wrong:
            self.dismiss(typed)
            return
        said = self.query_one("#name-wrong", Static)
        said.update(f"! {wrong}")
        said.set_class(bool(wrong), "-refused")
        said.display = bool(wrong)
