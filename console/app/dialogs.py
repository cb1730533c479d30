"""What is asked before a dose changes: one question, Enter for yes, Escape for no. Hold and stop work underneath."""
from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Generic, NamedTuple, TypeVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Button, Static

from console.locale import _

R = TypeVar("R")
DIALOG_FRAME = 7          # rows of the border, and of alarms and keys that stay in sight


class Choice(NamedTuple):
    """why: why it cannot be taken now, and how it could be; empty where it can."""

    value: str
    label: str
    why: str = ""


class Dialog(ModalScreen[R], Generic[R]):
    """A box in the middle; hold and stop have priority over it.

    Textual calls `on_button_pressed` of every class in a dialog's line, so a kind of dialog only handles its own.
    """

    AUTO_FOCUS = ""
    VERTICAL_BREAKPOINTS = [(0, "-few"), (28, "-enough")]
    BINDINGS: ClassVar = [Binding("escape", "cancel", show=False), Binding("enter", "yes", show=False),
                          Binding("apostrophe", "app.do('jump')", id="jump", show=False)]

    def __init__(self, title: str, text: str = "") -> None:
        super().__init__()
        self.heading, self.text = title, text

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog"):
            yield Static(self.heading, classes="dialog-title", markup=False)
            with VerticalScroll(classes="dialog-body", can_focus=False):
                if self.text:
                    yield Static(self.text, classes="dialog-text", markup=False)
                yield from self.body()
            with Horizontal(classes="dialog-buttons"):
                yield from self.buttons()

    def on_resize(self, event: events.Resize) -> None:
        """The middle part has the rows that are left: title and keys stay in sight at any height."""
        for box in self.query(".dialog-body"):
            around = sum(one.outer_size.height + one.styles.margin.height for one in self.query(
                ".dialog-title, .dialog-buttons"))
            box.styles.max_height = max(1, event.size.height - around - DIALOG_FRAME)

    def body(self) -> ComposeResult:
        yield from ()

    def buttons(self) -> ComposeResult:
        yield Button(f"{_('Enter')}  {self.yes_label()}", id="yes", classes="dialog-button")
        yield Button(f"Esc  {_('cancel')}", id="cancel", classes="dialog-button")

    def yes_label(self) -> str:
        return _("yes")

    def on_button_pressed(self, event: Button.Pressed) -> None:
        event.stop()
        if event.button.id == "yes":
            self.action_yes()
        elif event.button.id == "cancel":
            self.action_cancel()

    def action_cancel(self) -> None:
        self.dismiss(None)

    def action_yes(self) -> None:
        raise NotImplementedError


class Confirm(Dialog[bool | None]):
    """Yes or nothing."""

    def action_yes(self) -> None:
        self.dismiss(True)


class NudgeDialog(Dialog[float | None]):
    """Steps of 5 % from where the nudge is; one Enter for all of them."""

    BINDINGS: ClassVar = [Binding("plus,equals_sign,kp_plus,up", "step(1)", show=False),
                          Binding("minus,kp_minus,down", "step(-1)", show=False),
                          Binding("0,kp_0", "zero", show=False)]
    STEP_PERCENT, LIMIT_PERCENT = 5, 30

    def __init__(self, now_percent: float, first: int) -> None:
        super().__init__(_("Nudge the target"), _("+ and - change, 0 takes it away, at most 30 % either way"))
        self.before = now_percent
        self.percent = now_percent
        self._typing = False            # a number was started, which is not how it is changed: its 0 is no 0
        self.action_step(first)

    def body(self) -> ComposeResult:
        yield Static(self._says(), classes="dialog-value", id="nudge-value", markup=False)

    def on_key(self, event: events.Key) -> None:
        """The 0 of a typed `10` must not take the nudge away: digits are refused, in words."""
        digit = event.character or event.key.removeprefix("kp_")
        if len(digit) == 1 and digit.isdecimal() and (digit != "0" or self._typing):
            event.stop()
            self._typing = True
            self._tell(_("It goes in steps: + and - change it, a number is not typed here."))
        elif event.key in ("backspace", "delete"):
            self._typing = False
            self._tell()

    def _says(self) -> str:
        return f"{self.before:+.0f} %   >>>   {self.percent:+.0f} %"

    def action_step(self, steps: int) -> None:
        wanted = self.percent + steps * self.STEP_PERCENT
        self.percent = float(max(-self.LIMIT_PERCENT, min(self.LIMIT_PERCENT, wanted)))
        self._typing = False
        self._tell()

    def action_zero(self) -> None:
        self.percent = 0.0
        self._tell()

    def _tell(self, wrong: str = "") -> None:
        if self.is_mounted:
            shown = self.query_one("#nudge-value", Static)
            shown.update(f"{self._says()}\n! {wrong}" if wrong else self._says())
            shown.set_class(bool(wrong), "-refused")

    def action_yes(self) -> None:
        self.dismiss(self.percent)


class ChoiceDialog(Dialog[str | None]):
    """One of a few: digit or arrows choose, Enter takes."""

    BINDINGS: ClassVar = [Binding("up", "move(-1)", show=False), Binding("down", "move(1)", show=False)]

    def __init__(self, title: str, choices: Sequence[Choice], now: str, text: str = "") -> None:
        super().__init__(title, text)
        self.choices = tuple(choices)
        self.now = now
        values = [choice.value for choice in self.choices]
        self.at = values.index(now) if now in values else 0

    def body(self) -> ComposeResult:
        for index in range(len(self.choices)):
            yield Button(self._line(index), id=f"choice-{index}", classes="dialog-choice")

    def on_mount(self) -> None:
        self._mark()

    def _line(self, index: int) -> str:
        choice = self.choices[index]
        now = f"  ({_('now')})" if choice.value == self.now else ""
        label = f"({choice.label}: {choice.why})" if choice.why else f"{choice.label}{now}"
        return f"{'>' if index == self.at else ' '} {index + 1}  {label}"

    def _mark(self) -> None:
        for index in range(len(self.choices)):
            button = self.query_one(f"#choice-{index}", Button)
            button.label = self._line(index)
            button.set_class(index == self.at, "-chosen")
            button.set_class(bool(self.choices[index].why), "-off")
            if index == self.at:
                button.scroll_visible(animate=False)

    def action_move(self, by: int) -> None:
        self.at = (self.at + by) % len(self.choices)
        self._mark()

    def on_key(self, event: events.Key) -> None:
        if event.character and event.character.isdigit() and 1 <= int(event.character) <= len(self.choices):
            event.stop()
            self.at = int(event.character) - 1
            self._mark()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        name = event.button.id or ""
        if name.startswith("choice-"):
            event.stop()
            self.at = int(name.removeprefix("choice-"))
            self._mark()

    def action_yes(self) -> None:
        """What cannot be taken now says why, and the question stays."""
        if not self.choices[self.at].why:
            self.dismiss(self.choices[self.at].value)


class TextDialog(Dialog[bool | None]):
    """Reads only: lines of text, scrolled where they are many; Escape, Enter or a click on the last line closes."""

    AUTO_FOCUS = "#text-scroll"

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="text-scroll", classes="dialog wide"):
            yield Static(self.heading, classes="dialog-title", markup=False)
            yield Static(self.text, classes="dialog-text", markup=False)
            with Horizontal(classes="dialog-buttons"):
                yield Button(f"Esc  {_('close')}", id="cancel", classes="dialog-button")

    def action_yes(self) -> None:
        self.dismiss(None)
