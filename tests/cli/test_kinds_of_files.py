"""Every refusal names the kind of file that it is; endings and exit codes are alike in all
commands."""

from __future__ import annotations

import gzip
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from topdress.control.log_row import COLUMNS
from topdress.control.machine.compiled import run_shaft
from topdress.control.machine.machine import add_effect
from topdress.control.machine.shaft import ShaftInput, ShaftOutput, make_shaft_start
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S, make_input_rows, make_no_switch
from topdress.drivers.files import optional_packages
from topdress.drivers.files.config import find_shipped_files, load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.file_sniffer import sniff_file_kind

from tests.command import topdress

PRJ = "<kml xmlns='http://www.opengis.net/kml/2.2'><Document/></kml>"
KINDS: dict[str, tuple[str, bytes]] = {
    "drone.tif": ("geotiff", b"II*\0" + bytes(60)),
    "cloud.csv": ("geotiff", b"MM\0*" + bytes(60)),
    "photo.png": ("picture", b"\x89PNG\r\n\x1a\n" + bytes(60)),
    "photo.jpg": ("picture", b"\xff\xd8\xff\xe0" + bytes(60)),
    "report.pdf": ("pdf", b"%PDF-1.7\n"),
    "map.csv": ("html", b"<!DOCTYPE html><html>Not found</html>"),
    "field.gpkg": ("gpkg", b"SQLite format 3\0" + bytes(52) + b"GPKG" + bytes(40)),
    "farm.db": ("sqlite", b"SQLite format 3\0" + bytes(100)),
    "field.kml": ("kml", b"<?xml version='1.0'?>" + PRJ.encode()),
    "track.gpx": ("gpx", b"<?xml version='1.0'?><gpx version='1.1'></gpx>"),
    "other.xml": ("xml", b"<config/>"),
    "TASKDATA.XML": (
        "task",
        b"<?xml version='1.0'?><!-- x --><ISO11783_TaskData VersionMajor='4'/>",
    ),
    "Zone.fdShape": ("deere", bytes(40)),
    "work.agdata": ("agleader", b"PK" + bytes(40)),
    "job.vy1": ("cnh", bytes(range(40))),
    "field.2020": ("planting", bytes(range(40))),
    "map.fgb": ("fgb", b"fgb\x03fgb" + bytes(20)),
    "scan.las": ("las", b"LASF" + bytes(200)),
    "log.csv.gz": ("gzip", gzip.compress(b"time_s\n")),
    "old.7z": ("7z", b"7z\xbc\xaf\x27\x1c" + bytes(20)),
    "old.rar": ("rar", b"Rar!\x1a\x07\x01\0"),
    "map.dbf": ("shp part", b"\x03\x5f\x07\x1a" + bytes(60)),
    "nmea.log": ("nmea", b"$GPGGA,1,2\r\n$GPRMC,1,2\r\n"),
    "machine.yaml": ("config", b"format: topdress-machine/1\n"),
    "blob.dat": ("binary", bytes(range(256)) * 4),
    "empty.csv": ("empty", b""),
    "map.json": ("json", b"{}"),
    "gbk.csv": ("text", "时间,速度\n1,2\n".encode("gb18030")),
    "wide.csv": ("text", "time_s,a\n1,2\n".encode("utf-16")),
    "log.csv": ("text", b"time_s,speed_mps\n0,1\n"),
}


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_is_known_by_its_bytes(name: str, tmp_path: Path) -> None:
    kind, data = KINDS[name]
    (tmp_path / name).write_bytes(data)
    assert sniff_file_kind(tmp_path / name).id == kind


def test_zips_and_folders(tmp_path: Path) -> None:
    for name, inside, kind in (
        ("a.kmz", "doc.kml", "kmz"),
        ("b.xlsx", "xl/workbook.xml", "excel"),
        ("c.docx", "word/document.xml", "office"),
        ("d.zip", "TASKDATA/TASKDATA.XML", "zip"),
    ):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr(inside, "x")
        assert sniff_file_kind(tmp_path / name).id == kind
    assert sniff_file_kind(tmp_path).id == "folder"
    (tmp_path / "Field.txt").write_text("x")
    assert sniff_file_kind(tmp_path).id == "aog"


