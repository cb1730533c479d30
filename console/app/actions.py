"""Lists every action once; bindings, key bar, help and palette are made from this table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from topdress.console.app import common_keys as common
from topdress.console.app.action import ANYWHERE, Action
from topdress.console.app.pages.calibrate import keys as calibrate
from topdress.console.app.pages.devices import keys as devices
from topdress.console.app.pages.diagnosis import keys as diagnosis
from topdress.console.app.pages.job import keys as job
from topdress.console.app.pages.map import keys as map
from topdress.console.app.pages.replay import keys as replay
from topdress.console.app.pages.run import keys as run
from topdress.console.app.pages.settings import keys as settings
from topdress.console.app.pages.trends import keys as trends
from topdress.console.locale import N_

# The order of this tuple is the order of help and palette: a page's own actions precede those of
# every screen.
ACTIONS: tuple[Action, ...] = (
    *run.ACTIONS,
    *devices.ACTIONS,
    *calibrate.ACTIONS,
    *replay.ACTIONS,
    *diagnosis.ACTIONS,
    *map.ACTIONS,
    *trends.ACTIONS,
    *job.ACTIONS,
    *settings.ACTIONS,
    *common.ACTIONS,
)
# Textual's names of keys, and the shorter forms that fit a key bar.
_KEY_NAMES = {
    "pageup": "PgUp",
    "pagedown": "PgDn",
    "plus": "+",
    "minus": "-",
    "comma": ",",
    "full_stop": ".",
    "left": "<",
    "right": ">",
    "up": "Up",
    "down": "Down",
    "equals_sign": "=",
    "slash": "/",
    "semicolon": ";",
    "exclamation_mark": "!",
    "apostrophe": "'",
    "left_square_bracket": "[",
    "right_square_bracket": "]",
    "delete": "Del",
    "backspace": "Bksp",
}
# While no machine is connected, the key of STOP carries these words: the console cannot stop a
# machine that it does not reach.
CONNECT_LABEL = N_("connect")
CONNECT_HELP = N_("Asks how to connect: STOP is the hard-wired one until then.")
# Textual names of menu entries are this prefix and a digit. No terminal sends such a key, so an
# entry is reachable through the menu only.
_MENU_PREFIX = "q_"
# Maps an action's id to the key to print, for actions that the user's keymap changes.
_remapped: dict[str, str] = {}
BY_ID = {action.id: action for action in ACTIONS}


def remap_actions(keymap: Mapping[str, str]) -> None:
    """Print the keys of this keymap from now on, and the built-in keys of all other actions."""
    _remapped.clear()
    _remapped.update(
        {name: format_key(keys.split(",")[0].strip()) for name, keys in keymap.items()}
    )


def format_key(key: str) -> str:
    """Return the name of a key in the short form that keyboards and the key bar use."""
    if key.startswith(_MENU_PREFIX):
        return _remapped.get("menu", "Q") + key.removeprefix(_MENU_PREFIX)
    *held, last = key.split("+")
    last = _KEY_NAMES.get(last, last.removeprefix("kp_"))
    return "".join(
        {"ctrl": "^", "shift": "S-", "alt": "A-"}.get(one, f"{one}+") for one in held
    ) + (last.upper() if len(last) == 1 else last[:1].upper() + last[1:])


def list_page_actions(where: str) -> tuple[Action, ...]:
    """Return the actions of one screen: its own and those of every screen."""
    found = [action for action in ACTIONS if action.where in (ANYWHERE, where)]
    own_start = any(action.id in ("start", "job_start") for action in found)
    # A page with a START key of its own does not show the general START key in its bar.
    as_here: dict[str, dict[str, Any]] = {
        "start_anywhere": {"bar": 0} if own_start else {"label": BY_ID["start"].label}
    }
    return tuple(
        action._replace(shown=find_shown_key(action), **as_here.get(action.id, {}))
        for action in found
        # A menu without an entry would open an empty list.
        if action.id != "menu" or list_menu_actions(where)
    )


def drop_machine_actions(shown: tuple[Action, ...]) -> tuple[Action, ...]:
    """Return the actions without hold, with STOP relabelled "connect": for a console without a
    machine."""
    return tuple(
        action._replace(label=CONNECT_LABEL, help=CONNECT_HELP) if action.id == "stop" else action
        for action in shown
        if action.id != "hold"
    )


def find_shown_key(action: Action) -> str:
    """Return an action's key as bars, help and menu print it, from the keymap first."""
    if action.keys.startswith(_MENU_PREFIX) and action.id not in _remapped:
        return format_key(action.keys)
    return _remapped.get(action.id, action.shown)


def list_menu_actions(where: str) -> tuple[Action, ...]:
    """Return the actions of the page's menu in the order of their digits. The menu exists because
    seventy actions exceed the letters of the alphabet."""
    return tuple(
        sorted(
            (
                action
                for action in ACTIONS
                if action.where == where and action.keys.startswith(_MENU_PREFIX)
            ),
            key=lambda action: action.keys,
        )
    )


def find_bound_keys(where: str, keymap: Mapping[str, str]) -> frozenset[str]:
    """Return every key that has an action on this screen, with the keymap's keys in place of the
    built-in keys."""
    return frozenset(
        key for action in list_page_actions(where) for key in find_keys(action, keymap)
    )


def find_keys(action: Action, keymap: Mapping[str, str]) -> tuple[str, ...]:
    """Return the keys of one action, from the keymap first."""
    return tuple(key.strip() for key in keymap.get(action.id, action.keys).split(","))


def list_page_openers() -> tuple[Action, ...]:
    """Return the actions that open a page, in the order of the table."""
    return tuple(action for action in common.ACTIONS if action.id.endswith("_screen"))
