"""How do consoles reach the worker without a socket? Connections, a listener and a selector in
memory, with the methods that the link uses."""

from __future__ import annotations

import hashlib
import json
from collections import deque
from typing import Any, NamedTuple

# A console's operating system holds this many bytes for it, as a small socket buffer does.
RECEIVE_BUFFER_BYTES = 65_536


class Connection:
    """Holds the worker's end of one connection."""

    def __init__(self) -> None:
        self.to_worker = bytearray()
        self.to_console = bytearray()
        self.is_closed = False
        # Whether the console has closed its end.
        self.is_left = False

    def recv(self, size: int) -> bytes:
        """Returns received bytes; raises BlockingIOError without any."""
        if not self.to_worker:
            if self.is_left:
                return b""
            raise BlockingIOError
        data = bytes(self.to_worker[:size])
        del self.to_worker[:size]
        return data

    def send(self, data: bytes) -> int:
        """Takes as many bytes as fit and returns their number."""
        if self.is_left:
            raise ConnectionResetError
        room = RECEIVE_BUFFER_BYTES - len(self.to_console)
        if room <= 0:
            raise BlockingIOError
        self.to_console += data[:room]
        return min(room, len(data))

    @property
    def is_readable(self) -> bool:
        """Whether the worker would receive something."""
        return bool(self.to_worker) or self.is_left

    def setblocking(self, _flag: bool) -> None:
        """Does nothing, because nothing here blocks."""

    def setsockopt(self, *_option: int) -> None:
        """Does nothing, because memory has no options."""

    def close(self) -> None:
        """Closes the worker's end."""
        self.is_closed = True


class Listener:
    """Holds the connections that wait for the worker."""

    def __init__(self) -> None:
        self.waiting: deque[Connection] = deque()

    def accept(self) -> tuple[Connection, str]:
        """Returns the oldest waiting connection; raises BlockingIOError without any."""
        if not self.waiting:
            raise BlockingIOError
        return self.waiting.popleft(), "memory"

    @property
    def is_readable(self) -> bool:
        """Whether a connection waits."""
        return bool(self.waiting)

    def setblocking(self, _flag: bool) -> None:
        """Does nothing, because nothing here blocks."""

    def getsockname(self) -> tuple[str, int]:
        """Returns an address."""
        return "memory", 1

    def close(self) -> None:
        """Does nothing; the listener ends with its part of the day."""


class SelectorKey(NamedTuple):
    """Holds a registered end and its data, as `selectors.SelectorKey` does."""

    fileobj: Any
    data: Any


class Selector:
    """Selects the readable ends at once, in the order of their registration."""

    def __init__(self) -> None:
        self._keys: dict[Any, SelectorKey] = {}

    def register(self, fileobj: Any, _events: int, data: Any = None) -> None:
        """Adds an end."""
        self._keys[fileobj] = SelectorKey(fileobj, data)

    def unregister(self, fileobj: Any) -> None:
        """Removes an end."""
        del self._keys[fileobj]

    def get_map(self) -> dict[Any, SelectorKey]:
        """Returns the registered ends."""
        return self._keys

    def select(self, _timeout_s: float | None = None) -> list[tuple[SelectorKey, int]]:
        """Returns the readable ends."""
        return [(key, 1) for key in self._keys.values() if key.fileobj.is_readable]

    def close(self) -> None:
        """Forgets all ends."""
        self._keys.clear()


class Question(NamedTuple):
    """Holds a request that waits for its answer."""

    at_s: float
    text: dict[str, Any]


class SimulatedConsole:
    """Sends requests as a console does, and takes answers and frames.

    Parameters
    ----------
    name : the name that it shows.
    token : its key; a wrong key makes it a stranger.
    tablet : whether it is a tablet.
    folder : text that the digest of the frames leaves out.
    """

    def __init__(
        self, name: str, token: str | None, tablet: bool = False, folder: str = ""
    ) -> None:
        self.name, self.token, self.tablet = name, token, tablet
        self.silent_until_s = -1.0
        self.waiting: dict[int, Question] = {}
        self.answers: list[tuple[Question, dict[str, Any]]] = []
        self.digest = hashlib.sha256()
        # The name of the day's folder is no part of a run.
        self._folder = folder.encode() or b"\n"
        self.frames = 0
        self._connection: Connection | None = None
        self._numbers = 0
        self._alive_due_s = 0.0

    @property
    def is_attached(self) -> bool:
        """Whether the connection stands."""
        return self._connection is not None and not self._connection.is_closed

    def attach(self, listener: Listener, now_s: float) -> None:
        """Connects, and asks for frames."""
        self._connection = Connection()
        listener.waiting.append(self._connection)
        self.waiting.clear()
        self._alive_due_s = now_s
        self.send_request(now_s, {"ask": "look", "name": self.name, "tablet": self.tablet})

    def detach(self) -> None:
        """Closes the console's end."""
        if self._connection is not None:
            self._connection.is_left = True
        self._connection = None

    def send_bytes(self, data: bytes) -> None:
        """Sends bytes as they are."""
        if self._connection is not None:
            self._connection.to_worker += data

    def send_request(self, now_s: float, request: dict[str, Any]) -> None:
        """Sends a request with number and key."""
        self._numbers += 1
        text = {"id": self._numbers, "token": self.token} | request
        self.waiting[self._numbers] = Question(now_s, text)
        self.send_bytes(json.dumps(text).encode() + b"\n")

    def run_turn(self, now_s: float, keeps_alive: bool, period_s: float) -> bool:
        """Sends the sign of life when it is due and returns whether it was sent."""
        if self._connection is None or now_s < self.silent_until_s:
            return False
        self._take_bytes()
        if not keeps_alive or now_s < self._alive_due_s:
            return False
        self._alive_due_s = now_s + period_s
        self.send_bytes(b'{"id":0,"token":"%s","ask":"alive"}\n' % str(self.token).encode())
        return True

    def _take_bytes(self) -> None:
        """Takes whole lines: answers are kept, frames are counted."""
        assert self._connection is not None
        lines, received = [], self._connection.to_console
        end = received.rfind(b"\n") + 1
        if end:
            lines = bytes(received[:end]).splitlines()
            del received[:end]
        for line in lines:
            if line.startswith(b'{"answer":'):
                answer = json.loads(line)
                question = self.waiting.pop(answer["answer"], None)
                if question is not None:
                    self.answers.append((question, answer))
            elif not line.startswith(b'{"hello"'):
                self.frames += 1
            if not line.startswith(b'{"hello"'):
                self.digest.update(line.replace(self._folder, b""))
