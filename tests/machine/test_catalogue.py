"""The catalogue: every published id is there, complete, neutral by default, and does something
when it is not."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.result import (
    Cause,
    Diagnosis,
    FieldCost,
    Size,
    SourceSummary,
    TermFound,
)
from topdress.control.experiments.setting_levels import list_opening_levels, list_shaft_levels
from topdress.control.machine import compiled, stage_runner
from topdress.control.machine.effect import FULL_FLOW, SHAFT_RANGE
from topdress.control.machine.effort import EffortInput, calc_gate_effort, calc_shaft_effort
from topdress.control.machine.fall import FallInput, calc_drop_s, make_fall_start, step_fall
from topdress.control.machine.fault_injection import InjectedEffect, schedule_effects
from topdress.control.machine.flow import FlowInput, FlowOutput, calc_grams_per_rev, make_flow_start
from topdress.control.machine.gate import GateInput, GateOutput, make_gate_start
from topdress.control.machine.heads import HeadInput, read_head
from topdress.control.machine.history import find_last_change, undo_last_change
from topdress.control.machine.machine import (
    CATALOGUE,
    NOMINAL_MACHINE,
    Machine,
    add_effect,
    describe_unit,
    find_size_bounds,
    list_effect_sizes,
    scale_nominal,
)
from topdress.control.machine.scale import ScaleInput, read_scale
from topdress.control.machine.shaft import ShaftInput, ShaftOutput, make_shaft_start
from topdress.control.machine.speed import SpeedInput, SpeedOutput, make_speed_start
from topdress.control.machine.terms import Term
from topdress.drivers.files.config import ConfigError, find_shipped_files, load_config, save_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

# On the nominal machine: lowest and highest size, unit. Public.
OF_HUANGHAI = {
    "shaft.gain": (-300, 1900, "%"),
    "shaft.slow": (-5, 5, "s"),
    "shaft.second_order": (0, 5, "s"),
    "shaft.ramp": (0, 600, "s to full speed"),
    "shaft.dead_time": (-0.3, 2, "s"),
    "shaft.dead_band": (0, 60, "r/min"),
    "shaft.dead_zone": (0, 60, "r/min"),
    "shaft.saturation": (0, 95, "% lost at full speed"),
    "shaft.neutral": (-200, 200, "r/min of command"),
    "shaft.back_gain": (-90, 200, "%"),
    "shaft.back_zone": (-60, 60, "r/min"),
    "shaft.voltage_sag": (0, 30, "% lost per V"),
    "shaft.load_droop": (0, 60, "% lost at full opening"),
    "shaft.coarse_encoder": (0, 20, "r/min"),
    "shaft.stall": (0, 1, "s"),
    "gate.offset": (-20, 20, "mm, reading - true"),
    "gate.home_error": (-20, 20, "mm, true - command"),
    "gate.backlash": (0, 15, "mm"),
    "gate.lost_steps": (-5, 5, "mm per 100 mm"),
    "gate.slow": (-20, 19.5, "mm/s lost"),
    "gate.stuck": (0, 1, "s"),
    "flow.gain": (-60, 100, "%"),
    "flow.zero_offset": (-60, 60, "g per revolution"),
    "flow.fill_falloff": (-10, 60, "% lost at 100 r/min"),
    "flow.hopper_head": (0, 40, "% lost from full to empty"),
    "flow.moisture_drift": (-30, 30, "% per hour"),
    "flow.batch": (-60, 100, "%"),
    "flow.blocked_outlet": (0, 100, "% lost"),
    "flow.outlet_uneven": (-100, 100, "%"),
    "flow.bridging": (0, 90, "% of time"),
    "flow.leak": (0, 500, "kg/h"),
    "flow.slope": (-5, 5, "% more per degree nose up"),
    "flow.pulsation": (0, 100, "% amplitude"),
    "scale.gain": (-30, 30, "%"),
    "scale.drift": (-30, 30, "kg/h"),
    "scale.tilt": (-5, 5, "% more per degree nose up"),
    "speed.wheel_slip": (-5, 40, "%"),
    "speed.wheel_radius": (-20, 20, "%"),
    "speed.missed_pulses": (0, 60, "%"),
    "speed.gnss_latency": (0, 3, "s"),
    "canopy.head_fouled": (-90, 90, "%"),
    "canopy.warm_up": (-60, 60, "% at power-on"),
    "canopy.saturation": (0, 60, "% lost at NDVI 0.8"),
    "effort.friction": (0, 500, "% more than its own"),
    "effort.drag": (-90, 500, "% more than its own"),
    "effort.load": (-100, 500, "% more of the material's load"),
    "effort.gate_friction": (0, 500, "% more than its own"),
    "effort.gate_drag": (-90, 500, "% more than its own"),
    "lag.offset": (-2, 3, "s"),
    "lag.rebound": (-2, 3, "s above the straight line at 100 r/min"),
    "lag.first_fill": (-1, 5, "s"),
    "lag.asymmetry": (-3, 3, "s, down - up"),
    "lag.coarse_clock": (0, 2, "s"),
    "lag.speed_scale": (-50, 50, "%, true over written speed - 1"),
    "place.lever_arm": (-20, 20, "m"),
    "place.latency": (-3, 5, "s"),
}

BACKWARDS = {"shaft.back_gain", "shaft.back_zone"}  # tests/machine/test_nominal.py
# no stage step: they act on bench tables
IN_ITS_TABLE = {"lag.coarse_clock", "lag.speed_scale", "place.lever_arm"}


def outputs(machine: Machine) -> dict[str, np.ndarray[Any, Any]]:
    """Every stage over one busy drive."""
    n = 4000
    time_s = np.arange(n) * 0.05
    rng = np.random.default_rng(3)
    command = np.repeat(rng.uniform(0, 100, n // 40), 40).round(1)
    opening = np.repeat(rng.uniform(5, 60, n // 50), 50).round(1)
    supply = 13.5 - np.abs(np.sin(time_s / 7.0))
    pitch = 3.0 * np.sin(time_s / 11.0)
    none = stage_runner.make_no_switch()
    rows = stage_runner.make_input_rows
    found: dict[str, Any] = {}
    found["shaft"] = compiled.run_shaft(
        (machine.shaft,),
        none,
        make_shaft_start(),
        ShaftOutput(0.0, 0.0),
        rows(
            ShaftInput,
            n,
            command_rpm=command,
            opening_mm=opening,
            supply_v=supply,
            pitch_deg=pitch,
        ),
        time_s,
        0.05,
    )
    found["gate"] = compiled.run_gate(
        (machine.gate,),
        none,
        make_gate_start(20.0),
        GateOutput(20.0, 20.0),
        rows(GateInput, n, command_mm=opening),
        time_s,
        0.05,
    )
    refill = np.zeros(n)
    refill[2000] = 50.0
    stopped = np.where(np.arange(n) % 1000 < 100, 0.0, command)
    found["flow"] = compiled.run_flow(
        (machine.flow,),
        none,
        make_flow_start(250.0),
        FlowOutput(0.0, 250.0),
        rows(
            FlowInput, n, shaft_rpm=stopped, opening_mm=opening, pitch_deg=pitch, refill_kg=refill
        ),
        time_s,
        0.05,
    )
    found["speed"] = compiled.run_speed(
        (machine.speed,),
        none,
        make_speed_start(),
        SpeedOutput(0.0, 0.0),
        rows(SpeedInput, n, speed_mps=1.2 + 0.3 * np.sin(time_s), working=1.0, pitch_deg=pitch),
        time_s,
        0.05,
    )
    found["scale"] = np.array(
        [
            read_scale(machine.scale, ScaleInput(h, t, p))
            for h, t, p in zip(250.0 - 0.1 * time_s, time_s, pitch, strict=True)
        ]
    )
    found["heads"] = np.array(
        [
            [
                read_head(machine.heads, HeadInput(0.5 + 0.1 * np.sin(t), head, t))
                for head in range(1, 7)
            ]
            for t in time_s[::20]
        ]
    )
    works = machine.effort._replace(
        coulomb=8.0, viscous=0.6, load=0.06, gate_coulomb=0.5, gate_viscous=0.02
    )
    found["effort"] = np.array(
        [
            (
                calc_shaft_effort(works, EffortInput(r, 0.0, 1.0, 5.0 * o)),
                calc_gate_effort(works, EffortInput(o - 20.0)),
            )
            for r, o in zip(command, opening, strict=True)
        ]
    )
    state, falls = make_fall_start(), []
    for t, rpm in zip(time_s[::10], stopped[::10], strict=True):
        state, drop = step_fall(
            machine.fall, state, FallInput(rpm, 0.1 if rpm > 0 else 0.0, np.sign(np.sin(t))), 0.5
        )
        falls.append(drop)
    found["fall"] = np.array(falls)
    return found


@pytest.fixture(scope="module")
def nominal() -> dict[str, Any]:
    return outputs(Machine())


def test_every_published_id_and_no_other() -> None:
    assert set(CATALOGUE) == set(OF_HUANGHAI)


@pytest.mark.parametrize("effect_id", OF_HUANGHAI)
def test_an_entry_is_complete(effect_id: str) -> None:
    entry = CATALOGUE[effect_id]
    effect = entry.effect
    says = 3 if entry.low < -100.0 and effect.unit == "%" else 2 if entry.low < 0.0 else 1
    assert len(effect.says) == says, (
        "what the owner reads, for each sign that it may have, and of what is turned round"
    )
    for text in (
        effect.unit,
        effect.title,
        effect.physics,
        effect.source,
        effect.advice,
        effect.separate,
    ):
        assert text.strip()
    assert effect.seen_in
    assert entry.low <= entry.neutral <= entry.high
    assert entry.low < entry.high < 1e6
    assert effect.probes


def test_the_nominal_machine_has_no_effect() -> None:
    assert list_effect_sizes(Machine()) == {}


@pytest.mark.parametrize("effect_id", sorted(set(OF_HUANGHAI) - IN_ITS_TABLE - BACKWARDS))
def test_an_effect_changes_its_own_stage_only(effect_id: str, nominal: dict[str, Any]) -> None:
    entry = CATALOGUE[effect_id]
    size = entry.effect.probes[-1]
    changed = outputs(
        add_effect(Machine(), effect_id, size, 3 if entry.effect.member_field else None)
    )
    for stage, values in nominal.items():
        assert np.array_equal(values, changed[stage]) == (stage != entry.stage), stage


@pytest.mark.parametrize(
    ("effect_id", "size", "bad"), [("flow.gain", 800.0, "800"), ("shaft.dead_band", -1.0, "-1")]
)
def test_a_size_out_of_bounds_is_refused_with_the_range(
    effect_id: str, size: float, bad: str
) -> None:
    with pytest.raises(ValueError, match=f"{effect_id}: size {bad}: allowed"):
        add_effect(Machine(), effect_id, size)


def test_which_head_must_be_said() -> None:
    with pytest.raises(ValueError, match="say which with #1 to #6"):
        add_effect(Machine(), "canopy.head_fouled", -5.0)
    assert add_effect(Machine(), "canopy.head_fouled", -5.0, 3).heads.fouled_head == 3.0


# --- What a diagnosis changed in a machine file stands in its history, and the last of it can
# be taken back ----------

TERM = Term.model_validate(
    {
        "id": "flow.slope_roll_deg",
        "acts_on": "flow_percent",
        "form": "slope",
        "over": ({"name": "roll_deg", "valid": (-4.0, 4.0)},),
        "coefficients": {"slope": -0.5},
    }
)


def found(size: float, *terms: Term) -> Diagnosis:
    cause = Cause(
        "flow.gain",
        Size(size, size - 0.5, size + 0.5, "%"),
        None,
        0.99,
        (),
        None,
        "Do a catch test.",
        FieldCost(size, 0.0),
    )
    told = tuple(
        TermFound(term.model_dump(mode="json"), "scale", "kg", 0.5, 0.1, 200.0, 0.8)
        for term in terms
    )
    return Diagnosis(
        SourceSummary("run.csv", "run", 600, 60.0, "huanghai"),
        (),
        "named",
        (cause,),
        (),
        (),
        None,
        (),
        None,
        terms=told,
    )


def test_the_last_change_is_taken_back_and_the_one_before_stays() -> None:
    start = Machine()
    first = extend(start, found(2.0), date="2026-07-01", sha256="1" * 64)
    second = extend(first, found(3.0, TERM), date="2026-07-09", sha256="2" * 64)
    assert (list_effect_sizes(second), [t.id for t in second.terms]) == (
        {"flow.gain": 5.0},
        [TERM.id],
    )
    back = undo_last_change(second, date="2026-07-10")
    assert back.model_copy(update={"history": ()}) == first.model_copy(update={"history": ()})
    assert [one.undone for one in back.history] == ["", "2026-07-10"]
    again = undo_last_change(back, date="2026-07-11")
    assert again.model_copy(update={"history": ()}) == start
    assert find_last_change(again) is None
    with pytest.raises(ValueError, match="nothing to take back"):
        undo_last_change(again)


def test_what_was_changed_by_hand_since_stays() -> None:
    changed = add_effect(extend(Machine(), found(2.0), date="2026-07-01"), "flow.gain", 2.5)
    assert list_effect_sizes(undo_last_change(changed)) == {"flow.gain": pytest.approx(0.5)}


def test_the_file_keeps_it(tmp_path: Path) -> None:
    extended = extend(Machine(), found(3.0, TERM), date="2026-07-09", sha256="2" * 64)
    save_config(tmp_path / "new.yaml", extended, MACHINE_KIND)
    read = load_config(str(tmp_path / "new.yaml"), MACHINE_KIND).model
    assert read == extended
    save_config(tmp_path / "back.yaml", undo_last_change(read, date="2026-07-10"), MACHINE_KIND)
    back = load_config(str(tmp_path / "back.yaml"), MACHINE_KIND).model
    assert (list_effect_sizes(back), back.terms, back.history[0].terms) == (
        {},
        (),
        (TERM.model_copy(update={"source": back.history[0].terms[0].source}),),
    )


def test_nothing_adopted_is_no_change() -> None:
    nothing = Diagnosis(
        SourceSummary("run.csv", "run", 600, 60.0, "huanghai"),
        (),
        "none",
        (),
        (),
        (),
        None,
        (),
        None,
    )
    assert extend(Machine(), nothing) == Machine()


# --- Bounds of sizes and sizes tried follow the machine file: shares of its own ranges
# -------------------------------


def of(name: str) -> Machine:
    return load_config(name, MACHINE_KIND).model


@pytest.mark.parametrize("effect_id", CATALOGUE)
def test_sizes_on_the_nominal_machine_are_as_published(effect_id: str) -> None:
    low, high, unit = OF_HUANGHAI[effect_id]
    for machine in (of("huanghai"), Machine(), NOMINAL_MACHINE):
        assert find_size_bounds(effect_id, machine) == (low, high)
        assert describe_unit(effect_id, machine) == CATALOGUE[effect_id].effect.unit == unit
        assert EFFECT_ROWS[effect_id].scale_to_machine(machine) == EFFECT_ROWS[effect_id]


@pytest.mark.parametrize(
    ("name", "effect_id", "low", "high"),
    [
        ("drive_alone", "shaft.dead_band", 0.0, 390.0),
        ("drive_alone", "shaft.coarse_encoder", 0.0, 130.0),
        ("spreader", "gate.offset", -200.0 / 3.0, 200.0 / 3.0),
        ("spreader", "gate.slow", -40.0, 39.0),
        ("spreader", "scale.drift", -300.0, 300.0),
        ("spreader", "flow.leak", 0.0, 50000.0 / 11.0),
        ("planter", "gate.backlash", 0.0, 6.25),
        ("planter", "shaft.gain", -300.0, 1900.0),
    ],
)
def test_bounds_are_shares_of_the_machines_own_ranges(
    name: str, effect_id: str, low: float, high: float
) -> None:
    assert find_size_bounds(effect_id, of(name)) == pytest.approx((low, high))


@pytest.mark.parametrize("name", sorted(find_shipped_files("machines")))
@pytest.mark.parametrize("effect_id", sorted(CATALOGUE))
def test_sizes_tried_lie_within_the_bounds(name: str, effect_id: str) -> None:
    machine = of(name)
    row, (low, high) = (
        EFFECT_ROWS[effect_id].scale_to_machine(machine),
        find_size_bounds(effect_id, machine),
    )
    tried = [*row.trial_sizes, *([] if row.probe is None else [row.probe])]
    assert all(low <= size <= high for size in tried) and list(row.trial_sizes) == sorted(
        set(row.trial_sizes)
    )


def test_thresholds_are_tried_down_to_the_slowest_command() -> None:
    sizes = EFFECT_ROWS["shaft.dead_band"].scale_to_machine(of("drive_alone")).trial_sizes
    assert 6.5 < sizes[0] < 8.2 and sizes[-1] == pytest.approx(260.0)
    assert all(b / a < 1.31 for a, b in pairwise(sizes))
    # it turns from 200 on
    assert EFFECT_ROWS["shaft.dead_band"].scale_to_machine(of("spreader")).trial_sizes[
        0
    ] == pytest.approx(110.0)


def test_a_size_out_of_bounds_is_refused_with_this_machines_range() -> None:
    drive = of("drive_alone")
    assert add_effect(drive, "shaft.dead_band", 150.0).shaft.dead_band_rpm == 150.0
    with pytest.raises(
        ValueError, match=r"size 400: allowed 0 to 390 r/min where limits.shaft_high_rpm is 650$"
    ):
        schedule_effects(drive, [InjectedEffect("shaft.dead_band", 400.0)])
    with pytest.raises(
        ValueError, match=r"size 150: allowed 0 to 60 r/min where limits.shaft_high_rpm is 100$"
    ):
        add_effect(Machine(), "shaft.dead_band", 150.0)


def test_a_machine_file_with_a_size_out_of_its_bounds_is_refused_by_key_and_line(
    tmp_path: Path,
) -> None:
    text = find_shipped_files("machines")["huanghai"].read_text(encoding="utf-8")
    place = tmp_path / "m.yaml"
    place.write_text(
        text.replace("full_opening_mm: 60.0", "full_opening_mm: 60.0\n  dead_band_rpm: 150.0"),
        "utf-8",
    )
    with pytest.raises(ConfigError) as refused:
        load_config(place, MACHINE_KIND)
    line = place.read_text("utf-8").splitlines().index("  dead_band_rpm: 150.0") + 1
    assert refused.value.lines == (
        f"{place}: key shaft.dead_band_rpm: value 150.0: allowed 0 to 60 r/min where "
        f"limits.shaft_high_rpm is 100 (line {line})",
    )
    drive = find_shipped_files("machines")["drive_alone"].read_text(encoding="utf-8")
    place.write_text(drive.replace("shaft:\n", "shaft:\n  dead_band_rpm: 150.0\n"), "utf-8")
    assert load_config(place, MACHINE_KIND).model.shaft.dead_band_rpm == 150.0


def test_what_is_told_at_full_speed_is_told_at_the_machines_own() -> None:
    spreader = of("spreader")
    assert describe_unit("flow.fill_falloff", spreader) == "% lost at 1000 r/min"
    assert describe_unit("lag.rebound", of("planter")) == "s above the straight line at 60 r/min"
    lossy = add_effect(spreader, "flow.fill_falloff", 8.0).flow
    assert calc_grams_per_rev(lossy, 1000.0, 80.0) == pytest.approx(
        0.92 * calc_grams_per_rev(spreader.flow, 1000.0, 80.0)
    )
    fall = add_effect(Machine(), "lag.rebound", 0.4).fall._replace(
        slope_s_per_rpm=0.0, valid_to_rpm=400.0, full_rpm=600.0
    )
    assert calc_drop_s(fall, 600.0) - calc_drop_s(fall, 400.0) == pytest.approx(0.4)


def test_figures_as_multiples_of_the_nominal_machines() -> None:
    assert (
        scale_nominal(of("drive_alone"), SHAFT_RANGE) == 6.5
        and scale_nominal(of("drive_alone"), ()) == 1.0
    )
    assert scale_nominal(of("spreader"), FULL_FLOW) == pytest.approx(
        1.5 * 200.0 * 1000.0 / (5.5 * 60.0 * 100.0)
    )


def test_stairs_are_within_what_the_machine_can_do() -> None:
    assert list_shaft_levels(Machine()) == (20.0, 40.0, 60.0, 80.0) and list_opening_levels(
        Machine()
    ) == (
        10.0,
        20.0,
        30.0,
        40.0,
    )
    assert list_shaft_levels(of("spreader")) == (200.0, 400.0, 600.0, 800.0)
    assert list_shaft_levels(of("bench"))[0] == 50.0
