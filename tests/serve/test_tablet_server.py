"""`topdress serve` for real: server, two tabs and a worker, each a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from topdress.console.app.tablet_app import MAX_KEY_WAIT_S, TabletKey
from topdress.console.cli import serve as serve_command
from topdress.console.cli import tablet
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.tablet import (
    MAX_ADDRESSES,
    MAX_WAITS_BYTES,
    TAB_MEMORY_BYTES,
    SharedKeyWaits,
    TabLink,
    find_counting_key,
    read_options,
    read_token,
)
from topdress.console.link import Link
from topdress.console.running import WorkerAddress, WorkerFailed, start_worker
from topdress.control.orders import Answer, Do, Order
from topdress.drivers.files.process_lock import take_lock
from topdress.drivers.files.run_meta import format_meta_yaml, make_run_meta

aiohttp = pytest.importorskip("aiohttp", reason="textual-serve is not installed")
from topdress.console.serve import server as server_module  # noqa: E402
from topdress.console.serve import tab_console as tab_module  # noqa: E402
from topdress.console.serve.server import (  # noqa: E402
    MAX_MESSAGE_BYTES,
    MAX_TAB_COLUMNS,
    MAX_TAB_ROWS,
    MAX_TABS,
    MessageThrottle,
    TabletServer,
    is_host_allowed,
    parse_bounded_int,
)

posix = pytest.mark.skipif(os.name != "posix", reason="sends signals")


@pytest.fixture
def free_port():
    with socket.create_server(("127.0.0.1", 0)) as one:
        return one.getsockname()[1]


@pytest.fixture
def served(tmp_path, free_port, monkeypatch):
    """A worker on the simulated machine and a server; gives (where the worker listens, the
    server's address)."""
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.setenv("HOME", str(tmp_path))
    where = start_worker(
        ["--log", str(tmp_path / "run.csv")], tmp_path / "trouble.txt", timeout_s=60.0
    )
    server = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "from topdress.console.cli import main; main()",
            "serve",
            "--port",
            str(free_port),
        ],
        stdout=subprocess.DEVNULL,
    )
    yield where, f"http://127.0.0.1:{free_port}"
    server.send_signal(signal.SIGTERM)
    try:
        server.wait(60)
    except subprocess.TimeoutExpired:
        server.kill()
    with contextlib.suppress(ProcessLookupError):
        os.kill(where.pid, signal.SIGTERM)


class Tab:
    """A tab's socket, read all the time as a browser does; `text` is what its console drew."""

    def __init__(self, web):
        self.web, self.text = web, ""
        self.reading = asyncio.create_task(self._read())

    async def _read(self):
        async for message in self.web:
            if message.type == aiohttp.WSMsgType.BINARY:
                self.text += message.data.decode("utf-8", "replace")

    async def until(self, words, timeout_s=60.0, again=""):
        """again: pressed each second until then, for a line of others may stand where the
        answer did."""
        async with asyncio.timeout(timeout_s):
            while words not in self.text:
                assert not self.reading.done(), f"closed: {self.text[-400:]}"
                await asyncio.sleep(1.0 if again else 0.02)
                if again:
                    await self.press(again)

    async def press(self, key):
        await self.web.send_json(["stdin", key])


async def page_of(session, address):
    async with asyncio.timeout(60.0):
        while True:
            with contextlib.suppress(aiohttp.ClientConnectionError):
                async with session.get(address) as answer:
                    return answer.status, await answer.text()
            await asyncio.sleep(0.1)


@posix
async def test_two_tabs_look_at_the_worker_and_change_nothing(served):
    where, address = served
    async with aiohttp.ClientSession() as session:
        status, page = await page_of(session, address)
        assert (
            status == 200
            and f"ws://{address.removeprefix('http://')}/ws" in page
            and "https://" not in page
        )
        async with session.get(f"{address}/static/js/textual.js") as script:
            assert script.status == 200
        with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
            await session.ws_connect(f"{address}/ws", headers={"Origin": "http://evil.example"})
        async with session.get(address, headers={"Host": "evil.example"}) as refused:
            assert refused.status == 403
        tabs = [
            Tab(await session.ws_connect(f"{address}/ws?width=120&height=40")) for _two in (1, 2)
        ]
        for tab in tabs:
            await tab.until("VIEW ONLY")
        looking = Link(where.drop_token())
        task = asyncio.create_task(looking.run_connection())
        await asyncio.wait_for(looking.attached.wait(), 60)
        assert looking.current_frame.row.state == "off"
        for tab in tabs:
            for key in ("r", "s", "x", "+"):
                await tab.press(key)
        for tab in tabs:
            await tab.until("view only: hold", again="+")
        assert await looking.send_order(Order(Do.READY), 5.0) == Answer(False, "unauthorised")
        seq = looking.current_frame.seq
        while looking.current_frame.seq < seq + 10:
            await asyncio.sleep(0.05)
        assert looking.current_frame.row.state == "off" and not looking.current_frame.row.events
        task.cancel()
        for tab in tabs:
            await tab.web.close()


