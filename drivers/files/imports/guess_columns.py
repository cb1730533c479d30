"""Which column of a file corresponds to which column of the log? Names, units and ranges decide."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import COLUMNS, EFFORT_COLUMNS, PLAUSIBLE_RANGES, TEXT_COLUMNS
from topdress.control.recordings.speed_unit import IMPLAUSIBLE_MPS, MOVING_MPS
from topdress.drivers.files.columns import is_time_column
from topdress.drivers.files.imports import physical_checks
from topdress.drivers.files.imports.cell_numbers import parse_number_column
from topdress.drivers.files.imports.column_vocabulary import (
    COMMAND_WORDS,
    PLAIN_READING_WORDS,
    RAW_COMMAND_WORDS,
    READING_WORDS,
    SHAPEFILE_NAME_LENGTH,
    TIME_WORDS,
    ColumnSubject,
    find_subject,
    fold_column_name,
    has_any_word,
    is_unit_fitting,
)
from topdress.drivers.files.imports.convert import make_extra_name
from topdress.drivers.files.imports.guess_result import (
    COMMAND_PAIRS,
    ColumnCandidate,
    ImportDoubt,
    ImportGuess,
    ImportKey,
)
from topdress.drivers.files.imports.guess_time import find_count_since_1970
from topdress.drivers.files.imports.mapping import UNMAPPED_COLUMNS, Column
from topdress.drivers.files.imports.raw_table import RawTable
from topdress.drivers.files.imports.table_header import split_unit_name
from topdress.drivers.files.imports.units import (
    ColumnUnit,
    find_column_unit,
    find_named_unit,
    find_quantity,
)

# A larger number is a rotation, because no machine drives so fast in any unit of speed.
MIN_ROTATION_SPEED = 60.0
# Subjects whose unit, degrees, needs no word.
DEGREE_SUBJECTS = ("lat_deg", "lon_deg", "heading_deg")
# Factors of the units of effort; an effort keeps its unit, because the machine file defines its
# own.
EFFORT_UNITS = {"%": 1.0, "A": 1.0, "mA": 0.001, "Nm": 1.0}
# Words that are units by themselves.
RPM_WORDS = ("rpm", "drehzahl", "转速")


def find_candidates(raw: RawTable, used: Iterable[str | None]) -> list[ColumnCandidate]:
    """Returns the columns that may be a column of the log, except those in use."""
    found = [
        one
        for name in raw.names
        if name not in set(used) and (one := _make_candidate(raw, name)) is not None
    ]
    _assign_roles(found)
    _assign_efforts(raw, used, found)
    return found + _find_named_commands(raw, used, found)


def _assign_efforts(
    raw: RawTable, used: Iterable[str | None], found: list[ColumnCandidate]
) -> None:
    """Interprets a duty cycle next to a command as the effort of the drive."""
    duties = [
        name
        for name in raw.names
        if name not in set(used)
        and has_any_word(fold_column_name(split_unit_name(name)[0]), RAW_COMMAND_WORDS)
    ]
    commands = [one for one in found if one.target == "shaft_rpm_cmd" and one.source not in duties]
    if len(duties) == 1 and commands and not any(one.target == "shaft_effort" for one in found):
        unit = find_named_unit(raw.units[duties[0]]) if duties[0] in raw.units else None
        found[:] = [one for one in found if one.source != duties[0]]
        found.append(
            ColumnCandidate(
                duties[0],
                "shaft_effort",
                unit,
                True,
                "reading",
                values=_read_values(raw, duties[0]),
            )
        )


def _find_named_commands(
    raw: RawTable, used: Iterable[str | None], found: list[ColumnCandidate]
) -> list[ColumnCandidate]:
    """Returns the commands of a speed whose reading has no known command.

    The column is named a command, and the reading follows it, whatever it drives: `fan_command_rpm`
    commands no metering shaft on an applicator, but it may on a bench.
    """
    reading = next((one for one in found if one.target == "shaft_rpm"), None)
    if reading is None or any(one.target == "shaft_rpm_cmd" for one in found):
        return []
    commands = []
    for name in raw.names:
        plain, unit = (
            fold_column_name(split_unit_name(name)[0]),
            find_named_unit(raw.units[name]) if name in raw.units else None,
        )
        turns = has_any_word(plain, RPM_WORDS) if unit is None else unit.quantity == "rotation"
        if name not in {*used, reading.source} and turns and has_any_word(plain, COMMAND_WORDS):
            values = _read_values(raw, name)
            if values.size and _is_following(values, reading.values):
                commands.append(
                    ColumnCandidate(
                        name, "shaft_rpm_cmd", unit, unit is None, "command", values=values
                    )
                )
    return commands


def _make_candidate(raw: RawTable, name: str) -> ColumnCandidate | None:
    """Returns a column as a candidate, with target, unit and role; None for a column that the log
    does not have."""
    if is_time_column(raw.columns[name]):
        return None
    plain = fold_column_name(split_unit_name(name)[0])
    unit = find_named_unit(raw.units[name]) if name in raw.units else None
    if name in COLUMNS and name not in UNMAPPED_COLUMNS:
        return ColumnCandidate(
            name, name, None, implied=True, exact=True, values=_read_values(raw, name)
        )
    subject = find_subject(plain, unit.quantity if unit else None)
    if unit is not None and _is_no_unit(name, subject, unit, plain):
        subject, unit = find_subject(plain, None), None
    if (
        subject is None
        or not subject.reading
        or subject.id == "work"
        or (
            subject.reading in EFFORT_COLUMNS and unit is not None and unit.name not in EFFORT_UNITS
        )
    ):
        return None
    # A column with words of both roles is a command if it is a raw command (PWM).
    role = (
        "command"
        if has_any_word(plain, COMMAND_WORDS)
        else "reading"
        if has_any_word(plain, READING_WORDS)
        else ""
    )
    if (
        has_any_word(plain, READING_WORDS)
        and has_any_word(plain, COMMAND_WORDS)
        and not has_any_word(plain, RAW_COMMAND_WORDS)
    ):
        role = "reading" if has_any_word(plain, PLAIN_READING_WORDS) else "command"
    target = _find_target(subject, plain, role)
    values = _read_values(raw, name)
    if not np.isfinite(values).any() and target not in TEXT_COLUMNS:
        return None
    implied = (
        find_quantity(target) is None
        or subject.id in DEGREE_SUBJECTS
        or (subject.id == "shaft" and has_any_word(plain, RPM_WORDS))
    )
    if subject.id == "speed" and unit is None and _is_too_fast(values):
        target = "shaft_rpm_cmd" if role == "command" else "shaft_rpm"
    elif subject.id == "speed" and role == "command":
        # A commanded ground speed is no reading.
        return None
    return ColumnCandidate(name, target, unit, implied and unit is None, role, values=values)


def _is_no_unit(name: str, subject: ColumnSubject | None, unit: ColumnUnit, plain: str) -> bool:
    """Returns whether the end of a name only resembles a unit: a shapefile cuts `Tgt_Rate_lb_ac` to
    `Tgt_Rate_l`, and the Ms of `Rt_Apd_Ms` is a mass."""
    worded = find_subject(plain, None)
    if (
        worded is None
        or worded is subject
        or not worded.reading
        or is_unit_fitting(worded.reading, unit.quantity)
    ):
        return False
    return len(name) == SHAPEFILE_NAME_LENGTH or (worded.id == "rate" and unit.quantity == "time")


def _find_target(subject: ColumnSubject, plain: str, role: str) -> str:
    if subject.id == "ndvi" and plain[-1:] in "123456":
        return f"ndvi_{plain[-1]}"
    return subject.command if role == "command" and subject.command else subject.reading


def _read_values(raw: RawTable, name: str) -> NDArray[np.float64]:
    """Returns a column's numbers (n,); none where most cells are no numbers."""
    found = parse_number_column(raw.columns[name], raw.decimal_comma)
    return found.values if found.bad <= 0.5 * max(1, found.values.size) else np.empty(0)


