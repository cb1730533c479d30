"""Random steps of the control loop with wild places, times and numbers.

A machine drives to and fro on a field and works, by any strategy, at times with START held down
while it creeps; a tractor tells speeds to come. A share of its readings, of the times of its
ticks and of its orders is wild: no number, infinite, from the future, from the past, elsewhere
on earth. The interlocks are written here a second time, from docs/safety.md, and with a memory
of their own; every command that turns the shaft is held against them, every command against the
limits of the drives, every row against the log's text and the console's frame. Every other run
is of a machine whose sections have valves: none may be open without flow, or where a hand has
closed it.
"""

from __future__ import annotations

import datetime as dt
import random
from math import cos, hypot, inf, isfinite, nan, radians, sin
from typing import Any

import pytest
from shapely import Point, Polygon
from topdress.console.frame import Frame
from topdress.console.worker.run_interfaces import FRAME_FIELDS
from topdress.console.worker.wire_format import format_frame
from topdress.control.field.job import Job, Wanted
from topdress.control.geodesy import TangentPlane
from topdress.control.log_row import ALL_COLUMNS, COLUMNS
from topdress.control.loop import ControlLoop
from topdress.control.loop.tick import Tick
from topdress.control.orders import PLACE_SOURCES, Do, Order, State, Strategy, TargetSource
from topdress.control.readings import AnnouncedSpeeds, GnssFix, Measurements, Reading
from topdress.control.simulation.assembly import add_simulated_field, make_control_loop
from topdress.drivers.files.log_text import RowText
from topdress.drivers.files.run_setup import load_setup

STEPS_A_RUN = 2000
DT_S = 0.05
WILD = (nan, inf, -inf, 1e308, -1e308, 1e-320, -0.0, -1.0, 1e6, -1e6, 400.0, 0.0)
LATE_S = (0.0, 0.0, 0.1, 0.4, 0.6, 1.0, 3.0, 60.0, -0.05, -0.3, -5.0, -1e9, 1e9, nan, inf, -inf)
TICKS_S = (0.0, 0.01, 0.2, 0.6, 2.0, 30.0, -0.05, -10.0, -1e9, nan, inf, -inf, 1e9)
AWAY_M = (0.5, 5.0, 30.0, 1e3, 5e4, 5e6)
SETTLING = (Order(Do.ACKNOWLEDGE, ""), Order(Do.READY), Order(Do.START))
VALUES = (
    None,
    True,
    False,
    "",
    "map",
    "manual",
    "balanced",
    0.3,
    -30.0,
    250.0,
    nan,
    inf,
    1e308,
    "x" * 999,
)
ORDERS = [Order(do, value) for do in Do for value in VALUES]
SECTION_ORDERS = [
    Order(Do.SECTION, value) for value in ("1 off", "2 off", "3 off", "2 auto", "all auto", "9 off")
]
LIVELY = [order for order in ORDERS if order.do is not Do.STOP]


