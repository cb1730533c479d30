"""A board that does not do what it is told, over its own bytes: said, told to stand again and
again, counted, entered."""

from __future__ import annotations

import csv
import datetime as dt

import pytest
from topdress.control.orders import Do, Strategy
from topdress.control.sensing import predict_speed_ahead_mps, predict_way_ahead_m
from topdress.drivers.files.exports.as_applied import build_as_applied
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_log import RunLogWriter
from topdress.drivers.files.run_meta import make_run_meta
from topdress.drivers.files.run_setup import load_setup
from topdress.drivers.virtual.faults import RUNAWAY_OPENING_MM, RUNAWAY_SHAFT_RPM, DriveRunaway

SHAFT, GATE = DriveRunaway(shaft_rpm=RUNAWAY_SHAFT_RPM), DriveRunaway(opening_mm=RUNAWAY_OPENING_MM)


@pytest.fixture(scope="module")
def bench(benchmark_module):
    module = benchmark_module("drives_disobey")
    # half a minute by hand: python -m benchmarks drives_disobey
    module.LASTS_S, module.SETTLED_S = 6.0, 3.0
    return module


@pytest.mark.parametrize(
    "name",
    [
        "off, from the start",
        "ready",
        "calibrating, shaft at 0",
        "held, from the order on",
        "off, from STOP on",
        "working, switch up",
        "fault",
    ],
)
def test_a_shaft_that_turns_is_said_and_counted_in_every_state(bench, name):
    found = bench.lied_to(bench.STATES[name], SHAFT, "shaft_turns")
    assert found.plant_kg > 0.6
    assert all(bench.promised(name, found, bench.SHAFT_SAID_S).values()), found
    assert found.state in ("fault", "off")
    # there it is the run-down of work until the alarm
    if not name.startswith("working"):
        assert found.entered_kg == pytest.approx(found.counted_kg, abs=0.005)


@pytest.mark.parametrize("name", ["off, from the start", "held, from the order on"])
def test_a_gate_that_opens_is_said(bench, name):
    found = bench.lied_to(bench.STATES[name], GATE, "gate_opens")
    assert all(bench.promised(name, found, bench.GATE_SAID_S).values()), found


@pytest.mark.parametrize("name", ["held, from the order on"])
def test_a_valve_that_stays_open_is_said(bench, name):
    found = bench.lied_to(
        bench.STATES[name],
        DriveRunaway(),
        "valve_open",
        "huanghai_sections",
        "sections_demo",
        {2: True},
    )
    assert all(bench.promised(name, found, bench.VALVE_SAID_S).values()), found


@pytest.mark.parametrize(
    "name", ["off", "working", "off, console started again", "board started again, no console"]
)
def test_orders_played_in_again_turn_nothing_and_are_said(benchmark_module, name):
    orders = benchmark_module("old_orders")
    orders.LASTS_S = 8.0
    found = orders.played_in(name)
    assert all(orders.promised(name, found).values()), found
    assert found.state == ("fault" if name == "working" else "off")


@pytest.mark.exam
@pytest.mark.parametrize("machine", ["huanghai", "huanghai_sections"])
def test_a_day_of_stops_and_starts_accuses_nobody(bench, machine):
    """Holds, stops, calibrating runs, changes of the rate and of the strategy: drives that obey."""
    it = bench.Rig(machine, "sections_demo" if machine != "huanghai" else "demo")
    it.work()
    for do, value, seconds in (
        (Do.HOLD, None, 3.0),
        (Do.START, None, 8.0),
        (Do.STRATEGY, "speed_first", 5.0),
        (Do.NUDGE, 30.0, 4.0),
        (Do.STOP, None, 4.0),
        (Do.READY, None, 1.0),
        (Do.START, None, 6.0),
        (Do.STRATEGY, "balanced", 3.0),
        (Do.HOLD, None, 2.0),
    ):
        it.order(do, value)
        it.run(seconds)
    said = {alarm.id for tick in it.ticks for alarm in tick.alarms}
    assert not said & {"shaft_turns", "gate_opens", "valve_open"}, said


