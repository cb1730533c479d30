"""Twenty stories of a day in the cab, by real keys on the simulated machine: what the screen
says, what the ground got.

`python -m benchmarks session` all of them, a line each; `NAME` one of them. `--slow`: in this
terminal, to be watched, as fast as in the field; `--size 80x24`; `--picture FILE.svg`: how the
screen looks at the end.

The console is the real one and gets its keys from Textual's pilot; worker, loop, bytes and
plant are those of `loss_table`, on one injected clock, so that minutes in the field take
seconds. What the ground got is what the plant let go, not what the console believes.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, NamedTuple

from loss_table import Hosted
from rig import DT_S
from textual.pilot import Pilot
from topdress.console.app.app import TopdressApp
from topdress.console.app.services import Services
from topdress.console.app.units import METRIC
from topdress.console.frame import DeviceDo, Frame
from topdress.console.locale import ENGLISH_CODE, use_language
from topdress.console.services.field import make_field_picture
from topdress.console.worker.assemble import PARKED_STATES
from topdress.control.orders import Answer, Order

SIZE = (120, 40)
# between two looks of the console, as it has them live, and between two keys
LOOK_S = 0.2
FAST_S = 2.0  # between two looks where nobody watches
NO_KG = 1e-4  # what a shaft that stands lets go by rounding


class Ground(NamedTuple):
    """What left the outlets: kg, over so many metres of way with flow, hence kg/ha; and the
    kg/ha that were wanted."""

    kg: float
    way_m: float
    kg_ha: float
    wanted_kg_ha: float

    def since(self, before: Ground, width_m: float) -> Ground:
        """Of two running sums: kg and wanted kg/ha times m."""
        kg, way_m = self.kg - before.kg, self.way_m - before.way_m
        if way_m <= 0.0:
            return Ground(kg, way_m, 0.0, 0.0)
        return Ground(
            kg,
            way_m,
            10_000.0 * kg / (way_m * width_m),
            (self.wanted_kg_ha - before.wanted_kg_ha) / way_m,
        )


class Field(Hosted):
    """The machine, its driver parked until it works, and what it let go so far."""

    def __init__(
        self, folder: Path, job: str = "demo", effects: tuple[str, ...] = (), **sim: Any
    ) -> None:
        self.sums = Ground(0.0, 0.0, 0.0, 0.0)
        super().__init__(folder, effects, job, **sim)
        self.width_m = self.setup.machine.geometry.working_width_m

    def tick(self, each: Callable[[], object] = lambda: None) -> None:
        self.plant.parked = self.loop.safety.state in PARKED_STATES
        before_m = self.truth.driven_m if self.plant.truth is not None else 0.0
        super().tick(each)
        kg = self.truth.flow_kg_s * DT_S
        way_m = self.truth.driven_m - before_m if kg > 0.0 else 0.0
        kg_all, way_all_m, _rate, wanted = self.sums
        self.sums = Ground(
            kg_all + kg,
            way_all_m + way_m,
            0.0,
            wanted + way_m * (self.row.target_rate_kg_ha or 0.0),
        )


class FieldSource:
    """`console.app.frame_source.FrameSource` of it."""

    def __init__(self, field: Field) -> None:
        self._field = field

    @property
    def current_frame(self) -> Frame | None:
        return self._field.host.newest_frame

    async def run_connection(self) -> None:
        await asyncio.get_running_loop().create_future()

    async def send_order(self, order: Order) -> Answer:
        return self._field.ask(order.do, order.value)

    async def send_device_order(self, name: str, do: DeviceDo) -> Answer:
        return Answer(False, "not_known")

    async def send_lag_test_order(self, begin: bool) -> Answer:
        return Answer(False, "not_known")


class Seat:
    """Who sits in the cab: presses, waits, looks. Raises AssertionError where something is not
    as it should be."""

    def __init__(self, field: Field, app: TopdressApp, pilot: Pilot[None], slow: bool) -> None:
        self.field, self.app, self.pilot, self.slow = field, app, pilot, slow
        self.keys = 0

    async def press(self, *keys: str) -> None:
        for key in keys:
            await self.pilot.press(key)
            self.keys += 1
            await self.go(LOOK_S if not self.slow else 1.0)

    async def go(self, seconds: float) -> None:
        """So long in the field."""
        until_s, each_s = self.field.now_s + seconds - 0.5 * DT_S, LOOK_S if self.slow else FAST_S
        while self.field.now_s < until_s:
            self.field.go(min(each_s, until_s - self.field.now_s + DT_S))
            self.app.show_newest()
            await (asyncio.sleep(LOOK_S) if self.slow else self.pilot.pause(0))

    async def confirm(self, seconds: float) -> None:
        """Enter, once the question has stood for a second; then so long in the field."""
        await self.go(1.0)
        await self.press("enter")
        await self.go(seconds)

    async def work(self, seconds: float = 20.0) -> None:
        await self.go(1.0)
        await self.press("r", "s")
        await self.go(seconds)
        self.sees("WORKING")

    async def got(self, seconds: float) -> Ground:
        """What the ground gets in the next seconds."""
        before = self.field.sums
        await self.go(seconds)
        return self.field.sums.since(before, self.field.width_m)

    @property
    def screen(self) -> str:
        return "\n".join(strip.text for strip in self.app.screen._compositor.render_strips())

    def sees(self, *words: str) -> None:
        seen = " ".join(self.screen.split())
        for one in words:
            assert one in seen, f"not seen: {one}\n{self.screen}"

    def sees_no(self, *words: str) -> None:
        for one in words:
            assert one not in self.screen, f"seen: {one}\n{self.screen}"


class Session(NamedTuple):
    """keys: with which it is started."""

    play: Callable[[Seat], Awaitable[Ground]]
    machine: dict[str, Any]

    @property
    def story(self) -> str:
        return (self.play.__doc__ or "").split("\n")[0]


SESSIONS: dict[str, Session] = {}


def session(
    **machine: Any,
) -> Callable[[Callable[[Seat], Awaitable[Ground]]], Callable[[Seat], Awaitable[Ground]]]:
    def kept(play: Callable[[Seat], Awaitable[Ground]]) -> Callable[[Seat], Awaitable[Ground]]:
        SESSIONS[play.__name__] = Session(play, machine)
        return play

    return kept


def near(got: Ground, wanted_kg_ha: float | None = None, percent: float = 6.0) -> Ground:
    """Without a rate: what was wanted all the way."""
    wanted_kg_ha = wanted_kg_ha or got.wanted_kg_ha
    assert abs(got.kg_ha - wanted_kg_ha) <= 0.01 * percent * wanted_kg_ha, (
        f"{got.kg_ha:.0f} kg/ha where {wanted_kg_ha:.0f} are wanted"
    )
    return got


def nothing(got: Ground) -> Ground:
    assert got.kg <= NO_KG, f"{1000.0 * got.kg:.1f} g left the machine"
    return got


@session()
async def first_pass(seat: Seat) -> Ground:
    """R, S: the first minute of a pass gets what the canopy asks for."""
    await seat.work()
    return near(await seat.got(60.0))


@session()
async def hold_and_on(seat: Seat) -> Ground:
    """Space stops the flow within a second; S goes on where it was."""
    await seat.work()
    await seat.press("space")
    await seat.go(1.6)
    seat.sees("HELD")
    nothing(await seat.got(10.0))
    await seat.press("s")
    await seat.go(8.0)
    return near(await seat.got(20.0))


@session()
async def stop_at_once(seat: Seat) -> Ground:
    """X: off. S alone starts nothing, and says that R comes first."""
    await seat.work()
    await seat.press("x")
    await seat.go(1.6)
    await seat.press("s")
    seat.sees("OFF", "Press R first")
    return nothing(await seat.got(10.0))


@session()
async def start_from_the_map(seat: Seat) -> Ground:
    """F3, Ctrl+S, Enter: a machine that is ready begins to work without the Run page."""
    await seat.go(1.0)
    await seat.press("r", "f3", "ctrl+s")
    seat.sees("begins to spread as soon as it moves")
    await seat.confirm(15.0)
    seat.sees("WORKING")
    return near(await seat.got(30.0))


@session()
async def other_strategy(seat: Seat) -> Ground:
    """T, 2, Enter at work: speed first, without a gap on the ground."""
    await seat.work()
    await seat.press("t", "2", "enter")
    await seat.go(2.0)
    seat.sees("speed first")
    return near(await seat.got(30.0))


@session()
async def five_percent_more(seat: Seat) -> Ground:
    """M, +, Enter: the ground gets 5 % more than the manual rate."""
    await seat.work()
    await seat.press("m", "2", "0", "0", "enter")
    await seat.go(1.0)
    await seat.press("enter", "plus", "enter")
    await seat.go(12.0)
    seat.sees("+5 %")
    return near(await seat.got(40.0), 210.0)


@session()
async def taken_back(seat: Seat) -> Ground:
    """+, Enter, then Ctrl+Z, Enter: the rate is again what it was."""
    await seat.work()
    await seat.press("full_stop")
    await seat.go(1.0)
    await seat.press("enter", "plus", "enter")
    await seat.go(1.0)
    await seat.press("ctrl+z")
    seat.sees("nudge +0 %")
    await seat.confirm(12.0)
    return near(await seat.got(40.0), 150.0)


@session()
async def preset(seat: Seat) -> Ground:
    """. and Enter: the second preset rate everywhere."""
    await seat.work()
    await seat.press("full_stop", "enter")
    await seat.go(12.0)
    return near(await seat.got(40.0), 150.0)


@session()
async def typed_rate(seat: Seat) -> Ground:
    """M, a number, Enter, Enter; a number above what is allowed is refused and changes nothing."""
    await seat.work()
    await seat.press("m", "9", "9", "9", "9", "enter")
    seat.sees("is too much")
    await seat.press("escape")
    await seat.go(3.0)
    await seat.press("m", "1", "8", "0", "enter")
    await seat.confirm(12.0)
    return near(await seat.got(40.0), 180.0)


@session()
async def back_to_canopy(seat: Seat) -> Ground:
    """A manual rate, then O, 1, Enter, and Enter to the question: the canopy decides again."""
    await seat.work()
    await seat.press("comma", "enter")
    await seat.go(10.0)
    near(await seat.got(20.0), 100.0)
    await seat.press("o", "1", "enter")
    seat.sees("Change the dose from 100 kg/ha to")
    await seat.confirm(10.0)
    seat.sees("from canopy")
    got = await seat.got(20.0)
    assert got.kg_ha > 150.0, got
    return got


@session(job="map_demo", begin_m=0.0)
async def by_the_map(seat: Seat) -> Ground:
    """A job with a map: what is planned where the machine is, is what the ground gets."""
    await seat.work(30.0)
    seat.sees("from map")
    return near(await seat.got(30.0))


@session(hopper_kg=60.0)
async def refill(seat: Seat) -> Ground:
    """Space, F, kilograms, Enter: the log has the refill; then on. The simulated tractor drives on
    while work is held, so the refill is asked again."""
    await seat.work()
    await seat.press("space")
    await seat.go(3.0)
    keys = seat.keys
    await seat.press("f", "5", "0", "enter")
    seat.sees("The machine moves")
    await seat.press("enter")
    assert seat.keys - keys <= 5
    assert any(one.do == "refill" for one in seat.field.host.newest_frame.ordered) or "refill" in (
        Path(seat.field.writer.path).read_text(encoding="utf-8")
    )
    await seat.press("s")
    await seat.go(8.0)
    return near(await seat.got(20.0))


@session(hopper_kg=2.0, refill_at_kg=0.0)
async def empty_hopper(seat: Seat) -> Ground:
    """The hopper runs empty at work: held, said, and the cause is there as long as it is empty."""
    await seat.work(5.0)
    await seat.go(60.0)
    seat.sees("The hopper is empty")
    seat.sees_no("cause gone", "WORKING")
    return nothing(await seat.got(20.0))


@session()
async def wheel_sticks(seat: Seat) -> Ground:
    """The wheel sensor sticks: held, and said what to look at; once it counts again, A and S go
    on."""
    await seat.work()
    seat.field.wheel.stuck = True
    await seat.go(20.0)
    seat.sees("HELD", "gives no pulses", "Check the wheel sensor")
    nothing(await seat.got(5.0))
    seat.field.wheel.stuck = False
    await seat.go(10.0)
    await seat.press("a", "s")
    await seat.go(10.0)
    return near(await seat.got(30.0))


@session()
async def late_on_purpose(seat: Seat) -> Ground:
    """L, Enter: look-ahead off is said on the page as long as it is."""
    await seat.work()
    await seat.press("l")
    seat.sees("late")
    await seat.confirm(3.0)
    seat.sees("look-ahead", "OFF")
    return near(await seat.got(30.0))


@session()
async def without_the_scale(seat: Seat) -> Ground:
    """W, Enter: the scale corrects no more; the machine file's flow goes on."""
    await seat.work()
    await seat.press("w")
    await seat.confirm(3.0)
    seat.sees("OFF")
    return near(await seat.got(30.0))


