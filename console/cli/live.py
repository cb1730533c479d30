"""`topdress live`: what the machine does, as lines of JSON on stdout, on a local socket, and to
an MQTT broker.

It looks on as any console without the token: it orders nothing, keeps nothing working, and its
readers are not heard.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Annotated, Any
from urllib.parse import SplitResult, urlsplit

import typer

from console.cli.plain_errors import CommandError
from console.link import Link, WorkerGone
from console.running import WorkerFailed, find_running
from drivers.files.extras import need

FORMAT = "topdress-live/1"
FIELDS = (
    "job",
    "machine",
    "crop",
    "simulated",
    "log_path",
    "area_ha",
    "applied_kg",
    "metres_left_m",
    "place_m",
    # of `console.frame.Frame`
    "gnss_age_s",
    "head_ndvi",
    "sections",
    "why_no_flow",
    "why_state",
    "notes",
)
AGAIN_S = 2.0  # where no machine runs, or it ended
# bytes of a reader that does not take them: he misses lines until he does
MOST_WAITING = 1 << 16
PORTS = {"mqtt": 1883, "mqtts": 8883}
PASSWORD = "TOPDRESS_MQTT_PASSWORD"
ONLINE, FRAME = "online", "frame"

Tell = Callable[[bytes], None]


def live(
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
            "mqtts://; the password in the variable " + PASSWORD + ".",
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
        to: list[Tell] = [] if quiet else [_print]
        if mqtt is not None:
            need("MQTT", "mqtt")
            to.append(stack.enter_context(_broker(mqtt)))
        asyncio.run(_going_on(to, port, every))


def published(message: dict[str, Any]) -> dict[str, Any]:
    """Of a frame as the worker writes it (`console.frame.to_json`): the columns of the run log,
    and `FIELDS`."""
    return {"format": FORMAT, **message["row"], **{name: message.get(name) for name in FIELDS}}


class _Looking(Link):
    """A link that hands each frame on."""

    tell: Callable[[dict[str, Any]], None]

    def _take(self, message: dict[str, Any]) -> None:
        if "seq" in message:
            self.tell(published(message))


async def _going_on(to: list[Tell], port: int | None, every_s: float) -> None:
    """For ever: of the machine that runs, and of the next one when it has ended."""
    if port is not None:
        to.append(await _served(port))
    last_s = -every_s

    def tell(said: dict[str, Any]) -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if now_s - last_s >= every_s:
            last_s = now_s
            line = json.dumps(said, separators=(",", ":"), ensure_ascii=False).encode() + b"\n"
            for one in to:
                one(line)

    while True:
        with contextlib.suppress(WorkerGone, WorkerFailed):
            where = find_running()
            if where is not None:
                link = _Looking(where.looking_only(), "live")
                link.tell = tell
                await link.run()
        await asyncio.sleep(AGAIN_S)


async def _served(port: int) -> Tell:
    """To every program that connects. Raises OSError where the port is taken."""
    readers: set[asyncio.StreamWriter] = set()

    async def come(_heard: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        readers.add(writer)

    def tell(line: bytes) -> None:
        for one in list(readers):
            if one.is_closing():
                readers.remove(one)
            elif one.transport.get_write_buffer_size() < MOST_WAITING:
                one.write(line)

    server = await asyncio.start_server(come, "127.0.0.1", port)
    typer.echo(f"socket       127.0.0.1:{server.sockets[0].getsockname()[1]}", err=True)
    return tell


def _print(line: bytes) -> None:
    sys.stdout.write(line.decode())
    sys.stdout.flush()


@contextlib.contextmanager
def _broker(url: str) -> Any:
    """Tells a broker, which may come and go: paho connects anew by itself, and lines of the
    meantime are not kept. Raises CommandError."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    where = _split(url)
    topic = where.path.strip("/") or "topdress"
    client = Client(CallbackAPIVersion.VERSION2)
    if where.username is not None:
        client.username_pw_set(where.username, os.environ.get(PASSWORD))
    if where.scheme == "mqtts":
        client.tls_set()
    client.will_set(f"{topic}/{ONLINE}", "0", retain=True)

    def connected(_client: Client, _given: Any, _flags: Any, why: Any, _properties: Any) -> None:
        typer.echo(f"broker       {where.hostname}: {why}", err=True)
        client.publish(f"{topic}/{ONLINE}", "1", retain=True)

    def tell(line: bytes) -> None:
        if client.is_connected():
            client.publish(f"{topic}/{FRAME}", line.rstrip(b"\n"))

    client.on_connect = connected
    client.connect_async(str(where.hostname), where.port or PORTS[where.scheme])
    client.loop_start()
    try:
        yield tell
    finally:
        client.publish(f"{topic}/{ONLINE}", "0", retain=True).wait_for_publish(1.0)
        client.disconnect()
        client.loop_stop()


def _split(url: str) -> SplitResult:
    try:
        where = urlsplit(url)
        if (
            where.scheme in PORTS
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
