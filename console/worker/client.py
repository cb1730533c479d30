"""Holds one connection of the link on the worker's side: bytes received but not a whole line yet,
and bytes not yet sent.
"""

from __future__ import annotations

import socket
from enum import Enum, auto
from math import inf

from topdress.console.attached_consoles import DEFAULT_NAME, AttachedConsole
from topdress.console.worker.limits import (
    MAX_CLIENT_REFUSALS,
    MAX_LINE_BYTES,
    MAX_UNREAD_BYTES,
    REFUSAL_RECOVERY_S,
    SEND_BUFFER_BYTES,
)


class ClientKind(Enum):
    """Lists the kinds of clients, by what each has shown so far."""

    # The client has sent no valid message yet.
    NEW = auto()
    LOOKING = auto()
    WITH_KEY = auto()


class RefusalQuota:
    """Counts the refusals that a client may still receive: `MAX_CLIENT_REFUSALS` at once, and
    another one every `REFUSAL_RECOVERY_S`."""

    def __init__(self, now_s: float) -> None:
        self._left, self._at_s = float(MAX_CLIENT_REFUSALS), now_s

    def spend_refusal(self, now_s: float) -> bool:
        """Spend one refusal at `now_s` (s) and return True; return False when none was left."""
        self._left = min(
            float(MAX_CLIENT_REFUSALS), self._left + (now_s - self._at_s) / REFUSAL_RECOVERY_S
        )
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Client:
    """Holds one connection, which never blocks: its kind, bytes received and bytes unsent."""

    def __init__(self, connection: socket.socket, came_s: float) -> None:
        connection.setblocking(False)
        # A small send buffer bounds the age of the frames that a stalled client finds.
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        # Frames are small and urgent, so Nagle's algorithm is off.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.came_s = came_s
        self.kind = ClientKind.NEW
        self.refusal_quota = RefusalQuota(came_s)
        # Time since which the client is ignored, s; None for a client that is served.
        self.ignored_since_s: float | None = None
        # Time of the last message that the client is a living console, s.
        self.alive_s = -inf
        # Name as displayed on all screens.
        self.name = ""
        self.tablet = False
        # Description as the other consoles have it; None before they know the client.
        self.shown: AttachedConsole | None = None
        # True if the client fell silent after it had been heard.
        self.has_been_silent = False
        self.gone = False
        self._received = bytearray()
        self._unsent = bytearray()

    def describe_attached(self, late_s: float) -> AttachedConsole:
        """Describe the client for the other consoles.

        Parameters
        ----------
        late_s
            A client last heard before this time, s, does not keep the machine working.
        """
        return AttachedConsole(
            self.name or DEFAULT_NAME,
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
        """Whether more bytes than a line may have arrived without an end of line."""
        return len(self._received) > MAX_LINE_BYTES and not self.has_whole_line

    @property
    def is_behind(self) -> bool:
        """Whether bytes are unsent because the client has not read everything."""
        return bool(self._unsent)

    def queue_bytes(self, data: bytes) -> None:
        """Queue bytes and send as many as the socket accepts; a client too far behind is
        disconnected."""
        self._unsent += data
        self.send_unsent()
        if len(self._unsent) > MAX_UNREAD_BYTES:
            self.gone = True

    def send_unsent(self) -> None:
        """Send as many unsent bytes as the socket accepts."""
        try:
            while self._unsent:
                del self._unsent[: self.connection.send(self._unsent)]
        except BlockingIOError:
            pass
        except OSError:
            self.gone = True

    def take_lines(self, most: int, read_bytes: int) -> list[bytes]:
        """Take at most `most` whole lines.

        The socket is read only after all earlier lines were taken: unread bytes fill the sender's
        own buffer, so that the sender waits.
        """
        if not self.has_whole_line:
            self._receive_bytes(read_bytes)
        found: list[bytes] = []
        while len(found) < most and (end := self._received.find(b"\n")) >= 0:
            found.append(bytes(self._received[:end]))
            del self._received[: end + 1]
        return found

    def _receive_bytes(self, read_bytes: int) -> None:
        """Receive bytes, or note that the connection has ended."""
        try:
            got = self.connection.recv(read_bytes)
        except BlockingIOError:
            return
        except OSError:
            got = b""
        # Zero bytes mean that the other end has closed the connection.
        if got:
            self._received += got
        else:
            self.gone = True
