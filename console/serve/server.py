"""Runs the tablet's web server on textual-serve: its page needs nothing from the internet, tabs are
limited, and only the page's own origin may open a socket.
"""

from __future__ import annotations

import asyncio
import contextlib
import html
import ipaddress
import json
import logging
import re
import signal
import socket
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, urlsplit

from aiohttp import WSCloseCode, web
from aiohttp.web_protocol import RequestHandler
from textual_serve.app_service import AppService
from textual_serve.server import Server
from topdress.console.attached_consoles import clean_name
from topdress.console.serve.tab_console import TabConsole

# Consoles at once; a console counts until its process has ended.
MAX_TABS = 6
# Period of the heartbeat, s: a tablet that vanished is noticed within 15 s. With 3 s, tabs of busy
# computers were ended.
HEARTBEAT_PERIOD_S = 10.0
# Limits and default of the font size, px.
MIN_FONT_PX, DEFAULT_FONT_PX, MAX_FONT_PX = 8, 16, 40
# No screen has more cells; the limits bound the memory of the process.
MAX_TAB_COLUMNS, MAX_TAB_ROWS = 400, 200
# Largest message of a tab, bytes: a pasted text.
MAX_MESSAGE_BYTES = 16_384
# Messages per second of each tab, more than anybody types.
MAX_MESSAGES_PER_S = 100.0
# Longest text of a ping that is echoed.
MAX_PING_CHARACTERS = 100
# Time in which a browser must confirm that its socket closes, s.
CLOSE_TIMEOUT_S = 0.4
# Connections that the system queues, which may be added to the limits in one turn.
MAX_BACKLOG = 32
# Lines per minute in the log: a client that sends rubbish must not fill the disk.
MAX_LOG_LINES_PER_MIN = 20
# A name or address, with an optional port.
HOST_PATTERN = re.compile(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+)(:\d{1,5})?")
_PAGE_FILE = Path(__file__).with_name("page.html")


class ConnectionQuota(NamedTuple):
    """Limits the connections that are not tabs."""

    # Connections at once: a browser that loads the page opens six, and 1,024 files may be open.
    connections: int = 64
    # Longest duration of such a connection, s; a browser opens another one.
    connection_s: float = 30.0
    # Period of the check, s.
    looked_s: float = 1.0


DEFAULT_QUOTA = ConnectionQuota()


