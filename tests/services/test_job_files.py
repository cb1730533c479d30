"""The Job screen's desk on real files: facts, new job files, what is offered after a power cut."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import os
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from topdress.console.app.pages.job.map_words import describe_map_check, is_doubtful
from topdress.console.app.pages.job.service import MapReading
from topdress.console.app.units import METRIC
from topdress.console.running import WorkerFailed
from topdress.console.services.job import JobFiles, find_implausible_rates
from topdress.console.services.launcher import Launcher, list_other_files
from topdress.console.services.removable_media import find_maps, is_map_likely, list_entries
from topdress.console.services.running_limits import read_earlier_run, read_running_limits
from topdress.console.worker import resume
from topdress.console.worker.resume import Snapshot
from topdress.control.agronomy.reference_strips import StripMean
from topdress.control.field.boundary import Boundary
from topdress.control.field.coverage import Raster
from topdress.control.field.job import Job
from topdress.control.field.job_names import JobNames
from topdress.control.field.job_totals import TotalSums
from topdress.control.geodesy import TangentPlane
from topdress.control.targets.map_check import check_map
from topdress.control.targets.prescription import MapData, Zone
from topdress.drivers.files.config import find_shipped_files, load_config, save_config
from topdress.drivers.files.config_kinds import JOB_KIND
from topdress.drivers.files.run_log import PlainLogWriter
from topdress.drivers.files.run_meta import make_run_meta


class NoWorker(Launcher):
    """Notes what a worker would be started with."""

    def __init__(self, logs):
        super().__init__((), (), 1, 20.0, str(logs / "run.csv"), logs.parent / "trouble")
        self.starts, self.fails = [], False

    async def start_link(self, resumed=None):
        if self.fails:
            raise WorkerFailed("no port")
        self.starts.append((self.config, self.seed, resumed))


@pytest.fixture
def launcher(tmp_path):
    return NoWorker(tmp_path / "logs")


@pytest.fixture
def desk(launcher, tmp_path):
    return JobFiles(launcher, tmp_path)


def test_a_start_that_fails_leaves_the_files_of_before(desk, launcher):
    desk.choose_file("job", str(find_shipped_files("jobs")["map_demo"]))
    launcher.fails = True
    with pytest.raises(WorkerFailed):
        asyncio.run(desk.restart_worker())
    assert launcher.config == () and desk.find_facts().setup.job.target.source == "canopy"


def test_facts_of_what_is_shipped(desk):
    facts = desk.find_facts()
    assert (
        facts.setup.crop.name.startswith("Winter wheat")
        and facts.setup.crop.warnings
        and facts.shipped_machine
    )
    assert (
        facts.setup.rule.ndvi_nrich is None
        and facts.setup.crop.fixed_yield_t_ha == pytest.approx(6.73)
    )
    assert (
        facts.field_ha == pytest.approx(8.64, abs=0.01)
        and facts.setup.job.target.source == "canopy"
    )
    assert (
        Path(facts.job_file) == find_shipped_files("jobs")["demo"]
        and facts.job_file == facts.jobs[0].value
    )
    assert {file.label for file in facts.crops} >= {"huanghai_wheat", "osu_durum_2006"}


def test_the_strip_goes_into_a_new_job_file_that_is_used_next(desk, launcher, tmp_path):
    before = find_shipped_files("jobs")["demo"].read_bytes()
    path = Path(desk.save_strip_value(StripMean("nrich", 0.71, 0.004, 38)))
    assert "standard error 0.0040, 38 samples" in path.read_text(encoding="utf-8")
    assert path.parent == tmp_path / "jobs" and launcher.config == (str(path),)
    assert (
        load_config(path, JOB_KIND).model.ndvi_nrich == 0.71
        and find_shipped_files("jobs")["demo"].read_bytes() == before
    )
    facts = desk.find_facts()
    assert (
        facts.setup.rule.ndvi_nrich == facts.setup.job.ndvi_nrich == 0.71
        and facts.job_file == str(path)
    )
    both = load_config(Path(desk.save_strip_value(StripMean("check", 0.55))), JOB_KIND).model
    assert (both.ndvi_nrich, both.ndvi_check) == (
        0.71,
        0.55,
    ) and desk.find_facts().setup.rule.ndvi_check == 0.55


def test_a_map_beside_the_job_is_found_from_the_new_file_too(desk, launcher):
    desk.choose_file("job", str(find_shipped_files("jobs")["map_demo"]))
    asyncio.run(desk.restart_worker())
    new = load_config(Path(desk.save_strip_value(StripMean("nrich", 0.7))), JOB_KIND).model
    assert Path(new.target.map).is_absolute() and Path(new.target.map).exists()


def test_another_crop_and_machine(desk, launcher):
    before = desk.find_facts().crop_file
    desk.choose_file("crop", str(find_shipped_files("crops")["osu_winter_wheat_2006"]))
    assert desk.find_facts().crop_file == before, "what runs is what is said"
    asyncio.run(desk.restart_worker())
    desk.choose_file("machine", str(find_shipped_files("machines")["bench"]))
    asyncio.run(desk.restart_worker())
    facts = desk.find_facts()
    assert facts.crop_file == str(find_shipped_files("crops")["osu_winter_wheat_2006"])
    assert (
        facts.machine_file == str(find_shipped_files("machines")["bench"])
        and len(launcher.config) == 2
    )


def test_what_cannot_be_used_is_one_line_and_changes_nothing(desk, launcher, tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("format: topdress-machine/1\nid: 7\n")
    for kind, value in (
        ("machine", str(bad)),
        ("job", str(bad)),
        ("crop", str(tmp_path / "none.yaml")),
    ):
        with pytest.raises(ValueError, match=r"\.yaml: ") as caught:
            desk.choose_file(kind, value)
        assert "\n" not in str(caught.value)
    assert launcher.config == ()


def test_a_job_that_was_cut_off_is_offered_for_two_weeks(desk, launcher, tmp_path):
    launcher.log_folder.mkdir(exist_ok=True)
    path = resume.make_snapshot_path(launcher.log_folder / "a.csv")
    now = dt.datetime.now(dt.UTC)

    def keep(days: float) -> None:
        saved = (now - dt.timedelta(days=days)).isoformat()
        resume.write_snapshot(
            path,
            Snapshot(
                "a.csv", began_utc=saved, saved_utc=saved, job="west", sums=TotalSums(area_ha=1.2)
            ),
        )

    assert desk.find_offer() is None
    keep(1.0)
    offer = desk.find_offer()
    assert (offer.path, offer.job, offer.area_ha) == (str(path), "west", 1.2)
    keep(20.0)
    assert desk.find_offer() is None


def test_a_shipped_file_by_its_name_is_the_same_file(tmp_path):
    other = str(tmp_path / "other.yaml")
    assert list_other_files((str(find_shipped_files("jobs")["demo"]),), ("demo", other)) == (other,)
    assert list_other_files(("demo",), (str(find_shipped_files("jobs")["demo"]),)) == ()


async def test_begin_anew_is_not_asked_again(desk, launcher):
    launcher.log_folder.mkdir(exist_ok=True)
    saved = dt.datetime.now(dt.UTC).isoformat()
    resume.write_snapshot(
        resume.make_snapshot_path(launcher.log_folder / "a.csv"),
        Snapshot(
            "a.csv",
            began_utc=saved,
            saved_utc=saved,
            sums=TotalSums(area_ha=1.2),
            config=("demo",),
            seed=7,
        ),
    )
    offer = desk.find_offer()
    await desk.resume_job(offer)
    assert launcher.starts == [(("demo",), 7, Path(offer.path))]
    await desk.start_anew(offer)
    assert launcher.starts[-1][2] is None and desk.find_offer() is None


@pytest.mark.parametrize(
    ("box", "far", "anew", "named"),
    [
        ((0.0, 60.0), False, False, True),
        ((0.0, 60.0), False, True, False),
        ((0.0, 60.0), True, False, False),
        ((-60.0, 20.0), False, False, False),
    ],
)
async def test_a_start_with_another_file_goes_on_with_what_was_left_on_its_field(
    desk, launcher, tmp_path, box, far, anew, named
):
    """Anew: that job is ended, and asked about no more. What lies elsewhere is no concern of it."""
    demo = load_config(find_shipped_files("jobs")["demo"], JOB_KIND).model
    field = demo.field.model_copy(
        update={"origin_lat_deg": 36.0 if far else demo.field.origin_lat_deg}
    )
    save_config(
        tmp_path / "other.yaml",
        demo.model_copy(update={"field": field, "strategy": "balanced"}),
        JOB_KIND,
        "",
    )
    launcher.log_folder.mkdir(exist_ok=True)
    path = resume.make_snapshot_path(launcher.log_folder / "a.csv")
    west, east = box
    resume.write_snapshot(
        path,
        Snapshot(
            "a.csv",
            saved_utc=dt.datetime.now(dt.UTC).isoformat(),
            simulated=True,
            job="Mine",
            sums=TotalSums(area_ha=0.12),
            origin_deg=(34.28, 119.88),
            ground=Raster(
                west, 0.0, 0.25, np.ones((80, round((east - west) / 0.25)), dtype=np.bool_)
            ),
        ),
    )
    desk.choose_file("job", str(tmp_path / "other.yaml"))
    assert (desk.find_offer() is None) is far
    await desk.restart_worker(anew)
    assert [(config, resumed) for config, _, resumed in launcher.starts] == [
        ((str(tmp_path / "other.yaml"),), path if named else None)
    ]
    assert resume.read_snapshot(path).finished is anew and (desk.find_offer() is None) is (
        far or anew
    )


def test_the_files_of_a_worker_that_runs_are_its_logs(launcher, tmp_path):
    job = find_shipped_files("jobs")["map_demo"]
    log = tmp_path / "run.csv"
    PlainLogWriter(
        log,
        make_run_meta(
            sha256={str(job): "x", str(find_shipped_files("crops")["huanghai_wheat"]): "y"}
        ),
    ).close()
    launcher.config = ("mine.yaml", str(job))
    assert launcher.adopt_running_files(str(log)) == ("mine.yaml",), "what is not used is said"
    assert launcher.config == (str(job),)
    launcher.config = ("map_demo", "points_demo")
    assert launcher.adopt_running_files(str(log)) == ("points_demo",), (
        "a name is the file that is shipped by it"
    )
    assert launcher.adopt_running_files(str(tmp_path / "none.csv")) is None, (
        "not known is not all used"
    )
    assert launcher.config == (str(job),)


def test_the_limits_of_a_run_are_its_own(tmp_path):
    log = tmp_path / "run.csv"
    PlainLogWriter(
        log, make_run_meta({"flow": {"full_kg": 280.0}}, {"max_rate_kg_ha": 450.0})
    ).close()
    found = read_running_limits(str(log))
    assert found is not None and found[:2] == (450.0, 280.0) and found.machine is not None
    assert (
        found.machine.flow.full_kg == 280.0
        and read_running_limits(str(tmp_path / "none.csv")) is None
    )


def test_an_export_of_nothing_is_one_line(desk, tmp_path):
    log = tmp_path / "run.csv"
    PlainLogWriter(log, make_run_meta()).close()
    with pytest.raises((ValueError, OSError)) as caught:
        desk.export_as_applied(str(log), ".geojson", lambda done, of, what: None, lambda: False)
    assert "\n" not in str(caught.value) and "run.csv" in str(caught.value)
    assert (
        desk.export_as_applied(str(log), ".csv", lambda done, of, what: None, lambda: True) == ()
    ), "cancelled before it began"
    assert desk.find_free_bytes(os.fspath(log)) > 0 and read_earlier_run(str(log)) is None


def field_of_zones(path: Path, names: tuple[str, ...] = ("rate",)) -> Path:
    """Two zones of about a hectare each on the shipped demo's field."""
    import json

    corner = (119.8805, 34.2805)
    features = []
    for number, rate in enumerate((200.0, 320.0)):
        west, east = corner[0] + 0.001 * number, corner[0] + 0.001 * (number + 1)
        ring = [
            [west, corner[1]],
            [east, corner[1]],
            [east, corner[1] + 0.001],
            [west, corner[1] + 0.001],
            [west, corner[1]],
        ]
        features.append(
            {
                "type": "Feature",
                "properties": {name: rate + k for k, name in enumerate(names)},
                "geometry": {"type": "Polygon", "coordinates": [ring]},
            }
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8"
    )
    return path


