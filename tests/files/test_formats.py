"""Each format at every command, page and list: a format that is forgotten anywhere is red here."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from topdress.console.app.pages.job.keys import EXPORT_FORMATS
from topdress.console.cli.field import FIELD_KINDS
from topdress.console.cli.inputs import LOG_KINDS, MAP_FILE_KINDS
from topdress.console.services.foreign_files import READ_SUFFIXES
from topdress.console.services.map_refusal import MAP_KINDS
from topdress.console.services.removable_media import is_map_likely, list_entries
from topdress.control.targets.prescription import MapData, Zone
from topdress.drivers.files import limits
from topdress.drivers.files.fields.field_data import FieldData
from topdress.drivers.files.file_sniffer import FILE_KINDS, sniff_file_kind
from topdress.drivers.files.formats import registry
from topdress.drivers.files.formats.file_format import FileFormat
from topdress.drivers.files.formats.registry import list_able, list_formats, list_kinds
from topdress.drivers.files.imports.mapping import SourceKind
from topdress.drivers.files.limits import FILE_LIMITS
from topdress.drivers.files.optional_packages import is_extra_installed
from topdress.drivers.files.prescriptions.map_reader import KNOWN_FORMATS, read_prescription

from tests.command import topdress

DOCS = Path(__file__).parents[2] / "docs"
RATE_KG_HA = 120.0
CORNERS_DEG = np.array([(33.0, 120.0), (33.001, 120.0), (33.001, 120.001), (33.0, 120.001)])


def read_page(name: str) -> str:
    """Read a page of docs as one line."""
    return " ".join((DOCS / name).read_text(encoding="utf-8").split())


def show_help(command: str) -> str:
    """Show a command's help as one line."""
    return " ".join(topdress(command, "--help").output.split())


def write_example(one: FileFormat, folder: Path) -> Path:
    """Write the format's own example, or a prescription of 120 kg/ha by its own writer."""
    path = folder / ("TASKDATA.XML" if one.id == "task" else f"example{one.endings[0]}")
    if one.writing_extra and not is_extra_installed(one.writing_extra):
        pytest.skip(f"the extra {one.writing_extra} is not installed")
    if one.id == "geotiff":
        pytest.importorskip("rasterio", reason="rasterio is not installed")
    if one.make_example is not None:
        one.make_example(path)
    else:
        assert one.write_map is not None
        one.write_map(MapData((Zone(RATE_KG_HA, (CORNERS_DEG,)),)), path)
    return path


@pytest.mark.parametrize("one", list_formats(), ids=lambda one: one.id)
def test_format_has_its_example(one: FileFormat, tmp_path: Path) -> None:
    if not one.endings:
        assert one.write_field is not None and one.read_field is not None
        one.write_field(FieldData("example", CORNERS_DEG), tmp_path / "field")
        assert one.read_field(tmp_path / "field").outline_deg is not None
        return
    path = write_example(one, tmp_path)
    assert sniff_file_kind(path).id == one.id


@pytest.mark.parametrize("one", list_able("read_map"), ids=lambda one: one.id)
def test_a_prescription_is_taken_at_every_door(one: FileFormat, tmp_path: Path) -> None:
    path = write_example(one, tmp_path)
    assert sniff_file_kind(path).id == one.id
    read = read_prescription(path)
    assert read.data.rates_kg_ha == pytest.approx([RATE_KG_HA])
    shown = topdress("map", path)
    assert shown.exit_code == 0 and "120.0" in shown.output
    assert one.title in KNOWN_FORMATS and one.title in MAP_FILE_KINDS.words
    assert one.id in MAP_FILE_KINDS.kinds and one.id in MAP_KINDS
    assert one.title in show_help("map")
    assert topdress("import", path).exit_code != 0 or one.read_table
    listed = [Path(entry.path) for entry in list_entries(tmp_path)]
    assert is_map_likely(path) == (one.id != "task")
    assert path in listed or tmp_path in listed


