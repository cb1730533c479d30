"""Run logs with and without something wrong, from columns to verdict. The logs are made by the compiled model."""
from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from control.diagnosis.extend import extend
from control.diagnosis.runs import columns as group_columns
from control.diagnosis.runs import grid, intermittent, log, onset, search, stages
from control.diagnosis.runs.channels import channels
from control.diagnosis.runs.diagnose import diagnose_run, series_of_log
from control.diagnosis.runs.guard import Cancelled
from control.diagnosis.runs.hypothesis import EffectInstance
from control.diagnosis.runs.model import nuisances
from control.diagnosis.runs.next_run import separation
from control.diagnosis.runs.settle import settle
from control.experiments.manoeuvres import manoeuvres
from control.machine.compiled import flow_run, gate_run, scale_run, shaft_run, speed_run
from control.machine.flow import FlowInput, FlowOutput, flow_start
from control.machine.gate import GateInput, GateOutput, gate_start
from control.machine.machine import CATALOGUE, Machine, effect_sizes, with_effect
from control.machine.over_log import MOST_STEP_S, input_rows, no_switch
from control.machine.scale import ScaleInput
from control.machine.shaft import ShaftInput, ShaftOutput, shaft_start
from control.machine.speed import SpeedInput, SpeedOutput, speed_start

STEP_S = 0.1


def levels(rng, time, low, high, hold_s):
    """Random steps held for `hold_s`."""
    values = rng.uniform(low, high, int(time[-1] / hold_s) + 2)
    return np.round(values[(time / hold_s).astype(int)], 1)


