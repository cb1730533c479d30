"""How do a raw table and the meaning of its columns become the columns of a run log?"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import COMMANDS_HELD_EVENT, TEXT_COLUMNS
from topdress.control.orders import State
from topdress.control.recordings.finding import Finding, many
from topdress.control.recordings.row_times import mend_times
from topdress.drivers.files.columns import (
    Columns,
    calc_median,
    count_microseconds,
    count_rows,
    is_text_column,
    is_time_column,
    make_text_column,
    make_unknown_like,
    map_texts,
    select_rows,
)
from topdress.drivers.files.config_words import suggest_nearest
from topdress.drivers.files.imports.cell_numbers import ParsedNumbers, parse_number_column
from topdress.drivers.files.imports.import_errors import LogImportError, format_list
from topdress.drivers.files.imports.mapping import (
    EVENTS_COLUMN,
    EXTRA_COLUMN_PREFIX,
    STATE_COLUMN,
    Column,
    ImportFile,
    Working,
)
from topdress.drivers.files.imports.raw_table import RawTable
from topdress.drivers.files.imports.table_header import split_unit_name
from topdress.drivers.files.imports.time_cells import (
    convert_to_texts,
    read_row_times,
    read_time_texts,
)
from topdress.drivers.files.imports.units import (
    convert_to_log_unit,
    find_named_unit,
    find_quantity,
    make_name_slug,
)

# Column with the time of a row in whole microseconds.
TIME_US_COLUMN = "us"
# Column of the run log with UTC, and the column of microseconds since 1970 that replaces it here.
UTC_COLUMN, UTC_US_COLUMN = "utc", "utc_us"
# Columns of the log that hold commands.
COMMAND_COLUMNS = frozenset({"shaft_rpm_cmd", "opening_mm_cmd", "target_rate_kg_ha"})
# Columns of speed; the first one that a log has is its speed.
SPEED_COLUMNS = ("speed_used_mps", "speed_mps", "wheel_speed_mps")
# Below this speed, m/s, the machine stands and a flow is no rate.
MIN_MOVING_MPS = 0.05
# Number of digits kept of a converted number: more than a file has, fewer than a double has.
CONVERTED_NUMBER_DIGITS = 12
# Share of cells that are no numbers, above which the import file names the wrong column.
_MAX_NON_NUMBER_SHARE = 0.5
_LINE_BREAKS = re.compile(r"[\r\n]+")


@dataclass(frozen=True, eq=False)
class ConvertedFile:
    """Holds one file's part of the log. `columns` begins with `us` (whole microseconds, strictly
    increasing), followed by the columns of the log: numbers or texts."""

    raw: RawTable
    columns: Columns
    kind: Literal["utc", "local", "relative"]
    findings: tuple[Finding, ...]


def convert_table(raw: RawTable, mapping: ImportFile) -> ConvertedFile:
    """Returns a table converted to columns of the log.

    Parameters
    ----------
    raw : the table as the file holds it.
    mapping : the meaning of its columns.

    Returns
    -------
    columns in the log's units, with findings.

    Raises
    ------
    LogImportError : a line for each key that does not fit this file.
    """
    # Missing columns are reported together, before any conversion.
    _require_columns(raw, mapping)
    times = read_row_times(raw, mapping.time)
    findings = list(raw.findings)
    columns: Columns = {
        name: _convert_column(raw, name, column, mapping, findings)
        for name, column in mapping.columns.items()
        if name != UTC_COLUMN
    }
    if UTC_COLUMN in mapping.columns:
        columns[UTC_US_COLUMN] = _read_utc_us(raw, mapping.columns[UTC_COLUMN])
    # Flows are converted after all columns, because they need the speed.
    _convert_flows(raw, mapping, columns)
    if mapping.working is not None:
        columns[STATE_COLUMN] = _find_state(raw, mapping.working, mapping)
    if mapping.extra == "keep":
        columns |= _collect_extras(raw, mapping, taken=set(columns))
    # Rows are ordered at the end, so that all columns are sorted by the same index.
    columns = _order_rows(raw, {TIME_US_COLUMN: times.us, **columns}, findings)
    if mapping.rows == "answer_in_row":
        constants = [
            name for name, column in mapping.columns.items() if column.constant is not None
        ]
        columns = _shift_commands(columns, constants)
    return ConvertedFile(raw, columns, times.kind, tuple(findings))


def _require_columns(raw: RawTable, mapping: ImportFile) -> None:
    wanted = {f"columns.{name}.from": column.source for name, column in mapping.columns.items()}
    wanted |= {"time.column": mapping.time.column, "time.date_column": mapping.time.date_column}
    wanted["working.column"] = mapping.working.column if mapping.working else None
    wrong = [
        f"{key} {name}: no such column: allowed {format_list(raw.names)}"
        f"{suggest_nearest(name, raw.names)}"
        for key, name in wanted.items()
        if name is not None and name not in raw.names
    ]
    if wrong:
        raise LogImportError(raw.path, *wrong)


def _convert_column(
    raw: RawTable, name: str, column: Column, mapping: ImportFile, findings: list[Finding]
) -> NDArray[Any]:
    """Returns a column of the log, (n,) numbers in its unit, or texts."""
    if column.constant is not None:
        # A constant replaces a column, for example a fixed opening.
        return np.full(count_rows(raw.columns), float(column.constant))
    assert column.source is not None
    cells = raw.columns[column.source]
    missing = (*mapping.missing, *column.missing)
    # Texts have neither unit nor scale.
    if name in TEXT_COLUMNS:
        return _clean_texts(cells, missing)
    found = parse_number_column(cells, raw.decimal_comma, missing)
    # Numbers that mean "unknown" are reported, because they look like readings.
    if found.marked:
        marks = format_list(f"{mark:g}" for mark in missing if not isinstance(mark, str))
        findings.append(
            Finding(
                "sentinel",
                f"column {column.source}: {many(found.marked, 'value')} of {marks} "
                "emptied: not known",
                column.source,
                found.marked,
            )
        )
    if found.bad:
        # An extra column may hold texts.
        if name.startswith(EXTRA_COLUMN_PREFIX) and found.bad > _MAX_NON_NUMBER_SHARE * cells.size:
            return _clean_texts(cells, missing)
        _report_bad_cells(raw, column.source, found, findings)
    # Limits apply to the file's own numbers, before scale and unit.
    values = _empty_outside(raw, column, found.values, findings)
    converted = _convert_to_log_unit(values * column.scale + column.offset, name, column)
    if (
        find_quantity(name) == "rate"
        and column.unit is not None
        and (unit := find_named_unit(column.unit)) is not None
        and unit.quantity == "volume"
    ):
        # Litres times kg/l are kg.
        converted = converted * (mapping.density_kg_l or 1.0)
    # Rounding removes the digits that only a conversion of units has added.
    return _round_digits(converted) if column.scale != 1.0 or column.unit else converted


def _round_digits(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns numbers (n,) rounded to `CONVERTED_NUMBER_DIGITS` digits, halves away from zero."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        # The logarithm of 0 is infinite; the last line keeps such values.
        per_digit = 10.0 ** (CONVERTED_NUMBER_DIGITS - 1 - np.floor(np.log10(np.abs(values))))
        scaled = values * per_digit
        rounded = np.copysign(np.floor(np.abs(scaled) + 0.5), scaled) / per_digit
    return np.where(np.isfinite(scaled) & (values != 0.0), rounded, values)


def _read_utc_us(raw: RawTable, column: Column) -> NDArray[np.float64]:
    """Returns the UTC column next to another time, ISO 8601 or a typed time, in
    microseconds (n,)."""
    assert column.source is not None
    cells = raw.columns[column.source]
    if is_time_column(cells):
        return count_microseconds(cells)
    us = read_time_texts(cells, None, "UTC").us
    # A column without a single date is a wrong column, not a gap.
    if np.isnan(us).all():
        raise LogImportError(
            raw.path,
            f"row {raw.first_row}: column {column.source}: value {cells[0]}: allowed ISO "
            "8601, e.g. 2026-03-20T08:00:00Z",
        )
    return us


def _report_bad_cells(
    raw: RawTable, source: str, found: ParsedNumbers, findings: list[Finding]
) -> None:
    """Adds a finding about cells that are no numbers. Raises LogImportError where most are none."""
    where = f"row {raw.first_row + found.row}"
    # Many such cells mean that the import file names the wrong column.
    if found.bad > _MAX_NON_NUMBER_SHARE * found.values.size:
        raise LogImportError(
            raw.path,
            f"{where}: column {source}: value {found.cell[:40]}: allowed a number (of "
            f"{found.values.size} cells {found.bad} are none)",
        )
    findings.append(
        Finding(
            "not_a_number",
            f"column {source}: {many(found.bad, 'cell')} such as {found.cell[:20]!r} "
            f"in {where} emptied: not a number",
            source,
            found.bad,
        )
    )


def _empty_outside(
    raw: RawTable, column: Column, values: NDArray[np.float64], findings: list[Finding]
) -> NDArray[np.float64]:
    """Returns numbers (n,), with NaN outside of the mapping's range, and adds a finding."""
    if column.valid is None:
        # Values outside are emptied and counted instead of limited, because a limited value looks
        # measured.
        return values
    low, high = column.valid
    outside = (values < low) | (values > high)
    count = int(outside.sum())
    if not count:
        return values
    row = int(np.flatnonzero(outside)[0])
    findings.append(
        Finding(
            "outside",
            f"column {column.source}: {many(count, 'value')} such as {values[row]:g} in row "
            f"{raw.first_row + row} emptied: allowed {low:g} to {high:g}",
            column.source or "",
            count,
        )
    )
    return np.where(outside, np.nan, values)