def test_a_prescription_is_looked_at_and_then_taken_in_kilograms_of_ours(desk, launcher, tmp_path):
    stick = field_of_zones(tmp_path / "stick" / "north.geojson", ("RATE",))
    seen = desk.preview_map(str(stick), MapReading("", "lb/ac"))
    assert seen.question == "" and seen.reading.column == "RATE" and "lb/ac" in seen.unit
    assert seen.rates_kg_ha == (pytest.approx(224.2, abs=0.1), pytest.approx(358.7, abs=0.1))
    assert seen.picture is not None and seen.picture.planned is not None and seen.check is not None
    assert launcher.config == () and not (tmp_path / "maps").exists(), "looking changes nothing"
    job = load_config(Path(desk.choose_map(seen)), JOB_KIND).model
    assert job.target.source == "map" and Path(job.target.map).parent == tmp_path / "maps"
    stick.unlink()  # the stick is pulled
    assert desk.find_facts().setup.job.target.source == "canopy", (
        "until the worker starts again with it"
    )
    desk.drop_choices()
    asyncio.run(desk.restart_worker())
    assert desk.find_facts().setup.job.target.source == "canopy", "not taken"
    desk.choose_file("job", str(next((tmp_path / "jobs").iterdir())))
    asyncio.run(desk.restart_worker())
    facts = desk.find_facts()
    assert (
        facts.setup.job.target.source == "map"
        and facts.map_trouble == ""
        and facts.map_check is not None
    )


