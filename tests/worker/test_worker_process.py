"""The real program in a process of its own, on a fake machine, over loopback."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import pytest
from topdress.console.cli.tablet import TabLink
from topdress.console.link import Link, WorkerGone
from topdress.console.locale import use_language
from topdress.console.running import WorkerAddress, WorkerFailed, find_running_worker, start_worker
from topdress.console.worker.limits import (
    MAX_AUTHORISED_CLIENTS,
    MAX_CLIENT_REFUSALS,
    MAX_LINE_BYTES,
    MAX_NEW_CLIENTS,
    MAX_VIEWING_CLIENTS,
)
from topdress.control.orders import Answer, Do, Order
from topdress.drivers.files.process_lock import take_lock

from tests.waiting import until

posix = pytest.mark.skipif(os.name != "posix", reason="sends signals")


def raw(where: WorkerAddress) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", where.port), timeout=2)
    client.settimeout(2)
    return client


def answers(client: socket.socket, n: int) -> list[dict]:
    """The next n answers, frames and the greeting passed over."""
    found, rest = [], b""
    while len(found) < n:
        got = client.recv(65536)
        if not got:
            break
        *lines, rest = (rest + got).split(b"\n")
        found += [m for m in map(json.loads, lines) if "answer" in m]
    return found


async def test_attach_and_order(running, attach, log_of):
    where = running()
    link = await attach(where)
    assert (
        link.current_frame.row.state == "ready"
        and link.current_frame.machine == "huanghai"
        and link.current_frame.simulated
    )
    assert await link.send_order(Order(Do.START)) == Answer(True)
    await until(lambda: link.current_frame.row.state == "working")
    assert await link.send_order(Order(Do.MANUAL_RATE, 900.0)) == Answer(False, "rate_above_limit")
    refused = await link.send_order(Order(Do.REFILL, 5.0))
    assert not refused.accepted and refused.why.startswith(
        "internal_error: refill 5.0: RuntimeError"
    )
    assert await link.send_order(Order(Do.HOLD)) == Answer(True)
    await until(lambda: link.current_frame.alarms)
    assert link.current_frame.alarms[0].id == "console_silent" and link.current_frame.alarms[
        0
    ].details == (("age_s", 2.0),)
    await link.stop_worker()
    with pytest.raises(WorkerGone):
        await link.task
    with pytest.raises(WorkerGone):
        await link.send_order(Order(Do.START))
    assert log_of(where)[-1] == {"end": True} and log_of(where)[-2]["state"] == "off"


async def test_the_frame_tells_how_many_consoles_keep_the_machine_working(running, attach):
    """Those that only look are none of them; one that is killed is no longer counted."""
    where = running()
    first = await attach(where)
    await until(lambda: first.current_frame.consoles == 1)
    second = await attach(where)
    await attach(where.drop_token())
    await until(lambda: first.current_frame.consoles == 2)
    second.task.cancel()
    await until(lambda: first.current_frame.consoles == 1)


async def test_frames_of_a_shaft_that_turns_come_at_ten_hertz_and_the_worker_hears_of_us(
    running, attach, log_of
):
    where = running("--hz", "100")
    link = await attach(where)
    seen = set()
    until_s = time.monotonic() + 1.0
    while time.monotonic() < until_s:
        seen.add(link.current_frame.seq)
        await asyncio.sleep(0.005)
    assert 7 <= len(seen) <= 13
    # a word every 0.1 s, twenty times the need
    assert sum(row["age_s"] < 0.3 for row in log_of(where)) > 40
    stats = await link.request_stats()
    assert stats["hz"] == pytest.approx(100.0) and stats["ticks"] > 50 and stats["clients"] == 1
    assert 0.0 < stats["p50_ms"] <= stats["p99_ms"] <= stats["p999_ms"] <= stats["max_ms"]


async def test_without_the_token_a_client_only_looks(running, attach):
    where = running()
    owner, watcher = await attach(where), await attach(where.drop_token())
    assert await owner.send_order(Order(Do.START)) == Answer(True)
    await until(lambda: watcher.current_frame.row.state == "working")
    assert await watcher.send_order(Order(Do.HOLD)) == Answer(False, "unauthorised")
    with pytest.raises(PermissionError, match="unauthorised"):
        await watcher.stop_worker()
    forger = await attach(WorkerAddress(where.port, "f" * 32, where.pid))
    assert await forger.send_order(Order(Do.STOP)) == Answer(False, "unauthorised")
    await asyncio.sleep(0.2)
    assert watcher.current_frame.row.state == "working"
    assert (await owner.request_stats())["unauthorised"] >= 3


CONSOLE = textwrap.dedent("""
    import asyncio, json, signal, sys
    from topdress.console.link import Link
    from topdress.console.running import WorkerAddress
    from topdress.control.orders import Do, Order
    signal.signal(signal.SIGHUP, signal.SIG_DFL)        # a suite under nohup hands its ignoring on
    async def main():
        link = Link(WorkerAddress(**json.loads(sys.argv[1])))
        task = asyncio.create_task(link.run_connection())
        await link.attached.wait()
        await link.send_order(Order(Do.START))
        print("working", flush=True)
        await task
    asyncio.run(main())