def _convert_to_log_unit(
    values: NDArray[np.float64], name: str, column: Column
) -> NDArray[np.float64]:
    """Returns numbers (n,) in the log's unit, with the mapping's sign."""
    values = values * column.sign
    unit = find_named_unit(column.unit) if column.unit is not None else None
    quantity = find_quantity(name)
    # Extra columns and efforts keep their own unit.
    if unit is None or name.startswith(EXTRA_COLUMN_PREFIX) or quantity == "share":
        return values
    # A percentage needs the full value of the machine.
    if unit.name == "%":
        return values * ((column.full or 1.0) / 100.0)
    return convert_to_log_unit(values, unit, name)


def _convert_flows(raw: RawTable, mapping: ImportFile, columns: Columns) -> None:
    """Replaces flows, kg/s, by rates in kg/ha, from the area covered in a second, m2; a standing
    machine has no rate."""
    flows = [
        name
        for name, column in mapping.columns.items()
        if find_quantity(name) == "rate"
        and column.unit is not None
        and (unit := find_named_unit(column.unit)) is not None
        and unit.quantity == "flow"
    ]
    if not flows:
        return
    # The columns are listed from the most to the least processed speed.
    speed = next((columns[name] for name in SPEED_COLUMNS if name in columns), None)
    if speed is None:
        raise LogImportError(
            raw.path, f"columns.{flows[0]}: a flow: allowed with a column speed_mps to divide by"
        )
    assert mapping.width_m is not None
    # A standing machine would divide by zero.
    moving = np.where(speed > MIN_MOVING_MPS, speed, np.nan)
    for name in flows:
        # kg/s divided by m2/s is kg/m2; 10 000 m2 are 1 ha.
        columns[name] = columns[name] / (moving * mapping.width_m) * 10_000.0


