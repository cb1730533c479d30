"""Point mode through the whole loop on the simulated bench: doses at plants, told to the log,
learned, stopped."""

from __future__ import annotations

import datetime as dt
import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.console.worker.assemble import assemble_run
from topdress.console.worker.options import Options
from topdress.control.field.coverage import Raster
from topdress.control.field.job import Camera, Job, Plants, Wanted
from topdress.control.field.job_totals import NO_SUMS
from topdress.control.geodesy import TangentPlane, find_unit_vector
from topdress.control.orders import Do, Order, TargetSource
from topdress.control.readings import CameraPlant, DoseOrder
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
    make_point_source,
)
from topdress.control.simulation.closed_loop import simulate_run
from topdress.control.simulation.dose_watch import DoseErrors, DoseWatch
from topdress.control.simulation.point_run import PointTruth, simulate_point_run
from topdress.control.targets.plant_doser import CommandedDose, DueDose, PlantDoser
from topdress.control.targets.plant_places import PlantList, PlantRow, TrackedPlant
from topdress.control.targets.point_mode import (
    DoseThreshold,
    PointMode,
    ThresholdLearning,
    calc_max_speed_mps,
    calc_point_lag,
)
from topdress.drivers.files.prescriptions.job_targets import read_loop_targets
from topdress.drivers.files.prescriptions.map_choices import PrescriptionError
from topdress.drivers.files.run_setup import Setup, load_setup

from tests.command import topdress

TICK_S = 0.05


@pytest.fixture(scope="module")
def bench() -> Setup:
    return load_setup("bench", "points_demo", dt.date(2026, 5, 1))


def job_of(bench: Setup, sim: dict[str, Any] | None = None, **target: Any) -> Job:
    job = bench.job.model_copy(
        update={
            "target": bench.job.target.model_copy(update=target),
            "simulated": bench.job.simulated.model_copy(update=sim or {}),
        }
    )
    return add_simulated_field(job, bench.machine)


def driven(
    bench: Setup, job: Job, seconds: float, orders: Any = None, plants: PlantList | None = None
) -> tuple[DoseErrors, list[Any]]:
    plant = make_plant(bench.machine, job, 1, TICK_S, plants=plants)
    loop = make_control_loop(bench.machine, bench.crop, bench.rule, job, plants=plants)
    watch = DoseWatch(plant.plants_m, 3, 0.01)
    ticks = [step.tick for step in simulate_run(plant, loop, seconds, orders, watch)]
    return watch.judge_doses(settle=50), ticks


def events(ticks: list[Any]) -> Counter[str]:
    return Counter(word for tick in ticks for word in (tick.row.events or "").split(";"))


@pytest.mark.exam
def test_doses_fall_at_the_plants_of_a_camera_and_learning_takes_the_bias_out(bench: Setup) -> None:
    learned, ticks = driven(bench, job_of(bench), 90.0)
    fixed, _ = driven(bench, job_of(bench, learn_threshold=False), 90.0)
    assert learned.plants > 200 and learned.missed <= 2 and learned.doubled == 0
    assert learned.dose_g == pytest.approx(0.917 * 25.0 / 3.0, rel=0.01), "a third of a turn"
    assert abs(learned.mean_m) < 0.012 and learned.p95_m < 0.08
    assert fixed.mean_m == pytest.approx(-0.083, abs=0.03), (
        "half a turn of the shaft, as the paper counts it"
    )
    assert learned.p50_m < 0.5 * fixed.p50_m
    assert events(ticks)["dose 120"] == learned.doses
    rows = [tick.row for tick in ticks if tick.row.state == "working"]
    assert {row.target_source for row in rows if row.events and "dose 120" in row.events} == {
        "point"
    }
    assert all(row.target_rate_kg_ha is None for row in rows if row.target_source == "point")
    assert all(row.shaft_rpm_cmd == 0.0 and row.opening_mm_cmd == 25.0 for row in rows), (
        "doses, no speed"
    )
    assert not any(row.alarms for row in rows)
    assert all(change.after.rate_kg_ha == 0.0 for tick in ticks for change in tick.fired), (
        "no rate changes"
    )
    assert rows[-1].hopper_kg is not None and ticks[-1].metres_left_m == pytest.approx(
        rows[-1].hopper_kg / (0.00764 / 0.25), rel=0.1
    )


