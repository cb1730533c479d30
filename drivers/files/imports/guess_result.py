"""What does a guess contain? It has the import file, its doubts and its reasons, and it is written
as text.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.drivers.files.imports.mapping import IMPORT_KIND, Column, ImportFile
from topdress.drivers.files.imports.units import ColumnUnit
from topdress.drivers.files.plain_data import convert_to_plain
from topdress.drivers.files.yaml_text import dump_yaml

# Path of keys in an import file.
ImportKey = tuple[str, ...]

# Columns of each command with its reading.
COMMAND_PAIRS = (
    ("shaft_rpm_cmd", "shaft_rpm"),
    ("opening_mm_cmd", "opening_mm"),
    ("target_rate_kg_ha", "applied_rate_kg_ha"),
)


class ImportDoubt(NamedTuple):
    """Holds a doubt. `key` is the key of the import file, `text` the reason of the doubt."""

    key: ImportKey
    text: str

    def __str__(self) -> str:
        return f"{'.'.join(self.key)}: {self.text}"


@dataclass
class ImportGuess:
    """Holds an import file with its doubts. `reasons` explains each key. `open` holds columns that
    need a number from outside of the file, as YAML text. `full` is the largest value of a column by
    the machine file, in the log's unit."""

    mapping: ImportFile
    doubts: list[ImportDoubt] = field(default_factory=list)
    reasons: dict[ImportKey, str] = field(default_factory=dict)
    open: dict[str, str] = field(default_factory=dict)
    full: Mapping[str, float] = field(default_factory=dict)
    # Working width, m; None where the file states none.
    width_m: float | None = None

    @property
    def is_sure(self) -> bool:
        """Whether no key is doubtful."""
        return not self.doubts

    @property
    def questions(self) -> tuple[str, ...]:
        """The open questions, one line each."""
        return tuple(map(str, self.doubts))

    @property
    def unsure(self) -> str:
        """The number of doubtful lines, in words."""
        count = len(self.doubts)
        return (
            "nothing is unsure"
            if count == 0
            else f"{count} {'line is' if count == 1 else 'lines are'} unsure"
        )


@dataclass
class ColumnCandidate:
    """Holds a column of the file (`source`) that may be a column of the log (`target`). `values`
    are unchanged numbers of the file."""

    source: str
    target: str
    unit: ColumnUnit | None
    # Whether the name contains the unit.
    implied: bool = False
    # Role by the name: command, reading, or empty without a word.
    role: str = ""
    exact: bool = False
    values: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def rank_key(self) -> tuple[bool, bool, bool]:
        """Sort key of candidates: the log's own name, a unit, a role."""
        return self.exact, self.unit is not None or self.implied, self.role != ""


def format_first_import(guess: ImportGuess, files: Sequence[Path], place: Path) -> str:
    """Returns the import file that was guessed from the first of `files`, with the command that
    uses it at its head; `place` is where it is saved."""
    return format_mapping(
        guess,
        [
            f"Guessed from {files[0].name}: {guess.unsure}. The keys: docs/import.md.",
            f"Then: topdress import {shlex.join(path.name for path in files)} --mapping "
            f"{shlex.quote(place.name)} "
            "--out LOG.csv",
        ],
    )


def format_mapping(guess: ImportGuess, head: Iterable[str]) -> str:
    """Returns the import file as YAML with doubts and reasons as comments; it reads back as the
    guess's own mapping."""
    mapping = guess.mapping
    lines = [f"# {line}" for line in head]
    lines += [
        f"format: {IMPORT_KIND.format}",
        "",
        *_format_doubts(guess, ("source", "names"), 0),
        "source:",
        *_format_pairs(_drop_empty_keys(convert_to_plain(mapping.source)), 2),
    ]
    lines += [
        "",
        *_format_doubts(guess, ("time",), 0),
        "time:" + _format_reason(guess, ("time",)),
        *_format_pairs(_drop_empty_keys(convert_to_plain(mapping.time)), 2),
    ]
    if mapping.time.zone is None and mapping.time.counts in ("text", "excel_day"):
        lines.append(
            "  # zone: Europe/Berlin     (times without a zone: the log then tells no UTC)"
        )
    lines += [
        "",
        *_format_doubts(guess, ("columns",), 0),
        "columns:" + ("" if mapping.columns or guess.open else " {}"),
    ]
    for name, column in mapping.columns.items():
        key = ("columns", name)
        lines += [
            *_format_doubts(guess, key, 2),
            f"  {name}:{_format_reason(guess, key)}",
            *_format_pairs(_list_column_keys(column), 4),
        ]
    for name, text in guess.open.items():
        lines += [*_format_doubts(guess, ("columns", name), 2), f"  # {name}: {text}"]
    if mapping.working is not None:
        lines += [
            "",
            *_format_doubts(guess, ("working",), 0),
            "working:" + _format_reason(guess, ("working",)),
            *_format_pairs(_drop_empty_keys(convert_to_plain(mapping.working)), 2),
        ]
    if mapping.width_m is not None:
        lines += ["", f"width_m: {mapping.width_m:g}"]
    lines += [
        "",
        *_format_doubts(guess, ("rows",), 0),
        f"rows: {mapping.rows}",
        f"extra: {mapping.extra}",
    ]
    return "\n".join(lines) + "\n"


def _list_column_keys(column: Column) -> dict[str, Any]:
    usual = convert_to_plain(Column.from_source("x"))
    return {
        key: value
        for key, value in convert_to_plain(column).items()
        if key == "from" or value != usual[key]
    }


def _drop_empty_keys(data: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if value not in (None, [])}


def _format_pairs(data: dict[str, Any], indent: int) -> list[str]:
    """Returns keys and values as indented lines of YAML."""
    return [
        " " * indent + line
        for key, value in data.items()
        for line in dump_yaml({key: value}).splitlines()
    ]


def _format_doubts(guess: ImportGuess, key: ImportKey, indent: int) -> list[str]:
    return [f"{' ' * indent}# unsure: {doubt.text}" for doubt in guess.doubts if doubt.key == key]


def _format_reason(guess: ImportGuess, key: ImportKey) -> str:
    """Returns a comment with a key's reason, except for a doubtful key."""
    doubtful = any(doubt.key == key for doubt in guess.doubts)
    return f"     # {guess.reasons[key]}" if key in guess.reasons and not doubtful else ""