@pytest.mark.exam
@posix
async def test_a_tab_that_operates_does_not_keep_the_machine_working(served, tmp_path):
    """The order is taken, but two seconds after the last word of a console the worker holds: no
    order puts that off."""
    where, _address = served
    tab = TabLink(where)
    task = asyncio.create_task(tab.run_connection())
    await asyncio.wait_for(tab.attached.wait(), 60)
    await asyncio.sleep(0.7)
    assert await tab.send_order(Order(Do.READY), 5.0) == Answer(True)
    heard = time.monotonic()
    async with asyncio.timeout(60.0):
        while not any(alarm.id == "console_silent" for alarm in tab.current_frame.alarms):
            await asyncio.sleep(0.05)
            if tab.current_frame.row.state == "ready":
                await asyncio.sleep(0.3)
                await tab.send_order(Order(Do.START), 5.0)
    assert time.monotonic() - heard < 4.0
    task.cancel()


# --- without processes
# -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "allowed"),
    [
        ("127.0.0.1:8000", True),
        ("localhost:8000", True),
        ("192.168.1.7:8000", True),
        ("[::1]:8000", True),
        ("cab.farm:8000", True),
        ("evil.example:8000", False),
        ("", False),
        (f"{socket.gethostname()}:8000", True),
        ('127.0.0.1:8000"><script>alert(1)</script>', False),
        ("evil.example@127.0.0.1:8000", False),
        ("127.0.0.1:80:80", False),
        ("[::1]x:8000", False),
        ("localhost\\@evil.example", False),
    ],
)
def test_only_names_of_this_machine_lead_here(asked, allowed):
    assert is_host_allowed(asked, "cab.farm") is allowed


async def test_nothing_of_a_request_stands_in_the_page_as_it_came(monkeypatch):
    """The host's name was written as it was sent: a script in it ran."""
    monkeypatch.setattr(server_module, "is_host_allowed", lambda *_: True)
    server = TabletServer(["x"], "127.0.0.1", 0)
    evil = '"><script>alert(1)</script>'
    request = SimpleNamespace(
        host=f"127.0.0.1:8000{evil}", secure=False, query={"name": evil, "fontsize": evil}
    )
    page = (await server.handle_index(request)).text
    assert "alert(1)</script>" not in page and "&quot;&gt;&lt;script&gt;alert(1)" in page


def test_numbers_out_of_a_query_are_held_in_range():
    assert [parse_bounded_int(text, 16, 8, 40) for text in (None, "x", "1", "20", "999")] == [
        16,
        16,
        8,
        20,
        40,
    ]


def test_a_token_file_is_made_for_its_owner_alone_or_checked(tmp_path):
    path = tmp_path / "sub" / "key"
    assert serve_command.prepare_token(path) and not serve_command.prepare_token(path)
    token = read_token(path)
    assert (
        token is not None and len(token) == 10 and set(token) <= set(serve_command.TOKEN_ALPHABET)
    )
    if os.name == "posix":
        assert path.stat().st_mode & 0o777 == 0o600
    path.write_text("\n", encoding="utf-8")
    with pytest.raises(CommandError, match="is no key"):
        serve_command.prepare_token(path)
    assert (
        read_token(path) is None
        and read_token(tmp_path / "none") is None
        and read_token(None) is None
    )


async def test_a_tab_begins_without_the_token_and_gets_it_only_to_operate():
    where = WorkerAddress(1, "secret", 1)
    app = tablet.make_tab_app(where, "abcd2345")
    assert app.is_view_only and app.source.where.token is None
    assert (await tablet.make_tab_link(False, lambda: where)).where.token is None
    assert (await tablet.make_tab_link(True, lambda: where)).where.token == "secret"
    with pytest.raises(WorkerFailed, match="The console on the machine is not running"):
        await tablet.make_tab_link(True, lambda: None)


