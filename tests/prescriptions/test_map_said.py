"""What of a map is not applied as it stands is said: before work, while working, in log,
summary, export and report."""

from __future__ import annotations

import csv
import html
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from topdress.console.app.frame_words import describe_alarm
from topdress.console.app.pages.job.checklist import LOOK, STOP, list_checks
from topdress.console.app.pages.job.map_words import describe_map_check
from topdress.console.app.units import METRIC
from topdress.console.locale import use_language
from topdress.console.services.job import JobFiles
from topdress.console.services.launcher import Launcher
from topdress.control.field.boundary import Boundary
from topdress.control.geodesy import TangentPlane
from topdress.control.orders import Alarm, Severity
from topdress.control.targets.map_check import check_map
from topdress.control.targets.prescription import GridDeg, MapData, Zone, calc_rate_shares
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.config import find_shipped_files
from topdress.drivers.files.prescriptions.map_choices import RateChoice, RateQuestion
from topdress.drivers.files.prescriptions.map_reader import read_prescription

from tests.app.made_up.job import FACTS
from tests.command import topdress
from tests.geojson import feature, geojson

LAT, LON, STEP = 34.28, 119.88, 0.0005
LIMIT = 500.0  # of the shipped crop


def square(south: float, west: float, north: float, east: float) -> Floats:
    return np.array([(south, west), (south, east), (north, east), (north, west)], dtype=np.float64)


def strips(folder: Path, rates: tuple[float, ...], south: float = LAT) -> Path:
    """Strips from south to north over the shipped job's field."""
    geojson(
        folder / "map.geojson",
        *(
            feature(
                [[[LON, a], [LON + 0.001, a], [LON + 0.001, a + STEP], [LON, a + STEP], [LON, a]]],
                rate=rate,
            )
            for k, rate in enumerate(rates)
            for a in [south + k * STEP]
        ),
    )
    text = (
        find_shipped_files("jobs")["map_demo"]
        .read_text()
        .replace("map_demo.geojson", "map.geojson")
    )
    (folder / "job.yaml").write_text(text)
    return folder / "job.yaml"


# -- above the crop's limit
# -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Log and output of a run on a map with 1000 kg/ha."""
    folder = tmp_path_factory.mktemp("cut")
    log = folder / "run.csv"
    result = topdress(
        "simulate",
        "--job",
        strips(folder, (1000.0, 300.0, 1000.0)),
        "--seconds",
        "120",
        "--out",
        log,
        "--summary",
    )
    assert result.exit_code == 0, result.output
    return log, result.output


def rows_of(log: Path) -> list[dict[str, str]]:
    with log.open(newline="") as file:
        return [
            row
            for row in csv.DictReader(file)
            if row["state"] == "working" and row["target_source"] == "map"
        ]


@pytest.mark.exam
def test_the_log_tells_what_was_wanted_and_the_alarm_that_it_was_cut(cut: tuple[Path, str]) -> None:
    rows = rows_of(cut[0])
    assert {row["target_rate_kg_ha"] for row in rows} == {"1000.0", "300.0"}
    assert all(
        ("target_cut" in row["alarms"]) or row["target_rate_kg_ha"] == "300.0" for row in rows[50:]
    )
    settled = [
        float(row["applied_rate_kg_ha"])
        for row in rows[100:]
        if row["target_rate_kg_ha"] == "1000.0"
    ]
    assert np.median(settled) == pytest.approx(LIMIT, rel=0.05), "what flows keeps to the limit"


def test_the_summary_the_export_and_the_report_miss_the_plan_by_what_was_cut(
    cut: tuple[Path, str], tmp_path: Path
) -> None:
    log, said = cut
    assert "above the crop's limit: 500 kg/ha are applied there" in said and "target_cut" in said
    told = json.loads(topdress("map", log, "--json").stdout)
    known = [row for row in rows_of(log) if row["target_rate_kg_ha"] == "1000.0"]
    share = len(known) / len(rows_of(log))
    assert told["error_percent"] == pytest.approx(
        100.0 * ((500 * share + 300 * (1 - share)) / (1000 * share + 300 * (1 - share)) - 1.0),
        abs=2.0,
    )
    assert told["cut_at_crop_limit"]["limit_kg_ha"] == LIMIT
    assert told["cut_at_crop_limit"]["less_kg"] == pytest.approx(
        500.0 * told["cut_at_crop_limit"]["area_ha"]
    )
    text = topdress("map", log, "--out", tmp_path / "r.html").output
    assert "wanted up to 1000 kg/ha: the crop's limit of 500 was applied there" in text
    page = html.unescape((tmp_path / "r.html").read_text())
    assert "above the crop's limit" in page and "kg less than wanted" in page


