"""What a console waits for until its first number: neither for modules nor for the next frame."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import subprocess
import sys

from topdress.console.link import Link
from topdress.console.running import WorkerAddress
from topdress.console.worker.link_server import LinkServer


async def test_who_comes_gets_the_newest_frame_at_once(rig):
    made = rig()
    made.host.run_one_tick(0.0)  # one frame, and none after it
    server = LinkServer(made.host, "key")
    server.start()
    links = [
        Link(WorkerAddress(server.port, "key", os.getpid()), name) for name in ("first", "second")
    ]
    tasks = []
    try:
        for link in links:
            tasks.append(asyncio.create_task(link.run_connection()))
            await asyncio.wait_for(link.attached.wait(), 5.0)
        assert [link.current_frame.seq for link in links] == [made.host.newest_frame.seq] * 2
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        server.close_link()


async def test_the_first_numbers_move_at_once_though_the_machine_stands(rig):
    """Half a second without a change looks like a picture that hangs."""
    made = rig()
    turns = made.loop.run_tick

    def stands(*given, **named):
        made_of = turns(*given, **named)
        return dataclasses.replace(made_of, row=made_of.row._replace(shaft_rpm=0.0))

    made.loop.run_tick = stands
    made.host.run_one_tick(0.0)
    server = LinkServer(made.host, "key")
    server.start()
    link = Link(WorkerAddress(server.port, "key", os.getpid()), "first")
    task, seen = asyncio.create_task(link.run_connection()), set()
    try:
        await asyncio.wait_for(link.attached.wait(), 5.0)
        for k in range(1, 21):  # a second
            made.host.run_one_tick(0.05 * k)
            await asyncio.sleep(0.05)
            seen.add(link.current_frame.seq)
        # ten a second, on a busy machine too; standing it is two
        assert len(seen) >= 6, seen
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        server.close_link()


def loaded_with(modules: str, *heavy: str) -> str:
    """Which of some modules a fresh interpreter has loaded after importing others."""
    said = subprocess.run(
        [
            sys.executable,
            "-c",
            f"import sys, {modules}; print([name for name in {heavy} if name in sys.modules])",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    return said.stdout.strip()


def test_the_right_to_be_the_worker_is_taken_before_the_modules_are_read():
    """A new lock settles for 0.4 s: they come up meanwhile."""
    assert (
        loaded_with(
            "topdress.console.worker.__main__",
            "numpy",
            "pydantic",
            "yaml",
            "topdress.control.loop",
            "topdress.drivers.cab",
        )
        == "[]"
    )


def test_the_worker_is_started_before_the_console_reads_what_it_draws_with():
    assert (
        loaded_with(
            "topdress.console.cli.run, topdress.console.cli.screens, topdress.console.running, "
            "topdress.console.services.launcher",
            "asyncio",
            "textual",
            "numpy",
            "yaml",
            "topdress.console.app",
        )
        == "[]"
    )