def test_limits_come_from_the_log_of_the_job_at_work(tmp_path):
    log = tmp_path / "run.csv"
    assert read_options(WorkerAddress(1, None, 1, "", str(log))) == {} and read_options(None) == {}
    meta = make_run_meta({"flow": {"full_kg": 280.0}}, {"max_rate_kg_ha": 450.0})
    log.with_suffix(".yaml").write_text(format_meta_yaml(meta), encoding="utf-8")
    assert read_options(WorkerAddress(1, None, 1, "", str(log))) == {
        "limits_kg_ha": (0.0, 450.0),
        "hopper_kg": 280.0,
    }


class Said:
    """A tab's socket that says what it is given, and a service that notes what reaches the
    console."""

    def __init__(self, *messages):
        self.messages = [
            SimpleNamespace(type=aiohttp.web.WSMsgType.TEXT, data=text) for text in messages
        ]
        self.sizes, self.bytes, self.pongs = [], [], []

    async def __aiter__(self):
        for message in self.messages:
            yield message

    async def set_terminal_size(self, width, height):
        self.sizes.append((width, height))

    async def send_bytes(self, data):
        self.bytes.append(data)

    async def send_json(self, data):
        self.pongs.append(data)


@pytest.mark.parametrize(
    ("width", "height", "told"),
    [
        ("1e9", "1e9", (MAX_TAB_COLUMNS, MAX_TAB_ROWS)),
        ("-5", "0", (1, 1)),
        ('"x"', "null", (80, 24)),
        ("[]", "{}", (80, 24)),
        ("1e400", "NaN", (80, 24)),
        ("9" * 300, "40", (MAX_TAB_COLUMNS, 40)),
    ],
)
async def test_a_window_stays_bounded_after_the_first_message_too(width, height, told):
    tab = Said(f'["resize", {{"width": {width}, "height": {height}}}]')
    await TabletServer(["x"], "127.0.0.1", 0)._process_messages(tab, tab)
    assert tab.sizes == [told]


@contextlib.asynccontextmanager
async def socket_of(server):
    """The server's socket alone, its consoles a program that says nothing."""
    app = aiohttp.web.Application()
    app.router.add_get("/ws", server.handle_websocket)
    runner = aiohttp.web.AppRunner(app)
    await runner.setup()
    site = aiohttp.web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    try:
        async with aiohttp.ClientSession() as session:
            yield session, f"http://127.0.0.1:{runner.addresses[0][1]}/ws"
    finally:
        await runner.cleanup()


# with a child of its own
STUBBORN = ["sh", "-c", "trap '' TERM; sleep 60 & sleep 60; sleep 60"]


def group(server):
    """The processes of all its consoles, and what those started, that still run. Linux."""
    leaders = {console._process.pid for console in server._consoles if console._process}
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            if int(fields[2]) in leaders and fields[0] != "Z":
                found.add(int(stat.parent.name))
    return found


def running(pids):
    return {
        pid
        for pid in pids
        if Path(f"/proc/{pid}").exists()
        and Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    }


linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts processes in /proc")


@pytest.mark.exam
@posix
async def test_what_is_no_message_of_the_page_ends_the_tab_alone(monkeypatch):
    """Also where its console hangs: it is killed, and its place is free again."""
    monkeypatch.setattr(tab_module, "QUIT_TIMEOUT_S", 0.1)
    server = TabletServer(["sleep", "60"], "127.0.0.1", 0)
    wrong = {
        "[": 1008,
        "{}": 1008,
        "7": 1008,
        "[]": 1008,
        "[" * 5000: 1008,
        '["resize", 7]': 1008,
        '["stdin"]': 1008,
        '["resize", {}]': 1008,
        f'["stdin", "{"x" * MAX_MESSAGE_BYTES}"]': 1009,
    }
    async with socket_of(server) as (session, address), asyncio.timeout(120.0):
        other = await session.ws_connect(address)
        for message, code in wrong.items():
            tab = await session.ws_connect(address)
            await tab.send_str(message)
            assert (
                await tab.receive()
            ).type == aiohttp.WSMsgType.CLOSE and tab.close_code == code, message[:20]
            await tab.close()
            while server.tabs > 1:  # until its console has ended
                await asyncio.sleep(0.02)
        await other.send_json(["ping", "still here"])
        assert await other.receive_json() == ["pong", "still here"]
        await other.close()
        while server.tabs:
            await asyncio.sleep(0.02)


