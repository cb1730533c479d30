"""Who is attached to the control worker, and who gave which order? The module has the names of
consoles, their events in the log, and their part of a frame. It is pure except for `find_own_name`.

Events: `attached NAME, console` (or `tablet`; `, looks only` for a console without the right to
order), `left NAME`, `silent NAME` (the console no longer keeps the machine working), `heard NAME`
(it does again). Every order is followed by the same word with `_by`: `nudge 5.0;nudge_by ann@cab
pts/3`.
"""

from __future__ import annotations

import contextlib
import getpass
import os
import socket
from collections.abc import Collection, Iterator
from typing import NamedTuple

# Longest name: two names and an order fit into 80 columns, cut where needed.
MAX_NAME_CHARACTERS = 32
NAME_VARIABLE = "TOPDRESS_NAME"
# Name of a console that sends no name.
DEFAULT_NAME = "console"
# Number of orders in a frame: a dialog of 24 rows can show them.
MAX_LATEST_ORDERS = 8


class AttachedConsole(NamedTuple):
    """Describes an attached console. `orders` tells whether it has sent the token, `keeps` whether
    it sent a sign of life within 2 s, so that the machine continues."""

    name: str
    tablet: bool = False
    orders: bool = True
    keeps: bool = False


class ExecutedOrder(NamedTuple):
    """Describes an order that was executed. `time_s` is the time of its row in the log."""

    do: str
    value: str
    name: str
    time_s: float


def clean_name(name: object) -> str:
    """Returns a name that breaks neither an event of the log nor a line of the screen; empty where
    no printable character remains."""
    text = name if isinstance(name, str) else ""
    plain = "".join(
        one if one.isprintable() and one not in ';,"' else " "
        for one in text[: 10 * MAX_NAME_CHARACTERS]
    )
    return " ".join(plain.split())[:MAX_NAME_CHARACTERS].strip()


def make_unique_name(name: str, others: Collection[str]) -> str:
    """Returns the name, with a number appended where another console has it."""
    if name not in others:
        return name
    found = (f"{name[: MAX_NAME_CHARACTERS - 4]} #{number}" for number in range(2, len(others) + 3))
    return next(one for one in found if one not in others)


def find_own_name(given: str | None = None) -> str:
    """Returns the name of this console: `given`, else the environment variable TOPDRESS_NAME, else
    user, computer and terminal: `ann@cab pts/3`."""
    return (
        clean_name(given)
        or clean_name(os.environ.get(NAME_VARIABLE))
        or clean_name(f"{_find_user_name()}@{_find_host_name()} {_find_terminal_name()}")
    )


def _find_user_name() -> str:
    try:
        return getpass.getuser()
    # Some users have no name in the system's list.
    except (OSError, KeyError, ImportError):
        return "user"


def _find_host_name() -> str:
    return socket.gethostname().split(".")[0]


def _find_terminal_name() -> str:
    for number in (0, 1, 2):
        # Windows has no names of terminals.
        with contextlib.suppress(OSError, AttributeError):
            return os.ttyname(number).removeprefix("/dev/")
    return ""


def format_attached_event(one: AttachedConsole) -> str:
    """Returns the log's event for a console that attaches."""
    kind = "tablet" if one.tablet else "console"
    return f"attached {one.name}, {kind}{'' if one.orders else ', looks only'}"


def read_orders(events: str | None, time_s: float) -> Iterator[ExecutedOrder]:
    """Returns the orders in a cell of events, with the name of the console that gave each; an order
    without a name is omitted."""
    values: dict[str, str] = {}
    for event in (events or "").split(";"):
        word, _blank, value = event.strip().partition(" ")
        do = word.removesuffix("_by")
        if word != do and do in values:
            yield ExecutedOrder(do, values.pop(do), value, time_s)
        else:
            values[word] = value
