"""The console's end of the control worker: newest frame in, acknowledged orders out.

asyncio only. What is said on the line is described in `console/worker/requests.py` and
`console/frame.py`.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NoReturn

from topdress.console.attached import own_name
from topdress.console.frame import DeviceDo, Frame, from_json
from topdress.console.locale import _
from topdress.console.running import WorkerAddress
from topdress.console.worker_handshake import HOST, LINE_BYTES
from topdress.control.orders import Answer, Order

# the worker holds after 2 s of silence: the console may draw for nearly all of them
KEEP_ALIVE_S = 0.2
ANSWER_S = 0.5  # the loop answers with its next tick


class WorkerGone(ConnectionError):
    """The worker's end is closed: it stopped, died or was never there."""


class Link:
    """One console's connection. `run` it in a task; read `newest`; give orders."""

    # says that a console with STOP in sight lives; False: gives orders only
    keeps_alive = True

    tablet = False  # how the others at this machine have it

    def __init__(self, where: WorkerAddress, name: str | None = None) -> None:
        """name: how this console calls itself (`console.attached.own_name`); the worker may put
        a number behind it."""
        self.where = where
        self.name = own_name(name)
        self.newest: Frame | None = None
        self.newest_at_s: float | None = None  # time.monotonic() when it came
        self.attached = asyncio.Event()
        # whether what this console draws is seen
        self.shows: Callable[[], bool] = lambda: True
        self._writer: asyncio.StreamWriter | None = None
        self._named = 0  # the number of the word that says our name
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._numbers = itertools.count(1)
        self._gone = asyncio.Event()
        self._next_word: asyncio.TimerHandle | None = None

    async def run(self) -> NoReturn:
        """Take frames and answers, keep the worker assured; raises WorkerGone the moment its
        end is closed."""
        try:
            reader, self._writer = await asyncio.open_connection(
                HOST, self.where.port, limit=LINE_BYTES
            )
        except OSError as error:
            self._gone.set()
            raise WorkerGone(_("the connection to the machine broke off")) from error
        self._named = next(self._numbers)
        self._send(self._named, {"ask": "look", "name": self.name, "tablet": self.tablet})
        self._keep_alive()
        try:
            # a worker may be killed in the middle of one
            while (line := await reader.readline()).endswith(b"\n"):
                self._take(json.loads(line))
        except (OSError, ValueError):  # a line that is none: not our worker
            pass
        finally:
            self.attached.clear()
            self._gone.set()
            if self._next_word is not None:
                self._next_word.cancel()
            self._writer.close()
            for future in self._waiting.values():
                if not future.done():
                    future.set_exception(
                        WorkerGone(_("the connection to the machine broke off before it answered"))
                    )
            self._waiting.clear()
        raise WorkerGone(_("the connection to the machine broke off"))

    async def order(self, order: Order, timeout_s: float = ANSWER_S) -> Answer:
        """Give an order and wait for the worker's answer.

        `no_answer` says that none came in time: the order may yet be followed, the state on the
        next frames tells. Raises WorkerGone where there is no worker (any more).
        """
        return await self._asked({"do": order.do.value, "value": order.value}, timeout_s)

    async def device(self, name: str, do: DeviceDo, timeout_s: float = ANSWER_S) -> Answer:
        """Order something of one device, by the name that the frame gives it; what came of it
        is in its DeviceView.

        Answers and errors as `order`.
        """
        return await self._asked({"device": name, "act": do.value}, timeout_s)

    async def lag_test(self, begin: bool, timeout_s: float = ANSWER_S) -> Answer:
        """Begin the lag test, or end it: it measures while the state is calibrating. Answers
        and errors as `order`."""
        return await self._asked({"ask": "lag_test" if begin else "end_lag_test"}, timeout_s)

    async def stats(self, timeout_s: float = ANSWER_S) -> dict[str, float]:
        """How punctual the worker's loop is (`console.worker.host`), what its link refused.
        Raises TimeoutError."""
        said = await self._ask({"ask": "stats"}, timeout_s)
        return dict(said.get("stats", {}))

    async def stop_worker(self, timeout_s: float = 5.0) -> None:
        """Have the worker stop its machine, close its log and end; returns when its end is closed.

        Raises PermissionError where this console only looks, TimeoutError where the worker does
        not end in time.
        """
        async with asyncio.timeout(timeout_s):
            with contextlib.suppress(WorkerGone):
                said = await self._ask({"ask": "quit"}, timeout_s)
                if not said["accepted"]:
                    raise PermissionError(str(said["why"]))
            await self._gone.wait()

    async def _asked(self, message: dict[str, Any], timeout_s: float) -> Answer:
        try:
            said = await self._ask(message, timeout_s)
        except TimeoutError:
            return Answer(False, "no_answer")
        return Answer(bool(said["accepted"]), str(said["why"]))

    async def _ask(self, message: dict[str, Any], timeout_s: float) -> dict[str, Any]:
        number = next(self._numbers)
        future: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._send(number, message)
        self._waiting[number] = future
        try:
            return await asyncio.wait_for(future, timeout_s)
        finally:
            self._waiting.pop(number, None)

    def _send(self, number: int, message: dict[str, Any]) -> None:
        if self._writer is None or self._gone.is_set():
            raise WorkerGone(_("no machine is connected"))
        self._writer.write(
            json.dumps({"id": number, "token": self.where.token} | message).encode() + b"\n"
        )

    def _take(self, message: dict[str, Any]) -> None:
        if "seq" in message:
            self.newest, self.newest_at_s = from_json(message), time.monotonic()
            self.attached.set()
        elif "answer" in message:
            if message["answer"] == self._named:
                self.name = str(message.get("name") or self.name)
            future = self._waiting.get(message["answer"])
            if future and not future.done():
                future.set_result(message)

    def _keep_alive(self) -> None:
        """Say that this console lives. The event loop that takes keys and draws says it, with
        its next turn, and nobody else: a frozen console falls silent by itself, one that draws
        for long is as silent as its screen, and one that is not seen says nothing."""
        if self.where.token is None or not self.keeps_alive or self._gone.is_set():
            return
        if self.shows():
            self._send(next(self._numbers), {"ask": "alive"})
        self._next_word = asyncio.get_running_loop().call_later(KEEP_ALIVE_S, self._keep_alive)


class ComingLink(Link):
    """A link to a worker that is still coming up: the screen need not wait for it."""

    def __init__(self, coming: Future[WorkerAddress], name: str | None = None) -> None:
        super().__init__(WorkerAddress(0, None, 0), name)
        self._coming = coming

    async def run(self) -> NoReturn:
        """As of any link. Raises WorkerFailed where the worker does not come up."""
        self.where = await asyncio.wrap_future(self._coming)
        await super().run()

    async def _asked(self, message: dict[str, Any], timeout_s: float) -> Answer:
        """Before the worker is there nothing is gone: it is waited for as long as for an answer."""
        if self._writer is None and not self._gone.is_set():
            try:
                await asyncio.wait_for(self.attached.wait(), timeout_s)
            except TimeoutError:
                return Answer(False, "no_answer")
        return await super()._asked(message, timeout_s)