""")


@posix
async def test_console_killed_frozen_or_closed_is_held_after_two_seconds(
    running, attach, log_of, tmp_path
):
    """Four consoles, each with a worker of its own, end in four ways at the same time; somebody
    looks on each time."""

    async def one(how: str) -> None:
        where = running(name=how)
        say = json.dumps({"port": where.port, "token": where.token, "pid": where.pid})
        console = subprocess.Popen(
            [sys.executable, "-P", "-c", CONSOLE, say], stdout=subprocess.PIPE
        )
        try:
            assert await asyncio.to_thread(console.stdout.readline) == b"working\n"
            watcher = await attach(where.drop_token())
            os.kill(console.pid, getattr(signal, how))
            await until(lambda: watcher.current_frame.row.state == "held")
            # the log's own thread is a little behind
            await until(lambda: log_of(where)[-1]["state"] == "held")
        finally:
            console.kill()
            console.wait()
            console.stdout.close()
        rows = log_of(where)
        assert 2.0 < next(row for row in rows if row["state"] == "held")["age_s"] < 3.0
        gaps = [b["time_s"] - a["time_s"] for a, b in pairwise(rows)]
        assert max(gaps) < 1.0  # the loop did not even stumble
        # and a new console may attach
        assert find_running_worker(tmp_path / "run" / f"{how}.json") == where

    async def detached() -> None:
        where = running(name="detached")
        owner, watcher = await attach(where), await attach(where.drop_token())
        await owner.send_order(Order(Do.START))
        owner.task.cancel()
        left_s = time.monotonic()
        await until(lambda: watcher.current_frame.row.state == "held")
        assert 1.8 < time.monotonic() - left_s < 6.0  # its last word was up to 0.1 s old
        again = await attach(where)
        # the fake shows the console's age there
        await until(lambda: again.current_frame.row.speed_mps < 1.0)

    await asyncio.gather(one("SIGKILL"), one("SIGSTOP"), one("SIGHUP"), detached())


@posix
async def test_worker_killed_is_told_at_once(running, attach):
    where = running()
    link = await attach(where)
    waiting = asyncio.create_task(link.send_order(Order(Do.START), 5.0))
    await asyncio.sleep(0)
    os.kill(where.pid, signal.SIGKILL)
    killed = time.monotonic()
    with pytest.raises(WorkerGone, match="connection to the machine broke off"):
        await link.task
    assert time.monotonic() - killed < 1.5
    with pytest.raises(WorkerGone):  # nobody waits for an answer that cannot come
        if (await waiting).accepted:
            raise WorkerGone("answered before the kill")


@pytest.mark.parametrize("last", [b'{"frame": "cut off he', b"no message\n", b"x" * 2_000_000])
async def test_a_worker_that_ends_in_the_middle_of_a_line_is_gone(last):
    """Killed while it sends; what raised another error left the console without word of it."""

    async def cut_off(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        writer.write(last)
        await writer.drain()
        writer.close()

    async with await asyncio.start_server(cut_off, "127.0.0.1", 0) as server:
        link = Link(WorkerAddress(server.sockets[0].getsockname()[1], "", 0))
        with pytest.raises(WorkerGone):
            await asyncio.wait_for(link.run_connection(), 10.0)


@pytest.mark.exam
@posix
async def test_a_frozen_worker_costs_an_order_only_its_time_limit(running, attach):
    where = running()
    link = await attach(where)
    os.kill(where.pid, signal.SIGSTOP)
    try:
        began = time.monotonic()
        assert await link.send_order(Order(Do.HOLD)) == Answer(False, "no_answer")
        assert time.monotonic() - began < 5.0
        with pytest.raises(WorkerFailed, match="does not answer"):
            find_running_worker(Path(where.log_path).parent / "run" / "worker.json")
    finally:
        os.kill(where.pid, signal.SIGCONT)


@posix
async def test_terminate_is_a_clean_stop_and_ctrl_c_is_nothing(running, attach, log_of):
    where = running("--hz", "100")
    link = await attach(where)
    await link.send_order(Order(Do.START))
    os.kill(where.pid, signal.SIGINT)
    os.kill(where.pid, signal.SIGHUP)
    await asyncio.sleep(0.2)
    assert not link.task.done() and link.current_frame.row.state == "working"
    os.kill(where.pid, signal.SIGTERM)
    with pytest.raises(WorkerGone):
        await asyncio.wait_for(link.task, 30)
    assert link.current_frame.row.state == "off"  # the last frame still came
    run_file = Path(where.log_path).parent / "run" / "worker.json"
    await until(lambda: not run_file.exists())
    rows = log_of(where)
    assert rows[-1] == {"end": True} and rows[-2]["state"] == "off"
    times = [row["time_s"] for row in rows[:-1]]
    assert len(times) > 4 and times == sorted(times)


async def test_nobody_ever_came(running, log_of):
    where = running("--orphan-s", "0.3")
    run_file = Path(where.log_path).parent / "run" / "worker.json"
    await until(lambda: not run_file.exists())
    assert log_of(where)[-1] == {"end": True} and log_of(where)[-2]["state"] == "off"


async def test_rubbish_is_counted_answered_and_harmless(running, attach):
    where = running("--hz", "50")
    link = await attach(where)
    client = raw(where)
    good = json.dumps({"id": 5, "token": where.token, "do": "hold"}).encode()
    client.sendall(b"\x00\xff{]\n\n[1,2]\n" + b"[" * 30_000 + b"\n" + good[:20])
    time.sleep(0.05)
    client.sendall(good[20:] + b"\n")  # split anywhere
    said = answers(client, 4)
    assert [m["accepted"] for m in said] == [False, False, False, True] and said[-1]["answer"] == 5
    flood = raw(where)
    with pytest.raises(OSError):
        for _ in range(100):
            flood.sendall(b"x" * MAX_LINE_BYTES)
            time.sleep(0.01)
    stats = await link.request_stats()
    assert stats["malformed"] == 3 and stats["oversized"] == 1
    assert stats["skipped"] < 5 and stats["clients"] == 2
    client.close()


async def test_a_client_that_never_reads_stalls_nobody(running, attach):
    where = running("--hz", "100")
    link = await attach(where)
    lazy = socket.socket()
    lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    lazy.connect(("127.0.0.1", where.port))
    alive = json.dumps({"id": 1, "token": where.token, "ask": "alive"}).encode() + b"\n"
    lazy.setblocking(False)
    first = link.current_frame.seq
    began = time.monotonic()
    while time.monotonic() - began < 1.0:
        try:
            lazy.send(alive * 10)
        except BlockingIOError:
            pass
        await asyncio.sleep(0.01)
    stats = await link.request_stats()
    assert stats["dropped_frames"] >= 3
    assert stats["skipped"] < 5
    assert link.current_frame.seq - first > 80  # 100 ticks went by
    assert await link.send_order(Order(Do.START)) == Answer(True)
    lazy.close()


STRANGER = textwrap.dedent("""
    import socket, sys
    while True:
        try:
            with socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=2.0) as one:
                while True:
                    one.settimeout(2.0)
                    one.sendall(b"x\\n" * 30000)
                    one.setblocking(False)
                    try:
                        while one.recv(1 << 16):
                            pass
                    except BlockingIOError:
                        pass
        except OSError:
            pass
