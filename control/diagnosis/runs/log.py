"""Examines the recorded data for anomalies, corrects them where that is safe, and reports each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.log_row import COLUMNS, COMMANDS_HELD_EVENT, DOSE_EVENT, EFFORT_COLUMNS
from topdress.control.machine.machine import Machine, allow_long_answers
from topdress.control.orders import State
from topdress.control.recordings.column_repair import mend_recording
from topdress.control.recordings.finding import Finding
from topdress.control.recordings.row_times import LONG_STEP_S
from topdress.control.recordings.speed_unit import MOVING_MPS
from topdress.control.recordings.valid_values import (
    UNLIMITED,
    blank_held_readings,
    blank_outliers,
    blank_sentinels,
    blank_unreadable,
    round_as_printed,
)

from .unit_change import restore_units

# Maximum number of further columns, besides the ten published variables: 560 products of two.
MAX_FURTHER_COLUMNS = 24
# Number of pieces of the log whose means are compared: a transient affects a single piece.
PIECE_COUNT = 400
# Minimum number of pieces for a correlation.
MIN_LOG_PIECES = 20
# Correlation from which two columns are copies: the same reading, in another unit or rounded.
COPY_CORRELATION = 0.99999
# Number of rows on which columns are compared.
COMPARED_ROW_COUNT = 4_000
# Maximum length of a column's name, letters; `control.machine.terms` has the same limit.
MAX_NAME_LETTERS = 200
# Minimum spread of a column in its own unit: coefficients of a smaller spread exceed the range of a
# machine file.
MIN_SPREAD = 1e-3
# Number of column names that a finding lists.
MAX_LISTED_NAMES = 3
Array = npt.NDArray[np.float64]
# Maximum median row distance, s: the slowest staircase of settings stays this long on a setting.
MAX_STEP_S = 600.0
HEAD_COLUMNS = tuple(f"ndvi_{k}" for k in range(1, 7))
REQUIRED_COLUMNS = {
    "shaft": ("shaft_rpm_cmd", "shaft_rpm"),
    "gate": ("opening_mm_cmd", "opening_mm"),
    "flow": ("shaft_rpm", "opening_mm", "hopper_kg"),
    "speed": ("speed_mps", "wheel_speed_mps"),
    "heads": HEAD_COLUMNS[:3],
}
DRIVE_EFFORT_COLUMNS = {
    "effort": ("shaft_rpm", "shaft_effort"),
    "gate_effort": ("opening_mm", "gate_effort"),
}
NUMBER_COLUMNS = (
    "shaft_rpm_cmd",
    "shaft_rpm",
    "opening_mm_cmd",
    "opening_mm",
    "hopper_kg",
    "supply_v",
    "pitch_deg",
    "roll_deg",
    "heading_deg",
    "speed_mps",
    "wheel_speed_mps",
    "work_switch",
    *HEAD_COLUMNS,
    *EFFORT_COLUMNS,
)
# Published columns that no diagnosis of a log reads: neither the channels nor `rates`.
UNREAD_COLUMNS = frozenset(COLUMNS) - {
    "time_s",
    *NUMBER_COLUMNS,
    "events",
    "state",
    "lat_deg",
    "lon_deg",
    "target_rate_kg_ha",
    "applied_rate_kg_ha",
}
# Columns that determine the unit of a speed.
UNIT_COLUMNS = ("time_s", "lat_deg", "lon_deg")
# Speed below which a machine stands, m/s: the noise of a receiver.
STANDING_MPS = 0.05
# Longest answer of a drive alone as a share of its log.
LONGEST_ANSWER_SHARE = 0.25
# Minimum number of rows of a log.
MIN_ROWS = 40
# Minimum number of rows of settled answers: each is a mean, and a rising staircase has this many
# steps.
MIN_SETTLED_ROWS = 20
# Minimum share of valid rows of a further column.
MIN_VALID_SHARE = 0.5


class SelectedColumns(NamedTuple):
    """Further columns that are searched, and findings about the others."""

    # Selected columns, (n,) each.
    columns: dict[str, Array]
    # A finding for each kind of column that was left out.
    said: tuple[str, ...]


def select_variables(further: Mapping[str, Array], known: Mapping[str, Array]) -> SelectedColumns:
    """Select the further columns (n,) that the search uses: those with information of their own, up
    to a maximum.

    A bus log has thousands of signals. Products of any two are tried, so time and memory grow with
    the square of their number, as does the chance of an accidental fit. If there are too many, the
    columns are selected that correlate best with a channel's reading after the fit of its commands,
    for each channel (sure independence screening: Fan and Lv, J. R. Statist. Soc. B 70, 2008).
    known : the published columns (n,), NaN where not valid.
    """
    said: list[str] = []
    named = {
        name: values
        for name, values in further.items()
        if 0 < len(name.strip()) <= MAX_NAME_LETTERS
    }
    _add_finding(
        said,
        [name for name in further if name not in named],
        f"without a name, or with one of more than {MAX_NAME_LETTERS} letters",
    )
    wide = {name: values for name, values in named.items() if _calc_spread(values) >= MIN_SPREAD}
    _add_finding(
        said,
        [name for name in named if name not in wide],
        f"changing by less than {MIN_SPREAD:g}: in a smaller unit they could be judged",
    )
    single = _remove_copies(wide, known)
    _add_finding(
        said, [name for name in wide if name not in single], "the same readings as another column"
    )
    kept = single if len(single) <= MAX_FURTHER_COLUMNS else _select_closest(single, known)
    _add_finding(
        said,
        [name for name in single if name not in kept],
        f"too many to be asked about: the {MAX_FURTHER_COLUMNS} that go best with the readings are "
        "kept (an import file that "
        "names the columns wanted, with extra: drop, says which)",
    )
    return SelectedColumns(kept, tuple(said))


def _add_finding(said: list[str], names: list[str], why: str) -> None:
    if names:
        shown = ", ".join(
            name if len(name) <= 40 else f"{name[:37]}..." for name in names[:MAX_LISTED_NAMES]
        )
        more = f" and {len(names) - MAX_LISTED_NAMES} more" if len(names) > MAX_LISTED_NAMES else ""
        said.append(f"further column{'s' if len(names) > 1 else ''} {shown}{more} left out: {why}")


def _calc_spread(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(np.percentile(known, (1.0, 99.0)))) if len(known) else 0.0


def _standardise_columns(columns: Mapping[str, Array], rows: npt.NDArray[np.int64]) -> Array:
    """Return columns at some rows minus their mean, scaled to length 1, with missing values at the
    mean: (k, rows)."""
    picked = np.array([values[rows] for values in columns.values()])
    known = np.isfinite(picked)
    filled = np.where(known, picked, 0.0)
    middle = filled.sum(axis=1, keepdims=True) / np.maximum(1, known.sum(axis=1, keepdims=True))
    centred = np.where(known, filled - middle, 0.0)
    length = np.sqrt((centred**2).sum(axis=1, keepdims=True))
    return np.asarray(centred / np.where(length > 0.0, length, 1.0))


def _remove_copies(columns: dict[str, Array], known: Mapping[str, Array]) -> dict[str, Array]:
    if not columns:
        return columns
    count = len(next(iter(columns.values())))
    rows = np.unique(np.linspace(0, count - 1, min(count, COMPARED_ROW_COUNT)).astype(np.int64))
    ours, theirs = (
        _standardise_columns(columns, rows),
        _standardise_columns(known, rows) if known else np.zeros((0, len(rows))),
    )
    copied = np.asarray((np.abs(ours @ theirs.T) > COPY_CORRELATION).any(axis=1))
    same = np.asarray(np.abs(ours @ ours.T) > COPY_CORRELATION)
    kept: list[int] = []
    for k in range(len(ours)):
        if not copied[k] and not same[k][kept].any():
            kept.append(k)
    names = list(columns)
    return {names[k]: columns[names[k]] for k in kept}


def _select_closest(columns: dict[str, Array], known: Mapping[str, Array]) -> dict[str, Array]:
    """Select the columns that correlate best with a channel's reading minus the fit of the
    published columns, in means over pieces."""
    count = len(next(iter(columns.values())))
    pieces = max(MIN_LOG_PIECES, min(PIECE_COUNT, count // 10))
    edges = np.linspace(0, count, pieces + 1).astype(np.int64)
    theirs = {
        name: _average_pieces(values, edges)
        for name, values in known.items()
        if np.isfinite(values).any()
    }
    ours = {name: _average_pieces(values, edges) for name, values in columns.items()}
    every = np.arange(pieces)
    ours_there = _standardise_columns(ours, every)
    best = np.zeros(len(ours))
    for target, by in _list_channel_targets(theirs):
        plain = _standardise_columns({"target": target}, every)[0]
        against = (
            np.vstack((np.ones(pieces), _standardise_columns(by, every)))
            if by
            else np.ones((1, pieces))
        )
        left = _subtract_fit(plain[None], against)[0]
        rest = _subtract_fit(ours_there, against)
        length = np.sqrt((rest**2).sum(axis=1) * float(left @ left))
        best = np.maximum(best, np.abs(rest @ left) / np.where(length > 0.0, length, 1.0))
    chosen = sorted(np.argsort(-best, kind="stable")[:MAX_FURTHER_COLUMNS].tolist())
    names = list(columns)
    return {names[k]: columns[names[k]] for k in chosen}


def _list_channel_targets(means: Mapping[str, Array]) -> list[tuple[Array, dict[str, Array]]]:
    """Return each channel's reading with the columns that the reading is known to follow."""
    found = []
    for reading, command in (
        ("shaft_rpm", "shaft_rpm_cmd"),
        ("opening_mm", "opening_mm_cmd"),
        ("wheel_speed_mps", "speed_mps"),
    ):
        if reading in means and command in means:
            found.append((means[reading], {command: means[command]}))
    if "hopper_kg" in means:
        drives = {name: means[name] for name in ("shaft_rpm", "opening_mm") if name in means}
        if len(drives) == 2:
            drives["both"] = drives["shaft_rpm"] * drives["opening_mm"]
        found.append((np.gradient(means["hopper_kg"]), drives))
    return found


