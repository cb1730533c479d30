"""Every action once. Bindings, key bar, help and palette are read off this table."""
from __future__ import annotations

from textual.binding import Binding

from console.app.action import ANYWHERE, Action
from console.app.keys import common, replay, run

ACTIONS: tuple[Action, ...] = (*run.ACTIONS, *replay.ACTIONS, *common.ACTIONS)
BY_ID = {action.id: action for action in ACTIONS}


def bindings(where: str = ANYWHERE) -> list[Binding]:
    """The actions of every screen, or only those of one, as Textual bindings with their ids for a keymap."""
    return [Binding(action.keys, f"app.do('{action.id}')", action.label, id=action.id, priority=action.priority,
                    show=False) for action in ACTIONS if action.where == where]


def at(where: str) -> tuple[Action, ...]:
    """The actions of one screen: its own and those of every screen."""
    return tuple(action for action in ACTIONS if action.where in (ANYWHERE, where))


def pages() -> tuple[Action, ...]:
    """The actions that open a page, in the order of their F-keys."""
    found = (action for action in ACTIONS if action.where == ANYWHERE and action.id.endswith("_screen"))
    return tuple(sorted(found, key=lambda action: int(action.shown.removeprefix("F"))))
