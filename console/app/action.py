"""One action: its key, its words, what it does, and the screen that it belongs to."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from textual.binding import Binding, BindingType

ANYWHERE = "anywhere"
RUN, MAP, TRENDS, DEVICES, CALIBRATE = "run", "map", "trends", "devices", "calibrate"
REPLAY, DIAGNOSIS, JOB, SETTINGS = "replay", "diagnosis", "job", "settings"


class Action(NamedTuple):
    """Describes an action.

    id: also the key for a keymap. do: takes the page; that of an action of every screen takes the
    app. bar: place in the key bar, 0 = not there. locked: still works in lock mode. why: why it
    cannot be done now, one line, empty where it can; takes the argument of `do`. judged: it is
    tried all the same, for the worker has the last word, whose state is newer than the frame on the
    screen. asks: a "number" or a "text" is typed after it. needs_machine: it orders or asks
    something of the machine, and cannot be done without a connection.
    """

    id: str
    keys: str
    shown: str
    label: str
    help: str
    do: Callable[[Any], object]
    where: str = ANYWHERE
    bar: int = 0
    locked: bool = False
    priority: bool = False
    why: Callable[[Any], str] | None = None
    judged: bool = False
    asks: str = ""
    needs_machine: bool = False


def make_bindings(actions: Iterable[Action]) -> list[BindingType]:
    """The actions as Textual bindings, with their ids for a keymap."""
    return [
        Binding(
            action.keys,
            f"app.do('{action.id}')",
            action.label,
            id=action.id,
            priority=action.priority,
            show=False,
        )
        for action in actions
    ]


def set_page(where: str, *actions: Action) -> tuple[Action, ...]:
    """The actions, all on one page."""
    return tuple(action._replace(where=where) for action in actions)
