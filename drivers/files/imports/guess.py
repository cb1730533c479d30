"""Which import file fits a table? Names, units, ranges and physics decide, and open questions are
listed.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import COLUMNS, PLAUSIBLE_RANGES
from topdress.control.recordings.speed_unit import identify_unit
from topdress.drivers.files.columns import (
    calc_median,
    count_differences,
    format_numbers,
    is_number_column,
    is_text_column,
    select_rows,
)
from topdress.drivers.files.imports import physical_checks
from topdress.drivers.files.imports.cell_numbers import parse_number_column
from topdress.drivers.files.imports.column_vocabulary import (
    AMBIGUOUS_SWITCH_WORDS,
    QUANTITY_WORDS,
    SWITCH_ON_WORDS,
    find_subject,
    fold_column_name,
    has_any_word,
)
from topdress.drivers.files.imports.convert import TIME_US_COLUMN, UTC_US_COLUMN, convert_table
from topdress.drivers.files.imports.guess_columns import (
    build_column,
    calc_value_per_count,
    choose_candidates,
    find_candidates,
    find_extra_columns,
    find_unseen_commands,
    report_unnamed_drive,
)
from topdress.drivers.files.imports.guess_result import (
    COMMAND_PAIRS,
    ColumnCandidate,
    ImportDoubt,
    ImportGuess,
)
from topdress.drivers.files.imports.guess_time import guess_times
from topdress.drivers.files.imports.import_errors import TableError, format_list
from topdress.drivers.files.imports.mapping import Column, ImportFile, Working
from topdress.drivers.files.imports.raw_table import RawTable
from topdress.drivers.files.imports.table_header import split_unit_name
from topdress.drivers.files.imports.text_table import NO_HEADER_ID
from topdress.drivers.files.imports.units import find_named_unit, find_quantity

# Number of rows that are converted to test a guess.
MAX_TESTED_ROWS = 50_000
# Range of the ratio of wheel speed to ground speed, on any ground.
WHEEL_TO_GROUND_RATIO_RANGE = (0.7, 1.6)
# Relative difference of command and reading up to which both have the same unit.
SAME_UNIT_TOLERANCE = 0.1
# Share of the largest value by which readings may leave their range, because readings about zero
# are noisy.
RANGE_EXCESS_TOLERANCE = 0.02
# Range of the median time between rows, s, from the fastest logger of a drive to the slowest
# logger.
MIN_ROW_STEP_S, MAX_ROW_STEP_S = 5e-5, 60.0
# Commands that a row may hold together with their settled answer.
DRIVE_COMMANDS = ("shaft_rpm_cmd", "opening_mm_cmd")


def check_guess(raw: RawTable, out: ImportGuess, chosen: Mapping[str, ColumnCandidate]) -> None:
    """Converts the first rows by the guess, and changes or doubts each part that their numbers
    contradict."""
    # A part of the file is sufficient for the tests, and a season's log would take minutes.
    head = RawTable(
        raw.path,
        select_rows(raw.columns, slice(MAX_TESTED_ROWS)),
        raw.source,
        raw.units,
        raw.first_row,
        utc=raw.utc,
    )
    try:
        tried = convert_table(head, out.mapping.model_copy(update={"extra": "drop"}))
    # Unusable times make all further tests meaningless, so the check ends with this doubt.
    except TableError as trouble:
        out.doubts.append(
            ImportDoubt(("time",), _describe_too_close(raw, out) or str(trouble).splitlines()[0])
        )
        return
    time_s = (tried.columns[TIME_US_COLUMN] - tried.columns[TIME_US_COLUMN][0]) / 1e6
    columns = {
        name: column
        for name, column in tried.columns.items()
        if is_number_column(column) and name not in (TIME_US_COLUMN, UTC_US_COLUMN)
    }
    # The order matters: wrong times would make speeds wrong, and wrong speeds every rate.
    _check_row_spacing(time_s, out)
    _check_speed_units(time_s, columns, out, chosen)
    _check_ranges(columns, out)
    _check_commands(time_s, columns, out, chosen)
    _check_hopper(columns, out)


def _describe_too_close(raw: RawTable, out: ImportGuess) -> str:
    """Returns a doubt about times that increase in every row but coincide in the assumed unit, such
    as a header `time_us` above seconds; empty without a doubt."""
    time = out.mapping.time
    if time.column is None or time.counts not in ("ms", "us"):
        return ""
    steps = count_differences(
        parse_number_column(raw.columns[time.column], raw.decimal_comma).values
    )
    # Times that do not grow have another fault, which is reported elsewhere.
    if not steps.size or not (steps > 0).all():
        return ""
    each = calc_median(steps)
    return (
        f"{time.column} grows by {each:.3g} {time.counts} in each row: are the times in "
        "another unit?"
    )


def _check_row_spacing(time_s: NDArray[np.float64], out: ImportGuess) -> None:
    """Adds a doubt where rows are so far apart, or so close, that the times probably have another
    unit."""
    # Two rows give no reliable interval, and a counted row has no unit.
    if (
        len(time_s) < 3
        or out.mapping.time.counts == "rows"
        or any(doubt.key == ("time",) for doubt in out.doubts)
    ):
        return
    # The median is not changed by pauses of the log.
    step_s = float(np.median(np.diff(time_s)))
    if not MIN_ROW_STEP_S <= step_s <= MAX_ROW_STEP_S:
        whole, each = (
            f"{span:,.0f}" if span >= 100.0 else f"{span:.3g}"
            for span in (float(time_s[-1]), step_s)
        )
        out.doubts.append(
            ImportDoubt(
                ("time",),
                f"{whole} s for {len(time_s)} rows, one each {each} s: are the times in "
                "another unit?",
            )
        )


def _check_speed_units(
    time_s: NDArray[np.float64],
    columns: dict[str, NDArray[np.float64]],
    out: ImportGuess,
    chosen: Mapping[str, ColumnCandidate],
) -> None:
    """Compares speeds with the distances between positions, and corrects or doubts their units."""
    # Only positions give an independent measure of speed.
    if "lat_deg" not in columns or "lon_deg" not in columns:
        return
    for name in ("speed_mps", "wheel_speed_mps", "speed_used_mps"):
        if name not in columns:
            continue
        unit, ratio = physical_checks.find_speed_unit(
            time_s, columns["lat_deg"], columns["lon_deg"], columns[name]
        )
        # NaN means that the machine did not move.
        if ratio != ratio:
            continue
        column, key = out.mapping.columns[name], ("columns", name)
        written = find_named_unit(column.unit or "m/s")
        assert written is not None
        # A wheel may slip or be calibrated wrongly, so its ratio may differ from 1.
        slips = (
            name == "wheel_speed_mps"
            and chosen[name].unit is not None
            and WHEEL_TO_GROUND_RATIO_RANGE[0] < ratio < WHEEL_TO_GROUND_RATIO_RANGE[1]
        )
        # The converted speed fits, so the unit from the header or the range is right.
        if unit == "m/s" or slips:
            out.reasons[key] = f"{written.name}: {ratio:.2f} times the speed between the places"
            # The positions have answered the question about the unit.
            out.doubts = [
                doubt for doubt in out.doubts if doubt.key != key or "unit" not in doubt.text
            ]
        elif chosen[name].unit is None:
            _take_speed_unit(name, ratio / written.factor, column, out)
        else:
            out.doubts.append(
                ImportDoubt(
                    key,
                    f"in {written.name}, as the header says, it is {ratio:.2f} times the speed "
                    "between the places",
                )
            )


def _take_speed_unit(name: str, ratio: float, column: Column, out: ImportGuess) -> None:
    """Adopts the unit that fits the positions. `ratio` is the file's own number for 1 m/s between
    positions."""
    key = ("columns", name)
    # A ratio between two known units is reported as a doubt, never rounded.
    fits = identify_unit(ratio, physical_checks.SPEED_FACTORS)
    if fits is None:
        out.doubts.append(
            ImportDoubt(
                key, f"it is {ratio:.2f} times the speed between the places: no unit makes that"
            )
        )
        return
    changed = {**out.mapping.columns, name: column.model_copy(update={"unit": fits})}
    out.mapping = out.mapping.model_copy(update={"columns": changed})
    out.doubts = [doubt for doubt in out.doubts if doubt.key != key or "unit" not in doubt.text]
    out.reasons[key] = f"no unit: {fits}, which makes the distance between the places"


def _check_ranges(columns: dict[str, NDArray[np.float64]], out: ImportGuess) -> None:
    """Adds a doubt about each column outside of its plausible range."""
    for name, values in columns.items():
        known = values[np.isfinite(values)]
        if name not in PLAUSIBLE_RANGES or not known.size:
            continue
        low, high = PLAUSIBLE_RANGES[name]
        noise = RANGE_EXCESS_TOLERANCE * np.abs(known).max()
        outside = known[(known < low - noise) | (known > high + noise)]
        # Single outliers are no evidence against a unit.
        if outside.size > 0.01 * known.size:
            text = (
                f"{outside.size} of {known.size} values such as {outside[0]:g} are beyond "
                f"{low:g} to {high:g}"
            )
            out.doubts.append(ImportDoubt(("columns", name), f"{text}, which {name} can be"))


def _check_commands(
    time_s: NDArray[np.float64],
    columns: dict[str, NDArray[np.float64]],
    out: ImportGuess,
    chosen: Mapping[str, ColumnCandidate],
) -> None:
    """Scales commands without a unit to their readings, and finds whether a row holds a command
    with its settled answer."""
    for command, reading in COMMAND_PAIRS:
        if command not in columns or reading not in columns:
            continue
        key = ("columns", command)
        one = chosen.get(command)
        # A command with a unit needs no scale.
        if one is not None and one.unit is None and not one.implied and command in DRIVE_COMMANDS:
            bare = not has_any_word(fold_column_name(one.source), QUANTITY_WORDS)
            _scale_command(
                command,
                physical_checks.calc_answer_slope(columns[command], columns[reading]),
                bare,
                float(np.nanmax(np.abs(columns[command]))),
                out,
            )
        # A reading follows its command later; the lag distinguishes both.
        found = physical_checks.find_answer(columns[command], columns[reading])
        if found is not None and found.strength >= physical_checks.MIN_CORRELATION:
            # A rate may precede its target where the look-ahead is set too long.
            if found.lag < 0 and command in DRIVE_COMMANDS:
                out.doubts.append(
                    ImportDoubt(
                        key, f"{reading} moves {-found.lag} rows before it: are the two exchanged?"
                    )
                )
            elif found.lag == 0 and command in DRIVE_COMMANDS:
                _take_answer_in_row(
                    out,
                    f"{reading} moves in the very row in which {command} does: "
                    "answer_in_row where a "
                    "row holds a command and its answer, answer_next_row where it was given "
                    "after the "
                    "reading",
                )
        # In a table of settings every row has its own command, so no lag can be found.
        elif command in DRIVE_COMMANDS and physical_checks.is_settings_table(
            time_s, columns[command]
        ):
            apart_s = float(np.median(np.diff(time_s)))
            _take_answer_in_row(
                out,
                f"nearly every row has another {command}, and rows are {apart_s:.2g} s "
                "apart: taken "
                "for settings with their settled answers",
            )


def _take_answer_in_row(out: ImportGuess, text: str) -> None:
    """Interprets rows as settings with their answers, with a doubt."""
    # Several drives may show it, but the mapping has one rule for all rows.
    if out.mapping.rows != "answer_in_row":
        out.mapping = out.mapping.model_copy(update={"rows": "answer_in_row"})
        out.doubts.append(ImportDoubt(("rows",), text))


def _scale_command(command: str, factor: float, bare: bool, most: float, out: ImportGuess) -> None:
    """Scales a command without a unit. `most` is its largest number. `bare` means that its name
    states no quantity, so that it may count anything, as PWM does."""
    key = ("columns", command)
    # The scale answers the question about the missing unit.
    out.doubts = [doubt for doubt in out.doubts if doubt.key != key or "no unit" not in doubt.text]
    if not np.isfinite(factor) or factor == 0.0:
        out.doubts.append(
            ImportDoubt(key, "no unit in the header, and the readings do not tell a scale")
        )
        return
    # A ratio near 1 means that both have the same unit.
    if not bare or abs(factor - 1.0) < SAME_UNIT_TOLERANCE:
        out.doubts.append(
            ImportDoubt(
                key,
                f"no unit in the header; its readings are {factor:.3g} times as large: taken for "
                "the same unit",
            )
        )
        return
    column = out.mapping.columns[command]
    why = "the usual ratio of its reading to it; what the maker says of it is better"
    # The machine file is better evidence than the ratio of readings, which includes slip.
    if command in out.full:
        factor = calc_value_per_count(most, out.full[command])
        why = (
            f"so that its full count is {out.full[command]:g} r/min, as the machine file says"
            if command == "shaft_rpm_cmd"
            else "so that its full count is the machine file's"
        )
    changed = {
        **out.mapping.columns,
        command: column.model_copy(update={"scale": float(f"{factor:.4g}")}),
    }
    out.mapping = out.mapping.model_copy(update={"columns": changed})
    out.doubts.append(ImportDoubt(key, f"no unit in the header: scaled by {factor:.4g}, {why}"))


def _check_hopper(columns: dict[str, NDArray[np.float64]], out: ImportGuess) -> None:
    """Adds a doubt about a hopper whose mass only increases: its column may be exchanged with the
    applied mass."""
    hopper = columns.get("hopper_kg")
    # A short log cannot distinguish a refill from a counter.
    if hopper is not None and hopper.size > 20:
        known = hopper[np.isfinite(hopper)]
        if known.size > 20 and np.mean(np.diff(known) > 0.0) > 0.8 and known[-1] > known[0]:
            out.doubts.append(
                ImportDoubt(
                    ("columns", "hopper_kg"),
                    "it grows nearly all the time: does it count what was applied?",
                )
            )


def guess_import_file(raw: RawTable, full: Mapping[str, float] | None = None) -> ImportGuess:
    """Returns a first import file for a table, with doubts and reasons.

    Parameters
    ----------
    raw : the table as the file holds it.
    full : largest value of a log column by its machine file, in the log's unit; 100 % of a duty
    cycle has this value.

    Returns
    -------
    mapping, doubts and reasons.

    Raises
    ------
    LogImportError : the table has no readable times.
    """
    # Time comes first, because its column must not be chosen for a quantity.
    time = guess_times(raw)
    out = ImportGuess(
        ImportFile(source=raw.source, time=time.times, columns={}),
        full=full or {},
        width_m=raw.width_m,
    )
    out.doubts += [
        ImportDoubt(("source", "names"), one.text) for one in raw.findings if one.id == NO_HEADER_ID
    ]
    out.reasons[("time",)] = time.why
    if time.doubt:
        out.doubts.append(ImportDoubt(("time",), time.doubt))
    used = {time.times.column, time.times.date_column}
    chosen = choose_candidates(find_candidates(raw, used), out)
    columns: dict[str, Column] = {}
    # The order of the log is used, so that the import file is easy to compare with others.
    for target in (name for name in COLUMNS if name in chosen):
        column = build_column(chosen[target], out)
        if column is not None:
            columns[target] = column
    columns |= find_extra_columns(raw, {one.source for one in chosen.values()} | used)
    working = _find_work_column(raw, columns, out, used)
    out.mapping = ImportFile(
        source=raw.source,
        time=time.times,
        columns=columns,
        working=working,
        width_m=_find_flow_width(columns, raw),
    )
    # The guess is tested on the numbers themselves before it is returned.
    check_guess(raw, out, chosen)
    report_unnamed_drive(raw, out, used)
    if unseen := find_unseen_commands(raw, out, used):
        out.doubts.append(
            ImportDoubt(
                ("columns",),
                f"{format_list(unseen, 4)}: by the name a command, and taken for nothing: say "
                "which drive's it is (shaft_rpm_cmd, opening_mm_cmd), and which column is "
                "its reading",
            )
        )
    if not any(name in COLUMNS for name in out.mapping.columns) and "shaft_rpm_cmd" not in out.open:
        out.doubts.append(
            ImportDoubt(
                ("columns",), "no column was recognised: say which column of the file is which"
            )
        )
    return out


def _find_flow_width(columns: dict[str, Column], raw: RawTable) -> float | None:
    """Returns the file's own working width, m, where a rate is given as a flow."""
    units = [
        find_named_unit(column.unit)
        for name, column in columns.items()
        if column.unit and find_quantity(name) == "rate"
    ]
    return (
        # Only a flow needs the width for its conversion to a rate.
        raw.width_m if any(unit is not None and unit.quantity == "flow" for unit in units) else None
    )