@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("en", "1000 kg/ha are wanted here; the crop's limit of 500 kg/ha is applied."),
        ("zh", "按作物上限 500 kg/ha 施用"),
    ],
)
def test_the_operator_reads_it(language: str, words: str) -> None:
    use_language(language)
    try:
        alarm = Alarm(
            "target_cut",
            Severity.AMBER,
            0.0,
            False,
            (("planned_kg_ha", 1000), ("limit_kg_ha", 500)),
        )
        assert words in describe_alarm(alarm).text
    finally:
        use_language("en")


# -- before work
# --------------------------------------------------------------------------------------------------


def facts_check(job: Path) -> Any:
    launcher = Launcher([str(job)], [], 1, 20.0, None, job.with_name("trouble"))
    facts = JobFiles(launcher, job.parent).find_facts()
    return next(
        (
            check
            for check in list_checks(None, 0.0, facts, "", None, METRIC)
            if check.label == "map"
        ),
        None,
    )


def test_the_check_list_says_rates_above_the_limit_and_a_map_elsewhere(tmp_path: Path) -> None:
    above = facts_check(strips(tmp_path, (1000.0, 300.0, 1000.0)))
    assert above.level == LOOK and "1000 kg/ha, above the crop's limit" in above.text
    away = facts_check(strips(tmp_path, (300.0,), south=35.0))
    assert (
        away.level == LOOK and "79.7 km away from the field: nothing of it is applied" in away.text
    )
    (tmp_path / "map.geojson").unlink()
    gone = facts_check(tmp_path / "job.yaml")
    assert gone.level == STOP and "not there" in gone.text


def test_a_job_without_a_map_has_no_such_line() -> None:
    assert not [
        check
        for check in list_checks(None, 0.0, replace(FACTS), "", None, METRIC)
        if check.label == "map"
    ]


def test_check_reads_the_map_that_a_job_names(tmp_path: Path) -> None:
    job = strips(tmp_path, (1000.0,))
    fine = topdress("check", job)
    assert (
        fine.exit_code == 0 and "note:" in fine.output and "above the crop's limit" in fine.output
    )
    (tmp_path / "map.geojson").unlink()
    gone = topdress("check", job)
    assert gone.exit_code != 0 and "map.geojson: not there" in gone.output
    (tmp_path / "map.geojson").write_text('{"type": "FeatureCollection", "features": [')
    broken = topdress("check", job)
    assert broken.exit_code != 0 and "not readable as JSON" in broken.output


def test_ground_is_counted_as_it_lies() -> None:
    """Against shapely on the same plane: outside, without a rate, in two zones, above the limit."""
    zones = (
        Zone(100.0, (square(40.0, 116.0, 40.001, 116.001),)),
        Zone(700.0, (square(40.0, 116.0005, 40.001, 116.0015),)),
        Zone(900.0, (square(40.0, 116.0, 40.001, 116.001),)),
    )
    data, plane = MapData(zones), TangentPlane(40.0, 116.0)
    first, second, _ = (
        shapely.Polygon(plane.project_many_to_m(z.rings_deg[0][:, 0], z.rings_deg[0][:, 1]))
        for z in zones
    )
    field = shapely.Polygon([(-10.0, -10.0), (100.0, -10.0), (100.0, 50.0), (-10.0, 50.0)])
    found = check_map(
        data, LIMIT, Boundary([(float(e), float(n)) for e, n in field.exterior.coords[:-1]]), plane
    )
    own = second.difference(first)
    assert found.mapped_ha == pytest.approx(first.union(second).area / 1e4)
    assert found.overlap_ha == pytest.approx(first.area / 1e4)
    assert found.outside_ha == pytest.approx(first.union(second).difference(field).area / 1e4)
    assert found.uncovered_ha == pytest.approx(field.difference(first.union(second)).area / 1e4)
    assert found.above_ha == pytest.approx(own.intersection(field).area / 1e4)
    assert found.above_kg == pytest.approx(200.0 * own.intersection(field).area / 1e4)
    assert found.highest_kg_ha == 700.0, "the third zone lies wholly under the first"
    shares = calc_rate_shares(data)
    assert [share.rate_kg_ha for share in shares] == [100.0, 700.0]
    assert sum(share.area_ha for share in shares) == pytest.approx(
        first.union(second).area / 1e4, rel=1e-4
    )


def test_a_map_that_fits_has_nothing_to_be_said() -> None:
    grid = GridDeg(40.0, 116.0, 1e-4, 1e-4, np.full((5, 5), 200.0))
    assert describe_map_check(check_map(MapData(grid=grid), LIMIT), METRIC) == ()
    zones = (
        Zone(100.0, (square(40.0, 116.0, 40.001, 116.001),)),
        Zone(200.0, (square(40.0, 116.001, 40.001, 116.002),)),
    )
    assert describe_map_check(check_map(MapData(zones), LIMIT), METRIC) == ()