READERS = [
    ("import", "{}", "--out", "{o}.csv"),
    ("check", "{}"),
    ("diagnose", "{}"),
    ("watch", "{}", "--to-end"),
    ("replay", "{}", "--headless", "--out", "{o}.csv"),
    ("calibrate", "catch", "{}", "--out", "{o}.yaml"),
    ("calibrate", "lag", "{}", "--out", "{o}.yaml"),
    ("calibrate", "wheel", "{}", "--out", "{o}.yaml"),
    ("calibrate", "heads", "{}", "--out", "{o}.yaml"),
    ("decode", "gnss", "{}"),
    ("map", "{}"),
]


@pytest.mark.parametrize("words", READERS, ids=lambda words: "-".join(words[:2]).replace("{}", "x"))
def test_one_line_names_what_it_is_and_what_is_read(
    words: tuple[str, ...], topdress: Callable[..., Result], tmp_path: Path
) -> None:
    for name in ("report.pdf", "photo.png", "log.csv.gz"):
        (tmp_path / name).write_bytes(KINDS[name][1])
        result = topdress(*(word.format(tmp_path / name, o=tmp_path / "out") for word in words))
        lines = result.output.strip().splitlines()
        assert result.exit_code == 2 and len(lines) == 1, result.output
        assert "this is a" in lines[0] and "allowed here is" in lines[0]
    gone = topdress(*(word.format(tmp_path / "gone.csv", o=tmp_path / "out") for word in words))
    assert gone.exit_code == 2 and gone.output.strip() == f"{tmp_path / 'gone.csv'}: no such file"
    assert not list(tmp_path.glob("out*"))


