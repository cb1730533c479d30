"""Shows letters over everything clickable; typing a letter clicks. Hold and STOP work meanwhile and
are never covered.
"""

from __future__ import annotations

import string
from collections.abc import Iterator, Mapping, Set
from itertools import islice, product
from typing import NamedTuple

from textual import events
from textual.app import ComposeResult
from textual.geometry import Offset
from textual.screen import ModalScreen, Screen
from textual.widget import Widget
from textual.widgets import Button, Input, Static
from topdress.console.app.action import ANYWHERE, CALIBRATE, DEVICES, RUN
from topdress.console.app.widgets.base_panel import Panel
from topdress.console.app.widgets.canvas import Canvas

# Pages whose letter keys start, stop or change something on the machine.
MACHINE_PAGES = (ANYWHERE, RUN, DEVICES, CALIBRATE)


def choose_label_letters(bound: Mapping[str, Set[str]]) -> str:
    """Return the letters and digits for labels: those without an action on any page of the machine,
    so that one letter too many does nothing.

    Parameters
    ----------
    bound
        Keys with an action, by page.
    """
    # Letters of pages that only change the view may be used.
    taken = frozenset[str]().union(*(bound[where] for where in MACHINE_PAGES))
    return "".join(one for one in string.ascii_lowercase + string.digits if one not in taken)


def make_jump_labels(count: int, of: str) -> tuple[str, ...]:
    """Return up to `count` labels of equal length, so that no label begins another."""
    # A keymap may use every letter.
    if not of:
        return ()
    length = 1
    # Three characters suffice for any screen, and nobody types more.
    while len(of) ** length < count and length < 3:
        length += 1
    return tuple("".join(one) for one in islice(product(of, repeat=length), count))


class ClickPlace(NamedTuple):
    """Holds a clickable position: widget, cell in the widget, cell on the screen."""

    widget: Widget
    at: Offset
    seen: Offset


def find_click_places(screen: Screen[object]) -> tuple[ClickPlace, ...]:
    """Return the visible clickable positions, from top left to bottom right."""
    found = (
        ClickPlace(widget, at, widget.content_region.offset + at)
        for widget, at in _iterate_clickable(screen)
    )
    seen = [
        one for one in found if screen.region.contains_point(one.seen) and _is_on_top(screen, one)
    ]
    return tuple(sorted(seen, key=lambda one: (one.seen.y, one.seen.x)))


def _iterate_clickable(screen: Screen[object]) -> Iterator[tuple[Widget, Offset]]:
    """Yield buttons, text fields, and the clickable cells of panels."""
    for widget in screen.query(Widget):
        # Textual's own widgets are clickable as a whole.
        if isinstance(widget, Button | Input):
            yield widget, Offset(0, 0)
        elif isinstance(widget, Panel | Canvas):
            for x, y in widget.list_click_places():
                yield widget, Offset(x, y)


def _is_on_top(screen: Screen[object], place: ClickPlace) -> bool:
    """Return whether the widget is visible at this position and not covered by another widget."""
    return bool(place.widget.region.area) and screen.get_widget_at(*place.seen)[0] is place.widget


def click_place(place: ClickPlace) -> None:
    """Perform the action of a click at a position."""
    # A button has no click handler of its own: pressing is its public function.
    if isinstance(place.widget, Button):
        place.widget.press()
    elif isinstance(place.widget, Input):
        place.widget.focus()
    else:
        place.widget.post_message(
            events.Click(
                place.widget,
                place.at.x,
                place.at.y,
                0,
                0,
                1,
                False,
                False,
                False,
                place.seen.x,
                place.seen.y,
            )
        )


class JumpScreen(ModalScreen[ClickPlace | None]):
    """Shows the letters; a key that begins no label closes the screen."""

    def __init__(self, places: tuple[ClickPlace, ...], labels: tuple[str, ...]) -> None:
        super().__init__()
        self.labelled = dict(zip(labels, places, strict=False))
        self.typed = ""

    def compose(self) -> ComposeResult:
        """Yield the labels."""
        for label, place in self.labelled.items():
            shown = Static(label.upper(), classes="jump-label", markup=False, name=label)
            shown.styles.offset = place.seen
            yield shown

    def on_key(self, event: events.Key) -> None:
        """Click the position whose label was typed."""
        event.stop()
        event.prevent_default()
        self.typed += (event.character or event.key).lower()
        if self.typed in self.labelled:
            self.dismiss(self.labelled[self.typed])
        elif not any(label.startswith(self.typed) for label in self.labelled):
            self.dismiss(None)
        else:
            # After the first character only matching labels remain visible.
            for shown in self.query(Static):
                shown.display = bool(shown.name and shown.name.startswith(self.typed))

    def on_click(self, event: events.Click) -> None:
        """Close the screen."""
        event.stop()
        self.dismiss(None)
