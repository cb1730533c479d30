"""The console's end of a worker that is still coming up."""
from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future

import pytest

from console.link import ComingLink
from console.running import Where, WorkerFailed
from control.orders import Do, Order


async def test_it_is_a_link_once_the_worker_is_there(running: Callable[..., Where]) -> None:
    coming: Future[Where] = Future()
    link = ComingLink(coming)
    run = asyncio.create_task(link.run())
    await asyncio.sleep(0.05)
    assert link.newest is None
    assert (await link.order(Order(Do.HOLD))).why == "no_answer", "not gone: nobody is there yet"
    where = await asyncio.to_thread(running)
    early = asyncio.create_task(link.order(Order(Do.HOLD), 20.0))
    await asyncio.sleep(0.05)
    coming.set_result(where)
    assert (await early).why != "no_answer", "asked as soon as somebody is there"
    async with asyncio.timeout(20.0):
        await link.attached.wait()
    assert link.newest is not None
    run.cancel()


async def test_a_worker_that_does_not_come_up_is_told() -> None:
    coming: Future[Where] = Future()
    coming.set_exception(WorkerFailed("the control worker did not start: no port"))
    with pytest.raises(WorkerFailed, match="no port"):
        await ComingLink(coming).run()
