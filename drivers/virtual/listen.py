"""A port that waits for one TCP client at a time: the virtual machine's end of a `socket://` line."""
from __future__ import annotations

import contextlib
import socket

from drivers.ports import READ_TIMEOUT_S, Clock, SocketStream, ThreadedPort


class ListeningPort(ThreadedPort):
    """Listens at once; connected while a client is there; a next client is taken when the one before has gone.

    Raises
    ------
    OSError : the address cannot be listened on.
    """

    def __init__(self, host: str, number: int, clock: Clock) -> None:
        self._server: socket.socket | None = socket.create_server((host, number))
        self._server.settimeout(READ_TIMEOUT_S)
        self.number: int = self._server.getsockname()[1]
        self._address = host, self.number
        super().__init__(f"socket://{host}:{self.number}", self._accept, clock,
                         first_back_off_s=0.01, longest_back_off_s=0.01)

    def let_go(self) -> None:
        """Unplugged: nobody can connect."""
        if self._server is not None:
            with contextlib.suppress(OSError):
                self._server.close()
            self._server = None

    def close(self) -> None:
        super().close()
        self.let_go()

    def _accept(self) -> SocketStream:
        """On the reader's thread, the only one that touches the listening socket while the port is open."""
        if self._server is None:
            self._server = socket.create_server(self._address)
            self._server.settimeout(READ_TIMEOUT_S)
        try:
            connection, _ = self._server.accept()
        except TimeoutError:
            raise TimeoutError("no client yet") from None
        return SocketStream(connection)