def _is_too_fast(values: NDArray[np.float64]) -> bool:
    """Returns whether the values are too large for a ground speed."""
    moving = np.abs(values[np.isfinite(values)])
    moving = moving[moving > MOVING_MPS]
    return bool(moving.size and np.median(moving) > MIN_ROTATION_SPEED)


def _assign_roles(candidates: list[ColumnCandidate]) -> None:
    """Assigns the role of command to the column that the other column follows, where two columns of
    a subject have no word of a role."""
    for command, reading in COMMAND_PAIRS:
        alike = [one for one in candidates if one.target == reading and one.role == ""]
        if len(alike) != 2 or any(
            one.target == command or (one.target == reading and one.role) for one in candidates
        ):
            continue
        found = physical_checks.find_answer(alike[0].values, alike[1].values)
        if (
            found is not None
            and found.lag != 0
            and found.strength > physical_checks.MIN_CORRELATION
        ):
            first = alike[0] if found.lag > 0 else alike[1]
            first.target, first.role = command, "by physics"


def choose_candidates(
    candidates: list[ColumnCandidate], out: ImportGuess
) -> dict[str, ColumnCandidate]:
    """Returns the best candidate of each log column; among equal candidates the first, with a
    doubt."""
    by_target: dict[str, list[ColumnCandidate]] = {}
    for one in candidates:
        by_target.setdefault(one.target, []).append(one)
    chosen = {}
    for target, several in by_target.items():
        several = sorted(several, key=lambda one: one.rank_key, reverse=True)
        best = chosen[target] = several[0]
        # A second column with the same name is a rival too.
        rivals = [
            one.source
            for one in several[1:]
            if one.rank_key == best.rank_key or one.source.startswith(f"{best.source} (")
        ]  # of the same name
        if rivals:
            out.doubts.append(
                ImportDoubt(
                    ("columns", target),
                    f"{' and '.join(rivals)} would fit as well as {best.source}",
                )
            )
        # A flow is measured, whatever its name says.
        flow = best.unit is not None and best.unit.quantity == "flow"
        if (
            target == "applied_rate_kg_ha"
            and "target_rate_kg_ha" not in by_target
            and not (best.role or best.exact or flow)
        ):
            out.doubts.append(
                ImportDoubt(
                    ("columns", target),
                    f"no word says whether {best.source} is what was wanted or "
                    "what was applied: taken for applied",
                )
            )
        if best.role == "by physics":
            out.doubts.append(
                ImportDoubt(
                    ("columns", target),
                    f"no word says that {best.source} is the command: the other column follows it",
                )
            )
    return chosen


