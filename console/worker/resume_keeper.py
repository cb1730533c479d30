"""Maintains the snapshot of a running job: the loop only hands over ticks, and the log writer's
thread does the rest.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import NamedTuple

from topdress.console.frame import JobCounts
from topdress.console.worker import resume
from topdress.console.worker.resume import Snapshot, drop_last_refill
from topdress.console.worker.resume_alarms import AlarmHistory
from topdress.console.worker.resume_ground import WorkedGroundRecord
from topdress.console.worker.resume_tail import SCALE_WINDOW_S
from topdress.control.agronomy.reference_strips import parse_strip
from topdress.control.field.job_totals import TotalSums
from topdress.control.geodesy import TangentPlane
from topdress.control.log_row import LogRow
from topdress.control.loop import ControlLoop, Tick
from topdress.control.machine.machine import Machine
from topdress.control.orders import State
from topdress.drivers.files.run_log import MAX_WAITING_ROWS

# Largest age of the snapshot, s, besides the disk's own delay.
SNAPSHOT_PERIOD_S = 5.0
# A larger change of the scale since the cut, kg, indicates a refill or a repair.
MAX_CUT_LOSS_KG = 2.0
# Period at which the loop's sums are copied, s; a copy takes some 50 us.
SUMS_PERIOD_S = 1.0
# Event by which the operator ends a job.
FINISHED_EVENT = "mark job finished"


class _HandedTick(NamedTuple):
    """Holds a tick for the writer's thread, with sums and plane."""

    seen: Tick
    sums: TotalSums | None
    plane: TangentPlane | None