@linux
async def test_no_more_tabs_than_the_computer_carries_counted_until_they_have_ended():
    """20 tabs opened and closed left 20 programs of 75 MB, for what was killed was the shell
    before them."""
    server = TabletServer(STUBBORN, "127.0.0.1", 0)
    async with socket_of(server) as (session, address), asyncio.timeout(120.0):
        tabs = [await session.ws_connect(address) for _ in range(MAX_TABS)]
        with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
            await session.ws_connect(address)
        while len(pids := group(server)) < 3 * MAX_TABS:  # shell and two sleeps each
            await asyncio.sleep(0.02)
        closed_s = time.monotonic()
        for tab in tabs:
            await tab.close()
        while server.tabs:
            # a place is free only once its console has ended
            assert server.tabs >= len(running(pids)) / 3
            await asyncio.sleep(0.02)
        assert time.monotonic() - closed_s < 4.0  # 2 s, and room for a busy machine
        assert not running(pids)


@linux
async def test_ctrl_c_ends_all_consoles_within_two_seconds():
    """Told one after the other, and each waited for, it took 12 s."""
    server = TabletServer(STUBBORN, "127.0.0.1", 0)
    async with socket_of(server) as (session, address), asyncio.timeout(120.0):
        for _ in range(MAX_TABS):
            await session.ws_connect(address)
        while len(pids := group(server)) < 3 * MAX_TABS:
            await asyncio.sleep(0.02)
        began_s = time.monotonic()
        await server.on_shutdown(None)
        assert time.monotonic() - began_s < 2.0
        async with asyncio.timeout(30.0):
            # killed; a busy machine takes a moment to clear a group away
            while running(pids):
                await asyncio.sleep(0.02)


@linux
@pytest.mark.parametrize("asleep", [False, True], ids=["reads", "asleep"])
async def test_ctrl_c_leaves_no_socket_for_which_the_web_server_waits(asleep):
    """It waited half a second for requests that go on, and as long again for those it had cut
    short."""
    server = TabletServer(STUBBORN, "127.0.0.1", 0)
    async with socket_of(server) as (session, address), asyncio.timeout(120.0):
        tabs = [await session.ws_connect(address) for _ in range(MAX_TABS)]
        while len(group(server)) < 3 * MAX_TABS:
            await asyncio.sleep(0.02)
        reading = [] if asleep else [asyncio.create_task(tab.receive()) for tab in tabs]
        await server.on_shutdown(None)
        assert all(
            [
                (await one).type is aiohttp.WSMsgType.CLOSE and (await one).data == 1001
                for one in reading
            ]
        )
        for _turn in range(20):
            await asyncio.sleep(0)
        assert server.tabs == 0  # no request goes on


@posix
def test_a_tab_ends_with_its_server_however_that_ended():
    program = (
        "import os, threading, time; from topdress.console.cli.tablet import end_with_server; "
        "os.setsid();"
        "threading.Thread(target=end_with_server, args=(int(os.environ['SERVER']),), "
        "daemon=True).start();"
        "print(os.getpid(), flush=True); time.sleep(60)"
    )
    server = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import os, subprocess, sys; os.environ['SERVER'] = str(os.getpid());"
            f"subprocess.run([sys.executable, '-c', {program!r}])",
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    tab = int(server.stdout.readline())
    server.kill()
    server.wait()
    until_s = time.monotonic() + 5.0
    with pytest.raises(ProcessLookupError):
        while time.monotonic() < until_s:
            os.kill(tab, 0)
            time.sleep(0.05)
    server.stdout.close()


async def test_text_and_pings_are_taken_as_they_are():
    tab = Said('["stdin", "\\ud800x"]', '["stdin", 7]', f'["ping", "{"p" * 900}"]', '["other", 1]')
    await TabletServer(["x"], "127.0.0.1", 0)._process_messages(tab, tab)
    assert tab.bytes == [b"?x", b"7"] and tab.pongs == [["pong", "p" * 100]]


def test_messages_are_taken_no_faster_than_anybody_types():
    now_s = [0.0]
    pace = MessageThrottle(lambda: now_s[0])
    taken = 0
    while now_s[0] < 10.0:
        now_s[0] += pace.calc_wait_s() + 1e-6
        taken += 1
    assert 900 < taken < 1150


