"""A raw table and what its columns mean: the columns of a run log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import polars as pl

from control.log_row import COMMANDS_HELD, TEXT_COLUMNS
from control.orders import State
from control.recordings.finding import Finding, many
from control.recordings.times import mended_times
from drivers.files.config_words import nearest
from drivers.files.imports.header import named
from drivers.files.imports.mapping import (
    EVENTS,
    EXTRA_START,
    MADE_BY_WORKING,
    Column,
    ImportFile,
    Working,
)
from drivers.files.imports.numbers import Numbers, numbers
from drivers.files.imports.raw import RawTable
from drivers.files.imports.times import clock, read_texts
from drivers.files.imports.trouble import ImportTrouble, listed
from drivers.files.imports.units import in_log_unit, quantity_of, slug, unit_named

US = "us"  # the time of a row, whole microseconds
# the log's column, and here as microseconds since 1970
UTC, UTC_US = "utc", "utc_us"
COMMANDS = frozenset({"shaft_rpm_cmd", "opening_mm_cmd", "target_rate_kg_ha"})
SPEEDS = ("speed_used_mps", "speed_mps", "wheel_speed_mps")
STANDING_MPS = 0.05  # slower, and a flow is no rate
# digits kept of a converted number: more than a file holds, fewer than a double has
DIGITS = 12
# share of cells that are no number; above it the wrong column was named
_BAD_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Converted:
    """One file's part of the log. `frame`: `us` (Int64, strictly increasing), then log columns:
    Float64 or String."""

    raw: RawTable
    frame: pl.DataFrame
    kind: Literal["utc", "local", "relative"]
    findings: tuple[Finding, ...]


def convert(raw: RawTable, mapping: ImportFile) -> Converted:
    """Raises ImportTrouble: one line for each key that does not fit this file."""
    _all_there(raw, mapping)
    times = clock(raw, mapping.time)
    findings = list(raw.findings)
    columns = {
        name: _column(raw, name, column, mapping, findings)
        for name, column in mapping.columns.items()
        if name != UTC
    }
    if UTC in mapping.columns:
        columns[UTC_US] = _utc(raw, mapping.columns[UTC])
    _flows_to_rates(raw, mapping, columns)
    if mapping.working is not None:
        columns[MADE_BY_WORKING] = _state(raw, mapping.working, mapping)
    if mapping.extra == "keep":
        columns |= _extras(raw, mapping, taken=set(columns))
    frame = pl.DataFrame({US: times.us, **columns})
    frame = _in_order(raw, frame, findings)
    if mapping.rows == "answer_in_row":
        constants = [
            name for name, column in mapping.columns.items() if column.constant is not None
        ]
        frame = _with_commands_before(frame, constants)
    return Converted(raw, frame, times.kind, tuple(findings))


def _all_there(raw: RawTable, mapping: ImportFile) -> None:
    wanted = {f"columns.{name}.from": column.source for name, column in mapping.columns.items()}
    wanted |= {"time.column": mapping.time.column, "time.date_column": mapping.time.date_column}
    wanted["working.column"] = mapping.working.column if mapping.working else None
    wrong = [
        f"{key} {name}: no such column: allowed {listed(raw.names)}{nearest(name, raw.names)}"
        for key, name in wanted.items()
        if name is not None and name not in raw.names
    ]
    if wrong:
        raise ImportTrouble(raw.path, *wrong)


def _column(
    raw: RawTable, name: str, column: Column, mapping: ImportFile, findings: list[Finding]
) -> pl.Series:
    if column.constant is not None:
        return pl.Series(name, [column.constant], pl.Float64).new_from_index(0, raw.frame.height)
    assert column.source is not None
    series = raw.frame[column.source]
    missing = (*mapping.missing, *column.missing)
    if name in TEXT_COLUMNS:
        return _texts(series, missing).alias(name)
    found = numbers(series, raw.decimal_comma, missing)
    if found.marked:
        marks = listed(f"{mark:g}" for mark in missing if not isinstance(mark, str))
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
        if name.startswith(EXTRA_START) and found.bad > _BAD_SHARE * series.len():
            return _texts(series, missing).alias(name)
        _said_bad(raw, column.source, found, findings)
    values = _inside(raw, column, found.values, findings)
    converted = _in_log_unit(values * column.scale + column.offset, name, column)
    if (
        quantity_of(name) == "rate"
        and column.unit is not None
        and (unit := unit_named(column.unit)) is not None
        and unit.quantity == "volume"
    ):
        converted = converted * (mapping.density_kg_l or 1.0)
    return (
        converted.round_sig_figs(DIGITS).alias(name)
        if column.scale != 1.0 or column.unit
        else converted.alias(name)
    )


def _utc(raw: RawTable, column: Column) -> pl.Series:
    """UTC that stands next to another time, as ISO 8601 or by type."""
    assert column.source is not None
    series = raw.frame[column.source]
    if isinstance(series.dtype, pl.Datetime):
        return series.dt.timestamp("us").alias(UTC_US)
    us = read_texts(series.cast(pl.String), None, "UTC").us
    if us.null_count() == us.len():
        raise ImportTrouble(
            raw.path,
            f"row {raw.first_row}: column {column.source}: value {series[0]}: allowed ISO "
            "8601, e.g. 2026-03-20T08:00:00Z",
        )
    return us.alias(UTC_US)


def _said_bad(raw: RawTable, source: str, found: Numbers, findings: list[Finding]) -> None:
    where = f"row {raw.first_row + found.row}"
    if found.bad > _BAD_SHARE * found.values.len():
        raise ImportTrouble(
            raw.path,
            f"{where}: column {source}: value {found.cell[:40]}: allowed a number (of "
            f"{found.values.len()} cells {found.bad} are none)",
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


def _inside(raw: RawTable, column: Column, values: pl.Series, findings: list[Finding]) -> pl.Series:
    if column.valid is None:
        return values
    low, high = column.valid
    outside = ((values < low) | (values > high)).fill_null(False)
    count = int(outside.sum())
    if not count:
        return values
    row = int(outside.arg_true()[0])
    findings.append(
        Finding(
            "outside",
            f"column {column.source}: {many(count, 'value')} such as {values[row]:g} in row "
            f"{raw.first_row + row} emptied: allowed {low:g} to {high:g}",
            column.source or "",
            count,
        )
    )
    return values.set(outside, None)


def _in_log_unit(values: pl.Series, name: str, column: Column) -> pl.Series:
    values = values * column.sign
    unit = unit_named(column.unit) if column.unit is not None else None
    quantity = quantity_of(name)
    if unit is None or name.startswith(EXTRA_START) or quantity == "share":
        return values
    if unit.name == "%":
        return values * ((column.full or 1.0) / 100.0)
    converted = in_log_unit(values.to_numpy(), unit, name)
    return pl.Series(values.name, converted, pl.Float64, nan_to_null=True)


def _flows_to_rates(raw: RawTable, mapping: ImportFile, columns: dict[str, pl.Series]) -> None:
    """kg/s over the ground covered in a second, m2, as kg/ha; standing there is no rate."""
    flows = [
        name
        for name, column in mapping.columns.items()
        if quantity_of(name) == "rate"
        and column.unit is not None
        and (unit := unit_named(column.unit)) is not None
        and unit.quantity == "flow"
    ]
    if not flows:
        return
    speed = next((columns[name] for name in SPEEDS if name in columns), None)
    if speed is None:
        raise ImportTrouble(
            raw.path, f"columns.{flows[0]}: a flow: allowed with a column speed_mps to divide by"
        )
    assert mapping.width_m is not None
    moving = speed.set((speed <= STANDING_MPS).fill_null(True), None)
    for name in flows:
        columns[name] = (columns[name] / (moving * mapping.width_m) * 10_000.0).alias(name)


def _state(raw: RawTable, working: Working, mapping: ImportFile) -> pl.Series:
    series = raw.frame[working.column]
    found = numbers(series, raw.decimal_comma, mapping.missing).values
    if working.equals:
        marks = [mark for mark in working.equals if not isinstance(mark, str)]
        holds = found.is_in([float(mark) for mark in marks]).fill_null(False)
        known = found.is_not_null()
        if series.dtype == pl.String:
            words = [word.casefold() for word in working.equals if isinstance(word, str)]
            texts = series.str.strip_chars().str.to_lowercase()
            holds = holds | texts.is_in(words).fill_null(False)
            known = (texts != "").fill_null(False)
    else:
        holds, known = found.is_not_null(), found.is_not_null()
        if working.above is not None:
            holds = holds & (found > working.above).fill_null(False)
        if working.below is not None:
            holds = holds & (found < working.below).fill_null(False)
    if not holds.any():
        kinds = listed(repr(value) for value in series.unique().sort().head(6))
        raise ImportTrouble(
            raw.path,
            f"working: column {working.column} never fulfils the condition: its values are {kinds}",
        )
    frame = pl.DataFrame({"holds": holds, "known": known})
    return frame.select(
        pl.when(~pl.col("known"))
        .then(None)
        .when("holds")
        .then(pl.lit(State.WORKING.value))
        .otherwise(pl.lit(State.READY.value))
        .alias(MADE_BY_WORKING)
    )[MADE_BY_WORKING]


def _extras(raw: RawTable, mapping: ImportFile, taken: set[str]) -> dict[str, pl.Series]:
    """Columns that nothing names, by their name and unit, in the file's own unit."""
    used = {column.source for column in mapping.columns.values()} | {
        mapping.time.column,
        mapping.time.date_column,
    }
    if mapping.working is not None and mapping.working.equals:
        used.add(mapping.working.column)
    extras: dict[str, pl.Series] = {}
    for source in raw.names:
        series = raw.frame[source]
        if source in used or series.dtype.is_temporal():
            continue
        found = numbers(series, raw.decimal_comma, mapping.missing)
        values = found.values if found.bad == 0 else _texts(series, mapping.missing)
        if values.null_count() == values.len():
            continue
        name = extra_name(source, raw.units.get(source))
        number, free = 1, name
        while free in taken or free in extras:
            number += 1
            free = f"{name}_{number}"
        extras[free] = values.alias(free)
    return extras


