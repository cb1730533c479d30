"""The virtual machine served to another program: the console's worker on real sockets and
terminals."""

from __future__ import annotations

import asyncio
import contextlib
import operator
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from topdress.console.link import Link, WorkerGone
from topdress.console.running import start_worker
from topdress.control.orders import Do, Order
from topdress.drivers.files.config import find_shipped_files
from topdress.drivers.files.read_log import read_log

from tests.command import serving


@pytest.fixture
def served() -> Iterator:
    """Start `topdress serve-machine`; gives device -> URLs, and when it began."""
    with contextlib.ExitStack() as started:
        yield lambda *options: (
            started.enter_context(serving("--seed", "3", *options)),
            time.monotonic(),
        )


def cab_file(folder: Path, urls: dict[str, list[str]]) -> str:
    heads = [urls[f"head_{n}"][0] for n in range(1, 7)]
    path = folder / "cab.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "format": "topdress-cab/1",
                "virtual": True,
                "gnss": {"port": urls["gnss"][0]},
                "heads": {"ports": heads},
                "board": {"port": urls["board"][0]},
            }
        )
    )
    return str(path)


def job_file(folder: Path) -> str:
    """The shipped job with a short way to the field."""
    job = yaml.safe_load(find_shipped_files("jobs")["demo"].read_text())
    job["simulated"]["run_in_m"] = 2.0
    path = folder / "job.yaml"
    path.write_text(yaml.safe_dump(job))
    return str(path)


@contextlib.asynccontextmanager
async def console(folder: Path, *config: str):
    """A worker on that cab and a console that operates it."""
    files = [word for file in config for word in ("--config", file)]
    where = await asyncio.to_thread(
        start_worker,
        [*files, "--log", str(folder / "run.csv")],
        folder / "trouble",
        run_file=folder / "w.json",
    )
    link = Link(where)
    running = asyncio.create_task(link.run_connection())
    await asyncio.wait_for(link.attached.wait(), 10)
    try:
        yield link
    finally:
        with contextlib.suppress(Exception):
            await link.stop_worker()
        running.cancel()
        with contextlib.suppress(WorkerGone, asyncio.CancelledError):
            await running


async def until(link: Link, what, timeout_s: float = 15.0):
    deadline = time.monotonic() + timeout_s
    while not what(link.current_frame):
        assert time.monotonic() < deadline, (
            link.current_frame.row.state,
            link.current_frame.alarms,
        )
        await asyncio.sleep(0.02)
    return link.current_frame


def has(frame, alarm: str) -> bool:
    return any(one.id == alarm for one in frame.alarms)


async def start_work(link: Link) -> None:
    await until(
        link,
        lambda frame: (frame.row.speed_used_mps or 0.0) > 0.5 and frame.row.shaft_rpm is not None,
    )
    if link.current_frame.row.state != "ready":
        for alarm in link.current_frame.alarms:
            await link.send_order(Order(Do.ACKNOWLEDGE, alarm.id))
        await link.send_order(Order(Do.READY))
        await until(link, lambda frame: frame.row.state == "ready")
    await link.send_order(Order(Do.START))


@pytest.mark.exam
async def test_work_over_tcp_with_the_board_unplugged_and_plugged_in_again(served, tmp_path):
    job = job_file(tmp_path)
    urls, began_s = served("--job", job, "--fault", "unplug:board@7+1")
    async with console(tmp_path, cab_file(tmp_path, urls), job) as link:
        await start_work(link)
        frame = await until(link, lambda frame: (frame.row.applied_rate_kg_ha or 0.0) > 100.0)
        if time.monotonic() - began_s >= 7.0:
            pytest.skip("too slow a computer for this time line: nothing is proven")
        assert frame.simulated
        assert {device.name for device in frame.devices} == {
            "gnss",
            "board",
            *(f"head_{n}" for n in range(1, 7)),
        }
        assert all(device.connected and device.rejected == 0 for device in frame.devices)
        frame = await until(link, lambda frame: has(frame, "shaft_silent"))
        assert 7.0 < time.monotonic() - began_s < 9.0
        assert frame.row.state == "fault" and frame.row.shaft_rpm_cmd == 0.0
        await until(link, lambda frame: frame.row.shaft_rpm is not None)
        await start_work(link)
        await until(link, lambda frame: (frame.row.applied_rate_kg_ha or 0.0) > 100.0)
    log = read_log(tmp_path / "run.csv")
    states = [row.state for row in log.rows()]
    assert states[-1] == "off" and {"working", "fault"} <= set(states)
    times_s = [row.time_s for row in log.rows()]
    assert max(map(operator.sub, times_s[1:], times_s)) < 0.5, "nothing is missing from the log"
    assert (tmp_path / "trouble").read_text() == ""