def test_endings_that_do_not_fit(topdress: Callable[..., Result], tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    table.write_text("shaft_rpm,drop_s\n10,0.5\n20,0.45\n30,0.4\n")
    for words, allowed in (
        (("diagnose", table, "--report", tmp_path / "why.pdf"), "--report"),
        (("diagnose", table, "--adopt", tmp_path / "new.csv"), "--adopt"),
        (("calibrate", "lag", table, "--out", tmp_path / "n.csv"), "--out"),
        (("history", "huanghai", "--undo", "--out", tmp_path / "n.csv"), "--out"),
    ):
        result = topdress(*words)
        assert result.exit_code == 2 and result.output.startswith(allowed), result.output
        assert (
            "allowed is a name that ends in" in result.output
            and len(result.output.strip().splitlines()) == 1
        )
        assert (": a browser prints that page to a PDF" in result.output) == (allowed == "--report")


def test_a_log_is_no_table_and_a_table_no_log(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    log, table = tmp_path / "log.csv", tmp_path / "lag.csv"
    log.write_text(
        "time_s,shaft_rpm,speed_mps,lat_deg\n" + "".join(f"{k},40,1.2,34\n" for k in range(9))
    )
    table.write_text("shaft_rpm,drop_s\n10,0.5\n20,0.45\n30,0.4\n")
    # ours has what a lag table has too
    for name, header in (("log.csv", None), ("ours.csv", ",".join(COLUMNS))):
        if header:
            (tmp_path / name).write_text(header + "\n" + ",".join("1" for _ in COLUMNS) + "\n")
        said = topdress("calibrate", "lag", tmp_path / name, "--out", tmp_path / "n.yaml")
        assert said.exit_code == 2 and "this is a run log" in said.output
    for words in (
        ("calibrate", "wheel", table, "--out", tmp_path / "n.yaml"),
        ("watch", table),
        ("replay", table, "--headless", "--out", tmp_path / "o.csv"),
    ):
        said = topdress(*words)
        assert said.exit_code == 2 and "this is a bench table (lag" in said.output, said.output


def test_decode_and_devices_do_not_end_well_where_nothing_was(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    (tmp_path / "words.txt").write_text("Dear all,\nthe field is ready.\n")
    said = topdress("decode", "gnss", tmp_path / "words.txt")
    assert said.exit_code == 2 and "no measurement of gnss in" in said.output
    port = topdress("devices", "/dev/nope")
    assert port.exit_code == 1 and "cannot be opened" in port.output


def test_an_install_line_needs_no_package_of_ours(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert re.fullmatch(
        r"\S+ -m pip install 'textual-serve>=[\d.]+'", optional_packages.format_extra_line("serve")
    )
    # an environment of `uv tool install`
    monkeypatch.setattr(optional_packages, "find_spec", lambda _: None)
    assert re.fullmatch(
        r"uv pip install --python \S+ 'textual-serve>=[\d.]+'",
        optional_packages.format_extra_line("serve"),
    )
    # an environment of pipx, whatever its back end
    monkeypatch.setattr(optional_packages.sys, "prefix", str(tmp_path / "topdress"))
    (tmp_path / "topdress").mkdir()
    (tmp_path / "topdress" / optional_packages.PIPX_METADATA).touch()
    line = optional_packages.format_extra_line("diagnosis")
    assert re.fullmatch(r"pipx inject topdress 'numba>=[\d.]+'", line)


@pytest.mark.parametrize("ending", ["shp", "tif", "gpkg", "kml", "geojson", "zip", "csv"])
def test_an_empty_file_and_a_folder_by_such_a_name(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"a.{ending}").touch()
    (tmp_path / f"b.{ending}").mkdir()
    for command in ("map", "field"):
        if (command, ending) == ("field", "csv"):
            continue
        said = topdress(command, tmp_path / f"a.{ending}")
        assert said.exit_code == 2 and f"a.{ending}: this is an empty file" in said.output, (
            said.output
        )
        said = topdress(command, tmp_path / f"b.{ending}")
        assert said.exit_code == 2 and f"b.{ending}: no " in said.output, said.output


# --- Machines of other scale at the commands: their bounds, a run of the spreader, a log of a
# drive alone ------------


def test_effects_of_a_machine_have_its_bounds(tmp_path: Path) -> None:
    plain = topdress("effects", "--machine", "drive_alone").output
    assert (
        "shaft.dead_band  (r/min; 0 to 390)" in plain
        and "(% lost at 650 r/min; -10 to 60)" in plain
    )
    assert "shaft.dead_band  (r/min; 0 to 60)" in topdress("effects").output
    listed = {
        one["id"]: one
        for one in json.loads(
            topdress(
                "effects", "--json", "--machine", find_shipped_files("machines")["spreader"]
            ).output
        )
    }
    assert (listed["gate.slow"]["low"], listed["gate.slow"]["high"]) == (-40.0, 39.0)
    page = tmp_path / "page.md"
    assert topdress("effects", "--machine", "spreader", "--markdown", page).exit_code == 0
    assert "Ranges are those of machine `spreader`" in page.read_text(encoding="utf-8")
    assert "mm/s lost; -40 to 39, by gate.slew_mm_s" in page.read_text(encoding="utf-8")


@pytest.mark.exam
def test_a_spreader_meters_and_places_what_is_wanted() -> None:
    result = topdress(
        "simulate",
        "--machine",
        "spreader",
        "--job",
        "spreader_demo",
        "--seconds",
        "240",
        "--summary",
        "--json",
    )
    assert result.exit_code == 0, result.output
    told = json.loads(result.output)
    assert told["rate_error_percent"] < 4.0 and told["released_kg"] == pytest.approx(
        told["landed_kg"]
    )
    assert told["area_ha"] > 1.0


@pytest.mark.exam
def test_a_log_of_a_shaft_alone_is_diagnosed(tmp_path: Path) -> None:
    drive = load_config("drive_alone", MACHINE_KIND).model
    rng, time = np.random.default_rng(4), np.arange(0.0, 240.0, 0.05)
    asked = np.round(rng.uniform(0.0, 600.0, 200)[(time / 1.5).astype(int)], 1)
    inputs = make_input_rows(ShaftInput, len(time), command_rpm=asked, opening_mm=0.0, supply_v=7.4)
    turns = run_shaft(
        (add_effect(drive, "shaft.gain", -6.0).shaft,),
        make_no_switch(),
        make_shaft_start(),
        ShaftOutput(0.0, 0.0),
        inputs,
        time,
        MAX_MODEL_STEP_S,
    )[:, 0]
    place = tmp_path / "drive.csv"
    read = turns + 2.0 * rng.standard_normal(len(time))
    place.write_text(
        "time_s,shaft_rpm_cmd,shaft_rpm\n"
        + "".join(f"{t:.3f},{c:g},{r:.2f}\n" for t, c, r in zip(time, asked, read, strict=True)),
        encoding="utf-8",
    )
    result = topdress("diagnose", place, "--machine", "drive_alone", "--json", "-")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert [one["channel"] for one in found["channels"]] == ["shaft"] and found["data"][
        "machine"
    ] == "drive_alone"
    gain = next(one for one in found["causes"] if one["id"] == "shaft.gain")
    assert gain["size"]["value"] == pytest.approx(-6.0, abs=1.0)
