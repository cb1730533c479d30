"""A still app for every test: seeded frames, a clock that stands, English, no colour or theme from outside."""
from __future__ import annotations

import os

for _name in ("NO_COLOR", "TEXTUAL_THEME"):          # textual reads them when it is imported
    os.environ.pop(_name, None)

import pytest  # noqa: E402

from console.app import sample  # noqa: E402
from console.app.app import TopdressApp  # noqa: E402
from console.app.gallery import Picture, StillClock, StillSource, still_app  # noqa: E402
from console.app.replay_job import ReplayJob  # noqa: E402
from console.app.replay_source import ReplaySource  # noqa: E402
from console.locale import ENGLISH, use  # noqa: E402


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