def extra_name(source: str, unit: str | None) -> str:
    """`Engine torque [Nm]` is `x_engine_torque_nm`."""
    name, written = named(source)
    parts = [slug(name) if name else "column"]
    if unit or written:
        parts.append(slug(unit or written or ""))
    plain = "_".join(part for part in parts if part)
    return plain if plain.startswith(EXTRA_START) else EXTRA_START + plain


def _texts(series: pl.Series, missing: tuple[float | str, ...]) -> pl.Series:
    """Texts without blanks around; line breaks are blanks."""
    texts = series.cast(pl.String).str.replace_all(r"[\r\n]+", " ").str.strip_chars()
    nothing = ["", *(word for word in missing if isinstance(word, str))]
    return texts.set(texts.is_in(nothing).fill_null(True), None)


def _in_order(raw: RawTable, frame: pl.DataFrame, findings: list[Finding]) -> pl.DataFrame:
    """Rows with strictly increasing times, as the log's own reader would have them."""
    us = frame[US]
    known = us.drop_nulls()
    first = int(known[0]) if known.len() else 0
    time_s = ((us - first).cast(pl.Float64) / 1e6).fill_null(float("nan")).to_numpy()
    try:
        times = mended_times(time_s)
    except ValueError as error:
        raise ImportTrouble(raw.path, f"{str(error).replace('time_s', 'time')}") from None
    findings += times.findings
    kept = frame if isinstance(times.rows, slice) else frame[times.rows]
    if times.spread:
        spread = first + np.round(times.time_s * 1e6).astype(np.int64)
        kept = kept.with_columns(pl.Series(US, spread))
    return kept


def _with_commands_before(frame: pl.DataFrame, constants: list[str]) -> pl.DataFrame:
    """From rows that hold a command and its settled answer to rows of the run log.

    A row of the log holds a reading, and the command in force from there on: the command of
    each row moves to the row before, and a row stands before the first for its command. An
    event says that no command is missing between rows.
    """
    times = frame[US]
    step = int(times.diff().median() or 1_000_000)  # type: ignore[arg-type]
    before = frame.head(1).select(
        pl.lit(int(times[0]) - step, pl.Int64).alias(US)
        if name == US
        else pl.col(name)
        if name in (*COMMANDS, *constants, MADE_BY_WORKING)
        else pl.lit(None, kind).alias(name)
        for name, kind in frame.schema.items()
    )
    longer = pl.concat([before, frame])
    later = [
        pl.concat([frame[name], frame[name].tail(1)]) for name in frame.columns if name in COMMANDS
    ]
    stated = frame[EVENTS].to_list() if EVENTS in frame.columns else [None] * frame.height
    return longer.with_columns(*later, pl.Series(EVENTS, [COMMANDS_HELD, *stated], pl.String))
