"""Logs with long gaps: nobody knows what was metered meanwhile."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from control.diagnosis.runs.channels import _pieces
from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.intermittent import _Level, _short_bridges
from control.diagnosis.runs.log import gate
from control.diagnosis.runs.stages import run_data
from drivers.files.config import load
from drivers.files.kinds import MACHINE


def test_a_hopper_that_would_have_run_empty_over_gaps_goes_on_from_what_was_read(work):
    """It stood in three gaps of a minute each; bridged by lines, 30 kg are metered there that were not."""
    columns, time_s = {name: column.copy() for name, column in work.items()}, work["time_s"]
    kept = np.ones(len(time_s), bool)
    for begin_s in (100.0, 250.0, 400.0):
        gap = (time_s >= begin_s) & (time_s < begin_s + 60.0)
        kept &= ~gap
        columns["hopper_kg"] += np.where(time_s >= begin_s + 60.0, np.ptp(work["hopper_kg"][gap]), 0.0)
    columns["hopper_kg"] -= columns["hopper_kg"][-1] - 5.0
    found = diagnose_run({name: column[kept] for name, column in columns.items()}, load("huanghai", MACHINE).model)
    assert found.verdict == "none", (found.causes, found.unexplained)


def test_a_gap_that_ends_while_the_hopper_is_filled_starts_no_new_level(work):
    """150 kg in 20 s at 300 s; rows are missing until 303 s."""
    columns, time_s = {name: column.copy() for name, column in work.items()}, work["time_s"]
    columns["hopper_kg"] += 150.0 * np.clip((time_s - 300.0) / 20.0, 0.0, 1.0) - 100.0
    kept = (time_s < 296.0) | (time_s >= 303.0)
    log = gate({name: column[kept] for name, column in columns.items()})
    hopper = run_data(log, load("huanghai", MACHINE).model).hopper
    assert [end for end, _ in hopper.gaps] == [303] and 303 not in hopper.grid.rows
    assert [begin for begin, _, _ in _pieces(hopper)] == [0]


def test_a_long_move_of_a_gate_that_began_in_a_gap_is_no_fault():
    """39 mm at 20 mm/s take two seconds; rows are missing until it is half-way. A log of this kind gave
    gate.home_error, -14.6 mm from 1584 to 1614 s, p = 1.00."""
    rng, time_s = np.random.default_rng(7), np.arange(0.0, 600.0, 0.05)
    command = np.choose((time_s // 40.0).astype(int) % 3, [27.5, 46.4, 7.1])
    stands, opening = command[0], []
    for k in range(len(time_s)):
        opening.append(stands)
        stands += np.clip(command[max(0, k - 2)] - stands, -1.0, 1.0)
    columns = {"time_s": time_s, "opening_mm_cmd": command,
               "opening_mm": np.array(opening) + 0.1 * rng.standard_t(3.0, len(time_s))}
    kept = np.ones(len(time_s), bool)
    for move_s in (80.0, 320.0):
        kept &= (time_s < move_s - 30.0) | (time_s > move_s + 1.0)
    found = diagnose_run({name: column[kept] for name, column in columns.items()}, load("huanghai", MACHINE).model)
    assert found.verdict == "none", (found.causes, found.unexplained)


@pytest.mark.parametrize("in_gaps", [True, False])
def test_steps_of_the_scale_where_rows_are_missing_are_no_bridges(work, in_gaps):
    """Four steps of 0.5 kg up: what was metered in a gap nobody knows, elsewhere the hopper bridged. A log of this
    kind gave flow.bridging, 0.98 %, p = 0.95."""
    hopper = run_data(gate(work), load("huanghai", MACHINE).model).hopper
    at = np.array([100, 220, 340, 460])
    seconds = np.arange(len(hopper.grid.even_s))
    left = np.random.default_rng(3).normal(0.0, 0.1, len(seconds)) + 0.5 * np.searchsorted(at, seconds, side="right")
    level = _Level(280.0 - 0.15 * seconds, left, np.ones(len(seconds)), np.array([], int),
                   at if in_gaps else np.array([], int))
    assert (_short_bridges(hopper, level) is None) is in_gaps


def test_canopy_under_a_machine_that_stands_is_no_fouled_head():
    """Six heads at work for eight minutes; then a catch test, 60 s on one place, where each sees its own plants. A live
    log of this kind gave canopy.head_fouled, -7.7 %, p = 1."""
    rng, time_s = np.random.default_rng(4), np.arange(0.0, 600.0, 0.2)
    stands = (time_s >= 480.0) & (time_s < 540.0)
    speed = np.where(stands, 0.0, 1.3)
    canopy = 0.6 + 0.05 * np.sin(time_s / 5.0)
    place = rng.normal(0.0, 0.03, 6)
    columns = {"time_s": time_s, "speed_mps": speed + np.abs(rng.normal(0.0, 0.02, len(time_s))),
               "wheel_speed_mps": speed + np.where(stands, 0.0, rng.normal(0.0, 0.02, len(time_s)))}
    columns |= {f"ndvi_{k + 1}": np.where(stands, 0.6 + place[k], canopy + rng.normal(0.0, 0.03, len(time_s)))
                + rng.normal(0.0, 0.005, len(time_s)) for k in range(6)}
    found = diagnose_run(columns, load("huanghai", MACHINE).model)
    assert "heads" in [row.channel for row in found.channels]
    assert not [cause for cause in found.causes if cause.id.startswith("canopy")], found.causes


def late_rows(seed):
    """Ten minutes of a gate behind a computer that is late now and then; its board's readings are up to 20 ms old."""
    rng = np.random.default_rng(seed)
    late = np.where(rng.random(11_000) < 0.05, rng.geometric(0.5, 11_000), 0)
    time_s = np.cumsum(0.05 * (1 + late) + rng.uniform(0.0, 0.004, 11_000))
    time_s -= time_s[0]
    fine_s = np.arange(0.0, time_s[-1] + 0.1, 0.005)
    command = np.repeat(20.0 + np.cumsum(rng.choice([-0.8, 0.8], len(time_s) // 100 + 1)), 100)[:len(time_s)]
    command = np.round(np.clip(command, 12.0, 28.0), 1)
    command[8000:8800] = 45.0                                     # a catch test
    sent = command[np.clip(np.searchsorted(time_s, fine_s - 0.1 - rng.uniform(0.0, 0.02), side="right") - 1, 0, None)]
    wide = np.empty(len(fine_s))
    at = sent[0]
    for k, asked in enumerate(sent):
        at += np.clip(asked - at, -0.1, 0.1)
        wide[k] = at
    read = np.interp(time_s - rng.uniform(0.0, 0.02, len(time_s)), fine_s, wide)
    return {"time_s": time_s, "opening_mm_cmd": command, "opening_mm": read + rng.normal(0.0, 0.08, len(time_s))}


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.exam) for seed in (2, 3))])
def test_moves_in_rows_of_a_late_computer_are_no_slow_gate(seed):
    found = diagnose_run(late_rows(seed), load("huanghai", MACHINE).model)
    assert [row.channel for row in found.channels] == ["gate"]
    assert found.verdict == "none", (found.causes, found.unexplained)
    assert any("rows in which it moves quickly are left out" in text for text in found.findings)


