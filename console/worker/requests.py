"""What a client may send: one JSON object a line. Pure: bytes in, request or refusal out.

    {"id": 7, "token": "...", "do": "hold", "value": null}      an order (`control.orders`)
    {"id": 8, "token": "...", "ask": "alive" | "stats" | "quit" | "lag_test" | "end_lag_test"}
    {"id": 9, "token": "...", "device": "gnss", "act": "connect" | ...}  a device (`frame.DeviceDo`)
    {"id": 1, "token": null, "ask": "look", "name": "ann@cab pts/3", "tablet": false}
                            frames only; the one request
                                                                that needs no token; name and
                                                                tablet may be left out

Answered by {"answer": 7, "accepted": true, "why": ""}; `stats` is added where asked for, and to
`look` the name under which all screens have this client. Who says nothing at all is soon
disconnected.
"""

from __future__ import annotations

import json
import math
import secrets
from enum import StrEnum
from typing import NamedTuple, NoReturn

from topdress.console.attached import clean_name
from topdress.console.frame import DeviceDo
from topdress.console.worker.limits import TEXT_CHARACTERS
from topdress.control.orders import Do, Order


class Question(StrEnum):
    # a console that can show STOP lives: nothing else keeps the machine working
    ALIVE = "alive"
    STATS = "stats"  # how punctual the loop is, what the link refused
    QUIT = "quit"  # off, close the log, exit
    # begin the lag test: it measures while the state is calibrating
    LAG_TEST = "lag_test"
    END_LAG_TEST = "end_lag_test"
    # this client wants frames; with the token it has a place that is kept for those who have it
    LOOK = "look"


class DeviceOrder(NamedTuple):
    """Something that concerns one device, by the name that the frame gives it."""

    device: str
    do: DeviceDo


RequestContent = Order | Question | DeviceOrder


class Request(NamedTuple):
    id: int
    what: RequestContent
    with_key: bool = True
    name: str = ""  # of a look: how the client calls itself
    tablet: bool = False


class Refusal(NamedTuple):
    """`id` is None where the line does not even tell whom to answer; `kind` is what is counted."""

    id: int | None
    kind: str  # malformed, unauthorised
    why: str


def parse_request(line: bytes, token: str) -> Request | Refusal:
    """Read one line from a client.

    Never raises; anything but a well-formed, authorised request is a Refusal.

    Parameters
    ----------
    line: bytes without the end of line.
    token: the token of this run, which an order must carry.
    """
    try:
        message = json.loads(line, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        return Refusal(None, "malformed", "malformed: not JSON")
    if not isinstance(message, dict):
        return Refusal(None, "malformed", "malformed: not an object")
    number = message.get("id")
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < 2**53:
        return Refusal(None, "malformed", "malformed: id")
    with_key = _is_token_right(message.get("token"), token)
    if message.get("ask") == Question.LOOK:
        return Request(
            number,
            Question.LOOK,
            with_key,
            clean_name(message.get("name")),
            message.get("tablet") is True,
        )
    if not with_key:
        return Refusal(number, "unauthorised", "unauthorised")
    if "ask" in message:
        return _parse_question(number, message["ask"])
    if "device" in message:
        return _parse_device_order(number, message["device"], message.get("act"))
    return _parse_loop_order(number, message.get("do"), message.get("value"))


def _parse_question(number: int, ask: object) -> Request | Refusal:
    try:
        return Request(number, Question(str(ask)))
    except ValueError:
        return Refusal(number, "malformed", "malformed: ask")


def _parse_device_order(number: int, device: object, act: object) -> Request | Refusal:
    try:
        do = DeviceDo(str(act))
    except ValueError:
        do = None
    if do is None or not isinstance(device, str):
        return Refusal(number, "malformed", "malformed: device")
    return Request(number, DeviceOrder(device[:TEXT_CHARACTERS], do))


def _parse_loop_order(number: int, do: object, value: object) -> Request | Refusal:
    try:
        known = Do(str(do))
    except ValueError:
        return Refusal(number, "malformed", "malformed: do")
    match value:
        case None | bool():
            return Request(number, Order(known, value))
        case str() if len(value) <= TEXT_CHARACTERS:
            return Request(number, Order(known, value))
        case int() if abs(value) < 2**53:
            return Request(number, Order(known, float(value)))
        case float() if math.isfinite(value):
            return Request(number, Order(known, value))
    return Refusal(number, "malformed", "malformed: value")


def _is_token_right(offered: object, token: str) -> bool:
    return isinstance(offered, str) and secrets.compare_digest(
        offered.encode(errors="replace"), token.encode()
    )


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")
