"""How are tables known, read and written: text, workbooks and Parquet?"""

from __future__ import annotations

import zipfile
from pathlib import Path

from topdress.drivers.files.formats.file_format import FileFormat, defer, list_zip_names
from topdress.drivers.files.limits import TEXT_LIMIT, WORKBOOK_LIMIT

# Largest workbook that a list of maps opens, because a workbook is read whole, bytes.
MAX_LISTED_BYTES = 2_000_000
# A triangle of 120 kg/ha.
EXAMPLE_TABLE = 'rate_kg_ha,wkt\n120,"POLYGON((120 33,120 33.001,120.001 33.001,120 33))"\n'


# The least parts of a workbook with one sheet.
_OFFICE = "http://schemas.openxmlformats.org"
_MAIN, _PACKAGE = f"{_OFFICE}/spreadsheetml/2006/main", f"{_OFFICE}/package/2006"
_RELATIONS = f"{_OFFICE}/officeDocument/2006/relationships"
_TYPE = "application/vnd.openxmlformats-officedocument.spreadsheetml"
_WORKBOOK_PARTS = {
    "[Content_Types].xml": f'<Types xmlns="{_PACKAGE}/content-types"><Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    f'<Override PartName="/xl/workbook.xml" ContentType="{_TYPE}.sheet.main+xml"/>'
    f'<Override PartName="/xl/sheet.xml" ContentType="{_TYPE}.worksheet+xml"/></Types>',
    "_rels/.rels": f'<Relationships xmlns="{_PACKAGE}/relationships"><Relationship Id="r1" '
    f'Type="{_RELATIONS}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
    "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{_PACKAGE}/relationships">'
    f'<Relationship Id="r1" Type="{_RELATIONS}/worksheet" Target="sheet.xml"/></Relationships>',
    "xl/workbook.xml": f'<workbook xmlns="{_MAIN}" xmlns:r="{_RELATIONS}"><sheets>'
    '<sheet name="rates" sheetId="1" r:id="r1"/></sheets></workbook>',
}


def write_workbook(path: Path) -> None:
    """Writes sixteen places of 120 kg/ha as a workbook. Raises OSError."""
    rows: list[tuple[str | float, ...]] = [("lat", "lon", "rate_kg_ha")]
    rows += [(33.0 + 1e-4 * (k // 4), 120.0 + 1.2e-4 * (k % 4), 120.0) for k in range(16)]
    cells = "".join("<row>" + "".join(map(_format_cell, row)) + "</row>" for row in rows)
    sheet = f'<worksheet xmlns="{_MAIN}"><sheetData>{cells}</sheetData></worksheet>'
    with zipfile.ZipFile(path, "w") as book:
        for name, text in (_WORKBOOK_PARTS | {"xl/sheet.xml": sheet}).items():
            book.writestr(name, text)


def _format_cell(value: str | float) -> str:
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
    return f"<c><v>{value}</v></c>"


def is_workbook(path: Path, head: bytes) -> bool:
    """Returns whether a file is an old workbook, or a zip with the parts of a new one."""
    names = list_zip_names(path, head)
    return head.startswith(b"\xd0\xcf\x11\xe0") or any(
        name.parts[:1] == ("xl",) or str(name) == "content.xml" for name in names
    )


def write_log(path: Path) -> None:
    """Writes a log of two rows as Parquet. Raises ValueError without the extra parquet."""
    import numpy as np
    from topdress.drivers.files.log_store import write_log_store

    write_log_store(path, {"time_s": np.array([0.0, 0.1]), "shaft_rpm": np.full(2, 60.0)}, None)


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
    read_table=defer("imports.text_table", "read_text_table"),
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
    make_example=write_workbook,
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
    make_example=write_log,
)
FORMATS = (TEXT, WORKBOOK, PARQUET)