class TabletServer(Server):
    """Serves the console to browsers, one process per tab.

    Parameters
    ----------
    command
        Program and arguments, started once for each tab.
    host, port
        Address on which the server listens.
    room
        Limits of connections.
    """

    def __init__(
        self, command: Sequence[str], host: str, port: int, room: ConnectionQuota = DEFAULT_QUOTA
    ) -> None:
        super().__init__(" ".join(command), host=host, port=port, title="topdress")
        self._arguments, self._room = tuple(command), room
        self._page = _PAGE_FILE.read_text(encoding="utf-8")
        self._consoles: dict[TabConsole, web.WebSocketResponse] = {}
        # Request of each tab's socket.
        self._asked: dict[web.WebSocketResponse, web.Request] = {}
        self.tabs = 0

    def serve(self, debug: bool = False) -> None:
        """Serve until Ctrl-C or a signal; the consoles of all tabs have ended within 2 s then.
        Raises OSError if the server cannot listen."""
        self.initialize_logging()
        # Windows reports Ctrl-C as KeyboardInterrupt.
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(self._serve_until_signal())

    async def _serve_until_signal(self) -> None:
        """Serve until a signal arrives."""
        loop, asked = asyncio.get_running_loop(), asyncio.Event()
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            # Windows has no signal handlers in the event loop.
            with contextlib.suppress(NotImplementedError, AttributeError):
                loop.add_signal_handler(getattr(signal, name), asked.set)
        runner = web.AppRunner(await self._make_app(), shutdown_timeout=CLOSE_TIMEOUT_S)
        await runner.setup()
        try:
            assert runner.server is not None
            doors = ConnectionGate(
                runner.server,
                lambda: {request.protocol for request in self._asked.values()},
                loop.time,
                self._room,
            )
            listening = await loop.create_server(doors, self.host, self.port, backlog=MAX_BACKLOG)
            try:
                while not asked.is_set():
                    doors.end_overdue()
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(asked.wait(), self._room.looked_s)
            finally:
                listening.close()
        finally:
            await runner.cleanup()

    async def on_shutdown(self, app: web.Application) -> None:
        """End all tabs at once: first the console, then its socket, for which the web server would
        otherwise wait twice as long."""
        await asyncio.gather(
            *(_end_console_and_tab(console, tab) for console, tab in self._consoles.items())
        )

    async def _make_app(self) -> web.Application:
        """Return the web application with a path for sockets of named tabs: the script of
        textual-serve appends its own query."""
        app = await super()._make_app()
        app.add_routes([web.get("/ws/{name}", self.handle_websocket)])
        return app

    def initialize_logging(self) -> None:
        """Print warnings only, with a limited rate."""
        quiet = logging.StreamHandler()
        quiet.addFilter(RateLimitedFilter(time.monotonic))
        logging.basicConfig(level="WARNING", format="%(message)s", handlers=[quiet])

    async def on_startup(self, app: web.Application) -> None:
        """Print nothing, because the command itself prints the address."""

    async def handle_index(self, request: web.Request) -> web.Response:
        """Answer a request for the page; the requested name must belong to this machine."""
        if not is_host_allowed(request.host, self.host):
            raise web.HTTPForbidden(text="this name is not mine")
        scheme = "wss" if request.secure else "ws"
        name = quote(clean_name(request.query.get("name")), safe="")
        address = html.escape(f"{scheme}://{request.host}/ws{'/' + name if name else ''}")
        page = self._page.replace("{{ socket }}", address)
        size = parse_bounded_int(
            request.query.get("fontsize"), DEFAULT_FONT_PX, MIN_FONT_PX, MAX_FONT_PX
        )
        return web.Response(
            text=page.replace("{{ font_size }}", str(size)),
            content_type="text/html",
            # The header prevents other pages from showing this page in a frame and catching clicks.
            headers={"X-Frame-Options": "DENY"},
        )

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """Serve one tab; its app process lives as long as its socket."""
        # Browsers send the origin of the page: a foreign page must not operate the machine.
        origin = request.headers.get("Origin")
        if not is_host_allowed(request.host, self.host) or (
            origin and urlsplit(origin).netloc != request.host
        ):
            raise web.HTTPForbidden(text="another page may not open this console")
        if self.tabs >= MAX_TABS:
            raise web.HTTPServiceUnavailable(text=f"{MAX_TABS} tabs are open already")
        tab = web.WebSocketResponse(
            heartbeat=HEARTBEAT_PERIOD_S, max_msg_size=MAX_MESSAGE_BYTES, timeout=CLOSE_TIMEOUT_S
        )
        self.tabs += 1
        self._asked[tab] = request
        try:
            await tab.prepare(request)
            await self._serve_tab(
                tab,
                find_tab_name(request),
                parse_bounded_int(request.query.get("width"), 80, 1, MAX_TAB_COLUMNS),
                parse_bounded_int(request.query.get("height"), 24, 1, MAX_TAB_ROWS),
            )
        finally:
            self.tabs -= 1
            del self._asked[tab]
        return tab

    async def _serve_tab(
        self, tab: web.WebSocketResponse, name: str, width: int, height: int
    ) -> None:
        """Start the console of a tab and process its messages until the tab closes."""

        async def close_tab() -> None:
            await tab.close()

        service = TabConsole(
            self._arguments,
            name,
            self._asked[tab].remote or "",
            write_bytes=tab.send_bytes,
            write_str=tab.send_str,
            close=close_tab,
            download_manager=self.download_manager,
        )
        self._consoles[service] = tab
        try:
            await service.start(width, height)
            await self._process_messages(tab, service)
        except (ValueError, KeyError, IndexError, TypeError, AssertionError, RecursionError):
            await tab.close(code=WSCloseCode.POLICY_VIOLATION, message=b"not a message of the page")
        finally:
            await service.end_console()
            del self._consoles[service]

    async def _process_messages(self, tab: web.WebSocketResponse, service: AppService) -> None:
        """Pass the page's messages on, one after the other, no faster than anybody types, with
        every number within its range.

        Raises ValueError, KeyError and similar errors for a message that the page does not send.
        """
        pace = MessageThrottle(asyncio.get_running_loop().time)
        async for message in tab:
            if message.type is not web.WSMsgType.TEXT:
                continue
            await asyncio.sleep(pace.calc_wait_s())
            kind, *rest = json.loads(message.data)
            if kind == "stdin":
                await service.send_bytes(str(rest[0]).encode("utf-8", "replace"))
            elif kind == "resize":
                await service.set_terminal_size(
                    parse_bounded_int(rest[0]["width"], 80, 1, MAX_TAB_COLUMNS),
                    parse_bounded_int(rest[0]["height"], 24, 1, MAX_TAB_ROWS),
                )
            elif kind == "ping":
                await tab.send_json(["pong", str(rest[0])[:MAX_PING_CHARACTERS]])
            elif kind in ("blur", "focus"):
                await getattr(service, kind)()