@pytest.mark.exam
def test_doses_fall_at_the_plants_of_a_list_and_none_outside_the_field(bench: Setup) -> None:
    job = job_of(bench, {"plants": None, "camera": None, "passes": 1})
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    ways = np.arange(-8.0, 60.0, 0.4)
    plants = PlantList([plane.convert_to_deg(0.3, way) for way in ways], plane)
    found, ticks = driven(bench, job, 75.0, plants=plants)
    assert found.p95_m < 0.06 and found.doubled == 0
    missed = events(ticks)["dose_missed no_flow"]
    assert missed >= 5, "the plants before the field's edge"
    assert found.missed <= missed


@pytest.mark.parametrize(
    ("asked", "sent"),
    [
        (DoseOrder(120.0, 60.0), DoseOrder(120.0, 60.0)),
        (DoseOrder(9e9, 9e9), DoseOrder(3600.0, 201.0)),
        (DoseOrder(math.nan, 60.0), None),
        (DoseOrder(120.0, math.inf), None),
        (DoseOrder(-5.0, 60.0), None),
    ],
)
def test_a_dose_passes_the_last_gate_or_is_not_commanded_whatever_asks_for_it(
    bench: Setup, monkeypatch: pytest.MonkeyPatch, asked: DoseOrder, sent: DoseOrder | None
) -> None:
    """Plants that are due in every tick, also where no flow is allowed, of an angle and a speed
    that no drive has."""

    def always(points: PlantDoser, time_s: float, track_m: float, *_: Any) -> DueDose:
        points.given.append(CommandedDose(time_s, track_m, 0.0, 0.0, time_s))
        return DueDose(asked, ())

    monkeypatch.setattr(PlantDoser, "find_due_dose", always)
    _, ticks = driven(
        bench,
        job_of(bench, {"passes": 1}),
        20.0,
        [
            (2.0, Order(Do.READY)),
            (4.0, Order(Do.START)),
            (12.0, Order(Do.HOLD)),
            (15.0, Order(Do.START)),
            (17.0, Order(Do.STOP)),
        ],
    )
    stopped = [tick for tick in ticks if tick.why_no_flow]
    assert {tick.row.state for tick in stopped} == {"off", "ready", "working", "held"}
    assert {tick.command.dose for tick in stopped} == {None}
    assert {tick.command.dose for tick in ticks if not tick.why_no_flow} == {sent}


@pytest.mark.parametrize("no_double", [True, False])
def test_plants_dosed_before_a_power_cut_are_passed_by(bench: Setup, no_double: bool) -> None:
    job = job_of(bench, {"passes": 1}, learn_threshold=False, camera=None)
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    plants = PlantList([plane.convert_to_deg(0.0, way) for way in np.arange(2.0, 40.0, 0.4)], plane)
    plant = make_plant(bench.machine, job, 1, TICK_S, plants=plants)
    loop = make_control_loop(bench.machine, bench.crop, bench.rule, job, plants=plants)
    loop.resume_job(NO_SUMS, Raster(-3.0, 6.0, 0.25, np.ones((24, 24), dtype=np.bool_)), plane)
    loop.handle_order(Order(Do.NO_DOUBLE, no_double))
    dosed, missed, spread = [], [], 0
    for step in simulate_run(plant, loop, 45.0, [(4.0, Order(Do.READY)), (4.1, Order(Do.START))]):
        tick = step.tick
        spread += "already_spread" in tick.notes
        if "dose_missed" in (tick.row.events or "") and tick.place_m is not None:
            missed.append(tick.place_m[1])
        if tick.command.dose is not None and tick.place_m is not None:
            dosed.append(tick.place_m[1] + loop.dose_ahead_m)
    again = [north for north in dosed if 6.2 < north < 11.8]
    assert any(north < 5.8 for north in dosed) and any(north > 12.2 for north in dosed), dosed[-1]
    if no_double:
        assert not again and spread > 50
        assert not [north for north in missed if 6.2 < north < 11.0], (
            "nothing is missed where nothing is owed"
        )
    else:
        assert len(again) >= 8 and spread == 0


