"""Waiting for what another thread or program does."""

import asyncio
import time
from collections.abc import Callable


def wait_for(what: Callable[[], object], seconds: float = 30.0) -> None:
    """Not a matter of time: on a busy machine it may be long in coming."""
    deadline = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.005)


async def until(true: Callable[[], object], timeout_s: float = 30.0) -> None:
    """As `wait_for`, of what this thread's loop does itself."""
    async with asyncio.timeout(timeout_s):
        while not true():
            await asyncio.sleep(0.01)
