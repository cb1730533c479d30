"""Defines the dialogs that ask before something changes: Enter accepts, Escape cancels; hold and
STOP work below them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar, cast

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Button, Static
from topdress.console.app.type_ahead_guard import MAX_TYPING_PAUSE_S
from topdress.console.app.widgets.base_panel import Picked
from topdress.console.app.widgets.choice_list import Choice as Choice
from topdress.console.app.widgets.choice_list import ChoiceList, ChoicesView
from topdress.console.locale import _

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp

Result = TypeVar("Result")
# Rows of a dialog's border and of the alarms and keys that remain visible around it.
DIALOG_FRAME_ROWS = 7


class Dialog(ModalScreen[Result], Generic[Result]):
    """Asks in a box in the middle of the screen; hold and STOP have priority over it.

    Textual calls `on_button_pressed` of every base class of a dialog, so each kind of dialog
    handles its own buttons only.
    """

    # No button has the focus: Enter must never press the button that happens to have it.
    AUTO_FOCUS = ""
    # Below 28 rows the style sheet leaves out margins.
    VERTICAL_BREAKPOINTS = [(0, "-few"), (28, "-enough")]
    BINDINGS: ClassVar = [
        Binding("escape", "cancel", show=False),
        Binding("enter", "yes", show=False),
        Binding("apostrophe", "app.do('jump')", id="jump", show=False),
        Binding("ctrl+y", "app.do('copy')", id="copy", show=False),
    ]

    def __init__(self, title: str, text: str = "") -> None:
        super().__init__()
        self.heading, self.text = title, text

    def compose(self) -> ComposeResult:
        """Yield title, body and buttons."""
        with Vertical(classes="dialog"):
            yield Static(self.heading, classes="dialog-title", markup=False)
            with VerticalScroll(classes="dialog-body", can_focus=False):
                if self.text:
                    yield Static(self.text, classes="dialog-text", markup=False)
                yield from self.compose_body()
            with Horizontal(classes="dialog-buttons"):
                yield from self.compose_buttons()

    def on_resize(self, event: events.Resize) -> None:
        """Limit the body to the rows that title and buttons leave, so that both stay visible at any
        height."""
        # A dialog without a body needs no limit.
        for box in self.query(".dialog-body"):
            around = sum(
                one.outer_size.height + one.styles.margin.height
                for one in self.query(".dialog-title, .dialog-buttons, .dialog > ChoiceList")
            )
            box.styles.max_height = max(1, event.size.height - around - DIALOG_FRAME_ROWS)

    def compose_body(self) -> ComposeResult:
        """Yield the widgets between text and buttons."""
        yield from ()

    def compose_buttons(self) -> ComposeResult:
        """Yield the dialog's buttons."""
        yield Button(f"{_('Enter')}  {self.describe_yes()}", id="yes", classes="dialog-button")
        yield Button(f"Esc  {_('cancel')}", id="cancel", classes="dialog-button")

    def describe_yes(self) -> str:
        """Return the word of the yes button."""
        return _("yes")

    def on_button_pressed(self, event: Button.Pressed) -> None:
        # Without this stop the handler of the base class would receive the press again.
        event.stop()
        if event.button.id == "yes":
            self.action_yes()
        elif event.button.id == "cancel":
            self.action_cancel()

    def action_cancel(self) -> None:
        """Close without an answer."""
        self.dismiss(None)

    def action_yes(self) -> None:
        """Answer yes."""
        raise NotImplementedError


class Confirm(Dialog[bool | None]):
    """Asks a question that only a yes answers."""

    def action_yes(self) -> None:
        """Answer yes."""
        self.dismiss(True)


class NudgeDialog(Dialog[float | None]):
    """Asks for a nudge of the target in steps of 5 %; one Enter confirms the sum of the steps."""

    BINDINGS: ClassVar = [
        Binding("plus,equals_sign,kp_plus,up", "step(1)", show=False),
        Binding("minus,kp_minus,down", "step(-1)", show=False),
        Binding("0,kp_0", "zero", show=False),
    ]
    # A nudge of more than 30 % suggests a wrong rate, which has a dialog of its own.
    STEP_PERCENT, LIMIT_PERCENT = 5, 30

    def __init__(self, now_percent: float, first: int) -> None:
        super().__init__(
            _("Nudge the target"), _("+ and - change, 0 takes it away, at most 30 % either way")
        )
        self.before = now_percent
        self.percent = now_percent
        # True after a typed digit. Numbers are not accepted here, so a 0 that follows must not
        # clear the nudge.
        self._is_number_started = False
        self.action_step(first)

    def compose_body(self) -> ComposeResult:
        yield Static(self._format_nudge(), classes="dialog-value", id="nudge-value", markup=False)

    def on_key(self, event: events.Key) -> None:
        """Refuse digits with an explanation, because the 0 of a typed `10` must not clear the
        nudge."""
        digit = event.character or event.key.removeprefix("kp_")
        if len(digit) == 1 and digit.isdecimal() and (digit != "0" or self._is_number_started):
            event.stop()
            self._is_number_started = True
            self._show_nudge(_("It goes in steps: + and - change it, a number is not typed here."))
        elif event.key in ("backspace", "delete"):
            self._is_number_started = False
            self._show_nudge()

    def _format_nudge(self) -> str:
        return f"{self.before:+.0f} %   >>>   {self.percent:+.0f} %"

    def action_step(self, steps: int) -> None:
        """Change the nudge by steps of 5 %."""
        # Steps add up, and one Enter confirms the sum.
        wanted = self.percent + steps * self.STEP_PERCENT
        self.percent = float(max(-self.LIMIT_PERCENT, min(self.LIMIT_PERCENT, wanted)))
        self._is_number_started = False
        self._show_nudge()

    def action_zero(self) -> None:
        """Set the nudge to zero."""
        self.percent = 0.0
        self._show_nudge()

    def _show_nudge(self, wrong: str = "") -> None:
        # The constructor calls the first step before any widget exists.
        if self.is_mounted:
            shown = self.query_one("#nudge-value", Static)
            shown.update(f"{self._format_nudge()}\n! {wrong}" if wrong else self._format_nudge())
            shown.set_class(bool(wrong), "-refused")

    def action_yes(self) -> None:
        """Answer with the nudge."""
        self.dismiss(self.percent)


