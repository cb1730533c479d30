"""A GNSS place that cannot be: refused, said, harmless; taken once GNSS goes on telling it."""

from __future__ import annotations

import datetime as dt
import importlib.util
import math
import sys
from collections.abc import Callable
from math import cos, radians, sin
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from topdress.control.field.job import Wanted
from topdress.control.geodesy import TangentPlane, calc_plane_distance_m
from topdress.control.loop.tick import Tick
from topdress.control.orders import Do, TargetSource
from topdress.control.readings import GnssFix, Measurements, Reading, RefusedSpeed
from topdress.control.sensing import Sensing, SensingLimits
from topdress.control.sensing.place_drift import WINDOWS_S
from topdress.control.sensing.position_gate import PositionGate
from topdress.control.simulation.assembly import add_simulated_field
from topdress.drivers.files.prescriptions.job_targets import read_job_map
from topdress.drivers.files.run_setup import load_setup

from tests.control_loop.closed import Closed
from tests.places import RECEIVERS

PLANE = TangentPlane(34.28, 119.88)
WORKED_S = 12.0
Change = Callable[[float, Measurements], Measurements]


def jumped(m: Measurements, north_m: float, **more: Any) -> Measurements:
    """The measurements with their GNSS place so far to the north, and as far to the east."""
    assert m.gnss is not None
    return m._replace(
        gnss=m.gnss._replace(
            lat_deg=m.gnss.lat_deg + north_m / 111_000.0,
            lon_deg=m.gnss.lon_deg + north_m / 92_000.0,
            **more,
        )
    )


class Work:
    """The demo machine at work, 12 s; then `change(seconds since, measurements)` for `seconds`.
    Every tick is kept."""

    def __init__(
        self,
        change: Change,
        seconds: float = 5.0,
        source: TargetSource = TargetSource.MANUAL,
        pass_length_m: float = 300.0,
    ) -> None:
        if source is TargetSource.MAP:
            setup = load_setup("huanghai", "map_demo", dt.date(2014, 3, 7))
            closed = Closed(
                setup,
                loop={
                    "prescription": read_job_map(
                        add_simulated_field(setup.job, setup.machine), setup.folder
                    )
                },
            )
        else:
            closed = Closed(
                sim={"pass_length_m": pass_length_m},
                target=Wanted(source=source, manual_rate_kg_ha=300.0),
            )
        closed.order(Do.READY)
        closed.run(4.05)
        assert closed.order(Do.START).accepted
        closed.run(
            WORKED_S + seconds - 4.05,
            lambda m: change(m.time_s - WORKED_S, m) if m.time_s >= WORKED_S else m,
        )
        self.loop, self.ticks = closed.loop, list[Tick]()
        self.off_m: list[float] = []  # of the outlet's place from its true one
        for tick, truth in zip(closed.ticks, closed.truths, strict=True):
            if truth.time_s >= WORKED_S:
                assert tick.place_m is not None
                self.ticks.append(tick)
                self.off_m.append(
                    calc_plane_distance_m(tick.place_m, (truth.east_m, truth.north_m))
                )

    @property
    def events(self) -> list[str]:
        return [word for tick in self.ticks for word in (tick.row.events or "").split(";") if word]


@pytest.fixture(scope="module")
def sound() -> Work:
    return Work(lambda after, m: m)


def once(north_m: float) -> Change:
    def change(after: float, m: Measurements) -> Measurements:
        assert m.gnss is not None
        return jumped(m, north_m) if 1.0 <= m.gnss.time_s - WORKED_S < 1.05 else m

    return change


@pytest.mark.parametrize("north_m", [20.0, 1e3, 5e4, 5e6])
def test_one_epoch_that_cannot_be_is_refused_and_said(sound: Work, north_m: float) -> None:
    work = Work(once(north_m))
    assert max(work.off_m) < 0.3
    refused = [event for event in work.events if event.startswith("position_refused ")]
    assert len(refused) == 1 and not any(
        event.startswith("position_moved") for event in work.events
    )
    if north_m < 1e6:
        assert float(refused[0].split()[1]) == pytest.approx(1.41 * north_m, rel=0.03)
    said = [tick for tick in work.ticks if "position_jumped" in {alarm.id for alarm in tick.alarms}]
    assert 1.0 < 0.05 * len(said) < 1.5, "amber, gone a second after the next sound epoch"
    empty = [tick.row for tick in work.ticks if tick.row.lat_deg is None]
    assert len(empty) == 2 and all(row.lon_deg is None and row.fix_quality is None for row in empty)
    assert all(row.speed_mps is not None for row in empty), "its speed is none the worse"
    assert all(tick.why_no_flow == () for tick in work.ticks)
    assert work.loop.totals.covered_ha == pytest.approx(sound.loop.totals.covered_ha, abs=1e-4)
    assert work.loop.totals.overlap_ha == sound.loop.totals.overlap_ha


