"""The whole loop on a map: steps land at the cells' edges; what a job names is found and laid
on its plane."""

from __future__ import annotations

import csv
import dataclasses
import datetime as dt
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.console.worker.assemble import assemble_run
from topdress.console.worker.options import Options
from topdress.control.field.job import Ground, Job, Simulated, SpeedChange, Wanted
from topdress.control.geodesy import TangentPlane
from topdress.control.loop import ControlLoop
from topdress.control.loop.map_location_check import NEAR_MAP_DISTANCE_M
from topdress.control.loop.tick import Tick
from topdress.control.orders import Do, Order, TargetSource
from topdress.control.safety import read_refusal
from topdress.control.simulation.assembly import add_simulated_field, make_control_loop
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.error_metrics import find_landing, find_place_errors
from topdress.control.simulation.plant import Plant
from topdress.control.simulation.tractor import PathLeg
from topdress.control.simulation.tractor import TractorPath as Way
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.prescription import (
    NO_FALLBACKS,
    Fallbacks,
    MapData,
    Prescription,
    Zone,
    project_prescription,
)
from topdress.control.targets.rate_map import GridMap, ZoneMap, make_frame_deg, make_frame_m
from topdress.drivers.files.config import find_shipped_files
from topdress.drivers.files.prescriptions.job_targets import read_job_map, read_job_plants
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_setup import Setup, load_setup
from topdress.drivers.plain_text import RefusedInput

from tests.command import topdress
from tests.control_loop.closed import Change, Closed
from tests.geojson import feature, geojson

RING = [[119.88, 34.28], [119.881, 34.28], [119.881, 34.281], [119.88, 34.281], [119.88, 34.28]]
HEADING_DEG = 24.0


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup("huanghai", "demo", dt.date(2014, 3, 7))


@pytest.fixture(scope="module")
def grid() -> Prescription:
    chequered = np.indices((12, 12)).sum(axis=0) % 2
    return Prescription(
        GridMap(make_frame_m((-20.0, -20.0), 10.0, 10.0), np.where(chequered, 420.0, 240.0)),
        Fallbacks(),
    )


def driven(setup: Setup, grid: Prescription, look_ahead: bool) -> tuple[list[float], ControlLoop]:
    """Place errors of one oblique pass of 50 m at 6 km/h, by the begin of each step's row."""
    job = Job(
        target=Wanted(source=TargetSource.MAP, map="made here"),
        look_ahead=look_ahead,
        simulated=Simulated(speed_kmh=6.0, passes=1, refill_at_kg=0.0),
    )
    profile = MapProfile(grid, TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg))
    plant = Plant(
        setup.machine, job, 1, 0.05, path=Way([PathLeg(3.3, 1.7, HEADING_DEG, 100.0, 0.0)])
    )
    loop, record = (
        make_control_loop(setup.machine, setup.crop, setup.rule, job, prescription=profile),
        RunRecord(),
    )
    for step in simulate_run(plant, loop, 40.0):
        record.add_tick(step)
    columns = record.make_columns()
    columns["time_s"] = columns["time_s"] - 0.05
    columns["driven_m"] = np.concatenate(([0.0], columns["driven_m"][:-1]))
    true = [s.distance_m for s in grid.find_targets_ahead((3.3, 1.7), HEADING_DEG, 55.0)][1:]
    fired = []
    for change in record.fired:
        at = float(np.interp(change.place_m, columns["track_m"], columns["driven_m"]))
        nearest = min(true, key=lambda d: abs(d - at))
        if abs(nearest - at) < 0.5 and at > 12.0:
            fired.append(
                change._replace(
                    place_m=float(np.interp(nearest, columns["driven_m"], columns["track_m"]))
                )
            )
    misses, _ = find_place_errors(columns, fired, find_landing(columns, 2.4), 2.4)
    return misses.tolist(), loop


@pytest.mark.exam
def test_steps_land_at_the_edges_of_the_cells(setup: Setup, grid: Prescription) -> None:
    misses, _ = driven(setup, grid, look_ahead=True)
    assert len(misses) >= 3
    assert max(map(abs, misses)) < 0.35


