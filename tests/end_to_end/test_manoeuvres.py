"""Manoeuvres stay as good as they are, and strategies are compared in the same units."""
from __future__ import annotations

import pytest

from control.orders import Strategy
from control.sensing import speed_ahead_mps, travelled_ahead_m


@pytest.mark.parametrize(("name", "rate_percent", "place_m"), [
    ("steady 4.5 km/h", 2.0, 0.05), ("start of a pass, rolling", 3.5, 0.2),
    *(pytest.param(*one, marks=pytest.mark.exam) for one in (
        ("accelerating 3 to 7 km/h, 0.5 m/s2", 14.5, 0.65), ("decelerating 7 to 3 km/h, 0.5 m/s2", 18.5, 1.0),
        ("reversing 4 m, going on", 13.0, 0.4)))])
def test_rate_and_place_error(benchmark_module, name, rate_percent, place_m):
    m = benchmark_module("manoeuvres")
    what = next(one for one in m.MANOEUVRES if one.name == name)
    if what.edges:
        what = what._replace(end_s=130.0)
    judged = m.measured(what, Strategy.OPENING_FIRST, 1, m.the_setup())
    assert judged.rate_percent < rate_percent
    assert judged.place_m < place_m
    assert len(judged.places_m) >= 1


@pytest.mark.parametrize(("name", "strategy", "told", "rate_percent"), [
    ("accelerating 3 to 7 km/h, 0.5 m/s2", Strategy.BALANCED, "plan", 3.2),
    *(pytest.param(*one, marks=pytest.mark.exam) for one in (
        ("steady 4.5 km/h", Strategy.BALANCED, "none", 1.25), ("steady 4.5 km/h", Strategy.SPEED_FIRST, "none", 2.3),
        ("accelerating 3 to 7 km/h, 0.5 m/s2", Strategy.BALANCED, "none", 8.0)))])
def test_what_the_plan_reaches(benchmark_module, name, strategy, told, rate_percent):
    """Before it: 1.7, 2.9, 11.6 and 11.6 %. Where the tube is settled: elsewhere no plan counts on it."""
    m = benchmark_module("manoeuvres")
    what = next(one for one in m.MANOEUVRES if one.name == name)
    judged = m.measured(what._replace(sim={"speed_told": told}), strategy, 1, m.the_setup(settled=True))
    assert judged.rate_percent < rate_percent


def test_strategies_in_the_same_units(benchmark_module):
    m = benchmark_module("manoeuvres")
    from control.simulation.figures import moves
    setup = m.the_setup()
    found = {}
    for strategy in (Strategy.OPENING_FIRST, Strategy.SPEED_FIRST):
        record = m.driven(setup, strategy, 1, 120.0, {}, None)
        found[strategy] = moves(record.columns(), record.fired, setup.machine.geometry.working_width_m)
    opening, shaft = found[Strategy.OPENING_FIRST], found[Strategy.SPEED_FIRST]
    assert 0.15 < opening.reach_p50_s < 0.4, "gate: dead time 0.1 s and its travel"
    assert 0.4 < shaft.reach_p50_s < 1.2, "shaft: dead time 0.37 s, its run-up, and a plan that is drawn out"
    assert shaft.gate_moves_per_h == 0.0 < shaft.shaft_moves_per_h < 20_000.0
    assert opening.shaft_moves_per_h < 400.0
    assert 1_000.0 < opening.gate_moves_per_h < 8_000.0, "the noise of the speed does not move the gate at every tick"


def test_the_forecast_is_bounded_and_its_own_integral():
    for speed, acceleration in ((1.25, 0.5), (1.25, -0.5), (0.5, 3.0), (1.0, -3.0), (0.0, 0.7)):
        steps = [speed_ahead_mps(speed, acceleration, 0.001 * k) for k in range(2001)]
        way = sum(steps[:-1]) * 0.001
        assert travelled_ahead_m(speed, acceleration, 2.0) == pytest.approx(way, abs=0.2)
        assert all(0.5 * speed - 1e-9 <= s <= 1.5 * speed + 1e-9 for s in steps)
    assert speed_ahead_mps(2.0, 0.5, 10.0) == pytest.approx(2.4), "0.5 m/s2 dies out within 0.8 s: 0.4 m/s more"