def test_what_runs_down_after_a_catch_test_lies_in_the_tray(bench):
    it = bench.Rig()
    bench.STATES[bench.CALIBRATING](it)
    for rpm in (0.0, 60.0):
        it.loop.handle_order(bench.Order(Do.CALIBRATE_SHAFT, rpm))
        for _ in range(40):
            it.loop.handle_order(bench.Order(Do.CALIBRATE))
            it.run(0.05)
    it.order(Do.RELEASE)
    it.run(3.0)
    assert it.hopper_kg < 299.9
    assert it.loop.totals.applied_kg == 0.0
    assert not any("released_stopped" in (tick.row.events or "") for tick in it.ticks)


@pytest.mark.exam
def test_the_log_tells_it_and_so_does_the_export(bench, tmp_path):
    it = bench.Rig()
    it.work()
    it.order(Do.HOLD)
    it.run(3.0)
    it.runaway = SHAFT
    it.run(10.0)
    it.runaway = DriveRunaway()
    it.run(3.0)
    setup = load_setup("huanghai", "demo", dt.date(2026, 4, 1))
    writer = RunLogWriter(
        tmp_path / "run.csv", make_run_meta(setup.machine, setup.crop, it.job, seed=1, sha256={})
    )
    for tick in it.ticks:
        writer.append(tick.row)
    writer.close()
    totals = it.loop.totals
    assert totals.stopped_kg > 1.2
    assert totals.applied_kg * 0.46 == pytest.approx(totals.applied_n_kg, rel=0.05)
    applied = build_as_applied(read_log(tmp_path / "run.csv"))
    assert applied.totals.applied_kg == pytest.approx(totals.applied_kg, rel=2e-3)
    assert applied.totals.stopped_kg == pytest.approx(totals.stopped_kg, abs=1e-3)
    assert sum(one.kg for one in applied.stopped) == pytest.approx(totals.stopped_kg, abs=1e-3)
    on_ground = float(applied.stretches.applied_kg.sum())
    # it moved on: on stretches too
    assert on_ground > applied.totals.applied_kg - applied.totals.stopped_kg + 0.5
    with (tmp_path / "run.csv").open(newline="") as file:
        events = [
            row["events"] for row in csv.DictReader(file) if "released_stopped" in row["events"]
        ]
    assert len(events) > 10


# --- Two sensors that disagree, drives that do not follow: over the same bytes
# ---------------------------------------

PAIRS = ("wheel x 2", "shaft turns 36 % too fast", "gate stuck 3 mm too wide, of 18 mm")


@pytest.mark.parametrize(
    "name",
    [
        name if name in PAIRS else pytest.param(name, marks=pytest.mark.exam)
        for name in (
            *PAIRS,
            "wheel x 0.5",
            "wheel stuck at 5 m/s",
            "GNSS speed x 0.5",
            "GNSS speed x 2",
            "shaft jams",
            "gate stuck 3 mm too wide, of 9 mm",
        )
    ],
)
@pytest.mark.exam
def test_what_disagrees_is_said_and_costs_little(benchmark_module, name):
    """All of them, and with a plain fix: python -m benchmarks sensors_disagree."""
    m = benchmark_module("sensors_disagree")
    case = next(one for one in m.CASES if one.name == name)
    found = m.found(case, plain=False)
    assert all(m.promised(case, False, found).values()), found


# --- Manoeuvres stay as good as they are, and strategies are compared in the same units
# ------------------------------


@pytest.mark.exam
@pytest.mark.parametrize(
    ("name", "rate_percent", "place_m"),
    [
        ("steady 4.5 km/h", 2.0, 0.05),
        ("start of a pass, rolling", 3.5, 0.2),
        ("accelerating 3 to 7 km/h, 0.5 m/s2", 14.5, 0.65),
        ("decelerating 7 to 3 km/h, 0.5 m/s2", 18.5, 1.0),
        ("reversing 4 m, going on", 13.0, 0.4),
    ],
)
def test_rate_and_place_error(benchmark_module, name, rate_percent, place_m):
    m = benchmark_module("manoeuvres")
    what = next(one for one in m.MANOEUVRES if one.name == name)
    if what.edges:
        what = what._replace(end_s=130.0)
    judged = m.measured(what, Strategy.OPENING_FIRST, 1, m.the_setup())
    assert judged.rate_percent < rate_percent
    assert judged.place_m < place_m
    assert len(judged.places_m) >= 1


