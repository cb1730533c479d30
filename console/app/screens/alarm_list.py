"""Shows all alarms of the run: first and last occurrence, number, acknowledgement, remedy."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Static
from topdress.console.app.alarms import AlarmEntry
from topdress.console.app.widgets.base_panel import TextPart
from topdress.console.locale import _
from topdress.control.orders import Severity


class AlarmList(ModalScreen[None]):
    """Shows all alarms of the run."""

    AUTO_FOCUS = "#alarm-scroll"
    BINDINGS: ClassVar = [
        Binding("escape,exclamation_mark,enter", "close", show=False),
        Binding("ctrl+y", "app.do('copy')", id="copy", show=False),
    ]

    def __init__(self, title: str, entries: tuple[AlarmEntry, ...]) -> None:
        super().__init__()
        self.heading, self.entries = title, entries

    @property
    def text(self) -> str:
        """Lines as plain text, for copying."""
        return self._format_entries().plain

    def compose(self) -> ComposeResult:
        """Yield the list."""
        with VerticalScroll(id="alarm-scroll", classes="dialog wide"):
            yield Static(self.heading, classes="dialog-title", markup=False)
            yield Static(
                self._format_entries() if self.entries else _("no alarm so far"), id="alarm-lines"
            )
            yield Static(f"Esc  {_('close')}", classes="dialog-hint", markup=False)

    def _format_entries(self) -> Content:
        """Return the lines of the alarms, with the style of each state."""
        parts: list[TextPart] = []
        for entry in self.entries:
            name = "red" if entry.severity is Severity.RED else "amber"
            style = (
                # A standing alarm without a cause is inverted: it waits for acknowledgement only.
                "bold $background on $foreground"
                if entry.gone
                else (f"bold $on-alarm-{name} on $alarm-{name}" if entry.stands else "bold")
            )
            place = f"{entry.place}: " if entry.place else ""
            parts += [
                (f" {entry.symbol} {entry.word} ", style),
                (f" {place}{entry.text}", "bold"),
                "\n",
            ]
            parts += [(f"     {entry.when}\n", "$muted")]
            if entry.todo:
                parts += [f"     {entry.todo}\n"]
        return Content.assemble(*parts)

    def action_close(self) -> None:
        """Close the list."""
        self.dismiss(None)

    def on_click(self) -> None:
        """Close the list."""
        self.dismiss(None)
