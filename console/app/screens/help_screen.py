"""Shows the keys of a screen, a glossary and the meaning of signs (F1). A word typed after /
selects the lines that contain it.
"""

from __future__ import annotations

from typing import ClassVar

from rich.cells import cell_len
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static
from topdress.console.app.action import Action
from topdress.console.app.widgets.base_panel import TextPart, fit_text_width
from topdress.console.locale import N_, _

# Terms of the pages that are unknown from bags and tractors, one line each.
GLOSSARY_LINES = (
    N_(
        "look-ahead: a change of the rate is ordered before its place, by as far as "
        "granules take to the ground."
    ),
    N_(
        "scale trim: 1.02 says that by the hopper scale 2 % more flows than by the machine "
        "file; it is allowed for."
    ),
    N_("nudge: so many percent more or less than the target, until it is taken away."),
    N_("fallback: the crop file's rate, where neither canopy nor map says one."),
    N_("headland: no work there; nothing is owed."),
    N_("set: what the shaft or the gate was commanded; the number above it is what it reads."),
    N_("max, under speed: faster, the heads see the crop too late for the granules."),
    N_("NDVI: how green and dense the canopy is, 0 bare soil to 1."),
    N_("CV: how uneven, in percent of the mean. C_uc: how even, 100 % is the same everywhere."),
    N_("N-rich strip: a strip that got enough nitrogen; the rule compares the field with it."),
    N_("adopt: write what was found into the machine file, so that the console allows for it."),
    N_(
        "what if: the log computed once more, as it would have been with another strategy, "
        "crop or machine."
    ),
)


class HelpScreen(ModalScreen[None]):
    """Shows the keys of a screen and a glossary."""

    AUTO_FOCUS = "#help-scroll"
    BINDINGS: ClassVar = [
        Binding("escape,f1,enter", "close", show=False),
        Binding("slash", "search", show=False),
    ]

    def __init__(self, shown: tuple[Action, ...]) -> None:
        super().__init__()
        # Only actions that the page offers are listed.
        self.shown = shown

    def compose(self) -> ComposeResult:
        """Yield the help."""
        with VerticalScroll(id="help-scroll", classes="dialog wide"):
            yield Static(_("Keys of this screen"), classes="dialog-title", markup=False)
            # The field has no focus at first, so that letters stay keys.
            yield Input(
                "",
                placeholder=_("/ searches"),
                id="help-search",
                classes="name-input",
                compact=True,
            )
            yield Static(self._format_key_lines(), id="help-keys")
            yield Static(_("Words"), classes="dialog-title", markup=False)
            yield Static("\n".join(map(_, GLOSSARY_LINES)), id="help-words", markup=False)
            yield Static(_("Signs"), classes="dialog-title", markup=False)
            yield Static(
                "\n".join(
                    (
                        _(
                            "Orange, ✖, ALARM: flow is stopped or about to be; acknowledge "
                            "it.  Blue, !, CAUTION: work goes on."
                        ),
                        _("Grey: older than 1 s.  --: not known.  The error bar is full at 30 %."),
                        _("The console is not a safety part: the machine needs a hard-wired stop."),
                    )
                ),
                markup=False,
            )
            yield Static(f"Esc  {_('close')}", classes="dialog-hint", markup=False)

    def action_search(self) -> None:
        """Move the focus to the search field."""
        self.query_one("#help-search", Input).focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Show the lines that contain the typed words."""
        self.query_one("#help-keys", Static).update(self._format_key_lines(event.value))

    def on_input_submitted(self) -> None:
        """End the search: letters are keys again, and the selected lines stay."""
        self.query_one("#help-scroll").focus()

    def _format_key_lines(self, wanted: str = "") -> Content:
        """Return the lines that contain every wanted word in key, name or description."""
        # Words may be typed in any order.
        words = wanted.lower().split()
        shown = [
            action
            for action in self.shown
            if all(
                word in f"{action.shown} {_(action.label)} {_(action.help)}".lower()
                for word in words
            )
        ]
        # An empty list would look like a fault.
        if not shown:
            return Content(_("no key does this on this page"))
        # The width of all actions, so that columns do not jump during a search.
        width = max(cell_len(_(action.label)) for action in self.shown) + 3
        parts: list[TextPart] = []
        for action in shown:
            parts += [
                (fit_text_width(f" {action.shown}", 7), "bold $primary"),
                (fit_text_width(_(action.label), width), "bold"),
                f"{_(action.help)}\n",
            ]
        return Content.assemble(*parts)

    def action_close(self) -> None:
        """Close the help."""
        self.dismiss(None)
