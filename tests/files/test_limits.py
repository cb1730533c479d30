"""Files that are too large, hold too much, or are no files of their kind: one line, at once,
and little memory."""

from __future__ import annotations

import base64
import io
import json
import os
import re
import resource
import struct
import subprocess
import sys
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from topdress.console.worker import resume
from topdress.console.worker.resume_ground import unpack_raster
from topdress.control.recordings.place_check import cut_track_pieces
from topdress.control.targets.prescription import calc_rate_shares
from topdress.drivers.files import limits
from topdress.drivers.files.bench_table import read_bench_table
from topdress.drivers.files.columns import count_rows
from topdress.drivers.files.config import ConfigError
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.limits import (
    FILE_LIMITS,
    BeyondLimits,
    check_file,
    check_text,
    read_json,
)
from topdress.drivers.files.log_store import read_log_store
from topdress.drivers.files.prescriptions.job_targets import read_plant_places
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_setup import load_by_kind
from topdress.drivers.files.sheet_text import check_sheets
from topdress.drivers.plain_text import join_lines

from tests.geojson import feature, geojson

PAGE = Path(__file__).parents[2] / "docs" / "limits.md"


def zipped(
    path: Path,
    entries: list[tuple[str, bytes]],
    declares: int | None = None,
    method: int | None = None,
    flag: int = 0,
) -> Path:
    """A zip; `declares`: what its directory says of the first entry's size."""
    made = io.BytesIO()
    with (
        warnings.catch_warnings(action="ignore"),
        zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name, data in entries:
            archive.writestr(name, data)
    data = bytearray(made.getvalue())
    central = data.find(b"PK\x01\x02")
    if declares is not None:
        data[central + 24 : central + 28] = struct.pack("<I", declares)
    if method is not None:
        data[central + 10 : central + 12] = data[8:10] = struct.pack("<H", method)
    data[central + 8] |= flag
    path.write_bytes(data)
    return path


def test_the_page_shows_the_table() -> None:
    rows = [
        line.strip("| ").split(" | ")
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| ") and "up to" not in line
    ]
    assert rows == [[one.what, limits._format_amount(one.most, one.unit)] for one in FILE_LIMITS]


@pytest.mark.parametrize(
    ("entries", "how", "said"),
    [
        (
            [("a.shp", b"x"), ("a.dbf", b"x")],
            {"declares": 600 << 20},
            "600 MB: allowed up to 512 MB",
        ),
        (
            [("a.shp", b"x"), ("b.bin", b"x")],
            {"declares": 4_000_000_000},
            "unpacked: 3815 MB: allowed up to 1024 MB",
        ),
        ([("TASKDATA.XML", b"x")], {"declares": 65 << 20}, "allowed up to 64 MB"),
        (
            [("a.prj", b"x"), ("a.shp", b"x")],
            {"declares": 2 << 20},
            "a.prj: 2097152 bytes: allowed up to 1048576 bytes",
        ),
        ([("a.shp", b"x")] * 2, {}, "a.shp: stands twice"),
        ([(f"{k}", b"") for k in range(5001)], {}, "5001 entries: allowed up to 5000 entries"),
        (
            [("TASKDATA.XML", b"<ISO11783_TaskData/>")],
            {"method": 99},
            "compression 99: allowed are stored and deflated",
        ),
        (
            [("TASKDATA.XML", b"<ISO11783_TaskData/>")],
            {"flag": 1},
            "encrypted: allowed is a zip without",
        ),
    ],
)
@pytest.mark.parametrize("read", [read_prescription, read_raw_table])
def test_a_zip_is_judged_by_its_directory(tmp_path: Path, read, entries, how, said) -> None:
    path = zipped(tmp_path / "map.zip", entries, **how)
    with pytest.raises(ValueError, match=said):
        read(path)


def test_a_zip_that_lies_about_its_sizes_is_not_unpacked_beyond_them(tmp_path: Path) -> None:
    path = zipped(tmp_path / "map.zip", [("TASKDATA.XML", b" " * (80 << 20))], declares=100)
    with pytest.raises(ValueError, match=r"XML|CRC"):
        read_prescription(path)


def test_a_file_that_is_named_many_times_is_read_once(tmp_path: Path) -> None:
    """A task file of 2000 names of one file: 200 MB of elements in memory, and as many again
    for each name."""
    references = b'<XFR A="TSK00001" B="1"/>'
    text = b"<ISO11783_TaskData>" + references * 900 + b"</ISO11783_TaskData>"
    entries = [("TASKDATA.XML", text), ("TSK00001.XML", b"<XFC>" + b"<TSK/>" * 20_000 + b"</XFC>")]
    with pytest.raises(ValueError, match=r"map\.zip"):
        read_prescription(zipped(tmp_path / "map.zip", entries))
    (tmp_path / "TASKDATA.XML").write_bytes(text.replace(references, references * 2))
    with pytest.raises(ValueError, match="1800 files: allowed up to 1000 files"):
        read_prescription(tmp_path / "TASKDATA.XML")


def test_side_files_are_held_to_their_limits(tmp_path: Path) -> None:
    (tmp_path / "map.shp").write_bytes(b"x")
    (tmp_path / "map.prj").write_bytes(b" " * (limits.SIDE_FILE_LIMIT.most + 1))
    with pytest.raises(BeyondLimits, match=r"map\.prj"):
        check_file(tmp_path / "map.shp")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"features":' * 50_000, '{"a": ' + "9" * 400 + "}", "\ufeff{", "NaN,"]
)
@pytest.mark.parametrize("name", ["x.geojson", "x.json"])
def test_json_of_any_depth_and_length_is_one_line(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    for read in (read_prescription, read_raw_table, read_plant_places, read_json):
        with pytest.raises(ValueError) as said:
            read(path)
        assert "\n" not in str(said.value)


@pytest.mark.parametrize("properties", ["[1, 2]", '"rate"', "7", "null"])
def test_properties_that_are_no_record_are_nothing(tmp_path: Path, properties: str) -> None:
    path = tmp_path / "x.geojson"
    ring = "[[1, 1], [1, 2], [2, 2], [1, 1]]"
    for shape in (
        f'{{"type": "Polygon", "coordinates": [{ring}]}}',
        '{"type": "Point", "coordinates": [1, 1]}',
    ):
        path.write_text(
            '{"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": '
            f'{shape}, "properties": {properties}}}]}}'
        )
        for read in (read_prescription, read_raw_table):
            with pytest.raises(ValueError):
                read(path)


@pytest.mark.parametrize(
    "text",
    [
        "? \n: 1",
        "~: 1",
        "null: 1",
        '"": 1',
        "x: !!set {a}",
        "x: !!omap [a: 1]",
        "x: !!binary aaaa",
        "x: !!timestamp 2020-01-01",
        "x: !!python/name:os.system",
        "x: !own 1",
        "a: " + "[" * 50_000,
        "{" * 50_000,
        f"id: {'9' * 5000}",
    ],
)
def test_yaml_is_plain_data_with_names(tmp_path: Path, text: str) -> None:
    path = tmp_path / "job.yaml"
    path.write_text(f"format: topdress-job/1\n{text}\n")
    with pytest.raises(ConfigError) as said:
        load_by_kind([str(path)])
    assert len(said.value.lines) == 1
    assert "plain data without tags" in str(said.value) or "!" not in text


def test_yaml_has_a_depth(tmp_path: Path) -> None:
    path = tmp_path / "job.yaml"
    path.write_text(f"format: topdress-job/1\na: {'[' * 60}{']' * 60}\n")
    with pytest.raises(ConfigError, match="nested too deeply or too large"):
        load_by_kind([str(path)])


@pytest.mark.parametrize(
    "data",
    [b"a" * 200_000, b"time_s" + b",c" * 3000 + b"\n1\n", b"x,y\n" + b'"' * 200_000],
    ids=["endless line", "columns", "quotes"],
)
def test_a_text_table_has_lines_and_a_header(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(data)
    with pytest.raises(BeyondLimits):
        check_text(data, "x")
    for read in (read_log, read_raw_table):
        with pytest.raises(ValueError, match="allowed up to"):
            read(path)


def test_bare_returns_are_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(b"time_s,shaft_rpm\r" + b"".join(b"%d,1\r" % k for k in range(300_000)))
    assert len(read_log(path)) == 300_000 and count_rows(read_raw_table(path).columns) == 300_000


def test_times_of_other_scales_cost_nothing() -> None:
    """Three rows, the last a thousand years later: marks of five seconds between them would be
    50 GB."""
    time_s = np.array([0.0, 6.0, 12.0, 3.2e10])
    found = cut_track_pieces(time_s, np.array([34.0, 34.1, 34.2, 34.3]), np.full(4, 119.0))
    assert found is not None and found[0].tolist() == [0, 1] and found[1].tolist() == [1, 2]


def sheet(path: Path, cells: bytes) -> Path:
    return zipped(
        path,
        [
            (
                "xl/worksheets/sheet1.xml",
                b"<worksheet><sheetData>" + cells + b"</sheetData></worksheet>",
            )
        ],
    )


FAR = b'<row r="1"><c r="A1"/></row><row r="1048576"><c r="XFD1048576"/></row>'
# its reader would make every cell between two, and end the program when it cannot
CELLS = {
    "far apart": FAR,
    "far apart, rows without a place": b'<row><c r="A1"/></row><row><c r="XFD1048576"/></row>',
    "far down": b'<row r="4000000"><c r="Z4000000"/></row>',
    "no references": b"<row>" + b"<c/>" * 16_000 + b"</row>" + b"<row><c/></row>" * 2_000,
    "prefixed": b"<x:row>" + b"<x:c/>" * 16_000 + b"</x:row>" + b"<x:row><x:c/></x:row>" * 2_000,
    "a row of two pieces": b"<row>"
    + b"<c/>" * 3_000
    + b" " * (5 << 20)
    + b"<c/>" * 3_000
    + b"</row>"
    + (b"<row/>" * 3_000),
}


@pytest.mark.parametrize("cells", CELLS)
def test_a_sheet_of_many_cells_is_not_made(tmp_path: Path, cells: str) -> None:
    for read in (read_raw_table, read_bench_table):
        with pytest.raises(
            ValueError, match=r"sheet1\.xml: [0-9]+ cells: allowed up to 16777216 cells"
        ):
            read(sheet(tmp_path / "x.xlsx", CELLS[cells]))


def test_a_sheet_under_any_name_is_looked_through(tmp_path: Path) -> None:
    """A workbook says itself where its sheets are."""
    with pytest.raises(ValueError, match="elsewhere: 17179869184 cells"):
        read_raw_table(
            zipped(tmp_path / "x.xlsx", [("elsewhere", b"<worksheet>" + FAR + b"</worksheet>")])
        )


@pytest.mark.parametrize("more", [b"", b" "], ids=["as much", "one byte more"])
def test_a_workbook_that_lies_about_its_sizes_is_refused(tmp_path: Path, more: bytes) -> None:
    """Its reader would unpack all there is: the checksum is made for as much as the directory
    says, or for one more."""
    begin = b"<worksheet><sheetData>" + b" " * 1000
    path = zipped(
        tmp_path / "x.xlsx",
        [("xl/worksheets/sheet1.xml", begin + b" " * (8 << 20))],
        declares=len(begin),
    )
    data = bytearray(path.read_bytes())
    central = data.find(b"PK\x01\x02")
    data[central + 16 : central + 20] = struct.pack("<I", zlib.crc32(begin + more))
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"unpacks to more than|CRC"):
        read_raw_table(path)
    with pytest.raises(ValueError, match="900 MB: allowed up to 256 MB"):
        read_raw_table(zipped(path, [("xl/worksheets/sheet1.xml", begin)], declares=900 << 20))


def document(path: Path, rows: str) -> Path:
    text = (
        '<office:document-content xmlns:office="urn:oasis:names:tc:opendocument:xmlns:office:1.0" '
        'xmlns:tableable="urn:oasis:names:tc:opendocument:xmlns:table:1.0"><office:body>'
        "<office:spreadsheet>"
        '<table:table table:name="S">'
        f"{rows}</table:table></office:spreadsheet></office:body></office:document-content>"
    )
    return zipped(
        path,
        [
            ("mimetype", b"application/vnd.oasis.opendocument.spreadsheet"),
            ("content.xml", text.encode()),
            ("META-INF/manifest.xml", b"<manifest/>"),
        ],
    )


CELL = (
    '<table:table-cell office:value-type="float" office:value="1" '
    'table:number-columns-repeated="{}"/>'
)
EMPTY = '<table:table-cell table:number-columns-repeated="16000"/>'


@pytest.mark.parametrize(
    "rows",
    [
        f'<table:table-row table:number-rows-repeated="9000">{CELL.format(9000)}</table:table-row>',
        "<table:table-row "
        f'table:number-rows-repeated="9000">{EMPTY}{CELL.format(1)}</table:table-row>',
        f'<table:table-row table:number-rows-repeated="900000">{EMPTY}</table:table-row>'
        f"<table:table-row>{EMPTY}{CELL.format(1)}</table:table-row>",
    ],
    ids=["repeated", "far right", "far down"],
)
@pytest.mark.parametrize("read", [read_raw_table, lambda path: read_bench_table(path, "lag")])
def test_a_document_of_few_bytes_and_many_cells_is_not_made(
    tmp_path: Path, read, rows: str
) -> None:
    """900 000 x 16 000 empty cells before the one that is there ended the program: 48 GB were
    asked for."""
    # the second: before the reader is asked
    where = "sheet S: " if "900000" in rows else "content.xml: "
    with pytest.raises(ValueError, match=where + "[0-9]+ cells: allowed up to 16777216 cells"):
        read(document(tmp_path / "x.ods", rows))


def test_rows_that_fill_the_end_of_a_document_do_not_count(tmp_path: Path) -> None:
    rows = (
        f"<table:table-row>{CELL.format(20)}</table:table-row>"
        f'<table:table-row table:number-rows-repeated="1048575">{EMPTY}</table:table-row>'
    )
    check_sheets(document(tmp_path / "x.ods", rows))


def test_records_of_a_binary_sheet_are_looked_through(tmp_path: Path) -> None:
    def record(kind: int, number: int) -> bytes:
        return bytes([kind, 8]) + struct.pack("<II", number, 0)

    near = [record(0, 0), record(1, 0), record(0, 9), record(2, 3)]
    for records, most in (
        (near, None),
        ([*near, record(0, 1_048_575), record(5, 16_383)], "17179869184 cells"),
    ):
        data = b"\x81\x01\x00" + b"".join(records)
        path = zipped(tmp_path / "x.xlsb", [("xl/worksheets/sheet1.bin", data)])
        if most is None:
            check_sheets(path)
        else:
            with pytest.raises(ValueError, match=most):
                read_raw_table(path)


def test_settings_of_a_printer_are_no_sheet(tmp_path: Path) -> None:
    """Bytes that read as records of a sheet far down: Excel keeps a DEVMODE in every workbook
    that was printed."""
    far = (
        b"\x00\x08" + struct.pack("<II", 1_048_575, 0) + b"\x05\x08" + struct.pack("<II", 16_383, 0)
    )
    cells = b'<worksheet><sheetData><row r="1"><c r="A1"><v>1</v></c></row></sheetData></worksheet>'
    check_sheets(
        zipped(
            tmp_path / "x.xlsx",
            [("xl/worksheets/sheet1.xml", cells), ("xl/printerSettings/printerSettings1.bin", far)],
        )
    )


def test_a_long_sheet_is_read(tmp_path: Path) -> None:
    rows = b"".join(
        b'<row r="%d"><c r="A%d"><v>1</v></c><c r="J%d"><v>2</v></c></row>' % (k, k, k)
        for k in range(1, 50_000)
    )
    check_sheets(sheet(tmp_path / "x.xlsx", rows))


def test_ground_is_unpacked_no_further_than_it_says(tmp_path: Path) -> None:
    bits = base64.b64encode(zlib.compress(bytes(100 << 20), 9)).decode()
    told = {"west_m": 0.0, "south_m": 0.0, "cell_m": 0.25, "rows": 8, "columns": 8, "bits": bits}
    with pytest.raises(ValueError, match="10 bytes of cells for 8 x 8"):
        unpack_raster(told)
    with pytest.raises(ValueError, match="allowed up to 400000000"):
        unpack_raster(told | {"rows": 10**6, "columns": 10**6})
    path = tmp_path / "x.resume.json"
    for text in ("[" * 100_000, json.dumps({"format": resume.SNAPSHOT_FORMAT, "sums": 1e400})):
        path.write_text(text)
        with pytest.raises(ValueError, match="not a job that can go on"):
            resume.read_snapshot(path)


@pytest.mark.parametrize(
    "data", [b"Zeit;Men\\e\n1,5;2\r;2,5\n2,5;3\n", b"time_s,x\n1,2\n1e308,3\n-1e308,4\n"]
)
def test_what_a_fuzzer_found_is_one_line_or_read(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(data)
    try:
        read_raw_table(path)
    except Exception as said:
        assert "\n" not in str(said)


# -- few bytes that grow: each in a process of its own, for its reader might end this one
# ------------------------------


def grown(read: str, path: Path, seconds: float = 60.0, most_mb: int = 600) -> str:
    """The refusal of a file in a process of at most 2 GB, and within time and memory.

    The usual imports take some 250 MB of it; the time is for a busy machine. Its own high-water
    mark is asked: to `ru_maxrss` Linux counts what the process had that started it.
    """
    code = (
        f"import sys\nfrom pathlib import Path\n{read}\n"
        "try:\n    read(Path(sys.argv[1]))\nexcept Exception as said:\n    print(said)\n"
        "print(next(int(line.split()[1]) >> 10 for line in open('/proc/self/status') if "
        "line.startswith('VmHWM')))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        timeout=seconds,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30)),
        env={**os.environ, "POLARS_MAX_THREADS": "2", "OPENBLAS_NUM_THREADS": "1"},
    )
    assert ended.returncode == 0, ended.stderr[-500:]
    *said, mb = ended.stdout.splitlines()
    assert int(mb) < most_mb
    return "\n".join(said)


MAP = "from topdress.drivers.files.prescriptions.map_reader import read_prescription as read"
RAW = "from topdress.drivers.files.imports.table_reader import read_raw_table as read"


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        (
            {"width": 3000, "height": 3000, "count": 120, "blockxsize": 3008, "blockysize": 3008},
            "1080000000 cells: allowed up to 10000000 cells",
        ),
        (
            {"width": 100, "height": 100, "count": 1, "blockxsize": 16_000, "blockysize": 16_000},
            "a tile: 256000000 cells: allowed up to 10000000 cells",
        ),
    ],
)
def test_a_raster_is_held_to_its_cells_in_all_bands_and_to_its_tiles(
    tmp_path: Path, shape: dict[str, int], said: str
) -> None:
    """1132 bytes asked for 4 GB."""
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    with rasterio.open(
        tmp_path / "x.tif",
        "w",
        driver="GTiff",
        dtype="uint8",
        crs="EPSG:4326",
        tiled=True,
        nodata=0,
        sparse_ok=True,
        transform=rasterio.transform.from_origin(9, 52, 1e-6, 1e-6),
        **shape,
    ):
        pass
    assert said in grown(MAP, tmp_path / "x.tif")


def test_a_parquet_is_held_to_its_cells_before_it_is_unpacked(tmp_path: Path) -> None:
    """400 million zeros in 0.8 MB ended the program."""
    path = tmp_path / "x.parquet"
    pl.DataFrame({"a": np.zeros(60_000_000, dtype=np.int8)}).write_parquet(path, compression="zstd")
    assert "60000000 cells: allowed up to 50000000 cells" in grown(RAW, path)


def _varying(number: int) -> bytes:
    return bytes([number & 127 | 128]) + _varying(number >> 7) if number > 127 else bytes([number])


def test_a_parquet_whose_pages_are_larger_than_its_footer_says_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    pl.DataFrame({"a": np.arange(3000.0)}).write_parquet(path, compression="zstd")
    data = path.read_bytes()
    # the first page: kind, unpacked size
    head = re.match(rb"PAR1\x15.\x15[\x80-\xff]*[\0-\x7f]", data, re.DOTALL)
    assert head is not None
    path.write_bytes(data[:7] + _varying(2 * (2 << 30)) + data[head.end() :])  # zigzag
    assert "2048 MB: allowed up to 1024 MB" in grown(RAW, path)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"PAR1",
        b"PAR1" + b"\xff" * 100 + b"\x20\0\0\0PAR1",
        b"PAR1" + b"\x1c" * 64 + b"\x40\0\0\0PAR1",
        b"PAR1" + bytes(20) + b"\xff\xff\xff\x7fPAR1",
    ],
)
def test_a_footer_that_is_none_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"Parquet|no rows"):
        read_raw_table(path)


