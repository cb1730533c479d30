"""Write the tables of columns in docs/format-run-log.md anew: `python .ci/columns.py`.

They are made of the declarations in control/signals.py; run it after one of them changed.
tests/files/test_signals.py fails where the page says otherwise."""

from __future__ import annotations

import math
from itertools import groupby
from pathlib import Path

from topdress.control.log_row import VALID_FOR_S, WHOLE_COLUMNS
from topdress.control.signals import SIGNALS, VALID_FOR, Signal, ValidFor

PAGE = Path(__file__).parents[1] / "docs" / "format-run-log.md"
COLUMNS_HEAD = "| column | unit | digits written | meaning |\n|---|---|---|---|\n"
TIMES_HEAD = (
    "| reading | log, s | control, s | safety, s | why they differ |\n|---|---|---|---|---|\n"
)


def describe_digits(name: str, signal: Signal) -> str:
    """Return how a column is written."""
    if signal.decimals is not None:
        return str(signal.decimals)
    return "exact" if signal.exact else "whole" if name in WHOLE_COLUMNS else ""


def join_names(names: list[str]) -> str:
    """Return the names of a row: those of the heads by the first and the last."""
    heads = [name for name in names if name[-1].isdigit()]
    words = [f"`{heads[0]}` ... `{heads[-1]}`"] if heads else []
    return ", ".join(words + [f"`{name}`" for name in names if name not in heads])


def make_columns_table() -> str:
    """Return the table of columns; neighbours that mean the same share a row."""
    rows = []
    for key, group in groupby(
        SIGNALS.items(),
        lambda item: (
            "degrees" if item[1].unit == "deg" else item[1].unit,
            describe_digits(*item),
            item[1].meaning,
        ),
    ):
        rows.append(f"| {join_names([name for name, _ in group])} | {' | '.join(key)} |\n")
    return COLUMNS_HEAD + "".join(rows)


def make_times_table() -> str:
    """Return the table of times for which readings are valid; `-`: the age does not matter."""
    groups: dict[ValidFor, list[str]] = {}
    for name in VALID_FOR_S:
        groups.setdefault(VALID_FOR[name], []).append(name)
    rows = []
    for times, names in groups.items():
        cells = [f"{s:g}" if math.isfinite(s) else "-" for s in times[:3]]
        rows.append(f"| {join_names(names)} | {' | '.join(cells)} | {times.reason} |\n")
    return TIMES_HEAD + "".join(rows)


def write_tables(page: str) -> str:
    """Return the page with both tables as they are to be."""
    for head, table in ((COLUMNS_HEAD, make_columns_table()), (TIMES_HEAD, make_times_table())):
        before, after = page.split(head)
        page = before + table + "\n" + after.partition("\n\n")[2]
    return page


if __name__ == "__main__":
    PAGE.write_text(write_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