def test_held_and_off_the_shaft_gets_no_dose(bench: Setup) -> None:
    _, ticks = driven(
        bench,
        job_of(bench),
        40.0,
        orders=[
            (4.0, Order(Do.READY)),
            (4.1, Order(Do.START)),
            (25.0, Order(Do.HOLD)),
            (32.0, Order(Do.READY)),
            (32.1, Order(Do.START)),
        ],
    )
    by_state = {(tick.row.state, tick.command.dose is not None) for tick in ticks}
    assert ("working", True) in by_state and ("held", False) in by_state
    assert not any(
        "dose_missed" in (tick.row.events or "") for tick in ticks if tick.row.state != "working"
    )
    assert not {("held", True), ("ready", True), ("off", True)} & by_state
    again = [tick.row.time_s for tick in ticks if tick.command.dose and tick.row.time_s > 32.0]
    assert again and again[0] < 33.5


def test_the_source_point_can_be_ordered_only_with_plants(bench: Setup) -> None:
    with_plants = make_control_loop(bench.machine, bench.crop, bench.rule, job_of(bench))
    assert with_plants.handle_order(Order(Do.SOURCE, "manual")).accepted
    assert with_plants.handle_order(Order(Do.SOURCE, "point")).accepted
    none = make_control_loop(
        bench.machine, bench.crop, bench.rule, job_of(bench, source=TargetSource.MANUAL)
    )
    assert none.handle_order(Order(Do.SOURCE, "point")).why == "source_not_ready"
    assert none.handle_order(Order(Do.DOSE_ERROR, 0.1)).why == "no_dose_landed"
    assert with_plants.handle_order(Order(Do.DOSE_ERROR, 9.0)).why == "dose_error_out_of_range"


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    """Doses of a day before, 0.12 m late at every speed."""
    path = tmp_path / "doses.csv"
    path.write_text(
        "error_m,speed_mps\n"
        + "".join(f"{0.12 + 0.01 * (k % 3 - 1)},{0.6 + 0.1 * (k % 5)}\n" for k in range(30))
    )
    return path


def test_a_file_of_measured_errors_feeds_the_threshold_as_orders_do(
    bench: Setup, measured: Path
) -> None:
    job = job_of(bench, dose_errors=measured.name)
    loop = make_control_loop(
        bench.machine,
        bench.crop,
        bench.rule,
        job,
        **read_loop_targets(job, measured.parent, bench.machine, "ndvi"),
    )
    assert loop.threshold is not None and loop.threshold.doses == 30
    assert loop.threshold.find_threshold_m(0.8) == pytest.approx(0.12, abs=0.02)
    fixed = job_of(bench, dose_errors=measured.name, learn_threshold=False)
    still = make_control_loop(
        bench.machine,
        bench.crop,
        bench.rule,
        fixed,
        **read_loop_targets(fixed, measured.parent, bench.machine, "ndvi"),
    )
    assert still.threshold is not None and still.threshold.find_threshold_m(0.8) == 0.0, (
        "it stays 0 where nothing is to be learned"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "error_m,speed_mps\n0.1,0.8\n3.0,0.8\n",
            "line 3: 3 m at 0.8 m/s: allowed are errors and thresholds of at most",
        ),
        ("error_m,speed_mps\n0.1,0\n", "speeds above 0 to 10 m/s"),
        ("error_m,speed_mps\n0.1,\n", "line 2: 0.1, : allowed are numbers"),
        ("error_m\n0.1\n", "column speed_mps missing"),
        (None, "not there: allowed is a table"),
    ],
    ids=["too_far", "standing", "empty", "no_speed", "no_file"],
)
def test_errors_that_teach_nothing(
    text: str | None, said: str, bench: Setup, measured: Path
) -> None:
    measured.unlink() if text is None else measured.write_text(text)
    with pytest.raises(PrescriptionError) as caught:
        read_loop_targets(
            job_of(bench, dose_errors=measured.name), measured.parent, bench.machine, "ndvi"
        )
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_nudge_makes_every_dose_larger(bench: Setup) -> None:
    _, ticks = driven(
        bench,
        job_of(bench),
        25.0,
        orders=[(4.0, Order(Do.READY)), (4.1, Order(Do.START)), (4.2, Order(Do.NUDGE, 10.0))],
    )
    doses = {tick.command.dose for tick in ticks} - {None}
    assert doses == {DoseOrder(132.0, 99.8)}