@pytest.mark.parametrize("north_m", [100.0, 5e4])
def test_a_place_that_gnss_goes_on_telling_is_taken_and_nothing_between_is_marked(
    sound: Work, north_m: float
) -> None:
    work = Work(lambda after, m: jumped(m, north_m))
    taken = [k for k, tick in enumerate(work.ticks) if "position_moved" in (tick.row.events or "")]
    assert len(taken) == 1 and 1.0 <= 0.05 * taken[0] <= 1.2
    assert max(work.off_m[: taken[0]]) < 0.3 and min(work.off_m[taken[0] :]) > north_m
    assert work.loop.totals.covered_ha is not None and sound.loop.totals.covered_ha is not None
    assert 0.0 <= sound.loop.totals.covered_ha - work.loop.totals.covered_ha < 0.003, (
        "outside nothing flows"
    )
    there = [tick for k, tick in enumerate(work.ticks) if k > taken[0]]
    assert all("outside_field" in tick.why_no_flow for tick in there if north_m > 1e3)


def test_map_mode_stops_after_two_seconds_without_a_place_that_can_be() -> None:
    wild = np.random.default_rng(1)
    work = Work(lambda after, m: jumped(m, float(wild.uniform(1e3, 1e5))), source=TargetSource.MAP)
    stops = [k for k, tick in enumerate(work.ticks) if "position_lost" in tick.why_no_flow]
    assert 1.9 <= 0.05 * stops[0] <= 2.1 and stops == list(range(stops[0], len(work.ticks)))
    assert all(tick.sensed.refused_m is not None for tick in work.ticks)


@pytest.mark.parametrize(
    ("source", "turn_deg", "quality", "lasts_m"),
    [
        (TargetSource.MAP, 0.0, 4, 9.8),
        (TargetSource.MAP, 0.0, 1, 2.5),
        (TargetSource.MAP, 20.0, 4, 2.5),
        (TargetSource.POINT, 0.0, 4, 2.5),
    ],
)
def test_without_gnss_a_place_is_reckoned_as_long_as_it_is_good_enough(
    source: TargetSource, turn_deg: float, quality: int, lasts_m: float
) -> None:
    """Half the width of 2.4 m, straight on and by RTK; else 2 s."""
    limits = SensingLimits(reckoned_m=0.0 if source is TargetSource.POINT else 1.2)
    sensing, plane, ok_m = Sensing(0.0, PLANE, limits), PLANE, 0.0
    fix, east, north, course = None, 0.0, 0.0, 0.0
    for k in range(800):
        course += turn_deg * 0.05 if 9.0 < 0.05 * k < 12.0 else 0.0
        east, north = east + 0.0625 * sin(radians(course)), north + 0.0625 * cos(radians(course))
        if k % 4 == 0 and 0.05 * k < 10.0:
            fix = GnssFix(
                0.05 * k, *plane.convert_to_deg(east, north), quality, 12, 0.8, 1.25, course % 360.0
            )
        found = sensing.sense_motion(
            Measurements(0.05 * k, gnss=fix, wheel_speed_mps=Reading(1.25, 0.05 * k))
        )
        ok_m += 0.0625 * (found.position_ok and 0.05 * k >= 10.0)
    assert ok_m == pytest.approx(lasts_m, abs=0.4)


# -- the gate
# --------------------------------------------------------------------------------------------------


def driven(gate: PositionGate, seconds: float) -> float:
    """At 2 m/s east; the way, m."""
    for _ in range(round(seconds / 0.05)):
        gate.add_way(0.1, 0.1, 0.0)
    return 2.0 * seconds