def test_a_map_takes_the_place_of_a_held_mean_and_stays_under_the_heads(desk, tmp_path):
    """A map has its own mean; a job that lets the heads move around a map goes on doing so with
    another one."""
    for target, source in (
        ({"hold_mean_kg_ha": 250.0}, "map"),
        ({"source": "map_and_canopy", "map": "old.geojson"}, "map_and_canopy"),
    ):
        data = load_config("demo", JOB_KIND).model.model_dump(mode="json")
        job = Job.model_validate(data | {"target": data["target"] | target})
        save_config(tmp_path / "job.yaml", job, JOB_KIND)
        shutil.copy(
            find_shipped_files("jobs")["map_demo"].with_suffix(".geojson"), tmp_path / "old.geojson"
        )
        desk.choose_file("job", str(tmp_path / "job.yaml"))
        asyncio.run(desk.restart_worker())
        new = load_config(
            Path(desk.choose_map(desk.preview_map(str(tmp_path / "old.geojson"), MapReading()))),
            JOB_KIND,
        ).model
        assert (new.target.source, new.target.hold_mean_kg_ha) == (source, None)


def test_a_map_with_two_columns_asks_and_names_them(desk, tmp_path):
    stick = field_of_zones(tmp_path / "stick" / "zones.geojson", ("alpha", "beta"))
    seen = desk.preview_map(str(stick), MapReading())
    assert seen.columns == ("alpha", "beta") and "not chosen" in seen.question and seen.kept == ""
    assert desk.preview_map(str(stick), MapReading("beta")).rates_kg_ha == (201.0, 321.0)
    stick.write_text("{", encoding="utf-8")
    with pytest.raises(ValueError, match="zones"):
        desk.preview_map(str(stick), MapReading())


