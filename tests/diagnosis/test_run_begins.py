"""When a cause is said to begin."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis.extend import extend
from control.diagnosis.judgement.evidence import Role
from control.diagnosis.judgement.noise import coefficients, series_of, strengths
from control.diagnosis.result import UNKNOWN
from control.diagnosis.runs.changepoint import END_S, best_begins
from control.diagnosis.runs.channels import channels
from control.diagnosis.runs.coarsening import even_gain
from control.diagnosis.runs.columns import Columns
from control.diagnosis.runs.diagnose import diagnose_run, series_of_log
from control.diagnosis.runs.hypothesis import EffectInstance
from control.diagnosis.runs.model import GROUPS, GroupModel, course, with_course
from control.diagnosis.runs.search import Search
from drivers.files.config import load
from drivers.files.kinds import MACHINE


@pytest.mark.exam
def test_nothing_is_told_to_begin_at_either_end_of_a_log(work):
    """A shaft that turns ever faster from the first row on."""
    columns = {**work, "shaft_rpm": work["shaft_rpm"] * (1.0 + 0.04 * work["time_s"] / 600.0)}
    found = diagnose_run(columns, load("huanghai", MACHINE).model)
    begun = [cause.onset_s for cause in found.causes if cause.onset_s is not None]
    assert begun and np.min(begun) >= END_S and np.max(begun) <= work["time_s"][-1] - END_S


@pytest.mark.parametrize("grows", [False, True])
@pytest.mark.parametrize(("part", "channel"), [(EffectInstance("shaft.gain", -3.0), "shaft"),
                                               (EffectInstance("flow.zero_offset", -5.0), "scale")])
def test_how_a_cause_may_differ_in_form_is_confined_to_when_it_is_there(work, part, channel, grows):
    """What a part that begins late may be wrong by cannot stand for what was there all along."""
    machine = load("huanghai", MACHINE).model
    _, data, _ = series_of_log(work, machine)
    seen = channels(data, machine)
    columns = Columns(GroupModel([seen[name] for name in next(g for g in GROUPS.values() if channel in g)
                                  if name in seen], machine, data))
    late = part._replace(onset_s=300.0, grows=grows)
    freedom = [c for c in columns.of_hypothesis((late,)) if c.label.role is Role.FORM]
    one = columns.model.channel(channel)
    before = one.grid.even_s < 299.0
    shapes = [series_of(c.coefficients[channel], one.cut) for c in freedom]
    assert shapes and all(np.abs(s[before]).max() < 1e-3 * np.abs(s).max() for s in shapes)
    (own,) = columns.slopes((late,))
    does = np.abs(series_of(own.coefficients[channel], one.cut))
    # the drive follows: a leap would tell one reading
    not_yet = (one.grid.even_s < 301.0) & (does < 1e-3 * does.max())
    assert all(np.abs(s[not_yet]).max() < 1e-2 * np.abs(s).max() for s in shapes)


# --- Causes that come and go again within a log ----------------------------------------------------------------------

@pytest.fixture
def machine():
    return load("huanghai", MACHINE).model


@pytest.mark.parametrize(("id_", "channel"), [("shaft.gain", "shaft"), ("flow.zero_offset", "scale")])
def test_the_gain_of_a_box_is_that_of_least_squares(work, machine, id_, channel):
    """One box of one candidate, by hand: its trace whitened, what the hypothesis can take up projected off."""
    _, data, _ = series_of_log(work, machine)
    group = next(g for g in GROUPS.values() if channel in g)
    seen = channels(data, machine)
    search = Search([seen[name] for name in group if name in seen], machine, data)
    model, columns, noise = search.model, search.columns, search.refit(()).noise
    candidate = next(c for c in search.candidates if c.part.id == id_)
    banded, base = model.banded_residual(()), columns.of_hypothesis(())
    trace = model.difference((), candidate.part)
    found = best_begins(model.channels, banded, base, [noise], [candidate], [trace], matters=0.0, temporary=True)
    box = next((one for one in found if one.part.until_s is not None), None)
    assert box is not None and box.part.until_s - box.part.onset_s >= 20.0

    rows, left, basis = [], [], []
    for one in model.channels:
        scale = 1.0 / np.sqrt(strengths(noise[one.name], one.prior, one.cut, one.grid.step_s))
        there = course(one, box.part)
        summed = one.name == "scale"
        boxed = with_course(trace[one.name] / candidate.part.size, there, one.copies, summed) if one.name in trace \
            else np.zeros(len(one.measured))
        rows.append(coefficients(boxed, one.cut) * scale)
        left.append(banded[one.name] * scale)
        basis.append(np.array([c.coefficients.get(one.name, np.zeros(len(scale))) * scale for c in base]).T)
    stack = np.vstack([np.concatenate(basis), np.diag([1.0 / c.sd for c in base])]) if base else None
    x = np.concatenate([*rows, np.zeros(len(base))])
    y = np.concatenate([*left, np.zeros(len(base))])
    if stack is not None:
        q, _ = np.linalg.qr(stack / np.linalg.norm(stack, axis=0))
        x, y = x - q @ (q.T @ x), y - q @ (q.T @ y)
    best = np.clip(x @ y / (x @ x), candidate.low, candidate.high)
    assert box.part.size == pytest.approx(best, rel=0.1)
    assert box.gain == pytest.approx(2.0 * best * (x @ y) - best ** 2 * (x @ x), rel=0.1)


@pytest.mark.parametrize(("from_s", "to_s"), [pytest.param(150.0, 260.0, marks=pytest.mark.exam), (300.0, 380.0)])
def test_a_shaft_that_is_slow_for_a_while_is_named_with_both_times(work, machine, from_s, to_s):
    """2 % for a fifth of the log: neither all along nor from then on."""
    there = (work["time_s"] >= from_s) & (work["time_s"] < to_s)
    columns = {**work, "shaft_rpm": work["shaft_rpm"] * np.where(there, 0.98, 1.0)}
    del columns["hopper_kg"]        # the flow was as before
    found = diagnose_run(columns, machine)
    (cause,) = found.causes
    assert found.verdict == "named" and cause.id in ("shaft.gain", "shaft.load_droop", "shaft.voltage_sag")
    assert cause.onset_s == pytest.approx(from_s, abs=15.0) and cause.until_s == pytest.approx(to_s, abs=15.0)


@pytest.mark.exam
def test_an_offset_of_the_gate_that_is_gone_again_may_be_something_unknown(work, machine):
    """A constant for a while has no mark of its own: it may be an effect or anything else; when is said."""
    there = (work["time_s"] >= 150.0) & (work["time_s"] < 260.0)
    columns = {**work, "opening_mm": work["opening_mm"] + np.where(there, 0.15, 0.0)}
    del columns["hopper_kg"]
    found = diagnose_run(columns, machine)
    (cause,) = found.causes
    assert found.verdict == "ambiguous" and cause.id in ("gate.home_error", "gate.offset")
    assert UNKNOWN in [rival.id for rival in cause.rivals] and cause.probability <= 0.5
    assert cause.onset_s == pytest.approx(150.0, abs=2.0) and cause.until_s == pytest.approx(260.0, abs=2.0)
    assert extend(machine, found) == machine


def test_a_box_in_a_gap_of_the_log_has_no_evidence(work, machine):
    """Rows are missing: hardly a reading was taken while it would have been there."""
    gone = (work["time_s"] > 200.0) & (work["time_s"] < 230.0)
    log = {name: values[~gone] for name, values in work.items()}
    _, data, _ = series_of_log(log, machine)
    search = Search([channels(data, machine)["shaft"]], machine, data)
    part = next(c.part for c in search.candidates if c.part.id == "shaft.gain")._replace(onset_s=203.0, until_s=225.0)
    trace, noise = search.columns.trace((part,), 0), search.refit(()).noise
    assert even_gain(search, (), noise, trace) == 0.0


@pytest.mark.parametrize("late_s", [0.013, 0.026, 0.039])
def test_a_gate_that_stuck_between_two_rows_has_nothing_else(machine, late_s):
    """It moves by a millimetre from row to row, and stands where it stopped: gave gate.offset, 0.74 mm."""
    rng, time_s, stuck_s = np.random.default_rng(round(late_s / 0.013)), np.arange(0.0, 600.0, 0.05), 300.2 + late_s
    command = rng.uniform(10.0, 45.0, 200)[(time_s // 6.0).astype(int)]
    opening = [command[0]]
    for k in range(1, len(time_s)):
        most = 20.0 * np.clip(stuck_s + 0.05 - time_s[k], 0.0, 0.05)
        opening.append(opening[-1] + np.clip(command[max(0, k - 3)] - opening[-1], -most, most))
    columns = {"time_s": time_s, "opening_mm_cmd": command,
               "opening_mm": np.array(opening) + rng.normal(0.0, 0.1, len(time_s))}
    found = diagnose_run(columns, machine)
    assert [cause.id for cause in found.causes] == ["gate.stuck"], found.causes
    assert found.causes[0].onset_s == pytest.approx(stuck_s, abs=0.1)


def test_a_wheel_that_misses_pulses_has_its_radius():
    """A wheel's reading that remembers 0.2 s blurs its dips: gave speed.wheel_radius, 1.8 %, p = 0.97."""
    rng, time_s = np.random.default_rng(1), np.arange(0.0, 900.0, 0.1)
    speed = 1.3 + 0.2 * np.sin(time_s / 40.0) + 0.1 * np.sin(time_s / 11.0)
    missing = np.zeros(len(time_s))
    for begin in np.flatnonzero(rng.random(len(time_s)) < 0.03):
        missing[begin:begin + rng.integers(2, 9)] = 0.9
    remembers = np.exp(-np.arange(0.0, 3.0, 0.1) / 0.2)
    wheel = speed * (1.0 - np.convolve(missing, remembers / remembers.sum())[:len(time_s)])
    found = diagnose_run({"time_s": time_s, "speed_mps": speed + rng.normal(0.0, 0.03, len(time_s)),
                          "wheel_speed_mps": np.maximum(0.0, wheel + rng.normal(0.0, 0.012, len(time_s)))},
                         load("huanghai", MACHINE).model)
    assert [cause.id for cause in found.causes] == ["speed.missed_pulses"], found.causes