def test_a_picture_is_placed_where_the_outlet_was_when_it_was_taken(bench: Setup) -> None:
    job = job_of(bench)
    source: PlantDoser = make_point_source(bench.machine, job, None)
    for k in range(41):
        source.look_for_plants(k * TICK_S, k * TICK_S * 1.0, (0.0, 0.0), 0.0, 1.0, ())
    source.look_for_plants(2.05, 2.05, (0.0, 0.0), 0.0, 1.0, [CameraPlant(0.525, 6.0)])
    assert source.row.places_m == pytest.approx([6.525])


@pytest.mark.exam
def test_too_fast_for_the_spacing_plants_are_missed_and_said(bench: Setup) -> None:
    slow, _ = driven(
        bench, job_of(bench, {"speed_kmh": 2.4, "plants": Plants(spacing_m=0.25)}), 60.0
    )
    fast, ticks = driven(
        bench,
        job_of(
            bench,
            {"speed_kmh": 5.4, "plants": Plants(spacing_m=0.25), "camera": Camera(ahead_m=8.0)},
        ),
        60.0,
    )
    assert slow.missed <= 2
    assert fast.missed > 0.2 * fast.plants
    assert abs(events(ticks)["dose_missed busy"] - fast.missed) <= 6


def test_a_job_in_point_mode_needs_plants() -> None:
    with pytest.raises(ValueError, match=r"point needs target\.plants"):
        Job(target=Wanted(source=TargetSource.POINT))


class Runaway:
    """A plant whose shaft sensor reads a turning shaft from some time on."""

    def __init__(self, plant: Any, from_s: float) -> None:
        self._plant, self._from_s = plant, from_s

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def advance_plant(self, command: Any, enabled: bool) -> Any:
        sensed = self._plant.advance_plant(command, enabled)
        return sensed if sensed.time_s < self._from_s else sensed._replace(shaft_rpm=99.8)


def test_a_shaft_that_turns_without_a_dose_is_an_alarm(bench: Setup) -> None:
    job = job_of(bench, {"plants": Plants(spacing_m=10.0)})
    plant = Runaway(make_plant(bench.machine, job, 1, TICK_S), 30.0)
    loop = make_control_loop(bench.machine, bench.crop, bench.rule, job)
    ticks = [step.tick for step in simulate_run(plant, loop, 45.0)]  # type: ignore[arg-type]
    alarms = {tick.row.time_s: tick.row.alarms or "" for tick in ticks}
    assert not any(text for at, text in alarms.items() if at < 30.0), "doses alone raise none"
    assert any("shaft_turns" in text for at, text in alarms.items() if 30.0 < at < 33.0)


@pytest.mark.exam
def test_the_speed_limit_is_shown_when_it_is_exceeded(bench: Setup) -> None:
    _, ticks = driven(
        bench,
        job_of(bench, {"speed_kmh": 5.4, "plants": Plants(spacing_m=0.25, scatter_percent=0.0)}),
        40.0,
    )
    assert ticks[-1].usable_speed_mps == pytest.approx(1.0, abs=0.05)
    _, ticks = driven(bench, job_of(bench, {"speed_kmh": 2.7}), 40.0)
    assert ticks[-1].usable_speed_mps is None


@pytest.mark.exam
def test_the_summary_compares_with_and_without_the_threshold_and_the_log_replays(
    bench: Setup, tmp_path: Path
) -> None:
    plane = TangentPlane(34.28, 119.88)
    (tmp_path / "plants.csv").write_text(
        "lat_deg,lon_deg\n"
        + "".join(
            "{:.9f},{:.9f}\n".format(*plane.convert_to_deg(0.3, way))
            for way in np.arange(0.4, 60.0, 0.4)
        )
    )
    (tmp_path / "job.yaml").write_text(
        "format: topdress-job/1\ncrop: huanghai_wheat\nflow_trim: false\n"
        "target: {source: point, plants: plants.csv}\n"
        "simulated: {speed_kmh: 3.6, pass_length_m: 60.0, passes: 1, hopper_kg: 20.0, "
        "refill_at_kg: 1.0}\n"
    )
    log, job = tmp_path / "log.csv", tmp_path / "job.yaml"
    done = topdress(
        "simulate",
        "--machine",
        "bench",
        "--job",
        job,
        "--seconds",
        "70",
        "--json",
        "--out",
        log,
        "--effect",
        "lag.offset=0.2",
    )
    assert done.exit_code == 0, done.output
    told = json.loads(done.output.splitlines()[-1])
    assert told["without_threshold"]["mean_m"] == pytest.approx(0.2 - 0.07, abs=0.04)
    assert abs(told["with_threshold"]["mean_m"]) < 0.03
    assert told["with_threshold"]["missed"] == 0 and told["with_threshold"]["plants"] > 120
    text = topdress("simulate", "--machine", "bench", "--job", job, "--seconds", "20", "--summary")
    assert (
        "learned threshold  dose error p50" in text.output
        and "without threshold  dose error p50" in text.output
    )
    again = tmp_path / "again.csv"
    assert topdress("replay", log, "--headless", "--out", again).exit_code == 0
    assert again.read_text().count("dose 120") == pytest.approx(
        log.read_text().count("dose 120"), abs=1
    )


