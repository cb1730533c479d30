"""A still app for every test: seeded frames, a clock that stands, English, no colour or theme
from outside."""

from __future__ import annotations

import asyncio
import os
from contextlib import asynccontextmanager
from time import monotonic, process_time

for _name in ("NO_COLOR", "TEXTUAL_THEME"):  # textual reads them when it is imported
    os.environ.pop(_name, None)

import pytest  # noqa: E402
import textual.app  # noqa: E402
import textual.pilot  # noqa: E402
from rich.console import RenderableType  # noqa: E402
from textual._compositor import Compositor  # noqa: E402
from textual.app import App  # noqa: E402
from textual.css.model import RuleSet  # noqa: E402
from textual.css.stylesheet import Stylesheet  # noqa: E402
from textual.pilot import Pilot  # noqa: E402
from topdress.console.app.app import TopdressApp  # noqa: E402
from topdress.console.app.pages.replay.service import ReplayJob  # noqa: E402
from topdress.console.app.replay_source import ReplaySource  # noqa: E402
from topdress.console.locale import ENGLISH_CODE, use_language  # noqa: E402

from tests.app import harness  # noqa: E402
from tests.app.gallery import Picture, StillClock, StillSource, still_app  # noqa: E402
from tests.app.made_up import run as sample  # noqa: E402

# as Textual's own wait: what falls due sooner is waited for,
LOOK_S = 0.02
# and so little is done meanwhile by a thread that only waits
IDLE_S = 0.001
try:
    SCHEDULED = os.open("/proc/self/schedstat", os.O_RDONLY)
except OSError:
    SCHEDULED = -1


def _queued_s() -> float:
    """How long the thread that draws stood in the queue for a processor; 0 where the system
    does not say."""
    return int(os.pread(SCHEDULED, 64, 0).split()[1]) * 1e-9 if SCHEDULED >= 0 else 0.0


def _next_s(loop) -> float:
    """Seconds to what the loop does next; LOOK_S where nothing falls due before."""
    due = (handle.when() - loop.time() for handle in loop._scheduled if not handle.cancelled())
    return 0.0 if loop._ready else max(0.0, min(due, default=LOOK_S))


def _threads_work(loop) -> bool:
    pool = loop._default_executor
    return pool is not None and len(pool._threads) > pool._idle_semaphore._value


async def come_to_rest(_min_sleep: float = 0.0, max_sleep: float = 1.0) -> None:
    """Textual's `wait_for_idle` by what the program does: its loop has nothing to do, and no
    thread computes for it.

    Textual waits 20 ms at least, and a second at most, which a program that shares its
    processor with many is not given: here the second is one in which it could run.
    """
    loop = asyncio.get_running_loop()
    start_s = monotonic() - _queued_s()
    while monotonic() - _queued_s() - start_s < max_sleep:
        wait_s = LOOK_S if _threads_work(loop) else min(_next_s(loop), LOOK_S)
        if wait_s < LOOK_S:
            await asyncio.sleep(wait_s)
            computes, still = _threads_work(loop), False
        else:
            # The time of a process takes 0.7 ms to read where many threads run.
            before_s = process_time()
            await asyncio.sleep(wait_s)
            # something that repeats, and does little
            still = (spent_s := process_time() - before_s) < IDLE_S
            computes = _threads_work(loop) and spent_s > IDLE_S
        if still or (not computes and _next_s(loop) >= LOOK_S):
            return


@pytest.fixture(autouse=True)
def _rest(monkeypatch):
    """A key is over when what it did is drawn; a test gets its pilot when the first page is."""
    press, begin = Pilot.press, App.run_test

    async def pressed(pilot: Pilot, *keys: str) -> None:
        await press(pilot, *keys)
        await pilot.pause()

    @asynccontextmanager
    async def begun(app: App, **of):
        async with begin(app, **of) as pilot:
            await pilot.pause()
            yield pilot

    for module in (textual.app, textual.pilot):
        monkeypatch.setattr(module, "wait_for_idle", come_to_rest)
    monkeypatch.setattr(Pilot, "press", pressed)
    monkeypatch.setattr(App, "run_test", begun)


_draw_update = Compositor.render_update


def _forget_update(
    compositor: Compositor, full=False, screen_stack=None, simplify=False
) -> RenderableType | None:
    """A picture that is exported is drawn whole; what would go to a terminal is not drawn."""
    if full:
        return _draw_update(compositor, full, screen_stack, simplify)
    compositor._dirty_regions.clear()
    return None


@pytest.fixture
def drawn_at_once():
    """Asks for every change to be drawn when it is made, for tests of the drawing itself."""


@pytest.fixture(autouse=True)
def _draw_when_read(request, monkeypatch):
    """A screen is drawn where a test reads it (`rows_of`, pictures): nobody sees what a headless
    app sends to its terminal, which is half of an app's work."""
    if "drawn_at_once" not in request.fixturenames:
        monkeypatch.setattr(Compositor, "render_update", _forget_update)


@pytest.fixture(autouse=True, scope="session")
def _styles_read_once():
    """Each app reads some fifty style sheets, twice: a quarter of what its start costs. They
    are the same in all."""
    parse, known = Stylesheet._parse_rules, {}

    def parsed(sheet: Stylesheet, css, read_from, is_default_rules=False, tie_breaker=0, scope=""):
        key = (
            css,
            read_from,
            is_default_rules,
            tie_breaker,
            scope,
            tuple(sorted(sheet._variables.items())),
        )
        if key not in known:
            known[key] = parse(sheet, css, read_from, is_default_rules, tie_breaker, scope)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Stylesheet, "_parse_rules", parsed)
        # the same, without a call for each rule and widget
        patch.setattr(RuleSet, "__hash__", object.__hash__)
        yield


@pytest.fixture(autouse=True)
def _english(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    use_language(ENGLISH_CODE)
    yield
    use_language(ENGLISH_CODE)


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
    return TopdressApp(
        source, clock, live=False, utc_offset_s=0.0, services=sample.sample_services()
    )


@pytest.fixture
async def pilot(request):
    """Drives the app that the test asks for, `full` or `app`, on a terminal of its `size`, else
    of its file's SIZE."""
    asked = request.fixturenames
    app = request.getfixturevalue("full" if "full" in asked else "app")
    size = (
        request.getfixturevalue("size")
        if "size" in asked
        else getattr(request.module, "SIZE", (120, 40))
    )
    async with app.run_test(size=size) as pilot:
        yield pilot


@pytest.fixture
def turned():
    return harness.turned


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

    return harness.rows_of


@pytest.fixture
def picture():
    def make(**of) -> TopdressApp:
        return still_app(Picture("test", **of))[0]

    return make