@pytest.mark.parametrize(
    ("strategy", "rate_percent"), [(Strategy.OPENING_FIRST, 3.3), (Strategy.SPEED_FIRST, 5.9)]
)
@pytest.mark.exam
def test_what_a_speed_that_is_announced_reaches(benchmark_module, strategy, rate_percent):
    """From 3 to 7 km/h; not announced 10 and 12 %."""
    m = benchmark_module("manoeuvres")
    what = next(one for one in m.MANOEUVRES if one.name == "accelerating 3 to 7 km/h, 0.5 m/s2")
    judged = m.measured(what._replace(sim={"speed_told": "plan"}), strategy, 1, m.the_setup())
    assert judged.rate_percent < rate_percent


@pytest.mark.exam
def test_strategies_in_the_same_units(benchmark_module):
    m = benchmark_module("manoeuvres")
    from topdress.control.simulation.strategy_figures import count_moves

    setup = m.the_setup()
    found = {}
    for strategy in (Strategy.OPENING_FIRST, Strategy.SPEED_FIRST):
        record = m.driven(setup, strategy, 1, 120.0, {}, None)
        found[strategy] = count_moves(
            record.make_columns(), record.fired, setup.machine.geometry.working_width_m
        )
    opening, shaft = found[Strategy.OPENING_FIRST], found[Strategy.SPEED_FIRST]
    assert 0.15 < opening.reach_p50_s < 0.4, "gate: dead time 0.1 s and its travel"
    assert 0.4 < shaft.reach_p50_s < 1.2, (
        "shaft: dead time 0.37 s, its run-up, and a plan that is drawn out"
    )
    assert shaft.gate_moves_per_h == 0.0 < shaft.shaft_moves_per_h < 20_000.0
    assert opening.shaft_moves_per_h < 400.0
    assert 1_000.0 < opening.gate_moves_per_h < 8_000.0, (
        "the noise of the speed does not move the gate at every tick"
    )


def test_the_forecast_is_bounded_and_its_own_integral():
    for speed, acceleration in ((1.25, 0.5), (1.25, -0.5), (0.5, 3.0), (1.0, -3.0), (0.0, 0.7)):
        steps = [predict_speed_ahead_mps(speed, acceleration, 0.001 * k) for k in range(2001)]
        way = sum(steps[:-1]) * 0.001
        assert predict_way_ahead_m(speed, acceleration, 2.0) == pytest.approx(way, abs=0.2)
        assert all(0.5 * speed - 1e-9 <= s <= 1.5 * speed + 1e-9 for s in steps)
    assert predict_speed_ahead_mps(2.0, 0.5, 10.0) == pytest.approx(2.4), (
        "0.5 m/s2 dies out within 0.8 s: 0.4 m/s more"
    )


# --- Each row of the loss table on the virtual machine, through its bytes: the reaction and its
# time -----------------

ROWS = (
    "ndvi_silent",
    "heads_few",
    "gnss_silent",
    "gnss_silent_map",
    "wheel_stuck",
    "both_speeds",
    "board_unplugged",
    "host_silent",
    "driver_fault",
    "console_silent",
    "console_gone",
    "rate_amber",
    "rate_red",
    "bridging",
    "hopper_empty",
    "hopper_low",
    "lead_short",
    "log_failed",
    "acknowledge",
)


QUICK = (
    "gnss_silent",
    "board_unplugged",
    "driver_fault",
    "console_silent",
    "rate_red",
    "hopper_empty",
    "log_failed",
)


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.exam) for name in ROWS]
)
def test_reaction_in_time(benchmark_module, name):
    table = benchmark_module("loss_table")
    found = table.provoke(getattr(table, name))
    assert found.ok, found


def test_no_row_is_left_out(benchmark_module):
    assert tuple(row.__name__ for row in benchmark_module("loss_table").ROWS) == ROWS
