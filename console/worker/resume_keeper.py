"""Keeps the snapshot of a running job: the loop only hands over, the log writer's thread does
the rest."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import NamedTuple

from topdress.console.frame import Tally
from topdress.console.worker import resume
from topdress.console.worker.resume import Snapshot, drop_last_refill
from topdress.console.worker.resume_alarms import AlarmBook
from topdress.console.worker.resume_ground import Done
from topdress.console.worker.resume_tail import SCALE_S
from topdress.control.agronomy.strips import read_strip
from topdress.control.field.totals import Sums
from topdress.control.geodesy import TangentPlane
from topdress.control.log_row import LogRow
from topdress.control.loop import ControlLoop, Tick
from topdress.control.machine.machine import Machine
from topdress.control.orders import State
from topdress.drivers.files.run_log import MAX_WAITING_ROWS

# the snapshot is this old at most, and the disk's own time
SAVE_S = 5.0
# a scale that lost or gained more since the cut tells of a refill, or of a repair
BELIEVED_KG = 2.0
# the loop's sums are taken over this often: some 50 us
SUMS_S = 1.0
FINISHED = "mark job finished"  # the event by which the operator ends a job


class _Handed(NamedTuple):
    seen: Tick
    sums: Sums | None
    plane: TangentPlane | None


class Keeper:
    """`take` on the loop's thread, `work` on the log writer's. `tally` is for the frames."""

    def __init__(
        self,
        path: Path,
        machine: Machine,
        started: Snapshot,
        loop: ControlLoop,
        utc_now: Callable[[], str],
        most_waiting: int = MAX_WAITING_ROWS,
    ) -> None:
        """started: what is known of the job already; of an earlier part all that it had done."""
        self._path, self._loop, self._utc_now, self._most_waiting = (
            path,
            loop,
            utc_now,
            most_waiting,
        )
        self._handed: SimpleQueue[_Handed] = SimpleQueue()
        self._taken_s = -inf
        self._quit = False
        self._log_path = started.log_path
        self._snapshot = started
        self._done = Done(machine, started.ground, started.track)
        self._book = AlarmBook(started.alarms)
        self._last: LogRow | None = None
        self._track_m: float | None = None  # of that row
        self._saved_s = -inf
        self._saved = False
        self._scale = _AfterCut(started.after_cut_kg, started.cut_hopper_kg)
        self.trouble = ""
        self.tally = self._tally()

    # --- the loop's thread
    # -------------------------------------------------------------------------------------------

    def take(self, seen: Tick) -> None:
        """A tick. Queues, no more."""
        sums = None
        if seen.row.time_s - self._taken_s >= SUMS_S:
            self._taken_s, sums = seen.row.time_s, self._loop.sums
        # as many as the log lets wait for a disk that hangs
        if self._handed.qsize() < self._most_waiting:
            self._handed.put(_Handed(seen, sums, self._loop.plane))

    def quit(self) -> None:
        """The worker was asked to end: nothing is cut off. Before the last `work`."""
        self._quit = True

    def follow(self, log_path: str) -> None:
        """The run goes on in another log."""
        self._log_path = os.path.abspath(log_path)

    # --- the log writer's thread
    # -------------------------------------------------------------------------------------

    def work(self, closing: bool) -> None:
        """Takes in what was handed over, and writes when it is time. Never raises: the log
        matters more."""
        try:
            while True:
                try:
                    handed = self._handed.get_nowait()
                except Empty:
                    break
                self._absorb(handed)
            before = self._snapshot
            if before.log_path != self._log_path:
                self._path, self._saved_s = resume.snapshot_path(self._log_path), -inf
                self._snapshot = replace(
                    before,
                    log_path=self._log_path,
                    logs_before=(*before.logs_before, before.log_path),
                )
            if self._quit:
                self._snapshot = replace(self._snapshot, quit=True)
            if self._last is not None and (closing or self._last.time_s - self._saved_s >= SAVE_S):
                self._save()
            self.tally = self._tally()
        except Exception as error:
            self.trouble = f"{self._path}: {type(error).__name__}: {error}"

    def _absorb(self, handed: _Handed) -> None:
        seen, row = handed.seen, handed.seen.row
        if self._book.see(row.time_s, row.utc, seen.alarms):
            # an alarm is kept soon
            self._saved_s = min(self._saved_s, row.time_s - SAVE_S + 0.5)
        changes = self._since(self._last, row) | self._of_events(row.events or "")
        if row.state == State.WORKING and row.shaft_rpm_cmd and not self._snapshot.worked:
            # a cut in the first second is one to go on after
            changes["worked"], self._saved_s = True, -inf
        self._last = row
        if handed.sums is not None:
            changes |= {"sums": handed.sums, "sums_s": row.time_s}
        if handed.plane is not None:
            changes["origin_deg"] = handed.plane.to_deg(0.0, 0.0)
        self._pass_over(seen)
        self._scale.look(row)
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

    def _since(self, before: LogRow | None, row: LogRow) -> dict[str, object]:
        """What the step from one row to the next adds."""
        now = self._snapshot
        if before is not None and row.state == State.HELD:
            return {"held_s": now.held_s + max(0.0, row.time_s - before.time_s)}
        if before is not None and row.state == State.WORKING and _moved(before, row):
            return {"moves": now.moves + 1}
        return {}

    def _of_events(self, events: str) -> dict[str, object]:
        """What the events of a row change; the end of the job is kept at once."""
        changes: dict[str, object] = {}
        for event in events.split(";"):
            word, _space, value = event.partition(" ")
            if word == "refill":
                changes["refills"] = (*self._snapshot.refills, (self._utc_now(), float(value)))
            elif word == "refill_back":
                changes["refills"] = drop_last_refill(self._snapshot.refills, float(value))
            elif word == "strip" and (strip := read_strip(value)) is not None:
                changes[f"ndvi_{strip.which}"], self._saved_s = strip.ndvi, -inf
            elif event == FINISHED:
                changes["finished"] = True
                self._saved_s = -inf
        return changes

    def _pass_over(self, seen: Tick) -> None:
        """Where the loop's own guard knows the place, and how far it went meanwhile."""
        row, sensed, before_m = seen.row, seen.sensed, self._track_m
        self._track_m = sensed.track_m
        self._done.pass_over(
            row.time_s,
            seen.place_m if sensed.position_ok else None,
            sensed.heading_deg,
            row.shaft_rpm if row.state != State.CALIBRATING else 0.0,
            (row.applied_rate_kg_ha or 0.0) * (row.flow_trim or 1.0),
            row.sections_cmd,
            0.0 if before_m is None else sensed.track_m - before_m,
        )

    def _save(self) -> None:
        assert self._last is not None
        now, alarms = self._snapshot, self._book.records
        if not now.worth_going_on and not alarms and not now.finished and not self._saved:
            return  # a machine that only stood there leaves no file
        self._saved_s = self._last.time_s
        snapshot = replace(
            now,
            saved_utc=self._utc_now(),
            alarms=alarms,
            track=tuple(self._done.track),
            ground=self._done.raster(),
        )
        try:
            resume.write(self._path, snapshot)
        except OSError as error:
            self.trouble = f"{self._path}: {error.strerror or error}"
        else:
            self._saved, self.trouble = True, ""

    def _tally(self) -> Tally:
        now = self._snapshot
        return Tally(
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


class _AfterCut:
    """What the scale says of what was released after the last row before a cut: its mean while
    nothing flows, over the first seconds, less than then."""

    def __init__(self, model_kg: float, before_kg: float | None) -> None:
        self.model_kg = model_kg if model_kg > 0.0 else None
        self.scale_kg: float | None = None
        self._before_kg = before_kg if model_kg > 0.0 else None
        self._started_s: float | None = None
        self._settled: list[float] = []

    def look(self, row: LogRow) -> None:
        if self._before_kg is None:
            return
        if row.hopper_kg is not None and not row.shaft_rpm_cmd:
            self._started_s = row.time_s if self._started_s is None else self._started_s
            self._settled.append(row.hopper_kg)
        over = (
            row.shaft_rpm_cmd
            or "refill" in (row.events or "")
            or (self._started_s is not None and row.time_s - self._started_s >= SCALE_S)
        )
        if not over:
            return
        if self._settled:
            less_kg = self._before_kg - sum(self._settled) / len(self._settled)
            self.scale_kg = less_kg if abs(less_kg) < BELIEVED_KG else None
        self._before_kg = None


def _moved(before: LogRow, row: LogRow) -> bool:
    """Another set-point on the wire, as in `control.simulation.figures`."""
    if before.opening_mm_cmd is None or row.opening_mm_cmd is None:
        return False
    return row.opening_mm_cmd != before.opening_mm_cmd
