"""Writes findings about the recorded data: what the gate's reading shows, missing rows, and long
logs over their whole length.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import expit
from topdress.control.diagnosis.effects import EFFECT_ROWS, SHAFT_DEAD_TIME, SHAFT_SATURATION
from topdress.control.diagnosis.judgement.prior import (
    MIN_LISTED_PROB,
    MIN_NAMED_PROB,
    calc_row_log_odds,
    calc_unit_log_odds,
)
from topdress.control.diagnosis.result import Cause
from topdress.control.machine.effect import LONGEST_ANSWER, OPENING_RANGE, SHAFT_RANGE
from topdress.control.machine.machine import CATALOGUE, Machine, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import make_drive_channel
from .drives import (
    EQUAL_COMMAND_MM,
    Drive,
    LeftReason,
    find_reverse_rows,
    find_zero_command_rotation,
    list_left_rows,
    measure_zero_offset,
    read_whole_drives,
)
from .effort import EFFORT_CHANNELS, list_missing_inputs
from .grid import choose_row_windows, hold_last_value
from .hypothesis import EffectInstance, make_schedule
from .inputs import MAX_FINE_STEP_S
from .log import MIN_SETTLED_ROWS, CleanLog
from .model import find_tolerance
from .onset import TURNING_RPM
from .row_order import calc_late_gate_gain
from .selection import GroupResult
from .smooth import MIN_RANGE, NOMINAL_RANGES
from .stages import RunData

# Minimum share of the largest command or reading: below, dead zones and noise decide the ratio.
MIN_COMMAND_SHARE = 0.2
# Usual tick of control, s.
TICK_S = 0.05
# Difference of the two directions over their sum, from which they count as different: more than
# twice the spread between sessions.
MIN_DIRECTION_SHARE = 0.05
# Share of missing rows from which a finding reports them.
MIN_LOST_SHARE = 0.01
# Share of a drive's rows that are left out from which a finding says why.
MIN_LEFT_SHARE = 0.1
# Columns of the published ones whose range in the recording bounds what a machine file says.
RANGE_COLUMNS = ("shaft_rpm", "opening_mm", "supply_v")


_LEFT_WORDS = {
    LeftReason.UNREAD: "its reading is unknown",
    LeftReason.STANDS: "it stands as commanded",
    LeftReason.LOST: "what was commanded between rows is not in the log",
    LeftReason.REVERSE: "it turns backwards, or at a command of 0, which its file does not allow",
    LeftReason.REPEATED: "it moves, and its reading only repeats the row before",
}


def note_whole_log(log: CleanLog, judged: Sequence[GroupResult], machine: Machine) -> list[str]:
    """Return findings about a long log: the examined share of rows, and the error over all rows
    before and after the diagnosis.

    Flow and scale are always judged over the whole time. The result is empty for a log that was
    examined in full.
    """
    count = len(log.time_s)
    rows = choose_row_windows(count)
    if len(rows) == count:
        return []
    said = [
        "long log: shaft, gate, speed and heads are judged on "
        f"{100.0 * len(rows) / count:.0f} % of {count} rows, "
        "evenly chosen; flow and scale on the whole time"
    ]
    every = read_whole_drives(log, machine)
    for one in judged:
        for name in ("shaft", "gate"):
            parts = tuple(p for p in one.found.parts if EFFECT_ROWS[p.id].stage == name)
            if not parts or name not in every or name not in one.search.model.names:
                continue
            channel = make_drive_channel(every[name], machine)
            plans = [make_schedule(one.search.model.base, p) for p in ((), parts)]
            left = [channel.measured - channel.predict(plan, MAX_MODEL_STEP_S) for plan in plans]
            errors = [float(np.sqrt(np.mean(series**2))) for series in left]
            words = "holds" if errors[1] < errors[0] else "does NOT hold"
            said.append(
                f"stage {name}: what was named {words} on every row: error {errors[0]:.3g} "
                f"-> {errors[1]:.3g} "
                f"{channel.unit}"
            )
    return said


def note_reverse_turning(log: CleanLog, machine: Machine, counted: bool = False) -> list[str]:
    """Return findings about a shaft that is commanded to turn backwards, or that turns at a command
    of 0.

    For a shaft that turns in one direction by its machine file, the finding counts the rows that
    contradict the file and are left out. `counted` : such rows are judged, as when two files are
    compared.
    """
    command, read = log.columns["shaft_rpm_cmd"], log.columns["shaft_rpm"]
    known, back = int(np.isfinite(command).sum()), int(np.sum(command < 0.0))
    left_out = int(np.sum(find_reverse_rows(log.time_s, command, read, machine)))
    at_zero = int(
        np.sum(find_zero_command_rotation(log.time_s, hold_last_value(command), read, machine))
    )
    if at_zero:
        return [
            "stage shaft: it turns at commands of 0, which stop it by the machine file "
            "(shaft.zero_stops; 0: one "
            f"like any other): {at_zero} rows are "
            + ("counted as errors of the file" if counted else "left out")
        ]
    if left_out:
        return [
            f"stage shaft: {back} of {known} commands ask it to turn backwards, which it "
            "does not do by the "
            f"machine file (shaft.one_way): {left_out} rows are "
            + ("counted as errors of the file" if counted else "left out")
        ]
    return (
        [f"stage shaft: {back} of {known} commands are below 0: it turned backwards"]
        if back and machine.shaft.one_way <= 0.0
        else []
    )


def calc_answer_ratio(drive: Drive | None, machine: Machine) -> float:
    """Return the ratio of a drive's answer to its command, as the median over rows with large
    commands and readings; 1 for a drive that does not answer.

    For a shaft that stands at a command other than 0, the ratio is that of the changes.
    """
    if drive is None:
        return 1.0
    of_zero = measure_zero_offset(drive, machine)
    if of_zero.passed:
        return abs(of_zero.slope)
    asked, answered = np.abs(drive.command), np.abs(drive.measured)
    much = (asked > MIN_COMMAND_SHARE * float(np.nanmax(asked, initial=0.0))) & (
        answered > MIN_COMMAND_SHARE * float(np.nanmax(answered, initial=0.0))
    )
    return (
        float(np.nanmedian(answered[much] / asked[much]))
        if np.sum(much) >= MIN_SETTLED_ROWS // 2
        else 1.0
    )


def calc_unit_probability(drive: Drive | None, machine: Machine) -> float:
    """Return the probability that a shaft's gain comes from different units of command and reading.

    The alternative is the steady effect with the widest prior that explains the same gain.
    """
    ratio = calc_answer_ratio(drive, machine)
    if ratio <= 0.0 or ratio == 1.0:
        return 0.0
    names = sum(row.stage == "shaft" for row in EFFECT_ROWS.values())
    return float(
        expit(calc_unit_log_odds(ratio, SHAFT_SATURATION.scale_to_machine(machine).usual, names))
    )


def is_steady_part(part: EffectInstance) -> bool:
    """Tell whether an effect scales or shifts a drive's whole range for the whole log, as a
    mistaken unit does."""
    row = EFFECT_ROWS[part.id]
    return part.onset_s is None and not row.move_shaped and row.scanned


def find_row_shift_probability(
    part: EffectInstance, sd_s: float, data: RunData, machine: Machine
) -> float:
    """Return the probability that a shaft's delay, of an effect's size known to `sd_s` (1 s.d.),
    comes from log rows that are shifted by one.

    Where the gate moves, its own delay counts too: rows that are shifted delay both drives.
    """
    if (
        part.id != SHAFT_DEAD_TIME.id
        or part.onset_s is not None
        or data.shaft is None
        or part.size <= 0.0
    ):
        return 0.0
    row_s = float(np.median(np.diff(data.shaft.time_s)))
    known_s = float(np.hypot(sd_s, find_tolerance(part.id, machine)))
    names = sum(row.stage == "shaft" for row in EFFECT_ROWS.values())
    odds = calc_row_log_odds(part.size, row_s, known_s, SHAFT_DEAD_TIME.usual, names)
    if (
        data.gate is not None
        and np.ptp(data.gate.command) > scale_nominal(machine, OPENING_RANGE) * EQUAL_COMMAND_MM
    ):
        odds += calc_late_gate_gain(data.gate, machine, row_s)
    return float(expit(odds))


def note_doubted_rows(probabilities: Sequence[float]) -> list[str]:
    """Return findings about a shaft that is late by one row. probabilities : that its log is
    shifted by a row, by effect (`find_row_shift_probability`)."""
    if max(probabilities, default=0.0) <= MIN_LISTED_PROB:
        return []
    return [
        f"{SHAFT_DEAD_TIME.id}: it is as late as a row is long, and a log that writes "
        "readings a row late looks the same: the import file's order of rows would tell, or the "
        "lag of a gate that moves"
    ]


def note_doubted_units(data: RunData, machine: Machine) -> list[str]:
    """Return findings about a shaft whose command and reading are probably in different units."""
    if data.shaft is None or calc_unit_probability(data.shaft, machine) < MIN_NAMED_PROB:
        return []
    ratio = calc_answer_ratio(data.shaft, machine)
    return [
        f"stage shaft: it turns {ratio:.2g} times what its commands ask (up to "
        f"{float(np.nanmax(np.abs(data.shaft.command))):.4g} r/min asked, "
        f"{float(np.nanmax(np.abs(data.shaft.measured))):.4g} read): are both in r/min, of "
        "one side of a gear? "
        "The import file's scale puts that right; no steady fault of the drive is sure until then"
    ]


def note_unsure_drives(log: CleanLog, data: RunData, machine: Machine) -> list[str]:
    """Return findings about drives with hardly a valid row, and about each tenth of a drive's rows
    that is left out, with why."""
    late = [
        f"stage {word}: {drive.left_out} rows in which it moves quickly are left out: rows "
        "are missing, and those "
        "that are there may be late as well, so that nothing is said of delays"
        for word, drive in (("shaft", data.shaft), ("gate", data.gate))
        if drive is not None and drive.left_out
    ]
    rows, reasons = len(log.time_s), list_left_rows(log, machine)
    for word, drive in (("shaft", data.shaft), ("gate", data.gate)):
        if word not in log.stages:
            continue
        left = {why: int(there.sum()) for why, there in reasons[word].items()}
        if drive is None:
            most = max(left, key=lambda why: left[why])
            late.append(
                f"stage {word} is left out: hardly a row can be judged: {_LEFT_WORDS[most]} in "
                f"{left[most]} of {rows} rows"
            )
        else:
            late += [
                f"stage {word}: {count} of {rows} rows are not judged: {_LEFT_WORDS[why]}"
                for why, count in left.items()
                if why != LeftReason.STANDS and count > MIN_LEFT_SHARE * rows
            ]
    return late


def note_hardly_read(log: CleanLog, data: RunData) -> list[str]:
    """Return findings about channels whose columns exist but contain hardly a new reading."""
    return [
        f"stage {word} is left out: hardly a new reading in its columns: the same value "
        "stands in row after row, "
        "or there are too few"
        for word, seen in (("flow", data.hopper), ("speed", data.speed), ("heads", data.heads))
        if word in log.stages and seen is None
    ]


def note_effort_inputs(log: CleanLog, machine: Machine) -> list[str]:
    """Return findings about drives whose effort depends on a column that the log has not."""
    return [
        f"{name} is left out: it depends on {' and '.join(missing)}, and the log has no such column"
        for name in EFFORT_CHANNELS
        if name in log.stages and (missing := list_missing_inputs(name, log, machine))
    ]


def note_left_ranges(data: RunData, machine: Machine) -> list[str]:
    """Return a finding about commands, supply and further columns of which a share of rows lies
    beyond the ranges that the machine file's effects were adopted from."""
    ranges = dict[str, list[tuple[float, float]]]()
    for one in machine.adopted:
        for name, ends in one.valid.items():
            ranges.setdefault(name, []).append(ends)
    left = []
    for name, seen in ranges.items():
        if name not in data.variables:
            continue
        values = data.variables[name]
        if name == "shaft_rpm":
            # A shaft that stands leaves no range.
            values = values[np.abs(values) > scale_nominal(machine, SHAFT_RANGE) * TURNING_RPM]
        if not values.size:
            continue
        # A further column that rises and never falls counts rows or time.
        counts = np.ptp(values) > 0.0 and (np.diff(values) >= 0.0).all()
        if name not in RANGE_COLUMNS and (name in MIN_RANGE or counts):
            continue
        low, high = min(ends[0] for ends in seen), max(ends[1] for ends in seen)
        least = scale_nominal(machine, NOMINAL_RANGES.get(name, ())) * MIN_RANGE.get(
            name, high - low
        )
        if np.mean((values < low - least) | (values > high + least)) > MIN_LEFT_SHARE:
            here = np.percentile(values, (1.0, 99.0))
            left.append(f"{name} {low:.4g} to {high:.4g}, here {here[0]:.4g} to {here[1]:.4g}")
    return [
        f"this log leaves the range of the recordings that the machine file was adopted from "
        f"({'; '.join(left)}): that it holds here is not known"
    ] * bool(left)


