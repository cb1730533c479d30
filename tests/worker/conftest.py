from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import json
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from topdress.console.link import Link, WorkerGone
from topdress.console.running import WorkerAddress, start_worker
from topdress.console.worker.loop_host import Host
from topdress.console.worker.run_interfaces import RunAssembly, RunNames

FAKE = Path(__file__).with_name("fake_worker.py")


@pytest.fixture(scope="session")
def fake() -> ModuleType:
    """The fakes of `fake_worker.py`."""
    spec = importlib.util.spec_from_file_location("topdress_fake_worker", FAKE)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def rig(fake: ModuleType) -> Callable[..., SimpleNamespace]:
    """A host on fakes and a clock that only `sleep` and the test move."""

    def make(**options: Any) -> SimpleNamespace:
        made = SimpleNamespace(
            now_s=0.0,
            slept=[],
            bench=fake.FakeBench(),
            loop=fake.FakeLoop(),
            writer=fake.FakeWriter(),
            on_sleep=lambda: None,
        )

        def sleep(seconds: float) -> None:
            made.slept.append(seconds)
            made.now_s += seconds
            made.on_sleep()

        parts = RunAssembly(
            made.bench,
            made.loop,
            made.writer,
            RunNames("job", "huanghai", "wheat", "run.csv", True),
        )
        made.host = Host(parts, lambda: made.now_s, sleep, **options)
        return made

    return make


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Callable[..., WorkerAddress]]:
    """Start real worker processes on the fake machine; those still running are ended after the
    test."""
    started: list[WorkerAddress] = []

    def start(*args: str, name: str = "worker", **options: Any) -> WorkerAddress:
        where = start_worker(
            ["--log", str(tmp_path / f"{name}.log"), *args],
            tmp_path / f"{name}.trouble",
            run_file=tmp_path / "run" / f"{name}.json",
            program=("-P", str(FAKE)),
            **{"timeout_s": 60.0, **options},
        )
        started.append(where)
        return where

    yield start
    for where in started:
        with contextlib.suppress(ProcessLookupError):
            os.kill(where.pid, signal.SIGTERM)


@pytest.fixture
async def attach() -> AsyncIterator[Callable[[WorkerAddress], Any]]:
    """Attach a Link and wait for its first frame; `link.task` is its running `run`."""
    tasks: list[asyncio.Task[Any]] = []

    async def to(where: WorkerAddress) -> Link:
        link = Link(where)
        link.task = asyncio.create_task(link.run_connection())  # type: ignore[attr-defined]
        tasks.append(link.task)  # type: ignore[attr-defined]
        await asyncio.wait_for(link.attached.wait(), 30)
        return link

    yield to
    for task in tasks:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError, WorkerGone):
            await task


@pytest.fixture
def log_of() -> Callable[[WorkerAddress], list[dict[str, Any]]]:
    """The rows of a fake worker's log that are whole; the line `end` becomes {"end": true}."""

    def read(where: WorkerAddress) -> list[dict[str, Any]]:
        lines = Path(where.log_path).read_text(encoding="utf-8").split("\n")[:-1]
        return [{"end": True} if line == "end" else json.loads(line) for line in lines]

    return read
