"""The picture of a frame's field, read from what stands beside its run log; and a what-if of
that log, cancelled."""

from __future__ import annotations

import dataclasses
import datetime as dt
import json
from pathlib import Path

import numpy as np
import pytest
from topdress.console.app.pages.replay.service import WhatIf
from topdress.console.frame import Frame
from topdress.console.services.field import MAX_CELLS, make_field_picture
from topdress.console.services.replay_frames import make_frames, open_replay
from topdress.control.log_row import LogRow
from topdress.control.simulation.assembly import add_simulated_field
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_log import PlainLogWriter
from topdress.drivers.files.run_meta import make_run_meta
from topdress.drivers.files.run_setup import Setup, load_setup


def write(path: Path, setup: Setup, rows: int = 300, boundary: bool = True) -> Path:
    """A log of a machine that stands at the field's origin."""
    job = add_simulated_field(setup.job, setup.machine) if boundary else setup.job
    meta = make_run_meta(
        setup.machine, setup.crop, job, seed=1, extra={"job_folder": str(setup.folder)}
    )
    writer = PlainLogWriter(path, meta)
    for k in range(rows):
        writer.append(
            LogRow(
                time_s=k / 20,
                lat_deg=34.28,
                lon_deg=119.88,
                heading_deg=0.0,
                fix_quality=4,
                speed_mps=0.0,
                wheel_speed_mps=0.0,
                ndvi=0.5,
                state="off",
            )
        )
    writer.close()
    return path


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup("huanghai", "map_demo", dt.date(2026, 3, 18))


def frame_of(path: Path) -> Frame:
    return Frame(seq=0, at_s=0.0, row=LogRow(0.0), log_path=str(path))


def test_outline_and_plan_of_the_job_in_the_log(tmp_path, setup):
    picture = make_field_picture(frame_of(write(tmp_path / "a.csv", setup)))
    assert picture is not None and picture.planned is not None
    box = picture.box
    assert (box.east_m - box.west_m, box.north_m - box.south_m) == pytest.approx((24 * 2.4, 150.0))
    assert picture.area_ha == pytest.approx(0.864) and picture.width_m == 2.4
    assert picture.planned.rate_kg_ha.size <= MAX_CELLS
    assert set(np.unique(picture.planned.rate_kg_ha[np.isfinite(picture.planned.rate_kg_ha)])) == {
        180.0,
        270.0,
        360.0,
    }


def test_the_plan_is_what_the_loop_works_on(tmp_path, setup):
    from topdress.drivers.files.prescriptions.job_targets import read_job_map

    job = add_simulated_field(setup.job, setup.machine)
    picture = make_field_picture(frame_of(write(tmp_path / "a.csv", setup)))
    profile = read_job_map(job, setup.folder)
    rng = np.random.default_rng(3)
    places = rng.uniform((1.0, 1.0), (56.0, 149.0), (200, 2))
    wanted = [
        profile.prescription.find_target((east, north)).rate_kg_ha
        for east, north in places.tolist()
    ]
    found = [picture.planned.find_rate(east, north) for east, north in places.tolist()]
    assert sum(a == b for a, b in zip(found, wanted, strict=True)) >= 190, "but on the zones' edges"


def test_a_canopy_job_has_an_outline_and_no_plan(tmp_path):
    picture = make_field_picture(
        frame_of(write(tmp_path / "a.csv", load_setup("huanghai", "demo", dt.date(2026, 3, 18))))
    )
    assert picture.planned is None and picture.rings_m


def test_a_log_that_does_not_say_its_job_has_no_picture(tmp_path):
    assert make_field_picture(frame_of(tmp_path / "none.csv")) is None
    assert (
        make_field_picture(dataclasses.replace(frame_of(tmp_path / "none.csv"), log_path=""))
        is None
    )


def test_a_plan_that_is_gone_is_said_in_one_line(tmp_path, setup):
    path = write(tmp_path / "a.csv", dataclasses.replace(setup, folder=tmp_path))
    with pytest.raises(ValueError, match=r"map_demo\.geojson") as raised:
        make_field_picture(frame_of(path))
    assert "\n" not in str(raised.value)


def test_without_an_outline_log_and_plan_still_share_one_plane(tmp_path, setup):
    """The machine stood at the field's corner: it must lie at that corner of the plan."""
    path = write(tmp_path / "a.csv", setup, boundary=False)
    recorded = read_log(path)
    frame = next(make_frames(recorded.rows(), recorded))
    planned = make_field_picture(frame).planned
    antenna_m = setup.machine.geometry.antenna_m
    assert frame.place_m == pytest.approx((planned.west_m, planned.south_m - antenna_m), abs=1.0)


def test_a_cancelled_what_if_stops_at_its_next_row(tmp_path, setup):
    recorded = read_log(write(tmp_path / "a.csv", setup, rows=400))
    compute = open_replay(recorded).what_if
    assert compute is not None
    told: list[float] = []
    frames = compute(WhatIf(strategy="speed_first"), lambda: len(told) >= 3, told.append)
    assert told == [0.0, 64 / 400, 128 / 400] and 128 <= len(frames) <= 130
    assert len(compute(WhatIf(), lambda: False, told.append)) == 400 and told[-1] == 384 / 400


def test_where_the_map_says_nothing_nothing_is_planned(tmp_path, setup):
    ring = [
        [119.88, 34.28],
        [119.8802, 34.28],
        [119.8802, 34.2805],
        [119.88, 34.2805],
        [119.88, 34.28],
    ]
    zone = {
        "type": "Feature",
        "properties": {"rate_kg_ha": 200.0},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    corner = {
        "type": "Feature",
        "properties": {"rate_kg_ha": 100.0},
        "geometry": {
            "type": "Polygon",
            "coordinates": [
                [[119.8804, 34.2810], [119.8805, 34.2810], [119.8805, 34.2811], [119.8804, 34.2810]]
            ],
        },
    }
    (tmp_path / "map_demo.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [zone, corner]})
    )
    planned = make_field_picture(frame_of(write(tmp_path / "a.csv", setup))).planned
    assert planned.find_rate(5.0, 20.0) == 200.0 and planned.find_rate(30.0, 20.0) is None
    assert planned.rate_ends == (100.0, 200.0)
    assert planned.planned_mass_kg == pytest.approx(
        0.02 * 18.4 * 55.5 + 0.01 * 0.5 * 9.2 * 11.1, rel=0.06
    )