@pytest.mark.parametrize(
    ("before", "after", "jump_m", "taken"),
    [
        # RTK converges, noise
        (1, 4, 10.0, True),
        (5, 4, 3.0, True),
        (4, 4, 1.0, True),
        (2, 2, 8.0, True),
        (4, 4, 10.0, False),
        (1, 4, 30.0, False),
        (2, 5, 20.0, False),
    ],
)
def test_what_the_fix_allows_is_taken(before: int, after: int, jump_m: float, taken: bool) -> None:
    gate = PositionGate()
    assert gate.judge_epoch((0.0, 0.0), before, 1.0, 2.0, 100.0).taken
    way = driven(gate, 0.2)
    judged = gate.judge_epoch((way, jump_m), after, 1.0, 2.0, 100.2)
    assert judged.taken is taken and judged.off_m == pytest.approx(jump_m)


def test_after_two_seconds_any_place_within_the_way_is_possible() -> None:
    for seconds, side_m, taken in ((1.0, 5.0, False), (10.0, 18.0, True), (10.0, 60.0, False)):
        gate = PositionGate()
        gate.judge_epoch((0.0, 0.0), 4, 1.0, 2.0, 100.0)
        driven(gate, seconds)
        assert gate.judge_epoch((0.0, side_m), 4, 1.0, 2.0, 100.0 + seconds).taken is taken


def test_refused_places_that_do_not_agree_are_never_taken() -> None:
    gate = PositionGate()
    gate.judge_epoch((0.0, 0.0), 4, 1.0, 2.0, 100.0)
    for k in range(1, 60):
        driven(gate, 0.1)
        assert not gate.judge_epoch(
            (1e3 if k % 2 else -1e3, 0.0), 4, 1.0, 2.0, 100.0 + 0.1 * k
        ).taken
    assert not gate.judge_epoch((math.nan, 0.0), 4, 1.0, 2.0, 107.0).taken
    assert not gate.judge_epoch((math.inf, 0.0), 4, 1.0, 2.0, 107.1).taken


def test_a_plane_that_began_with_a_wrong_place_begins_anew() -> None:
    sensing = Sensing(0.0, None)
    for k in range(40):
        lat = 80.0 if k == 0 else 34.28
        now = 100.0 + 0.1 * k
        seen = sensing.sense_motion(
            Measurements(now, gnss=GnssFix(now, lat, 119.88, 4, speed_mps=0.0, heading_deg=0.0))
        )
    assert sensing.plane is not None and sensing.plane.lat_deg == 34.28
    assert seen.refused_m is None and (seen.east_m, seen.north_m) == pytest.approx((0.0, 0.0))


# -- clocks and numbers that cannot be
# ---------------------------------------------------------------------------------


def test_readings_from_the_future_are_not_fresh() -> None:
    sensing = Sensing(0.0, PLANE)
    for k in range(10):
        now = 100.0 + 0.1 * k
        fix = GnssFix(now + 60.0, 34.28, 119.88, 4, speed_mps=2.0, heading_deg=0.0)
        seen = sensing.sense_motion(
            Measurements(now, gnss=fix, wheel_speed_mps=Reading(2.0, now + 60.0))
        )
    assert seen.speed_mps is None and not seen.position_ok and seen.east_m is None
    work = Work(lambda after, m: m._replace(shaft_rpm=Reading(70.0, m.time_s + 5.0)))
    assert "drive_silent" in work.ticks[1].why_no_flow and work.ticks[1].row.shaft_rpm is None


@pytest.mark.parametrize("mps", [math.inf, math.nan, 1e9])
def test_a_speed_that_cannot_be_leaves_track_and_fence_alone(mps: float) -> None:
    def mad(after: float, m: Measurements) -> Measurements:
        assert m.gnss is not None and m.wheel_speed_mps is not None
        return (
            m._replace(
                gnss=m.gnss._replace(speed_mps=mps),
                wheel_speed_mps=m.wheel_speed_mps._replace(value=mps),
            )
            if after < 1.0
            else m
        )

    work = Work(mad, 10.0, pass_length_m=50.0)
    track = [tick.sensed.track_m for tick in work.ticks]
    assert all(map(math.isfinite, track)) and 0.0 <= track[-1] - track[0] < 20.0
    assert max(work.off_m) < 1.0 and work.loop.find_target(track[-1] + 1.0).rate_kg_ha == 300.0
    assert work.loop.find_target(track[-1] + 40.0).rate_kg_ha == 0.0, "the edge ahead is still seen"


