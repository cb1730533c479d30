"""Sections: each switched by its own strip of ground, metered for what is open, closed where
nothing may flow."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon
from topdress.control.field.boundary import Boundary
from topdress.control.field.coverage import Coverage
from topdress.control.field.job import Job, Wanted
from topdress.control.loop.section_control import WHY_NO_FLOW, SectionControl, SectionLeads
from topdress.control.machine.landing import calc_carried_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.sections import Section, Valve, make_section_strips
from topdress.control.orders import Do, Order, State, Strategy, TargetSource
from topdress.control.readings import DriveCommand
from topdress.control.safety import limit_valves
from topdress.control.sensing import SensedMotion
from topdress.control.simulation.assembly import add_simulated_field, make_control_loop
from topdress.control.simulation.closed_loop import SimulatedTick, simulate_run
from topdress.control.simulation.plant import Plant, PlantTruth
from topdress.control.simulation.tractor import PathLeg
from topdress.control.simulation.tractor import TractorPath as Way
from topdress.control.targets.boundary_profile import BoundaryAhead
from topdress.control.targets.section_ground import (
    WHY_DONE,
    WHY_OUTSIDE,
    SectionGround,
    SectionsGround,
)
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.run_setup import Setup, load_setup

HALF_FIELD = Boundary([(0.0, 0.0), (0.0, 200.0), (10.0, 200.0), (10.0, 0.0)])
# its east side meets a pass askew
SLANTED = ((-30.0, 0.0), (-30.0, 60.0), (0.0, 60.0), (6.0, 30.0), (0.0, 0.0))
NOTHING = SectionsGround(None, None, None, None, (False,) * 3)


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))


def manual(job: Job, **changes: Any) -> Job:
    target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0)
    return job.model_copy(update={"target": target, **changes})


def run(
    setup: Setup,
    machine: Machine,
    job: Job,
    seconds: float,
    way: Way | None = None,
    orders: list[tuple[float, Order]] | None = None,
) -> list[SimulatedTick]:
    plant = Plant(machine, job, 1, 0.05, path=way)
    return list(
        simulate_run(
            plant, make_control_loop(machine, setup.crop, setup.rule, job), seconds, orders
        )
    )


# -- the machine file
# ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ("sections: [{outlets: 2}, {outlets: 3}]", "add up to geometry.outlets, 6; found 5"),
        (
            "sections: [{outlets: 3, valve: {open_s: 0.2}}, {outlets: 3}]",
            "a valve in every section, or in none",
        ),
        ("sections: [{outlets: 0}, {outlets: 6}]", "key sections[1].outlets: value 0: allowed"),
        (
            "sections: [{outlets: 6, valve: {open_s: 2.5}}]",
            "key sections[1].valve.open_s: value 2.5: allowed 0 to 2",
        ),
        (
            "sections: [{outlets: 6, valves: 1}]",
            "key sections[1].valves: unknown key; did you mean valve?",
        ),
    ],
)
def test_a_bad_block_gets_one_line(tmp_path: Path, changes: str, said: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(f"format: topdress-machine/1\nid: m\n{changes}\n", encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_config(path, MACHINE_KIND)
    assert len(str(error.value).splitlines()) == 1 and said in str(error.value)


def test_strips_lie_side_by_side_over_the_width() -> None:
    left, middle, right = make_section_strips(
        [Section(outlets=1), Section(outlets=2), Section(outlets=3)], 2.4
    )
    assert (left.left_m, left.right_m, middle.right_m, right.right_m) == pytest.approx(
        (-1.2, -0.8, 0.0, 1.2)
    )
    assert left.share + middle.share + right.share == pytest.approx(1.0)


@pytest.mark.exam
def test_sections_without_valves_change_nothing(setup: Setup) -> None:
    plain = setup.machine.model_copy(update={"sections": ()})
    told = setup.machine.model_copy(update={"sections": (Section(outlets=3), Section(outlets=3))})
    job = add_simulated_field(setup.job, plain)
    rows = [[step.tick.row for step in run(setup, machine, job, 30.0)] for machine in (plain, told)]
    assert rows[0] == rows[1]
    assert all(row.sections_cmd is None for row in rows[1])


# -- the ground
# --------------------------------------------------------------------------------------------------


def judged_over_the_edge(overlap: float, outside_share: float) -> Any:
    """One section 0.8 m wide, heading north, with that share of its width west of the field."""
    ground = SectionGround(make_section_strips([Section(outlets=1)], 0.8), overlap, 0.0)
    return ground.judge_sections(
        (0.4 - outside_share * 0.8, 50.0),
        0.0,
        NOTHING._replace(fence=BoundaryAhead(HALF_FIELD), started=(False,)),
    )[0]


def test_the_overlap_setting_is_a_share_of_the_width() -> None:
    assert judged_over_the_edge(50.0, 0.45).wanted and not judged_over_the_edge(50.0, 0.55).wanted
    assert judged_over_the_edge(20.0, 0.15).wanted and not judged_over_the_edge(20.0, 0.25).wanted
    assert judged_over_the_edge(0.0, -0.01).wanted and not judged_over_the_edge(0.0, 0.02).wanted


def test_no_more_than_half_a_section_works_outside_the_field_whatever_the_setting() -> None:
    assert judged_over_the_edge(100.0, 0.45).wanted
    beyond = judged_over_the_edge(100.0, 0.55)
    assert not beyond.wanted and beyond.why == WHY_OUTSIDE


def test_done_ground_closes_at_a_hundred_only_where_all_is_done() -> None:
    coverage = Coverage(2.4)
    for north in (0.0, 20.0):
        coverage.extend_to((0.0, north), 0.0, north > 0.0)
    for north in np.arange(0.0, 40.0, 1.0).tolist():
        coverage.extend_to((50.0, north), 0.0, False)
    ground = NOTHING._replace(coverage=coverage)
    three = make_section_strips([Section(outlets=2)] * 3, 2.4)

    def wanted(overlap: float) -> list[bool]:
        """Heading north, half the machine to the west: of the middle one half is done, of the
        right one all."""
        return [
            one.wanted
            for one in SectionGround(three, overlap, 0.2).judge_sections((-1.2, 10.0), 0.0, ground)
        ]

    assert wanted(100.0) == [True, True, False]
    assert wanted(0.0) == [True, False, False]
    judged = SectionGround(three, 50.0, 0.2).judge_sections((0.0, 10.0), 0.0, ground)
    assert [one.why for one in judged] == [WHY_DONE] * 3
    again = SectionGround(three, 50.0, 0.2).judge_sections(
        (0.0, 10.0), 0.0, ground._replace(started=(True, False, False))
    )
    assert [one.wanted for one in again] == [True, False, False]


def test_without_a_place_no_section_works_on_a_known_field() -> None:
    ground = SectionGround(make_section_strips([Section(outlets=1)], 0.8), 50.0, 0.0)
    assert not ground.judge_unknown_place(NOTHING._replace(fence=BoundaryAhead(HALF_FIELD)))[
        0
    ].wanted
    assert ground.judge_unknown_place(NOTHING)[0].wanted


# -- valves in time
# ------------------------------------------------------------------------------------------------


def sensed(time_s: float, north_m: float, mps: float) -> SensedMotion:
    return SensedMotion(
        time_s, mps, 0.0, "both", north_m, 5.0, north_m, 0.0, 0.0, True, 0.0, 0.1, False, False
    )


def test_each_valve_is_told_so_long_before_the_moment_as_it_takes(setup: Setup) -> None:
    machine = setup.machine.model_copy(
        update={
            "sections": tuple(
                Section(outlets=3, valve=Valve(open_s=open_s, close_s=0.3)) for open_s in (0.1, 0.6)
            )
        }
    )
    sections = SectionControl(machine, 50.0, 0.2)
    assert sections.prepare_s == 0.6
    ground, told, share = (
        NOTHING._replace(fence=BoundaryAhead(HALF_FIELD), started=(False,) * 2),
        {},
        {},
    )
    for k in range(-200, 400):
        now = 0.01 * k + 10.0
        sections.decide_switches(
            sensed(now, 0.01 * k - 3.0, 1.0), 0.01, SectionLeads(2.0, 2.0, 2.0), ground, ()
        )
        for number, on in enumerate(sections.find_valves(now, 0.01, ())):
            if on:
                told.setdefault(number, now)
        if sections.find_share_at(now) > 0.9:
            share.setdefault("whole", now)
    decided = 10.0 + 1.0  # 2 m before the edge at 0
    assert told[0] == pytest.approx(decided + 0.6 - 0.1, abs=0.011)
    assert told[1] == pytest.approx(decided, abs=0.011)
    assert share["whole"] == pytest.approx(decided + 0.6, abs=0.011)


def test_a_jump_of_the_position_takes_back_what_was_decided(setup: Setup) -> None:
    sections = SectionControl(setup.machine, 50.0, 0.2)
    ground = NOTHING._replace(fence=BoundaryAhead(HALF_FIELD))
    for k in range(40):
        sections.decide_switches(
            sensed(0.05 * k, 50.0 + 0.05 * k, 1.0), 0.05, SectionLeads(2.0, 2.0, 2.0), ground, ()
        )
    assert sections.find_share_at(2.0) == pytest.approx(1.0) and sections.is_any_inside(2.0)
    sections.cancel_decisions()
    sections.decide_switches(sensed(2.0, 5e6, 1.0), 0.05, SectionLeads(2.0, 2.0, 2.0), ground, ())
    assert sections.find_share_at(2.0) == 0.0 and not sections.is_any_inside(2.0)
    assert not any(sections.find_valves(2.0, 0.05, ()))


@pytest.mark.exam
@pytest.mark.parametrize("strategy", [Strategy.OPENING_FIRST, Strategy.SPEED_FIRST])
def test_flow_follows_what_is_open_and_lands_inside(setup: Setup, strategy: Strategy) -> None:
    """A pass along x = 1.2 that enters and leaves a field askew: judged by the plant."""
    job = manual(
        setup.job,
        strategy=strategy,
        field=setup.job.field.model_copy(update={"boundary_m": SLANTED}),
    )
    steps = run(setup, setup.machine, job, 80.0, Way([PathLeg(1.2, -25.0, 0.0, 400.0, 0.0)]))
    truths = [step.truth for step in steps]
    open_at_once = {step.tick.command.valves for step in steps}
    assert {(False,) * 3, (True, False, False), (True, True, False), (True,) * 3} <= open_at_once
    closed = [step.tick.row for step in steps if step.truth.north_m > 70.0]
    assert {row.target_rate_kg_ha for row in closed} == {0.0} and {
        row.target_source for row in closed
    } == {"none"}
    rates = rates_by_section(truths, setup.machine)
    for k, (inside, rate) in enumerate(rates):
        well_inside, well_outside = inside > 0.9, inside < 0.1
        assert rate[well_outside].max() < 60.0, f"section {k + 1} spread outside the field"
        assert np.median(rate[well_inside]) == pytest.approx(300.0, rel=0.05)
        assert np.mean(np.abs(rate[well_inside] - 300.0) < 60.0) > 0.85
    totals = sum(sum(t.section_kg) for t in truths)
    assert totals == pytest.approx(sum(t.flow_kg_s * 0.05 for t in truths), rel=1e-9)
    area_ha = steps[-1].tick.area_ha
    field_m2 = Polygon(SLANTED).intersection(shapely.box(0.0, 0.0, 2.4, 60.0)).area
    assert 10_000.0 * area_ha == pytest.approx(field_m2, rel=0.06)


def rates_by_section(
    truths: list[PlantTruth], machine: Machine
) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each section by stretch of 0.5 m: the share of it that lies in the field, what
    landed, kg/ha."""
    time_s, north, settled, drop = (
        np.array([getattr(t, name) for t in truths])
        for name in ("time_s", "north_m", "settled_drop_s", "drop_s")
    )
    lands_m = np.interp(time_s + calc_carried_s(time_s, settled) + drop - settled, time_s, north)
    field, edges = Polygon(SLANTED), np.arange(-5.0, 45.0, 0.5)
    found = []
    for k, strip in enumerate(machine.switched_strips):
        kg, _ = np.histogram(lands_m, edges, weights=[t.section_kg[k] for t in truths])
        wide = strip.right_m - strip.left_m
        inside = np.array(
            [
                field.intersection(
                    shapely.box(1.2 + strip.left_m, low, 1.2 + strip.right_m, low + 0.5)
                ).area
                / (0.5 * wide)
                for low in edges[:-1]
            ]
        )
        found.append((inside, kg / (0.5 * wide) * 10_000.0))
    return found


