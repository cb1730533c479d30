"""Adds the last seconds before a power cut: rows of the log that are newer than the snapshot."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import replace
from math import isfinite, nan
from pathlib import Path
from typing import NamedTuple

from topdress.console.worker.resume import Refill, Snapshot, drop_last_refill
from topdress.console.worker.resume_ground import WorkedGroundRecord
from topdress.control.field.job_totals import Totaliser
from topdress.control.geodesy import Place, TangentPlane, offset_place
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.sections import LoggedValves
from topdress.control.machine.shaft import ShaftInput, make_shaft_start, step_shaft
from topdress.control.orders import State
from topdress.drivers.files.limits import LINE_LIMIT
from topdress.drivers.files.run_log import FLUSH_PERIOD_S

# After the last row material still flows, because a board whose host fell silent continues for a
# while.
#
# By the machine model the shaft continues as in the last row until the board stops by itself, then
# through its dead time and ramp; the flow follows the shaft. Pure. Step of this prediction, s.
RUN_ON_STEP_S = 0.05
# Rows reach the disk with this period, of which half is missing on average, s.
MEAN_UNLOGGED_S = 0.5 * FLUSH_PERIOD_S
# The prediction ends after this time, s, whatever the machine file contains.
MAX_RUN_ON_S = 30.0
# Share of the former speed below which the shaft counts as standing.
STANDSTILL_OF_FORMER_SPEED = 0.02


class RunOnState(NamedTuple):
    """Holds a moment after the last row; `share` is the share of the last row's flow. With 0 only
    material in the air still lands."""

    after_s: float
    share: float


def predict_run_on(machine: Machine, shaft_rpm: float, stops_s: float) -> Iterator[RunOnState]:
    """Yield the flow after the last row in steps of `RUN_ON_STEP_S`, until nothing lands any more.

    Parameters
    ----------
    machine
        Machine of the job.
    shaft_rpm
        Shaft speed in the last row.
    stops_s
        Time after which a board stops without its host, s.
    """
    if shaft_rpm <= 0.0:
        return
    shaft, time_s, share, stood_s = make_shaft_start(shaft_rpm), 0.0, 1.0, None
    supply_v = machine.shaft.nominal_supply_v
    while time_s < MAX_RUN_ON_S:
        commanded_rpm = shaft_rpm if time_s < MEAN_UNLOGGED_S + stops_s else 0.0
        shaft, turned = step_shaft(
            machine.shaft, shaft, ShaftInput(commanded_rpm, 0.0, supply_v), RUN_ON_STEP_S
        )
        time_s += RUN_ON_STEP_S
        share = min(1.0, max(0.0, turned.rpm / shaft_rpm))
        if share < STANDSTILL_OF_FORMER_SPEED:
            stood_s = time_s if stood_s is None else stood_s
            share = 0.0
            if time_s - stood_s > calc_drop_s(machine.fall, shaft_rpm):
                return
        yield RunOnState(time_s, share)


# Bytes read from the end of the log: minutes of rows at 20 Hz, and more than 20 s of rows full of
# events.
MAX_TAIL_BYTES = 2_000_000
# A longer step between rows is a gap, s.
MAX_ROW_STEP_S = 1.0
# Window of scale readings, s: five correlation times of the scale.
SCALE_WINDOW_S = 5.0


class _TailRow(NamedTuple):
    """Holds the values of one row of the log."""

    time_s: float
    # NaN, as for longitude and heading, in a row without a position.
    lat_deg: float
    lon_deg: float
    heading_deg: float
    speed_used_mps: float
    shaft_rpm: float
    shaft_rpm_cmd: float
    applied_rate_kg_ha: float
    flow_trim: float
    target_rate_kg_ha: float
    hopper_kg: float | None
    state: str
    refill_kg: float
    refill_back_kg: float
    # Mass that was released while commanded to stop, kg.
    stopped_kg: float = 0.0
    sections_cmd: str = ""
    # Open share of the working width.
    open_share: float = 1.0

    @property
    def has_place(self) -> bool:
        """Whether the row has position and heading."""
        return isfinite(self.lat_deg + self.lon_deg + self.heading_deg)


def add_log_tail(
    snapshot: Snapshot, machine: Machine, n_fraction: float, stops_s: float | None = None
) -> Snapshot:
    """Return the snapshot extended to the log's last whole row, and beyond it until nothing landed
    any more: sums, ground, refills. Without a log the snapshot is unchanged.

    Parameters
    ----------
    snapshot
        Snapshot of the job.
    machine
        Machine of the job.
    n_fraction
        Nitrogen in the product, kg/kg.
    stops_s
        Time after which the drive stops without its host, s; None if it ended with the worker, as a
        simulated drive does.
    """
    try:
        rows = list(
            _add_open_shares(
                _read_rows_after(Path(snapshot.log_path), min(snapshot.time_s, snapshot.sums_s)),
                machine,
            )
        )
    except OSError:
        return snapshot
    if not rows or snapshot.origin_deg is None:
        return snapshot
    way = _OutletWay(snapshot, TangentPlane(*snapshot.origin_deg), machine.geometry.antenna_m)
    done = WorkedGroundRecord(machine, snapshot.ground, snapshot.track)
    sums = Totaliser(machine.geometry.working_width_m, n_fraction, snapshot.sums)
    held_s, before_s = snapshot.held_s, min(snapshot.time_s, snapshot.sums_s)
    # Material that lands at the first row was released before it.
    rpm = rows[0].shaft_rpm
    begin_s = before_s - (calc_drop_s(machine.fall, rpm) if rpm > 0.0 else 0.0)
    done.add_outlet_place(begin_s, way.place, way.heading_deg, rpm, 0.0)
    for row in rows:
        step_s = row.time_s - before_s
        # The snapshot's position belongs to its own last row.
        new_s = row.time_s - max(before_s, snapshot.time_s)
        before_s = row.time_s
        # Material of a calibration run lies in a tray.
        flowing = row.state != State.CALIBRATING
        done.add_outlet_place(
            row.time_s,
            *way.follow_row(row, min(max(0.0, new_s), MAX_ROW_STEP_S)),
            row.shaft_rpm if flowing else 0.0,
            row.applied_rate_kg_ha * row.flow_trim,
            row.sections_cmd,
            way.step_m,
        )
        if row.time_s > snapshot.time_s and row.state == State.HELD:
            held_s += min(step_s, MAX_ROW_STEP_S)
        _add_row_to_sums(
            sums, row, step_s, 0.5 * machine.limits.shaft_low_rpm, row.time_s > snapshot.sums_s
        )
    last, place = rows[-1], way.place
    # A worker that was asked to quit stopped its drives itself.
    flowed = last.state == State.WORKING and last.shaft_rpm_cmd > 0.0 and not snapshot.quit
    after_cut_kg = (
        0.0
        if stops_s is None or not flowed
        else _add_run_on(machine, done, sums, way, last, stops_s)
    )
    return replace(
        snapshot,
        sums=sums.running_sums,
        ground=done.make_raster(),
        track=tuple(done.track),
        place_m=place,
        heading_deg=way.heading_deg,
        held_s=held_s,
        time_s=before_s,
        sums_s=before_s,
        refills=_list_refills(snapshot, rows),
        after_cut_kg=after_cut_kg,
        cut_hopper_kg=_estimate_hopper_kg(rows, machine.geometry.working_width_m),
    )


class _OutletWay:
    """Follows the outlets from row to row, by dead reckoning where a row has no position."""

    def __init__(self, snapshot: Snapshot, plane: TangentPlane, antenna_m: float) -> None:
        self.place, self.heading_deg = snapshot.place_m, snapshot.heading_deg
        # Distance of the last row or step, m.
        self.step_m = 0.0
        self._plane, self._antenna_m = plane, antenna_m

    def follow_row(self, row: _TailRow, step_s: float) -> tuple[Place | None, float | None]:
        """Return position and heading of a row; a position of None where the row has none."""
        if not row.has_place:
            self.drive_straight(row.speed_used_mps, step_s)
            return None, self.heading_deg
        self.step_m, self.heading_deg = row.speed_used_mps * step_s, row.heading_deg
        antenna = self._plane.project_to_m(row.lat_deg, row.lon_deg)
        self.place = offset_place(antenna, self.heading_deg, -self._antenna_m)
        return self.place, self.heading_deg

    def drive_straight(self, speed_mps: float, step_s: float) -> None:
        """Move the position straight ahead."""
        self.step_m = speed_mps * step_s
        if self.place is not None and self.heading_deg is not None:
            self.place = offset_place(self.place, self.heading_deg, self.step_m)


def _add_run_on(
    machine: Machine,
    done: WorkedGroundRecord,
    sums: Totaliser,
    way: _OutletWay,
    last: _TailRow,
    stops_s: float,
) -> float:
    """Record the mass that left the outlets after the last row, and return it, kg."""
    kg = 0.0
    for after in predict_run_on(machine, last.shaft_rpm, stops_s):
        way.drive_straight(last.speed_used_mps, RUN_ON_STEP_S)
        applied = last.applied_rate_kg_ha * last.flow_trim * after.share
        done.add_outlet_place(
            last.time_s + after.after_s,
            way.place if last.has_place else None,
            way.heading_deg,
            last.shaft_rpm * after.share,
            applied,
            last.sections_cmd,
            way.step_m,
        )
        if after.share > 0.0:
            sums.add_tick(
                RUN_ON_STEP_S, last.speed_used_mps, applied, last.target_rate_kg_ha, last.open_share
            )
            wide_m = last.open_share * machine.geometry.working_width_m
            kg += applied * wide_m * way.step_m / 10_000.0
    return kg


def _list_refills(snapshot: Snapshot, rows: list[_TailRow]) -> tuple[Refill, ...]:
    """Return the refills of the snapshot and of later rows, without undone refills."""
    new = [row for row in rows if row.time_s > snapshot.time_s]
    noted = (
        *snapshot.refills,
        *((snapshot.saved_utc, row.refill_kg) for row in new if row.refill_kg > 0.0),
    )
    for row in new:
        if row.refill_back_kg > 0.0:
            noted = drop_last_refill(noted, row.refill_back_kg)
    return noted


def _add_row_to_sums(
    sums: Totaliser, row: _TailRow, step_s: float, turning_rpm: float, is_new: bool
) -> None:
    """Add a row to the sums as the loop does, unless the sums contain it already."""
    worked = row.state == State.WORKING and (
        row.shaft_rpm_cmd > 0.0 or row.shaft_rpm >= turning_rpm
    )
    if not worked:
        sums.stop_work()
    elif is_new and step_s <= MAX_ROW_STEP_S:
        sums.add_tick(
            step_s,
            row.speed_used_mps,
            row.applied_rate_kg_ha * row.flow_trim,
            row.target_rate_kg_ha,
            row.open_share,
        )
    if is_new:
        sums.add_stopped(row.stopped_kg)


def _add_open_shares(rows: Iterator[_TailRow], machine: Machine) -> Iterator[_TailRow]:
    """Yield the rows with the open share of the width, for a machine with valves."""
    if not machine.switched_strips:
        yield from rows
        return
    valves = LoggedValves(machine.sections)
    for row in rows:
        yield row._replace(
            open_share=valves.calc_open_share(valves.find_open_valves(row.time_s, row.sections_cmd))
        )


def _estimate_hopper_kg(rows: list[_TailRow], width_m: float) -> float | None:
    """Estimate the mass on the scale at the last row, kg: the mean of the last readings, each minus
    the mass released after it."""
    released_kg, before_kg = 0.0, []
    for row, step_s in _iterate_backwards(rows):
        if rows[-1].time_s - row.time_s > SCALE_WINDOW_S or row.refill_kg > 0.0:
            break
        if row.hopper_kg is not None:
            before_kg.append(row.hopper_kg - released_kg)
        wide_m = row.open_share * width_m
        released_kg += (
            row.applied_rate_kg_ha * row.flow_trim * wide_m * row.speed_used_mps * step_s / 10_000.0
        )
    return sum(before_kg) / len(before_kg) if before_kg else None


def _iterate_backwards(rows: list[_TailRow]) -> Iterator[tuple[_TailRow, float]]:
    """Yield each row from the last one backwards, with the time since the row before, s."""
    for number in range(len(rows) - 1, 0, -1):
        yield (
            rows[number],
            min(MAX_ROW_STEP_S, max(0.0, rows[number].time_s - rows[number - 1].time_s)),
        )


def _read_rows_after(log: Path, time_s: float) -> Iterator[_TailRow]:
    """Yield whole rows later than `time_s`. Raises OSError."""
    with log.open("rb") as file:
        header = file.readline().decode("utf-8-sig", errors="replace").strip().split(",")
        size = file.seek(0, 2)
        file.seek(max(0, size - MAX_TAIL_BYTES))
        # The first and last line may be incomplete.
        lines = file.read().decode(errors="replace").split("\n")[1:-1]
    for cells in csv.reader(line for line in lines if len(line) <= LINE_LIMIT.most):
        if len(cells) == len(header):
            row = _parse_tail_row(dict(zip(header, cells, strict=True)))
            if row is not None and row.time_s > time_s:
                yield row


def _parse_tail_row(cells: dict[str, str]) -> _TailRow | None:
    """Return the values of a row; None for a damaged row."""

    def read_number(name: str, otherwise: float = 0.0) -> float:
        return float(cells.get(name) or otherwise)

    try:
        events = cells.get("events") or ""
        refills, stopped, back = (
            _sum_event_values(events, word)
            for word in ("refill", "released_stopped", "refill_back")
        )
        return _TailRow(
            time_s=float(cells["time_s"]),
            lat_deg=read_number("lat_deg", nan),
            lon_deg=read_number("lon_deg", nan),
            heading_deg=read_number("heading_deg", nan),
            speed_used_mps=read_number("speed_used_mps"),
            shaft_rpm=read_number("shaft_rpm"),
            shaft_rpm_cmd=read_number("shaft_rpm_cmd"),
            applied_rate_kg_ha=read_number("applied_rate_kg_ha"),
            flow_trim=read_number("flow_trim", 1.0),
            target_rate_kg_ha=read_number("target_rate_kg_ha"),
            hopper_kg=float(cells["hopper_kg"]) if cells.get("hopper_kg") else None,
            state=cells.get("state", ""),
            refill_kg=refills,
            refill_back_kg=back,
            stopped_kg=stopped,
            sections_cmd=cells.get("sections_cmd") or "",
        )
    except (KeyError, ValueError):
        return None


def _sum_event_values(events: str, word: str) -> float:
    """Return the sum of this word's values in a row's events. Raises ValueError."""
    return sum(
        float(event.partition(" ")[2])
        for event in events.split(";")
        if event.startswith(f"{word} ")
    )
