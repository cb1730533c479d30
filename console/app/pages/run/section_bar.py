"""One line on the Run page of a machine whose sections have valves: which are open, and why the
others are not."""

from __future__ import annotations

from itertools import groupby

from textual import events
from textual.content import Content
from topdress.console.app import words
from topdress.console.app.dialogs import Choice
from topdress.console.app.widgets.panel import Panel, TextPart, make_line
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import SectionState

ALL_AUTO_ORDER = "all auto"


class SectionBar(Panel[tuple[SectionState, ...]]):
    """Shows the sections; hidden by the page where the machine has no valves. A click asks which to
    close by hand."""

    def draw_rows(self, view: tuple[SectionState, ...], width: int, height: int) -> list[Content]:
        return [make_line(*list_section_parts(view))]

    async def on_click(self, event: events.Click) -> None:
        """Ask which section to close."""
        event.stop()
        await self.app.run_action("do('allow')")


def list_section_parts(sections: tuple[SectionState, ...]) -> list[TextPart]:
    """Neighbours in the same state together."""
    found: list[TextPart] = [(" " + _("sections"), "$text-muted")]
    first = 1
    for state, group in groupby(sections):
        last = first + len(list(group)) - 1
        numbers = f"{first}" if last == first else f"{first}-{last}"
        word = _("open") if state.open else _(words.SECTION_NAMES.get(state.why, state.why))
        style = "$success" if state.open else "$warning" if state.why == "hand" else "$text-muted"
        found.append((f"   {numbers} {word}", style))
        first = last + 1
    return found


def list_section_choices(frame: Frame | None) -> tuple[Choice, ...]:
    """A line for each section, with the values of the order; each turns a section into its
    opposite, the last gives all back."""
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