def test_a_start_before_the_first_course_is_no_lost_position(
    setup: Setup, grid: Prescription
) -> None:
    """RTK stands fixed, the tractor too: no alarm, nothing flows; on the way the map is applied."""
    stands = (SpeedChange(at_s=0.0, speed_kmh=0.0), SpeedChange(at_s=4.0, speed_kmh=6.0))
    job = Job(
        target=Wanted(source=TargetSource.MAP, map="made here"),
        simulated=Simulated(passes=1, speed_changes=stands),
    )
    profile = MapProfile(grid, TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg))
    plant = Plant(
        setup.machine, job, 1, 0.05, path=Way([PathLeg(3.3, 1.7, HEADING_DEG, 100.0, 0.0)])
    )
    loop = make_control_loop(setup.machine, setup.crop, setup.rule, job, prescription=profile)
    ticks = [
        step.tick
        for step in simulate_run(
            plant, loop, 20.0, [(1.0, Order(Do.READY)), (2.0, Order(Do.START))]
        )
    ]
    assert "position_lost" not in {alarm.id for tick in ticks for alarm in tick.alarms}
    standing = [tick for tick in ticks if tick.row.state == "working" and tick.row.time_s < 4.0]
    assert standing and all(
        tick.row.shaft_rpm_cmd == 0.0 and "course_unknown" in tick.why_no_flow for tick in standing
    )
    assert max(tick.row.shaft_rpm_cmd or 0.0 for tick in ticks) > 10.0


@pytest.mark.exam
def test_without_the_look_ahead_they_land_a_lag_distance_late(
    setup: Setup, grid: Prescription
) -> None:
    misses, _ = driven(setup, grid, look_ahead=False)
    assert len(misses) >= 3
    assert np.median(misses) == pytest.approx(1.667 * 2.0, abs=0.6)


def test_the_map_can_be_ordered_only_where_there_is_one(setup: Setup, grid: Prescription) -> None:
    without = make_control_loop(setup.machine, setup.crop, setup.rule, setup.job)
    assert without.handle_order(Order(Do.SOURCE, "map")).why == "source_not_ready"
    profile = MapProfile(grid, TangentPlane(34.28, 119.88))
    with_map = make_control_loop(
        setup.machine, setup.crop, setup.rule, setup.job, prescription=profile
    )
    assert with_map.handle_order(Order(Do.SOURCE, "map")).accepted


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    geojson(tmp_path / "map.geojson", feature([RING], rate=200.0))
    return tmp_path


def test_a_jobs_map_lies_on_the_fields_plane(map_file: Path) -> None:
    ground = Ground(
        origin_lat_deg=34.28, origin_lon_deg=119.88, boundary_m=((0, 0), (50, 0), (50, 50))
    )
    profile = read_job_map(
        Job(target=Wanted(source=TargetSource.MAP, map="map.geojson"), field=ground), map_file
    )
    assert profile is not None
    assert (profile.plane.lat_deg, profile.plane.lon_deg) == (34.28, 119.88)
    assert profile.prescription.find_target((10.0, 10.0)).rate_kg_ha == 200.0
    assert profile.prescription.find_target((-10.0, 10.0)).rate_kg_ha == 0.0
    assert read_job_map(Job(), map_file) is None


def test_a_jobs_map_that_is_not_there_is_said(map_file: Path) -> None:
    with pytest.raises(RefusedInput, match=r"no.shp: not there"):
        read_job_map(Job(target=Wanted(map="no.shp")), map_file)


