"""A first import file by looking at a table: by names, by units, by ranges, by physics. What is not sure is said."""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from control.log_row import COLUMNS, TEXT_COLUMNS
from drivers.files.imports import physics
from drivers.files.imports.convert import convert, extra_name
from drivers.files.imports.guess_time import guess_times
from drivers.files.imports.header import named
from drivers.files.imports.mapping import NOT_MAPPED, Column, ImportFile, Working
from drivers.files.imports.numbers import numbers
from drivers.files.imports.raw import RawTable
from drivers.files.imports.trouble import ImportTrouble
from drivers.files.imports.units import Unit, quantity_of, unit_named
from drivers.files.imports.words import (
    COMMAND,
    EITHER_WAY,
    ON,
    PLAINLY_READING,
    QUANTITIES,
    RAW_COMMAND,
    READING,
    Subject,
    folded,
    says,
    subject_of,
)
from drivers.files.log_values import PLAUSIBLE

Key = tuple[str, ...]

LOOKED_AT = 50_000              # rows, for what the converted numbers say
SLIP = (0.7, 1.6)               # a wheel's speed over the ground's, on any ground
ALIKE = 0.1                     # command and reading so near one another are in the same unit
BEYOND = 0.02                   # of the largest value: readings about zero are noisy
MOVING_MPS = 0.3
TOO_FAST = 60.0                 # no machine works at such a speed in km/h or any larger unit: a rotation
FAST_MPS = 8.0                  # no spreader works at more than 29 km/h: such a number is km/h, or no ground speed
PAIRS = (("shaft_rpm_cmd", "shaft_rpm"), ("opening_mm_cmd", "opening_mm"), ("target_rate_kg_ha", "applied_rate_kg_ha"))
DEGREES = ("latitude", "longitude", "heading")      # what these are in needs no word
IN_RPM = ("rpm", "drehzahl", "转速")                 # words that are units by themselves
DRIVEN = ("shaft_rpm_cmd", "opening_mm_cmd")        # commands that a row may hold with their settled answer
_LOG_UNITS = {"speed": "m/s", "rotation": "r/min", "length": "mm", "mass": "kg", "rate": "kg/ha", "angle": "deg",
              "voltage": "V", "share": "%", "time": "s"}


class Doubt(NamedTuple):
    """`key`: of the import file; `text`: why it is not sure."""

    key: Key
    text: str


@dataclass
class Guess:
    """`reasons`: why each key is as it is. `open`: columns that need a number from outside the file, as YAML text."""

    mapping: ImportFile
    doubts: list[Doubt] = field(default_factory=list)
    reasons: dict[Key, str] = field(default_factory=dict)
    open: dict[str, str] = field(default_factory=dict)

    @property
    def sure(self) -> bool:
        return not self.doubts


@dataclass
class _Candidate:
    source: str
    target: str
    unit: Unit | None
    implied: bool = False           # the unit is told by the name
    role: str = ""                  # command, reading, or not told
    exact: bool = False
    values: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def weight(self) -> tuple[bool, bool, bool]:
        return self.exact, self.unit is not None or self.implied, self.role != ""


def guess(raw: RawTable) -> Guess:
    """Raises ImportTrouble where the table has no times that can be read at all."""
    time = guess_times(raw)
    out = Guess(ImportFile(source=raw.source, time=time.times, columns={}))
    out.reasons[("time",)] = time.why
    if time.doubt:
        out.doubts.append(Doubt(("time",), time.doubt))
    used = {time.times.column, time.times.date_column}
    candidates = [one for name in raw.names if name not in used and (one := _candidate(raw, name)) is not None]
    _tell_roles(candidates)
    chosen = _chosen(candidates, out)
    columns: dict[str, Column] = {}
    for target in (name for name in COLUMNS if name in chosen):
        column = _column(chosen[target], out)
        if column is not None:
            columns[target] = column
    columns |= _extra_sentinels(raw, {one.source for one in chosen.values()} | used)
    working = _working(raw, columns, out, used)
    out.mapping = ImportFile(source=raw.source, time=time.times, columns=columns, working=working)
    _by_physics(raw, out, chosen)
    if not any(name in COLUMNS for name in out.mapping.columns):
        out.doubts.append(Doubt(("columns",), "no column was recognised: say which column of the file is which"))
    return out