def _find_state(raw: RawTable, working: Working, mapping: ImportFile) -> NDArray[Any]:
    """Returns the state (n,) of each row: working where the mapping's condition is true, else
    ready."""
    cells = raw.columns[working.column]
    found = parse_number_column(cells, raw.decimal_comma, mapping.missing).values
    known = ~np.isnan(found)
    if working.equals:
        marks = [float(mark) for mark in working.equals if not isinstance(mark, str)]
        holds = np.isin(found, marks)
        if is_text_column(cells):
            words = {word.casefold() for word in working.equals if isinstance(word, str)}
            # Case and blanks differ between versions of the same terminal.
            texts = [text.strip().lower() for text in cells.tolist()]
            holds |= np.array([text in words for text in texts])
            known = np.array([text != "" for text in texts])
    else:
        holds = known
        if working.above is not None:
            holds = holds & (found > working.above)
        if working.below is not None:
            holds = holds & (found < working.below)
    # A condition that is never true is a typing error in nearly all cases.
    if not holds.any():
        kinds = format_list(
            repr(value) for value in sorted(set(convert_to_texts(cells).tolist()))[:6]
        )
        raise LogImportError(
            raw.path,
            f"working: column {working.column} never fulfils the condition: its values are {kinds}",
        )
    states = np.where(holds, State.WORKING.value, State.READY.value)
    return make_text_column(np.where(known, states, "").tolist())