def test_a_logger_that_only_lost_rows_tells_of_moves_as_before(work):
    kept = np.random.default_rng(1).random(len(work["time_s"])) > 0.08
    log = gate({name: column[kept] for name, column in work.items()})
    data = run_data(log, load("huanghai", MACHINE).model)
    assert data.gate.left_out == 0 and data.gate.moves_seen


def test_a_machine_that_stops_and_starts_has_no_late_receiver():
    """A receiver whose noise remembers 0.3 s, three stops of half a minute: what it read before one and what it reads
    after it do not belong together. This log gave speed.gnss_latency, 0.13 s, p = 0.99."""
    rng, time_s = np.random.default_rng(2), np.arange(0.0, 240.0, 0.02)
    remembers = np.exp(-0.02 / 0.3)
    speed = np.interp(time_s, [0, 55, 57, 85, 87, 120, 122, 150, 152, 180, 182, 210, 212, 240],
                      [1.4, 1.4, 0, 0, 1.5, 1.5, 0, 0, 1.2, 1.2, 0, 0, 1.4, 1.4])
    noise = [sd * lfilter([np.sqrt(1.0 - remembers ** 2)], [1.0, -remembers], rng.normal(size=len(time_s)))
             for sd in (0.04, 0.01)]
    columns = {"time_s": time_s, "speed_mps": np.abs(speed + noise[0]), "wheel_speed_mps": np.abs(speed + noise[1])}
    assert diagnose_run(columns, load("huanghai", MACHINE).model).verdict == "none"
