"""One connection of the link, over a pair of sockets."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from concurrent.futures import Future

import pytest
from topdress.console.link import ComingLink
from topdress.console.running import WorkerAddress, WorkerFailed
from topdress.console.worker.client import Client, RefusalQuota
from topdress.console.worker.limits import MAX_CLIENT_REFUSALS, MAX_LINE_BYTES, REFUSAL_RECOVERY_S
from topdress.control.orders import Do, Order


@pytest.fixture
def pair():
    listener = socket.create_server(("127.0.0.1", 0))
    far = socket.create_connection(listener.getsockname())
    near, _ = listener.accept()
    client = Client(near, 0.0)
    yield client, far
    for one in (listener, far, near):
        one.close()


def sent(far, data):
    far.sendall(data)
    far.setblocking(True)


def test_lines_come_a_bounded_number_at_a_time_and_none_is_lost(pair):
    client, far = pair
    sent(far, b"".join(b"%d\n" % k for k in range(100)) + b"rest")
    found = []
    while len(found) < 100:
        some = client.take_lines(7, 64)
        assert len(some) <= 7
        found += some
    assert found == [b"%d" % k for k in range(100)]
    sent(far, b" of it\n")
    while not (last := client.take_lines(7, 64)):
        pass
    assert last == [b"rest of it"]


def test_nothing_is_read_while_lines_wait(pair):
    """What is not read fills the sender's buffer: he waits, and costs nothing."""
    client, far = pair
    sent(far, b"x\n" * 2000)
    while not client.take_lines(1, 64):
        pass
    for _ in range(31):
        assert client.take_lines(1, 64) == [b"x"]
    assert not client.has_whole_line and not client.is_oversized


def test_lines_before_the_end_of_a_connection_are_taken(pair):
    client, far = pair
    sent(far, b"one\ntwo\nthree\n")
    far.close()
    assert client.take_lines(1, MAX_LINE_BYTES) == [b"one"] and not client.gone
    assert client.take_lines(9, MAX_LINE_BYTES) == [b"two", b"three"] and not client.gone
    assert client.take_lines(9, MAX_LINE_BYTES) == [] and client.gone


def test_so_many_refusals_at_once_then_one_a_while():
    patience = RefusalQuota(0.0)
    assert [patience.spend_refusal(0.0) for _ in range(MAX_CLIENT_REFUSALS + 2)] == [
        True
    ] * MAX_CLIENT_REFUSALS + [
        False,
        False,
    ]
    assert not patience.spend_refusal(0.9 * REFUSAL_RECOVERY_S) and patience.spend_refusal(
        1.0 * REFUSAL_RECOVERY_S
    )
    assert not patience.spend_refusal(1.5 * REFUSAL_RECOVERY_S)
    assert [patience.spend_refusal(1000.0) for _ in range(MAX_CLIENT_REFUSALS + 1)] == [
        True
    ] * MAX_CLIENT_REFUSALS + [False]


# --- The console's end of a worker that is still coming up
# -----------------------------------------------------------


async def test_it_is_a_link_once_the_worker_is_there(running: Callable[..., WorkerAddress]) -> None:
    coming: Future[WorkerAddress] = Future()
    link = ComingLink(coming)
    run = asyncio.create_task(link.run_connection())
    await asyncio.sleep(0.05)
    assert link.current_frame is None
    assert (await link.send_order(Order(Do.HOLD))).why == "no_answer", (
        "not gone: nobody is there yet"
    )
    where = await asyncio.to_thread(running)
    early = asyncio.create_task(link.send_order(Order(Do.HOLD), 20.0))
    await asyncio.sleep(0.05)
    coming.set_result(where)
    assert (await early).why != "no_answer", "asked as soon as somebody is there"
    async with asyncio.timeout(20.0):
        await link.attached.wait()
    assert link.current_frame is not None
    run.cancel()


async def test_a_worker_that_does_not_come_up_is_told() -> None:
    coming: Future[WorkerAddress] = Future()
    coming.set_exception(WorkerFailed("the machine did not start: no port"))
    with pytest.raises(WorkerFailed, match="no port"):
        await ComingLink(coming).run_connection()