def test_a_wrong_key_makes_every_tab_of_its_address_wait(tmp_path):
    now_s = [100.0]
    path = tmp_path / "run" / "waits.json"
    one, other = (
        TabletKey("right", lambda: now_s[0], SharedKeyWaits(path, "192.168.1.7")) for _ in range(2)
    )
    assert "not the tablet" in one.find_fault("guess")
    assert "wait" in other.find_fault("right"), "also a tab that was loaded again"
    now_s[0] += 1.1
    assert "not the tablet" in other.find_fault("guess") and "wait" in one.find_fault("right")
    assert path.stat().st_mode & 0o077 == 0 or os.name != "posix"
    now_s[0] += 2.1
    assert one.find_fault("right") == "" and other.find_fault("right") == ""
    with take_lock(path.with_suffix(".lock")):
        assert "wait" in one.find_fault("right"), "one guess at a time over all tabs"
    now_s[0] += 0.1
    for spoilt in (
        b"",
        b"[1]",
        b"[60, 1e9]",
        b"{}",
        b'{"192.168.1.7": 7}',
        b'{"192.168.1.7": [NaN, 1e400]}',
    ):
        path.write_bytes(spoilt)
        assert one.find_fault("right") == ""
    path.write_text(f'{{"192.168.1.7": [10, {now_s[0] + 1e6}]}}')
    assert one.find_fault("right") == "", "of a clock that began anew"


def test_wrong_keys_of_one_address_keep_nobody_at_another_out_and_nobody_out_for_long(tmp_path):
    """One a minute kept the owner out for ever."""
    now_s, path = [100.0], tmp_path / "run" / "waits.json"

    def tab(address):
        return TabletKey("right", lambda: now_s[0], SharedKeyWaits(path, address))

    for guess in range(20):
        stranger = tab("192.168.1.66")
        while "not the tablet" not in stranger.find_fault(f"guess {guess}"):
            now_s[0] += 0.5
        assert tab("192.168.1.7").find_fault("right") == "", "the owner, elsewhere"
        assert tab("::ffff:192.168.1.66").wait_left_s is None
        owner = tab("192.168.1.66")  # behind the same tunnel
        assert "wait" in owner.find_fault("right") and owner.wait_left_s <= MAX_KEY_WAIT_S
        now_s[0] += owner.wait_left_s / 2.0
        other = tab("192.168.1.66")
        assert "wait" in other.find_fault("again"), "who comes later waits too"
        now_s[0] += owner.wait_left_s
        # a wrong key is judged first: the owner's turn is not put off
        if guess % 2:
            assert "not the tablet" in other.find_fault("again")
        assert owner.find_fault("right") == ""
    for host in range(300):
        assert "not the tablet" in tab(f"10.1.{host // 256}.{host % 256}").find_fault("guess")
    assert (
        len(json.loads(path.read_text())) <= MAX_ADDRESSES + 1
        and path.stat().st_size < MAX_WAITS_BYTES
    )
    assert "wait" in tab("10.1.1.43").find_fault("right"), "the newest are kept"


@pytest.mark.parametrize(
    ("address", "counted"),
    [
        ("192.168.1.7", "192.168.1.7"),
        ("::ffff:192.168.1.7", "192.168.1.7"),
        ("fd00::1:2:3:4", "fd00::/64"),
        ("fd00::9:9:9:9", "fd00::/64"),
        ("::1", "::/64"),
        ("", ""),
    ],
)
def test_an_address_of_ipv6_counts_as_its_network(address, counted):
    assert find_counting_key(address) == counted


# --- a crowd at the door
# ---------------------------------------------------------------------------------------------


@contextlib.asynccontextmanager
async def listening(free_port, **room):
    """The whole server; gives how often a half-open connection from an address can be made, and
    what became of it."""
    server = TabletServer(
        ["sleep", "60"], "127.0.0.1", free_port, server_module.ConnectionQuota(**room)
    )
    task = asyncio.create_task(server._serve_until_signal())
    made = []

    async def half(source="127.0.0.1"):
        reader, writer = await asyncio.open_connection(
            "127.0.0.1", free_port, local_addr=(source, 0)
        )
        writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1")
        made.append(writer)
        return reader

    async def page():
        async with (
            aiohttp.ClientSession() as session,
            session.get(f"http://127.0.0.1:{free_port}/") as answer,
        ):
            return answer.status, (await answer.text()).rstrip().endswith("</html>")

    try:
        async with asyncio.timeout(20.0):
            while task.done() or not await came(page):
                await asyncio.sleep(0.02)
        yield half, page, f"http://127.0.0.1:{free_port}/ws"
    finally:
        for writer in made:
            writer.close()
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def came(page):
    try:
        return await page() == (200, True)
    except OSError:
        return False