async def _end_console_and_tab(console: TabConsole, tab: web.WebSocketResponse) -> None:
    """End a console, then its socket. A tablet that fell asleep neither reads nor answers, so it is
    abandoned after `CLOSE_TIMEOUT_S`."""
    await console.end_console()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(CLOSE_TIMEOUT_S):
            await tab.close(code=WSCloseCode.GOING_AWAY)


class ConnectionGate:
    """Creates the protocol of each accepted connection, and limits connections.

    A connection that is no tab has `room.connection_s`. Beyond `room.connections` the oldest
    connection ends, of the address with the most connections. A client that opens many silent
    connections thus takes neither all descriptors nor another client's place.

    Parameters
    ----------
    server
        Server of aiohttp.
    tabs
        Returns the connections that are tabs, which are limited separately.
    clock
        Returns s, as `time.monotonic`.
    room
        Limits of connections.
    """

    def __init__(
        self,
        server: web.Server,
        tabs: Callable[[], set[Any]],
        clock: Callable[[], float],
        room: ConnectionQuota,
    ) -> None:
        self._server, self._tabs, self._clock, self._room = server, tabs, clock, room
        self._since_s: dict[RequestHandler, float] = {}

    def __call__(self) -> RequestHandler:
        self.end_overdue()
        return self._server()

    def end_overdue(self) -> None:
        """End connections whose time is over, and make room for one more."""
        now_s, tabs = self._clock(), self._tabs()
        open_now = [
            one
            for one in self._server.connections
            if one.transport is not None and one not in tabs and not one.transport.is_closing()
        ]
        self._since_s = {one: self._since_s.get(one, now_s) for one in open_now}
        addresses = Counter(map(_find_peer_address, open_now))
        most = max(addresses.values(), default=0)
        crowd = [one for one in open_now if addresses[_find_peer_address(one)] == most]
        over = [one for one in open_now if now_s - self._since_s[one] > self._room.connection_s]
        for one in {*over, *crowd[: max(0, len(open_now) - self._room.connections + 1)]}:
            assert one.transport is not None
            one.transport.abort()


def _find_peer_address(connection: RequestHandler) -> object:
    """Return the address of a connection's peer."""
    assert connection.transport is not None
    return (connection.transport.get_extra_info("peername") or ("",))[0]


class RateLimitedFilter(logging.Filter):
    """Passes at most `MAX_LOG_LINES_PER_MIN` lines, without tracebacks; the next line reports how
    many were dropped."""

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._since_s, self._said, self._left_out = clock, clock(), 0, 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the line is printed."""
        if self._clock() - self._since_s > 60.0:
            self._since_s, self._said = self._clock(), 0
        self._said += 1
        if self._said > MAX_LOG_LINES_PER_MIN:
            self._left_out += 1
            return False
        left_out, self._left_out = self._left_out, 0
        record.msg, record.args = (
            record.getMessage() + (f" ({left_out} more before it)" if left_out else ""),
            (),
        )
        record.exc_info = record.exc_text = None
        return True


class MessageThrottle:
    """Measures the wait before the next message: `MAX_MESSAGES_PER_S` on average, with bursts of
    one second."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._due_s = clock, clock()

    def calc_wait_s(self) -> float:
        """Return the seconds to wait before the next message."""
        now_s = self._clock()
        self._due_s = max(self._due_s, now_s - 1.0) + 1.0 / MAX_MESSAGES_PER_S
        return max(0.0, self._due_s - now_s)


def find_tab_name(request: web.Request) -> str:
    """Return the name of a tab among the machine's consoles: the page's query `?name=`, which the
    page copies into the path of its socket, else the address of its computer."""
    return clean_name(request.match_info.get("name")) or clean_name(
        f"tablet {request.remote or ''}"
    )


def is_host_allowed(asked: str, listening: str) -> bool:
    """Return whether a request means this server: an address, localhost, or a name of this machine.

    A foreign page may have made any other name lead here (DNS rebinding). A text that is neither
    name nor address is refused.
    """
    if not HOST_PATTERN.fullmatch(asked):
        return False
    name = (urlsplit(f"//{asked}").hostname or "").lower()
    own = socket.gethostname().lower()
    if name in {
        "localhost",
        listening.lower(),
        own,
        own.split(".")[0],
        f"{own.split('.')[0]}.local",
    }:
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def parse_bounded_int(text: Any, usual: int, least: int, most: int) -> int:
    """Return a whole number of a query within its range; `usual` for any other text."""
    try:
        return max(least, min(most, int(text)))
    except (ArithmeticError, TypeError, ValueError):
        return usual