def test_plants_from_csv_and_geojson(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("id,lat_deg,lon_deg\n1,34.28,119.88\n2,34.28001,119.88\n")
    points = [{"geometry": {"type": "Point", "coordinates": [119.88, 34.28]}}]
    (tmp_path / "p.geojson").write_text(json.dumps({"features": points}))
    found = read_job_plants(Job(target=Wanted(plants="p.csv")), tmp_path)
    assert found is not None and len(found.places_m) == 2
    assert found.places_m[1, 1] - found.places_m[0, 1] == pytest.approx(1.109, abs=0.002)
    again = read_job_plants(Job(target=Wanted(plants="p.geojson")), tmp_path)
    assert again is not None and len(again.places_m) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lat,lon\n1,2\n", "column lat_deg missing"),
        ("lat_deg,lon_deg\n", "no plants"),
        ("lat_deg,lon_deg\n1,x\n", "line 2: 1, x: allowed are numbers"),
        ("lat_deg,lon_deg\n95,10\n", "plant 1: 95, 10: allowed are degrees"),
    ],
)
def test_broken_plant_lists_are_said_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(RefusedInput, match=words):
        read_job_plants(Job(target=Wanted(plants="p.csv")), tmp_path)


# --- A job with a map through the commands: simulated, replayed, refused in one line where the
# map is not there ------


def invoke(*words: Any) -> str:
    result = topdress(*words)
    assert result.exit_code == 0, result.output
    return result.output


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """The shipped map job and its map in a folder of their own."""
    folder = tmp_path / "job"
    folder.mkdir()
    source = find_shipped_files("jobs")["map_demo"]
    for path in (source, source.with_suffix(".geojson")):
        shutil.copy(path, folder)
    return folder / "map_demo.yaml"


def test_the_shipped_job_is_right() -> None:
    assert "ok (topdress-job/1)" in invoke("check", "map_demo")


@pytest.mark.exam
def test_a_run_follows_the_map_and_its_replay_finds_the_map_again(
    job: Path, tmp_path: Path
) -> None:
    log, again = tmp_path / "logs" / "a.csv", tmp_path / "again.csv"
    invoke("simulate", "--job", job, "--seconds", 70, "--out", log)
    rows = rows_of(log)
    by_map = [row for row in rows if row["target_source"] == "map"]
    assert len(by_map) > 800
    assert {"360", "270"} <= {str(round(float(row["target_rate_kg_ha"]))) for row in by_map}
    assert str(job.with_suffix(".geojson")) in read_log(log).meta.sha256  # type: ignore[union-attr]
    invoke("replay", log, "--headless", "--out", again)
    sources = [row["target_source"] for row in rows_of(again)]
    assert sum(
        a == row["target_source"] for a, row in zip(sources, rows, strict=True)
    ) > 0.99 * len(rows)
    shutil.move(job.with_suffix(".geojson"), log.parent)
    invoke("replay", log, "--headless", "--out", tmp_path / "beside.csv")
    (log.parent / "map_demo.geojson").unlink()
    result = topdress("replay", log, "--headless", "--out", tmp_path / "none.csv")
    assert result.exit_code == 2
    assert (
        "map_demo.geojson: not there" in result.output
        and len(result.output.strip().splitlines()) == 1
    )


def test_a_map_that_is_missing_is_one_line(job: Path, tmp_path: Path) -> None:
    job.with_suffix(".geojson").unlink()
    result = topdress("simulate", "--job", job, "--seconds", "5")
    assert result.exit_code == 2
    assert (
        "map_demo.geojson: not there" in result.output
        and len(result.output.strip().splitlines()) == 1
    )
    with pytest.raises(ValueError, match=r"map_demo\.geojson: not there"):
        assemble_run(
            Options((str(job),), tmp_path / "w.json", log=str(tmp_path / "run.csv")), lambda: 0.0
        )


def test_map_mode_without_a_map_is_said_by_check(job: Path) -> None:
    job.write_text(job.read_text().replace("  map: map_demo.geojson\n", ""))
    result = topdress("check", job)
    assert result.exit_code == 2
    assert "source map needs the key map" in result.output