@pytest.mark.parametrize("one", list_able("write_map"), ids=lambda one: one.id)
def test_a_prescription_is_written(one: FileFormat, tmp_path: Path) -> None:
    source = tmp_path / "source.geojson"
    [geojson] = [other for other in list_formats() if other.id == "json"]
    assert geojson.write_map is not None
    geojson.write_map(MapData((Zone(RATE_KG_HA, (CORNERS_DEG,)),)), source)
    if one.writing_extra and not is_extra_installed(one.writing_extra):
        pytest.skip(f"the extra {one.writing_extra} is not installed")
    for ending in one.written_endings:
        out = tmp_path / (ending[1:] or "folder") / f"out{ending}"
        assert topdress("map", source, "--out", out).exit_code == 0
        assert read_prescription(
            out.parent if ending == ".xml" else out
        ).data.rates_kg_ha == pytest.approx([RATE_KG_HA])
        assert ending in show_help("map")


@pytest.mark.parametrize(
    "one", list_able("read_layers", "read_field", "write_field"), ids=lambda one: one.id
)
def test_a_field_is_taken_and_written(one: FileFormat, tmp_path: Path) -> None:
    shown = show_help("field")
    assert one.id in FIELD_KINDS.kinds and one.title in FIELD_KINDS.words
    assert one.title in shown
    if one.write_field is None:
        return
    assert all(ending in shown for ending in one.written_endings)
    if one.writing_extra and not is_extra_installed(one.writing_extra):
        pytest.skip(f"the extra {one.writing_extra} is not installed")
    out = tmp_path / f"out{one.written_endings[0]}"
    assert topdress("field", "demo.yaml", "--out", out).exit_code in (0, 2)


def test_logs_and_exports_ask_the_registry() -> None:
    for one in list_able("read_table"):
        assert one.id in LOG_KINDS.kinds and {*one.endings} <= READ_SUFFIXES
        assert one.title in LOG_KINDS.words
    assert {one.source_kind for one in list_able("read_table")} == {*get_args(SourceKind)}
    offered = {one.id for one in EXPORT_FORMATS}
    assert offered == {one.id for one in list_able("write_export") if not one.writing_extra}


def test_what_a_format_states_is_whole() -> None:
    """No suffix has two formats; kinds, limits and docs have every format."""
    endings = [ending for one in list_formats() for ending in one.endings]
    assert len(endings) == len({*endings})
    ranks = [one.rank for one in list_formats()]
    assert len(ranks) == len({*ranks})
    maps = read_page("format-prescriptions.md")
    fields, logs = read_page("fields.md"), read_page("import.md")
    for one in list_formats():
        assert FILE_KINDS[one.id].words == one.words
        assert one.limit in FILE_LIMITS
        assert not one.read_map or one.title in maps, f"docs/format-prescriptions.md: {one.title}"
        assert not one.has_any("read_layers", "read_field") or one.title in fields + maps
        assert not one.read_table or one.title in logs
        for part in (one.read_map, one.read_layers, one.read_table):
            assert part is None or callable(part)


@pytest.mark.parametrize(
    "one", [one for one in list_formats() if one.endings], ids=lambda one: one.id
)
def test_a_file_is_held_to_the_limit_of_its_format(
    one: FileFormat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held: list[limits.Limit] = []
    monkeypatch.setattr(limits, "check_limit", lambda limit, *_: held.append(limit))
    for ending in one.endings:
        path = tmp_path / f"a{ending}"
        path.write_bytes(b"no zip")
        limits.check_file(path)
    assert {*held} == {one.limit}


def test_a_format_without_functions_is_offered_nowhere() -> None:
    bare = replace(list_formats()[0], read_map=None, read_layers=None, read_table=None)
    assert not bare.has_any("read_map", "read_layers", "read_table")


def test_zips_and_folders_are_read_where_a_format_is_read_from_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert {"zip", "folder"} <= {*list_kinds("read_map")}
    bare = tuple(replace(one, is_packed=False) for one in list_formats())
    monkeypatch.setattr(registry, "list_formats", lambda: bare)
    assert not {"zip", "folder"} & {*list_kinds("read_map")}


@pytest.mark.parametrize(
    "one", [one for one in list_able("read_map") if one.is_packed], ids=lambda one: one.id
)
def test_a_packed_format_is_read_from_a_zip(one: FileFormat, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    write_example(one, folder)
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as packed:
        for path in folder.rglob("*.*"):
            packed.write(path, path.relative_to(folder))
    for source in (folder, tmp_path / "packed.zip"):
        assert read_prescription(source).data.rates_kg_ha == pytest.approx([RATE_KG_HA])
