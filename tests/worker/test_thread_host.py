from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace

import pytest

from console.link import WorkerGone
from console.worker.host import Host
from console.worker.parts import Assembly, Names
from console.worker.thread_host import ThreadHost
from control.orders import Answer, Do, Order


@pytest.fixture
def live(fake):
    parts = Assembly(fake.FakeBench(), fake.FakeLoop(), fake.FakeWriter(), Names())
    began = time.monotonic()
    host = Host(parts, lambda: time.monotonic() - began, time.sleep, hz=100)
    return SimpleNamespace(parts=parts, link=ThreadHost(host, gone=WorkerGone))


async def test_it_looks_like_a_link(live):
    with pytest.raises(WorkerGone):
        await live.link.order(Order(Do.START))
    task = asyncio.create_task(live.link.run())
    await asyncio.sleep(0.1)
    assert await live.link.order(Order(Do.START)) == Answer(True)
    await asyncio.sleep(0.1)
    assert live.link.newest.row.state == "working" and live.link.newest_at_s == pytest.approx(time.monotonic(), abs=0.2)
    await asyncio.sleep(0.7)
    assert 0.3 < max(live.parts.loop.ages) < 0.65                # it says by itself that the console lives
    assert (await live.link.stats())["hz"] == pytest.approx(100)
    await live.link.stop_worker()
    with pytest.raises(WorkerGone, match="told to quit"):
        await task
    assert live.parts.writer.closed and live.parts.bench.closed and live.parts.writer.rows[-1].state == "off"


async def test_a_loop_that_breaks_is_told(live):
    live.parts.loop.break_at_tick = 5
    with pytest.raises(WorkerGone, match="the loop broke"):
        await live.link.run()
    assert live.parts.bench.commands[-1][1:] == (None, False)


async def test_closing_the_console_ends_the_loop(live):
    task = asyncio.create_task(live.link.run())
    await asyncio.sleep(0.1)
    task.cancel()
    await asyncio.sleep(0.1)
    assert live.parts.writer.closed and live.parts.writer.rows[-1].state == "off"
