"""Declares one action of the console: its key, its words, its function and its screen."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from textual.binding import Binding, BindingType

# The value of `Action.where` for an action that every screen offers.
ANYWHERE = "anywhere"
RUN, MAP, TRENDS, DEVICES, CALIBRATE = "run", "map", "trends", "devices", "calibrate"
REPLAY, DIAGNOSIS, JOB, SETTINGS = "replay", "diagnosis", "job", "settings"


class Action(NamedTuple):
    """Describes an action of the table of `actions`.

    Attributes
    ----------
    id
        Name of the action, which is also its key in a user's keymap.
    keys
        Textual names of the keys, separated by commas.
    shown
        Key as bars and help print it.
    do
        Function that performs the action; its argument is the page, or the app where `where` is
        ANYWHERE.
    bar
        Position in the key bar from 1; 0 means that the key bar omits the action.
    locked
        True if the action still works while the keys are locked.
    why
        Function that returns the reason why the action is impossible now (one line), or "" where it
        is possible. It takes the argument of `do`.
    judged
        True if the action is attempted in spite of `why`: the worker decides, because its state is
        newer than the frame on the screen.
    asks
        "number" or "text" if the action opens a question into which the operator types.
    needs_machine
        True if the action sends something to the machine and is impossible without a connection.
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
    """Convert the actions to Textual bindings, whose ids a user's keymap refers to."""
    return [
        Binding(
            action.keys,
            f"app.do('{action.id}')",
            action.label,
            id=action.id,
            priority=action.priority,
            # Textual's own footer is not used: `widgets.key_bar` draws the keys.
            show=False,
        )
        for action in actions
    ]


def set_page(where: str, *actions: Action) -> tuple[Action, ...]:
    """Return the actions with `where` set to one page."""
    return tuple(action._replace(where=where) for action in actions)
