"""How does `topdress live` publish the state of the machine as lines of JSON on stdout, on a local
socket, and to an MQTT broker?

It connects as a console without the token: it gives no orders, does not keep the machine working,
and ignores input from its readers.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import sys
import threading
import time
from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import SplitResult, urlsplit

import typer
from topdress.console.cli.line_output import LineOutput
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import format_json_line
from topdress.console.link import Link, WorkerGone
from topdress.console.running import WorkerFailed, find_running_worker
from topdress.drivers.files.optional_packages import require_extras

if TYPE_CHECKING:
    from paho.mqtt.client import Client

LIVE_FORMAT = "topdress-live/1"
PUBLISHED_FIELDS = (
    "job",
    "machine",
    "crop",
    "simulated",
    "log_path",
    "area_ha",
    "applied_kg",
    "metres_left_m",
    "place_m",
    # These are fields of `console.frame.Frame`.
    "gnss_age_s",
    "head_ndvi",
    "sections",
    "why_no_flow",
    "why_state",
    "notes",
)
# Interval of attempts while no machine runs, s.
MACHINE_RETRY_S = 2.0
# Number of waiting bytes of a slow reader; the reader misses lines beyond them.
MAX_WAITING_BYTES = 1 << 16
# Number of programs that read from the socket, where the system permits so many; at most
# `MAX_WAITING_BYTES` wait for each.
MAX_READERS = 1000
# Number of open files of this process itself: libraries, streams, the machine, a broker.
RESERVED_FILES = 48
# Number of simultaneous connections that are accepted before the first is refused.
LISTEN_BACKLOG = 32
# Interval between two lines about the same event, s.
REPEAT_PERIOD_S = 60.0
# Time-out for a broker's last message, and for the end of its connection, s.
LEAVE_TIMEOUT_S = 1.0
DEFAULT_PORTS = {"mqtt": 1883, "mqtts": 8883}
PASSWORD_VARIABLE = "TOPDRESS_MQTT_PASSWORD"
ONLINE_TOPIC, FRAME_TOPIC = "online", "frame"

LineSink = Callable[[bytes], None]


def publish_live(
    port: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            min=0,
            max=65535,
            help="Also to every program of this "
            "computer that connects to this port; 0: any that is free.",
        ),
    ] = None,
    mqtt: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Also to a broker: mqtt://USER@HOST:PORT/TOPIC, or "
            "mqtts://; the password in the variable " + PASSWORD_VARIABLE + ".",
        ),
    ] = None,
    every: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0.0,
            max=3600.0,
            help="Leave out lines that come sooner after one.",
        ),
    ] = 0.0,
    quiet: Annotated[bool, typer.Option("--quiet", help="Nothing on stdout.")] = False,
) -> None:
    """Tell what the machine does while it works: the row of the run log and what goes with it,
    a line of JSON at most ten times a second. Nothing can be ordered here. Ctrl-C ends."""
    with contextlib.ExitStack() as stack:
        to: list[LineSink] = []
        if mqtt is not None:
            require_extras("MQTT", "mqtt")
            to.append(stack.enter_context(_open_broker(mqtt)))
        asyncio.run(_publish_until_unread(to, port, every, quiet))


def select_published(message: dict[str, Any]) -> dict[str, Any]:
    """Returns the published part of a frame of the worker (`console.frame.format_frame_json`): the
    columns of the run log, and `PUBLISHED_FIELDS`."""
    return {
        "format": LIVE_FORMAT,
        **message["row"],
        **{name: message.get(name) for name in PUBLISHED_FIELDS},
    }


class _ObservingLink(Link):
    """Passes each frame to a function."""

    tell: Callable[[dict[str, Any]], None]

    def _take_message(self, message: dict[str, Any]) -> None:
        if "seq" in message:
            self.tell(select_published(message))


async def _publish_until_unread(
    to: list[LineSink], port: int | None, every_s: float, quiet: bool
) -> None:
    """Publishes until standard output, if it is used, has no reader any more; then raises
    BrokenPipeError."""
    loop, unread = asyncio.get_running_loop(), asyncio.Event()

    def note_unread() -> None:
        # The loop may already be closed.
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(unread.set)

    if not quiet and sys.stdout is not None:
        sys.stdout.flush()
        to.append(LineOutput(sys.stdout.fileno(), note_unread).queue_line)
    tells = asyncio.create_task(_publish_forever(to, port, every_s))
    waits = asyncio.create_task(unread.wait())
    await asyncio.wait((tells, waits), return_when=asyncio.FIRST_COMPLETED)
    if not tells.done():
        raise BrokenPipeError
    tells.result()


async def _publish_forever(to: list[LineSink], port: int | None, every_s: float) -> None:
    """Publishes the frames of the machine that runs, and of the next machine after its end."""
    if port is not None:
        to.append(await _serve_socket(port))
    last_s = -every_s

    def send_message(said: dict[str, Any]) -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if now_s - last_s >= every_s:
            last_s = now_s
            line = format_json_line(said, (",", ":")).encode() + b"\n"
            for one in to:
                one(line)

    refused = RareLine()
    while True:
        try:
            where = find_running_worker()
            if where is not None:
                link = _ObservingLink(where.drop_token(), "live")
                link.tell = send_message
                await link.run_connection()
        except WorkerGone:
            pass
        except WorkerFailed as error:
            refused.print_rarely(str(error))
        await asyncio.sleep(MACHINE_RETRY_S)


async def _serve_socket(port: int) -> LineSink:
    """Returns a sink to every program that connects, up to a limit. Raises OSError for a port in
    use."""
    readers: set[asyncio.StreamWriter] = set()
    most, refused = calc_max_readers(), RareLine()

    async def accept_reader(_heard: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(readers) < most:
            readers.add(writer)
            return
        writer.close()
        refused.print_rarely(f"socket       {most} programs read already: no more are let in")

    def send_line(line: bytes) -> None:
        for one in list(readers):
            if one.is_closing():
                readers.remove(one)
            elif one.transport.get_write_buffer_size() < MAX_WAITING_BYTES:
                one.write(line)

    def handle_failure(loop: asyncio.AbstractEventLoop, what: dict[str, Any]) -> None:
        """Reports that no more files can be opened; asyncio waits and continues."""
        error = what.get("exception")
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            refused.print_rarely(f"socket       {error.strerror}: no more programs are let in")
        else:
            loop.default_exception_handler(what)

    asyncio.get_running_loop().set_exception_handler(handle_failure)
    server = await asyncio.start_server(accept_reader, "127.0.0.1", port, backlog=LISTEN_BACKLOG)
    typer.echo(f"socket       127.0.0.1:{server.sockets[0].getsockname()[1]}", err=True)
    return send_line


def calc_max_readers() -> int:
    """Returns the number of programs that may read from the socket. Some of the files that this
    process may open are reserved for itself, for the search for the machine, and for refused
    programs."""
    if sys.platform == "win32":
        return MAX_READERS
    import resource

    files, _most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files == resource.RLIM_INFINITY:
        return MAX_READERS
    return max(1, min(MAX_READERS, files - RESERVED_FILES - LISTEN_BACKLOG))


class RareLine:
    """Prints a line on stderr for events that may occur a thousand times a second."""

    def __init__(self, every_s: float = REPEAT_PERIOD_S) -> None:
        self._every_s, self._next_s = every_s, -inf

    def print_rarely(self, line: str) -> None:
        """Prints the line, unless a line was printed in the last `every_s`."""
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + self._every_s
            typer.echo(line, err=True)


@contextlib.contextmanager
def _open_broker(url: str) -> Any:
    """Returns a sink to a broker, which may disconnect: paho reconnects by itself, and lines in
    between are dropped. Raises CommandError."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    where = _parse_broker_url(url)
    topic, unreached = where.path.strip("/") or "topdress", RareLine(every_s=inf)
    client = Client(CallbackAPIVersion.VERSION2)
    if where.username is not None:
        client.username_pw_set(where.username, os.environ.get(PASSWORD_VARIABLE))
    if where.scheme == "mqtts":
        client.tls_set()
    client.will_set(f"{topic}/{ONLINE_TOPIC}", "0", retain=True)

    def note_connected(
        _client: Client, _given: Any, _flags: Any, why: Any, _properties: Any
    ) -> None:
        typer.echo(f"broker       {where.hostname}: {why}", err=True)
        client.publish(f"{topic}/{ONLINE_TOPIC}", "1", retain=True)

    def publish_line(line: bytes) -> None:
        if client.is_connected():
            client.publish(f"{topic}/{FRAME_TOPIC}", line.rstrip(b"\n"))

    def note_unreachable(_client: Client, _given: Any) -> None:
        unreached.print_rarely(f"broker       {where.hostname}: not reached; it is tried again")

    client.on_connect, client.on_connect_fail = note_connected, note_unreachable
    client.connect_async(str(where.hostname), where.port or DEFAULT_PORTS[where.scheme])
    client.loop_start()
    try:
        yield publish_line
    finally:
        _leave_broker(client, f"{topic}/{ONLINE_TOPIC}")


def _leave_broker(client: Client, topic: str) -> None:
    """Informs a connected broker of the end. A broker that is disconnected, refuses or does not
    answer is not waited for; the thread of its connection ends with the process."""
    if client.is_connected():
        # The connection may end at this moment.
        with contextlib.suppress(RuntimeError, ValueError):
            client.publish(topic, "0", retain=True).wait_for_publish(LEAVE_TIMEOUT_S)
    client.disconnect()
    stops = threading.Thread(target=client.loop_stop, daemon=True)
    stops.start()
    stops.join(LEAVE_TIMEOUT_S)


def _parse_broker_url(url: str) -> SplitResult:
    try:
        where = urlsplit(url)
        if (
            where.scheme in DEFAULT_PORTS
            and where.hostname
            and where.port != 0
            and where.password is None
            and not set("#+") & set(url)
        ):
            return where
    except ValueError:
        pass
    raise CommandError(
        f"--mqtt {url.partition('@')[2] or url}: allowed is mqtt://USER@HOST:PORT/TOPIC or "
        "mqtts://, "
        "without a password, # and +"
    )