def test_a_run_without_a_plant_list_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="a camera has no driver yet"):
        assemble_run(
            Options(("bench", "points_demo"), tmp_path / "w.json", log=str(tmp_path / "a.csv")),
            lambda: 0.0,
        )


# --- Point mode: the lag's four parts, doses at their moment, each plant once, the threshold
# learned, the speed limit.

LAG = calc_point_lag(120.0, 99.8, 1.0)


def row_of(*places: float) -> PlantRow:
    row = PlantRow()
    row.add_plants([TrackedPlant(0.0, place) for place in places], float("-inf"))
    return row


def test_the_papers_delays() -> None:
    """Section 2.3: 1.5 + 0.8 + 0.2 + 0.45 = 2.95 s."""
    lag = calc_point_lag(120.0, 99.8, 1.0, vision_s=1.5)
    assert lag == pytest.approx((1.5, 0.8, 0.2, 0.45), abs=2e-3)
    assert lag.total_s == pytest.approx(2.95, abs=0.003)
    assert lag.find_distance_m(1.2) == pytest.approx(1.2 * 2.95, abs=0.004)
    with pytest.raises(ValueError, match="allowed is above 0"):
        calc_point_lag(120.0, 0.0, 1.0)


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.7])
def test_each_dose_is_commanded_at_its_lag_distance(speed: float) -> None:
    places = [5.0, 5.7, 6.4, 7.3]
    mode, got, track = PointMode(LAG, row_of(*places)), [], 0.0
    for k in range(2000):
        track = k * 0.05 * speed
        doses, missed = mode.plan_doses(k * 0.05, track, speed, 0.05)
        got += [(dose.plant_m, track + dose.in_s * speed) for dose in doses]
        assert not missed and all(0.0 <= dose.in_s < 0.05 for dose in doses)
        if track > 8.0:
            break
    assert [plant for plant, _ in got] == places
    assert [plant - at for plant, at in got] == pytest.approx(
        [LAG.find_distance_m(speed)] * 4, abs=1e-9
    )


def test_a_plant_too_near_behind_another_is_missed_and_said() -> None:
    mode, said = PointMode(LAG, row_of(5.0, 5.1, 5.5)), []
    for k in range(300):
        doses, missed = mode.plan_doses(k * 0.05, k * 0.05 * 1.0, 1.0, 0.05)
        said += [(d.plant_m, "") for d in doses] + [(m.plant_m, m.why) for m in missed]
    assert said == [(5.0, ""), (5.1, "busy"), (5.5, "")]
    assert (mode.doses, mode.missed) == (2, 1)


def test_a_plant_seen_too_late_is_missed_and_said() -> None:
    mode = PointMode(LAG, row_of(1.0))
    assert [m.why for m in mode.plan_doses(0.0, 0.0, 1.0, 0.05)[1]] == ["passed"]
    assert mode.plan_doses(0.05, 0.05, 1.0, 0.05) == ([], [])


def test_nothing_is_dosed_at_standstill() -> None:
    assert PointMode(LAG, row_of(0.1)).plan_doses(0.0, 0.0, 0.0, 0.05) == ([], [])


