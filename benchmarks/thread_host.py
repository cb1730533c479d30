"""The control loop in a thread of the console's process, to be measured: looks like `console.link.Link`.

Not for the field: a thread of the console's process is late by tens of milliseconds whenever the console draws
(docs/decisions/0001-loop-in-a-process.md), and it dies with it.
"""
from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any, NoReturn

from console.frame import DeviceDo, Frame
from console.worker.host import Host
from console.worker.requests import Ask, DeviceOrder, What
from control.orders import Answer, Order

KEEP_ALIVE_S = 0.5


class ThreadHost:
    """Runs `host` in a thread from `run` on. `gone` makes the exception that `run` ends with (`WorkerGone`)."""

    def __init__(self, host: Host, gone: Callable[[str], Exception] = ConnectionError) -> None:
        self.newest_at_s: float | None = None
        self._host = host
        self._gone = gone
        self._seen = -1
        self._thread = threading.Thread(target=self._work, name="control", daemon=True)
        self._error: BaseException | None = None

    @property
    def newest(self) -> Frame | None:
        frame = self._host.newest
        if frame and frame.seq != self._seen:
            self._seen, self.newest_at_s = frame.seq, time.monotonic()
        return frame

    async def run(self) -> NoReturn:
        """Start the thread and keep the loop assured; raises `gone` when the loop ends."""
        self._thread.start()
        try:
            while self._thread.is_alive():
                self._host.console_heard()
                for _ in range(10):
                    await asyncio.sleep(KEEP_ALIVE_S / 10)
                    if not self._thread.is_alive():
                        break
        finally:
            self._host.stop("console closed")
        raise self._gone(f"the control loop ended: {self._error or self._host.ended}") from self._error

    async def order(self, order: Order, timeout_s: float = 0.5) -> Answer:
        return await self._asked(order, timeout_s)

    async def device(self, name: str, do: DeviceDo, timeout_s: float = 0.5) -> Answer:
        return await self._asked(DeviceOrder(name, do), timeout_s)

    async def lag_test(self, begin: bool, timeout_s: float = 0.5) -> Answer:
        return await self._asked(Ask.LAG_TEST if begin else Ask.END_LAG_TEST, timeout_s)

    async def stats(self, timeout_s: float = 0.5) -> dict[str, float]:
        _, extra = await self._ask(Ask.STATS, timeout_s)
        return dict(extra.get("stats", {}))

    async def stop_worker(self, timeout_s: float = 5.0) -> None:
        async with asyncio.timeout(timeout_s):
            self._host.stop("asked to quit")
            while self._thread.is_alive():
                await asyncio.sleep(0.01)

    async def _asked(self, what: What, timeout_s: float) -> Answer:
        try:
            answer, _ = await self._ask(what, timeout_s)
        except TimeoutError:
            return Answer(False, "no_answer")
        return answer

    async def _ask(self, what: What, timeout_s: float) -> tuple[Answer, dict[str, Any]]:
        if not self._thread.is_alive():
            raise self._gone("the control loop does not run")
        here = asyncio.get_running_loop()
        future: asyncio.Future[tuple[Answer, dict[str, Any]]] = here.create_future()

        def take(answer: Answer, extra: dict[str, Any]) -> None:
            if not future.done():
                future.set_result((answer, extra))

        def reply(answer: Answer, extra: dict[str, Any]) -> None:
            with contextlib.suppress(RuntimeError):            # the console's event loop is closed: nobody waits
                here.call_soon_threadsafe(take, answer, extra)

        self._host.console_heard()
        if not self._host.ask(what, reply):
            return Answer(False, "busy"), {}
        return await asyncio.wait_for(future, timeout_s)

    def _work(self) -> None:
        try:
            self._host.run()
        except BaseException as error:
            self._error = error                 # raised by `run`