@session()
async def allowed(seat: Seat) -> Ground:
    """H, 1, Enter allows reversing until STOP, which takes it back."""
    await seat.work()
    await seat.press("h")
    seat.sees("allow: flow while reversing", "STOP forbids all of them again")
    await seat.press("1", "enter")
    await seat.go(1.0)
    seat.sees("REVERSE OK")
    await seat.press("x")
    await seat.go(2.0)
    seat.sees_no("REVERSE OK")
    return nothing(await seat.got(10.0))


@session()
async def locked(seat: Seat) -> Ground:
    """F8: a sleeve on the keys changes nothing; Space still holds."""
    await seat.work()
    await seat.press("f8", "t", "m", "comma", "plus", "enter")
    seat.sees("LOCKED", "WORKING")
    near(await seat.got(15.0))
    await seat.press("space")
    await seat.go(1.6)
    seat.sees("HELD")
    return nothing(await seat.got(10.0))


@session()
async def round_the_pages(seat: Seat) -> Ground:
    """F2 to F11 at work: looking at every page leaves no gap on the ground."""
    await seat.work()
    before = seat.field.sums
    for key in ("f3", "f4", "f5", "f6", "f9", "f10", "f11", "f2"):
        await seat.press(key)
        await seat.go(3.0)
        seat.sees("WORKING")
    return near(seat.field.sums.since(before, seat.field.width_m))