async def ended(reader):
    """Whether the server left it: asked once all that it has to do is done."""
    await asyncio.sleep(0.05)
    return reader.at_eof() or isinstance(reader.exception(), OSError)


@linux
async def test_half_open_connections_take_neither_all_places_nor_those_of_another_address(
    free_port,
):
    """With 1,100 of them no page came, and 292 MB of traces were written in a minute."""
    async with listening(free_port, connections=10) as (half, page, socket_address):
        other = await half("127.0.0.2")
        async with aiohttp.ClientSession() as session:
            tab = await session.ws_connect(socket_address)
            crowd = [await half() for _ in range(60)]
            assert await page() == (200, True)
            gone = [await ended(one) for one in crowd]
            assert gone.count(False) <= 10 and not gone[-1], "the oldest goes"
            assert not await ended(other), "but the crowd's oldest, not another address's"
            await tab.send_json(["ping", "still here"])
            assert await tab.receive_json() == ["pong", "still here"]
            await tab.close()


async def test_a_connection_that_is_no_tab_has_its_time(free_port):
    async with (
        listening(free_port, connection_s=0.3, looked_s=0.05) as (half, page, socket_address),
        aiohttp.ClientSession() as session,
    ):
        tab, silent = await session.ws_connect(socket_address), await half()
        assert not await ended(silent)
        await asyncio.sleep(0.5)
        assert await ended(silent)
        await tab.send_json(["ping", "still here"])
        assert await tab.receive_json() == ["pong", "still here"]
        await tab.close()
        assert await page() == (200, True)


def test_what_the_server_says_fills_no_disk():
    now_s = [0.0]
    few = server_module.RateLimitedFilter(lambda: now_s[0])

    def said(text):
        record = logging.LogRecord(
            "asyncio", logging.ERROR, "f", 1, "%s", (text,), (OSError, OSError(text), None)
        )
        return few.filter(record) and (record.getMessage(), record.exc_info)

    heard = [said("out of files") for _ in range(10_000)]
    assert (
        heard[0] == ("out of files", None)
        and sum(map(bool, heard)) == server_module.MAX_LOG_LINES_PER_MIN
    )
    now_s[0] = 61.0
    assert said("again") == (
        f"again ({10_000 - server_module.MAX_LOG_LINES_PER_MIN} more before it)",
        None,
    )


@posix
def test_a_tab_has_little_memory_and_no_first_claim_on_the_processor():
    program = (
        "import os, resource; from topdress.console.cli.tablet import limit_resources; "
        "before = os.nice(0); "
        "limit_resources();"
        "print(os.nice(0) - before, resource.getrlimit(resource.RLIMIT_AS)[0])"
    )
    said = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    assert int(said[0]) > 0 and int(said[1]) == TAB_MEMORY_BYTES


async def test_a_tab_has_the_name_that_its_address_says_or_where_it_is():
    """And a name that is no name harms neither page nor socket."""
    server, heard = TabletServer(["x"], "127.0.0.1", 0), []

    async def serve_tab(tab, name, width, height):
        heard.append((name, width))

    server._serve_tab = serve_tab
    runner = aiohttp.web.AppRunner(await server._make_app())
    await runner.setup()
    site = aiohttp.web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    address = f"http://127.0.0.1:{runner.addresses[0][1]}"
    try:
        async with aiohttp.ClientSession() as session:
            for named in ("", "?name=Ann%20Li", "?name=%22%3E%3Cscript%3E;%2F..%2F"):
                async with session.get(f"{address}/{named}") as answer:
                    page = await answer.text()
                socket = re.search(r'data-session-websocket-url="ws(:[^"]*)"', page).group(1)
                # as the page's script does
                await session.ws_connect(f"http{socket}?width=100&height=40")
    finally:
        await runner.cleanup()
    assert heard == [("tablet 127.0.0.1", 100), ("Ann Li", 100), ("><script> /../", 100)]