def test_parquets_of_many_kinds_are_read_as_before(tmp_path: Path) -> None:
    frame = pl.DataFrame(
        {
            "time_s": np.arange(5000.0),
            "text": [f"t{k % 7}" for k in range(5000)],
            "k": np.arange(5000, dtype=np.int32),
            "flag": [k % 2 == 0 for k in range(5000)],
        }
    )
    for compression in ("zstd", "snappy", "uncompressed", "gzip", "lz4"):
        for group in (100, 100_000):
            frame.write_parquet(
                tmp_path / "x.parquet", compression=compression, row_group_size=group
            )
            assert count_rows(read_raw_table(tmp_path / "x.parquet").columns) == 5000


def test_a_zip_of_many_task_files_is_opened_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its directory was read for each of 999 files, and each time that one was looked for."""
    opened = []
    monkeypatch.setattr(
        zipfile,
        "ZipFile",
        lambda *words, real=zipfile.ZipFile, **named: opened.append(words) or real(*words, **named),
    )
    entries = [
        (
            "TASKDATA.XML",
            b"<ISO11783_TaskData>"
            + b"".join(b'<XFR A="TSK%05d"/>' % k for k in range(999))
            + b"</ISO11783_TaskData>",
        ),
        *((f"TSK{k:05d}.XML", b"<XFC><TSK/></XFC>") for k in range(999)),
    ]
    path = zipped(tmp_path / "map.zip", entries)
    opened.clear()
    with pytest.raises(ValueError, match="no treatment zones"):
        read_prescription(path)
    assert len(opened) < 10


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        (
            [
                (
                    "TASKDATA.XML",
                    b"<ISO11783_TaskData>" + b"<a/>" * 3_000_000 + b"</ISO11783_TaskData>",
                )
            ],
            "allowed up to 2000000",
        ),
        (
            [
                (
                    "TASKDATA.XML",
                    b"<ISO11783_TaskData>"
                    + b"".join(b'<XFR A="TSK%05d"/>' % k for k in range(99))
                    + b"</ISO11783_TaskData>",
                ),
                *((f"TSK{k:05d}.XML", b"<XFC>" + b"<a/>" * 30_000 + b"</XFC>") for k in range(99)),
            ],
            "allowed up to 2000000",
        ),
        (
            [(f"{k}/TASKDATA.XML", b" " * (1 << 20)) for k in range(70)],
            "task files: 70 MB: allowed up to 64 MB",
        ),
    ],
)
def test_task_files_are_counted_together(
    tmp_path: Path, entries: list[tuple[str, bytes]], said: str
) -> None:
    assert said in grown(MAP, zipped(tmp_path / "map.zip", entries))


@pytest.mark.exam
@pytest.mark.parametrize("text", ["a: [" + "1," * 900_000 + "1]", "a:\n" + "- {k: 1}\n" * 200_000])
def test_yaml_is_counted_as_it_is_read(tmp_path: Path, text: str) -> None:
    path = tmp_path / "job.yaml"
    path.write_text(f"format: topdress-job/1\n{text}\n")
    read = (
        "from topdress.drivers.files.run_setup import load_by_kind\n"
        "read = lambda path: load_by_kind([str(path)])"
    )
    assert "nested too deeply or too large" in grown(read, path)


def _map(path: Path, rings: list[np.ndarray]) -> Path:
    return geojson(
        path, *(feature([ring.tolist()], rate_kg_ha=100 + k) for k, ring in enumerate(rings))
    )


PLACES = np.random.default_rng(1).random((3000, 2)) * 0.01 + (9.0, 52.0)
EDGES = np.column_stack((9.0 + 0.01 * (np.arange(20_000) % 2), 52.0 + 5e-7 * np.arange(20_000)))
SLANTED = np.column_stack((EDGES[:, 0], EDGES[:, 1] + EDGES[:, 0]))
LAID_OVER = [
    np.array([(9 + 1e-6 * k, 52), (9.01 + 1e-6 * k, 52), (9.01, 52.01), (9 + 1e-7 * k, 52.01)])
    for k in range(500)
]


@pytest.mark.parametrize(
    ("rings", "said"),
    [
        ([PLACES], "crossings: allowed up to 1000|pairs: allowed up to 2000000"),
        ([PLACES[60 * k : 60 * k + 60] for k in range(50)], "crossings: allowed up to 1000"),
        ([SLANTED], "pairs: allowed up to 2000000"),
        (LAID_OVER, "pairs: allowed up to 5000"),
    ],
    ids=["one", "many small", "long edges", "zones"],
)
def test_outlines_over_themselves_and_one_another_are_counted(
    tmp_path: Path, rings: list[np.ndarray], said: str
) -> None:
    """To put a ring of 3000 corners right took more than 200 s."""
    assert re.search(said, grown(MAP, _map(tmp_path / "x.geojson", rings)))


def test_an_outline_that_crosses_itself_a_few_times_is_read(tmp_path: Path) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    ring = np.column_stack((9.0 + 0.01 * np.cos(angle), 52.0 + 0.01 * np.sin(angle)))
    ring[::100] = ring[3::100]
    assert read_prescription(_map(tmp_path / "x.geojson", [ring])).data.zones


# --- What a refusal quotes of a file may hold ends of lines of every kind: it stays one line,
# and nothing else is raised.

ENDS = "\n\r\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"


def _zip(change: Callable[[bytes], bytes]) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr("x.xml", "<a/>")
    return change(made.getvalue())


def _nameless(packed: bytes) -> bytes:
    """The directory's entry has no name, which the library asks for its last letter."""
    at = packed.index(b"PK\x01\x02")
    entry = bytearray(packed[at:])
    entry[28:30] = b"\x00\x00"
    del entry[46:51]
    end = entry.index(b"PK\x05\x06")
    entry[end + 12 : end + 16] = (len(entry[:end])).to_bytes(4, "little")
    return packed[:at] + bytes(entry)


