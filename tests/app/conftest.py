"""A still app for every test: seeded frames, a clock that stands, English, no colour or theme from outside."""
from __future__ import annotations

import asyncio
import os
from pathlib import Path
from time import monotonic, process_time

for _name in ("NO_COLOR", "TEXTUAL_THEME"):          # textual reads them when it is imported
    os.environ.pop(_name, None)

import pytest  # noqa: E402
import textual.app  # noqa: E402
import textual.pilot  # noqa: E402

from console.app import sample  # noqa: E402
from console.app.app import TopdressApp  # noqa: E402
from console.app.gallery import Picture, StillClock, StillSource, still_app  # noqa: E402
from console.app.replay_job import ReplayJob  # noqa: E402
from console.app.replay_source import ReplaySource  # noqa: E402
from console.locale import ENGLISH, use  # noqa: E402

LOOK_S = 0.02               # as Textual's own wait: between two looks,
IDLE_S = 0.001              # and how little is done between them where nothing is left to do


def _queued_s() -> tuple[float, float]:
    """How long the first thread, and all others together, stood in the queue for a processor; 0 where none tells."""
    try:
        waits = {task.name: int((task / "schedstat").read_text().split()[1]) * 1e-9
                 for task in Path("/proc/self/task").iterdir()}
    except (OSError, IndexError):
        return 0.0, 0.0
    first = waits.pop(str(os.getpid()), 0.0)
    return first, sum(waits.values())


async def come_to_rest(min_sleep: float = LOOK_S, max_sleep: float = 1.0) -> None:
    """Textual's `wait_for_idle`, by time in which the program could run.

    Where many programs share a processor, its second at most is over before a page is drawn, and a thread that stands
    in the queue looks as idle as one that is done.
    """
    start_s, (start_queued_s, _) = monotonic(), _queued_s()
    while True:
        ran_s, (_, others_s) = process_time(), _queued_s()
        await asyncio.sleep(LOOK_S)
        ran_s = process_time() - ran_s
        queued_s, others_now_s = _queued_s()
        could_run_s = monotonic() - start_s - (queued_s - start_queued_s)
        if could_run_s >= max_sleep:
            return
        if could_run_s > min_sleep and ran_s < IDLE_S and others_now_s - others_s < IDLE_S:
            return


@pytest.fixture(autouse=True)
def _rest(monkeypatch):
    for module in (textual.app, textual.pilot):
        monkeypatch.setattr(module, "wait_for_idle", come_to_rest)


@pytest.fixture(autouse=True)
def _english(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    use(ENGLISH)
    yield
    use(ENGLISH)


@pytest.fixture(scope="session")
def frames():
    """60 s of a quiet run, five frames a second."""
    return sample.run_frames(seconds=60.0)


@pytest.fixture
def clock():
    return StillClock()


@pytest.fixture
def source(frames):
    return StillSource(frames[-1])


@pytest.fixture
def app(source, clock):
    return TopdressApp(source, clock, live=False, utc_offset_s=0.0)


@pytest.fixture
def replay_source(frames, clock):
    return ReplaySource(frames, clock)


@pytest.fixture
def replay_app(replay_source, clock):
    job = ReplayJob(replay_source, "run.csv", ("3 rows had no time",))
    return TopdressApp(None, clock, replay=job, live=False, utc_offset_s=0.0)


@pytest.fixture
def shown():
    """All text on the screen, row by row."""

    def read(app: TopdressApp) -> list[str]:
        from textual.geometry import Region
        width, height = app.size
        lines = app.screen._compositor.render_strips()
        assert Region(0, 0, width, height).area
        return [strip.text for strip in lines]

    return read


@pytest.fixture
def picture():
    def make(**of) -> TopdressApp:
        return still_app(Picture("test", **of))[0]

    return make
