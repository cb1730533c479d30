"""Who is attached to the control worker, and who ordered what? Names, their events in the log, and
their part of a frame. Pure but for `find_own_name`.

Events: `attached NAME, console` (or `tablet`; `, looks only` where it may not order), `left NAME`,
`silent NAME` (it no longer keeps the machine working), `heard NAME` (it does again), and behind
every order the same word with `_by`: `nudge 5.0;nudge_by ann@cab pts/3`.
"""

from __future__ import annotations

import contextlib
import getpass
import os
import socket
from collections.abc import Collection, Iterator
from typing import NamedTuple

# two names and an order have room in 80 columns, cut at need
NAME_CHARACTERS = 32
NAME_VARIABLE = "TOPDRESS_NAME"
UNNAMED = "console"  # of one that says no name
# orders that a frame tells: a dialog of 24 rows holds them
LATEST = 8


class Attached(NamedTuple):
    """Describes an attached console. orders: whether it has shown the token. keeps: whether it said
    within 2 s that it lives, so that the machine goes on."""

    name: str
    tablet: bool = False
    orders: bool = True
    keeps: bool = False


class Ordered(NamedTuple):
    """Describes an order that was followed. time_s: of the log's row that has it."""

    do: str
    value: str
    name: str
    time_s: float


def clean_name(name: object) -> str:
    """A name that breaks neither an event of the log nor a line of the screen; empty where nothing
    printable remains."""
    text = name if isinstance(name, str) else ""
    plain = "".join(
        one if one.isprintable() and one not in ';,"' else " "
        for one in text[: 10 * NAME_CHARACTERS]
    )
    return " ".join(plain.split())[:NAME_CHARACTERS].strip()


def make_unique_name(name: str, others: Collection[str]) -> str:
    """The name, with a number behind it where another console has it."""
    if name not in others:
        return name
    found = (f"{name[: NAME_CHARACTERS - 4]} #{number}" for number in range(2, len(others) + 3))
    return next(one for one in found if one not in others)


def find_own_name(given: str | None = None) -> str:
    """The name that this console gives itself: as given, else as the environment variable
    TOPDRESS_NAME has it, else user, computer and terminal: `ann@cab pts/3`."""
    return (
        clean_name(given)
        or clean_name(os.environ.get(NAME_VARIABLE))
        or clean_name(f"{_find_user_name()}@{_find_host_name()} {_find_terminal_name()}")
    )


def _find_user_name() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a user without a name in the system's list
        return "user"


def _find_host_name() -> str:
    return socket.gethostname().split(".")[0]


def _find_terminal_name() -> str:
    for number in (0, 1, 2):
        with contextlib.suppress(OSError, AttributeError):  # Windows names none
            return os.ttyname(number).removeprefix("/dev/")
    return ""


def format_attached_event(one: Attached) -> str:
    """The log's event for a console that comes."""
    kind = "tablet" if one.tablet else "console"
    return f"attached {one.name}, {kind}{'' if one.orders else ', looks only'}"


def read_orders(events: str | None, time_s: float) -> Iterator[Ordered]:
    """The orders in a cell of events, with the name of the console that gave each; an order without
    a name is left out."""
    values: dict[str, str] = {}
    for event in (events or "").split(";"):
        word, _blank, value = event.strip().partition(" ")
        do = word.removesuffix("_by")
        if word != do and do in values:
            yield Ordered(do, values.pop(do), value, time_s)
        else:
            values[word] = value