def _find_work_column(
    raw: RawTable, columns: dict[str, Column], out: ImportGuess, used: set[str | None]
) -> Working | None:
    """Returns the column that states when the machine worked, a switch or a word; None without such
    a column."""
    taken = {column.source for column in columns.values()} | used
    # The log's own columns of the state need no guess.
    if "state" in columns or "work_switch" in columns:
        return None
    for source in raw.names:
        plain = fold_column_name(split_unit_name(source)[0])
        subject = find_subject(plain, None)
        if source in taken or subject is None or subject.id != "work":
            continue
        column = raw.columns[source]
        texts = (
            column.tolist() if is_text_column(column) else format_numbers(column.astype(np.float64))
        )
        # Twelve different words are enough to see that a column is no switch.
        kinds = list(islice(filter(None, dict.fromkeys(text.strip() for text in texts)), 12))
        on = [kind for kind in kinds if kind.casefold().removesuffix(".0") in SWITCH_ON_WORDS]
        # A column with more words is no switch.
        if len(kinds) > 6 or len(on) != 1:
            continue
        rivals = [
            name for name in raw.names if name.partition(" (")[0] == source.partition(" (")[0]
        ]
        # Several sections may each have a switch, and their states may differ.
        if len(rivals) > 1:
            out.doubts.append(
                ImportDoubt(
                    ("working",),
                    f"{len(rivals)} columns say it, and not alike ({format_list(rivals, 4)}): "
                    "which says that the machine works?",
                )
            )
        mark: float | str = float(on[0]) if on[0].removesuffix(".0").isdigit() else on[0]
        out.reasons[("working",)] = f"{source} is one of {', '.join(sorted(kinds))}"
        # A lift sensor may be on in either position, so the operator must decide.
        if has_any_word(plain, AMBIGUOUS_SWITCH_WORDS):
            out.doubts.append(
                ImportDoubt(("working",), f"{source}: is {on[0]} working, or lifted?")
            )
        return Working(column=source, equals=(mark,))
    return None