class ChoiceDialog(Dialog[str | None]):
    """Asks for one entry of a list.

    Digits, arrows and clicks mark an entry; two digits typed in quick succession form one number.
    Only Enter accepts. A number without an entry is reported, and Enter accepts nothing until an
    entry is marked again.
    """

    BINDINGS: ClassVar = [
        Binding("up", "move(-1)", show=False),
        Binding("down", "move(1)", show=False),
        Binding("pageup", "go(-10)", show=False),
        Binding("pagedown", "go(10)", show=False),
        Binding("home", "go(-10_000)", show=False),
        Binding("end", "go(10_000)", show=False),
    ]

    def __init__(
        self, title: str, choices: Sequence[Choice], now: str, text: str = "", at: int | None = None
    ) -> None:
        """Create the dialog.

        Parameters
        ----------
        choices
            Entries of the list.
        now
            Value in force, which the list points out.
        at
            Index of the entry that is marked first; -1 marks none, None marks the value in force.
        """
        super().__init__(title, text)
        self.choices = tuple(choices)
        self.now = now
        # The value in force may be missing in the list.
        values = [choice.value for choice in self.choices]
        self.at = at if at is not None else values.index(now) if now in values else 0
        self._typed, self._typed_s, self._unknown_number = "", 0.0, ""

    def compose_body(self) -> ComposeResult:
        yield ChoiceList(self._make_view(), id="choices")

    def on_mount(self) -> None:
        self._show_mark()

    def on_resize(self, event: events.Resize) -> None:
        """Limit the list to the rows that the text leaves; the list scrolls by itself."""
        super().on_resize(event)
        # The heights are known only after Textual's layout.
        self.call_after_refresh(self._fit_list)

    def _fit_list(self) -> None:
        for box in self.query(".dialog-body"):
            rows = box.styles.max_height
            said = sum(
                one.outer_size.height + one.styles.margin.height
                for one in self.query(".dialog-text")
            )
            # Three rows keep the neighbours of the marked entry visible.
            self.query_one(ChoiceList).styles.max_height = max(
                3, int(rows.value if rows else 0) - said
            )

    def _make_view(self) -> ChoicesView:
        return ChoicesView(self.choices, self.at, self.now, self._unknown_number)

    def _show_mark(self) -> None:
        shown = self.query_one(ChoiceList)
        shown.show_view(self._make_view())
        shown.refresh(layout=True)

    def _mark_line(self, index: int) -> None:
        self.at, self._typed, self._unknown_number = index, "", ""
        self._show_mark()

    def action_move(self, by: int) -> None:
        """Move the mark by a number of entries; beyond an end it continues at the other end."""
        self._mark_line(
            (max(-1, self.at + by) if self.at < 0 else self.at + by) % len(self.choices)
        )

    def action_go(self, by: int) -> None:
        """Move the mark by a number of entries, at most to an end of the list."""
        self._mark_line(max(0, min(len(self.choices) - 1, self.at + by)))

    def on_key(self, event: events.Key) -> None:
        """Mark the entry whose number is typed."""
        # Keys of the numeric keypad have no character in the kitty protocol.
        digit = (
            event.key.removeprefix("kp_") if event.key.startswith("kp_") else event.character or ""
        )
        if len(digit) != 1 or not digit.isdecimal():
            return
        event.stop()
        now_s = cast("TopdressApp", self.app).clock()
        before = self._typed if now_s - self._typed_s < MAX_TYPING_PAUSE_S else ""
        # `int` converts digits of other scripts, which `isdecimal` admits.
        typed = (before + str(int(digit))).lstrip("0")
        if not typed:
            return
        if int(typed) <= len(self.choices):
            self._mark_line(int(typed) - 1)
            self._typed, self._typed_s = typed, now_s
        else:
            self._typed, self._unknown_number = "", typed
            self._show_mark()

    def on_picked(self, event: Picked) -> None:
        """Mark the clicked entry."""
        self._mark_line(event.index)

    def on_choice_list_wheeled(self, event: ChoiceList.Wheeled) -> None:
        """Move the mark with the mouse wheel."""
        self.action_go(event.lines)

    def action_yes(self) -> None:
        """Answer with the marked entry. An impossible entry shows its reason, and the dialog stays
        open."""
        self._typed = ""
        if self.at >= 0 and not self._unknown_number and not self.choices[self.at].why:
            self.dismiss(self.choices[self.at].value)


class TextDialog(Dialog[bool | None]):
    """Shows text in a scrollable box; Escape, Enter or the last line closes it."""

    AUTO_FOCUS = "#text-scroll"

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="text-scroll", classes="dialog wide"):
            yield Static(self.heading, classes="dialog-title", markup=False)
            yield Static(self.text, classes="dialog-text", markup=False)
            with Horizontal(classes="dialog-buttons"):
                yield Button(f"Esc  {_('close')}", id="cancel", classes="dialog-button")

    def action_yes(self) -> None:
        self.dismiss(None)