def test_maps_are_found_on_a_stick_and_not_searched_for_without_end(tmp_path):
    stick = tmp_path / "STICK"
    field_of_zones(stick / "farm" / "north.geojson")
    (stick / "TASKDATA").mkdir()
    (stick / "TASKDATA" / "TASKDATA.XML").write_text("<x/>", encoding="utf-8")
    (stick / "TASKDATA" / "more.zip").write_bytes(b"")
    (stick / "a" / "b" / "c" / "d").mkdir(parents=True)
    field_of_zones(stick / "a" / "b" / "c" / "d" / "deep.geojson")
    (stick / "letter.txt").write_text("no map", encoding="utf-8")
    found = find_maps(((stick, "STICK"), (tmp_path / "gone", "gone")))
    assert {one.name for one in found} == {"north.geojson", "TASKDATA"} and {
        one.where for one in found
    } == {"STICK"}


def test_names_go_into_a_new_job_and_come_back(desk, launcher):
    desk.save_job_names(JobNames("Li Ming", "East farm", "division 2", "urea 46-0-0", "Ann"))
    asyncio.run(desk.restart_worker())
    assert desk.find_facts().names == JobNames(
        "Li Ming", "East farm", "division 2", "urea 46-0-0", "Ann"
    )
    with pytest.raises(ValueError, match="client"):
        desk.save_job_names(JobNames("x" * 200))


