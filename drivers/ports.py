"""How do bytes reach a device and come back without blocking the control loop? A port has queues
and threads.

`open_port` takes a serial device (`/dev/ttyUSB0`, `COM3`), `socket://HOST:PORT` or
`rfc2217://HOST:PORT`. pyserial's other URLs are refused, because `spy://` writes all traffic into
any file that the URL names. A reader and a writer thread make the blocking calls; the loop only
takes bytes from, and puts bytes into, bounded queues. `make_memory_pair` returns two ends of one
line without any thread.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol
from urllib.parse import urlsplit

import serial
import serial.rfc2217

Clock = Callable[[], float]

# Largest number of received bytes that wait for a read, 1.4 s at 115 200 Bd. It limits the duration
# of a tick's read in a flood; older bytes are dropped and counted.
MAX_RECEIVED_BYTES = 16384
# Largest number of writes that wait for sending. The oldest is dropped and counted, because only
# the newest command matters.
MAX_QUEUED_WRITES = 64
# Interval at which a reader thread checks its stop flag, s.
READ_TIMEOUT_S = 0.05
# Time after which a write counts as failed, s; a board stops after 1 s without a command.
WRITE_TIMEOUT_S = 0.5
# Time after which a connection attempt counts as failed, s.
CONNECT_TIMEOUT_S = 3.0
# Pause before the second attempt to open a line, s; it doubles up to `MAX_BACK_OFF_S`.
FIRST_BACK_OFF_S = 0.25
MAX_BACK_OFF_S = 2.0
# Kinds of URLs (docs/devices.md); `drivers.datagrams` adds udp.
URL_SCHEMES = ("socket", "rfc2217")
UNPLUGGED = "unplugged"
# Number of newest bytes that are kept to show the last raw lines.
RAW_TAIL_BYTES = 512


class PortState(NamedTuple):
    """Holds the state of a port; times are on the injected clock, s."""

    connected: bool
    # Number of times the line was opened.
    connects: int
    last_error: str
    bytes_in: int
    bytes_out: int
    # Number of bytes received but dropped before a read.
    dropped_in: int
    # Number of writes that were never sent.
    dropped_out: int
    last_byte_s: float | None
    # The newest bytes received.
    raw_tail: bytes

    def format_last_lines(self, count: int = 1) -> list[str]:
        r"""Returns the newest `count` whole lines received, oldest first; unprintable bytes appear
        as `\xNN`."""
        whole, _, _ = self.raw_tail.rpartition(b"\n")
        lines = [line for line in whole.replace(b"\r", b"\n").split(b"\n") if line]
        return [escape_unprintable(line) for line in lines[-count:]]


class Port(Protocol):
    """Defines one end of a line. `read` and `write` return at once."""

    @property
    def name(self) -> str: ...

    def read(self) -> bytes:
        """Returns the bytes that have arrived since the last call; empty if none have."""
        ...

    def write(self, data: bytes) -> None:
        """Queues bytes for sending; drops and counts them where the line is down or the queue is
        full."""
        ...

    def state(self) -> PortState: ...

    def plug(self, plugged: bool) -> None:
        """Closes the line (False) and keeps it closed until True, as if the plug had been
        pulled."""
        ...

    def close(self) -> None: ...


class Stream(Protocol):
    """Defines an open line, used by the threads of a `ThreadedPort`. Any `OSError` means that the
    line is lost."""

    def read(self) -> bytes:
        """Waits at most `READ_TIMEOUT_S` for the first byte, then returns the available bytes."""
        ...

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


def escape_unprintable(line: bytes) -> str:
    r"""Returns ASCII text with every unprintable byte as `\xNN`, for screens and messages."""
    text = line.decode("latin-1")
    # This shortcut serves nearly every line, and a screen formats five lines a second.
    if text.isascii() and text.isprintable():
        return text
    return "".join(chr(byte) if 32 <= byte < 127 else f"\\x{byte:02x}" for byte in line)


class _Inbox:
    """Holds bytes between the receiving thread and the reading loop, with the counters of both
    directions."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._pending = bytearray()
        self._tail = b""
        self._last_byte_s: float | None = None
        self._in = 0
        self._dropped_in = 0
        self.out = 0
        self.dropped_out = 0

    def put_bytes(self, data: bytes) -> None:
        """Adds received bytes."""
        now_s = self._clock()
        with self._lock:
            self._pending += data
            surplus = len(self._pending) - MAX_RECEIVED_BYTES
            if surplus > 0:
                del self._pending[:surplus]
                self._dropped_in += surplus
            self._tail = (self._tail + data)[-RAW_TAIL_BYTES:]
            self._in += len(data)
            self._last_byte_s = now_s

    def take_bytes(self) -> bytes:
        """Returns the received bytes and empties the inbox."""
        if not self._pending:
            return b""
        with self._lock:
            data = bytes(self._pending)
            self._pending.clear()
        return data

    def state(self, connected: bool, connects: int, last_error: str) -> PortState:
        """Returns the state of a port with this traffic."""
        with self._lock:
            return PortState(
                connected,
                connects,
                last_error,
                self._in,
                self.out,
                self._dropped_in,
                self.dropped_out,
                self._last_byte_s,
                self._tail,
            )


