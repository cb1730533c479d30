"""What the sheets of a workbook span, found out before its reader makes all their cells, empty ones too."""
from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path

from drivers.files.limits import CELLS, MB, held_to


def check_sheets(path: Path) -> None:
    """The cells that a sheet spans, which its reader makes all, empty ones too. Raises BeyondLimits."""
    if path.suffix.lower() not in (".xlsx", ".xlsm") or not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if info.filename.startswith("xl/worksheets/") and info.filename.endswith(".xml"):
                with archive.open(info) as sheet:
                    held_to(CELLS, _spanned(iter(lambda: sheet.read(4 * MB), b"")), f"{path}: {info.filename}")


def _spanned(chunks: Iterator[bytes]) -> int:
    """Rows times columns, as far as the references of rows and cells say; a little more than there are."""
    columns: set[bytes] = set()
    last_row, rows, rest = 0, 0, b""
    for chunk in chunks:
        text = rest + chunk
        columns.update(re.findall(rb'\br="([A-Z]{1,9})\d', text))
        rows += text.count(b"<row")
        told = re.findall(rb'<row[^>]{0,200}?\br="(\d{1,9})"', text)
        last_row = max(last_row, max(map(int, told), default=0))
        odd = re.findall(rb'\br="[A-Z]{1,9}(\d{6,12})"', text)          # far down, whatever its row says
        last_row = max(last_row, max(map(int, odd), default=0))
        rest = text[-300:]
    return max(last_row, rows) * max((_column(name) for name in columns), default=0)


def _column(name: bytes) -> int:
    number = 0
    for letter in name:
        number = number * 26 + letter - 64
    return number
