"""What a diagnosis of bench tables hands on as data, not in a sentence: steps, minutes and
costs."""

from __future__ import annotations

import doctest

import pytest
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.tables import diagnose
from topdress.control.diagnosis.tables.report import calc_table_field_cost
from topdress.control.diagnosis.tables.table_series import SizedEffect, TableCandidate
from topdress.control.experiments.bench_tests import list_bench_tests
from topdress.control.machine.machine import Machine

from tests.diagnosis.tables import MACHINE, diagnosed, labelled_lags


def test_the_next_run_has_its_tests_and_minutes() -> None:
    found = diagnosed(labelled_lags(0.3)).next_run
    assert found is not None
    tests = [one for one in list_bench_tests(Machine()) if one.id in found.id.split("+")]
    assert found.steps and set(found.steps) == {one.plan for one in tests}
    assert found.minutes == sum(one.minutes for one in tests)
    assert all(step in found.plan for step in found.steps)
    assert found.to_do() == tuple(
        f"{one} ({minutes:.0f} min)"
        for one, minutes in zip(
            found.steps,
            ({each.plan: each.minutes for each in tests}[one] for one in found.steps),
            strict=True,
        )
    )


def test_every_experiment_has_an_id_of_its_own() -> None:
    ids = [one.id for one in list_bench_tests(Machine())]
    assert len(set(ids)) == len(ids) and not any("+" in one for one in ids)


def test_bench_tests_are_at_settings_of_the_machines_own_ranges() -> None:
    """A large shaft is not asked for the nominal machine's speeds, and no shaft for less than
    its slowest."""
    nominal, ranges = Machine(), Machine().limits
    large = nominal.model_copy(
        update={
            "limits": ranges.model_copy(
                update={"shaft_high_rpm": 10.0 * ranges.shaft_high_rpm, "shaft_low_rpm": 150.0}
            )
        }
    )
    steps = {
        one.id: (one.plan, other.plan)
        for one, other in zip(list_bench_tests(nominal), list_bench_tests(large), strict=True)
    }
    assert "5 starts each at 10, 40 and 70 r/min" in steps["response_test"][0]
    assert "5 starts each at 150, 400 and 700 r/min" in steps["response_test"][1]
    assert steps["static_weigh"][0] == steps["static_weigh"][1]


@pytest.mark.parametrize(
    ("row", "size", "rate", "place"),
    [
        (effects.FLOW_GAIN, 5.0, 5.0, 0.0),
        (effects.FLOW_PULSATION, 30.0, 0.0, 0.0),
        (effects.LAG_COARSE_CLOCK, 0.1, 0.0, 0.0),
        (effects.LAG_OFFSET, 0.4, 0.0, 0.5),
        (effects.PLACE_LEVER_ARM, 0.4, 0.0, 0.4),
        (effects.CANOPY_HEAD_FOULED, -8.0, None, None),
    ],
)
def test_the_field_cost_goes_through_the_model(
    row: effects.EffectRow, size: float, rate: float | None, place: float | None
) -> None:
    cost = calc_table_field_cost(MACHINE, SizedEffect(TableCandidate(row.id, 1), size), 1.25)
    assert cost.rate_error_percent == (rate if rate is None else pytest.approx(rate, abs=1e-9))
    assert cost.place_error_m == (place if place is None else pytest.approx(place, abs=1e-9))


def test_a_lag_off_distances_at_a_wrong_speed_is_wrong_by_as_much() -> None:
    at_10, at_20 = (
        calc_table_field_cost(
            MACHINE, SizedEffect(TableCandidate(effects.LAG_SPEED_SCALE.id), percent), 1.25
        )
        for percent in (10.0, 20.0)
    )
    lag_s = 0.383 + 1.8288 - 0.0083 * MACHINE.set_points.shaft_rpm
    assert at_10.place_error_m == pytest.approx(0.1 * 1.25 * lag_s, rel=0.02)
    assert at_20.place_error_m == pytest.approx(2.0 * at_10.place_error_m)


def test_the_example_of_diagnose_tables_holds() -> None:
    ran = doctest.testmod(diagnose)
    assert ran.attempted >= 9 and ran.failed == 0
