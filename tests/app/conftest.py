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
SCHEDULED = Path("/proc/self/schedstat")


def _queued_s() -> float:
    """How long the thread that draws stood in the queue for a processor; 0 where the system does not tell."""
    try:
        return int(SCHEDULED.read_text().split()[1]) * 1e-9
    except (OSError, IndexError):
        return 0.0


async def come_to_rest(min_sleep: float = LOOK_S, max_sleep: float = 1.0) -> None:
    """Textual's `wait_for_idle`, by time in which the program could run.

    Where many programs share a processor, the second that it waits at most is over before a page is drawn.
    """
    start_s = monotonic() - _queued_s()
    while True:
        ran_s = process_time()
        await asyncio.sleep(LOOK_S)
        ran_s = process_time() - ran_s
        could_run_s = monotonic() - _queued_s() - start_s
        if could_run_s >= max_sleep or (could_run_s > min_sleep and ran_s < IDLE_S):
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
def full(source, clock):
    """The app with services: every page can do its work."""
    return TopdressApp(source, clock, live=False, utc_offset_s=0.0, services=sample.sample_services())


@pytest.fixture
def turned():
    """Turns to a page, and waits until it is drawn."""
    async def turn(app, pilot, where):
        app.turn_to(where)
        for _ in range(3):
            await pilot.pause()

    return turn


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