@session()
async def night_and_chinese(seat: Seat) -> Ground:
    """D, then G and Enter at work: another look, another language, the same rate."""
    await seat.work()
    await seat.press("d", "g")
    await seat.confirm(2.0)
    seat.sees("作业")
    return near(await seat.got(20.0))


async def play(
    one: Session, size: tuple[int, int] = SIZE, slow: bool = False, picture: Path | None = None
) -> Ground:
    """What the ground got in the part of it that counts. Raises AssertionError."""
    with tempfile.TemporaryDirectory() as folder:
        field = Field(Path(folder), **one.machine)
        app = TopdressApp(
            FieldSource(field),
            field.clock,
            live=False,
            utc_offset_s=0.0,
            language=ENGLISH_CODE,
            units=METRIC,
            services=Services(field=make_field_picture),
        )
        got: list[Ground] = []

        async def in_the_cab(pilot: Pilot[None]) -> None:
            got.append(await one.play(Seat(field, app, pilot, slow)))
            if picture is not None:
                picture.write_text(
                    app.export_screenshot(title=one.play.__name__, simplify=True), encoding="utf-8"
                )
            app.exit()

        try:
            if slow:
                await app.run_async(auto_pilot=in_the_cab)
            else:
                async with app.run_test(size=size) as pilot:
                    await in_the_cab(pilot)
        finally:
            field.host.close_run("done")
            # of the whole process: a story may have changed it
            use_language(ENGLISH_CODE)
        return got[0]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks session")
    parser.add_argument(
        "name", nargs="*", choices=[[], *SESSIONS], metavar="NAME", help=", ".join(SESSIONS)
    )
    parser.add_argument("--slow", action="store_true")
    parser.add_argument("--size", default="120x40")
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    columns, _x, rows = asked.size.partition("x")
    failed = 0
    for name in asked.name or SESSIONS:
        try:
            got = asyncio.run(
                play(SESSIONS[name], (int(columns), int(rows)), asked.slow, asked.picture)
            )
            said = (
                f"{got.kg:6.2f} kg on {got.way_m:5.1f} m: {got.kg_ha:4.0f} kg/ha, wanted "
                f"{got.wanted_kg_ha:4.0f}"
            )
        except AssertionError as error:
            failed, said = failed + 1, f"NOT SO: {error}"
        print(f"{name:18}  {said}   {SESSIONS[name].story}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