# -- safety
# --------------------------------------------------------------------------------------------------


def test_the_last_gate_closes_every_valve_without_flow() -> None:
    assert limit_valves((True, False, True), False) == (False, False, False)
    assert limit_valves((True, False, True), True) == (True, False, True)


def test_a_valve_is_open_only_while_every_interlock_holds(setup: Setup) -> None:
    job = manual(add_simulated_field(setup.job, setup.machine))
    orders = [
        (1.0, Order(Do.READY)),
        (14.0, Order(Do.START)),
        (24.0, Order(Do.HOLD)),
        (28.0, Order(Do.READY)),
        (29.0, Order(Do.START)),
        (40.0, Order(Do.STOP)),
    ]
    steps = run(setup, setup.machine, job, 45.0, orders=orders)
    seen = {(step.tick.row.state, any(step.tick.command.valves)) for step in steps}
    assert (State.WORKING, True) in seen
    assert not {state for state, on in seen if on} - {State.WORKING}
    for step in steps:
        if step.tick.verdict.why_no_flow:
            assert not any(step.tick.command.valves)
            assert all(one.why for one in step.tick.sections)
    assert {
        one.why for step in steps if step.tick.row.state == State.OFF for one in step.tick.sections
    } <= {WHY_NO_FLOW, WHY_OUTSIDE}