def build_column(one: ColumnCandidate, out: ImportGuess) -> Column | None:
    """Returns the import file's column of a candidate; None where a number is missing that the file
    does not contain."""
    key: ImportKey = ("columns", one.target)
    quantity = find_quantity(one.target)
    if one.exact or one.target in TEXT_COLUMNS:
        out.reasons[key] = "the log's own name"
        return Column.from_source(one.source, missing=_find_missing_marks(one))
    if one.unit is None or one.target in EFFORT_COLUMNS:
        return _build_without_unit(one, quantity, out)
    out.reasons[key] = "name and unit of the header"
    if one.unit.quantity == quantity or (quantity is None and one.unit.name == "%"):
        return Column.from_source(
            one.source, unit=one.unit.name, missing=_find_missing_marks(one, one.unit.factor)
        )
    # A pitch in % is a slope.
    if one.unit.name == "%" and quantity == "angle":
        return Column.from_source(one.source, unit="slope %", missing=_find_missing_marks(one))
    if one.unit.name == "%" and one.target in out.full:
        out.reasons[key] = (
            f"100 % is {out.full[one.target]:g} {_find_log_unit(one)} by the machine file"
        )
        return Column.model_validate(
            {
                "from": one.source,
                "unit": "%",
                "full": out.full[one.target],
                "missing": _find_missing_marks(one),
            }
        )
    if one.unit.name == "%" and quantity is not None:
        out.doubts.append(
            ImportDoubt(
                key,
                f"{one.source} is in %: the file does not say what 100 % is in "
                f"{_find_log_unit(one)}",
            )
        )
        out.open[one.target] = f'{{from: {_quote_yaml(one.source)}, unit: "%", full: }}'
        return None
    if quantity == "rate" and one.unit.quantity == "flow":
        if out.width_m is not None:
            out.reasons[key] = (
                f"a flow, over the working width of {out.width_m:g} m that the device says"
            )
            return Column.from_source(
                one.source, unit=one.unit.name, missing=_find_missing_marks(one)
            )
        out.doubts.append(
            ImportDoubt(
                key, f"{one.source} is a flow: the working width width_m is not in the file"
            )
        )
        out.open[one.target] = (
            f"{{from: {_quote_yaml(one.source)}, unit: {one.unit.name}}}"
            "     # and, on top, width_m: "
        )
        return None
    if quantity == "rate" and one.unit.quantity == "volume":
        out.doubts.append(
            ImportDoubt(
                key,
                f"{one.source} is a volume: the product's density, density_kg_l, is not in the "
                "file",
            )
        )
        out.open[one.target] = (
            f"{{from: {_quote_yaml(one.source)}, unit: {one.unit.name}}}"
            "     # and, on top, density_kg_l: "
        )
        return None
    return None


