"""A guessed import file as text: what is unsure has a comment above it that says why, what is sure one next to it."""
from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from drivers.files.imports.guessed import Guess, Key
from drivers.files.imports.mapping import IMPORT, Column
from drivers.files.plain import plain
from drivers.files.yaml_text import dump_yaml


def first_import_file(guess: Guess, files: Sequence[Path], place: Path) -> str:
    """The guess from the first of `files` as it is written at `place`, with how it is used."""
    return mapping_text(guess, [
        f"Guessed from {files[0].name}: {guess.unsure}. The keys: docs/import.md.",
        f"Then: topdress import {shlex.join(path.name for path in files)} --mapping {shlex.quote(place.name)} "
        "--out LOG.csv"])


def mapping_text(guess: Guess, head: Iterable[str]) -> str:
    """Reads back as the guess's own mapping."""
    mapping = guess.mapping
    lines = [f"# {line}" for line in head]
    lines += [f"format: {IMPORT.format}", "", *_doubts(guess, ("source", "names"), 0), "source:",
              *_pairs(_stated(plain(mapping.source)), 2)]
    lines += ["", *_doubts(guess, ("time",), 0), "time:" + _reason(guess, ("time",)),
              *_pairs(_stated(plain(mapping.time)), 2)]
    if mapping.time.zone is None and mapping.time.counts in ("text", "excel_day"):
        lines.append("  # zone: Europe/Berlin     (times without a zone: the log then tells no UTC)")
    lines += ["", *_doubts(guess, ("columns",), 0), "columns:" + ("" if mapping.columns or guess.open else " {}")]
    for name, column in mapping.columns.items():
        key = ("columns", name)
        lines += [*_doubts(guess, key, 2), f"  {name}:{_reason(guess, key)}", *_pairs(_column(column), 4)]
    for name, text in guess.open.items():
        lines += [*_doubts(guess, ("columns", name), 2), f"  # {name}: {text}"]
    if mapping.working is not None:
        lines += ["", *_doubts(guess, ("working",), 0), "working:" + _reason(guess, ("working",)),
                  *_pairs(_stated(plain(mapping.working)), 2)]
    if mapping.width_m is not None:
        lines += ["", f"width_m: {mapping.width_m:g}"]
    lines += ["", *_doubts(guess, ("rows",), 0), f"rows: {mapping.rows}", f"extra: {mapping.extra}"]
    return "\n".join(lines) + "\n"


def _column(column: Column) -> dict[str, Any]:
    usual = plain(Column.of("x"))
    return {key: value for key, value in plain(column).items() if key == "from" or value != usual[key]}


def _stated(data: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if value not in (None, [])}


def _pairs(data: dict[str, Any], indent: int) -> list[str]:
    return [" " * indent + line for key, value in data.items() for line in dump_yaml({key: value}).splitlines()]


def _doubts(guess: Guess, key: Key, indent: int) -> list[str]:
    return [f"{' ' * indent}# unsure: {doubt.text}" for doubt in guess.doubts if doubt.key == key]


def _reason(guess: Guess, key: Key) -> str:
    """Not next to what is unsure."""
    doubtful = any(doubt.key == key for doubt in guess.doubts)
    return f"     # {guess.reasons[key]}" if key in guess.reasons and not doubtful else ""
