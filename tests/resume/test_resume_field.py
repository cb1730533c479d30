"""Jobs that were left, by place: which field they lie on, on whose plane, and what a start
there knows of them."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest
from topdress.console.worker import resume
from topdress.console.worker.assemble import assemble_run
from topdress.console.worker.options import Options
from topdress.console.worker.resume import Snapshot
from topdress.console.worker.resume_field import find_jobs_here, move_snapshot
from topdress.control.field.coverage import Raster
from topdress.control.field.job import Ground, Job
from topdress.control.field.job_totals import Totaliser, TotalSums
from topdress.control.geodesy import TangentPlane
from topdress.drivers.files.config import find_shipped_files, load_config, save_config
from topdress.drivers.files.config_kinds import JOB_KIND

NOW = dt.datetime.now(dt.UTC)
HOME = 34.28, 119.88
SQUARE = ((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))


def kept(folder, name="west", box=(0.0, 50.0, 0.0, 20.0), origin=HOME, **known):
    """A job that has spread a rectangle (west, east, south, north) of its plane."""
    west, east, south, north = box
    cells = np.ones((round((north - south) / 0.25), round((east - west) / 0.25)), dtype=np.bool_)
    snapshot = Snapshot(
        str(folder / f"{name}.csv"),
        job=name,
        simulated=True,
        origin_deg=origin,
        saved_utc=NOW.isoformat(),
        sums=TotalSums(area_ha=cells.size * 0.0625 / 1e4, kg=30.0),
        ground=Raster(west, south, 0.25, cells),
        place_m=(east, north),
        heading_deg=0.0,
        track=((west, south, 0.0, 300.0),),
    )
    snapshot = Snapshot(
        **{one: getattr(snapshot, one) for one in Snapshot.__dataclass_fields__} | known
    )
    resume.write_snapshot(folder / f"{name}.resume.json", snapshot)
    return snapshot


def job(origin=HOME, ring=SQUARE) -> Job:
    return Job(field=Ground(origin_lat_deg=origin[0], origin_lon_deg=origin[1], boundary_m=ring))


@pytest.mark.parametrize(
    ("field", "goes_on"),
    [
        (job(), True),
        # on a plane of its own
        (
            job(
                TangentPlane(*HOME).convert_to_deg(-30.0, -40.0),
                tuple((e + 30.0, n + 40.0) for e, n in SQUARE),
            ),
            True,
        ),
        # a boundary that was driven
        (job(ring=((-5.0, -5.0), (60.0, -5.0), (60.0, 30.0), (-5.0, 30.0))), True),
        # a part of it: the ground alone
        (job(ring=((40.0, 0.0), (90.0, 0.0), (90.0, 90.0), (40.0, 90.0))), False),
        (job(ring=((60.0, 0.0), (90.0, 0.0), (90.0, 90.0), (60.0, 90.0))), None),  # next to it
        (job((34.9, 119.9)), None),
        (Job(), True),  # no field is known: asked
    ],
)
def test_the_field_is_known_by_its_place(tmp_path, field, goes_on):
    kept(tmp_path)
    assert [one.is_same_job for one in find_jobs_here(tmp_path, field, True, NOW)] == (
        [] if goes_on is None else [goes_on]
    )
    assert find_jobs_here(tmp_path, field, False, NOW) == [], (
        "what was simulated lies on no real field"
    )


def test_what_was_cut_off_before_anything_landed_is_where_it_stood(tmp_path):
    kept(tmp_path, worked=True, ground=resume.EMPTY_RASTER, sums=TotalSums(), place_m=(5.0, 5.0))
    assert len(find_jobs_here(tmp_path, job(), True, NOW)) == 1
    assert not find_jobs_here(tmp_path, job((34.9, 119.9)), True, NOW)


def test_on_another_plane_the_same_places_are_done(tmp_path):
    before = kept(tmp_path, box=(200.0, 260.0, 300.0, 340.0))
    own, plane = TangentPlane(*HOME), TangentPlane(HOME[0] + 0.02, HOME[1] - 0.05)
    moved = move_snapshot(before, plane)
    for east, north, done in (
        (201.0, 301.0, True),
        (259.0, 339.0, True),
        (230.0, 320.0, True),
        (199.0, 320.0, False),
        (230.0, 341.0, False),
        (261.0, 320.0, False),
    ):
        place = plane.project_to_m(*own.convert_to_deg(east, north))
        column, row = (
            (at - edge) // 0.25
            for at, edge in zip(place, (moved.ground.west_m, moved.ground.south_m), strict=True)
        )
        rows, columns = moved.ground.done.shape
        assert (
            0 <= row < rows and 0 <= column < columns and moved.ground.done[int(row), int(column)]
        ) == done
    assert moved.ground.done.sum() == pytest.approx(before.ground.done.sum(), rel=0.005)
    assert moved.place_m == pytest.approx(
        plane.project_to_m(*own.convert_to_deg(260.0, 340.0)), abs=0.002
    )
    assert moved.track[0][:2] == pytest.approx(
        plane.project_to_m(*own.convert_to_deg(200.0, 300.0)), abs=0.06
    )
    assert move_snapshot(moved, plane) is moved


def start(folder, config, log="new"):
    """A worker put together."""
    parts = assemble_run(
        Options(config, folder / "w.json", log=str(folder / f"{log}.csv")), lambda: 0.0
    )
    parts.writer.close()
    return parts


def done_before(loop, place):
    return loop._ahead.overlap.is_done_earlier(place)


@pytest.fixture
def jobs(tmp_path):
    """A job of the demo's field with other words and rules in it, and the same on a field far
    away."""
    demo = load_config(find_shipped_files("jobs")["demo"], JOB_KIND).model
    far = demo.field.model_copy(update={"origin_lat_deg": 35.0})
    save_config(
        tmp_path / "mapped.yaml",
        demo.model_copy(
            update={
                "id": "mapped",
                "title": "Mapped",
                "strategy": "balanced",
                "crop": "osu_winter_wheat_2002",
            }
        ),
        JOB_KIND,
        "",
    )
    save_config(tmp_path / "far.yaml", demo.model_copy(update={"field": far}), JOB_KIND, "")
    return tmp_path


@pytest.mark.parametrize(
    ("config", "goes_on"), [((), True), (("mapped.yaml",), True), (("far.yaml",), False)]
)
def test_a_start_knows_what_is_done_on_its_field(jobs, config, goes_on):
    """Whatever file was taken: a new log had forgotten it, and the ground got its material
    twice."""
    width_m = 2.4
    start(jobs, (), "west")  # its sidecar says with which files
    kept(
        jobs,
        box=(-0.5 * width_m, 0.5 * width_m, 0.0, 20.0),
        strategy="speed_first",
        place_m=(0.0, 20.0),
    )
    loop = start(jobs, tuple(str(jobs / one) for one in config)).loop
    assert [done_before(loop, place) for place in ((0.0, 10.0), (1.1, 19.0), (0.0, 21.0))] == [
        goes_on,
        goes_on,
        False,
    ]
    assert loop.totals.applied_kg == (30.0 if goes_on else 0.0)
    assert loop.strategy == ("opening_first" if config else "speed_first")


def test_an_ended_job_is_another_pass(jobs):
    kept(jobs, finished=True)
    parts = start(jobs, ())
    assert not done_before(parts.loop, (10.0, 10.0)) and parts.keeper.tally.log_before == ""


def test_a_part_of_a_field_that_another_job_has_done_gets_no_more(jobs):
    """A quarter of what the other job has spread lies here: its ground counts, its totals do
    not."""
    kept(jobs, box=(-60.0, 20.0, 0.0, 20.0))
    parts = start(jobs, ())
    assert done_before(parts.loop, (10.0, 10.0)) and parts.loop.totals.applied_kg == 0.0
    assert parts.loop.totals.covered_ha == 0.0 and parts.keeper.tally.log_before == ""


def test_nitrogen_of_two_products_is_the_sum_of_both():
    first = Totaliser(2.4, 0.46)
    first.add_tick(10.0, 1.0, 100.0)
    then = Totaliser(2.4, 0.27, first.running_sums)
    then.add_tick(10.0, 1.0, 100.0)
    assert then.make_totals().applied_n_kg == pytest.approx((0.46 + 0.27) * first.applied_kg)
    assert Totaliser(
        2.4, 0.27, first.running_sums._replace(n_kg=None)
    ).applied_n_kg == pytest.approx(0.27 * first.applied_kg)
