"""Pictures of the screens: `python -m tests.app.gallery docs/screens` draws them all again, the
same every time."""

from __future__ import annotations

import asyncio
import re
import sys
from collections.abc import Awaitable, Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from topdress.console.app.action import CALIBRATE, DEVICES, DIAGNOSIS
from topdress.console.app.app import TopdressApp
from topdress.console.app.frame_history import LiveHistory
from topdress.console.app.pages.diagnosis.page import DiagnosisScreen
from topdress.console.app.pages.map.page import MapScreen
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.replay_source import ReplaySource
from topdress.console.app.services import Services
from topdress.console.app.units import METRIC
from topdress.console.frame import DeviceDo, Frame
from topdress.console.locale import ENGLISH_CODE, use_language
from topdress.console.worker.resume_alarms import AlarmHistory
from topdress.control.diagnosis.result import ModelDeviation
from topdress.control.orders import Answer, Order, State

from tests.app.made_up.diagnosis import OPEN
from tests.app.made_up.job import CUT_OFF, SampleJobService
from tests.app.made_up.poses import pose
from tests.app.made_up.run import run_frames, sample_alarms, sample_services


class StillSource:
    """A source whose newest frame is set by hand; every order is kept and accepted, until `end`
    is given an error."""

    def __init__(self, current_frame: Frame | None = None) -> None:
        self.current_frame = current_frame
        self.orders: list[Order] = []
        self.device_orders: list[tuple[str, DeviceDo]] = []
        self.lag_tests: list[bool] = []
        self.answer = Answer(True)
        self.end: asyncio.Future[None] | None = None

    async def run_connection(self) -> None:
        """Waits until `end` is given an error."""
        self.end = asyncio.get_running_loop().create_future()
        await self.end

    async def send_order(self, order: Order) -> Answer:
        if self.end is not None and self.end.done():
            self.end.result()
        self.orders.append(order)
        return self.answer

    async def send_device_order(self, name: str, do: DeviceDo) -> Answer:
        self.device_orders.append((name, do))
        return self.answer

    async def send_lag_test_order(self, begin: bool) -> Answer:
        self.lag_tests.append(begin)
        return self.answer