class Rules:
    """The published interlocks again, over all that was measured and ordered so far."""

    def __init__(self, job: Job, has_switch: bool) -> None:
        self._field = Polygon(job.field.boundary_m) if job.field.boundary_m else None
        self._has_switch = has_switch
        self._now_s: float | None = None
        self._standing = 0
        self._pulse_s = self._speed_s = -inf

    def broken(
        self, m: Measurements, console_s: float | None, log_ok: bool, tick: Tick
    ) -> list[str]:
        went_on = isfinite(m.time_s) and (self._now_s is None or self._now_s < m.time_s)
        self._standing = 0 if went_on else self._standing + 1
        if went_on:
            self._now_s = m.time_s
        now_s = self._now_s if self._now_s is not None else nan
        wheel, fix = m.wheel_speed_mps, m.gnss
        if wheel is not None and 0.0 < wheel.value <= 30.0 and _fresh(wheel.time_s, now_s, inf):
            self._pulse_s = max(self._pulse_s, wheel.time_s)
            self._speed_s = max(self._speed_s, wheel.time_s)
        if (
            fix is not None
            and fix.speed_mps is not None
            and 0.0 <= fix.speed_mps <= 30.0
            and _fresh(fix.time_s, now_s, inf)
        ):
            self._speed_s = max(self._speed_s, fix.time_s)
        command, allow, state = tick.command, tick.allow, tick.verdict.state
        opened = [k for k, on in enumerate(command.valves, start=1) if on is not False]
        closed = [
            name
            for name, bad in (
                ("valve_without_flow", bool(opened and tick.verdict.why_no_flow)),
                (
                    "valve_not_working",
                    bool(opened) and state not in (State.WORKING, State.CALIBRATING),
                ),
                (
                    "valve_by_hand",
                    state is State.WORKING and bool(set(opened) & set(tick.choices.sections_off)),
                ),
            )
            if bad
        ]
        turns_well = command.shaft_rpm == 0.0 or 10.0 <= command.shaft_rpm <= 100.0
        found = closed + ([] if turns_well and 0.0 <= command.opening_mm <= 60.0 else ["limits"])
        if command.shaft_rpm == 0.0 and command.dose is None:
            return found
        found += [
            name
            for name, bad in (
                ("not_working", state not in (State.WORKING, State.CALIBRATING)),
                ("shaft_silent", not _known(m.shaft_rpm, now_s, 0.5)),
                ("gate_silent", not _known(m.opening_mm, now_s, 0.5)),
                ("clock_stands", self._standing > 12),
                (
                    "work_switch_up",
                    m.work_switch is False or (self._has_switch and m.work_switch is None),
                ),
            )
            if bad
        ]
        if state is not State.WORKING:
            return found
        row = tick.row
        return found + [
            name
            for name, bad in (
                ("log_failed", not log_ok and not allow.unlogged),
                ("console_silent", console_s is not None and not console_s <= 2.0),
                ("standstill", not now_s - self._pulse_s <= 0.8 + 1e-6),
                ("speed_silent", not now_s - self._speed_s <= 3.0 + 1e-6),
                (
                    "target_refused",
                    row.target_rate_kg_ha is not None
                    and not 0.0 <= row.target_rate_kg_ha <= 1000.0,
                ),
                (
                    "position_lost",
                    tick.choices.source in PLACE_SOURCES and not tick.sensed.position_ok,
                ),
                (
                    "outside_field",
                    self._field is not None and not allow.outside and not self._may_land(tick),
                ),
            )
            if bad
        ]

    def _may_land(self, tick: Tick) -> bool:
        """Whether some place within the reach of the lag, from where the loop thinks it is,
        lies in the field."""
        place, speed_mps = tick.place_m, tick.row.speed_used_mps
        if (
            place is None
            or not (isfinite(place[0]) and isfinite(place[1]))
            or speed_mps is None
            or self._field is None
        ):
            return False
        return bool(self._field.distance(Point(place)) <= 3.0 + 4.0 * speed_mps)


def _fresh(time_s: float, now_s: float, holds_s: float) -> bool:
    return -0.1 - 1e-9 <= now_s - time_s <= holds_s + 1e-9


def _known(reading: Reading | None, now_s: float, holds_s: float) -> bool:
    return (
        reading is not None and isfinite(reading.value) and _fresh(reading.time_s, now_s, holds_s)
    )