def _candidate(raw: RawTable, name: str) -> _Candidate | None:
    if raw.frame[name].dtype.is_temporal():
        return None
    plain = folded(named(name)[0])
    unit = unit_named(raw.units[name]) if name in raw.units else None
    if name in COLUMNS and name not in NOT_MAPPED:
        return _Candidate(name, name, None, implied=True, exact=True, values=_values(raw, name))
    subject = subject_of(plain, unit.quantity if unit else None)
    if subject is None or not subject.reading or subject.id == "work":
        return None
    role = "command" if says(plain, COMMAND) else "reading" if says(plain, READING) else ""
    if says(plain, READING) and says(plain, COMMAND) and not says(plain, RAW_COMMAND):
        role = "reading" if says(plain, PLAINLY_READING) else "command"
    target = _target(subject, plain, role)
    values = _values(raw, name)
    if not np.isfinite(values).any() and target not in TEXT_COLUMNS:
        return None
    implied = quantity_of(target) is None or subject.id in DEGREES or (
        subject.id == "shaft" and says(plain, IN_RPM))
    if subject.id == "speed" and unit is None and _too_fast(values):
        target = "shaft_rpm_cmd" if role == "command" else "shaft_rpm"
    elif subject.id == "speed" and role == "command":
        return None                     # a ground speed that somebody wants
    return _Candidate(name, target, unit, implied and unit is None, role, values=values)


def _target(subject: Subject, plain: str, role: str) -> str:
    if subject.id == "ndvi" and plain[-1:] in "123456":
        return f"ndvi_{plain[-1]}"
    return subject.command if role == "command" and subject.command else subject.reading


def _values(raw: RawTable, name: str) -> NDArray[np.float64]:
    found = numbers(raw.frame[name], raw.decimal_comma)
    return found.values.to_numpy() if found.bad <= 0.5 * max(1, found.values.len()) else np.empty(0)


def _too_fast(values: NDArray[np.float64]) -> bool:
    moving = np.abs(values[np.isfinite(values)])
    moving = moving[moving > MOVING_MPS]
    return bool(moving.size and np.median(moving) > TOO_FAST)


def _tell_roles(candidates: list[_Candidate]) -> None:
    """Of two columns of one kind and no word which is which: the one that the other follows is the command."""
    for command, reading in PAIRS:
        alike = [one for one in candidates if one.target == reading and one.role == ""]
        if len(alike) != 2 or any(one.target == command or (one.target == reading and one.role) for one in candidates):
            continue
        found = physics.answer(alike[0].values, alike[1].values)
        if found is not None and found.lag != 0 and found.strength > physics.LEAST_CORRELATION:
            first = alike[0] if found.lag > 0 else alike[1]
            first.target, first.role = command, "by physics"


def _chosen(candidates: list[_Candidate], out: Guess) -> dict[str, _Candidate]:
    """The best candidate of each log column; where several fit as well, the first and a doubt."""
    by_target: dict[str, list[_Candidate]] = {}
    for one in candidates:
        by_target.setdefault(one.target, []).append(one)
    chosen = {}
    for target, several in by_target.items():
        several = sorted(several, key=lambda one: one.weight, reverse=True)
        best = chosen[target] = several[0]
        rivals = [one.source for one in several[1:] if one.weight == best.weight
                  or one.source.startswith(f"{best.source} (")]         # of the same name
        if rivals:
            out.doubts.append(Doubt(("columns", target), f"{' and '.join(rivals)} would fit as well as {best.source}"))
        if best.role == "by physics":
            out.doubts.append(Doubt(("columns", target), f"no word says that {best.source} is the command: the other "
                                    "column follows it"))
    return chosen


def _column(one: _Candidate, out: Guess) -> Column | None:
    """The import file's words for a candidate; None where a number is wanting that the file does not hold."""
    key: Key = ("columns", one.target)
    quantity = quantity_of(one.target)
    if one.exact or one.target in TEXT_COLUMNS:
        out.reasons[key] = "the log's own name"
        return Column.of(one.source, missing=_missing(one))
    if one.unit is None:
        return _without_unit(one, quantity, out)
    out.reasons[key] = "name and unit of the header"
    if one.unit.quantity == quantity or (quantity is None and one.unit.name == "%"):
        return Column.of(one.source, unit=one.unit.name, missing=_missing(one, one.unit.factor))
    if one.unit.name == "%" and quantity == "angle":
        return Column.of(one.source, unit="slope %", missing=_missing(one))
    if one.unit.name == "%" and quantity is not None:
        out.doubts.append(Doubt(key, f"{one.source} is in %: the file does not say what 100 % is in "
                                f"{_LOG_UNITS[quantity]}"))
        out.open[one.target] = f'{{from: {_quoted(one.source)}, unit: "%", full: }}'
        return None
    if quantity == "rate" and one.unit.quantity == "flow":
        out.doubts.append(Doubt(key, f"{one.source} is a flow: the working width width_m is not in the file"))
        out.open[one.target] = f"{{from: {_quoted(one.source)}, unit: {one.unit.name}}}     # and, on top, width_m: "
        return None
    return None