def test_a_job_s_card(desk, launcher, tmp_path):
    desk.save_strip_value(StripMean("nrich", 0.71))
    launcher.log_folder.mkdir(exist_ok=True)
    resume.write_snapshot(
        resume.make_snapshot_path(launcher.log_folder / "a.csv"),
        Snapshot(
            "a.csv",
            saved_utc="2026-03-18T07:02:00+00:00",
            config=launcher.config,
            sums=TotalSums(area_ha=1.2),
        ),
    )
    (tmp_path / "jobs" / "broken.yaml").write_text(
        "format: topdress-job/1\nid: 7\n", encoding="utf-8"
    )
    listed = desk.list_job_cards()
    cards = {file.label: card for file, card in listed}
    assert listed[0][0].value == launcher.config[0] and cards["broken"] is None
    mine, by_map = listed[0][1], cards["map_demo"]
    assert (mine.field, mine.crop, mine.map) == ("Huanghai, division 2", "huanghai_wheat", "")
    assert (mine.done_ha, mine.worked_utc[:10]) == (1.2, "2026-03-18")
    assert (
        by_map.map == "map_demo.geojson"
        and by_map.picture.planned is not None
        and by_map.worked_utc == ""
    )


def test_a_job_that_is_changed_stays_the_same_job_with_a_history(desk, launcher, tmp_path):
    jobs = tmp_path / "jobs"

    def versions():
        return [
            load_config(path, JOB_KIND).model.ndvi_nrich
            for path in sorted((jobs / "history").glob("*.yaml"))
        ]

    desk.save_strip_value(StripMean("nrich", 0.71))
    desk.save_strip_value(StripMean("nrich", 0.72))
    desk.save_job_names(JobNames(client="Li Ming"))
    assert (
        load_config(jobs / "demo.yaml", JOB_KIND).model.client
        == ""
        == desk.find_facts().setup.job.client
    ), "nothing has it yet"
    desk.drop_choices()
    assert versions() == [0.71], "what was not taken is not kept"
    desk.save_job_names(JobNames(client="Li Ming"))
    asyncio.run(desk.restart_worker())
    desk.choose_file("crop", str(find_shipped_files("crops")["osu_winter_wheat_2006"]))
    launcher.fails = True
    with pytest.raises(WorkerFailed):
        asyncio.run(desk.restart_worker())
    job = load_config(jobs / "demo.yaml", JOB_KIND).model
    assert (job.id, job.client, job.ndvi_nrich) == (
        "demo",
        "Li Ming",
        0.72,
    ) and "huanghai" in job.crop
    assert [path.name for path in jobs.glob("*.yaml")] == ["demo.yaml"]
    assert launcher.config == (str(jobs / "demo.yaml"),)
    said = (jobs / "demo.yaml").read_text(encoding="utf-8").splitlines()[:4]
    assert said[0] == "# From demo.yaml." and [line.split(" ", 3)[3] for line in said[1:]] == [
        "N-rich strip: NDVI 0.7100",
        "N-rich strip: NDVI 0.7200",
        "Names given in the cab",
    ]