class Machine:
    """A machine that drives to and fro, and what its sensors say; `wild` of all that is said is
    wild."""

    def __init__(self, chance: random.Random, job: Job, wild: float) -> None:
        self._chance, self._wild = chance, wild
        origin = job.field.origin_lat_deg, job.field.origin_lon_deg
        self._plane = TangentPlane(*origin)
        corners = (
            Polygon(job.field.boundary_m).bounds if job.field.boundary_m else (0.0, 0.0, 40.0, 60.0)
        )
        self._east_m, self._south_m, self._north_m = (
            0.5 * (corners[0] + corners[2]),
            corners[1],
            corners[3],
        )
        self._driven_m, self._true_s = chance.uniform(0.0, 50.0), 0.0
        self._speed_mps = chance.choice((0.4, 0.8, 1.2, 2.0))
        self._said: dict[str, Any] = {}
        self._off: tuple[float, float] | None = None
        self._skew_s = 0.0
        self._announces = chance.random() < 0.5  # the tractor speaks
        self._frozen = 0  # ticks for which clock and devices still stand
        self._last: Measurements | None = None

    def measure(self) -> Measurements:
        if self._frozen > 0 and self._last is not None:
            self._frozen -= 1
            return self._last
        if self._odd(0.002):
            self._frozen = 40
        self._last = self._measured()
        return self._last

    def _measured(self) -> Measurements:
        chance = self._chance
        self._true_s += DT_S
        self._driven_m += self._speed_mps * DT_S
        if chance.random() < 0.002:
            self._speed_mps = chance.choice((0.0, 0.15, 0.25, 0.4, 0.8, 1.2, 2.0, 4.0))
        now_s = self._true_s + self._skew_s
        if chance.random() < 0.02 * self._wild:
            now_s += chance.choice(TICKS_S if chance.random() < 0.2 else TICKS_S[:-5])
            if chance.random() < 0.3 and abs(now_s) < 1e6:
                self._skew_s = now_s - self._true_s
        span_m = self._north_m - self._south_m + 20.0
        legs, along_m = divmod(self._driven_m, span_m)
        back = int(legs) % 2 == 1
        north_m = self._south_m - 10.0 + (span_m - along_m if back else along_m)
        for name, value in (
            ("wheel_speed_mps", self._speed_mps),
            ("shaft_rpm", 40.0),
            ("opening_mm", 25.0),
            ("hopper_kg", 200.0),
            ("supply_v", 12.5),
            ("pitch_deg", 0.0),
            ("roll_deg", 0.0),
        ):
            if not self._quiet():
                self._said[name] = self._reading(value, now_s)
        if not self._quiet():
            self._said["ndvi"] = tuple(self._reading(0.6, now_s) for _ in range(6))
        if not self._quiet():
            self._said["gnss"] = self._fix(now_s, self._east_m, north_m, 180.0 if back else 0.0)
        if self._odd(0.05):
            self._said["work_switch"] = chance.choice((True, False, None))
        self._tell(now_s)
        if self._odd(0.05):
            self._said.pop(chance.choice(sorted(self._said)), None)
        return Measurements(
            now_s,
            **{"work_switch": True} | self._said,
            drive_fault=self._odd(0.01),
            drive_stopped=self._odd(0.01),
        )

    def _tell(self, now_s: float) -> None:
        """What the tractor says of its speeds."""
        if not self._announces or self._quiet():
            return
        chance = self._chance
        points = [(0.0, self._speed_mps), (1.0, chance.choice((0.0, 1.2, 3.0)))][
            : chance.choice((1, 2))
        ]
        if self._odd(0.1):
            points[-1] = chance.choice(WILD), chance.choice(WILD)
        self._said["speed_told"] = AnnouncedSpeeds(
            now_s - (chance.choice(LATE_S) if self._odd(0.1) else 0.0),
            tuple(points),
            chance.choice(WILD) if self._odd(0.05) else 0.5,
        )

    def _odd(self, share: float) -> bool:
        return self._chance.random() < share * self._wild

    def _quiet(self) -> bool:
        return self._odd(0.3)

    def _reading(self, value: float, now_s: float) -> Reading:
        said = self._chance.choice(WILD) if self._odd(0.1) else value
        return Reading(said, now_s - (self._chance.choice(LATE_S) if self._odd(0.1) else 0.0))

    def _fix(self, now_s: float, east_m: float, north_m: float, heading_deg: float) -> GnssFix:
        chance = self._chance
        if self._odd(0.05):
            away_m, angle = chance.choice(AWAY_M), radians(chance.uniform(0.0, 360.0))
            self._off = (
                None if chance.random() < 0.5 else (away_m * sin(angle), away_m * cos(angle))
            )
        off = self._off or (0.0, 0.0)
        lat_deg, lon_deg = _degrees(self._plane, east_m + off[0], north_m + off[1])
        speed: float | None = self._speed_mps
        if self._odd(0.05):
            lat_deg, lon_deg = chance.choice((lat_deg, *WILD)), chance.choice((lon_deg, *WILD))
        if self._odd(0.05):
            speed = chance.choice((None, *WILD))
        course = (
            chance.choice((None, *WILD, chance.uniform(0.0, 360.0)))
            if self._odd(0.05)
            else heading_deg
        )
        return GnssFix(
            now_s - (chance.choice(LATE_S) if self._odd(0.05) else 0.0),
            lat_deg,
            lon_deg,
            chance.choice((0, 1, 9, -1)) if self._odd(0.05) else 4,
            14,
            chance.choice((None, *WILD)) if self._odd(0.05) else 0.8,
            speed,
            course,
            chance.choice((None, "2014-03-07T08:00:00.000Z")),
        )