def _collect_extras(raw: RawTable, mapping: ImportFile, taken: set[str]) -> Columns:
    """Returns the columns that no key names, by their name and unit, in the file's own unit."""
    used = {column.source for column in mapping.columns.values()} | {
        mapping.time.column,
        mapping.time.date_column,
    }
    # A column of words for the state would only repeat the state.
    if mapping.working is not None and mapping.working.equals:
        used.add(mapping.working.column)
    extras: Columns = {}
    for source in raw.names:
        cells = raw.columns[source]
        if source in used or is_time_column(cells):
            continue
        found = parse_number_column(cells, raw.decimal_comma, mapping.missing)
        values = found.values if found.bad == 0 else _clean_texts(cells, mapping.missing)
        # An empty column has no information.
        if not (values != "" if is_text_column(values) else ~np.isnan(values)).any():
            continue
        name = make_extra_name(source, raw.units.get(source))
        number, free = 1, name
        # The second column with the same name gets the suffix _2.
        while free in taken or free in extras:
            number += 1
            free = f"{name}_{number}"
        extras[free] = values
    return extras


def make_extra_name(source: str, unit: str | None) -> str:
    """Returns an extra column's name: `Engine torque [Nm]` becomes `x_engine_torque_nm`."""
    name, written = split_unit_name(source)
    parts = [make_name_slug(name) if name else "column"]
    if unit or written:
        parts.append(make_name_slug(unit or written or ""))
    plain = "_".join(part for part in parts if part)
    return plain if plain.startswith(EXTRA_COLUMN_PREFIX) else EXTRA_COLUMN_PREFIX + plain


def _clean_texts(cells: NDArray[Any], missing: tuple[float | str, ...]) -> NDArray[Any]:
    """Returns texts without surrounding blanks; line breaks become blanks."""
    nothing = {word for word in missing if isinstance(word, str)}

    def one_line(text: str) -> str:
        text = _LINE_BREAKS.sub(" ", text).strip()
        return "" if text in nothing else text

    return map_texts(one_line, convert_to_texts(cells))


def _order_rows(raw: RawTable, columns: Columns, findings: list[Finding]) -> Columns:
    """Returns rows with strictly increasing times, as the log's own reader makes them."""
    us = columns[TIME_US_COLUMN]
    known = us[~np.isnan(us)]
    first = known[0] if known.size else 0.0
    try:
        # Times are shifted to begin near 0, because doubles lose microseconds at 1e9 s.
        times = mend_times((us - first) / 1e6)
    except ValueError as error:
        raise LogImportError(raw.path, f"{str(error).replace('time_s', 'time')}") from None
    findings += times.findings
    kept = columns if isinstance(times.rows, slice) else select_rows(columns, times.rows)
    if times.spread:
        kept = {**kept, TIME_US_COLUMN: first + np.round(times.time_s * 1e6)}
    return kept


def _shift_commands(columns: Columns, constants: list[str]) -> Columns:
    """Converts rows that hold a command and its settled answer to rows of the run log.

    A row of the log holds a reading, and the command in force from then on. The command of each row
    therefore moves to the row before, and an additional first row holds the first command. An event
    states that no command is missing between rows.
    """
    times = columns[TIME_US_COLUMN]
    # The first row begins one usual step earlier, or one second earlier without any step.
    step = int(calc_median(np.diff(times)) or 1e6)
    stated = columns.get(EVENTS_COLUMN, make_unknown_like(make_text_column([]), len(times)))
    longer = {TIME_US_COLUMN: np.concatenate(([times[0] - step], times))}
    for name, column in columns.items():
        if name in COMMAND_COLUMNS:
            # The last command stays in force after the last row.
            longer[name] = np.concatenate((column, column[-1:]))
        elif name != TIME_US_COLUMN:
            # A state or constant also applies to the additional row; a reading does not.
            is_held = name in (*constants, STATE_COLUMN)
            before = column[:1] if is_held else make_unknown_like(column, 1)
            longer[name] = np.concatenate((before, column))
    return {**longer, EVENTS_COLUMN: make_text_column([COMMANDS_HELD_EVENT, *stated.tolist()])}
