"""One line on the Run page of a machine whose sections have valves: which are open, and why the
others are not."""

from __future__ import annotations

from itertools import groupby

from textual import events
from textual.content import Content
from topdress.console.app import words
from topdress.console.app.dialogs import Choice
from topdress.console.app.widgets.panel import Panel, Part, line
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import SectionState

GIVE_ALL_BACK = "all auto"


class SectionBar(Panel[tuple[SectionState, ...]]):
    """Hidden by the page where the machine has no valves. A click asks which to close by hand."""

    def lines(self, view: tuple[SectionState, ...], width: int, height: int) -> list[Content]:
        return [line(*section_parts(view))]

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.app.run_action("do('allow')")


def section_parts(sections: tuple[SectionState, ...]) -> list[Part]:
    """Neighbours that are alike together."""
    found: list[Part] = [(" " + _("sections"), "$text-muted")]
    first = 1
    for state, group in groupby(sections):
        last = first + len(list(group)) - 1
        numbers = f"{first}" if last == first else f"{first}-{last}"
        word = _("open") if state.open else _(words.SECTIONS.get(state.why, state.why))
        style = "$success" if state.open else "$warning" if state.why == "hand" else "$text-muted"
        found.append((f"   {numbers} {word}", style))
        first = last + 1
    return found


def section_choices(frame: Frame | None) -> tuple[Choice, ...]:
    """Values are those of the order; each line turns a section into its opposite, the last
    gives all back."""
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
            GIVE_ALL_BACK,
            _("give all sections back"),
            "" if any(state.why == "hand" for state in states) else _("none is closed by hand"),
        ),
    )