def _subtract_fit(rows: Array, against: Array) -> Array:
    """Return rows (k, m) minus their least-squares fit to other rows (j, m)."""
    basis = np.linalg.svd(against, full_matrices=False)
    span = basis[2][basis[1] > 1e-9 * basis[1].max()]
    return np.asarray(rows - (rows @ span.T) @ span)


def _average_pieces(values: Array, edges: npt.NDArray[np.int64]) -> Array:
    """Return the mean of the valid values in each piece; the overall mean where a piece has no
    valid value."""
    known = np.isfinite(values)
    sums = np.add.reduceat(np.where(known, values, 0.0), edges[:-1])
    counts = np.add.reduceat(known.astype(np.float64), edges[:-1])
    usual = float(values[known].mean()) if known.any() else 0.0
    return np.where(counts > 0.0, sums / np.maximum(counts, 1.0), usual)


class CleanLog(NamedTuple):
    """A cleaned run log. Arrays have shape (n,); NaN means not valid."""

    time_s: Array
    # Median row distance, s.
    step_s: float
    columns: dict[str, Array]
    # Texts of the events, shape (n,).
    events: npt.NDArray[Any]
    state: npt.NDArray[Any]
    # Channels that this log can show.
    stages: tuple[str, ...]
    findings: tuple[str, ...]
    # Numeric columns beyond the published columns, by name.
    further: dict[str, Array] = {}
    # Whether each command is held until the next row, so that no command is missing.
    held: bool = False

    @property
    def working_flags(self) -> Array:
        """Return 1 where the log says that the machine works, 0 where it does not work, NaN where
        the log does not say: (n,)."""
        if (self.state != "").any():
            return np.where(self.state == State.WORKING, 1.0, 0.0)
        return np.where(
            np.isfinite(self.columns["work_switch"]), self.columns["work_switch"] > 0.5, np.nan
        )

    def has_column(self, name: str) -> bool:
        return bool(np.isfinite(self.columns[name]).any())


