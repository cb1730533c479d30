"""Point mode: the lag's four parts, doses at their moment, each plant once, the threshold learned, the speed limit."""
from __future__ import annotations

import math

import numpy as np
import pytest

from control.geodesy import TangentPlane, direction
from control.simulation.point_run import PointTruth, point_run
from control.targets.plants import PlantList, PlantRow, SeenPlant
from control.targets.point import Learning, PointMode, Threshold, fastest_mps, point_lag

LAG = point_lag(120.0, 99.8, 1.0)


def row_of(*places: float) -> PlantRow:
    row = PlantRow()
    row.look([SeenPlant(0.0, place) for place in places], float("-inf"))
    return row


def test_the_papers_delays() -> None:
    """Section 2.3: 1.5 + 0.8 + 0.2 + 0.45 = 2.95 s."""
    lag = point_lag(120.0, 99.8, 1.0, vision_s=1.5)
    assert lag == pytest.approx((1.5, 0.8, 0.2, 0.45), abs=2e-3)
    assert lag.total_s == pytest.approx(2.95, abs=0.003)
    assert lag.distance_m(1.2) == pytest.approx(1.2 * 2.95, abs=0.004)
    with pytest.raises(ValueError, match="allowed is above 0"):
        point_lag(120.0, 0.0, 1.0)


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.7])
def test_each_dose_is_commanded_at_its_lag_distance(speed: float) -> None:
    places = [5.0, 5.7, 6.4, 7.3]
    mode, got, track = PointMode(LAG, row_of(*places)), [], 0.0
    for k in range(2000):
        track = k * 0.05 * speed
        doses, missed = mode.tick(k * 0.05, track, speed, 0.05)
        got += [(dose.plant_m, track + dose.in_s * speed) for dose in doses]
        assert not missed and all(0.0 <= dose.in_s < 0.05 for dose in doses)
        if track > 8.0:
            break
    assert [plant for plant, _ in got] == places
    assert [plant - at for plant, at in got] == pytest.approx([LAG.distance_m(speed)] * 4, abs=1e-9)


def test_a_plant_too_near_behind_another_is_missed_and_said() -> None:
    mode, said = PointMode(LAG, row_of(5.0, 5.1, 5.5)), []
    for k in range(300):
        doses, missed = mode.tick(k * 0.05, k * 0.05 * 1.0, 1.0, 0.05)
        said += [(d.plant_m, "") for d in doses] + [(m.plant_m, m.why) for m in missed]
    assert said == [(5.0, ""), (5.1, "busy"), (5.5, "")]
    assert (mode.doses, mode.missed) == (2, 1)


def test_a_plant_seen_too_late_is_missed_and_said() -> None:
    mode = PointMode(LAG, row_of(1.0))
    assert [m.why for m in mode.tick(0.0, 0.0, 1.0, 0.05)[1]] == ["passed"]
    assert mode.tick(0.05, 0.05, 1.0, 0.05) == ([], [])


def test_nothing_is_dosed_at_standstill() -> None:
    assert PointMode(LAG, row_of(0.1)).tick(0.0, 0.0, 0.0, 0.05) == ([], [])


def test_a_plant_seen_again_is_the_same_plant() -> None:
    row = row_of(5.0, 5.3)
    row.look([SeenPlant(1.0, 4.02), SeenPlant(1.0, 4.31)], 5.15)
    assert row.places_m == pytest.approx([5.0, 5.303])        # the first is dosed already and stays
    assert row.after(5.0) == pytest.approx(5.303)
    row.look([SeenPlant(1.0, 3.0)], 5.15)
    assert len(row.places_m) == 2                             # far behind the last dose: too late to be new
    row.forget(5.2)
    assert row.places_m == pytest.approx([5.303])


def test_plants_of_a_list_lie_in_the_strip_ahead() -> None:
    plane = TangentPlane(40.0, 116.0)
    rng = np.random.default_rng(1)
    places = rng.uniform(-20, 20, (800, 2))
    plants = PlantList([plane.to_deg(e, n) for e, n in places], plane)
    for heading in (0.0, 33.0, 200.0):
        east, north = direction(heading)
        wanted = sorted(ahead for ahead, aside in (
            (e * east + n * north, e * north - n * east) for e, n in places) if 0 < ahead <= 9.0 and abs(aside) <= 0.3)
        assert plants.ahead_m((0.0, 0.0), heading, 9.0, 0.3) == pytest.approx(wanted, abs=1e-6)
        assert wanted


def test_the_threshold_finds_a_distance_and_a_delay_and_holds_at_a_third_speed() -> None:
    threshold, rng = Threshold(), np.random.default_rng(3)
    for k in range(160):
        speed = 0.8 if k % 40 < 20 else 1.4
        used = threshold.at(speed)
        threshold.learn(0.04 + 0.12 * speed - used + 0.02 * rng.standard_normal(), speed, used)
    assert threshold.at(1.1) == pytest.approx(0.04 + 0.12 * 1.1, abs=0.01)
    assert threshold.at(0.5) == pytest.approx(0.04 + 0.12 * 0.5, abs=0.02)


def test_one_wild_measurement_moves_the_threshold_little() -> None:
    threshold = Threshold(Learning())
    for _ in range(50):
        threshold.learn(0.0, 1.0, threshold.at(1.0))
    threshold.learn(2.0, 1.0, threshold.at(1.0))
    assert abs(threshold.at(1.0)) < 0.02


def test_a_runaway_threshold_is_bounded() -> None:
    threshold = Threshold()
    for _ in range(3000):
        threshold.learn(1.0, 2.0, threshold.at(2.0))
    assert threshold.at(2.0) == 0.5 and math.isfinite(threshold.delay_s)


@pytest.mark.parametrize("speed", [0.5, 1.0])
def test_learning_takes_the_bias_out_of_a_row(speed: float) -> None:
    without = point_run(LAG, 0.3, speed, 200, 1, learn=False).error_m[80:]
    learned = point_run(LAG, 0.3, speed, 200, 1, learn=True).error_m[80:]
    assert abs(learned.mean()) < 0.015
    assert without.mean() == pytest.approx(0.04 + (0.15 - 0.1) * speed, abs=0.02)
    assert np.median(np.abs(learned)) < 0.6 * np.median(np.abs(without))


def test_a_perfect_machine_errs_by_half_a_turn_of_the_shaft_only() -> None:
    """The paper counts the whole turn into the lag; the middle of the dose falls at half of it."""
    exact = PointTruth(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    run = point_run(LAG, 0.5, 1.0, 40, 1, learn=False, truth=exact, wander_percent=0.0)
    assert run.missed == 0
    assert run.error_m == pytest.approx(np.full(40, -0.5 * LAG.turn_s), abs=1e-6)


@pytest.mark.parametrize("spacing", [0.2, 0.3])
def test_misses_begin_at_the_speed_limit(spacing: float) -> None:
    limit = fastest_mps(spacing, LAG.turn_s)
    assert limit == pytest.approx(spacing / 0.2, rel=3e-3)
    assert point_run(LAG, spacing, 0.7 * limit, 150, 2).missed <= 1
    assert point_run(LAG, spacing, 1.4 * limit, 150, 2).missed > 30
    with pytest.raises(ValueError, match="spacing"):
        fastest_mps(0.0, 0.2)