def test_the_worker_takes_the_source_map_live_only_with_a_map(job: Path, tmp_path: Path) -> None:
    job.write_text(job.read_text().replace("  source: map ", "  source: canopy "))
    for name, accepted in ((str(job), True), ("demo", False)):
        config = (name,) if accepted else ()
        parts = assemble_run(
            Options(config, tmp_path / "w.json", log=str(tmp_path / f"{accepted}.csv")), lambda: 0.0
        )
        answer = parts.loop.handle_order(Order(Do.SOURCE, "map"))
        assert answer.accepted == accepted
        assert answer.why == ("" if accepted else "source_not_ready")
        parts.bench.close_devices()
        parts.writer.close()


# --- A map that lies elsewhere gives its outside rate everywhere: START is refused unless the
# operator wants that.

OUTSIDE = Fallbacks(default_kg_ha=180.0, outside_kg_ha=157.0)
PLANE = TangentPlane(34.28, 119.88)


def square(south_m: float, west_m: float, size_m: float = 400.0) -> MapData:
    corners = [
        (west_m, south_m),
        (west_m + size_m, south_m),
        (west_m + size_m, south_m + size_m),
        (west_m, south_m + size_m),
    ]
    return MapData(
        zones=(Zone(250.0, (np.array([PLANE.convert_to_deg(*corner) for corner in corners]),)),),
        fallbacks=OUTSIDE,
    )


class Work(Closed):
    """The simulated machine, which starts at the field's south-western corner and works
    northwards; `seen`: by GNSS."""

    def __init__(self, data: MapData, with_field: bool = False, seen: bool = True) -> None:
        setup = load_setup("huanghai", "map_demo", dt.date(2026, 4, 1))
        job = add_simulated_field(setup.job, setup.machine)
        field = job.field.model_copy(update={} if with_field else {"boundary_m": ()})
        super().__init__(
            setup,
            known={"job": job.model_copy(update={"field": field})},
            loop={"prescription": MapProfile(project_prescription(data, PLANE), PLANE)},
        )
        self.seen = seen
        self.run(1.0)
        assert self.order(Do.READY).accepted
        self.run(1.0)

    def run(self, seconds: float, change: Change | None = None) -> Tick:
        begun_kg = self.loop.totals.applied_kg
        tick = super().run(seconds, lambda m: m if self.seen else m._replace(gnss=None))
        self.kg = self.loop.totals.applied_kg - begun_kg
        return tick


@pytest.mark.parametrize("with_field", [False, True])
@pytest.mark.parametrize("away", [(50_000.0, 0.0), (0.0, 900.0)])
def test_start_is_refused_and_says_how_far_and_what_it_would_give(away, with_field):
    work = Work(square(*away), with_field)
    answer = work.order(Do.START)
    name, details = read_refusal(answer.why)
    assert not answer.accepted and name == "map_elsewhere"
    assert details["outside_kg_ha"] == "157" and float(details["away_m"]) == pytest.approx(
        max(away), abs=60.0
    )
    assert work.run(10.0).row.state == "ready" and work.kg == 0.0


def test_it_is_taken_where_the_outside_rate_is_wanted_until_stop():
    work = Work(square(50_000.0, 0.0))
    assert not work.order(Do.ALLOW_MAP_ELSEWHERE, "yes").accepted
    assert work.order(Do.ALLOW_MAP_ELSEWHERE, True).accepted
    assert work.order(Do.START).accepted
    tick = work.run(15.0)
    assert tick.allow.map_elsewhere and work.kg > 0.1 and tick.row.target_rate_kg_ha == 157.0
    assert work.order(Do.STOP).accepted and work.order(Do.READY).accepted
    assert not work.order(Do.START).accepted


def test_a_place_that_comes_after_start_stops_the_flow():
    work = Work(square(50_000.0, 0.0), seen=False)
    assert work.order(Do.START).accepted  # nobody knows where the machine is
    work.seen = True
    tick = work.run(10.0)
    assert work.kg == 0.0 and "map_elsewhere" in tick.why_no_flow


