"""Which experiments are taken: those that settle most pairs of rivals a minute, of equal ones
the clearest."""

from __future__ import annotations

import numpy as np
from topdress.control.diagnosis.judgement.prior import MIN_REPORT_LOG_ODDS, SEPARATION_SD
from topdress.control.experiments.bench_tests import list_bench_tests
from topdress.control.experiments.experiment import choose_experiments
from topdress.control.experiments.manoeuvres import list_manoeuvres
from topdress.control.machine.machine import Machine


def test_of_equal_experiments_the_one_that_sets_rivals_furthest_apart() -> None:
    """Before, bench tests were taken in the order of their list."""
    found = choose_experiments(np.array([[4.1, 9.0, 30.0]]), (10.0, 10.0, 20.0), SEPARATION_SD, 3)
    assert found.tests == (1,) and found.settled.all() and found.apart_sd == 9.0


def test_the_shortest_run_that_separates_is_taken() -> None:
    """Before, a run of twenty minutes was planned where it was half as clear again as one of
    ten."""
    assert choose_experiments(np.array([[4.0, 8.0]]), (10.0, 20.0), SEPARATION_SD, 1).tests == (0,)


def test_most_pairs_a_minute_first_and_what_stays_open_is_said() -> None:
    apart = np.array([[9.0, 9.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0], [0.0, 1.0, 2.0]])
    found = choose_experiments(apart, (10.0, 15.0, 10.0), SEPARATION_SD, 3)
    assert (
        found.tests == (1, 2)
        and found.settled.tolist() == [True, True, True, False]
        and found.apart_sd == 9.0
    )
    assert choose_experiments(apart[3:], (10.0, 15.0, 10.0), SEPARATION_SD, 3) == (
        (),
        found.settled[3:],
        None,
    )


def test_rivals_that_far_apart_are_told_apart_by_nine_measurements_in_ten() -> None:
    seen = np.random.default_rng(1).normal(SEPARATION_SD, 1.0, 200_000)
    assert abs(np.mean((seen > 0.0) & (0.5 * seen**2 > MIN_REPORT_LOG_ODDS)) - 0.9) < 0.005


def test_both_kinds_have_one_shape_and_ids_of_their_own() -> None:
    every = (*list_manoeuvres(Machine()), *list_bench_tests(Machine()))
    assert len({one.id for one in every}) == len(every)
    assert all(one.minutes > 0.0 and one.plan and one.steps for one in every)
    assert all(len(one.predict(Machine())) for one in every)
