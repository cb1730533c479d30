"""Bounds of sizes and sizes tried follow the machine file: shares of its own ranges."""
from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from control.diagnosis.effects import ROWS
from control.experiments.levels import opening_levels, shaft_levels
from control.machine.effect import FULL_FLOW, SHAFT_RANGE
from control.machine.fall import drop_s
from control.machine.flow import grams_per_rev
from control.machine.machine import CATALOGUE, NOMINAL, Machine, bounds, of_nominal, unit_of, with_effect
from control.machine.planting import Planted, schedule
from drivers.files.config import ConfigError, load, shipped
from drivers.files.kinds import MACHINE

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


def of(name: str) -> Machine:
    return load(name, MACHINE).model


@pytest.mark.parametrize("effect_id", CATALOGUE)
def test_sizes_on_the_nominal_machine_are_as_published(effect_id: str) -> None:
    low, high, unit = OF_HUANGHAI[effect_id]
    for machine in (of("huanghai"), Machine(), NOMINAL):
        assert bounds(effect_id, machine) == (low, high)
        assert unit_of(effect_id, machine) == CATALOGUE[effect_id].effect.unit == unit
        assert ROWS[effect_id].on(machine) == ROWS[effect_id]


def test_the_table_has_every_effect() -> None:
    assert set(OF_HUANGHAI) == set(CATALOGUE)


@pytest.mark.parametrize(("name", "effect_id", "low", "high"), [
    ("drive_alone", "shaft.dead_band", 0.0, 390.0), ("drive_alone", "shaft.coarse_encoder", 0.0, 130.0),
    ("spreader", "gate.offset", -200.0 / 3.0, 200.0 / 3.0), ("spreader", "gate.slow", -40.0, 39.0),
    ("spreader", "scale.drift", -300.0, 300.0), ("spreader", "flow.leak", 0.0, 50000.0 / 11.0),
    ("planter", "gate.backlash", 0.0, 6.25), ("planter", "shaft.gain", -300.0, 1900.0),
])
def test_bounds_are_shares_of_the_machines_own_ranges(name: str, effect_id: str, low: float, high: float) -> None:
    assert bounds(effect_id, of(name)) == pytest.approx((low, high))


@pytest.mark.parametrize("name", sorted(shipped("machines")))
@pytest.mark.parametrize("effect_id", sorted(CATALOGUE))
def test_sizes_tried_lie_within_the_bounds(name: str, effect_id: str) -> None:
    machine = of(name)
    row, (low, high) = ROWS[effect_id].on(machine), bounds(effect_id, machine)
    tried = [*row.trial_sizes, *([] if row.probe is None else [row.probe])]
    assert all(low <= size <= high for size in tried) and list(row.trial_sizes) == sorted(set(row.trial_sizes))


def test_thresholds_are_tried_down_to_the_slowest_command() -> None:
    sizes = ROWS["shaft.dead_band"].on(of("drive_alone")).trial_sizes
    assert 6.5 < sizes[0] < 8.2 and sizes[-1] == pytest.approx(260.0)
    assert all(b / a < 1.31 for a, b in pairwise(sizes))
    assert ROWS["shaft.dead_band"].on(of("spreader")).trial_sizes[0] == pytest.approx(110.0)     # it turns from 200 on


def test_a_size_out_of_bounds_is_refused_with_this_machines_range() -> None:
    drive = of("drive_alone")
    assert with_effect(drive, "shaft.dead_band", 150.0).shaft.dead_band_rpm == 150.0
    with pytest.raises(ValueError, match=r"size 400: allowed 0 to 390 r/min where limits.shaft_high_rpm is 650$"):
        schedule(drive, [Planted("shaft.dead_band", 400.0)])
    with pytest.raises(ValueError, match=r"size 150: allowed 0 to 60 r/min where limits.shaft_high_rpm is 100$"):
        with_effect(Machine(), "shaft.dead_band", 150.0)


def test_a_machine_file_with_a_size_out_of_its_bounds_is_refused_by_key_and_line(tmp_path: Path) -> None:
    text = shipped("machines")["huanghai"].read_text(encoding="utf-8")
    place = tmp_path / "m.yaml"
    place.write_text(text.replace("full_opening_mm: 60.0", "full_opening_mm: 60.0\n  dead_band_rpm: 150.0"), "utf-8")
    with pytest.raises(ConfigError) as refused:
        load(place, MACHINE)
    line = place.read_text("utf-8").splitlines().index("  dead_band_rpm: 150.0") + 1
    assert refused.value.lines == (f"{place}: key shaft.dead_band_rpm: value 150.0: allowed 0 to 60 r/min where "
                                   f"limits.shaft_high_rpm is 100 (line {line})",)
    drive = shipped("machines")["drive_alone"].read_text(encoding="utf-8")
    place.write_text(drive.replace("shaft:\n", "shaft:\n  dead_band_rpm: 150.0\n"), "utf-8")
    assert load(place, MACHINE).model.shaft.dead_band_rpm == 150.0


def test_what_is_told_at_full_speed_is_told_at_the_machines_own() -> None:
    spreader = of("spreader")
    assert unit_of("flow.fill_falloff", spreader) == "% lost at 1000 r/min"
    assert unit_of("lag.rebound", of("planter")) == "s above the straight line at 60 r/min"
    lossy = with_effect(spreader, "flow.fill_falloff", 8.0).flow
    assert grams_per_rev(lossy, 1000.0, 80.0) == pytest.approx(0.92 * grams_per_rev(spreader.flow, 1000.0, 80.0))
    fall = with_effect(Machine(), "lag.rebound", 0.4).fall._replace(
        slope_s_per_rpm=0.0, valid_to_rpm=400.0, full_rpm=600.0)
    assert drop_s(fall, 600.0) - drop_s(fall, 400.0) == pytest.approx(0.4)


def test_figures_as_multiples_of_the_nominal_machines() -> None:
    assert of_nominal(of("drive_alone"), SHAFT_RANGE) == 6.5 and of_nominal(of("drive_alone"), ()) == 1.0
    assert of_nominal(of("spreader"), FULL_FLOW) == pytest.approx(1.5 * 200.0 * 1000.0 / (5.5 * 60.0 * 100.0))


def test_stairs_are_within_what_the_machine_can_do() -> None:
    assert shaft_levels(Machine()) == (20.0, 40.0, 60.0, 80.0) and opening_levels(Machine()) == (10.0, 20.0, 30.0, 40.0)
    assert shaft_levels(of("spreader")) == (200.0, 400.0, 600.0, 800.0)
    assert shaft_levels(of("bench"))[0] == 50.0