""")


@pytest.mark.exam  # eight programs that compute for three seconds
async def test_stop_does_not_wait_behind_strangers_who_flood(running, attach):
    """Each line of theirs was parsed and answered before a word of the console was read: 1.3 s
    with eight of them."""
    where = running()
    link = await attach(where)
    crowd = [subprocess.Popen([sys.executable, "-c", STRANGER, str(where.port)]) for _ in range(8)]
    try:
        await asyncio.sleep(2.0)
        took = []
        for _ in range(9):
            began_s = time.monotonic()
            assert await link.send_order(Order(Do.STOP), 10.0) == Answer(True)
            took.append(time.monotonic() - began_s)
            await asyncio.sleep(0.1)
        assert sorted(took)[4] < 0.4
        assert link.current_frame.row.speed_mps < 1.5  # the fake shows the console's age there
        stats = await link.request_stats(10.0)
        assert stats["clients_put_aside"] >= 8 and stats["malformed"] < 8 * MAX_CLIENT_REFUSALS * 10
        assert (await attach(where)).current_frame is not None  # and a second console gets in
    finally:
        for one in crowd:
            one.kill()
            one.wait()


async def test_a_client_that_only_looks_is_put_aside_when_it_goes_on_asking(running, attach):
    where = running()
    link = await attach(where)
    client = look(where)
    assert answers(client, 1)[0]["accepted"]
    client.sendall(b'{"id": 2, "token": null, "do": "start"}\n' * 100)
    said = answers(client, MAX_CLIENT_REFUSALS)
    assert [one["why"] for one in said] == ["unauthorised"] * (MAX_CLIENT_REFUSALS - 1) + [
        "refused too often"
    ]
    client.settimeout(10)
    assert await asyncio.to_thread(closed, client)
    assert await link.send_order(Order(Do.START)) == Answer(True)


async def test_a_console_that_floods_costs_the_others_little(running, attach):
    """With the key: never put aside, and never more than its lines a turn; stop is taken before
    all that waits."""
    where = running()
    link = await attach(where)
    client = raw(where)
    client.setblocking(False)
    ask = json.dumps({"id": 1, "token": where.token, "ask": "stats"}).encode() + b"\n"
    for _ in range(5):
        with contextlib.suppress(BlockingIOError):
            client.send(ask * 400)
        began_s = time.monotonic()
        assert await link.send_order(Order(Do.STOP), 10.0) == Answer(True)
        assert time.monotonic() - began_s < 1.0
    client.close()


def look(where: WorkerAddress) -> socket.socket:
    client = raw(where)
    client.sendall(b'{"id": 1, "token": null, "ask": "look"}\n')
    return client


def closed(client: socket.socket) -> bool:
    """Whether the worker ended this connection; what it had sent is read."""
    try:
        while client.recv(65536):
            pass
    except TimeoutError:
        return False
    except OSError:
        pass
    return True


async def test_strangers_who_say_nothing_take_no_place(running, attach, tmp_path):
    """As many as a worker has places, all idle: it stays found, no second one starts, its
    console gets in."""
    where = running()
    crowd = [raw(where) for _ in range(MAX_NEW_CLIENTS)]
    assert all(c.recv(100).startswith(b'{"hello"') for c in crowd)
    run_file = tmp_path / "run" / "worker.json"
    assert find_running_worker(run_file) == where and run_file.exists()
    with pytest.raises(WorkerFailed, match=f"runs already on this computer .program {where.pid}"):
        running()
    link = await attach(where)
    assert await link.send_order(Order(Do.START)) == Answer(True)
    await until(lambda: link.current_frame.row.state == "working")
    assert await asyncio.to_thread(closed, crowd[-1])  # none of them is kept
    stats = await link.request_stats()
    assert stats["clients_silent"] >= MAX_NEW_CLIENTS and stats["clients"] == 1
    for client in crowd:
        client.close()


async def test_who_only_looks_never_takes_the_place_of_a_console(running, attach):
    where = running()
    crowd = [look(where) for _ in range(MAX_VIEWING_CLIENTS)]
    assert all(answers(c, 1)[0]["accepted"] for c in crowd)
    assert closed(look(where))
    consoles = [await attach(where) for _ in range(MAX_AUTHORISED_CLIENTS)]
    assert (await consoles[-1].request_stats())["clients_refused"] == 1
    crowd.pop().close()
    await asyncio.sleep(0.3)
    assert (await attach(where.drop_token())).current_frame is not None
    for client in crowd:
        client.close()


async def test_orders_do_not_keep_the_machine_working(running, attach, log_of):
    """A tablet with the key that orders without end, beside a console that froze: the machine
    worked for 9.7 s."""
    where = running()
    watcher = await attach(where.drop_token())
    client = raw(where)
    began_s = time.monotonic()
    for number in range(40):
        do = "start" if number == 0 else "strategy"
        client.sendall(
            json.dumps({"id": number, "token": where.token, "do": do, "value": None}).encode()
            + b"\n"
        )
        await asyncio.sleep(0.1)
        if watcher.current_frame.row.state == "held":
            break
    assert watcher.current_frame.row.state == "held" and time.monotonic() - began_s < 3.5
    client.close()


@pytest.mark.parametrize("token", ["", None, "f" * 32])
async def test_a_sign_of_life_without_the_key_keeps_no_machine_working(running, attach, token):
    """Whoever can reach the port may say that he lives; nobody hears it as a console's."""
    where = running()
    console = await attach(where)
    assert await console.send_order(Order(Do.START)) == Answer(True)
    await until(lambda: console.current_frame.row.state == "working")
    watcher = await attach(where.drop_token())
    console.task.cancel()
    began_s = time.monotonic()
    while watcher.current_frame.row.state == "working" and time.monotonic() - began_s < 10.0:
        # a new one each time: who is refused is put aside
        with contextlib.closing(raw(where)) as client:
            client.sendall(json.dumps({"id": 1, "token": token, "ask": "alive"}).encode() + b"\n")
            await asyncio.sleep(0.3)
    assert watcher.current_frame.row.state == "held" and time.monotonic() - began_s < 3.5


