"""One connection of the link as the worker sees it: bytes not yet a whole line, and bytes not
yet taken."""

from __future__ import annotations

import socket
from enum import Enum, auto
from math import inf

from topdress.console.attached import UNNAMED, Attached
from topdress.console.worker.limits import (
    LINE_BYTES,
    REFUSAL_AGAIN_S,
    REFUSALS,
    SEND_BUFFER_BYTES,
    UNREAD_BYTES,
)


class ClientKind(Enum):
    NEW = auto()  # has said nothing yet that counts
    LOOKING = auto()
    WITH_KEY = auto()


class Patience:
    """How many refusals somebody still gets: `REFUSALS` at once, one more every
    `REFUSAL_AGAIN_S`."""

    def __init__(self, now_s: float) -> None:
        self._left, self._at_s = float(REFUSALS), now_s

    def spend(self, now_s: float) -> bool:
        """One refusal; False when there was none left for it."""
        self._left = min(float(REFUSALS), self._left + (now_s - self._at_s) / REFUSAL_AGAIN_S)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Client:
    """One connection, not blocking."""

    def __init__(self, connection: socket.socket, came_s: float) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.came_s = came_s
        self.kind = ClientKind.NEW
        self.patience = Patience(came_s)
        # since when it is not heard any more; None: it is heard
        self.aside_s: float | None = None
        # when it last said that it is a console that lives
        self.alive_s = -inf
        self.name = ""  # as all screens have it
        self.tablet = False
        self.shown: Attached | None = None  # as the others have it; None: they do not yet
        self.was_silent = False  # after it had been heard
        self.gone = False
        self._received = bytearray()
        self._unsent = bytearray()

    def attached(self, late_s: float) -> Attached:
        """As others see it; who said before `late_s` that it lives keeps nothing working."""
        return Attached(
            self.name or UNNAMED,
            self.tablet,
            self.kind is ClientKind.WITH_KEY,
            self.alive_s > late_s,
        )

    @property
    def waits(self) -> bool:
        """Whether a whole line was received and not yet taken."""
        return b"\n" in self._received

    @property
    def oversized(self) -> bool:
        """Whether it has sent too much without an end of line."""
        return len(self._received) > LINE_BYTES and not self.waits

    @property
    def behind(self) -> bool:
        """Whether it has not taken all that was sent to it."""
        return bool(self._unsent)

    def send(self, data: bytes) -> None:
        """Queue behind what is unsent and send as much as the socket takes; a client too far
        behind is gone."""
        self._unsent += data
        self.flush()
        if len(self._unsent) > UNREAD_BYTES:
            self.gone = True

    def flush(self) -> None:
        try:
            while self._unsent:
                del self._unsent[: self.connection.send(self._unsent)]
        except BlockingIOError:
            pass
        except OSError:
            self.gone = True

    def lines(self, most: int, read_bytes: int) -> list[bytes]:
        """At most so many whole lines. The socket is read only once all lines before are taken:
        what is not read fills the sender's own buffer, and the sender waits."""
        if not self.waits:
            self._receive(read_bytes)
        found: list[bytes] = []
        while len(found) < most and (end := self._received.find(b"\n")) >= 0:
            found.append(bytes(self._received[:end]))
            del self._received[: end + 1]
        return found

    def _receive(self, read_bytes: int) -> None:
        try:
            got = self.connection.recv(read_bytes)
        except BlockingIOError:
            return
        except OSError:
            got = b""
        if got:
            self._received += got
        else:
            self.gone = True