class SnapshotKeeper:
    """Maintains the job's snapshot. `take_tick` runs in the loop's thread, `save_due` in the log
    writer's; `tally` serves the frames."""

    def __init__(
        self,
        path: Path,
        machine: Machine,
        started: Snapshot,
        loop: ControlLoop,
        utc_now: Callable[[], str],
        most_waiting: int = MAX_WAITING_ROWS,
    ) -> None:
        """Create the keeper; `started` has what is known of the job already, including all earlier
        parts."""
        self._path, self._loop, self._utc_now, self._most_waiting = (
            path,
            loop,
            utc_now,
            most_waiting,
        )
        self._handed: SimpleQueue[_HandedTick] = SimpleQueue()
        self._taken_s = -inf
        self._quit = False
        self._log_path = started.log_path
        self._snapshot = started
        self._done = WorkedGroundRecord(machine, started.ground, started.track)
        self._book = AlarmHistory(started.alarms)
        self._last: LogRow | None = None
        # Distance along the track at that row, m.
        self._track_m: float | None = None
        self._saved_s = -inf
        self._saved = False
        self._scale = _ReleaseBeforeCut(started.after_cut_kg, started.cut_hopper_kg)
        self.trouble = ""
        self.tally = self._make_tally()

    # The loop's thread calls the following methods.

    def take_tick(self, seen: Tick) -> None:
        """Queue a tick, nothing else."""
        sums = None
        if seen.row.time_s - self._taken_s >= SUMS_PERIOD_S:
            self._taken_s, sums = seen.row.time_s, self._loop.running_sums
        # The same limit as the log's for a disk that hangs.
        if self._handed.qsize() < self._most_waiting:
            self._handed.put(_HandedTick(seen, sums, self._loop.plane))

    def note_quit(self) -> None:
        """Record that the worker was asked to end, so that nothing is interrupted. Must precede the
        last `save_due`."""
        self._quit = True

    def follow_log(self, log_path: str) -> None:
        """Record the path of the log in which the run continues."""
        self._log_path = os.path.abspath(log_path)

    # The log writer's thread calls the following methods.

    def save_due(self, closing: bool) -> None:
        """Process the queued ticks, and write the snapshot when it is due. Never raises, because
        the log matters more."""
        try:
            while True:
                try:
                    handed = self._handed.get_nowait()
                except Empty:
                    break
                self._absorb_tick(handed)
            before = self._snapshot
            if before.log_path != self._log_path:
                self._path, self._saved_s = resume.make_snapshot_path(self._log_path), -inf
                self._snapshot = replace(
                    before,
                    log_path=self._log_path,
                    logs_before=(*before.logs_before, before.log_path),
                )
            if self._quit:
                self._snapshot = replace(self._snapshot, quit=True)
            if self._last is not None and (
                closing or self._last.time_s - self._saved_s >= SNAPSHOT_PERIOD_S
            ):
                self._save_snapshot()
            self.tally = self._make_tally()
        except Exception as error:
            self.trouble = f"{self._path}: {type(error).__name__}: {error}"

    def _absorb_tick(self, handed: _HandedTick) -> None:
        """Update the snapshot with a tick."""
        seen, row = handed.seen, handed.seen.row
        if self._book.add_row_alarms(row.time_s, row.utc, seen.alarms):
            # An alarm is saved soon, before a cut can lose it.
            self._saved_s = min(self._saved_s, row.time_s - SNAPSHOT_PERIOD_S + 0.5)
        changes = self._find_row_changes(self._last, row) | self._find_event_changes(
            row.events or ""
        )
        if row.state == State.WORKING and row.shaft_rpm_cmd and not self._snapshot.worked:
            # A power cut in the first second of work must be resumable too.
            changes["worked"], self._saved_s = True, -inf
        self._last = row
        if handed.sums is not None:
            changes |= {"sums": handed.sums, "sums_s": row.time_s}
        if handed.plane is not None:
            changes["origin_deg"] = handed.plane.convert_to_deg(0.0, 0.0)
        self._add_outlet_place(seen)
        self._scale.take_row(row)
        known = {
            "strategy": row.strategy or None,
            "hopper_kg": row.hopper_kg,
            "place_m": seen.place_m,
            "heading_deg": row.heading_deg,
        }
        changes |= {name: value for name, value in known.items() if value is not None}
        self._snapshot = replace(
            self._snapshot,
            time_s=row.time_s,
            look_ahead=seen.look_ahead,
            flow_trim_on=seen.flow_trim_on,
            **changes,  # type: ignore[arg-type]
        )

    def _find_row_changes(self, before: LogRow | None, row: LogRow) -> dict[str, object]:
        """Return the changes of the snapshot between two rows."""
        now = self._snapshot
        if before is not None and row.state == State.HELD:
            return {"held_s": now.held_s + max(0.0, row.time_s - before.time_s)}
        if before is not None and row.state == State.WORKING and _has_opening_moved(before, row):
            return {"moves": now.moves + 1}
        return {}

    def _find_event_changes(self, events: str) -> dict[str, object]:
        """Return the changes of the snapshot by a row's events; the end of a job is saved at
        once."""
        changes: dict[str, object] = {}
        for event in events.split(";"):
            word, _space, value = event.partition(" ")
            if word == "refill":
                changes["refills"] = (*self._snapshot.refills, (self._utc_now(), float(value)))
            elif word == "refill_back":
                changes["refills"] = drop_last_refill(self._snapshot.refills, float(value))
            elif word == "strip" and (strip := parse_strip(value)) is not None:
                changes[f"ndvi_{strip.which}"], self._saved_s = strip.ndvi, -inf
            elif event == FINISHED_EVENT:
                changes["finished"] = True
                self._saved_s = -inf
        return changes

    def _add_outlet_place(self, seen: Tick) -> None:
        """Record the position of the outlets where the loop's own guard knows it, and the distance
        covered meanwhile."""
        row, sensed, before_m = seen.row, seen.sensed, self._track_m
        self._track_m = sensed.track_m
        self._done.add_outlet_place(
            row.time_s,
            seen.place_m if sensed.position_ok else None,
            sensed.heading_deg,
            # Material of a calibration run lies in a tray.
            row.shaft_rpm if row.state != State.CALIBRATING else 0.0,
            (row.applied_rate_kg_ha or 0.0) * (row.flow_trim or 1.0),
            row.sections_cmd,
            0.0 if before_m is None else sensed.track_m - before_m,
        )

    def _save_snapshot(self) -> None:
        """Write the snapshot if there is anything worth saving."""
        assert self._last is not None
        now, alarms = self._snapshot, self._book.records
        if not now.is_worth_resuming and not alarms and not now.finished and not self._saved:
            # A machine that only stood leaves no file.
            return
        self._saved_s = self._last.time_s
        snapshot = replace(
            now,
            saved_utc=self._utc_now(),
            alarms=alarms,
            track=tuple(self._done.track),
            ground=self._done.make_raster(),
        )
        try:
            resume.write_snapshot(self._path, snapshot)
        except OSError as error:
            self.trouble = f"{self._path}: {error.strerror or error}"
        else:
            self._saved, self.trouble = True, ""

    def _make_tally(self) -> JobCounts:
        """Return the tally for frames."""
        now = self._snapshot
        return JobCounts(
            now.held_s,
            now.moves,
            now.refills,
            now.logs_before[-1] if now.logs_before else "",
            now.began_utc,
            now.finished,
            self.trouble,
            self._scale.model_kg,
            self._scale.scale_kg,
        )


class _ReleaseBeforeCut:
    """Measures the mass released after the last row before a cut: mean reading of the scale while
    nothing flows, minus the reading before."""

    def __init__(self, model_kg: float, before_kg: float | None) -> None:
        self.model_kg = model_kg if model_kg > 0.0 else None
        self.scale_kg: float | None = None
        self._before_kg = before_kg if model_kg > 0.0 else None
        self._started_s: float | None = None
        self._settled: list[float] = []

    def take_row(self, row: LogRow) -> None:
        """Add a row until the first flow, refill or the end of the window."""
        if self._before_kg is None:
            return
        if row.hopper_kg is not None and not row.shaft_rpm_cmd:
            self._started_s = row.time_s if self._started_s is None else self._started_s
            self._settled.append(row.hopper_kg)
        over = (
            row.shaft_rpm_cmd
            or "refill" in (row.events or "")
            or (self._started_s is not None and row.time_s - self._started_s >= SCALE_WINDOW_S)
        )
        if not over:
            return
        if self._settled:
            less_kg = self._before_kg - sum(self._settled) / len(self._settled)
            self.scale_kg = less_kg if abs(less_kg) < MAX_CUT_LOSS_KG else None
        self._before_kg = None


def _has_opening_moved(before: LogRow, row: LogRow) -> bool:
    """Return whether the opening's commanded value changed, as counted in
    `control.simulation.strategy_figures`."""
    if before.opening_mm_cmd is None or row.opening_mm_cmd is None:
        return False
    return row.opening_mm_cmd != before.opening_mm_cmd