async def test_a_tablets_tab_that_operates_keeps_no_machine_working(running, attach):
    """The tab's own link, with the worker's token: orders are taken, but it is no console."""
    where = running()
    console = await attach(where)
    tab = TabLink(where)
    reading = asyncio.create_task(tab.run_connection())
    await asyncio.wait_for(tab.attached.wait(), 30.0)
    assert await tab.send_order(Order(Do.START)) == Answer(True)
    await until(lambda: tab.current_frame.row.state == "working")
    console.task.cancel()
    began_s = time.monotonic()
    while tab.current_frame.row.state == "working" and time.monotonic() - began_s < 10.0:
        await asyncio.sleep(0.05)
    assert tab.current_frame.row.state == "held" and time.monotonic() - began_s < 3.5
    reading.cancel()


async def test_the_console_lives_as_its_event_loop_turns(running, attach):
    """A loop that stands for 1.65 s is heard in time, for its word before was fresh, and not
    half a second old; one that stands longer is not."""
    where = running()
    link, watcher = await attach(where), await attach(where.drop_token())
    await link.send_order(Order(Do.START))
    time.sleep(1.65)
    await asyncio.sleep(0.45)
    assert watcher.current_frame.row.state == "working"
    time.sleep(2.6)
    await until(lambda: watcher.current_frame.row.state == "held", 5.0)