def test_a_plant_seen_again_is_the_same_plant() -> None:
    row = row_of(5.0, 5.3)
    row.add_plants([TrackedPlant(1.0, 4.02), TrackedPlant(1.0, 4.31)], 5.15)
    # the first is dosed already and stays
    assert row.places_m == pytest.approx([5.0, 5.303])
    assert row.find_next_m(5.0) == pytest.approx(5.303)
    row.add_plants([TrackedPlant(1.0, 3.0)], 5.15)
    assert len(row.places_m) == 2  # far behind the last dose: too late to be new
    row.forget_behind(5.2)
    assert row.places_m == pytest.approx([5.303])


def test_plants_of_a_list_lie_in_the_strip_ahead() -> None:
    plane = TangentPlane(40.0, 116.0)
    rng = np.random.default_rng(1)
    places = rng.uniform(-20, 20, (800, 2))
    plants = PlantList([plane.convert_to_deg(e, n) for e, n in places], plane)
    for heading in (0.0, 33.0, 200.0):
        east, north = find_unit_vector(heading)
        wanted = sorted(
            ahead
            for ahead, aside in ((e * east + n * north, e * north - n * east) for e, n in places)
            if 0 < ahead <= 9.0 and abs(aside) <= 0.3
        )
        assert plants.find_plants_ahead_m((0.0, 0.0), heading, 9.0, 0.3) == pytest.approx(
            wanted, abs=1e-6
        )
        assert wanted


def test_the_threshold_finds_a_distance_and_a_delay_and_holds_at_a_third_speed() -> None:
    threshold, rng = DoseThreshold(), np.random.default_rng(3)
    for k in range(160):
        speed = 0.8 if k % 40 < 20 else 1.4
        used = threshold.find_threshold_m(speed)
        threshold.learn_error(
            0.04 + 0.12 * speed - used + 0.02 * rng.standard_normal(), speed, used
        )
    assert threshold.find_threshold_m(1.1) == pytest.approx(0.04 + 0.12 * 1.1, abs=0.01)
    assert threshold.find_threshold_m(0.5) == pytest.approx(0.04 + 0.12 * 0.5, abs=0.02)


def test_one_wild_measurement_moves_the_threshold_little() -> None:
    threshold = DoseThreshold(ThresholdLearning())
    for _ in range(50):
        threshold.learn_error(0.0, 1.0, threshold.find_threshold_m(1.0))
    threshold.learn_error(2.0, 1.0, threshold.find_threshold_m(1.0))
    assert abs(threshold.find_threshold_m(1.0)) < 0.02


def test_a_runaway_threshold_is_bounded() -> None:
    threshold = DoseThreshold()
    for _ in range(3000):
        threshold.learn_error(1.0, 2.0, threshold.find_threshold_m(2.0))
    assert threshold.find_threshold_m(2.0) == 0.5 and math.isfinite(threshold.delay_s)


@pytest.mark.parametrize("speed", [0.5, 1.0])
def test_learning_takes_the_bias_out_of_a_row(speed: float) -> None:
    without = simulate_point_run(LAG, 0.3, speed, 200, 1, learn=False).error_m[80:]
    learned = simulate_point_run(LAG, 0.3, speed, 200, 1, learn=True).error_m[80:]
    assert abs(learned.mean()) < 0.015
    assert without.mean() == pytest.approx(0.04 + (0.15 - 0.1) * speed, abs=0.02)
    assert np.median(np.abs(learned)) < 0.6 * np.median(np.abs(without))


def test_a_perfect_machine_errs_by_half_a_turn_of_the_shaft_only() -> None:
    """The paper counts the whole turn into the lag; the middle of the dose falls at half of it."""
    exact = PointTruth(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    run = simulate_point_run(LAG, 0.5, 1.0, 40, 1, learn=False, truth=exact, wander_percent=0.0)
    assert run.missed == 0
    assert run.error_m == pytest.approx(np.full(40, -0.5 * LAG.turn_s), abs=1e-6)


@pytest.mark.parametrize("spacing", [0.2, 0.3])
def test_misses_begin_at_the_speed_limit(spacing: float) -> None:
    limit = calc_max_speed_mps(spacing, LAG.turn_s)
    assert limit == pytest.approx(spacing / 0.2, rel=3e-3)
    assert simulate_point_run(LAG, spacing, 0.7 * limit, 150, 2).missed <= 1
    assert simulate_point_run(LAG, spacing, 1.4 * limit, 150, 2).missed > 30
    with pytest.raises(ValueError, match="spacing"):
        calc_max_speed_mps(0.0, 0.2)