def note_other_dynamics(causes: Sequence[Cause], machine: Machine) -> list[str]:
    """Return a finding about times of a drive alone that are not those of its machine file."""
    if machine.has_stage("flow"):
        return []
    found = [
        one.id
        for one in causes
        if CATALOGUE[one.id].effect.scales_with == LONGEST_ANSWER
        and one.onset_s is None
        and one.probability >= MIN_NAMED_PROB
    ]
    return [
        f"{', '.join(found)}: the machine file's dynamics are not those of this log: topdress "
        "machine --from LOG --out NEW.yaml writes it anew; adopting adds what was found"
    ] * bool(found)


def _has_numbers(values: npt.NDArray[Any]) -> bool:
    return values.dtype.kind in "fiub" and bool(np.isfinite(values.astype(np.float64)).any())


def note_unread_efforts(columns: Mapping[str, npt.NDArray[Any]], data: RunData) -> list[str]:
    """Return findings about columns of effort that no stage reads."""
    read = {{"effort": "shaft_effort"}.get(one.name, one.name) for one in data.efforts}
    return [
        f"column {name} is read by no stage: the machine file has no effort of its sound drive; "
        "topdress calibrate effort writes it from a log of one"
        for name, values in columns.items()
        if name.endswith("_effort") and name not in read and _has_numbers(values)
    ]