class MemoryPort:
    """Holds one end of a line in memory; see `make_memory_pair`."""

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self._inbox = _Inbox(clock)
        self._other: MemoryPort | None = None
        self._open = True
        self._plugged = True
        self._connects = 1

    @property
    def name(self) -> str:
        """Name of the line."""
        return self._name

    def join_ends(self, other: MemoryPort) -> None:
        """Joins this end with another end: each end reads what the other writes."""
        self._other, other._other = other, self

    def read(self) -> bytes:
        """Returns the received bytes."""
        return self._inbox.take_bytes()

    def write(self, data: bytes) -> None:
        """Sends bytes to the other end."""
        if self._is_connected and self._other is not None:
            self._other._inbox.put_bytes(data)
            self._inbox.out += len(data)
        else:
            self._inbox.dropped_out += 1

    def state(self) -> PortState:
        """Returns whether the line is connected, and its traffic."""
        return self._inbox.state(
            self._is_connected,
            self._connects,
            "" if self._is_connected else "closed" if self._plugged else UNPLUGGED,
        )

    def plug(self, plugged: bool) -> None:
        """Plugs the line in or unplugs it."""
        self._connects += plugged and not self._plugged
        self._plugged = plugged

    def close(self) -> None:
        """Closes this end."""
        self._open = False

    @property
    def _is_connected(self) -> bool:
        other = self._other
        return self._open and self._plugged and other is not None and other._open and other._plugged


def make_memory_pair(
    name: str = "memory", clock: Clock = lambda: 0.0
) -> tuple[MemoryPort, MemoryPort]:
    """Returns two ends of one line: each end reads at once and in order what the other writes."""
    one, two = MemoryPort(f"{name}:host", clock), MemoryPort(f"{name}:device", clock)
    one.join_ends(two)
    return one, two


class SerialStream:
    """Opens a serial line of this computer, or of another by RFC 2217, for this process alone,
    because a second reader would take bytes from it."""

    def __init__(self, url: str, baud: int) -> None:
        self._serial: serial.Serial | serial.rfc2217.Serial
        # RFC 2217 does not support a time-out of writes.
        if parse_scheme(url) == "rfc2217":
            self._serial = serial.rfc2217.Serial(url, baudrate=baud, timeout=READ_TIMEOUT_S)
        else:
            self._serial = serial.Serial(
                url,
                baudrate=baud,
                timeout=READ_TIMEOUT_S,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True,
            )

    def read(self) -> bytes:
        """Returns the received bytes. Raises OSError where the device was unplugged."""
        data: bytes = self._serial.read(1)
        waiting = self._serial.in_waiting if data else 0
        return data + self._serial.read(waiting) if waiting else data

    def write(self, data: bytes) -> None:
        """Sends bytes. Raises OSError where the device was unplugged."""
        self._serial.write(data)

    def close(self) -> None:
        """Closes the serial line."""
        with contextlib.suppress(OSError):
            self._serial.close()


