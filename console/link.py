"""How does a console communicate with the control worker? It receives the newest frame and sends
orders, which are acknowledged.

The module uses asyncio only. `console/worker/requests.py` and `console/frame.py` describe the
messages.
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

from topdress.console.attached_consoles import find_own_name
from topdress.console.frame import DeviceDo, Frame, parse_frame
from topdress.console.locale import _
from topdress.console.running import WorkerAddress
from topdress.console.worker_handshake import MAX_FRAME_BYTES, WORKER_HOST
from topdress.control.orders import Answer, Order

# Interval of the keep-alive, s. The worker holds after 2 s of silence, so the console may draw for
# nearly 2 s.
KEEP_ALIVE_PERIOD_S = 0.2
# Time-out of an answer; the loop answers at its next tick.
ANSWER_TIMEOUT_S = 0.5


class WorkerGone(ConnectionError):
    """Reports that the worker's end is closed: it stopped, crashed or never ran."""


class Link:
    """Connects one console to the worker. `run_connection` runs in a task, `current_frame` holds
    the newest frame, and orders are sent by methods."""

    # Whether the link keeps the machine working, as a console with STOP in view does; False for a
    # link that only gives orders.
    keeps_alive = True

    # Whether the other consoles see this one as a tablet.
    tablet = False

    def __init__(self, where: WorkerAddress, name: str | None = None) -> None:
        """Makes a link that is not connected yet.

        `name` is the name of this console (`console.attached_consoles.find_own_name`); the worker
        may append a number.
        """
        self.where = where
        self.name = find_own_name(name)
        self.current_frame: Frame | None = None
        # Arrival of the newest frame, time.monotonic() seconds.
        self.newest_at_s: float | None = None
        self.attached = asyncio.Event()
        # Returns whether the drawing of this console is visible.
        self.shows: Callable[[], bool] = lambda: True
        self._writer: asyncio.StreamWriter | None = None
        # Number of the message that sends the name.
        self._named = 0
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._numbers = itertools.count(1)
        self._gone = asyncio.Event()
        self._next_word: asyncio.TimerHandle | None = None

    async def run_connection(self) -> NoReturn:
        """Receives frames and answers, and sends the keep-alive; raises WorkerGone at once when the
        worker's end is closed."""
        try:
            reader, self._writer = await asyncio.open_connection(
                WORKER_HOST, self.where.port, limit=MAX_FRAME_BYTES
            )
        except OSError as error:
            self._gone.set()
            raise WorkerGone(_("the connection to the machine broke off")) from error
        self._named = next(self._numbers)
        self._write_message(self._named, {"ask": "look", "name": self.name, "tablet": self.tablet})
        self._send_keep_alive()
        try:
            # A worker may be killed in the middle of a line.
            while (line := await reader.readline()).endswith(b"\n"):
                self._take_message(json.loads(line))
        # An invalid line does not come from a topdress worker.
        except (OSError, ValueError):
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

    async def send_order(self, order: Order, timeout_s: float = ANSWER_TIMEOUT_S) -> Answer:
        """Gives an order and returns the worker's answer.

        `no_answer` means that no answer arrived in time; the order may yet be executed, and the
        state of the next frames shows it. Raises WorkerGone without a worker.
        """
        return await self._request_answer({"do": order.do.value, "value": order.value}, timeout_s)

    async def send_device_order(
        self, name: str, do: DeviceDo, timeout_s: float = ANSWER_TIMEOUT_S
    ) -> Answer:
        """Gives an order for one device, by its name in the frame; its DeviceView shows the result.
        Answers and errors are those of `send_order`."""
        return await self._request_answer({"device": name, "act": do.value}, timeout_s)

    async def send_lag_test_order(self, begin: bool, timeout_s: float = ANSWER_TIMEOUT_S) -> Answer:
        """Begins or ends the lag test, which measures while the state is calibrating. Answers and
        errors are those of `send_order`."""
        return await self._request_answer(
            {"ask": "lag_test" if begin else "end_lag_test"}, timeout_s
        )

    async def request_stats(self, timeout_s: float = ANSWER_TIMEOUT_S) -> dict[str, float]:
        """Returns the punctuality of the worker's loop (`console.worker.loop_host`) and counts of
        requests that its link refused. Raises TimeoutError."""
        said = await self._send_request({"ask": "stats"}, timeout_s)
        return dict(said.get("stats", {}))

    async def stop_worker(self, timeout_s: float = 5.0) -> None:
        """Makes the worker stop its machine, close its log and end; returns when its end is closed.

        Raises PermissionError for a console without the right to order, TimeoutError where the
        worker does not end in time.
        """
        async with asyncio.timeout(timeout_s):
            with contextlib.suppress(WorkerGone):
                said = await self._send_request({"ask": "quit"}, timeout_s)
                if not said["accepted"]:
                    raise PermissionError(str(said["why"]))
            await self._gone.wait()

    async def _request_answer(self, message: dict[str, Any], timeout_s: float) -> Answer:
        try:
            said = await self._send_request(message, timeout_s)
        except TimeoutError:
            return Answer(False, "no_answer")
        return Answer(bool(said["accepted"]), str(said["why"]))

    async def _send_request(self, message: dict[str, Any], timeout_s: float) -> dict[str, Any]:
        number = next(self._numbers)
        future: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._write_message(number, message)
        self._waiting[number] = future
        try:
            return await asyncio.wait_for(future, timeout_s)
        finally:
            self._waiting.pop(number, None)

    def _write_message(self, number: int, message: dict[str, Any]) -> None:
        if self._writer is None or self._gone.is_set():
            raise WorkerGone(_("no machine is connected"))
        self._writer.write(
            json.dumps({"id": number, "token": self.where.token} | message).encode() + b"\n"
        )

    def _take_message(self, message: dict[str, Any]) -> None:
        if "seq" in message:
            self.current_frame, self.newest_at_s = parse_frame(message), time.monotonic()
            self.attached.set()
        elif "answer" in message:
            if message["answer"] == self._named:
                self.name = str(message.get("name") or self.name)
            future = self._waiting.get(message["answer"])
            if future and not future.done():
                future.set_result(message)

    def _send_keep_alive(self) -> None:
        """Sends the keep-alive.

        Only the event loop that handles keys and drawing sends it. A frozen console therefore falls
        silent by itself, a console that draws for long is as silent as its screen, and an invisible
        console sends nothing.
        """
        if self.where.token is None or not self.keeps_alive or self._gone.is_set():
            return
        if self.shows():
            self._write_message(next(self._numbers), {"ask": "alive"})
        self._next_word = asyncio.get_running_loop().call_later(
            KEEP_ALIVE_PERIOD_S, self._send_keep_alive
        )


class ComingLink(Link):
    """Connects to a worker that is still starting, so that the screen need not wait for it."""

    def __init__(self, coming: Future[WorkerAddress], name: str | None = None) -> None:
        super().__init__(WorkerAddress(0, None, 0), name)
        self._coming = coming

    async def run_connection(self) -> NoReturn:
        """Waits for the worker, then runs as any link. Raises WorkerFailed where the worker does
        not start."""
        self.where = await asyncio.wrap_future(self._coming)
        await super().run_connection()

    async def _request_answer(self, message: dict[str, Any], timeout_s: float) -> Answer:
        """Waits for the worker as long as for an answer, because a worker that has not started yet
        is not gone."""
        if self._writer is None and not self._gone.is_set():
            try:
                await asyncio.wait_for(self.attached.wait(), timeout_s)
            except TimeoutError:
                return Answer(False, "no_answer")
        return await super()._request_answer(message, timeout_s)