class StillClock:
    """A clock that stands until it is set."""

    def __init__(self, now_s: float = 1000.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s


class Picture(NamedTuple):
    name: str
    size: tuple[int, int]
    theme: str = "day"
    language: str = ENGLISH_CODE
    screen: str = "run"  # a page, help, gone
    alarms: bool = False


def pictures(names: str) -> tuple[Picture, ...]:
    """By names of page, size, and what of theme and language is not day and English; a ! where
    alarms stand."""

    def named(name: str) -> Picture:
        page, wide, high, rest = re.split(r"-(\d+)x(\d+)", name.removesuffix("!"))
        more = rest.split("-")
        return Picture(
            name.removesuffix("!"),
            (int(wide), int(high)),
            next((one for one in ("night", "contrast") if one in more), "day"),
            "zh" if "zh" in more else ENGLISH_CODE,
            page,
            "alarms" in more or name.endswith("!"),
        )

    return tuple(map(named, names.split()))


OTHERWISE: dict[str, dict[str, Any]] = {
    "replay-120x40-zh": {"theme": "night"},
    "calibrate-80x24-day": {"screen": "calibrate-running"},
}
PICTURES = tuple(
    one._replace(**OTHERWISE.get(one.name, {}))
    for one in pictures("""
    run-120x40-day run-120x40-night run-120x40-contrast! run-120x40-alarms run-120x40-zh!
    run-100x30-day run-80x24-day
    run-80x24-night run-80x24-alarms run-60x16! run-check-120x40-day run-check-80x24-day
    run-check-unnamed-80x24-night
    run-check-held-120x40-day run-check-unsure-120x40-zh run-check-unsure-80x24-day map-120x40-day
    map-120x40-night
    map-near-120x40-day map-80x24-day! map-120x40-zh map-laid-120x40-day map-laid-80x24-night
    map-laid-80x24-zh!
    trends-120x40-day trends-120x40-night trends-read-100x30-day trends-80x24-day!
    trends-120x40-zh replay-120x40-day
    replay-120x40-night replay-80x24-day replay-80x24-night replay-120x40-zh diagnosis-120x40-day
    diagnosis-120x40-night diagnosis-100x30-day diagnosis-80x24-day diagnosis-120x40-zh
    diagnosis-list-80x24-night
    diagnosis-import-100x30-day devices-120x40-day devices-120x40-night devices-80x24-day!
    devices-120x40-zh
    calibrate-120x40-day calibrate-120x40-night calibrate-running-120x40 calibrate-80x24-day
    calibrate-120x40-zh
    calibrate-lag-100x30 calibrate-heads-100x30 calibrate-wheel-80x24-night job-120x40-day
    job-120x40-night
    job-80x24-day! job-120x40-zh settings-120x40-day settings-120x40-night settings-80x24-day
    settings-120x40-zh
    alarm-list-100x30! power-cut-100x30 help-100x30 gone-100x30
""")
)

MOVING = (
    "run-120x40-day",
    "map-120x40-day",
    "devices-120x40-day",
    "diagnosis-120x40-day",
    "job-120x40-day",
)
EACH_S = 4

DONE_ON: dict[str, tuple[str, ...]] = {  # actions that bring a page to a picture
    "map-near": ("map_layer", "map_layer", "map_follow", "map_out"),
    "trends-read": ("trends_longer", "trends_far_left", "trends_far_left", "trends_far_left"),
}


_FILLS_LESS = ModelDeviation("flow", "flow.fill_falloff", -4.0, 300.0, adoptable=True)
# what the model check says on the Run page, and in which state
CHECKED: dict[str, tuple[State, ModelDeviation]] = {
    "run-check": (State.WORKING, _FILLS_LESS),
    "run-check-unnamed": (State.WORKING, ModelDeviation("shaft", "", None, 240.0, False)),
    "run-check-held": (State.HELD, _FILLS_LESS),
    "run-check-unsure": (
        State.HELD,
        _FILLS_LESS._replace(
            certain=False,
            adoptable=False,
            next_run="Two ground speeds: 3 and 6 km/h in turn, two minutes each.",
        ),
    ),
}


@cache
def _frames() -> tuple[Frame, ...]:
    return tuple(run_frames())


@cache
def _history() -> LiveHistory:
    """Of all that came before the frame that is shown."""
    history = LiveHistory()
    for frame in _frames()[:-1]:
        history.add_frame(frame)
    return history


def still_app(picture: Picture) -> tuple[TopdressApp, StillClock]:
    """An app that shows one picture: nothing in it moves by itself."""
    frames = list(_frames())
    if picture.alarms:
        last = frames[-1]
        row = last.row._replace(
            applied_rate_kg_ha=(last.row.target_rate_kg_ha or 0.0) * 0.86,
            nudge_percent=5.0,
            hopper_kg=18.5,
        )
        frames[-1] = replace(
            last,
            row=row,
            alarms=sample_alarms(last.at_s),
            metres_left_m=640.0,
            dropped_heads=(4,),
            usable_speed_mps=1.81,
        )
    if picture.screen in CHECKED:
        frames[-1] = replace(
            frames[-1], row=frames[-1].row._replace(state=CHECKED[picture.screen][0])
        )
    clock = StillClock()
    replay = None
    if picture.screen == "replay":
        began, ended = len(frames) * 3 // 5, len(frames) * 13 // 20
        alarms = sample_alarms(frames[began].at_s)[1:]
        marked = [
            replace(frame, alarms=alarms) if began <= index < ended else frame
            for index, frame in enumerate(frames)
        ]
        source = ReplaySource(marked, clock)
        source.seek_time(300.0)
        source.set_speed(10.0)
        replay = ReplayJob(source, "run.csv", ("2 rows with a time that runs back were left out",))
    app = TopdressApp(
        None if replay else StillSource(frames[-1]),
        clock,
        replay=replay,
        language=picture.language,
        theme=picture.theme,
        units=METRIC,
        utc_offset_s=8 * 3600.0,
        live=False,
        services=_services(picture),
    )
    app.history = deepcopy(_history())
    return app, clock


def _services(picture: Picture) -> Services:
    services, checked = sample_services(), CHECKED.get(picture.screen)
    return services if checked is None else replace(services, model_check=lambda _: checked[1])


async def settle(app: TopdressApp, picture: Picture, wait: Callable[[], Awaitable[None]]) -> None:
    """Bring a still app to what its picture shows."""
    await wait()
    app.show_newest()
    where = picture.screen.partition("-")[0]
    if where in app.pages and app.page.where != where:
        app.turn_to_page(where)
        await wait()
        app.show_newest()
    if where == DIAGNOSIS:
        await prepare_diagnosis(app, picture.screen, wait)
    if (
        where in (DEVICES, CALIBRATE)
        and isinstance(app.source, StillSource)
        and app.source.current_frame is not None
    ):
        app.source.current_frame = pose(app, picture.screen, app.source.current_frame)
        app.show_newest()
    if picture.screen == "map-laid" and isinstance(app.page, MapScreen):
        app.page.overlay_file("/logs/autumn.geojson")
    await _lay_over(app, picture)
    await wait()
    await wait()
    for worker in [
        worker for worker in app.workers if worker.group in ("field", "laid", "job-look")
    ]:
        await worker.wait()
    app.page.refresh_all_next_tick()
    app.show_newest()
    for action in DONE_ON.get(picture.screen, ()):
        await app.action_do(action)
        await wait()
    await wait()


async def _lay_over(app: TopdressApp, picture: Picture) -> None:
    """What lies over the page in some pictures."""
    if picture.screen == "alarm-list":
        app.alarm_history = AlarmHistory()
        for frame in _frames()[-200:]:
            standing = [
                one for one in sample_alarms(_frames()[-1].at_s) if one.since_s <= frame.at_s
            ]
            app.alarm_history.add_row_alarms(frame.row.time_s, frame.row.utc, standing)
        await app.action_do("alarm_list")
    if picture.screen == "power-cut":
        app.ask_to_resume_job(SampleJobService(cut_off=CUT_OFF))
    if picture.screen == "help":
        await app.action_do("help")
    if (
        picture.screen == "gone"
        and isinstance(app.source, StillSource)
        and app.source.end is not None
    ):
        from topdress.console.link import WorkerGone

        app.start = app.attach = _never
        app.source.end.set_exception(WorkerGone("the connection to the machine broke off"))


async def prepare_diagnosis(
    app: TopdressApp, screen: str, wait: Callable[[], Awaitable[None]]
) -> None:
    """The list of files; and, unless that alone is wanted, what was found in the second, or is
    not known of another."""
    await _worked(app, wait)
    if screen == "diagnosis-import" and isinstance(app.page, DiagnosisScreen):
        app.page.show_open_questions(OPEN)
        await wait()
    if screen == "diagnosis":
        await app.action_do("dia_down")
        await app.action_do("dia_begin")
        await _worked(app, wait)


async def _worked(app: TopdressApp, wait: Callable[[], Awaitable[None]]) -> None:
    for worker in [worker for worker in app.workers if worker.group in ("list", "work")]:
        await worker.wait()
    await wait()
    app.show_newest()
    await wait()


async def _never() -> StillSource:
    return StillSource()


async def draw(picture: Picture) -> str:
    """The picture as SVG."""
    app, _clock = still_app(picture)
    async with app.run_test(size=picture.size) as pilot:
        await settle(app, picture, pilot.pause)
        return app.export_screenshot(title="topdress", simplify=True)


def moving(pictures: Sequence[str]) -> str:
    """Pictures of one size as one that moves: each for `EACH_S`, in turn; the first alone where
    nothing may move."""
    size = pictures[0].split('viewBox="')[1].split('"')[0]
    each = "".join(
        f'<g class="page" style="animation-delay:{EACH_S * k}s">{one}</g>'
        for k, one in enumerate(pictures)
    )
    return (
        f'<svg viewBox="{size}" xmlns="http://www.w3.org/2000/svg"><style>'
        f"@keyframes show {{ 0% {{ visibility: visible }} {100 / len(pictures)}%, 100% {{ "
        f"visibility: hidden }} }}"
        ".page { visibility: hidden } .page:first-of-type { visibility: visible }"
        "@media (prefers-reduced-motion: no-preference) { .page, .page:first-of-type { "
        "visibility: hidden;"
        f"animation: show {EACH_S * len(pictures)}s step-end infinite }} }}</style>{each}</svg>"
    )


def main(folder: str) -> None:
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    for picture in PICTURES:
        svg = asyncio.run(draw(picture))
        (target / f"{picture.name}.svg").write_text(svg, encoding="utf-8")
        print(f"{picture.name}.svg")
    drawn = [(target / f"{name}.svg").read_text(encoding="utf-8") for name in MOVING]
    (target / "moving.svg").write_text(moving(drawn), encoding="utf-8")
    use_language(ENGLISH_CODE)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("python -m tests.app.gallery FOLDER")
    main(sys.argv[1])
