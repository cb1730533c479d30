"""How is a log row written as a line of text? Every column has its own number of decimals, and no
text may break the line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from topdress.control.log_row import (
    ALL_COLUMNS,
    COLUMNS,
    DECIMALS,
    EXACT_COLUMNS,
    TEXT_COLUMNS,
    WHOLE_COLUMNS,
    LogRow,
)

# Header of a log without section valves.
LOG_HEADER = ",".join(COLUMNS) + "\n"

# Largest length of a written line, bytes: half of the bytes in which a reader searches the
# beginning of the last line.
MAX_ROW_BYTES = 32_768
# Number of characters that each text of a longer line keeps; all texts together then fit.
MAX_CUT_CELL_CHARACTERS = 1_000
# Largest number of bytes of a character in UTF-8.
MAX_CHARACTER_BYTES = 4
# This mark ends a text that was cut.
CUT_MARK = "..."
# Decimals of time_s where two rows fall into the same millisecond.
_CLOSE_TIME_DECIMALS = 6
# This format takes its value and prints nothing.
_EMPTY_FORMAT = "%.0s"


def _find_number_form(column: str) -> str:
    if column in EXACT_COLUMNS or column in TEXT_COLUMNS:
        return "%s"
    return "%d" if column in WHOLE_COLUMNS else f"%.{DECIMALS[column]}f"


def format_values(column: str, values: Sequence[float]) -> list[str | None]:
    """Returns every value of a column (n,) as a log's row shows it; None for unknown. A value with
    more digits than its column has the shortest text that reads back as the same number."""
    numbers = list(filter(math.isfinite, values))
    texts = list(map(repr, numbers))
    if column in ALL_COLUMNS and column not in EXACT_COLUMNS | TEXT_COLUMNS:
        close = (f"%.{_CLOSE_TIME_DECIMALS}f",) if column == "time_s" else ()
        for form in (*close, _find_number_form(column)):
            made = ((form + "\n") * len(numbers) % tuple(numbers)).split("\n")[:-1]
            texts = [
                new if float(new) == number else old
                for new, old, number in zip(made, texts, numbers, strict=True)
            ]
    found = iter(texts)
    return [next(found) if math.isfinite(one) else None for one in values]


def find_log_columns(machine: Mapping[str, Any] | None) -> tuple[str, ...]:
    """Returns the columns of a machine's logs, the first of `ALL_COLUMNS`; the machine is plain
    data."""
    sections = (machine or {}).get("sections")
    valved = isinstance(sections, list | tuple) and any(
        isinstance(section, Mapping) and section.get("valve") is not None for section in sections
    )
    return ALL_COLUMNS if valved else COLUMNS


def format_header(columns: tuple[str, ...]) -> str:
    """Returns the header line."""
    return ",".join(columns) + "\n"


class RowText:
    """Turns rows into lines. It remembers the last time written, and a template for each set of
    unknown columns. `columns` are the first of `ALL_COLUMNS`; cells beyond them are omitted."""

    def __init__(self, columns: tuple[str, ...] = COLUMNS) -> None:
        self._forms = tuple(_find_number_form(column) for column in columns)
        self._templates: dict[tuple[bool, ...], str] = {}
        self._last_time = ""

    def line(self, row: LogRow) -> str:
        """Returns a row as a line with its line end.

        Numbers that are not finite are unknown; line breaks in texts become spaces. Texts of a line
        that is too long for readers are cut to `MAX_CUT_CELL_CHARACTERS`.

        Raises
        ------
        TypeError : a number's column holds a text.
        """
        line = self._format_cells(row[: len(self._forms)])
        if (
            len(line) > MAX_ROW_BYTES // MAX_CHARACTER_BYTES
            and len(line.encode(errors="replace")) > MAX_ROW_BYTES
        ):
            line = self._format_cells(
                tuple([_cut_long_text(value) for value in row[: len(self._forms)]])
            )
        time, comma, rest = line.partition(",")
        if time == self._last_time:
            return f"{row.time_s:.{_CLOSE_TIME_DECIMALS}f}{comma}{rest}"
        self._last_time = time
        return line

    def _format_cells(self, cells: tuple[float | str | None, ...]) -> str:
        unknown = tuple([value is None for value in cells])
        template = self._templates.get(unknown)
        if template is None:
            template = (
                ",".join(
                    _EMPTY_FORMAT if u else form
                    for u, form in zip(unknown, self._forms, strict=True)
                )
                + "\n"
            )
            self._templates[unknown] = template
        line = template % cells
        if not _is_plain_line(line, len(self._forms)):
            line = (
                ",".join(
                    [
                        _format_cell(value, form)
                        for value, form in zip(cells, self._forms, strict=True)
                    ]
                )
                + "\n"
            )
        return line


def _cut_long_text(value: float | str | None) -> float | str | None:
    if isinstance(value, str) and len(value) > MAX_CUT_CELL_CHARACTERS:
        return value[: MAX_CUT_CELL_CHARACTERS - len(CUT_MARK)] + CUT_MARK
    return value


def _is_plain_line(line: str, columns: int) -> bool:
    return (
        line.count(",") == columns - 1
        and line.count("\n") == 1
        and "nan" not in line
        and "inf" not in line
        and '"' not in line
        and "\r" not in line
        and "\0" not in line
    )


def _format_cell(value: float | str | None, form: str) -> str:
    """Returns a cell as text, quoted where needed."""
    if value is None:
        return ""
    if isinstance(value, str):
        text = value.replace("\r", " ").replace("\n", " ").replace("\0", " ")
        return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text
    return form % value if math.isfinite(value) else ""