@pytest.mark.parametrize("back_s", [0.01, 3600.0, math.nan, math.inf])
def test_a_clock_that_goes_back_stops_time_and_then_flow(back_s: float) -> None:
    def shifted(after: float, m: Measurements) -> Measurements:
        if after < 1.0:
            return m
        return m._replace(time_s=m.time_s - back_s) if back_s == 0.01 else _all_back(m, back_s)

    work = Work(shifted, 3.0)
    times = [tick.row.time_s for tick in work.ticks]
    assert times == sorted(times)
    assert work.ticks[-1].is_enabled is (back_s == 0.01) and (not work.ticks[-1].why_no_flow) is (
        back_s == 0.01
    )


def _all_back(m: Measurements, seconds: float) -> Measurements:
    """Tick and readings on a clock that lies back."""

    def moved(one: Any) -> Any:
        return one if one is None else one._replace(time_s=one.time_s - seconds)

    names = (
        "gnss",
        "wheel_speed_mps",
        "shaft_rpm",
        "opening_mm",
        "hopper_kg",
        "supply_v",
        "pitch_deg",
        "roll_deg",
    )
    return m._replace(
        time_s=m.time_s - seconds,
        ndvi=tuple(map(moved, m.ndvi)),
        **{name: moved(getattr(m, name)) for name in names},
    )


# --- A GNSS place that walks off from its own speed and course: seen, said, not used; sound
# receivers are not... -----

ROOT = Path(__file__).parents[2]
WALK_PLANE = TangentPlane(48.0, 11.0)


