"""Every action once. Bindings, key bar, help and palette are read off this table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from topdress.console.app import keys as common
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
# of the key of STOP, while no machine is connected
CONNECT_LABEL = N_("connect")
CONNECT_HELP = N_("Asks how to connect: STOP is the hard-wired one until then.")
# key of what stands in a page's menu, before its digit: no terminal sends it
_MENU_PREFIX = "q_"
# action -> key as it is shown, where the user's keymap has another one
_remapped: dict[str, str] = {}
BY_ID = {action.id: action for action in ACTIONS}


def remap_actions(keymap: Mapping[str, str]) -> None:
    """Show these actions with these keys from now on, all others with their own."""
    _remapped.clear()
    _remapped.update(
        {name: format_key(keys.split(",")[0].strip()) for name, keys in keymap.items()}
    )


def format_key(key: str) -> str:
    """A key as it is written on a keyboard, as short as the key bar wants it."""
    if key.startswith(_MENU_PREFIX):
        return _remapped.get("menu", "Q") + key.removeprefix(_MENU_PREFIX)
    *held, last = key.split("+")
    last = _KEY_NAMES.get(last, last.removeprefix("kp_"))
    return "".join(
        {"ctrl": "^", "shift": "S-", "alt": "A-"}.get(one, f"{one}+") for one in held
    ) + (last.upper() if len(last) == 1 else last[:1].upper() + last[1:])


def list_page_actions(where: str) -> tuple[Action, ...]:
    """The actions of one screen: its own and those of every screen."""
    found = [action for action in ACTIONS if action.where in (ANYWHERE, where)]
    own_start = any(action.id in ("start", "job_start") for action in found)
    # where the page has an S of its own ^S is not on the bar
    as_here: dict[str, dict[str, Any]] = {
        "start_anywhere": {"bar": 0} if own_start else {"label": BY_ID["start"].label}
    }
    return tuple(
        action._replace(shown=find_shown_key(action), **as_here.get(action.id, {}))
        for action in found
        if action.id != "menu" or list_menu_actions(where)
    )


def drop_machine_actions(shown: tuple[Action, ...]) -> tuple[Action, ...]:
    """The actions while no machine is connected: without hold, and the key of STOP connects."""
    return tuple(
        action._replace(label=CONNECT_LABEL, help=CONNECT_HELP) if action.id == "stop" else action
        for action in shown
        if action.id != "hold"
    )


def find_shown_key(action: Action) -> str:
    """The key as bars, help and menu show it: the user's, else its own."""
    if action.keys.startswith(_MENU_PREFIX) and action.id not in _remapped:
        return format_key(action.keys)
    return _remapped.get(action.id, action.shown)


def list_menu_actions(where: str) -> tuple[Action, ...]:
    """The actions in the page's menu, in the order of its digits: seventy actions are more than
    there are letters."""
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
    """Every key that has an action on this screen, the user's in place of the built-in ones."""
    return frozenset(
        key for action in list_page_actions(where) for key in find_keys(action, keymap)
    )


def find_keys(action: Action, keymap: Mapping[str, str]) -> tuple[str, ...]:
    """The keys of an action, the user's in place of the built-in ones."""
    return tuple(key.strip() for key in keymap.get(action.id, action.keys).split(","))


def list_page_openers() -> tuple[Action, ...]:
    """The actions that open a page, in the order of the table."""
    return tuple(action for action in common.ACTIONS if action.id.endswith("_screen"))