def test_every_sentence_has_its_chinese(tmp_path: Path) -> None:
    zones = (
        Zone(100.0, (square(40.0, 116.0, 40.001, 116.001),)),
        Zone(700.0, (square(40.0, 116.0005, 40.001, 116.0015),)),
    )
    field = Boundary([(-10.0, -10.0), (100.0, -10.0), (100.0, 50.0), (-10.0, 50.0)])
    far = Boundary([(1e4, 0.0), (2e4, 0.0), (2e4, 1e4)])
    use_language("zh")
    try:
        said = [
            text
            for where in (field, far)
            for text in describe_map_check(
                check_map(MapData(zones), LIMIT, where, TangentPlane(40.0, 116.0)), METRIC
            )
        ]
    finally:
        use_language("en")
    assert len(said) == 5
    assert all(any("一" <= letter <= "鿿" for letter in text) for text in said)


# -- what a file holds beside
# --------------------------------------------------------------------------------------

HEAD = '<ISO11783_TaskData VersionMajor="4" VersionMinor="3" DataTransferOrigin="1">'
GRID = (
    '<TSK A="TSK1" G="1" H="0" I="0" J="0"><TZN A="0"><PDV A="0006" B="0" E="VPN1"/></TZN>'
    '<TZN A="1"><PDV A="0006" B="12000" E="VPN1"/>{polygon}</TZN>'
    '<GRD A="40.0" B="116.0" C="0.0001" D="0.0001" E="1" F="2" G="GRD00001" I="1"/></TSK>'
)
POLYGON = (
    '<PLN A="2"><LSG A="1"><PNT A="2" C="40.0" D="116.0"/><PNT A="2" C="40.0" D="116.001"/>'
    '<PNT A="2" C="40.001" D="116.0"/></LSG></PLN>'
)


def task(folder: Path, body: str, offset: int = 0, cells: bytes = b"\x00\x01") -> Path:
    vpn = f'<VPN A="VPN1" B="{offset}" C="0.01" D="2" E="kg/ha"/>'
    (folder / "TASKDATA.XML").write_text(f"{HEAD}{vpn}{body}</ISO11783_TaskData>")
    (folder / "GRD00001.bin").write_bytes(cells)
    return folder


def test_polygons_beside_a_grid_are_said(tmp_path: Path) -> None:
    found = [
        f.text for f in read_prescription(task(tmp_path, GRID.format(polygon=POLYGON))).findings
    ]
    assert found == ["1 zone with a polygon next to the grid not used: the grid holds (zones 1)"]
    assert read_prescription(task(tmp_path, GRID.format(polygon=""))).findings == ()


def test_process_data_that_is_no_rate_is_said(tmp_path: Path) -> None:
    body = GRID.format(polygon='<PDV A="0043" B="3000"/>')
    assert [f.id for f in read_prescription(task(tmp_path, body)).findings] == ["other_data"]


def test_an_offset_of_the_presentation_is_a_question(tmp_path: Path) -> None:
    folder = task(tmp_path, GRID.format(polygon=""), offset=500)
    with pytest.raises(RateQuestion, match="an offset of 500 added, 6 kg/ha as presented"):
        read_prescription(folder)
    by_ddi, shown = (
        read_prescription(folder, RateChoice(rate_from=which)).data.grid  # type: ignore[arg-type]
        for which in ("ddi", "presentation")
    )
    assert by_ddi is not None and by_ddi.rate_kg_ha.max() == 120.0
    assert shown is not None and shown.rate_kg_ha.max() == 125.0


def test_columns_that_are_not_used_are_said(tmp_path: Path) -> None:
    ring = [[116.0, 40.0], [116.001, 40.0], [116.0, 40.001], [116.0, 40.0]]
    file = geojson(tmp_path / "m.geojson", feature([ring], rate=100, ID=7, offset_m=3.0))
    assert [f.text for f in read_prescription(file).findings] == [
        "2 columns not used: ID, offset_m"
    ]


def test_the_column_of_the_unit_is_used(tmp_path: Path) -> None:
    ring = [[116.0, 40.0], [116.001, 40.0], [116.0, 40.001], [116.0, 40.0]]
    file = geojson(tmp_path / "m.geojson", feature([ring], rate=100, unit="lb/ac", ID=7))
    found = read_prescription(file)
    assert (found.unit, [f.text for f in found.findings]) == ("lb/ac", ["1 column not used: ID"])


# --- `topdress map` as a person types it
# -----------------------------------------------------------------------------