def _of_another_version(packed: bytes) -> bytes:
    at = packed.index(b"PK\x01\x02")
    return packed[: at + 6] + b"\xed\x00" + packed[at + 8 :]


def _of_spoilt_bytes(packed: bytes) -> bytes:
    """A task that says it is deflated, of bytes that are no such thing."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("TASKDATA/TASKDATA.XML", bytes(range(256)) * 9)
    spoilt = bytearray(made.getvalue())
    begin = spoilt.index(b"TASKDATA.XML") + len(b"TASKDATA.XML")
    spoilt[begin : begin + 40] = b"\xfd\x7f" * 20
    return bytes(spoilt)


def _job(path: Path) -> None:
    try:
        load_by_kind([str(path)])
    except ConfigError as error:
        assert all(line == join_lines(line) for line in error.lines)
        raise ValueError(error.lines[0]) from None


CASES = {
    "bench table": (
        ".csv",
        lambda end: f'"{end}x{end}"\n1,2\n'.encode(),
        lambda path: read_bench_table(path, None),
    ),
    "plants": (
        ".csv",
        lambda end: f"lat_deg,lon_deg\n34,1\nq{end}5,4\n".encode(),
        read_plant_places,
    ),
    "log": (".csv", lambda end: f"tim{end}e,b\n1,2\n".encode(), read_log),
    "job": (".yaml", lambda end: f'format: "topdress-j{end}{end}x"\n'.encode(), _job),
}


@pytest.mark.parametrize("end", ENDS, ids=lambda end: f"U+{ord(end):04X}")
@pytest.mark.parametrize("name", CASES)
def test_a_refusal_is_one_line_whatever_it_quotes(tmp_path: Path, name: str, end: str) -> None:
    suffix, content, read = CASES[name]
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content(end))
    with pytest.raises(ValueError) as refused:
        read(path)
    assert len(str(refused.value).splitlines()) == 1
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("change", [_nameless, _of_another_version, _of_spoilt_bytes])
def test_a_zip_of_which_the_library_falls_over_is_refused_in_a_line(
    tmp_path: Path, change: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / "x.zip"
    path.write_bytes(_zip(change))
    with pytest.raises(ValueError) as refused:
        read_prescription(path)
    assert len(str(refused.value).splitlines()) == 1 and str(path) in str(refused.value)


def test_one_line_leaves_the_words_and_takes_what_parts_or_steers() -> None:
    assert join_lines(f"a{ENDS}b\x1b[2Jc") in ("a b[2Jc", "ab[2Jc")
    assert join_lines("value x: allowed 1 to 5") == "value x: allowed 1 to 5"


# as the store of a run log (`drivers.files.log_store`), and as another program's file
@pytest.mark.parametrize("is_store", [True, False])
@pytest.mark.parametrize(
    ("columns", "rows", "said"),
    [
        ({"time_s": 1.0}, 60_000_000, "60000000 cells: allowed up to 50000000 cells"),
        ({"time_s": 1.0}, 20_000_000, "a byte: "),
        ({"time_s": 1.0, "events": 5_000 * "x"}, 300_000, "its texts: 1431 MB: allowed up to 1024"),
    ],
)
def test_a_small_parquet_that_is_large_when_it_is_read_is_refused(
    tmp_path, monkeypatch, columns, rows, said, is_store
):
    path, piece = tmp_path / "small.parquet", min(rows, 20_000_000)
    about = {
        "topdress": json.dumps({"format": "topdress-log-store/1", "meta": None, "findings": []})
    }
    made = [pl.Series(name, [value]).new_from_index(0, piece) for name, value in columns.items()]
    groups = 100 if "events" in columns else 1
    pl.DataFrame(made).write_parquet(
        path, row_group_size=piece // groups, statistics=False, metadata=about if is_store else None
    )
    if rows > piece:  # the footer claims more
        data = path.read_bytes()
        path.write_bytes(data.replace(whole(piece), whole(rows)))
    assert path.stat().st_size < 300_000
    with pytest.raises((BeyondLimits, TableError), match="allowed up to") as refused:
        read_log_store(path) if is_store else read_raw_table(path)
    assert said in str(refused.value) and "\n" not in str(refused.value)


def whole(number: int) -> bytes:
    """A whole number of Thrift's compact protocol."""
    left, found = number << 1, []
    while left > 127:
        found.append(left & 127 | 128)
        left >>= 7
    return bytes([*found, left])


