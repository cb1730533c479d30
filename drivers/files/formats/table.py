"""How are tables known, read and written: text, workbooks and Parquet?"""

from __future__ import annotations

from pathlib import Path

from topdress.drivers.files.formats.file_format import FileFormat, defer, list_zip_names
from topdress.drivers.files.limits import TEXT_LIMIT, WORKBOOK_LIMIT

# Largest workbook that a list of maps opens, because a workbook is read whole, bytes.
MAX_LISTED_BYTES = 2_000_000
# A triangle of 120 kg/ha.
EXAMPLE_TABLE = 'rate_kg_ha,wkt\n120,"POLYGON((120 33,120 33.001,120.001 33.001,120 33))"\n'


def is_workbook(path: Path, head: bytes) -> bool:
    """Returns whether a file is an old workbook, or a zip with the parts of a new one."""
    names = list_zip_names(path, head)
    return head.startswith(b"\xd0\xcf\x11\xe0") or any(
        name.parts[:1] == ("xl",) or str(name) == "content.xml" for name in names
    )


def is_map_table(path: Path) -> bool:
    """Returns whether a .csv or a small workbook has polygons, or places without a time. Raises
    OSError, ValueError."""
    from topdress.drivers.files.file_content import FileContent

    text = path.suffix.lower() in TEXT.endings
    listed = path.suffix.lower() == ".csv" if text else path.stat().st_size <= MAX_LISTED_BYTES
    return listed and FileContent(path).content_kind == "map"


TEXT = FileFormat(
    id="text",
    words="a text",
    title="CSV",
    endings=(".csv", ".tsv", ".txt", ".log", ".dat"),
    rank=70,
    written=(".csv",),
    is_table=True,
    limit=TEXT_LIMIT,
    source_kind="text",
    is_map_likely=is_map_table,
    read_map=defer("prescriptions.map_reader", "read_table_map"),
    read_table=defer("imports.text", "read_text_table"),
    write_export=defer("exports.export_writer", "write_export_csv"),
    make_example=lambda path: path.write_text(EXAMPLE_TABLE),
)
WORKBOOK = FileFormat(
    id="excel",
    words="a workbook",
    title="Excel",
    endings=(".xlsx", ".xlsm", ".xls", ".xlsb", ".ods"),
    rank=71,
    is_table=True,
    limit=WORKBOOK_LIMIT,
    source_kind="excel",
    more_commands=("diagnose",),
    is_content=is_workbook,
    is_map_likely=is_map_table,
    read_map=defer("prescriptions.map_reader", "read_table_map"),
    read_table=defer("imports.excel", "read_excel"),
)
PARQUET = FileFormat(
    id="parquet",
    words="a Parquet file",
    title="Parquet",
    endings=(".parquet", ".pq"),
    rank=72,
    source_kind="parquet",
    more_commands=("diagnose", "replay"),
    is_content=lambda path, head: head.startswith(b"PAR1"),
    read_table=defer("imports.table_reader", "read_parquet_table"),
)
FORMATS = (TEXT, WORKBOOK, PARQUET)