def a_run(machine, seed=1, seconds=600.0, still_opening=False, shaft=(30.0, 90.0)):
    """Columns of a run of `machine` with its noise: random set-points, headlands, a slope, a wandering supply."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, STEP_S)
    n, sd = len(time), machine.noise
    work = (time % 120.0) > 12.0
    shaft_cmd = np.where(work, levels(rng, time, *shaft, 4.0), 0.0)
    gate_cmd = np.full(n, 25.0) if still_opening else levels(rng, time, 15.0, 40.0, 5.0)
    supply = 13.2 + 0.5 * np.sin(time / 40.0)
    pitch = 3.0 * np.sin(time / 60.0)
    gates = (machine.gate,)
    gate = gate_run(gates, no_switch(), gate_start(gate_cmd[0]), GateOutput(gate_cmd[0], gate_cmd[0]),
                    input_rows(GateInput, n, command_mm=gate_cmd), time, MOST_STEP_S)
    shafts = (machine.shaft,)
    turns = shaft_run(shafts, no_switch(), shaft_start(0.0), ShaftOutput(0.0, 0.0),
                      input_rows(ShaftInput, n, command_rpm=shaft_cmd, opening_mm=gate[:, 0], supply_v=supply), time,
                      MOST_STEP_S)
    flows = (machine.flow,)
    flow = flow_run(flows, no_switch(), flow_start(280.0), FlowOutput(0.0, 280.0),
                    input_rows(FlowInput, n, shaft_rpm=turns[:, 0], opening_mm=gate[:, 0], pitch_deg=pitch), time,
                    MOST_STEP_S)
    scale = scale_run(machine.scale, input_rows(ScaleInput, n, hopper_kg=flow[:, 1], time_s=time, pitch_deg=pitch))
    true_speed = 1.3 + 0.2 * np.sin(time / 7.0)
    speeds = (machine.speed,)
    speed = speed_run(speeds, no_switch(), speed_start(1.3), SpeedOutput(1.3, 1.3),
                      input_rows(SpeedInput, n, speed_mps=true_speed, working=work.astype(float), pitch_deg=pitch),
                      time, MOST_STEP_S)
    keep = np.exp(-STEP_S / sd.scale_correlation_s)
    slow = np.empty(n)
    slow[0] = sd.scale_kg * rng.standard_normal()
    kicks = sd.scale_kg * np.sqrt(1.0 - keep * keep) * rng.standard_normal(n)
    for k in range(1, n):
        slow[k] = keep * slow[k - 1] + kicks[k]
    ndvi = 0.5 + 0.05 * np.sin(time / 11.0)
    columns = {
        "time_s": time, "shaft_rpm_cmd": shaft_cmd, "opening_mm_cmd": gate_cmd, "supply_v": supply, "pitch_deg": pitch,
        "roll_deg": np.cos(time / 33.0), "heading_deg": np.where(np.floor(time / 120.0) % 2 < 1, 0.0, 180.0),
        "shaft_rpm": turns[:, 1] + sd.shaft_rpm * rng.standard_normal(n),
        "opening_mm": gate[:, 1] + sd.opening_mm * rng.standard_normal(n),
        "hopper_kg": np.round((scale + slow) / 0.05) * 0.05,
        "wheel_speed_mps": speed[:, 0] + sd.wheel_mps * rng.standard_normal(n),
        "speed_mps": speed[:, 1] + sd.gnss_mps * rng.standard_normal(n),
    }
    for head in range(1, 7):
        columns[f"ndvi_{head}"] = ndvi + sd.ndvi * rng.standard_normal(n)
    return columns


@cache
def of_nothing(seed):
    return diagnose_run(a_run(Machine(), seed), Machine())


def ids(diagnosis):
    return sorted(cause.id for cause in diagnosis.causes)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.exam) for seed in (2, 3))])
def test_nothing_wrong_is_called_nothing(seed):
    found = of_nothing(seed)
    assert found.verdict == "none", found.causes
    assert not found.unexplained
    assert {c.channel for c in found.channels} == {"shaft", "gate", "flow", "scale", "speed", "heads"}
    for channel in found.channels:
        if channel.channel in ("shaft", "gate"):
            assert channel.rmse == pytest.approx(channel.noise_floor, rel=0.1)


@pytest.mark.parametrize("effects", [
    {"shaft.slow": 0.12, "gate.backlash": 0.8},
    *(pytest.param(effects, marks=pytest.mark.exam) for effects in (
        {"scale.tilt": 0.2},
        {"shaft.gain": 1.5, "gate.home_error": 0.4}, {"shaft.dead_time": 0.1, "gate.slow": 6.0},
        {"shaft.voltage_sag": 2.0, "flow.fill_falloff": 12.0}, {"shaft.load_droop": 4.0, "flow.slope": 1.0})),
], ids=lambda effects: "+".join(effects))
def test_effects_are_named_with_their_sizes_and_nothing_else_is(effects):
    """One in each group of channels at most: the groups are judged apart, and must not disturb each other."""
    machine = Machine()
    for effect, size in effects.items():
        machine = with_effect(machine, effect, size)
    short = all(effect.startswith(("shaft", "gate")) for effect in effects)
    found = diagnose_run(a_run(machine, seed=5, seconds=500.0 if short else 900.0), Machine())
    assert ids(found) == sorted(effects)
    for cause in found.causes:
        assert cause.size.value == pytest.approx(effects[cause.id], rel=0.15)
        assert cause.size.low < cause.size.value < cause.size.high
        assert cause.advice


@pytest.mark.exam
def test_late_gnss_speed_is_named():
    columns = a_run(Machine(), seed=5)
    true = 1.3 + 0.2 * np.sin((columns["time_s"] - 0.4) / 7.0)      # the wheel's, made in rows, is 0.1 s late itself
    columns["speed_mps"] = true + 0.03 * np.random.default_rng(2).standard_normal(len(true))
    found = diagnose_run(columns, Machine())
    assert ids(found) == ["speed.gnss_latency"]
    assert found.causes[0].size.value == pytest.approx(0.3, abs=0.05)


@pytest.mark.exam
def test_a_wrong_read_back_is_seen_in_gate_and_flow_at_once():
    found = diagnose_run(a_run(with_effect(Machine(), "gate.offset", 0.5), seed=6), Machine())
    assert ids(found) == ["gate.offset"] and not found.causes[0].rivals


def test_a_constant_flow_error_is_ambiguous_and_the_next_run_would_tell():
    found = diagnose_run(a_run(with_effect(Machine(), "flow.gain", 6.0), seed=8), Machine())
    assert found.verdict == "ambiguous"
    assert {c.id for c in found.causes} | {r.id for c in found.causes for r in c.rivals} >= {"flow.gain", "scale.gain"}
    assert found.next_run is not None and found.next_run.plan
    planned = next(one for one in manoeuvres(Machine()) if one.id == found.next_run.id)
    assert (found.next_run.plan, found.next_run.minutes) == (planned.plan, planned.minutes) and found.next_run.steps
    assert all(cause.scope is None for cause in found.causes)
    assert sum(r.probability for r in found.causes[0].rivals) + found.causes[0].probability <= 1.0 + 1e-9


def test_what_no_effect_explains_is_said_with_its_variable():
    columns = a_run(Machine(), seed=9)
    columns["wheel_speed_mps"] = columns["wheel_speed_mps"] * (1.0 + 0.02 * columns["roll_deg"])
    found = diagnose_run(columns, Machine())
    assert found.verdict == "unexplained"
    assert (found.unexplained[0].channel, found.unexplained[0].variable) == ("speed", "roll_deg")
    assert max(found.tables[0].values) == pytest.approx(2.0, abs=0.4)
    assert [term.acts_on.value for term in extend(Machine(), found).terms] == ["wheel_percent"]


GATE = ("time_s", "opening_mm_cmd", "opening_mm")


def off_by(of_time, seed=31):
    """A log of the gate alone whose reading is off by a function of time, mm."""
    columns = a_run(Machine(), seed=seed)
    return {name: columns[name] + (of_time(columns["time_s"]) if name == "opening_mm" else 0.0) for name in GATE}


def only_cause(columns):
    found = diagnose_run(columns, Machine())
    assert [c.id for c in found.causes] in (["gate.offset"], ["gate.home_error"])   # the same without scale
    within = found.causes[0].onset_s is not None        # what adds a constant for a while may be anything
    assert {r.id for r in found.causes[0].rivals} <= {"gate.offset", "gate.home_error", *["unknown"] * within}
    return found.causes[0]


def test_an_effect_may_begin_anywhere():
    cause = only_cause(off_by(lambda t: np.where(t > 300.0, 0.6, 0.0)))
    assert cause.size.value == pytest.approx(0.6, abs=0.02) and cause.onset_s == pytest.approx(300.0, abs=1.0)
    assert cause.until_s is None and not cause.grows


def test_an_effect_may_end_again():
    cause = only_cause(off_by(lambda t: np.where((t > 200.0) & (t < 320.0), 0.6, 0.0)))
    assert cause.size.value == pytest.approx(0.6, abs=0.02)
    assert cause.onset_s == pytest.approx(200.0, abs=1.0) and cause.until_s == pytest.approx(320.0, abs=1.0)


def test_an_effect_may_grow():
    cause = only_cause(off_by(lambda t: 0.8 * np.clip((t - 300.0) / 300.0, 0.0, 1.0)))
    assert cause.grows and cause.size.value == pytest.approx(0.8, abs=0.05)
    assert cause.onset_s == pytest.approx(300.0, abs=15.0)


def test_what_comes_and_goes_at_one_frequency_is_not_noise():
    found = diagnose_run(off_by(lambda t: 0.05 * np.sin(2.0 * np.pi * t / 7.0)), Machine())
    assert found.verdict == "unexplained" and found.unexplained[0].channel == "gate"
    assert found.unexplained[0].period_s == pytest.approx(7.0, rel=0.01)


@pytest.mark.exam
def test_a_further_column_may_be_the_cause():
    columns = a_run(Machine(), seed=33)
    torque = 300.0 + 10.0 * levels(np.random.default_rng(3), columns["time_s"], 0.0, 8.0, 15.0)
    columns["wheel_speed_mps"] = columns["wheel_speed_mps"] * (1.0 + 0.0003 * (torque - 300.0))
    found = diagnose_run({**columns, "x_engine_torque_nm": torque, "x_fan_rpm": np.roll(torque, 1500)}, Machine())
    assert found.verdict == "unexplained"
    assert [(u.channel, u.variable) for u in found.unexplained] == [("speed", "x_engine_torque_nm")]


def test_one_stage_alone_is_judged_without_the_columns_of_others():
    columns = a_run(with_effect(Machine(), "shaft.slow", 0.3), seed=34)
    found = diagnose_run({name: columns[name] for name in ("time_s", "shaft_rpm_cmd", "shaft_rpm")}, Machine())
    assert ids(found) == ["shaft.slow"] and {c.channel for c in found.channels} == {"shaft"}


@pytest.mark.parametrize("every", [10, *(pytest.param(every, marks=pytest.mark.exam) for every in (2, 20))])
def test_a_healthy_log_of_few_rows_a_second_is_healthy(every):
    """Rows every 0.2, 1 and 2 s of a machine whose commands change every 4 and 5 s."""
    columns = {name: values[::every] for name, values in a_run(Machine(), seed=35, seconds=1200.0).items()}
    assert diagnose_run(columns, Machine()).verdict == "none"


def test_a_log_of_which_nothing_can_be_judged_says_so():
    found = diagnose_run({"time_s": np.arange(0.0, 60.0, STEP_S)}, Machine())
    assert found.verdict == "not_judged" and not found.channels and found.findings


@pytest.mark.exam
def test_a_stall_is_named_with_its_time():
    columns = a_run(Machine(), seed=10, seconds=500.0)
    late = columns["time_s"] > 350.0
    columns["shaft_rpm"] = np.where(late, 0.3 * np.sin(columns["time_s"] * 9.0), columns["shaft_rpm"])
    found = diagnose_run(columns, Machine())
    cause = next(c for c in found.causes if c.id == "shaft.stall")
    assert cause.onset_s == pytest.approx(350.0, abs=0.5)
    assert "shaft.slow" not in ids(found)


def test_missing_pulses_show_as_dips():
    columns = a_run(Machine(), seed=11)
    rng = np.random.default_rng(0)
    dips = rng.random(len(columns["time_s"])) < 0.03
    columns["wheel_speed_mps"] = np.where(dips, 0.5, 1.0) * columns["wheel_speed_mps"]
    found = diagnose_run(columns, Machine())
    assert ids(found) == ["speed.missed_pulses"]
    assert found.causes[0].size.value == pytest.approx(1.5, rel=0.15)


@pytest.mark.exam
def test_bridging_is_named_by_its_share_of_time():
    found = diagnose_run(a_run(with_effect(Machine(), "flow.bridging", 15.0), seed=12, seconds=900.0), Machine())
    assert "flow.bridging" in ids(found)
    assert next(c for c in found.causes if c.id == "flow.bridging").size.value == pytest.approx(15.0, abs=6.0)


@pytest.mark.exam
def test_rows_missing_give_the_same_name():
    columns = a_run(with_effect(Machine(), "shaft.load_droop", 5.0), seed=13, seconds=500.0)
    keep = np.random.default_rng(1).random(len(columns["time_s"])) > 0.05
    found = diagnose_run({name: series[keep] for name, series in columns.items()}, Machine())
    assert ids(found) == ["shaft.load_droop"]
    assert any("missing" in sentence for sentence in found.findings)


def test_what_is_not_named_has_a_smallest_size_or_none_at_all():
    found = of_nothing(1)
    sizes = {n.id: n.smallest_detectable.value for n in found.not_shown}
    assert sizes["flow.pulsation"] is None and sizes["lag.offset"] is None
    assert 0.0 < sizes["shaft.gain"] < 1.0
    assert set(sizes) == set(CATALOGUE)


def test_extending_takes_the_effect_into_the_machine_and_the_second_look_finds_nothing():
    columns = a_run(with_effect(Machine(), "shaft.load_droop", 5.0), seed=15, seconds=500.0)
    first = diagnose_run(columns, Machine(), path="run.csv")
    extended = extend(Machine(), first, date="2026-01-01", sha256="ab")
    assert effect_sizes(extended)["shaft.load_droop"] == pytest.approx(5.0, rel=0.1)
    assert extended.adopted[0].data == "run.csv" and extended.adopted[0].valid["opening_mm"][0] >= 14.0
    assert diagnose_run(columns, extended).verdict == "none"
    gain = next(g for g in first.gain if g.channel == "shaft")
    assert gain.after < gain.before and gain.low <= gain.after <= gain.high
    others = {g.metric.split(", ")[-1].split()[0]: g for g in first.gain if g.channel == "shaft" and g is not gain}
    assert others.keys() == {"nameless", "placebo"}
    assert gain.after < others["nameless"].after * 1.02 and gain.after < others["placebo"].after


def test_the_same_log_gives_the_same_diagnosis():
    columns = a_run(with_effect(Machine(), "flow.slope", 1.0), seed=16, seconds=120.0)
    assert diagnose_run(columns, Machine()).to_json() == diagnose_run(columns, Machine()).to_json()


def test_progress_is_told_and_cancel_obeyed():
    shares = []
    columns = a_run(Machine(), seed=17, seconds=120.0)
    diagnose_run(columns, Machine(), progress=lambda share, word: shares.append(share))
    assert shares == sorted(shares) and shares[-1] <= 1.0
    with pytest.raises(Cancelled):
        diagnose_run(columns, Machine(), cancelled=lambda: True)


def test_a_log_of_one_stage_is_cancelled_in_the_middle_of_its_work():
    """Not only between groups of channels: every run of the model asks."""
    whole = a_run(Machine(), seed=17, seconds=120.0)
    columns = {name: whole[name] for name in ("time_s", "speed_mps", "wheel_speed_mps")}
    asked = []
    diagnose_run(columns, Machine(), cancelled=lambda: bool(asked.append(0)))
    assert len(asked) > 20
    left = iter(range(len(asked) // 2))
    with pytest.raises(Cancelled):
        diagnose_run(columns, Machine(), cancelled=lambda: next(left, None) is None)


def test_the_gate_s_speed_may_be_off_by_its_share_of_the_nominal_one():
    machine = Machine()
    sizes = {one.key: one.sd for one in nuisances("gate", machine)}
    assert sizes["gate.slew_mm_s"] == pytest.approx(
        machine.gate.slew_mm_s * 0.01 * machine.tolerance.gate_slew_percent)


def test_a_tolerance_of_the_shaft_may_differ_by_speed_and_by_way(monkeypatch):
    """From -1 at the lowest speed to 1 at the highest; -1 where the command falls, 1 where it rises."""
    monkeypatch.setattr(group_columns, "_column", lambda model, label, change, sd: change["shaft"])
    by_speed, by_way = group_columns._by_speed_and_way(None, "k", np.ones(4), np.array([20.0, 50.0, 80.0, 35.0]), 1.0)
    assert by_speed.tolist() == pytest.approx([-1.0, 0.0, 1.0, -0.5]) and by_way.tolist() == [1.0, 1.0, -1.0, -1.0]


def test_manoeuvres_separate_what_they_are_for():
    plans = {m.id: m for m in manoeuvres(Machine())}
    gain = EffectInstance("flow.gain", 5.0)
    assert separation(plans["openings"], Machine(), gain, "flow.zero_offset") > 3.0
    assert separation(plans["standing"], Machine(), gain, "flow.zero_offset") < 1.0
    assert separation(plans["refill"], Machine(), gain, "scale.gain") > 3.0


@pytest.mark.exam
def test_a_gate_that_hardly_moves_has_no_backlash():
    columns = a_run(Machine(), seed=18, still_opening=True)
    rng = np.random.default_rng(3)
    columns["opening_mm_cmd"] = levels(rng, columns["time_s"], 24.4, 25.6, 5.0)     # asked, and never done
    assert "gate.backlash" not in ids(diagnose_run(columns, Machine()))


@pytest.mark.exam
def test_a_gate_stuck_while_its_moves_are_small_is_named():
    columns = a_run(Machine(), seed=18, seconds=400.0, still_opening=True)
    rng = np.random.default_rng(3)
    command = levels(rng, columns["time_s"], 24.0, 26.0, 3.0)
    stuck = columns["time_s"] > 250.0
    columns["opening_mm_cmd"] = command
    where = np.where(stuck, command[~stuck][-1], command)
    columns["opening_mm"] = where + 0.1 * rng.standard_normal(len(command))
    found = diagnose_run(columns, Machine())
    cause = next(c for c in found.causes if c.id == "gate.stuck")
    assert cause.onset_s == pytest.approx(250.0, abs=4.0)


def test_a_gate_whose_last_move_came_late_is_not_stuck():
    found = a_gate_alone(Machine(), 0.02)
    channel = found.model.channels[0]
    still = channel.measured.copy()
    asked = found.model.predicted(())["gate"].copy()
    asked[-400:], still[-400:] = 20.0, 20.0 + 0.05 * np.random.default_rng(2).standard_normal(400)
    still[-500:-400] = asked[-500:-400] = 27.0
    asked[-400] = 21.0
    assert onset._still_from(still, asked, 0.05, 60) is None
    asked[-300:] += 2.0 * np.sin(np.arange(300) / 20.0)
    assert onset._still_from(still, asked, 0.05, 60) is not None


def a_gate_alone(machine, dead_time_off_s=0.0):
    """The gate of a run whose moves are shorter than a row, judged by a machine file with the nominal dead time."""
    gate = machine.gate._replace(dead_time_s=machine.gate.dead_time_s + dead_time_off_s)
    rng, time = np.random.default_rng(5), np.arange(0.0, 200.0, 0.05)
    moves = np.where(np.arange(len(time)) % 8 == 0, 0.3 * rng.choice((-1.0, 1.0), len(time)), 0.0)
    command = np.clip(np.round(25.0 + np.cumsum(moves), 1), 15.0, 35.0)
    read = gate_run((gate,), no_switch(), gate_start(command[0]), GateOutput(command[0], command[0]),
                    input_rows(GateInput, len(time), command_mm=command), time, MOST_STEP_S)[:, 1]
    columns = {"time_s": time, "opening_mm_cmd": command, "opening_mm": read + 0.05 * rng.standard_normal(len(time))}
    data = stages.run_data(log.gate(columns), machine)
    return search.Search([channels(data, machine)["gate"]], machine, data)


@pytest.mark.parametrize("off_s", [-0.012, -0.006])
def test_a_dead_time_is_found_where_moves_are_shorter_than_a_row(off_s):
    """Such a move has begun or is over when it is read: the likelihood has a kink, and its slope leads nowhere."""
    found = a_gate_alone(Machine(), off_s)
    settle(found.columns, ())
    assert found.model.offsets["gate.dead_time_s"] == pytest.approx(off_s, abs=0.004)


@pytest.mark.exam
def test_one_stretch_alone_is_no_evidence():
    """A GNSS receiver that holds its reading through one restart of the tractor is late then, and not all along."""
    columns = a_run(Machine(), seed=20, seconds=400.0)
    time = columns["time_s"]
    stop = np.clip(np.abs(time - 200.0) / 3.0 - 1.0, 0.3, 1.0)
    for name in ("wheel_speed_mps", "speed_mps"):
        columns[name] = columns[name] * stop
    late = columns["speed_mps"] / stop * np.interp(time - 0.6, time, stop)
    columns["speed_mps"] = np.where((time > 203.0) & (time < 207.0), late, columns["speed_mps"])
    late_s = [(one.onset_s, one.until_s) for one in diagnose_run(columns, Machine()).causes
              if one.id == "speed.gnss_latency"]
    assert all(begin is not None and end is not None and 150.0 < begin < 205.0 < end < 260.0 for begin, end in late_s)


@pytest.mark.exam
def test_short_bridges_show_by_the_mass_that_stayed():
    columns = a_run(Machine(), seed=22, seconds=700.0)
    time = columns["time_s"]
    begins, length_s, kg_s = (130.0, 260.0, 385.0, 510.0, 640.0), 4.0, 0.12
    stayed = sum(np.clip(time - b, 0.0, length_s) for b in begins) * kg_s
    columns["hopper_kg"] = columns["hopper_kg"] + stayed
    found = diagnose_run(columns, Machine())
    share = 100.0 * stayed[-1] / (columns["hopper_kg"][0] - columns["hopper_kg"][-1] + stayed[-1])
    assert ids(found) == ["flow.bridging"]
    size = found.causes[0].size
    assert size.low <= share <= size.high


def test_a_long_log_is_looked_at_in_windows_and_judged_on_every_row(monkeypatch):
    monkeypatch.setattr(grid, "MAX_ROWS", 5_000)
    monkeypatch.setattr(grid, "WINDOW_ROWS", 3_000)
    columns = a_run(with_effect(Machine(), "shaft.load_droop", 5.0), seed=23, seconds=900.0)
    found = diagnose_run(columns, Machine())
    assert ids(found) == ["shaft.load_droop"]
    assert found.causes[0].size.value == pytest.approx(5.0, rel=0.15)
    said = " ".join(found.findings)
    assert "33 % of 9000 rows" in said and "stage shaft: what was named holds on every row" in said


@pytest.mark.exam
def test_a_steady_error_is_told_from_drift_from_whichever_side_the_noise_is_fitted():
    """A wheel off by a constant share, in a log whose first fit takes it for drift."""
    columns = a_run(with_effect(Machine(), "speed.wheel_radius", -1.6), seed=31, seconds=600.0)
    columns["speed_mps"] = columns["speed_mps"] + 0.03 * np.random.default_rng(8).standard_normal(6000)
    found = diagnose_run(columns, Machine())
    assert ids(found) == ["speed.wheel_radius"]
    assert found.causes[0].size.low < -1.6 < found.causes[0].size.high


def drifting(columns, sd, seed):
    """The log with a gate reading that drifts: a first-order process that remembers for ninety seconds."""
    memory = np.exp(-float(np.median(np.diff(columns["time_s"]))) / 90.0)
    fresh = np.random.default_rng(seed).standard_normal(len(columns["time_s"])) * np.sqrt(1.0 - memory ** 2)
    return {**columns, "opening_mm": columns["opening_mm"] + sd * lfilter([1.0], [1.0, -memory], fresh)}


@pytest.mark.exam
def test_the_interval_of_a_dead_band_is_what_the_commands_leave_open():
    columns = a_run(with_effect(Machine(), "shaft.dead_band", 17.0), seed=33, seconds=400.0, shaft=(10.0, 60.0))
    found = diagnose_run(columns, Machine())
    cause = next(c for c in found.causes if c.id == "shaft.dead_band")
    given = np.unique(np.round(columns["shaft_rpm_cmd"], 3))
    assert cause.size.low <= 17.0 <= cause.size.high
    assert cause.size.high - cause.size.low < 3.0 * np.diff(given[given > 10.0]).max() + 0.5


@pytest.mark.exam
def test_an_encoder_in_whole_steps_is_read_off_and_hides_nothing_of_the_flow():
    columns = a_run(with_effect(Machine(), "flow.gain", 6.0), seed=34, seconds=900.0)
    columns["shaft_rpm"] = np.round(np.round(columns["shaft_rpm"] / 2.6) * 2.6, 3)
    found = diagnose_run(columns, Machine())
    assert "shaft.coarse_encoder" in ids(found) and "shaft.gain" not in ids(found)
    step = next(c for c in found.causes if c.id == "shaft.coarse_encoder").size
    assert step.value == pytest.approx(2.6, abs=0.002)
    flow = next(c for c in found.causes if c.id.startswith(("flow.", "scale.")))
    assert "flow.gain" in {flow.id, *(r.id for r in flow.rivals)} and abs(flow.size.value) > 3.0


@pytest.mark.exam
def test_where_a_reading_is_empty_for_long_its_command_stands_in():
    """The shaft stops and starts in stretches whose speeds are empty: a line over them would meter another mass."""
    columns = a_run(Machine(), seed=41)
    gone = (columns["time_s"] % 120.0 > 100.0) | (columns["time_s"] % 120.0 < 40.0)
    columns["shaft_rpm"] = np.where(gone, np.nan, columns["shaft_rpm"])
    assert diagnose_run(columns, Machine()).verdict == "none"


@pytest.mark.exam
def test_a_further_column_is_blamed_beside_a_drift():
    """A dependence that is as slow as the drift, and gains far more than over any other course of its column."""
    columns, rng = a_run(Machine(), seed=43, seconds=1500.0), np.random.default_rng(43)
    time_s = columns["time_s"]
    heat, drift = (lfilter([1.0], [1.0, -np.exp(-0.1 / kept_s)], rng.standard_normal(len(time_s)))
                   for kept_s in (60.0, 120.0))
    heat = 60.0 + 10.0 * heat / np.std(heat)
    columns["shaft_rpm"] = columns["shaft_rpm"] * (1.0 + 0.0006 * (heat - 60.0)) + 0.2 * drift / np.std(drift)
    found = diagnose_run({**columns, "x_oil_temperature_c": heat}, Machine())
    assert [(u.channel, u.variable) for u in found.unexplained] == [("shaft", "x_oil_temperature_c")]


@pytest.mark.exam
def test_a_wheel_that_rolls_shorter_on_one_side_of_a_slope_misses_no_pulses() -> None:
    """What follows the roll is no dip that comes at any time: a term is found, and no name beside it."""
    columns = a_run(Machine(), seed=11)
    roll = 4.0 * np.sin(columns["time_s"] / 23.0)
    columns["roll_deg"] = roll + 0.05 * np.random.default_rng(1).standard_normal(len(roll))
    columns["wheel_speed_mps"] = columns["wheel_speed_mps"] * np.where(roll < -2.5, 0.85, 1.0)
    found = diagnose_run(columns, Machine())
    assert "speed.missed_pulses" not in ids(found)
    assert any([v["name"] for v in one.term["over"]] == ["roll_deg"] for one in found.terms)


@pytest.mark.exam
def test_dips_that_begin_on_a_slope_alone_are_no_missing_pulses() -> None:
    """Only the noise's own extremes pass for dips there: few of the rows, and all of them where the machine leans."""
    columns, rng = a_run(Machine(), seed=11), np.random.default_rng(3)
    roll = 4.0 * np.sin(columns["time_s"] / 23.0)
    columns["roll_deg"] = roll + 0.05 * rng.standard_normal(len(roll))
    columns["wheel_speed_mps"] = columns["wheel_speed_mps"] * (1.0 - 0.07 * np.maximum(0.0, -roll - 2.5)) \
        + 0.03 * rng.standard_normal(len(roll))
    assert "speed.missed_pulses" not in ids(diagnose_run(columns, Machine()))


