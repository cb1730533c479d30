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

from topdress.console.attached_consoles import clean_name
from topdress.console.frame import DeviceDo
from topdress.console.worker.limits import MAX_TEXT_CHARACTERS
from topdress.control.orders import Do, Order


class ClientQuestion(StrEnum):
    """Lists the questions that a client may ask."""

    # A console that can show STOP is alive; nothing else keeps the machine working.
    ALIVE = "alive"
    # Asks for the punctuality of the loop and the link's counts of refusals.
    STATS = "stats"
    # Switches off, closes the log and exits.
    QUIT = "quit"
    # Begins the lag test, which measures while the state is calibrating.
    LAG_TEST = "lag_test"
    END_LAG_TEST = "end_lag_test"
    # Asks for frames. With the token the client takes a place reserved for clients with the token.
    LOOK = "look"


class DeviceOrder(NamedTuple):
    """Holds an order for one device, by its name in the frame."""

    device: str
    do: DeviceDo


RequestContent = Order | ClientQuestion | DeviceOrder


class Request(NamedTuple):
    """Holds a valid request."""

    id: int
    what: RequestContent
    with_key: bool = True
    # Name that the client gives itself in a "look" request.
    name: str = ""
    tablet: bool = False


class Refusal(NamedTuple):
    """Holds a refusal. `id` is None where the line does not contain one; `kind` is the name of the
    counter."""

    id: int | None
    # "malformed" or "unauthorised".
    kind: str
    why: str


def parse_request(line: bytes, token: str) -> Request | Refusal:
    """Parse one line from a client.

    This function never raises; anything but a well-formed and authorised request becomes a Refusal.

    Parameters
    ----------
    line
        Bytes without the end of line.
    token
        Token of this run, which an order must contain.
    """
    try:
        message = json.loads(line, parse_constant=_refuse_constant)
    # Deeply nested JSON raises RecursionError.
    except (ValueError, RecursionError):
        return Refusal(None, "malformed", "malformed: not JSON")
    if not isinstance(message, dict):
        return Refusal(None, "malformed", "malformed: not an object")
    number = message.get("id")
    # A float64 represents integers exactly up to 2^53, and clients may use one.
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < 2**53:
        return Refusal(None, "malformed", "malformed: id")
    with_key = _is_token_right(message.get("token"), token)
    if message.get("ask") == ClientQuestion.LOOK:
        return Request(
            number,
            ClientQuestion.LOOK,
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
    """Parse a question."""
    try:
        return Request(number, ClientQuestion(str(ask)))
    except ValueError:
        return Refusal(number, "malformed", "malformed: ask")


def _parse_device_order(number: int, device: object, act: object) -> Request | Refusal:
    """Parse an order for a device."""
    try:
        do = DeviceDo(str(act))
    except ValueError:
        do = None
    if do is None or not isinstance(device, str):
        return Refusal(number, "malformed", "malformed: device")
    return Request(number, DeviceOrder(device[:MAX_TEXT_CHARACTERS], do))


def _parse_loop_order(number: int, do: object, value: object) -> Request | Refusal:
    """Parse an order for the loop."""
    try:
        known = Do(str(do))
    except ValueError:
        return Refusal(number, "malformed", "malformed: do")
    match value:
        case None | bool():
            return Request(number, Order(known, value))
        case str() if len(value) <= MAX_TEXT_CHARACTERS:
            return Request(number, Order(known, value))
        case int() if abs(value) < 2**53:
            return Request(number, Order(known, float(value)))
        case float() if math.isfinite(value):
            return Request(number, Order(known, value))
    return Refusal(number, "malformed", "malformed: value")


def _is_token_right(offered: object, token: str) -> bool:
    """Compare a token in constant time, so that its duration reveals nothing."""
    return isinstance(offered, str) and secrets.compare_digest(
        offered.encode(errors="replace"), token.encode()
    )


def _refuse_constant(name: str) -> NoReturn:
    """Refuse NaN and infinities, which Python's JSON would accept."""
    raise ValueError(f"{name} is not a number")
