"""The catalogue: every published id is there, complete, neutral by default, and does something when it is not."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from control.diagnosis.extend import extend
from control.diagnosis.result import Cause, Data, Diagnosis, FieldCost, Size, TermFound
from control.machine import compiled, over_log
from control.machine.effort import EffortInput, gate_effort, shaft_effort
from control.machine.fall import FallInput, fall_start, fall_step
from control.machine.flow import FlowInput, FlowOutput, flow_start
from control.machine.gate import GateInput, GateOutput, gate_start
from control.machine.heads import HeadInput, head_reads
from control.machine.history import last_change, undone
from control.machine.machine import CATALOGUE, Machine, effect_sizes, with_effect
from control.machine.scale import ScaleInput, scale_reads
from control.machine.shaft import ShaftInput, ShaftOutput, shaft_start
from control.machine.speed import SpeedInput, SpeedOutput, speed_start
from control.machine.terms import Term
from drivers.files.config import load, save
from drivers.files.kinds import MACHINE

PUBLISHED = """shaft.dead_zone shaft.saturation shaft.neutral shaft.back_gain shaft.back_zone
shaft.gain shaft.slow shaft.second_order shaft.ramp shaft.dead_time shaft.dead_band shaft.voltage_sag shaft.load_droop
shaft.coarse_encoder shaft.stall gate.offset gate.home_error gate.backlash gate.lost_steps gate.slow gate.stuck
flow.gain flow.zero_offset flow.fill_falloff flow.hopper_head flow.moisture_drift flow.batch flow.blocked_outlet
flow.outlet_uneven flow.bridging flow.leak flow.slope flow.pulsation speed.wheel_slip speed.wheel_radius
speed.missed_pulses speed.gnss_latency canopy.head_fouled canopy.warm_up canopy.saturation scale.gain scale.drift
scale.tilt lag.offset lag.rebound lag.first_fill lag.asymmetry lag.coarse_clock lag.speed_scale place.lever_arm
place.latency effort.friction effort.drag effort.load effort.gate_friction effort.gate_drag""".split()

BACKWARDS = {"shaft.back_gain", "shaft.back_zone"}      # tests/machine/test_nominal.py
IN_ITS_TABLE = {"lag.coarse_clock", "lag.speed_scale", "place.lever_arm"}    # no stage step: they act on bench tables


def outputs(machine: Machine) -> dict[str, np.ndarray[Any, Any]]:
    """Every stage over one busy drive."""
    n = 4000
    time_s = np.arange(n) * 0.05
    rng = np.random.default_rng(3)
    command = np.repeat(rng.uniform(0, 100, n // 40), 40).round(1)
    opening = np.repeat(rng.uniform(5, 60, n // 50), 50).round(1)
    supply = 13.5 - np.abs(np.sin(time_s / 7.0))
    pitch = 3.0 * np.sin(time_s / 11.0)
    none = over_log.no_switch()
    rows = over_log.input_rows
    found: dict[str, Any] = {}
    found["shaft"] = compiled.shaft_run(
        (machine.shaft,), none, shaft_start(), ShaftOutput(0.0, 0.0),
        rows(ShaftInput, n, command_rpm=command, opening_mm=opening, supply_v=supply), time_s, 0.05)
    found["gate"] = compiled.gate_run(
        (machine.gate,), none, gate_start(20.0), GateOutput(20.0, 20.0), rows(GateInput, n, command_mm=opening),
        time_s, 0.05)
    refill = np.zeros(n)
    refill[2000] = 50.0
    stopped = np.where(np.arange(n) % 1000 < 100, 0.0, command)
    found["flow"] = compiled.flow_run(
        (machine.flow,), none, flow_start(250.0), FlowOutput(0.0, 250.0),
        rows(FlowInput, n, shaft_rpm=stopped, opening_mm=opening, pitch_deg=pitch, refill_kg=refill), time_s, 0.05)
    found["speed"] = compiled.speed_run(
        (machine.speed,), none, speed_start(), SpeedOutput(0.0, 0.0),
        rows(SpeedInput, n, speed_mps=1.2 + 0.3 * np.sin(time_s), working=1.0, pitch_deg=pitch), time_s, 0.05)
    found["scale"] = np.array([scale_reads(machine.scale, ScaleInput(h, t, p))
                               for h, t, p in zip(250.0 - 0.1 * time_s, time_s, pitch, strict=True)])
    found["heads"] = np.array([[head_reads(machine.heads, HeadInput(0.5 + 0.1 * np.sin(t), head, t))
                                for head in range(1, 7)] for t in time_s[::20]])
    works = machine.effort._replace(coulomb=8.0, viscous=0.6, load=0.06, gate_coulomb=0.5, gate_viscous=0.02)
    found["effort"] = np.array([(shaft_effort(works, EffortInput(r, 0.0, 1.0, 5.0 * o)),
                                 gate_effort(works, EffortInput(o - 20.0)))
                                for r, o in zip(command, opening, strict=True)])
    state, falls = fall_start(), []
    for t, rpm in zip(time_s[::10], stopped[::10], strict=True):
        state, drop = fall_step(machine.fall, state, FallInput(rpm, 0.1 if rpm > 0 else 0.0, np.sign(np.sin(t))), 0.5)
        falls.append(drop)
    found["fall"] = np.array(falls)
    return found


@pytest.fixture(scope="module")
def nominal() -> dict[str, Any]:
    return outputs(Machine())


def test_every_published_id_and_no_other() -> None:
    assert set(CATALOGUE) == set(PUBLISHED)
    assert len(PUBLISHED) == len(set(PUBLISHED))


@pytest.mark.parametrize("effect_id", PUBLISHED)
def test_an_entry_is_complete(effect_id: str) -> None:
    entry = CATALOGUE[effect_id]
    effect = entry.effect
    says = 3 if entry.low < -100.0 and effect.unit == "%" else 2 if entry.low < 0.0 else 1
    assert len(effect.says) == says, "what the owner reads, for each sign that it may have, and of what is turned round"
    for text in (effect.unit, effect.title, effect.physics, effect.source, effect.advice, effect.separate):
        assert text.strip()
    assert effect.seen_in
    assert entry.low <= entry.neutral <= entry.high
    assert entry.low < entry.high < 1e6
    assert effect.probes


def test_the_nominal_machine_has_no_effect() -> None:
    assert effect_sizes(Machine()) == {}


@pytest.mark.parametrize("effect_id", sorted(set(PUBLISHED) - IN_ITS_TABLE - BACKWARDS))
def test_an_effect_changes_its_own_stage_only(effect_id: str, nominal: dict[str, Any]) -> None:
    entry = CATALOGUE[effect_id]
    size = entry.effect.probes[-1]
    changed = outputs(with_effect(Machine(), effect_id, size, 3 if entry.effect.member_field else None))
    for stage, values in nominal.items():
        assert np.array_equal(values, changed[stage]) == (stage != entry.stage), stage


@pytest.mark.parametrize(("effect_id", "size", "bad"), [("flow.gain", 800.0, "800"), ("shaft.dead_band", -1.0, "-1")])
def test_a_size_out_of_bounds_is_refused_with_the_range(effect_id: str, size: float, bad: str) -> None:
    with pytest.raises(ValueError, match=f"{effect_id}: size {bad}: allowed"):
        with_effect(Machine(), effect_id, size)


def test_which_head_must_be_said() -> None:
    with pytest.raises(ValueError, match="say which with #1 to #6"):
        with_effect(Machine(), "canopy.head_fouled", -5.0)
    assert with_effect(Machine(), "canopy.head_fouled", -5.0, 3).heads.fouled_head == 3.0


# --- What a diagnosis changed in a machine file stands in its history, and the last of it can be taken back ----------

TERM = Term.model_validate({"id": "flow.slope_roll_deg", "acts_on": "flow_percent", "form": "slope",
                            "over": ({"name": "roll_deg", "valid": (-4.0, 4.0)},), "coefficients": {"slope": -0.5}})


def found(size: float, *terms: Term) -> Diagnosis:
    cause = Cause("flow.gain", Size(size, size - 0.5, size + 0.5, "%"), None, 0.99, (), None, "Do a catch test.",
                  FieldCost(size, 0.0))
    told = tuple(TermFound(term.model_dump(mode="json"), "scale", "kg", 0.5, 0.1, 200.0, 0.8) for term in terms)
    return Diagnosis(Data("run.csv", "run", 600, 60.0, "huanghai"), (), "named", (cause,), (), (), None, (), None,
                     terms=told)


def test_the_last_change_is_taken_back_and_the_one_before_stays() -> None:
    start = Machine()
    first = extend(start, found(2.0), date="2026-07-01", sha256="1" * 64)
    second = extend(first, found(3.0, TERM), date="2026-07-09", sha256="2" * 64)
    assert (effect_sizes(second), [t.id for t in second.terms]) == ({"flow.gain": 5.0}, [TERM.id])
    back = undone(second, date="2026-07-10")
    assert back.model_copy(update={"history": ()}) == first.model_copy(update={"history": ()})
    assert [one.undone for one in back.history] == ["", "2026-07-10"]
    again = undone(back, date="2026-07-11")
    assert again.model_copy(update={"history": ()}) == start
    assert last_change(again) is None
    with pytest.raises(ValueError, match="nothing to take back"):
        undone(again)


def test_what_was_changed_by_hand_since_stays() -> None:
    changed = with_effect(extend(Machine(), found(2.0), date="2026-07-01"), "flow.gain", 2.5)
    assert effect_sizes(undone(changed)) == {"flow.gain": pytest.approx(0.5)}


def test_the_file_keeps_it(tmp_path: Path) -> None:
    extended = extend(Machine(), found(3.0, TERM), date="2026-07-09", sha256="2" * 64)
    save(tmp_path / "new.yaml", extended, MACHINE)
    read = load(str(tmp_path / "new.yaml"), MACHINE).model
    assert read == extended
    save(tmp_path / "back.yaml", undone(read, date="2026-07-10"), MACHINE)
    back = load(str(tmp_path / "back.yaml"), MACHINE).model
    assert (effect_sizes(back), back.terms, back.history[0].terms) == ({}, (), (TERM.model_copy(
        update={"source": back.history[0].terms[0].source}),))


def test_nothing_adopted_is_no_change() -> None:
    nothing = Diagnosis(Data("run.csv", "run", 600, 60.0, "huanghai"), (), "none", (), (), (), None, (), None)
    assert extend(Machine(), nothing) == Machine()
