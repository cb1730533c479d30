from __future__ import annotations

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from topdress.console.frame import DeviceDo
from topdress.console.worker.limits import MAX_TEXT_CHARACTERS
from topdress.console.worker.requests import (
    ClientQuestion,
    DeviceOrder,
    Refusal,
    Request,
    parse_request,
)
from topdress.control.orders import Do, Order

TOKEN = "0123456789abcdef"
# shared machines
relaxed = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def line(**message: object) -> bytes:
    return json.dumps({"id": 7, "token": TOKEN} | message).encode()


@pytest.mark.parametrize("do", list(Do))
def test_every_order_comes_through(do):
    assert parse_request(line(do=do.value), TOKEN) == Request(7, Order(do))


@pytest.mark.parametrize(
    ("sent", "taken"),
    [(5, 5.0), (-2.5, -2.5), ("map", "map"), (True, True), (None, None), (0, 0.0)],
)
def test_values_keep_their_kind(sent, taken):
    order = parse_request(line(do="nudge", value=sent), TOKEN).what
    assert order.value == taken and type(order.value) is type(taken)


@pytest.mark.parametrize("ask", list(ClientQuestion))
def test_asks(ask):
    assert parse_request(line(ask=ask.value), TOKEN) == Request(7, ask)


@pytest.mark.parametrize("do", list(DeviceDo))
def test_what_is_ordered_of_a_device(do):
    assert parse_request(line(device="head_3", act=do.value), TOKEN) == Request(
        7, DeviceOrder("head_3", do)
    )


@pytest.mark.parametrize(
    ("sent", "id_", "why"),
    [
        (line(device="gnss", act="explode"), 7, "device"),
        (line(device="gnss"), 7, "device"),
        (line(device=5, act="test"), 7, "device"),
        (b"hello", None, "not JSON"),
        (b"[" * 100_000, None, "not JSON"),
        (b"\xff\xfe\x00", None, "not JSON"),
        (b"[1]", None, "not an object"),
        (line(id=True, do="hold"), None, "id"),
        (line(id="7", do="hold"), None, "id"),
        (line(id=-1, do="hold"), None, "id"),
        (line(do="explode"), 7, "do"),
        (line(do=["hold"]), 7, "do"),
        (line(), 7, "do"),
        (line(ask="everything"), 7, "ask"),
        (line(ask={}), 7, "ask"),
        (line(do="nudge", value=[1]), 7, "value"),
        (line(do="mark", value="x" * (MAX_TEXT_CHARACTERS + 1)), 7, "value"),
        (line(do="nudge", value=10**400), 7, "value"),
        (line(do="nudge", value=0).replace(b"0}", b"1e999}"), 7, "value"),
        (line(do="nudge", value=0).replace(b"0}", b"NaN}"), None, "not JSON"),
    ],
    ids=lambda sent: repr(sent)[:40],
)
def test_what_is_wrong_is_refused_and_said(sent, id_, why):
    assert parse_request(sent, TOKEN) == Refusal(id_, "malformed", f"malformed: {why}")


@pytest.mark.parametrize(
    "token", [None, "", "0123456789abcdeg", 7, "\ud800", TOKEN + "0", TOKEN.upper()], ids=ascii
)
def test_without_the_token_nothing_is_taken(token):
    assert parse_request(line(token=token, do="start"), TOKEN) == Refusal(
        7, "unauthorised", "unauthorised"
    )
    for ask in set(ClientQuestion) - {ClientQuestion.LOOK}:
        assert parse_request(line(token=token, ask=ask.value), TOKEN) == Refusal(
            7, "unauthorised", "unauthorised"
        ), ask
    assert parse_request(line(token=token, ask="look"), TOKEN) == Request(
        7, ClientQuestion.LOOK, with_key=False
    )


@relaxed
@given(st.binary(max_size=200))
def test_no_bytes_raise(data):
    assert isinstance(parse_request(data, TOKEN), Refusal)


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text("ab\n", max_size=5)
json_values = (
    scalars | st.lists(scalars, max_size=2) | st.dictionaries(st.just("a"), scalars, max_size=1)
)


@relaxed
@given(st.dictionaries(st.sampled_from(["id", "token", "do", "ask", "value", "x"]), json_values))
def test_no_object_without_the_token_is_a_request(message):
    assert isinstance(parse_request(json.dumps(message).encode(), TOKEN), Refusal)


@relaxed
@given(json_values, st.sampled_from([d.value for d in Do]))
def test_a_request_carries_only_what_an_order_may(value, do):
    request = parse_request(line(do=do, value=value), TOKEN)
    if isinstance(request, Request):
        assert isinstance(request.what.value, str | float | bool | None)
