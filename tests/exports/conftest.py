"""A small run log whose every figure is known: two passes over a step of the target, a pause, a
correction by scale."""

from __future__ import annotations

import datetime as dt
from math import radians, sin
from pathlib import Path

import pytest
from topdress.control.geodesy import TangentPlane
from topdress.control.log_row import LogRow
from topdress.control.machine.machine import Machine
from topdress.drivers.files.exports.as_applied import AsApplied, build_as_applied
from topdress.drivers.files.read_log import RunLog, read_log
from topdress.drivers.files.run_log import write_whole_log
from topdress.drivers.files.run_meta import make_run_meta

STEP_S, SPEED_MPS, TRIM = 0.05, 1.25, 1.02
BEGIN = dt.datetime(2026, 3, 7, 23, 59, 50, tzinfo=dt.UTC)
PLANE = TangentPlane(34.28, 119.88)


def row(k: int, machine: Machine) -> LogRow:
    """40 s of work northwards, 5 s held, 20 s of work; the rate changes from 200 to 320 at 12 s."""
    time = k * STEP_S
    north = SPEED_MPS * time + machine.geometry.antenna_m
    fix = 2 * (k // 2)  # GNSS at half the log's rate: held in between
    lat, lon = PLANE.convert_to_deg(5.0, north - SPEED_MPS * (k - fix) * STEP_S)
    working = not 40.0 <= time < 45.0
    rate = 200.0 if time < 12.0 else 320.0
    return LogRow(
        time_s=time,
        utc=(BEGIN + dt.timedelta(seconds=fix * STEP_S)).isoformat(timespec="milliseconds")[:-6]
        + "Z",
        lat_deg=lat,
        lon_deg=lon,
        fix_quality=4,
        satellites=14,
        hdop=0.8,
        heading_deg=0.0,
        speed_mps=SPEED_MPS,
        speed_used_mps=SPEED_MPS,
        target_rate_kg_ha=rate,
        shaft_rpm_cmd=70.0,
        shaft_rpm=70.0,
        opening_mm=20.0,
        flow_trim=TRIM,
        applied_rate_kg_ha=(rate + 3.0 * sin(radians(7.0 * k))) / TRIM,
        state="working" if working else "held",
        target_source="map",
    )


@pytest.fixture(scope="session")
def known_log(tmp_path_factory: pytest.TempPathFactory) -> RunLog:
    machine = Machine()
    crop = {"product": "urea", "product_n_fraction": 0.46}
    job = {
        "field": {
            "origin_lat_deg": 34.28,
            "origin_lon_deg": 119.88,
            "boundary_m": [[0.0, 0.0], [30.0, 0.0], [30.0, 100.0], [0.0, 100.0]],
        }
    }
    path: Path = tmp_path_factory.mktemp("log") / "known.csv"
    write_whole_log(path, make_run_meta(machine, crop, job), [row(k, machine) for k in range(1301)])
    return read_log(path)


@pytest.fixture(scope="session")
def applied(known_log: RunLog) -> AsApplied:
    return build_as_applied(known_log)
