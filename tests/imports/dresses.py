"""Deals dresses that people and their programs put over a table, and holds what is imported
against the truth.

The log is the one of `dialects.py`, in a plain table whose header names every unit. What is
dealt is what stands around and between the numbers: quotes, ends of rows, blank rows, a header
again, a footer of totals, thousands, clocks of 12 hours, the order of day and month, sheets of
a book. Each must come in as the truth, or be asked about or refused with nothing written; what
came in as anything else is wrong.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import numpy.typing as npt
from topdress.drivers.files.read_log import read_log

from tests.command import topdress
from tests.imports import dialects as D

Floats = npt.NDArray[np.float64]
COLUMNS = (
    "lat_deg",
    "lon_deg",
    "speed_mps",
    "shaft_rpm_cmd",
    "shaft_rpm",
    "opening_mm_cmd",
    "opening_mm",
    "hopper_kg",
    "supply_v",
    "target_rate_kg_ha",
    "applied_rate_kg_ha",
)
TIMES = (
    "seconds",
    "iso_z",
    "iso_offset",
    "unix_s",
    "unix_ms",
    "ampm",
    "ampm_seconds",
    "month_first",
    "day_first",
    "day_first_short",
    "compact",
    "german",
)
# no zone is told
LOCAL = ("ampm", "ampm_seconds", "month_first", "day_first", "day_first_short", "compact", "german")
DAYS = {"sure": dt.datetime(2026, 3, 17, 14, 30), "unsure": dt.datetime(2026, 3, 7, 11, 59, 40)}
BETWEEN = (
    "nothing",
    "blank rows",
    "rows of delimiters",
    "header again",
    "a note",
    "a comment sign",
)
FOOTERS = ("none", "total", "totals and mean", "a sentence", "a signature")
QUOTES = ("where needed", "all", "texts", "numbers")
ENDS = ("\n", "\r\n", "mixed")
NOTES = (["Notes"], ["Field", "North"], ["Operator", "J. Smith"], ["Area", 12.5])
FIRST = {"notes first": NOTES, "hidden notes": NOTES, "empty first": ()}
SHEETS = (
    "one",
    "notes first",
    "notes last",
    "merged title",
    "chart name",
    "two logs",
    "empty first",
    "hidden notes",
)


@dataclass(frozen=True)
class Dress:
    number: int
    kind: str  # text or excel
    language: str
    columns: tuple[str, ...]
    units: dict[str, str]
    time: str
    day: str
    delimiter: str
    comma: bool
    encoding: str
    titles: int
    unit_row: bool
    quotes: str
    trailing: bool  # a delimiter after the last cell of each row
    between: str
    footer: str
    thousands: str  # sign that groups digits, "": none
    end: str
    sheets: str
    last_end: bool  # whether the last line ends


def dress(number: int, seed: int = 1) -> Dress:
    rng = np.random.default_rng([seed, 77, number])

    def one(choices: Any) -> Any:
        return list(choices)[int(rng.integers(len(list(choices))))]

    kind = one(("text",) * 3 + ("excel",))
    language = one(("en", "de", "zh"))
    delimiter = one(",;;\t|")
    comma = bool(delimiter != "," and rng.random() < 0.5)
    encodings = {
        "en": ("utf-8", "utf-8-sig", "utf-16", "cp1252"),
        "de": ("utf-8-sig", "utf-16", "cp1252", "utf-8"),
        "zh": ("utf-8-sig", "utf-16", "gbk", "gb18030"),
    }[language]
    kept = [
        name for name in COLUMNS if rng.random() < 0.8 or name in ("shaft_rpm_cmd", "shaft_rpm")
    ]
    if ("lat_deg" in kept) != ("lon_deg" in kept):
        kept = [name for name in kept if name not in ("lat_deg", "lon_deg")]
    units = {name: one(D.UNITS[name]) for name in kept}
    signs = ((".", " ", "'", "") if comma else (",", " ", "'", "")) if rng.random() < 0.4 else ("",)
    return Dress(
        number,
        kind,
        language,
        tuple(kept),
        units,
        one(TIMES),
        one(("sure", "sure", "unsure")),
        delimiter,
        comma,
        one(encodings),
        int(rng.integers(0, 4)),
        bool(rng.random() < 0.4),
        one(QUOTES),
        bool(rng.random() < 0.2),
        one(BETWEEN),
        one(FOOTERS),
        one(signs),
        one(ENDS),
        one(SHEETS),
        bool(rng.random() < 0.8),
    )


def times(of: Dress, t: Floats) -> tuple[str, list[str]]:
    """Unit and cells."""
    begin = DAYS[of.day]
    local = [begin + dt.timedelta(seconds=float(s)) for s in t]
    zone = ZoneInfo(D.ZONE)
    utc = [moment.replace(tzinfo=zone).astimezone(dt.UTC) for moment in local]
    unix = utc[0].timestamp()
    dot = "," if of.comma and of.kind == "text" else "."
    return {
        "seconds": ("s", [f"{s:.2f}".replace(".", dot) for s in t]),
        "iso_z": ("", [f"{m:%Y-%m-%dT%H:%M:%S}.{D._ms(m)}Z" for m in utc]),
        "iso_offset": ("", [f"{m:%Y-%m-%dT%H:%M:%S}.{D._ms(m)}+08:00" for m in local]),
        "unix_s": ("", [f"{unix + s:.3f}".replace(".", dot) for s in t]),
        "unix_ms": ("", [str(round(1000 * (unix + s))) for s in t]),
        "ampm": ("", [f"{m:%m/%d/%Y %I:%M:%S}.{D._ms(m)} {m:%p}" for m in local]),
        "ampm_seconds": (
            "",
            [f"{m.month}/{m.day}/{m.year} {int(m.strftime('%I'))}:{m:%M:%S %p}" for m in local],
        ),
        "month_first": ("", [f"{m:%m/%d/%Y %H:%M:%S}.{D._ms(m)}" for m in local]),
        "day_first": ("", [f"{m:%d/%m/%Y %H:%M:%S}.{D._ms(m)}" for m in local]),
        "day_first_short": ("", [f"{m:%d-%m-%y %H:%M:%S}.{D._ms(m)}" for m in local]),
        "compact": ("", [f"{m:%Y%m%d%H%M%S}{dot}{D._ms(m)}" for m in local]),
        "german": ("", [f"{m.day}.{m.month}.{m.year} {m:%H:%M:%S}{dot}{D._ms(m)}" for m in local]),
    }[of.time]


def rows_of(
    of: Dress, truth: dict[str, Floats]
) -> tuple[list[str], list[str], list[list[str]], Floats]:
    """Header, units, rows of texts, and which of the truth's rows they are (a clock of whole
    seconds keeps a tenth)."""
    kept = np.arange(0, D.ROWS, 10) if of.time == "ampm_seconds" else np.arange(D.ROWS)
    unit, cells = times(of, truth["time_s"][kept])
    names, units, columns = [D.TIME_NAMES[of.language][0]], [unit], [cells]
    for name in of.columns:
        values = truth[name][kept] * D.UNITS[name][of.units[name]]
        texts = [f"{value:.{D.DIGITS.get(name, 4)}f}" for value in values]
        names.append(D.NAMES[name][of.language][0])
        units.append(of.units[name])
        columns.append([_written(text, of) for text in texts])
    return names, units, [list(row) for row in zip(*columns, strict=True)], kept.astype(np.float64)


def _written(text: str, of: Dress) -> str:
    if of.kind == "excel":
        return text
    whole, _dot, part = text.partition(".")
    sign, digits = ("-", whole[1:]) if whole.startswith("-") else ("", whole)
    if of.thousands:
        groups = []
        while len(digits) > 3:
            groups.insert(0, digits[-3:])
            digits = digits[:-3]
        digits = of.thousands.join([digits, *groups])
    return f"{sign}{digits}{',' if of.comma else '.'}{part}" if part else f"{sign}{digits}"


def footer(of: Dress, width: int) -> list[list[str]]:
    rest = [""] * (width - 2)
    return {
        "none": [],
        "total": [[{"en": "Total", "de": "Summe", "zh": "合计"}[of.language], "123", *rest]],
        "totals and mean": [
            ["Total", "4711", *(["9.5"] * (width - 2))],
            ["Mean", "11", *(["0.5"] * (width - 2))],
        ],
        "a sentence": [["End of report, printed by the terminal"]],
        "a signature": [[], ["Signed:", "J. Smith"]],
    }[of.footer]


def body(of: Dress, names: list[str], units: list[str], rows: list[list[str]]) -> list[list[str]]:
    """All rows of the file, with what stands between."""
    out: list[list[str]] = [[title] for title in D.TITLES[of.language][: of.titles]]
    head = (
        names
        if of.unit_row
        else [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
    )
    out.append(head)
    if of.unit_row:
        out.append(units)
    for k, row in enumerate(rows):
        if k and k % 17 == 0:
            out += {
                "blank rows": [[]],
                "rows of delimiters": [[""] * len(names)],
                "header again": [head] if k == 17 else [],
                "a note": [["refilled here"]] if k == 17 else [],
                "a comment sign": [["# the tractor stopped"]] if k == 17 else [],
            }.get(of.between, [])
        out.append(row)
    return out + footer(of, len(names))


def write(of: Dress, truth: dict[str, Floats], folder: Path) -> tuple[Path, Floats]:
    names, units, rows, kept = rows_of(of, truth)
    every = body(of, names, units, rows)
    if of.kind == "excel":
        return _book(of, every, folder), kept
    last = of.delimiter if of.trailing else ""
    lines = [
        of.delimiter.join(_quoted(cell, of) for cell in row) + (last if len(row) > 1 else "")
        for row in every
    ]
    ends = [
        "\r\n" if of.end == "\r\n" or (of.end == "mixed" and k % 3 == 0) else "\n"
        for k in range(len(lines))
    ]
    text = "".join(line + end for line, end in zip(lines, ends, strict=True))
    path = folder / f"dress{of.number}.csv"
    path.write_bytes(
        (text if of.last_end else text.rstrip("\r\n")).encode(of.encoding, errors="replace")
    )
    return path, kept


def _quoted(cell: str, of: Dress) -> str:
    number = cell[:1].isdigit() or cell[:1] == "-"
    if (
        of.delimiter in cell
        or of.quotes == "all"
        or (of.quotes == "numbers" and number)
        or (of.quotes == "texts" and not number and cell)
    ):
        return f'"{cell}"'
    return cell


def _book(of: Dress, every: list[list[str]], folder: Path) -> Path:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    if of.sheets in FIRST:
        for note in FIRST[of.sheets]:
            sheet.append(note)
        sheet.sheet_state = "hidden" if of.sheets == "hidden notes" else "visible"
        sheet = book.create_sheet("Data")
        book.active = 1
    if of.sheets == "merged title":
        sheet.append(["Machine report of the north field"])
        sheet.merge_cells(start_row=1, start_column=1, end_row=1, end_column=5)
    for row in every:
        sheet.append([D._value(cell) for cell in row])
    if of.sheets in ("notes last", "two logs"):
        other = book.create_sheet("Second")
        for row in every if of.sheets == "two logs" else NOTES:
            other.append([D._value(str(cell)) for cell in row])
    path = folder / f"dress{of.number}.xlsx"
    book.save(path)
    return path


def problems(of: Dress, truth: dict[str, Floats], folder: Path) -> tuple[str, list[str]]:
    """What became of it (imported, asked, refused, wrong, broken), and what is to say of it."""
    source, kept = write(of, truth, folder)
    out = folder / f"out{of.number}.csv"
    done = topdress("import", source, "--out", out)
    lines = done.output.splitlines()
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        return "broken", [repr(done.exception)]
    if done.exit_code != 0:
        if out.exists() or out.with_suffix(".yaml").exists() or not lines:
            return "wrong", ["refused, but something was written, or nothing said"]
        return ("asked" if "--guess" in done.output else "refused"), lines[:1]
    if of.time in LOCAL and of.day == "unsure" and of.time not in ("compact", "german"):
        return "wrong", ["imported, though day and month can be taken for one another"]
    found = _against(of, truth, out, kept.astype(np.int64))
    return ("wrong" if found else "imported"), found


def _against(
    of: Dress, truth: dict[str, Floats], out: Path, kept: npt.NDArray[np.int64]
) -> list[str]:
    log = read_log(out)
    if len(log) != len(kept):
        return [f"{len(log)} rows of {len(kept)}"]
    want_s = truth["time_s"][kept] - truth["time_s"][kept][0]
    wrong = []
    if np.abs(log.time_s - want_s).max() > 1.1e-3:
        wrong.append(f"time_s off by {np.abs(log.time_s - want_s).max():g} s")
    for name in of.columns:
        wrong += D.column_wrong(name, of.units[name], log.numbers(name), truth[name][kept])
    return wrong