async def test_looking_with_the_key_does_not_keep_the_machine_working(running, attach, log_of):
    where = running("--orphan-s", "1.0")
    client = raw(where)
    for number in range(15):
        with contextlib.suppress(OSError):
            client.sendall(
                json.dumps({"id": number, "token": where.token, "ask": "look"}).encode() + b"\n"
            )
        await asyncio.sleep(0.1)
    assert log_of(where)[-1] == {"end": True}
    client.close()


@pytest.mark.exam
def test_of_starts_at_the_same_time_one_succeeds(running, tmp_path):
    def start(_: int) -> WorkerAddress | str:
        try:
            return running()
        except WorkerFailed as error:
            return str(error)

    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(start, range(3)))
    started = [one for one in found if isinstance(one, WorkerAddress)]
    assert len(started) == 1
    assert all("runs already" in one for one in found if isinstance(one, str))
    assert find_running_worker(tmp_path / "run" / "worker.json") == started[0]


@pytest.mark.exam
@posix
def test_without_its_run_file_a_worker_still_is_the_only_one(tmp_path, running):
    """Nobody mends the file of a worker that is stopped by a debugger; its lock stands."""
    where = running()
    os.kill(where.pid, signal.SIGSTOP)
    try:
        (tmp_path / "run" / "worker.json").unlink()
        with pytest.raises(
            WorkerFailed, match="did not start: topdress worker: a machine runs already"
        ):
            running()
    finally:
        os.kill(where.pid, signal.SIGCONT)