def test_two_outlines_that_cross_everywhere_are_refused_at_once(tmp_path):
    """Of 29 kB; their ground took 45 s and 440 MB."""
    ways = [(0.002 * k / 499, 0.002 * (k % 2)) for k in range(499)]
    combs = [
        feature(
            [[[117.0 + pair[side], 40.0 + pair[1 - side]] for pair in (*ways, ways[0])]], rate=1.0
        )
        for side in (0, 1)
    ]
    path = geojson(tmp_path / "combs.geojson", *combs)
    with pytest.raises(BeyondLimits, match="crossings: allowed up to 20000 crossings"):
        read_prescription(path)


def chain(count: int, cell_deg: float, lat_deg: float = 40.0) -> np.ndarray:
    """The outline of squares that touch at their corners, as zones made of a raster have it."""
    there = np.repeat(np.arange(count + 1), 2)
    back = there[::-1]
    ring = np.concatenate(
        (np.column_stack((there[1:], there[:-1])), np.column_stack((back[1:], back[:-1]))[1:-1])
    )
    return np.asarray(ring * cell_deg + (117.0, lat_deg))


def test_outlines_that_touch_themselves_are_no_crossings(tmp_path: Path) -> None:
    """Two outlines of all cross, as a bow tie does."""
    bow = np.array([(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)]) * 3e-5
    rings = [chain(60, 3e-5, 40.0 + 0.002 * k) for k in range(60)]
    rings += [bow + np.array((lon_deg, 40.0)) for lon_deg in (117.1, 117.2)]
    read = read_prescription(_map(tmp_path / "x.geojson", rings))
    assert [one.rows for one in read.findings if one.id == "crossing"] == [2]
    # a degree at 40 to 40.12 degrees north, WGS84
    cell_ha = (3e-5 * 111_037.0) * (3e-5 * 85_320.0) / 1e4
    ha = sum(share.area_ha for share in calc_rate_shares(read.data))
    assert ha == pytest.approx(cell_ha * (60 * 60 + 2 * 0.5), rel=0.001)


def test_an_outline_that_touches_itself_everywhere_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BeyondLimits, match="10099 places: allowed up to 10000 places"):
        read_prescription(_map(tmp_path / "x.geojson", [chain(10_100, 1e-7)]))
