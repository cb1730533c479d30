"""What the data gate leaves out, and that it says so."""
from __future__ import annotations

import numpy as np

from control.diagnosis.runs.findings import between_rows
from control.diagnosis.runs.log import gate

ROWS = 400


def columns(speed_mps):
    rng = np.random.default_rng(1)
    heads = {f"ndvi_{k}": rng.normal(0.5, 0.01, ROWS) for k in range(1, 7)}
    return {"time_s": 0.1 * np.arange(ROWS), "speed_mps": speed_mps, "wheel_speed_mps": np.zeros(ROWS),
            "shaft_rpm_cmd": np.full(ROWS, 50.0), "shaft_rpm": rng.normal(50.0, 0.3, ROWS)} | heads


def test_a_machine_that_stood_shows_nothing_of_speeds_and_heads():
    speed_mps = np.abs(np.random.default_rng(2).normal(0.0, 0.02, ROWS))
    speed_mps[77] = 4.0                                       # an outlier of the receiver is no journey
    clean = gate(columns(speed_mps))
    assert clean.stages == ("shaft",)
    assert any("stood all the time" in text for text in clean.findings)


def test_a_machine_that_stood_for_most_of_it_did_move():
    speed_mps = np.zeros(ROWS)
    speed_mps[:60] = 1.3
    clean = gate(columns(speed_mps))
    assert clean.stages == ("shaft", "speed", "heads")
    assert not any("stood" in text for text in clean.findings)


def test_small_faults_of_the_drives_are_doubted_where_commands_may_be_lost():
    clean = gate(columns(np.full(ROWS, 1.3)))                  # ten rows a second
    said = between_rows(clean, {"gate.slow", "flow.gain"})
    assert len(said) == 1 and said[0].startswith("gate.slow: rows come every 0.1 s")
    assert between_rows(clean, {"flow.gain"}) == []
    every_tick = clean._replace(step_s=0.05, time_s=0.05 * np.arange(ROWS))
    assert between_rows(every_tick, {"gate.slow"}) == []
    holed = every_tick._replace(time_s=np.delete(every_tick.time_s, np.arange(5, ROWS, 20)))
    assert "5 % of the rows are missing" in between_rows(holed, {"gate.slow"})[0]


def test_readings_alike_to_their_last_printed_digit_are_one_reading() -> None:
    """What repeats, and in which steps, is evidence: it must not hang on the last bits of a float."""
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 60.0, 0.1)
    columns = {"time_s": time_s, "hopper_kg": np.round((280.0 - 0.1 * time_s) / 0.05) * 0.05,
               "speed_mps": np.repeat(np.round(1.3 + 0.02 * rng.standard_normal(120), 3), 5), "x_load": time_s // 7.0}
    moved = {name: values + (1e-11 * rng.standard_normal(600) if name != "time_s" else 0.0)
             for name, values in columns.items()}
    one, other = gate(columns), gate(moved)
    for name in ("hopper_kg", "speed_mps"):
        assert np.array_equal(one.columns[name], other.columns[name]), name
    assert np.array_equal(one.further["x_load"], other.further["x_load"])
    huge = gate({**columns, "hopper_kg": np.full(600, 1e305)})
    assert np.isnan(huge.columns["hopper_kg"]).all() and any("beyond 1e+09" in one for one in huge.findings)