def test_a_section_closed_by_hand_stays_closed_until_it_is_given_back(setup: Setup) -> None:
    job = manual(add_simulated_field(setup.job, setup.machine))
    orders = [
        (1.0, Order(Do.READY)),
        (5.0, Order(Do.START)),
        (25.0, Order(Do.SECTION, "2 off")),
        (35.0, Order(Do.SECTION, "2 auto")),
    ]
    steps = run(setup, setup.machine, job, 45.0, orders=orders)
    by_hand = [step for step in steps if 25.1 < step.tick.row.time_s < 34.9]
    assert all(step.tick.command.valves == (True, False, True) for step in by_hand)
    assert {step.tick.sections[1].why for step in by_hand} == {"hand"}
    assert steps[-1].tick.command.valves == (True, True, True)
    late = [step.tick.row for step in by_hand if step.tick.row.time_s > 28.0]
    assert np.mean([row.applied_rate_kg_ha for row in late]) == pytest.approx(300.0, rel=0.03)
    landed = [step.truth.section_kg for step in by_hand if step.truth.time_s > 28.0]
    assert sum(kg[1] for kg in landed) == 0.0 and sum(kg[0] for kg in landed) > 0.1


@pytest.mark.parametrize(
    ("value", "why"),
    [
        ("4 off", "no_such_section"),
        ("0 off", "no_such_section"),
        ("two off", "section_off_or_auto"),
        (2.0, "section_off_or_auto"),
        ("2 on", "section_off_or_auto"),
    ],
)
def test_orders_for_no_section_are_refused(setup: Setup, value: Any, why: str) -> None:
    loop = make_control_loop(setup.machine, setup.crop, setup.rule, setup.job)
    assert loop.handle_order(Order(Do.SECTION, value)).why == why
    plain = setup.machine.model_copy(update={"sections": ()})
    assert (
        not make_control_loop(plain, setup.crop, setup.rule, setup.job)
        .handle_order(Order(Do.SECTION, "1 off"))
        .accepted
    )


def test_without_power_every_valve_closes(setup: Setup) -> None:
    plant = Plant(setup.machine, setup.job, 1, 0.05)
    for _ in range(40):
        plant.advance_plant(DriveCommand(70.0, 25.0, valves=(True, False, True)), True)
    assert (
        plant.truth is not None
        and plant.truth.section_kg[0] > 0.0
        and plant.truth.section_kg[1] == 0.0
    )
    assert plant.truth.open_share == pytest.approx(2.0 / 3.0)
    for _ in range(20):
        plant.advance_plant(DriveCommand(70.0, 25.0, valves=(True, True, True)), False)
    assert plant.truth.section_kg == (0.0,) * 3 and plant.truth.open_share == 0.0


def test_a_stuck_valve_shows_in_the_truth_alone(setup: Setup) -> None:
    plant = Plant(setup.machine, setup.job, 1, 0.05)
    assert plant.valves is not None
    plant.valves.stuck = {1: False, 2: True}
    for _ in range(40):
        plant.advance_plant(DriveCommand(70.0, 25.0, valves=(True, False, True)), True)
    assert plant.truth is not None
    assert [kg > 0.0 for kg in plant.truth.section_kg] == [False, True, True]
