"""How long a log row holds a value that no longer comes: the published times, as the loop writes them."""
from __future__ import annotations

import datetime as dt

import pytest

from control.readings import GnssFix, Measurements, Reading
from control.simulation.assembly import control_loop
from drivers.files.setup import load_setup

SETUP = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
PUBLISHED_S = {"shaft_rpm": 0.5, "opening_mm": 0.5, "wheel_speed_mps": 1.0, "pitch_deg": 1.0, "roll_deg": 1.0,
               "hopper_kg": 2.0, "supply_v": 2.0, "ndvi_1": 1.25, "lat_deg": 1.0}


@pytest.mark.parametrize("column", PUBLISHED_S)
def test_a_value_stands_for_its_time_and_then_the_cell_is_empty(column: str) -> None:
    heard = Reading(1.0, 100.0)
    said = {"gnss": GnssFix(100.0, 34.28, 119.88, 4, speed_mps=1.0, heading_deg=0.0)} if column == "lat_deg" else (
        {"ndvi": (heard,) * 6} if column == "ndvi_1" else {column: heard})
    loop = control_loop(SETUP.machine, SETUP.crop, SETUP.rule, SETUP.job)
    held_s = PUBLISHED_S[column]
    for age_s, stands in ((0.0, True), (held_s - 0.01, True), (held_s + 0.01, False)):
        row = loop.tick(Measurements(100.0 + age_s, **said)).row       # type: ignore[arg-type]
        assert (getattr(row, column) is not None) is stands