def note_unloaded_flanks(data: RunData, machine: Machine) -> list[str]:
    """Return findings about drives whose load pulls in one direction in the machine file's
    reference.

    The other flank of a screw or gear never bears the load, so friction on that flank cannot show.
    """
    own = machine.effort
    found = []
    for drive in data.efforts:
        ways = (
            (own.coulomb, own.coulomb_back)
            if drive.name == "effort"
            else (own.gate_coulomb, own.gate_coulomb_back)
        )
        if min(ways) > 0.0 and abs(ways[0] - ways[1]) > MIN_DIRECTION_SHARE * (ways[0] + ways[1]):
            found.append(
                f"{drive.name}: its load pulls one way ({ways[0]:.3g} {machine.effort_unit} "
                "forwards, "
                f"{ways[1]:.3g} back): friction that bears on the other side does not show "
                "at this load"
            )
    return found


def note_faults_between_rows(log: CleanLog, ids: set[str]) -> list[str]:
    """Return findings about small faults of the drives where the log may lack some of the
    commands."""
    steps = np.diff(log.time_s)
    lost = float(np.mean(steps > 1.5 * log.step_s)) if len(steps) else 0.0
    doubtful = sorted(one for one in ids if EFFECT_ROWS[one].move_shaped)
    if (
        not doubtful
        or log.step_s > MAX_FINE_STEP_S
        or (log.step_s < TICK_S * 1.2 and lost < MIN_LOST_SHARE)
    ):
        return []
    why = (
        f"{100.0 * lost:.0f} % of the rows are missing"
        if lost >= MIN_LOST_SHARE
        else f"rows come every {log.step_s:.2g} s, and control may decide more often"
    )
    return [
        f"{', '.join(doubtful)}: {why}: a command given between two rows is not in the log, "
        "and can look like "
        "this; a log of every tick would tell"
    ]
