"""A first import file by looking at a table: by names, by units, by ranges, by physics. What is not sure is said."""
from __future__ import annotations

from collections.abc import Mapping

from control.log_row import COLUMNS
from drivers.files.imports.guess_checks import check
from drivers.files.imports.guess_columns import (
    candidates_of,
    chosen_of,
    column_of,
    commands_unseen,
    extras_with_sentinels,
    unnamed_drive,
)
from drivers.files.imports.guess_time import guess_times
from drivers.files.imports.guessed import Doubt, Guess
from drivers.files.imports.header import named
from drivers.files.imports.mapping import Column, ImportFile, Working
from drivers.files.imports.raw import RawTable
from drivers.files.imports.text import NO_HEADER
from drivers.files.imports.trouble import listed
from drivers.files.imports.units import quantity_of, unit_named
from drivers.files.imports.words import EITHER_WAY, ON, folded, says, subject_of


def guess(raw: RawTable, full: Mapping[str, float] | None = None) -> Guess:
    """full : the most of a log column by its machine file, in the log's unit, where that is known: what 100 % of a duty
    cycle is. Raises ImportTrouble where the table has no times that can be read at all."""
    time = guess_times(raw)
    out = Guess(ImportFile(source=raw.source, time=time.times, columns={}), full=full or {}, width_m=raw.width_m)
    out.doubts += [Doubt(("source", "names"), one.text) for one in raw.findings if one.id == NO_HEADER]
    out.reasons[("time",)] = time.why
    if time.doubt:
        out.doubts.append(Doubt(("time",), time.doubt))
    used = {time.times.column, time.times.date_column}
    chosen = chosen_of(candidates_of(raw, used), out)
    columns: dict[str, Column] = {}
    for target in (name for name in COLUMNS if name in chosen):
        column = column_of(chosen[target], out)
        if column is not None:
            columns[target] = column
    columns |= extras_with_sentinels(raw, {one.source for one in chosen.values()} | used)
    working = _working(raw, columns, out, used)
    out.mapping = ImportFile(source=raw.source, time=time.times, columns=columns, working=working,
                             width_m=_width(columns, raw))
    check(raw, out, chosen)
    unnamed_drive(raw, out, used)
    if unseen := commands_unseen(raw, out, used):
        out.doubts.append(Doubt(("columns",), f"{listed(unseen, 4)}: by the name a command, and taken for nothing: say "
                                "which drive's it is (shaft_rpm_cmd, opening_mm_cmd), and which column is its reading"))
    if not any(name in COLUMNS for name in out.mapping.columns) and "shaft_rpm_cmd" not in out.open:
        out.doubts.append(Doubt(("columns",), "no column was recognised: say which column of the file is which"))
    return out


def _width(columns: dict[str, Column], raw: RawTable) -> float | None:
    """Where a rate is given as a flow, the file's own working width."""
    units = [unit_named(column.unit) for name, column in columns.items() if column.unit and quantity_of(name) == "rate"]
    return raw.width_m if any(unit is not None and unit.quantity == "flow" for unit in units) else None


def _working(raw: RawTable, columns: dict[str, Column], out: Guess, used: set[str | None]) -> Working | None:
    """A switch or a word that says when the machine worked."""
    taken = {column.source for column in columns.values()} | used
    if "state" in columns or "work_switch" in columns:
        return None
    for source in raw.names:
        plain = folded(named(source)[0])
        subject = subject_of(plain, None)
        if source in taken or subject is None or subject.id != "work":
            continue
        kinds = [str(value).strip() for value in raw.frame[source].drop_nulls().unique().head(12) if str(value).strip()]
        on = [kind for kind in kinds if kind.casefold().removesuffix(".0") in ON]
        if len(kinds) > 6 or len(on) != 1:
            continue
        rivals = [name for name in raw.names if name.partition(" (")[0] == source.partition(" (")[0]]
        if len(rivals) > 1:
            out.doubts.append(Doubt(("working",), f"{len(rivals)} columns say it, and not alike ({listed(rivals, 4)}): "
                                    "which says that the machine works?"))
        mark: float | str = float(on[0]) if on[0].removesuffix(".0").isdigit() else on[0]
        out.reasons[("working",)] = f"{source} is one of {', '.join(sorted(kinds))}"
        if says(plain, EITHER_WAY):
            out.doubts.append(Doubt(("working",), f"{source}: is {on[0]} working, or lifted?"))
        return Working(column=source, equals=(mark,))
    return None
