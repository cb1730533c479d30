"""The look-ahead: the lag of a change is what the model does; each change fires once, in order,
and stays."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.control.machine.change_lag import LagParts, SettledPair, calc_change_lag
from topdress.control.machine.machine import Machine, add_effect
from topdress.control.orders import TargetSource
from topdress.control.targets.canopy_target import CanopyDecisions
from topdress.control.targets.lag_correction import ChangeQueue
from topdress.control.targets.target_profile import DecidedStretches, Target, TargetChange


def test_an_opening_change_lags_by_gate_and_drop() -> None:
    lag = calc_change_lag(Machine(), SettledPair(70.0, 14.0), SettledPair(70.0, 17.0))
    assert lag.response_s == pytest.approx(0.10)
    # of a running shaft
    assert lag.drop_s == pytest.approx(1.8288 - 0.0083 * 70.0 - 1.69e-3 * 0.0083 * 70.0**2)
    assert lag.transition_s == pytest.approx(0.5 * 3.0 / 20.0, abs=0.02)


@pytest.mark.parametrize("shaft_rpm", [20.0, 40.0, 60.0])
def test_a_start_lags_as_the_lag_paper_says_plus_the_run_up(shaft_rpm: float) -> None:
    """Eq 6 is from the command to the first granules; half of the landed step comes with the
    shaft's run-up."""
    lag = calc_change_lag(Machine(), SettledPair(0.0, 25.0), SettledPair(shaft_rpm, 25.0)).total_s
    assert 0.0 < lag - (2.2118 - 8.3e-3 * shaft_rpm) < 0.4


def test_known_effects_of_the_fall_enter() -> None:
    plain = calc_change_lag(Machine(), SettledPair(70.0, 14.0), SettledPair(70.0, 17.0)).total_s
    late = calc_change_lag(
        add_effect(Machine(), "lag.offset", 0.3), SettledPair(70.0, 14.0), SettledPair(70.0, 17.0)
    ).total_s
    down = calc_change_lag(
        add_effect(Machine(), "lag.asymmetry", 0.4),
        SettledPair(70.0, 17.0),
        SettledPair(70.0, 14.0),
    ).total_s
    assert late - plain == pytest.approx(0.3, abs=1e-6)
    assert down - plain == pytest.approx(0.2, abs=1e-6)


class Constant:
    """A reach of fixed length."""

    def __init__(self, ahead_m: float) -> None:
        self.ahead_m = ahead_m
        self.max_reach_m = 20.0

    def find_lag(self, before: Target, change: TargetChange) -> LagParts:
        return LagParts(0.0, 0.0, 0.0)

    def find_distance_m(self, lag: LagParts) -> float:
        return self.ahead_m


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.3, 4.0), st.sampled_from([0.0, 180.0, 250.0, 300.0])),
        min_size=1,
        max_size=30,
    ),
    st.lists(st.tuples(st.floats(0.01, 0.4), st.floats(0.0, 3.0)), min_size=20, max_size=300),
)
def test_each_change_fires_once_in_order_and_none_is_lost(
    pieces: list[tuple[float, float]], moves: list[tuple[float, float]]
) -> None:
    """However the lag distance jumps from tick to tick."""
    stretches = DecidedStretches(300.0)
    begin = 0.0
    for length, rate in pieces:
        stretches.append_stretch(begin, begin + length, rate)
        begin += length
    queue = ChangeQueue(stretches.find_target(0.0))
    track, fired = 0.0, []
    for move, ahead in moves:
        track += move
        fired += queue.fire_changes(stretches, track, track, Constant(ahead))
        reached = max(track, queue.fired_to_m)
        assert queue.holding == stretches.find_target(reached) or reached == queue.fired_to_m
        assert (
            queue.holding.rate_kg_ha
            == stretches.find_target(max(reached, queue.fired_to_m)).rate_kg_ha
        )
    places = [change.place_m for change in fired]
    assert places == sorted(places)
    for one, following in pairwise(fired):
        assert one.after == following.before
        assert one.after != one.before


def test_a_change_that_fired_is_not_withdrawn() -> None:
    stretches = DecidedStretches(300.0)
    stretches.append_stretch(0.0, 10.0, 200.0)
    stretches.append_stretch(10.0, 20.0, 250.0)
    queue = ChangeQueue(stretches.find_target(0.0))
    assert queue.fire_changes(stretches, 0.0, 8.5, Constant(2.0))
    # the lag distance shrank: nothing goes back
    assert not queue.fire_changes(stretches, 0.1, 8.6, Constant(0.5))
    assert queue.holding.rate_kg_ha == 250.0


def test_gaps_wider_than_the_reach_get_the_fallback() -> None:
    stretches = DecidedStretches(300.0, reach_m=1.5)
    stretches.append_stretch(0.0, 2.0, 200.0)
    stretches.append_stretch(10.0, 12.0, 250.0)
    assert stretches.find_target(3.4).rate_kg_ha == 200.0
    assert stretches.find_target(5.0) == Target(300.0, TargetSource.FALLBACK)
    assert stretches.find_target(8.6).rate_kg_ha == 250.0
    places = []
    after, holding = 0.0, stretches.find_target(0.0)
    while (change := stretches.find_next_change(after, 20.0, holding)) is not None:
        places.append(round(change.place_m, 6))
        after, holding = change.place_m, change.target
    assert places == [3.5, 8.5, 13.5]


@pytest.mark.parametrize(("first_reach_m", "begins_m"), [(None, 5.5), (6.5, 0.5)])
def test_the_first_stretch_begins_where_it_is_within_reach(
    first_reach_m: float | None, begins_m: float
) -> None:
    """What `at` says and where `next_change` says that it begins are one."""
    stretches = DecidedStretches(300.0, reach_m=1.5, first_reach_m=first_reach_m)
    stretches.append_stretch(7.0, 8.0, 250.0)
    change = stretches.find_next_change(0.0, 20.0, stretches.find_target(0.0))
    assert change is not None and change.place_m == pytest.approx(begins_m)
    assert stretches.find_target(begins_m + 0.1).rate_kg_ha == change.target.rate_kg_ha == 250.0


def test_samples_in_a_turn_are_not_taken_for_the_next_pass() -> None:
    from topdress.control.agronomy.nitrogen_rate import prepare_rule
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import CROP_KIND

    rule = prepare_rule(load_config("huanghai_wheat", CROP_KIND).model)
    stretches = DecidedStretches(300.0)
    canopy = CanopyDecisions(rule, 6.5, 1.0, stretches)
    for k in range(21):
        canopy.take_sample(0.5, 0.0625 * k, 0.05 * k, 0.0)
        canopy.decide_stretch(0.0625 * k, 0.05 * k)
    assert stretches.find_target(7.0).source is TargetSource.CANOPY
    canopy.take_sample(0.5, 1.4, 1.1, 30.0)
    assert stretches.find_target(7.0).source is TargetSource.FALLBACK