def _geojson(path, *corners):
    ring = [list(corner) for corner in (*corners, corners[0])]
    path.write_text(
        json.dumps(
            {
                "type": "FeatureCollection",
                "features": [
                    {
                        "type": "Feature",
                        "properties": {"rate kg/ha": 200},
                        "geometry": {"type": "Polygon", "coordinates": [ring]},
                    }
                ],
            }
        )
    )
    return str(path)


def _square(east, north, size=0.001):
    return (east, north), (east + size, north), (east + size, north + size), (east, north + size)


def test_what_is_no_prescription_map_says_what_it_is(desk, tmp_path):
    (tmp_path / "notes.csv").write_bytes(b"%PDF-1.7 ...")
    (tmp_path / "worker.json").write_text('{"port": 1}')
    for name, what in (("notes.csv", "this is a PDF document"), ("worker.json", "type None")):
        with pytest.raises(ValueError) as raised:
            desk.preview_map(str(tmp_path / name), MapReading())
        assert str(raised.value).startswith("not a prescription map: ") and what in str(
            raised.value
        )


def test_swapped_latitude_and_longitude_are_named(desk, tmp_path):
    """Degrees beyond 90 cannot be latitudes; within them the job's own field tells (the demo's:
    34.28, 119.88)."""
    with pytest.raises(
        ValueError, match=r"^latitude and longitude look swapped: latitudes up to 120, "
    ):
        desk.preview_map(_geojson(tmp_path / "a.geojson", *_square(34.28, 119.88)), MapReading())
    with pytest.raises(ValueError, match=r"^coordinates up to 500"):
        desk.preview_map(
            _geojson(tmp_path / "m.geojson", *_square(500_000.0, 3_800_000.0, 100.0)), MapReading()
        )
    assert not desk.preview_map(
        _geojson(tmp_path / "b.geojson", *_square(119.88, 34.28)), MapReading()
    ).check.away_m


def test_a_map_of_small_degrees_that_is_swapped_is_seen_by_the_field():
    """Both numbers could be latitudes: 48 north, 16 east."""
    plane = TangentPlane(48.0, 16.0)
    field = Boundary(((0.0, 0.0), (200.0, 0.0), (200.0, 200.0), (0.0, 200.0)))
    right = np.array([(48.0, 16.0), (48.001, 16.0), (48.001, 16.001), (48.0, 16.001)])
    zones = {
        False: Zone(200.0, (right,)),
        True: Zone(200.0, (right[:, ::-1].copy(),)),
        None: Zone(200.0, (right + 1.0,)),
    }
    found = {name: check_map(MapData((zone,)), 500.0, field, plane) for name, zone in zones.items()}
    assert [found[name].swapped for name in (False, True, None)] == [False, True, False]
    assert describe_map_check(found[True], METRIC)[0].startswith(
        "latitude and longitude look swapped"
    )
    assert is_doubtful(found[True]) and describe_map_check(found[None], METRIC)[0].startswith(
        "the map lies"
    )


SQUARE = "POLYGON ((119.88 34.28, 119.881 34.28, 119.881 34.281, 119.88 34.28))"
SWAPPED = SQUARE.replace("119.88", "x").replace("34.28", "119.88").replace("x", "34.28")
REFUSED = {
    "notes.pdf": b"%PDF-1.4",
    "pic.png": b"\x89PNG\r\n",
    "page.html": b"<!doctype html><html></html>",
    "empty.csv": b"",
    "old.gz": b"\x1f\x8b\x08\0",
    "worker.json": b'{"type": "None"}',
    "plain.csv": b"a,b\n1,2\n",
    "none.csv": f'wkt,rate_kg_ha\n"{SQUARE}",\n'.encode(),
    "word.csv": f'wkt,rate_kg_ha\n"{SQUARE}",many\n'.encode(),
    "much.csv": f'wkt,rate_kg_ha\n"{SQUARE}",90000\n'.encode(),
    "swapped.csv": f'wkt,rate_kg_ha\n"{SWAPPED}",200\n'.encode(),
    "short.csv": f'wkt,rate_kg_ha\n"{SQUARE}"\n'.encode(),
    "srid.csv": f'wkt,rate_kg_ha\n"SRID=3857;{SQUARE}",9\n'.encode(),
    "uneven.csv": b"lat,lon,rate kg/ha\n34.28,119.88,90\n34.2811,119.8803,90\n"
    b"34.2817,119.8818,90\n34.29,119.9,90\n",
    "ring.geojson": b'{"type": "FeatureCollection", "features": [{"type": "Feature", '
    b'"properties": {"rate": 9}, '
    b'"geometry": {"type": "Polygon", "coordinates": [[[1, 2], [3, 4]]]}}]}',
    "TASKDATA.XML": b'<ISO11783_TaskData><TSK A="TSK1"/></ISO11783_TaskData>',
    "none.zip": b"PK\5\6" + bytes(18),
}


