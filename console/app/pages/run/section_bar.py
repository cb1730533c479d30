"""Shows which sections with valves are open, and why the others are closed, in one line of the Run
page.
"""

from __future__ import annotations

from itertools import groupby

from textual import events
from textual.content import Content
from topdress.console.app import frame_words
from topdress.console.app.dialogs import Choice
from topdress.console.app.widgets.base_panel import Panel, TextPart, make_line
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import SectionState

# Value of the order that returns all sections to automatic control.
ALL_AUTO_ORDER = "all auto"


class SectionBar(Panel[tuple[SectionState, ...]]):
    """Shows the sections; the page hides the line for a machine without valves. A click asks which
    section to close by hand."""

    def draw_rows(self, view: tuple[SectionState, ...], width: int, height: int) -> list[Content]:
        return [make_line(*list_section_parts(view))]

    async def on_click(self, event: events.Click) -> None:
        """Ask which section to close."""
        event.stop()
        await self.app.run_action("do('allow')")


def list_section_parts(sections: tuple[SectionState, ...]) -> list[TextPart]:
    """Return the parts of the line; neighbouring sections in the same state are combined."""
    found: list[TextPart] = [(" " + _("sections"), "$text-muted")]
    first = 1
    for state, group in groupby(sections):
        last = first + len(list(group)) - 1
        numbers = f"{first}" if last == first else f"{first}-{last}"
        word = _("open") if state.open else _(frame_words.SECTION_NAMES.get(state.why, state.why))
        style = "$success" if state.open else "$warning" if state.why == "hand" else "$text-muted"
        found.append((f"   {numbers} {word}", style))
        first = last + 1
    return found


def list_section_choices(frame: Frame | None) -> tuple[Choice, ...]:
    """Return an entry per section, whose value is that of the order. Each entry reverses the
    section's state; the last entry returns all sections to automatic control."""
    states = frame.sections if frame is not None else ()
    found = [
        Choice(
            f"{k} {'auto' if state.why == 'hand' else 'off'}",
            (
                _("section {number}: closed by hand, give back")
                if state.why == "hand"
                else _("section {number}: close by hand")
            ).format(number=k),
        )
        for k, state in enumerate(states, start=1)
    ]
    return (
        *found,
        Choice(
            ALL_AUTO_ORDER,
            _("give all sections back"),
            "" if any(state.why == "hand" for state in states) else _("none is closed by hand"),
        ),
    )