def _quoted(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _without_unit(one: _Candidate, quantity: str | None, out: Guess) -> Column | None:
    key: Key = ("columns", one.target)
    missing = _missing(one)
    if one.implied or quantity is None:
        out.reasons[key] = "the name"
        return Column.of(one.source, missing=missing)
    known = one.values[np.isfinite(one.values) & ~np.isin(one.values, missing)]
    unit = _LOG_UNITS[quantity]
    if quantity == "voltage":
        unit = "mV" if np.median(np.abs(known)) > 500.0 else "V"
        out.reasons[key] = f"no unit: {unit} by the range ({known.min():g} to {known.max():g})"
        return Column.of(one.source, unit=unit, missing=missing)
    if quantity == "angle":
        out.reasons[key] = "the name"
        if known.size and np.abs(known).max() < 1.6:
            out.doubts.append(Doubt(key, f"no unit: degrees or radians? (values up to {np.abs(known).max():.3g})"))
        return Column.of(one.source, unit="deg", missing=missing)
    moving = known[known > MOVING_MPS]
    if quantity == "speed" and moving.size and np.median(moving) > FAST_MPS:
        unit = "km/h"
    spread = f"{known.min():g} to {known.max():g}" if known.size else "no values"
    out.doubts.append(Doubt(key, f"no unit in the header: taken for {unit} ({spread})"))
    return Column.of(one.source, unit=unit, missing=missing)


def _missing(one: _Candidate, factor: float = 1.0) -> tuple[float, ...]:
    low, high = PLAUSIBLE.get(one.target, (-np.inf, np.inf))
    factor = factor if np.isfinite(factor) else 1.0
    return tuple(physics.sentinels(one.values, (low / factor, high / factor))) if one.values.size else ()


def _extra_sentinels(raw: RawTable, used: Iterable[str | None]) -> dict[str, Column]:
    """Columns beyond the log's own are kept as they are; those with numbers that stand for nothing are named for it."""
    columns: dict[str, Column] = {}
    for source in raw.names:
        if source in set(used) or raw.frame[source].dtype.is_temporal():
            continue
        marks = physics.sentinels(_values(raw, source), (-np.inf, np.inf))
        name = extra_name(source, raw.units.get(source))
        if marks and name not in columns:
            columns[name] = Column.of(source, missing=tuple(marks))
    return columns


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
        mark: float | str = float(on[0]) if on[0].removesuffix(".0").isdigit() else on[0]
        out.reasons[("working",)] = f"{source} is one of {', '.join(sorted(kinds))}"
        if says(plain, EITHER_WAY):
            out.doubts.append(Doubt(("working",), f"{source}: is {on[0]} working, or lifted?"))
        return Working(column=source, equals=(mark,))
    return None


def _by_physics(raw: RawTable, out: Guess, chosen: dict[str, _Candidate]) -> None:
    """What the converted numbers say against or for the guess."""
    head = RawTable(raw.path, raw.frame.head(LOOKED_AT), raw.source, raw.units, raw.first_row)
    try:
        tried = convert(head, out.mapping.model_copy(update={"extra": "drop"}))
    except ImportTrouble as trouble:
        out.doubts.append(Doubt(("time",), str(trouble).splitlines()[0]))
        return
    time_s = (tried.frame["us"] - tried.frame["us"][0]).to_numpy() / 1e6
    columns = {name: tried.frame[name].to_numpy() for name in tried.frame.columns
               if tried.frame[name].dtype == pl.Float64}
    _speeds(time_s, columns, out, chosen)
    _ranges(columns, out)
    _commands(time_s, columns, out, chosen)
    _hopper(columns, out)


def _speeds(time_s: NDArray[np.float64], columns: dict[str, NDArray[np.float64]], out: Guess,
            chosen: dict[str, _Candidate]) -> None:
    if "lat_deg" not in columns or "lon_deg" not in columns:
        return
    for name in ("speed_mps", "wheel_speed_mps", "speed_used_mps"):
        if name not in columns:
            continue
        unit, ratio = physics.speed_unit(time_s, columns["lat_deg"], columns["lon_deg"], columns[name])
        if ratio != ratio:
            continue
        column, key = out.mapping.columns[name], ("columns", name)
        written = unit_named(column.unit or "m/s")
        assert written is not None
        slips = name == "wheel_speed_mps" and chosen[name].unit is not None and SLIP[0] < ratio < SLIP[1]
        if unit == "m/s" or slips:                          # as converted: what the header or the range said holds
            out.reasons[key] = f"{written.name}: {ratio:.2f} times the speed between the places"
            out.doubts = [doubt for doubt in out.doubts if doubt.key != key or "unit" not in doubt.text]
        elif chosen[name].unit is None:
            _without_told_unit(name, ratio / written.factor, column, out)
        else:
            out.doubts.append(Doubt(key, f"in {written.name}, as the header says, it is {ratio:.2f} times the speed "
                                    "between the places"))


def _without_told_unit(name: str, ratio: float, column: Column, out: Guess) -> None:
    """`ratio`: of the file's own numbers to m/s between places."""
    key = ("columns", name)
    fits = physics.unit_of_ratio(ratio)
    if fits is None:
        out.doubts.append(Doubt(key, f"it is {ratio:.2f} times the speed between the places: no unit makes that"))
        return
    changed = {**out.mapping.columns, name: column.model_copy(update={"unit": fits})}
    out.mapping = out.mapping.model_copy(update={"columns": changed})
    out.doubts = [doubt for doubt in out.doubts if doubt.key != key or "unit" not in doubt.text]
    out.reasons[key] = f"no unit: {fits}, which makes the distance between the places"


def _ranges(columns: dict[str, NDArray[np.float64]], out: Guess) -> None:
    for name, values in columns.items():
        known = values[np.isfinite(values)]
        if name not in PLAUSIBLE or not known.size:
            continue
        low, high = PLAUSIBLE[name]
        noise = BEYOND * np.abs(known).max()
        outside = known[(known < low - noise) | (known > high + noise)]
        if outside.size > 0.01 * known.size:
            text = f"{outside.size} of {known.size} values such as {outside[0]:g} are beyond {low:g} to {high:g}"
            out.doubts.append(Doubt(("columns", name), f"{text}, which {name} can be"))


def _commands(time_s: NDArray[np.float64], columns: dict[str, NDArray[np.float64]], out: Guess,
              chosen: dict[str, _Candidate]) -> None:
    """Commands without a unit scaled to their readings, and whether a row holds a command with its settled answer."""
    for command, reading in PAIRS:
        if command not in columns or reading not in columns:
            continue
        key = ("columns", command)
        one = chosen.get(command)
        if one is not None and one.unit is None and not one.implied and command in DRIVEN:
            bare = not says(folded(one.source), QUANTITIES)
            _scaled(command, physics.slope(columns[command], columns[reading]), bare, out)
        found = physics.answer(columns[command], columns[reading])
        if found is not None and found.strength >= physics.LEAST_CORRELATION:
            if found.lag < 0:
                out.doubts.append(Doubt(key, f"{reading} moves {-found.lag} rows before it: are the two exchanged?"))
            elif found.lag == 0 and command in DRIVEN:
                _answer_in_row(out, f"{reading} moves in the very row in which {command} does: does a row hold a "
                               "command and what it settled at?")
        elif command in DRIVEN and physics.settings_a_row(time_s, columns[command]):
            apart_s = float(np.median(np.diff(time_s)))
            _answer_in_row(out, f"nearly every row has another {command}, and rows are {apart_s:.2g} s apart: taken "
                           "for settings with their settled answers")


def _answer_in_row(out: Guess, text: str) -> None:
    if out.mapping.rows != "answer_in_row":
        out.mapping = out.mapping.model_copy(update={"rows": "answer_in_row"})
        out.doubts.append(Doubt(("rows",), text))


def _scaled(command: str, factor: float, bare: bool, out: Guess) -> None:
    """`bare`: its name says no quantity, so that it may count anything, as PWM does."""
    key = ("columns", command)
    out.doubts = [doubt for doubt in out.doubts if doubt.key != key or "no unit" not in doubt.text]
    if not np.isfinite(factor) or factor == 0.0:
        out.doubts.append(Doubt(key, "no unit in the header, and the readings do not tell a scale"))
        return
    if not bare or abs(factor - 1.0) < ALIKE:
        out.doubts.append(Doubt(key, f"no unit in the header; its readings are {factor:.3g} times as large: taken for "
                                "the same unit"))
        return
    column = out.mapping.columns[command]
    changed = {**out.mapping.columns, command: column.model_copy(update={"scale": float(f"{factor:.4g}")})}
    out.mapping = out.mapping.model_copy(update={"columns": changed})
    out.doubts.append(Doubt(key, f"no unit in the header: scaled by {factor:.4g}, the usual ratio of its reading to "
                            "it; what the maker says of it is better"))


def _hopper(columns: dict[str, NDArray[np.float64]], out: Guess) -> None:
    """A hopper that fills all the while is turned round or something else."""
    hopper = columns.get("hopper_kg")
    if hopper is not None and hopper.size > 20:
        known = hopper[np.isfinite(hopper)]
        if known.size > 20 and np.mean(np.diff(known) > 0.0) > 0.8 and known[-1] > known[0]:
            out.doubts.append(Doubt(("columns", "hopper_kg"), "it grows nearly all the time: does it count what was "
                                    "applied?"))