def test_changing_to_the_map_while_working_does_not_help():
    work = Work(square(50_000.0, 0.0))
    for do, value in ((Do.SOURCE, TargetSource.MANUAL.value), (Do.START, None)):
        assert work.order(do, value).accepted
    work.run(12.0)
    assert work.kg > 0.1
    assert work.order(Do.SOURCE, TargetSource.MAP.value).accepted
    tick = work.run(5.0)
    assert "map_elsewhere" in tick.why_no_flow and tick.command.shaft_rpm == 0.0


@pytest.mark.parametrize(("south_m", "west_m"), [(0.0, -10.0), (25.0, 0.0), (-420.0, 0.0)])
def test_a_machine_that_stands_beside_its_map_starts(south_m, west_m):
    """On it, on the headland before it, just beyond it."""
    assert Work(square(south_m, west_m)).order(Do.START).accepted


def test_ground_without_a_rate_in_the_map_gets_nothing_and_is_no_fallback():
    """The map begins 40 m north of the start."""
    data = dataclasses.replace(square(40.0, -200.0), fallbacks=NO_FALLBACKS)
    work = Work(data, with_field=True)
    assert work.order(Do.START).accepted
    tick = work.run(8.0)
    assert work.kg < 0.01 and tick.row.target_source == "fallback"
    assert "zero_unmapped" in tick.notes and "zero_fallback" not in tick.notes
    assert work.run(40.0).row.target_rate_kg_ha == 250.0


def test_in_a_field_that_the_map_covers_in_part_every_place_is_near():
    work = Work(square(100.0, 0.0, 30.0), with_field=True)
    assert work.order(Do.START).accepted
    assert work.order(Do.HOLD).accepted
    away = Work(square(100.0, 0.0, 30.0))
    assert not away.order(Do.START).accepted  # without a field the map alone says where


@pytest.mark.parametrize(
    "place", [(50.0, 20.0), (250.0, 20.0), (-130.0, -70.0), (20_000.0, 9_000.0)]
)
def test_distances_to_cells_and_to_zones_are_the_same(place):
    """150 m by 90 m of cells of which every other has a rate, and the same cells as zones."""
    south, west = PLANE.convert_to_deg(0.0, 0.0)
    cell_lat, cell_lon = 30.0 / 110_922.0, 30.0 / 92_070.0
    rates = np.where((np.arange(15) % 2 == 0).reshape(3, 5), 100.0, np.nan)
    grid = GridMap(make_frame_deg(PLANE, south, west, cell_lat, cell_lon, 3, 5), rates)
    rings = [
        [
            np.array(
                [
                    PLANE.project_to_m(south + (r + i) * cell_lat, west + (c + j) * cell_lon)
                    for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
                ]
            )
        ]
        for r in range(3)
        for c in range(5)
        if (5 * r + c) % 2 == 0
    ]
    zones = ZoneMap(rings, np.full(len(rings), 100.0))
    assert grid.calc_distance_m(place) == pytest.approx(
        zones.calc_distance_m(place), rel=2e-3, abs=0.05
    )
    assert grid.calc_distance_m((15.0, 15.0)) == zones.calc_distance_m((15.0, 15.0)) == 0.0


def test_a_map_without_any_rate_is_nowhere():
    empty = GridMap(make_frame_deg(PLANE, 34.28, 119.88, 1e-4, 1e-4, 2, 2), np.full((2, 2), np.nan))
    assert empty.calc_distance_m((0.0, 0.0)) == np.inf > NEAR_MAP_DISTANCE_M
    assert Prescription(empty, OUTSIDE).outside_kg_ha == 157.0


def test_a_field_of_the_map_itself_counts_as_the_map():
    data = square(300.0, 0.0)
    corners = ((-50.0, -50.0), (400.0, -50.0), (400.0, 800.0), (-50.0, 800.0))
    ring = np.array([PLANE.convert_to_deg(*corner) for corner in corners])
    assert (
        project_prescription(
            dataclasses.replace(data, fields_deg=((ring,),)), PLANE
        ).calc_distance_m((0.0, 0.0))
        == 0.0
    )
    assert project_prescription(data, PLANE).calc_distance_m((0.0, 0.0)) == pytest.approx(
        300.0, abs=0.5
    )