@pytest.fixture(scope="module")
def walks() -> ModuleType:
    folder = str(ROOT / "benchmarks")
    spec = importlib.util.spec_from_file_location(
        "benchmark_position_walks", ROOT / "benchmarks" / "position_walks.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["benchmark_position_walks"] = module
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
    return module


@pytest.mark.parametrize(
    ("receiver", "drift_mps", "far_m", "said_s"),
    [
        (0, 0.5, 5.0, 10.0),
        (0, 3.0, 5.0, 2.0),
        (0, 10.0, 5.0, 1.0),
        (0, 30.0, 5.0, 1.0),
        (0, 0.25, 8.0, 35.0),
        (3, 0.5, 15.0, 35.0),
        (5, 3.0, 20.0, 15.0),
        (5, 0.5, 20.0, 45.0),
    ],
)
def test_a_place_that_walks_is_believed_for_some_metres_only(
    walks, receiver, drift_mps, far_m, said_s
):
    found = walks.drifting(walks.RECEIVERS[receiver], drift_mps, with_it=False)
    assert found.said_s is not None and found.said_s <= said_s and found.far_m <= far_m, found


def test_what_walks_too_slowly_is_not_seen_and_the_page_says_so(walks):
    assert walks.drifting(walks.RECEIVERS[0], 0.1, with_it=False).said_s is None
    assert "0.2 m/s" in (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("drift_mps", [3.0, 10.0, 30.0])
def test_a_receiver_whose_speed_walks_with_it_goes_farther_than_the_wheel_rolls(walks, drift_mps):
    found = walks.drifting(walks.RECEIVERS[0], drift_mps, with_it=True)
    assert found.said_s is not None and found.said_s <= 15.0 and found.far_m <= 60.0, found


class Way:
    """Straight north at 1.25 m/s, GNSS at 5 Hz; `drift` east."""

    def __init__(self) -> None:
        self.sensing, self.now_s, self.rng = Sensing(0.0, WALK_PLANE), 0.0, np.random.default_rng(3)

    def go(
        self,
        seconds,
        drift=lambda since_s: 0.0,
        wheel_mps=1.25,
        speed_mps=1.25,
        quality=4,
        told=True,
    ):
        found, begun_s = [], self.now_s
        for _ in range(round(seconds / 0.2)):
            self.now_s += 0.2
            east = drift(self.now_s - begun_s) + 0.01 * self.rng.standard_normal()
            lat, lon = WALK_PLANE.convert_to_deg(east, 1.25 * self.now_s)
            fix = GnssFix(
                self.now_s,
                lat,
                lon,
                quality,
                12,
                0.8,
                speed_mps if told else None,
                0.0 if told else None,
            )
            found.append(
                self.sensing.sense_motion(
                    Measurements(
                        self.now_s, gnss=fix, wheel_speed_mps=Reading(wheel_mps, self.now_s)
                    )
                )
            )
        return found


def test_the_place_goes_back_to_before_the_walk_and_no_flow_depends_on_the_walked_one():
    way = Way()
    way.go(70.0)
    found = way.go(20.0, lambda since_s: 1.0 * since_s)
    first = next(k for k, sensed in enumerate(found) if sensed.walks)
    assert 3.0 < 0.2 * first < 6.0
    assert found[first].moved_m == pytest.approx(0.2 * first, abs=1.5)
    assert abs(found[first].east_m) < 1.0 and abs(found[-1].east_m) < 3.0
    # course and speed are believed on
    assert found[-1].north_m == pytest.approx(1.25 * way.now_s, abs=3.0)
    assert not found[-1].position_ok and found[-1].walks and found[-1].refused_m > 10.0


def test_a_place_that_comes_back_is_taken_at_once():
    way = Way()
    way.go(70.0)
    assert way.go(20.0, lambda since_s: 1.0 * since_s)[-1].walks
    found = way.go(3.0)
    taken = next(k for k, sensed in enumerate(found) if sensed.refused_m is None)
    assert 0.2 * taken <= 1.0 and abs(found[-1].east_m) < 0.1 and found[-1].position_ok


def test_a_place_that_stays_off_is_taken_after_a_minute_that_agrees():
    way = Way()
    way.go(70.0)
    way.go(12.0, lambda since_s: 1.0 * since_s)
    found = way.go(80.0, lambda since_s: 12.0)
    taken = next(k for k, sensed in enumerate(found) if sensed.refused_m is None)
    assert WINDOWS_S[-1] - 8.0 <= 0.2 * taken <= WINDOWS_S[-1] + 15.0
    assert found[taken].moved_m == pytest.approx(12.0, abs=3.0) and found[-1].position_ok


def test_one_that_goes_on_walking_is_never_taken():
    way = Way()
    way.go(70.0)
    found = way.go(300.0, lambda since_s: 0.5 * since_s)
    first = next(k for k, sensed in enumerate(found) if sensed.walks)
    assert all(sensed.walks for sensed in found[first:])
    assert all(abs(sensed.east_m) < 5.0 for sensed in found)


@pytest.mark.parametrize("wheel_mps", [1.25 * 1.08, 1.25 * 0.95, 1.25 * 0.6, 3.5, 0.7])
def test_a_wheel_that_slips_spins_or_is_calibrated_wrongly_accuses_nobody(wheel_mps):
    way = Way()
    way.go(30.0)
    assert not any(sensed.refused_m is not None for sensed in way.go(120.0, wheel_mps=wheel_mps))


def test_a_jump_is_a_jump_and_no_walk():
    way = Way()
    way.go(70.0)
    found = way.go(5.0, lambda since_s: 200.0)
    assert found[0].refused_m == pytest.approx(200.0, abs=1.0) and not any(
        sensed.walks for sensed in found
    )
    assert found[-1].refused_m is None and found[-1].east_m == pytest.approx(200.0, abs=0.1)


def test_a_change_of_the_fix_is_no_walk():
    """RTK lost and found again: float half a metre off, plain GNSS three metres."""
    way = Way()
    way.go(60.0)
    for quality, off_m in ((5, 0.5), (1, 3.0), (5, 0.5), (4, 0.0)):
        found = way.go(30.0, lambda since_s, off_m=off_m: off_m, quality=quality)
        assert not any(sensed.walks for sensed in found)


def test_a_receiver_that_tells_no_speed_is_held_to_a_quarter_of_the_way():
    way = Way()
    way.go(60.0)
    assert not any(
        sensed.walks for sensed in way.go(60.0, lambda since_s: 0.3 * since_s, told=False)
    )
    assert any(
        sensed.walks for sensed in way.go(10.0, lambda since_s: 18.0 + 12.0 * since_s, told=False)
    )


def test_recordings_of_receivers_are_not_accused(walks):
    names = sorted(path.name for path in RECEIVERS.glob("*.log"))
    accused = [name for name in names if walks.heard(walks.recorded(RECEIVERS / name)).walks]
    assert len(names) >= 10
    assert set(accused) <= set(walks.COLD_STARTS), (
        "only one whose place jumps by 33 m in its first seconds"
    )


@pytest.mark.parametrize("number", range(6))
def test_minutes_of_work_accuse_no_receiver(walks, number):
    """Hours: python -m benchmarks position_walks."""
    was = walks.hour(walks.RECEIVERS[number], 240.0, 100 + number)
    assert was.epochs > 100 and was.walks == 0, was
    assert was.wheel_unspun == 0 and {one for one, _ in was.doubts} <= {RefusedSpeed.WHEEL}, was