@pytest.mark.exam
@posix
@pytest.mark.parametrize(
    "removed", [["worker.lock"], ["worker.lock", "worker.json"]], ids=["lock", "both"]
)
def test_a_worker_whose_lock_was_removed_still_is_the_only_one(running, tmp_path, removed):
    """The second one locked a file of the same name, and two workers drove one machine."""
    where = running()
    run_file = tmp_path / "run" / "worker.json"
    for _time in range(2):
        for name in removed:
            (run_file.parent / name).unlink()
        with pytest.raises(
            WorkerFailed, match=f"a machine runs already on this computer .program {where.pid}"
        ):
            running()
        assert find_running_worker(run_file) == where
    until_s = time.monotonic() + 5.0
    # it locks the new file
    while (lock := take_lock(run_file.with_suffix(".lock"))) is not None:
        lock.close()
        assert time.monotonic() < until_s
        time.sleep(0.05)


@posix
def test_a_console_that_looks_removes_no_run_file_of_a_worker_whose_lock_was_removed(
    running, tmp_path
):
    where = running()
    run_file = tmp_path / "run" / "worker.json"
    for _time in range(5):
        (run_file.parent / "worker.lock").unlink(missing_ok=True)
        assert find_running_worker(run_file) == where


@posix
def test_the_run_file_is_private_and_found(running, tmp_path):
    where = running()
    run_file = tmp_path / "run" / "worker.json"
    assert (
        run_file.stat().st_mode & 0o777 == 0o600 and run_file.parent.stat().st_mode & 0o777 == 0o700
    )
    assert find_running_worker(run_file) == where
    assert (
        where.log_path.endswith("worker.log")
        and where.started.endswith("Z")
        and len(where.token) == 32
    )
    with pytest.raises(WorkerFailed, match=f"runs already on this computer .program {where.pid}"):
        running()


@posix
async def test_a_file_left_by_a_dead_worker_is_removed(running, attach, tmp_path):
    where = running()
    os.kill(where.pid, signal.SIGKILL)
    run_file = tmp_path / "run" / "worker.json"
    assert run_file.exists()
    await asyncio.sleep(0.1)
    with pytest.raises(WorkerGone):
        await Link(where).run_connection()
    assert find_running_worker(run_file) is None and not run_file.exists()
    assert running().pid != where.pid


async def test_what_became_of_the_worker_is_said_in_the_language_of_the_screen(tmp_path):
    """It stood in English over a Chinese dialog, which is the one of all that has to be
    understood."""
    run_file = tmp_path / "worker.json"
    run_file.write_text("{}")
    use_language("zh")
    try:
        with pytest.raises(WorkerGone, match="与机器的连接中断了"):
            await Link(WorkerAddress(1, "x", 4711, "")).run_connection()
        with (
            take_lock(run_file.with_suffix(".lock")),
            pytest.raises(WorkerFailed, match="或结束该程序"),
        ):
            find_running_worker(run_file)
    finally:
        use_language("en")