def test_a_refused_map_is_refused_in_chinese_on_a_chinese_screen(desk, tmp_path):
    """Words of English that are left: names of files, columns, formats and units."""
    import re

    from topdress.console.locale import use_language

    kept = {
        "pdf",
        "csv",
        "wkt",
        "gzip",
        "json",
        "html",
        "png",
        "kg",
        "ha",
        "featurecollection",
        "rate",
        "many",
        "none",
        "gz",
        "srid",
        "wgs",
        "ddi",
    }
    left = {}
    use_language("zh")
    try:
        for name, data in REFUSED.items():
            (tmp_path / name).write_bytes(data)
            with pytest.raises(ValueError) as error:
                desk.preview_map(str(tmp_path / name), MapReading())
            said = str(error.value).replace(f"({name})", "")
            words = set(re.findall(r"[a-z]{2,}", said.lower())) - kept
            if words or not re.search("[\u4e00-\u9fff]", said):
                left[name] = said
    finally:
        use_language("en")
    assert left == {}


# --- Only what may be a map is listed: by its ending and its first bytes
# ---------------------------------------------


@pytest.fixture
def stick(tmp_path):
    square = [[[119.88, 34.28], [119.881, 34.28], [119.881, 34.281], [119.88, 34.28]]]
    feature = {
        "type": "Feature",
        "properties": {"rate": 150},
        "geometry": {"type": "Polygon", "coordinates": square},
    }
    (tmp_path / "a.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [feature]})
    )
    (tmp_path / "worker.json").write_text('{"pid": 4711, "token": "x"}')
    (tmp_path / "run.csv").write_text(
        "time_s,lat_deg,lon_deg,applied_rate_kg_ha\n0,34.28,119.88,100\n"
    )
    (tmp_path / "cells.csv").write_text(
        "latitude,longitude,rate\n34.28,119.88,100\n34.2801,119.88,120\n"
    )
    with zipfile.ZipFile(tmp_path / "photos.zip", "w") as archive:
        archive.writestr("a.jpg", b"")
    with zipfile.ZipFile(tmp_path / "map.zip", "w") as archive:
        archive.writestr("field/map.shp", b"")
    (tmp_path / "deep").mkdir()
    return tmp_path


def test_only_maps_are_listed(stick):
    listed = {one.name for one in find_maps(((stick, "stick"),))}
    assert listed == {"a.geojson", "cells.csv", "map.zip"}
    assert not is_map_likely(stick / "worker.json")


def test_folders_first_then_maps(stick):
    names = [one.name for one in list_entries(stick)]
    assert (
        names[0] == ".."
        and names[1] == "deep/"
        and set(names[2:]) == {"a.geojson", "cells.csv", "map.zip"}
    )


@pytest.mark.parametrize(
    ("rates", "said"),
    [([120.0, 260.0], ""), ([40_000.0], "far above"), ([0.15], "less than"), ([0.0], "")],
)
def test_rates_that_no_field_gets_are_asked_about(rates, said):
    assert (said in find_implausible_rates(rates, 500.0)) and bool(
        find_implausible_rates(rates, 500.0)
    ) == bool(said)
