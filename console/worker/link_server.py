"""The worker's end of the link: clients on loopback, in a thread of its own.

Each client gets the newest frame (the host makes up to 20 a second); a client that has not taken the last one yet
misses frames rather than being waited for. Clients that hold the token may order; the others look.

Everybody on this computer can connect. Places are therefore kept for those who have shown the token; those who only
look have places of their own, and who says nothing is disconnected.
"""
from __future__ import annotations

import os
import selectors
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from enum import Enum, auto
from functools import partial
from typing import Any

from console.worker import wire
from console.worker.host import Host
from console.worker.limits import (
    CLIENTS_LOOKING,
    CLIENTS_NEW,
    CLIENTS_WITH_KEY,
    HELLO_S,
    LINE_BYTES,
    SEND_BUFFER_BYTES,
    UNREAD_BYTES,
)
from console.worker.requests import Ask, Refusal, parse
from control.orders import Answer

LOOK_S = 0.01                 # how often a new frame or answer is looked for while somebody is attached
IDLE_S = 0.1                  # and while nobody is


class Kind(Enum):
    NEW = auto()              # has said nothing yet
    LOOKING = auto()
    WITH_KEY = auto()


PLACES = {Kind.LOOKING: CLIENTS_LOOKING, Kind.WITH_KEY: CLIENTS_WITH_KEY}


class Client:
    """One connection: bytes not yet a whole line, and bytes not yet taken."""

    def __init__(self, connection: socket.socket, came_s: float) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.came_s = came_s
        self.kind = Kind.NEW
        self.received = bytearray()
        self.unsent = bytearray()
        self.gone = False

    def send(self, data: bytes) -> None:
        """Queue behind what is unsent and send as much as the socket takes; a client too far behind is gone."""
        self.unsent += data
        self.flush()
        if len(self.unsent) > UNREAD_BYTES:
            self.gone = True

    def flush(self) -> None:
        try:
            while self.unsent:
                del self.unsent[:self.connection.send(self.unsent)]
        except BlockingIOError:
            pass
        except OSError:
            self.gone = True

    def lines(self) -> list[bytes]:
        """Whole lines received by now."""
        try:
            got = self.connection.recv(LINE_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            got = b""
        if not got:
            self.gone = True
            return []
        *lines, rest = (self.received + got).split(b"\n")
        self.received = rest
        return [bytes(line) for line in lines]


class LinkServer(threading.Thread):
    """Serves one host. `close` sends what is still waiting, then disconnects everybody."""

    def __init__(self, host: Host, token: str, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(name="link", daemon=True)
        self.counts: Counter[str] = Counter()      # malformed, oversized, unauthorised, busy, dropped_frames, ...
        self._host = host
        self._token = token
        self._clock = clock
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=CLIENTS_NEW)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[Client] = []
        self._chooser = selectors.DefaultSelector()
        self._chooser.register(self._listener, selectors.EVENT_READ)
        self._answers: deque[tuple[Client, bytes]] = deque()
        self._sent_seq = -1
        self._closing = threading.Event()

    def run(self) -> None:
        last = False
        while not last:
            last = self._closing.is_set()              # what was queued before `close` still goes out
            for key, _ in self._chooser.select(LOOK_S if self._clients else IDLE_S):
                if key.data is None:
                    self._accept()
                else:
                    self._guarded(key.data)
            self._tell()
            self._end_the_silent()
            self._forget_the_gone()
        for client in self._clients:
            client.connection.close()
        self._chooser.close()
        self._listener.close()

    def close(self, timeout_s: float = 1.0) -> None:
        self._closing.set()
        if self.is_alive():
            self.join(timeout_s)

    def _accept(self) -> None:
        """Those who wait to be let in, a bounded number in one turn."""
        for _ in range(CLIENTS_NEW):
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self._make_room()
            client = Client(connection, self._clock())
            self._clients.append(client)
            self._chooser.register(connection, selectors.EVENT_READ, client)
            client.send(wire.greeting(os.getpid()))

    def _make_room(self) -> None:
        """No more new clients than allowed: the oldest that still has nothing to say gives its place."""
        while len(new := [c for c in self._clients if c.kind is Kind.NEW and not c.gone]) >= CLIENTS_NEW:
            self._guarded(new[0])
            self._drop_silent(new[0])

    def _end_the_silent(self) -> None:
        late_s = self._clock() - HELLO_S
        for client in self._clients:
            if client.came_s < late_s:
                self._drop_silent(client)

    def _drop_silent(self, client: Client) -> None:
        if client.kind is Kind.NEW and not client.gone:
            self.counts["clients_silent"] += 1
            client.gone = True

    def _guarded(self, client: Client) -> None:
        """A client whose lines raise is put aside: it ends, nobody else."""
        try:
            self._hear(client)
        except Exception:
            self.counts["clients_failed"] += 1
            client.gone = True

    def _hear(self, client: Client) -> None:
        lines = client.lines()
        if len(client.received) > LINE_BYTES:
            self.counts["oversized"] += 1
            client.gone = True
        for line in lines:
            if line.strip():
                self._take(client, line)

    def _take(self, client: Client, line: bytes) -> None:
        request = parse(line, self._token)
        if isinstance(request, Refusal):
            self.counts[request.kind] += 1
            client.send(wire.answered(request.id, Answer(False, request.why), {}))
            return
        if not self._has_place(client, Kind.WITH_KEY if request.with_key else Kind.LOOKING):
            self.counts["clients_refused"] += 1
            client.gone = True
            return
        if request.what is Ask.LOOK:
            client.send(wire.answered(request.id, Answer(True), {}))
            return
        self._host.console_heard()
        if not self._host.ask(request.what, partial(self._reply, client, request.id, request.what is Ask.STATS)):
            self.counts["busy"] += 1
            client.send(wire.answered(request.id, Answer(False, "busy"), {}))

    def _has_place(self, client: Client, kind: Kind) -> bool:
        if client.kind in (kind, Kind.WITH_KEY):
            return True
        if sum(1 for other in self._clients if other.kind is kind) >= PLACES[kind]:
            return False
        client.kind = kind
        return True

    def _reply(self, client: Client, number: int, with_counts: bool, answer: Answer, extra: dict[str, Any]) -> None:
        """Called by the loop: only queues."""
        if with_counts:
            extra = {name: part | {"clients": len(self._clients)} | dict(self.counts) for name, part in extra.items()}
        self._answers.append((client, wire.answered(number, answer, extra)))

    def _tell(self) -> None:
        while self._answers:
            client, data = self._answers.popleft()
            client.send(data)
        frame = self._host.newest
        if frame is None or frame.seq == self._sent_seq or not self._clients:
            return
        self._sent_seq = frame.seq
        try:
            data = wire.framed(frame)
        except (ValueError, TypeError):
            self.counts["frames_not_finite"] += 1
            return
        for client in self._clients:
            if client.kind is Kind.NEW:
                continue
            client.flush()
            if client.unsent:
                self.counts["dropped_frames"] += 1
            else:
                client.send(data)

    def _forget_the_gone(self) -> None:
        for client in [c for c in self._clients if c.gone]:
            self._clients.remove(client)
            self._chooser.unregister(client.connection)
            client.connection.close()
