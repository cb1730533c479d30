"""Defines the only field of the console that accepts a number: by keys, from the pad on the screen,
or pasted.
"""

from __future__ import annotations

from collections.abc import Callable

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Button, Static
from topdress.console.app.dialogs import Confirm, Dialog
from topdress.console.app.typed_number import (
    MAX_NUMBER_CHARACTERS,
    TypedReading,
    format_number,
    read_in_range,
)
from topdress.console.locale import _


class NumberDialog(Dialog[float | None]):
    """Asks for a number and shows it while it is typed; the key that confirms shows the number that
    was read.

    Nothing typed is dropped silently: text that is no number or lies outside the range is refused
    in words.

    Parameters
    ----------
    unit
        Displayed unit.
    low, high
        Range in displayed units.
    to_si
        Converts the displayed number to the answer.
    typed
        Initial text; the first key replaces it.
    full
        Key, its word, and the number in displayed units that the key enters.
    doubt
        Returns an objection to a number in SI units, or "". An objection is confirmed in a second
        question.

    Notes
    -----
    The letter key that opened the dialog is ignored while nothing else is typed, because a key that
    stays down repeats.
    """

    # Layout of a telephone would have 1 at the top; this is the layout of a numeric keypad.
    PAD_KEYS = ("7", "8", "9", "4", "5", "6", "1", "2", "3", "0", ".", "C")

    def __init__(
        self,
        title: str,
        unit: str,
        low: float,
        high: float,
        text: str = "",
        to_si: Callable[[float], float] = lambda shown: shown,
        *,
        typed: str = "",
        doubt: Callable[[float], str] = lambda value: "",
        full: tuple[str, str, float] | None = None,
    ) -> None:
        super().__init__(title, text)
        self.unit, self.low, self.high, self.to_si, self.find_doubt = unit, low, high, to_si, doubt
        self.full = full
        self.typed = typed
        self._is_replaceable = bool(typed)

    @property
    def reading(self) -> TypedReading:
        """Number that was read from the text, with its fault."""
        return read_in_range(self.typed, self.low, self.high, self.unit)

    def compose_body(self) -> ComposeResult:
        yield Static(self._format_typed(), classes="dialog-value", id="number-value", markup=False)
        yield Static("", classes="dialog-value", id="number-wrong", markup=False)
        with Vertical(classes="pad"):
            for row in range(0, len(self.PAD_KEYS), 3):
                with Horizontal(classes="pad-row"):
                    for key in self.PAD_KEYS[row : row + 3]:
                        yield Button(key, name=key, classes="pad-key")

    def compose_buttons(self) -> ComposeResult:
        if self.full is not None:
            key, word, _value = self.full
            yield Button(f"{key}  {word}", id="full", classes="dialog-button")
        yield from super().compose_buttons()

    def _enter_full_value(self) -> None:
        """Enter the full number as if it were typed; range and objection apply to it as to any
        other number."""
        if self.full is not None:
            self.typed, self._is_replaceable = format_number(self.full[2]), True
            self._show_typed(asked=False)

    def on_mount(self) -> None:
        self.query_one("#number-wrong", Static).display = False

    def describe_yes(self) -> str:
        value = self.reading.value
        return (
            _("yes")
            if value is None
            else _("take {number} {unit}").format(number=format_number(value), unit=self.unit)
        )

    def _format_typed(self) -> str:
        allowed = _("allowed: {low} to {high} {unit}").format(
            low=f"{self.low:g}", high=f"{self.high:g}", unit=self.unit
        )
        return f"{self.typed or '_'} {self.unit}     {allowed}"

    def type_key(self, key: str) -> None:
        """Process a key: a character, "back" or "C"."""
        if key == "C":
            self.typed = ""
        elif key == "back":
            self.typed = self.typed[:-1]
        else:
            before = "" if self._is_replaceable else self.typed
            # One character more than any number has is kept, so that a text that is too long is
            # refused instead of cut.
            self.typed = (before + key)[: MAX_NUMBER_CHARACTERS + 1]
        self._is_replaceable = False
        self._show_typed(asked=False)

    def _show_typed(self, asked: bool) -> None:
        """Show text and fault.

        Parameters
        ----------
        asked
            True if the operator confirmed: then an incomplete number is a fault too.
        """
        reading = self.reading
        wrong = reading.why if asked or (self.typed and not reading.half) else ""
        self.query_one("#number-value", Static).update(self._format_typed())
        said = self.query_one("#number-wrong", Static)
        said.update(f"! {wrong}")
        said.set_class(bool(wrong), "-refused")
        said.display = bool(wrong)
        take = self.query_one("#yes", Button)
        take.label = f"{_('Enter')}  {self.describe_yes()}"
        # The button's width follows its new label.
        take.refresh(layout=True)

    def on_key(self, event: events.Key) -> None:
        """Type the key if it can belong to a number."""
        named = {"backspace": "back", "delete": "C", "kp_decimal": ".", "kp_separator": ","}.get(
            event.key, ""
        )
        number_key = event.key.removeprefix("kp_") if event.key.startswith("kp_") else ""
        key = named or (number_key if number_key.isdecimal() else event.character or "")
        # Full-width letters come from East Asian input methods.
        if key in ("c", "C", "ｃ", "Ｃ"):
            key = "C"
        if (
            self.full is not None
            and key.upper() == self.full[0]
            and (not self.typed or self._is_replaceable)
        ):
            event.stop()
            self._enter_full_value()
            return
        if (
            (not self.typed or self._is_replaceable)
            and key.isalpha()
            and event.key.lower() == getattr(self.app, "asked_by", "")
        ):
            # A letter key that opened the dialog and is still down.
            event.stop()
            return
        # The apostrophe is the key of the jump letters, which reach the buttons.
        if key and key != "'" and (named or (key.isprintable() and len(key) == 1)):
            event.stop()
            self.type_key(key)

    def on_paste(self, event: events.Paste) -> None:
        """Type the pasted characters."""
        event.stop()
        for character in event.text.strip():
            # Control characters become blanks, which the reader refuses, so that they are visible
            # as a fault.
            self.type_key(character if character.isprintable() else " ")

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Type the key of the pad."""
        if event.button.id == "full":
            event.stop()
            self._enter_full_value()
        if event.button.name in self.PAD_KEYS:
            event.stop()
            self.type_key(event.button.name)

    def action_yes(self) -> None:
        """Answer with the number if it has no fault; an objection is asked first."""
        value = self.reading.value
        if value is None:
            self._show_typed(asked=True)
            return
        taken = self.to_si(value)
        why = self.find_doubt(taken)
        if not why:
            self.dismiss(taken)
            return

        def take_answer(yes: bool | None) -> None:
            if yes:
                self.dismiss(taken)

        self.app.push_screen(
            Confirm(
                _("{number} {unit}: is that right?").format(
                    number=format_number(value), unit=self.unit
                ),
                why,
            ),
            take_answer,
        )