def _find_log_unit(one: ColumnCandidate) -> str:
    unit = find_column_unit(one.target)
    return "" if unit is None else unit.name


def _quote_yaml(name: str) -> str:
    """Returns a name as a quoted text of YAML."""
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


# The header of this candidate has no unit, so its range or name decides.
def _build_without_unit(
    one: ColumnCandidate, quantity: str | None, out: ImportGuess
) -> Column | None:
    """Returns the column of a candidate without a unit, with a doubt where its range or name is
    ambiguous."""
    key: ImportKey = ("columns", one.target)
    missing = _find_missing_marks(one)
    if one.implied or quantity is None:
        out.reasons[key] = "the name"
        scale = 1.0 if one.unit is None else EFFORT_UNITS.get(one.unit.name, 1.0)
        return Column.from_source(one.source, missing=missing).model_copy(
            update={} if scale == 1.0 else {"scale": scale}
        )
    known = one.values[np.isfinite(one.values) & ~np.isin(one.values, missing)]
    unit = _find_log_unit(one)
    if quantity == "voltage":
        # No machine's supply is above 500 V.
        unit = "mV" if np.median(np.abs(known)) > 500.0 else "V"
        out.reasons[key] = f"no unit: {unit} by the range ({known.min():g} to {known.max():g})"
        return Column.from_source(one.source, unit=unit, missing=missing)
    if quantity == "angle":
        out.reasons[key] = "the name"
        # A quarter turn is 1.57 rad.
        if known.size and np.abs(known).max() < 1.6:
            out.doubts.append(
                ImportDoubt(
                    key, f"no unit: degrees or radians? (values up to {np.abs(known).max():.3g})"
                )
            )
        return Column.from_source(one.source, unit="deg", missing=missing)
    moving = known[known > MOVING_MPS]
    if quantity == "speed" and moving.size and np.median(moving) > IMPLAUSIBLE_MPS:
        unit = "km/h"
    spread = f"{known.min():g} to {known.max():g}" if known.size else "no values"
    out.doubts.append(ImportDoubt(key, f"no unit in the header: taken for {unit} ({spread})"))
    return Column.from_source(one.source, unit=unit, missing=missing)


def report_unnamed_drive(raw: RawTable, out: ImportGuess, used: Iterable[str | None]) -> None:
    """Adds a doubt and open lines for the column that controls others, in a file in which no drive
    has both its columns.

    A command is recognised by its name (PWM, duty), or because it is constant for many rows while
    others change after it.
    """
    if any(
        {command, reading} <= out.mapping.columns.keys() | out.open.keys()
        for command, reading in COMMAND_PAIRS
    ):
        return
    values = {
        name: one
        for name in raw.names
        if name not in set(used)
        and (one := _read_values(raw, name))[np.isfinite(one)].size
        and np.nanmin(one) < np.nanmax(one)
        and not _is_time_stamp(name, one[np.isfinite(one)])
    }
    named_so = [
        name
        for name in values
        if has_any_word(fold_column_name(split_unit_name(name)[0]), RAW_COMMAND_WORDS)
    ]
    if not named_so and any(name in COLUMNS for name in (*out.mapping.columns, *out.open)):
        return
    # The column that changes least often comes first.
    held = sorted(values, key=lambda name: float(np.mean(np.diff(values[name]) != 0.0)))
    customary = _find_customary_pairs(values)
    for command in [*named_so, *customary, *held[:1]]:
        followers = [
            name
            for name in values
            if name != command
            and (_is_following(values[command], values[name]) or customary.get(command) == name)
        ]
        if followers:
            out.doubts.append(
                ImportDoubt(
                    ("columns",),
                    f"{', '.join(followers[:6])} follow{'s' * (len(followers) == 1)} "
                    f"{command}: is that the command of a drive and this its reading?",
                )
            )
            full = ", scale: "
            if "shaft_rpm_cmd" in out.full:
                most = float(np.nanmax(np.abs(values[command])))
                full += f"{calc_value_per_count(most, out.full['shaft_rpm_cmd']):.4g}"
            out.open.setdefault(
                "shaft_rpm_cmd", f"{{from: {_quote_yaml(command)}{full}}}     # r/min for one of it"
            )
            out.open.setdefault(
                "shaft_rpm", f"{{from: {_quote_yaml(followers[0])}, unit: rad/s}}     # or r/min"
            )
            return