def _degrees(plane: TangentPlane, east_m: float, north_m: float) -> tuple[float, float]:
    if hypot(east_m, north_m) > 1e6:
        return -45.0, 100.0
    return plane.convert_to_deg(east_m, north_m)


def _order(loop: ControlLoop, chance: random.Random) -> None:
    if chance.random() < 0.2:
        loop.handle_order(Order(Do.START, True))
    if chance.random() < 0.05:
        for order in SETTLING:
            loop.handle_order(order)
    if chance.random() < 0.01:
        loop.handle_order(chance.choice(SECTION_ORDERS))
    if chance.random() < 0.005:
        loop.handle_order(chance.choice(LIVELY if chance.random() < 0.98 else ORDERS))


def ran(number: int) -> tuple[int, int]:
    """Steps with flow and steps with an open valve, of a run of which every step keeps the
    rules."""
    setup = load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))
    chance = random.Random(f"1/{number}")
    source = chance.choice((TargetSource.MANUAL, TargetSource.CANOPY))
    target = Wanted(source=source, manual_rate_kg_ha=chance.choice((100.0, 300.0)))
    job = setup.job.model_copy(update={"target": target, "strategy": chance.choice(list(Strategy))})
    if chance.random() < 0.8:
        job = add_simulated_field(job, setup.machine)
    has_switch = chance.random() < 0.3
    valved = number % 2 == 1
    applicator = setup.machine if valved else setup.machine.model_copy(update={"sections": ()})
    loop = make_control_loop(applicator, setup.crop, setup.rule, job, has_switch)
    machine, rules = (
        Machine(chance, job, chance.choice((0.02, 0.1, 0.3, 1.0))),
        Rules(job, has_switch),
    )
    text = RowText(ALL_COLUMNS if valved else COLUMNS)
    flowing = opened = 0
    for step in range(STEPS_A_RUN):
        m = machine.measure()
        console_s = (
            chance.choice((0.1, 0.1, None, 1.9, 2.1, nan)) if chance.random() < 0.01 else 0.1
        )
        log_ok = chance.random() > 0.002
        _order(loop, chance)
        tick = loop.run_tick(m, console_s, log_ok)
        assert rules.broken(m, console_s, log_ok, tick) == [], (step, m, tick)
        flowing += tick.command.shaft_rpm > 0.0
        opened += any(tick.command.valves)
        text.line(tick.row)
        if step % 5 == 0:
            shown: dict[str, Any] = {name: getattr(tick, name) for name in FRAME_FIELDS}
            format_frame(Frame(seq=step, at_s=0.0, totals=loop.totals, **shown))
    return flowing, opened


@pytest.mark.exam
def test_random_steps_break_no_interlock() -> None:
    flowing, opened = zip(*map(ran, range(3)), strict=True)
    assert sum(flowing) > 0 and sum(opened) > 0