def clean_run_log(
    columns: Mapping[str, npt.NDArray[Any]], has: Callable[[str], bool] = lambda stage: True
) -> CleanLog:
    """Examine and clean the columns of a run log (by its contract: `time_s` in s, the others
    optional).

    has : tells whether the machine has a stage; columns of a missing stage are neither examined nor
    reported.

    Raises ValueError with one plain line where there is no usable time column.
    """
    if "time_s" not in columns:
        raise ValueError("column time_s: missing: a run log needs it")
    read, odd = mend_recording(
        {
            **{
                name: np.asarray(columns[name], np.float64)
                for name in (*UNIT_COLUMNS, *NUMBER_COLUMNS)
                if name in columns
            },
            **_split_columns(columns),
        }
    )
    time = read["time_s"] - read["time_s"][0]
    events = {word for text in set(read["events"].tolist()) for word in str(text).split(";")}
    held = COMMANDS_HELD_EVENT in events
    least = MIN_SETTLED_ROWS if held else MIN_ROWS
    step = _calc_row_step(time, least, odd)
    found = {
        name: blank_unreadable(round_as_printed(read[name]))
        if name in read
        else np.full(len(time), np.nan)
        for name in NUMBER_COLUMNS
    }
    changed: list[str] = []
    found = restore_units(found, time, changed)
    for name in ("shaft_rpm", "opening_mm", "hopper_kg"):
        found[name] = blank_held_readings(name, found[name], step, odd)
    for name in ("supply_v", "pitch_deg", "roll_deg"):
        found[name] = blank_outliers(name, found[name], odd)
    findings = [*map(str, odd), *changed]
    never = ": a scale that never changes is not read"
    found["hopper_kg"] = _reject_frozen("hopper_kg", found["hopper_kg"], never, findings)
    asked_rpm = float(np.nanmax(np.abs(np.r_[0.0, found["shaft_rpm_cmd"]])))
    if asked_rpm > 0.0 and not np.nansum(np.abs(found["shaft_rpm"])):
        never = (
            f", though up to {asked_rpm:g} r/min were commanded: it never turned, or is not read"
        )
        found["shaft_rpm"] = _reject_frozen("shaft_rpm", found["shaft_rpm"], never, findings)
    stood = _is_standing_still(found)
    if stood and (has("speed") or has("heads")):
        fastest = _calc_fastest_mps(found)
        moved = (
            "stood all the time"
            if fastest < STANDING_MPS
            else f"drove at {fastest:.2g} m/s at most, too slowly to tell speeds from noise"
        )
        findings.append(f"the machine {moved}: its speeds and canopy heads are left out")
    dosed = any(word.startswith(DOSE_EVENT) for word in events)
    unseen = {"speed", "heads"} if stood else set()
    if dosed and has("shaft"):
        unseen |= {"shaft", "flow", "effort"}
        findings.append(
            "the shaft turned for single doses, whose set-points are no column of a log: shaft, "
            "flow and scale are left out"
        )
    stages = _select_stages(
        found, lambda stage: has(stage) and stage not in unseen, least, findings
    )
    further = _read_further_columns(read, {**found, "time_s": time}, findings)
    return CleanLog(
        time,
        step,
        found,
        read["events"],
        read["state"],
        tuple(stages),
        tuple(findings),
        further,
        held,
    )


