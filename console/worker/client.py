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
    """The kinds of clients, by what each has shown so far."""

    NEW = auto()  # has said nothing yet that counts
    LOOKING = auto()
    WITH_KEY = auto()


class RefusalQuota:
    """Counts the refusals that a client still gets: `REFUSALS` at once, one more every
    `REFUSAL_AGAIN_S`."""

    def __init__(self, now_s: float) -> None:
        self._left, self._at_s = float(REFUSALS), now_s

    def spend_refusal(self, now_s: float) -> bool:
        """Spend one refusal at `now_s`, s; False when none was left."""
        self._left = min(float(REFUSALS), self._left + (now_s - self._at_s) / REFUSAL_AGAIN_S)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Client:
    """Holds one connection, which never blocks: its kind, bytes received and bytes unsent."""

    def __init__(self, connection: socket.socket, came_s: float) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.came_s = came_s
        self.kind = ClientKind.NEW
        self.patience = RefusalQuota(came_s)
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

    def describe_attached(self, late_s: float) -> Attached:
        """The client as other consoles see it.

        late_s: a client last heard before this time, s, keeps nothing working.
        """
        return Attached(
            self.name or UNNAMED,
            self.tablet,
            self.kind is ClientKind.WITH_KEY,
            self.alive_s > late_s,
        )

    @property
    def has_whole_line(self) -> bool:
        """Whether a whole line was received and not yet taken."""
        return b"\n" in self._received

    @property
    def is_oversized(self) -> bool:
        """Whether more bytes than a line may have came without an end of line."""
        return len(self._received) > LINE_BYTES and not self.has_whole_line

    @property
    def is_behind(self) -> bool:
        """Whether bytes are unsent: the client has not taken all."""
        return bool(self._unsent)

    def queue_bytes(self, data: bytes) -> None:
        """Queue behind what is unsent and send as much as the socket takes; a client too far behind
        is disconnected."""
        self._unsent += data
        self.send_unsent()
        if len(self._unsent) > UNREAD_BYTES:
            self.gone = True

    def send_unsent(self) -> None:
        """Send as much of the unsent bytes as the socket takes."""
        try:
            while self._unsent:
                del self._unsent[: self.connection.send(self._unsent)]
        except BlockingIOError:
            pass
        except OSError:
            self.gone = True

    def take_lines(self, most: int, read_bytes: int) -> list[bytes]:
        """Take at most `most` whole lines.

        The socket is read only once all earlier lines are taken: unread bytes fill the sender's own
        buffer, and the sender waits.
        """
        if not self.has_whole_line:
            self._receive_bytes(read_bytes)
        found: list[bytes] = []
        while len(found) < most and (end := self._received.find(b"\n")) >= 0:
            found.append(bytes(self._received[:end]))
            del self._received[: end + 1]
        return found

    def _receive_bytes(self, read_bytes: int) -> None:
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