def test_a_port_taken_over_by_another_program_is_not_a_worker(tmp_path):
    run_file = tmp_path / "worker.json"
    with socket.create_server(("127.0.0.1", 0)) as other:
        run_file.write_text(json.dumps({"port": other.getsockname()[1], "token": "x", "pid": 1}))
        assert find_running_worker(run_file) is None and not run_file.exists()


def test_a_port_taken_over_by_another_worker_is_not_ours(running, tmp_path):
    where = running()
    run_file = tmp_path / "old.json"
    run_file.write_text(json.dumps({"port": where.port, "token": "x", "pid": where.pid + 1}))
    assert find_running_worker(run_file) is None and not run_file.exists()


def test_a_worker_that_runs_mends_its_run_file(running, tmp_path):
    where = running()
    run_file = tmp_path / "run" / "worker.json"
    for text in (
        None,
        "",
        "{",
        "[]",
        '{"port": "x"}',
        '{"port": 1}',
        '{"port": 1e400}',
        "[" * 9999,
        '{"port": 1, "token": "x", "pid": 1}',
        '{"port": 70000, "token": "x", "pid": 1}',
    ):
        run_file.unlink()
        if text is not None:
            run_file.write_text(text)
        assert find_running_worker(run_file) == where, text
        assert run_file.stat().st_mode & 0o777 == 0o600, text


@posix
@pytest.mark.parametrize("text", ["", '{"port": 1e400}', '{"port": 70000, "token": "x", "pid": 1}'])
def test_a_wrong_run_file_that_nobody_mends_is_said(tmp_path, text):
    run_file = tmp_path / "worker.json"
    run_file.write_text(text)
    with take_lock(run_file.with_suffix(".lock")), pytest.raises(WorkerFailed, match="end"):
        find_running_worker(run_file)
    assert run_file.read_text() == text


@posix
def test_a_port_that_drips_is_not_waited_for(tmp_path):
    """A byte now and then, and never a whole line: each is answered before the time of a single
    read is over."""
    run_file = tmp_path / "worker.json"
    with (
        socket.create_server(("127.0.0.1", 0)) as dripping,
        take_lock(run_file.with_suffix(".lock")),
    ):

        def drip() -> None:
            with contextlib.suppress(OSError), dripping.accept()[0] as visitor:
                for _ in range(40):
                    visitor.send(b" ")
                    time.sleep(0.1)

        threading.Thread(target=drip, daemon=True).start()
        run_file.write_text(json.dumps({"port": dripping.getsockname()[1], "token": "x", "pid": 1}))
        began_s = time.monotonic()
        with pytest.raises(WorkerFailed, match="does not answer"):
            find_running_worker(run_file)
        # half a second, and room for a busy machine; 4 s without
        assert time.monotonic() - began_s < 2.0


@pytest.mark.parametrize("text", ["", "{", "[]", '{"port": "x"}', '{"port": 1}', "\x00"])
def test_a_spoilt_run_file_is_removed(tmp_path, text):
    run_file = tmp_path / "worker.json"
    run_file.write_text(text)
    assert find_running_worker(run_file) is None and not run_file.exists()
    assert find_running_worker(run_file) is None


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (
            ["--config", "refuse"],
            "topdress worker: cab.yaml: key gnss.port: value 7: allowed: a port name",
        ),
        (["--hz", "200"], "200: allowed are 1 to 100"),
    ],
)
def test_a_worker_that_cannot_start_says_why_in_one_line(running, tmp_path, args, said):
    with pytest.raises(WorkerFailed, match="did not start: .*" + said):
        running(*args)
    assert not (tmp_path / "run" / "worker.json").exists()


def test_a_worker_that_says_nothing_is_ended(tmp_path):
    began = time.monotonic()
    with pytest.raises(WorkerFailed, match="said nothing for"):
        start_worker(
            [],
            tmp_path / "trouble",
            run_file=tmp_path / "w.json",
            timeout_s=0.2,
            program=("-c", "import time; time.sleep(60)"),
        )
    assert time.monotonic() - began < 30.0