def _select_stages(
    found: Mapping[str, Array], has: Callable[[str], bool], least: int, findings: list[str]
) -> list[str]:
    """Return the stages whose columns have at least `least` values, and report the others."""
    stages = []
    for stage, needed in REQUIRED_COLUMNS.items():
        if not has(stage):
            continue
        missing = [name for name in needed if np.isfinite(found[name]).sum() < least]
        if missing:
            findings.append(
                f"stage {stage} is left out: column {missing[0]} is missing or nearly empty"
            )
        else:
            stages.append(stage)
    if "flow" in stages:
        stages.append("scale")
    return stages + _select_effort_drives(found, has, least)


def _select_effort_drives(
    found: Mapping[str, Array], has: Callable[[str], bool], least: int
) -> list[str]:
    """Return the drives with an effort column; the absence of the column is not reported, because
    few drives have one."""
    return [
        stage
        for stage, needed in DRIVE_EFFORT_COLUMNS.items()
        if has(stage) and all(np.isfinite(found[name]).sum() >= least for name in needed)
    ]


def _split_columns(columns: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Return events and states as texts, and the numeric columns that are not published: (n,)
    each."""
    count = len(columns["time_s"])
    texts = {
        name: np.array(
            [
                "" if text is None or text != text else str(text)
                for text in np.asarray(columns[name], object)
            ],
            object,
        )
        if name in columns
        else np.full(count, "", object)
        for name in ("events", "state")
    }
    return texts | {
        name: np.asarray(raw, np.float64)
        for name, raw in columns.items()
        if name not in COLUMNS and np.issubdtype(np.asarray(raw).dtype, np.number)
    }


def _read_further_columns(
    read: Mapping[str, npt.NDArray[Any]], published: Mapping[str, Array], findings: list[str]
) -> dict[str, Array]:
    """Return the numeric columns that are not published and vary: an effect may depend on them."""
    found, odd = {}, list[Finding]()
    for name, raw in read.items():
        if name in COLUMNS:
            continue
        values = blank_outliers(
            name,
            blank_unreadable(blank_sentinels(name, round_as_printed(raw), UNLIMITED, odd)),
            odd,
        )
        seen = values[np.isfinite(values)]
        if (
            len(seen) >= max(MIN_ROWS, MIN_VALID_SHARE * len(values))
            and np.ptp(np.percentile(seen, (1.0, 99.0))) > 0.0
        ):
            found[name] = values
    kept = select_variables(found, published)
    findings += [*map(str, odd), *kept.said]
    return kept.columns


def _calc_row_step(time: Array, least: int, findings: list[Finding]) -> float:
    """Return the median row distance, s. Raises ValueError where rows are too few, or too far
    apart."""
    if len(time) < least:
        raise ValueError(f"column time_s: {len(time)} usable rows: at least {least} are needed")
    step = float(np.median(np.diff(time)))
    if step > MAX_STEP_S:
        raise ValueError(
            f"column time_s: {len(time)} rows are {step:,.0f} s apart, {time[-1]:,.0f} s in "
            "all: allowed "
            f"up to {MAX_STEP_S:g} s between rows: are the times in another unit?"
        )
    if step > LONG_STEP_S:
        findings.append(
            Finding(
                "seldom",
                f"column time_s: {time[-1]:,.0f} s for {len(time)} rows, one each "
                f"{step:,.0f} s: are the times in another unit?",
                "time_s",
            )
        )
    return step


def _reject_frozen(name: str, values: Array, why: str, findings: list[str]) -> Array:
    """Reject readings that are identical in every row: no real hopper, full or empty, has no
    noise."""
    known = values[np.isfinite(values)]
    if len(known) < MIN_ROWS or np.ptp(known) > 0.0:
        return values
    findings.append(f"column {name}: {known[0]:g} in every row{why}: left out")
    return np.full(len(values), np.nan)


def _is_standing_still(found: dict[str, Array]) -> bool:
    """Tell whether the machine hardly moved.

    Wheel and GNSS then show only their noise, and each head only its own piece of canopy.
    """
    return _calc_fastest_mps(found) < MOVING_MPS


def _calc_fastest_mps(found: dict[str, Array]) -> float:
    """Return the highest speed, m/s, single outliers ignored; infinite where none is recorded."""
    return max(
        (
            float(np.nanquantile(found[name], 0.98))
            for name in ("speed_mps", "wheel_speed_mps")
            if np.isfinite(found[name]).any()
        ),
        default=np.inf,
    )


def fit_answers_to_log(machine: Machine, columns: Mapping[str, npt.NDArray[Any]]) -> Machine:
    """Return a drive alone whose answers may last up to LONGEST_ANSWER_SHARE of a log: a longer
    time does not settle within it."""
    time_s = np.asarray(columns.get("time_s", np.zeros(1)), np.float64)
    time_s = time_s[np.isfinite(time_s)]
    return allow_long_answers(
        machine, LONGEST_ANSWER_SHARE * float(np.ptp(time_s)) if len(time_s) else 0.0
    )