@pytest.fixture
def square_field(tmp_path: Path) -> Path:
    ring = [[116.0, 40.0], [116.001, 40.0], [116.001, 40.001], [116.0, 40.001], [116.0, 40.0]]
    return geojson(tmp_path / "square.geojson", feature([ring], rate=200.0))


def test_a_map_is_told(square_field: Path) -> None:
    told = topdress("map", square_field)
    assert told.exit_code == 0
    assert "1 zone, numbers in kg/ha" in told.stdout
    assert "altogether   0.9482 ha, 189.63 kg, mean 200.00 kg/ha" in told.stdout


@pytest.mark.parametrize("out", ["o.geojson", "o.shp", "o.zip", "task"])
def test_a_map_is_converted(square_field: Path, tmp_path: Path, out: str) -> None:
    told = topdress(
        "map",
        square_field,
        "--out",
        tmp_path / "new" / out,
        "--unit",
        "g/m2",
        "--scale",
        "0.1",
        "--json",
    )
    assert told.exit_code == 0
    assert json.loads(told.stdout)["mass_kg"] == pytest.approx(189.63, abs=0.01)
    again = read_prescription(tmp_path / "new" / out)
    assert [zone.rate_kg_ha for zone in again.data.zones] == [200.0]


def test_fallbacks_go_along_to_a_task(square_field: Path, tmp_path: Path) -> None:
    topdress(
        "map",
        square_field,
        "--out",
        tmp_path / "o.zip",
        "--default",
        "90",
        "--outside",
        "1",
        "--lost",
        "45",
    )
    assert tuple(read_prescription(tmp_path / "o.zip").data.fallbacks) == (90.0, 1.0, 45.0)


@pytest.mark.parametrize(
    "words",
    [("--unit", "bags"), ("--column", "dose"), ("--rate-from", "guess"), ("--out", "x.pdf")],
)
def test_what_cannot_be_is_one_line_and_no_success(
    square_field: Path, words: tuple[str, str]
) -> None:
    told = topdress("map", square_field, *words)
    assert told.exit_code != 0
    assert told.stdout == ""
    assert len(told.stderr.strip().splitlines()) == 1 and "allowed" in told.stderr


def test_the_source_is_never_written_over(square_field: Path) -> None:
    before = square_field.read_bytes()
    told = topdress("map", square_field, "--out", square_field)
    assert told.exit_code != 0
    assert square_field.read_bytes() == before


def test_zones_are_merged_by_a_step_of_rate_and_keep_their_mass(tmp_path: Path) -> None:
    rates = np.random.default_rng(7).uniform(90.0, 130.0, 400)
    strips = [
        [
            [116.0 + 1e-5 * k, 40.0],
            [116.0 + 1e-5 * (k + 1), 40.0],
            [116.0 + 1e-5 * (k + 1), 40.001],
            [116.0 + 1e-5 * k, 40.001],
            [116.0 + 1e-5 * k, 40.0],
        ]
        for k in range(400)
    ]
    file, out = tmp_path / "fine.geojson", tmp_path / "few.kml"
    geojson(
        file,
        *(feature([ring], rate=rate) for rate, ring in zip(rates.tolist(), strips, strict=True)),
    )
    told = topdress("map", file, "--merge", 5, "--outside", 30, "--out", out, "--json")
    assert told.exit_code == 0, told.output
    said, whole = json.loads(told.stdout), json.loads(topdress("map", file, "--json").stdout)
    assert said["mass_kg"] == pytest.approx(whole["mass_kg"], rel=1e-6)
    assert 9 <= len({share["rate_kg_ha"] for share in said["rates"]}) <= 10 and said["zones"] < 400
    texts = {one["id"]: one["text"] for one in said["findings"]}
    assert "400 zones merged to" in texts["merged"] and "as much mass" in texts["merged"]
    assert (
        "outside, " in texts["not_written"]
        and ".kml has no place for rates" in texts["not_written"]
    )
    for step in (0, -5):
        refused = topdress("map", file, "--merge", step, "--out", tmp_path / "none.kml")
        assert refused.exit_code == 2 and "allowed is a step above 0" in refused.output
        assert not (tmp_path / "none.kml").exists()


def test_a_zone_that_crosses_itself_is_put_right_and_said(tmp_path: Path) -> None:
    ring = [[116.0, 40.0], [116.001, 40.001], [116.001, 40.0], [116.0, 40.001], [116.0, 40.0]]
    told = topdress("map", geojson(tmp_path / "bow.geojson", feature([ring], rate=100)))
    assert (
        "altogether   0.4741 ha" in told.stdout
        and "1 zone with edges that cross: what they enclose" in told.stdout
    )