def test_pulses_that_are_missing_for_a_while_follow_no_column_that_happens_to_run_along() -> None:
    """They come in some classes of a slow column more than in others, and far more so in some of time."""
    columns, rng = a_run(Machine(), seed=11), np.random.default_rng(4)
    time_s = columns["time_s"]
    columns["roll_deg"] = 3.0 * np.sin(time_s / 60.0) + 0.3 * rng.standard_normal(len(time_s))
    dips = (rng.random(len(time_s)) < 0.1) & (time_s > 200.0) & (time_s < 330.0)
    columns["wheel_speed_mps"] = np.where(dips, 0.5, 1.0) * columns["wheel_speed_mps"]
    assert ids(diagnose_run(columns, Machine())) == ["speed.missed_pulses"]


@pytest.mark.parametrize(("in_one", "follows"), [(15, False), (25, True)])
def test_so_many_of_forty_dips_that_begin_in_one_class_of_sixteen_follow_its_variable(in_one, follows) -> None:
    begins = [*range(2, 2 + 2 * in_one, 2), *np.linspace(110, 1590, 40 - in_one).astype(int)]
    assert (intermittent._follows(np.isin(np.arange(1600), begins), np.arange(1600.0), 1.0) > 0.0) is follows


def test_a_few_dips_are_not_certain_to_be_missing_pulses() -> None:
    """Twelve outliers that all lie below come by chance once in four thousand times, and missing pulses are no everyday
    fault: their probability says so."""
    rng, count = np.random.default_rng(2), 12_000
    time_s = 0.05 * np.arange(count)
    speed = 1.4 + 0.1 * np.sin(time_s / 20.0)
    wheel = speed + 0.02 * rng.standard_normal(count)
    wheel[np.arange(600, count, 1000)] -= 0.4
    columns = {"time_s": time_s, "speed_mps": speed + 0.02 * rng.standard_normal(count), "wheel_speed_mps": wheel}
    (cause,) = diagnose_run(columns, Machine()).causes
    assert cause.id == "speed.missed_pulses" and 0.9 < cause.probability < 0.995
    wheel[np.arange(600, count, 2000)] += 0.8           # half of them above
    assert not series_of_log(columns, Machine())[2]


def test_pulses_that_stay_away_for_a_second_are_missing_though_tails_rise_as_often() -> None:
    """Spells of many rows count beside single outliers, which both sides have."""
    rng, count = np.random.default_rng(2), 12_000
    time_s = 0.05 * np.arange(count)
    speed = 1.4 + 0.1 * np.sin(time_s / 20.0)
    wheel = speed + 0.02 * rng.standard_normal(count)
    odd = rng.choice(count, 120, replace=False)
    wheel[odd] += np.where(np.arange(120) < 60, 0.4, -0.4)
    for begin in range(500, count, 1100):
        wheel[begin:begin + 20] *= 0.75
    found = diagnose_run({"time_s": time_s, "speed_mps": speed + 0.02 * rng.standard_normal(count),
                          "wheel_speed_mps": wheel}, Machine())
    assert [cause.id for cause in found.causes] == ["speed.missed_pulses"]
