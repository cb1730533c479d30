"""The inverse inverts, strategies keep to their limits, a switch of strategy does not show in
the flow."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.control.machine.machine import CATALOGUE, Machine, add_effect
from topdress.control.machine.shaft import ShaftInput, make_shaft_start, step_shaft
from topdress.control.metering.inverse_model import (
    Conditions,
    calc_flow_kg_s,
    calc_lowest_flow_kg_s,
    find_opening_mm,
    find_shaft_command,
    find_shaft_rpm,
)
from topdress.control.metering.strategies import find_pair
from topdress.control.orders import Do, Order, Strategy

EXTENDED = add_effect(
    add_effect(
        add_effect(add_effect(Machine(), "flow.fill_falloff", 9.0), "flow.zero_offset", 8.0),
        "flow.hopper_head",
        3.0,
    ),
    "shaft.second_order",
    0.03,
)
ZONED = add_effect(add_effect(EXTENDED, "shaft.dead_zone", 4.0), "shaft.saturation", 10.0)
LIMITS = Machine().limits


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from([Machine(), EXTENDED, ZONED]),
    st.floats(0.005, 0.4),
    st.floats(10.0, 100.0),
    st.floats(20.0, 300.0),
)
def test_the_inverse_inverts(
    machine: Machine, flow: float, shaft_rpm: float, hopper_kg: float
) -> None:
    c = Conditions(hopper_kg=hopper_kg)
    opening = find_opening_mm(machine, flow, shaft_rpm, c)
    if opening > 0.0:
        assert calc_flow_kg_s(machine, shaft_rpm, opening, c) == pytest.approx(flow, rel=1e-9)
    shaft = find_shaft_rpm(machine, flow, 25.0, c)
    if shaft < 150.0:
        assert calc_flow_kg_s(machine, shaft, 25.0, c) == pytest.approx(flow, rel=1e-4)


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from([Machine(), EXTENDED, ZONED]),
    st.sampled_from(list(Strategy)),
    st.floats(0.0, 1.0),
    st.floats(0.0, 60.0),
)
def test_every_pair_lies_within_the_limits(
    machine: Machine, strategy: Strategy, wanted: float, now_mm: float
) -> None:
    pair = find_pair(machine, strategy, wanted, now_mm)
    low, high = (
        calc_lowest_flow_kg_s(machine),
        calc_flow_kg_s(machine, LIMITS.shaft_high_rpm, LIMITS.opening_high_mm),
    )
    given_flow = calc_flow_kg_s(machine, pair.shaft_rpm, pair.opening_mm)
    if pair.shaft_rpm == 0.0:
        assert wanted <= 0.5 * low
        assert pair.opening_mm == now_mm
        return
    assert LIMITS.shaft_low_rpm <= pair.shaft_rpm <= LIMITS.shaft_high_rpm
    assert LIMITS.opening_low_mm <= pair.opening_mm <= LIMITS.opening_high_mm
    if low <= wanted <= high:
        assert given_flow == pytest.approx(wanted, rel=1e-4)
        assert pair.limited == ""
    elif wanted < low:
        assert given_flow == pytest.approx(low)
        assert pair.limited == "lowest"
    else:
        assert pair.limited == "highest"


def test_opening_first_moves_the_opening_and_speed_first_the_shaft() -> None:
    opening = [find_pair(Machine(), Strategy.OPENING_FIRST, q, 25.0) for q in (0.06, 0.09, 0.12)]
    speed = [find_pair(Machine(), Strategy.SPEED_FIRST, q, 25.0) for q in (0.06, 0.09, 0.12)]
    assert {pair.shaft_rpm for pair in opening} == {70.0}
    assert {pair.opening_mm for pair in speed} == {25.0}
    assert (
        len({pair.opening_mm for pair in opening}) == len({pair.shaft_rpm for pair in speed}) == 3
    )


# A shaft that stopped follows no command.
NEVER_COMPENSATED = {"shaft.stall"}


@pytest.mark.parametrize(
    "effect_id",
    [
        name
        for name, entry in CATALOGUE.items()
        if entry.stage == "shaft" and name not in NEVER_COMPENSATED
    ],
)
def test_known_effect_of_the_shaft_is_taken_back(effect_id: str) -> None:
    machine = add_effect(Machine(), effect_id, CATALOGUE[effect_id].effect.probes[-1])
    around = Conditions(supply_v=12.5, pitch_deg=3.0)
    command = find_shaft_command(machine, 50.0, 20.0, around)
    state, turned = make_shaft_start(), None
    for _ in range(100):
        state, turned = step_shaft(
            machine.shaft, state, ShaftInput(command, 20.0, 12.5, pitch_deg=3.0), 0.1
        )
    assert turned is not None and turned.rpm == pytest.approx(50.0, rel=1e-4)


@pytest.mark.parametrize(
    "shaft",
    [{"neutral_rpm": 12.0}, {"neutral_rpm": -8.0}, {"neutral_rpm": 105.0, "gain_percent": -200.0}],
)
@pytest.mark.exam
def test_a_known_neutral_point_changes_no_flow_and_no_stop(
    shaft: dict[str, float], simulated: Any
) -> None:
    """Within the limits of what may be sent, 0 in every stop, and then the shaft stands."""
    orders = [(0.5, Order(Do.READY)), (3.0, Order(Do.START)), (30.0, Order(Do.STOP))]
    plain, run = (
        simulated(40.0, orders=orders, shaft=one, flow_trim=False) for one in (None, shaft)
    )
    sent = [step.tick.command.shaft_rpm for step in run.steps]
    assert all(rpm == 0.0 or LIMITS.shaft_low_rpm <= rpm <= LIMITS.shaft_high_rpm for rpm in sent)
    flows, should = ([step.truth.flow_kg_s for step in one.steps] for one in (run, plain))
    assert sum(flows) == pytest.approx(sum(should), rel=0.01) and sum(should) > 0.0
    stopped = [step for step in run.steps if step.truth.time_s > 32.0]
    assert {step.tick.command.shaft_rpm for step in stopped} == {0.0}
    assert max(
        abs(step.truth.shaft_rpm) + step.truth.flow_kg_s for step in stopped
    ) == pytest.approx(0.0, abs=1e-6)


def test_a_neutral_point_that_nobody_knows_is_trimmed_and_stops(simulated: Any) -> None:
    orders = [(0.5, Order(Do.READY)), (3.0, Order(Do.START)), (40.0, Order(Do.STOP))]
    run = simulated(50.0, orders=orders, effects=["shaft.neutral=-6"], flow_trim=False)
    worked = [step.truth.shaft_rpm for step in run.steps if 30.0 < step.truth.time_s < 39.0]
    assert worked and sum(worked) / len(worked) == pytest.approx(70.0, rel=0.02)
    assert all(abs(step.truth.shaft_rpm) < 1e-6 for step in run.steps if step.truth.time_s > 43.0)


def test_a_machine_that_meters_is_stopped_by_a_command_of_zero() -> None:
    with pytest.raises(ValueError, match="a command of 0 must stop it"):
        Machine.model_validate({"shaft": {"zero_stops": 0.0}})
    assert (
        Machine.model_validate({"stages": ["shaft"], "shaft": {"zero_stops": 0.0}}).shaft.zero_stops
        == 0.0
    )


@pytest.mark.parametrize(
    ("gain_percent", "taken"),
    [(-95.0, True), (-96.0, False), (-100.0, False), (-104.0, False), (-105.0, True)],
)
def test_a_command_turns_what_meters(gain_percent: float, taken: bool) -> None:
    with (
        nullcontext()
        if taken
        else pytest.raises(ValueError, match="between them a command hardly turns it")
    ):
        Machine.model_validate({"shaft": {"gain_percent": gain_percent}})
    assert Machine.model_validate({"stages": ["shaft"], "shaft": {"gain_percent": gain_percent}})


def test_switching_the_strategy_does_not_show_in_the_flow(simulated: Any) -> None:
    """Manual rate, constant speed: the flow stays within 6.5 % while shaft and gate both move
    far."""
    from topdress.control.field.job import Wanted

    orders = [
        (0.5, Order(Do.READY)),
        (3.0, Order(Do.START)),
        (40.0, Order(Do.STRATEGY, "speed_first")),
    ]
    run = simulated(
        60.0,
        orders=orders,
        target=Wanted(source="manual", manual_rate_kg_ha=300.0),
        sim={"speed_wander_percent": 0.0},
        flow_trim=False,
    )
    flow = {round(s.truth.time_s, 2): s.truth.flow_kg_s for s in run.steps}
    settled = [q for t, q in flow.items() if 34.0 < t < 39.9]
    during = [q for t, q in flow.items() if 40.0 < t < 48.0]
    mean = sum(settled) / len(settled)
    assert max(abs(q / mean - 1.0) for q in during) < 0.065
    assert run.steps[-1].truth.opening_mm == pytest.approx(25.0, abs=0.5)
    assert run.steps[-1].truth.shaft_rpm < 45.0


@pytest.mark.exam
def test_trims_do_not_wind_up_on_the_headland(simulated: Any) -> None:
    """Short passes, many turns with the shaft stopped: nothing is wrong, so nothing is trimmed
    at any start."""
    run = simulated(250.0, look_ahead=False, seed=7, sim={"pass_length_m": 40.0, "passes": 8})
    starts = [
        k
        for k in range(1, len(run.steps) - 60)
        if run.steps[k - 1].tick.command.shaft_rpm == 0.0
        and run.steps[k].tick.command.shaft_rpm > 0.0
    ]
    assert len(starts) >= 3
    for start in starts[1:]:
        rows = [step.tick.row for step in run.steps[start : start + 60]]
        wanted = [
            find_pair(
                Machine(),
                Strategy.OPENING_FIRST,
                2.4 * row.target_rate_kg_ha * row.speed_used_mps / 1e4,
                25.0,
            ).opening_mm
            for row in rows
            if row.target_rate_kg_ha > 0.0
        ]
        sent = [row.opening_mm_cmd for row in rows if row.target_rate_kg_ha > 0.0]
        off_mm = sum(sent) / len(sent) - sum(wanted) / len(wanted)
        assert abs(off_mm) < 0.5, (rows[0].time_s, off_mm)