def _find_customary_pairs(names: Iterable[str]) -> dict[str, str]:
    """Returns the columns whose names are customarily a command, and the reading of each."""
    by_end = dict[tuple[str, str], str]()
    for name in names:
        stem, _, end = split_unit_name(name)[0].lower().rpartition(".")
        by_end[stem, end] = name
    return {
        name: by_end[stem, reading]
        for (stem, end), name in by_end.items()
        for command, reading in CUSTOMARY_PAIRS
        if end == command and (stem, reading) in by_end
    }


def _is_time_stamp(name: str, values: NDArray[np.float64]) -> bool:
    """Returns whether numbers (n,) that never fall are a further column of times: by its name, or
    by counts since 1970."""
    words = fold_column_name(split_unit_name(name)[0])
    return bool((np.diff(values) >= 0.0).all()) and (
        has_any_word(words, TIME_WORDS) or find_count_since_1970(float(values[0])) is not None
    )


def find_unseen_commands(raw: RawTable, out: ImportGuess, used: Iterable[str | None]) -> list[str]:
    """Returns columns of numbers whose names mean commands, in a file in which no drive has a
    command."""
    known = {*out.mapping.columns, *out.open}
    if any(command in known for command, _ in COMMAND_PAIRS):
        return []
    taken = {column.source for column in out.mapping.columns.values()} | set(used)
    return [
        name
        for name in raw.names
        if name not in taken
        and has_any_word(fold_column_name(split_unit_name(name)[0]), COMMAND_WORDS)
        and np.isfinite(_read_values(raw, name)).any()
    ]


# Names of a system's input and output: in control theory and recordings of experiments; at the end
# of a plant's tags, controller output and process value (ISA-5.1). The set point is no command.
CUSTOMARY_PAIRS = (("u", "y"), ("mv", "pv"), ("op", "pv"), ("co", "pv"))
# Smallest correlation of a reading with its command, or of their ranks, which also suit curved
# relations.
MIN_FOLLOW_CORRELATION = 0.8
# Full counts of drives' duty cycles.
FULL_SCALE_COUNTS = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 10_000.0, 32_767.0, 65_535.0)


def _is_following(command: NDArray[np.float64], reading: NDArray[np.float64]) -> bool:
    """Returns whether a reading (n,) follows a command (n,)."""
    both = np.isfinite(command) & np.isfinite(reading)
    if both.sum() < 10 or np.std(command[both]) == 0.0 or np.std(reading[both]) == 0.0:
        return False
    return any(
        bool(np.corrcoef(of(command[both]), of(reading[both]))[0, 1] > MIN_FOLLOW_CORRELATION)
        for of in (np.asarray, _calc_ranks)
    )


def _calc_ranks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns ranks (n,); equal values get their mean rank (Spearman 1904)."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - 0.5 * (counts - 1))[place]


def calc_value_per_count(most: float, full: float) -> float:
    """Returns the value of one count of a command: its largest number `most` lies within the
    smallest usual full count, which has the value `full`."""
    return full / next((count for count in FULL_SCALE_COUNTS if most <= count), most)


def _find_missing_marks(one: ColumnCandidate, factor: float = 1.0) -> tuple[float, ...]:
    """Returns the numbers that mean "unknown", in the file's unit."""
    low, high = PLAUSIBLE_RANGES.get(one.target, (-np.inf, np.inf))
    factor = factor if np.isfinite(factor) else 1.0
    return (
        tuple(physical_checks.find_sentinels(one.values, (low / factor, high / factor)))
        if one.values.size
        else ()
    )


def find_extra_columns(raw: RawTable, used: Iterable[str | None]) -> dict[str, Column]:
    """Returns the extra columns with numbers that mean "unknown"; other extra columns need
    no key."""
    columns: dict[str, Column] = {}
    for source in raw.names:
        if source in set(used) or is_time_column(raw.columns[source]):
            continue
        marks = physical_checks.find_sentinels(_read_values(raw, source), (-np.inf, np.inf))
        name = make_extra_name(source, raw.units.get(source))
        if marks and name not in columns:
            columns[name] = Column.from_source(source, missing=tuple(marks))
    return columns