class SocketStream:
    """Wraps a TCP line. pyserial's own `socket://` returns one byte for each call or waits for its
    time-out; this class does neither."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._socket.settimeout(WRITE_TIMEOUT_S)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self) -> bytes:
        """Returns the received bytes. Raises OSError where the connection has ended."""
        if not select.select([self._socket], [], [], READ_TIMEOUT_S)[0]:
            return b""
        data = self._socket.recv(4096)
        if not data:
            raise ConnectionError("the other side closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """Sends bytes. Raises OSError where the connection has ended."""
        self._socket.sendall(data)

    def close(self) -> None:
        """Closes the connection."""
        self._socket.close()


class ThreadedPort:
    """Keeps a port open with its own threads, which open, read and write it and reopen a lost line
    with back-off.

    `opener` returns a `Stream` or raises `OSError` (pyserial's own errors are `OSError`) or
    `ValueError`. Queued bytes are dropped when the line goes down, because a set-point must never
    arrive late.

    A subclass may define in `disconnect` which resources end while the port is unplugged; the
    reader's thread calls it repeatedly.
    """

    def __init__(
        self,
        name: str,
        opener: Callable[[], Stream],
        clock: Clock,
        first_back_off_s: float = FIRST_BACK_OFF_S,
        longest_back_off_s: float = MAX_BACK_OFF_S,
    ) -> None:
        self._name = name
        self._opener = opener
        self._first_back_off_s = first_back_off_s
        self._longest_back_off_s = longest_back_off_s
        self._inbox = _Inbox(clock)
        self._outbox: deque[bytes] = deque()
        self._to_send = threading.Condition()
        self._stop = threading.Event()
        # The event that ends a pause of the reader's thread.
        self._again = threading.Event()
        self._plugged = True
        self._stream: Stream | None = None
        self._connects = 0
        self._last_error = "not yet opened"
        self._closing = False
        self._reader = threading.Thread(
            target=self._keep_reading, name=f"{name} reader", daemon=True
        )
        self._writer = threading.Thread(
            target=self._keep_writing, name=f"{name} writer", daemon=True
        )
        self._reader.start()
        self._writer.start()

    @property
    def name(self) -> str:
        """Name or address of the port."""
        return self._name

    def read(self) -> bytes:
        """Returns the bytes received since the last call, without waiting."""
        return self._inbox.take_bytes()

    def write(self, data: bytes) -> None:
        """Queues bytes for the port's thread, without waiting."""
        with self._to_send:
            if self._stream is None:
                self._inbox.dropped_out += 1
                return
            if len(self._outbox) >= MAX_QUEUED_WRITES:
                self._outbox.popleft()
                self._inbox.dropped_out += 1
            self._outbox.append(data)
            self._to_send.notify()

    def state(self) -> PortState:
        """Returns whether the port is open, its traffic and its last error."""
        return self._inbox.state(self._stream is not None, self._connects, self._last_error)

    def plug(self, plugged: bool) -> None:
        """Closes the line now and keeps it closed until True, which opens the line at once."""
        self._plugged = plugged
        stream = self._stream
        if not plugged and stream is not None:
            self._forget_stream(stream)
        self._again.set()

    def disconnect(self) -> None:
        """Releases, in subclasses, the other resources of an unplugged port."""

    def close(self) -> None:
        """Sends queued bytes, such as a last stop, then closes the line; takes at most a second."""
        with self._to_send:
            self._closing = True
            self._to_send.notify()
        self._writer.join(timeout=WRITE_TIMEOUT_S)
        self._stop.set()
        self._again.set()
        self._reader.join(timeout=WRITE_TIMEOUT_S)

    def _keep_reading(self) -> None:
        """Opens the line and reads from it until the port is closed; runs in the reader's
        thread."""
        back_off_s = self._first_back_off_s
        while not self._stop.is_set():
            if not self._plugged:
                self.disconnect()
                self._last_error = UNPLUGGED
                self._wait_before_retry(self._longest_back_off_s)
                back_off_s = self._first_back_off_s
                continue
            try:
                stream = self._opener()
            except (OSError, ValueError) as error:
                self._last_error = str(error)
                self._wait_before_retry(back_off_s)
                back_off_s = min(2.0 * back_off_s, self._longest_back_off_s)
                continue
            self._store_stream(stream)
            if self._read_until_lost(stream):
                back_off_s = self._first_back_off_s
            self._close_stream(stream)
            if self._plugged:
                self._wait_before_retry(back_off_s)

    def _wait_before_retry(self, seconds: float) -> None:
        self._again.wait(seconds)
        self._again.clear()

    def _read_until_lost(self, stream: Stream) -> bool:
        """Returns whether any bytes arrived on this connection, after it was lost."""
        received = False
        while not self._stop.is_set() and self._stream is stream:
            try:
                data = stream.read()
            # pyserial raises ValueError and TypeError when a line is closed during a read.
            except (OSError, ValueError, TypeError) as error:
                self._last_error = str(error) or type(error).__name__
                break
            if data:
                received = True
                self._inbox.put_bytes(data)
        return received

    def _keep_writing(self) -> None:
        """Writes queued bytes until the port is closed; runs in the writer's thread."""
        while True:
            with self._to_send:
                while not self._outbox and not self._closing:
                    self._to_send.wait()
                if not self._outbox:
                    return
                stream, data = self._stream, self._outbox.popleft()
            if stream is None:
                continue
            try:
                stream.write(data)
                self._inbox.out += len(data)
            except (OSError, ValueError, TypeError) as error:
                self._last_error = f"write: {error}"
                self._inbox.dropped_out += 1
                self._forget_stream(stream)

    def _store_stream(self, stream: Stream) -> None:
        with self._to_send:
            # The plug was pulled while the line was being opened.
            if not self._plugged:
                return
            self._connects += 1
            self._last_error = ""
            self._stream = stream

    def _close_stream(self, stream: Stream) -> None:
        self._forget_stream(stream)
        stream.close()

    def _forget_stream(self, stream: Stream) -> None:
        with self._to_send:
            if self._stream is stream:
                self._stream = None
                self._inbox.dropped_out += len(self._outbox)
                self._outbox.clear()


def open_port(url: str, baud: int, clock: Clock) -> ThreadedPort:
    """Opens a port now, or as soon as the device is connected.

    Parameters
    ----------
    url : device name (`/dev/ttyUSB0`, `COM3`), `socket://host:port` or `rfc2217://host:port`.
    baud : bits per second; ignored for a socket.
    clock : returns seconds; stamps the arrival of bytes.

    Raises
    ------
    ValueError : the URL is of another kind or names no host and port, or the baud rate is not
    positive. An absent device is no error: the port keeps trying and reports it in
    `state().last_error`.
    """
    if baud <= 0:
        raise ValueError(f"port {url}: baud {baud}, allowed is 1 or more")
    if parse_scheme(url) == "socket":
        address = parse_socket_address(url)
        return ThreadedPort(
            url, lambda: SocketStream(socket.create_connection(address, CONNECT_TIMEOUT_S)), clock
        )
    return ThreadedPort(url, lambda: SerialStream(url, baud), clock)


def parse_scheme(url: str) -> str:
    """Returns the scheme `socket` or `rfc2217` of a URL with host and port; empty for a serial
    device. Raises ValueError with one line."""
    scheme, found, _ = url.partition("://")
    if not found:
        return ""
    if scheme not in URL_SCHEMES:
        raise ValueError(
            f"port {url}: allowed is a serial device (/dev/ttyUSB0, COM3), socket://HOST:PORT, "
            "rfc2217://HOST:PORT or udp://HOST:PORT"
        )
    parse_socket_address(url)
    return scheme


def parse_socket_address(url: str) -> tuple[str, int]:
    """Returns host and port number of `socket://host:port`; raises ValueError with one line where
    either is missing."""
    try:
        parts = urlsplit(url)
        host, number = parts.hostname, parts.port
    except ValueError:
        host, number = None, None
    if not host or not number:
        raise ValueError(
            f"port {url}: allowed is {url.partition(':')[0]}://HOST:PORT with a port of 1 to 65535"
        )
    return host, number
