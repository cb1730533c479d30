"""Rebuilds an interrupted job: the loop continues with what was done, in state OFF and with
everything else as usual.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from math import hypot
from pathlib import Path
from typing import NamedTuple

from topdress.console.worker import resume
from topdress.console.worker.options import Options
from topdress.console.worker.resume import Snapshot
from topdress.console.worker.resume_field import find_jobs_here, find_last_place, move_snapshot
from topdress.control.field.job import Job
from topdress.control.geodesy import TangentPlane
from topdress.control.loop import ControlLoop
from topdress.control.machine.machine import Machine
from topdress.control.orders import Strategy
from topdress.control.simulation.tractor import make_field_path
from topdress.drivers.files.run_meta import read_sidecar_meta

# Step of the search along the simulated tractor's way, m.
POSITION_SEARCH_STEP_M = 0.5


class EarlierWork(NamedTuple):
    """Holds the earlier work on this field.

    Attributes
    ----------
    job
        Job to resume; None where another job begins.
    others
        Jobs of which the ground alone counts.
    same_files
        True if the configuration files are those of the job.
    """

    job: Snapshot | None = None
    others: tuple[Snapshot, ...] = ()
    same_files: bool = True

    def move_to_plane(self, plane: TangentPlane | None) -> EarlierWork:
        """Return the earlier work on the loop's plane. A plane of None means that the loop has none
        yet and adopts the job's."""
        if plane is None:
            # Without a common plane, the ground of other jobs has no position.
            return self._replace(others=())
        return self._replace(
            job=None if self.job is None else move_snapshot(self.job, plane),
            others=tuple(move_snapshot(one, plane) for one in self.others),
        )


def find_earlier_job(
    named: Path | None,
    folder: Path,
    job: Job,
    sha256: Mapping[str, str],
    simulated: bool,
    now: datetime,
) -> EarlierWork:
    """Find the job to resume and the ground of other jobs on its field.

    Parameters
    ----------
    named
        Snapshot to resume (`--resume`); None means the interrupted job on this job's field, if the
        field has a boundary.
    folder
        Folder of the logs.
    job
        Job that begins.
    sha256
        Checksums of the configuration files.
    simulated
        True for the simulated machine.
    now
        Time of the start, UTC.

    Raises
    ------
    ValueError, OSError
        The named snapshot cannot be read.
    """
    here = find_jobs_here(folder, job, simulated, now) if job.field.boundary_m else []
    # The operator's explicit choice has priority over the search.
    goes_on = (
        next((one.snapshot for one in here if one.is_same_job), None)
        if named is None
        else resume.read_snapshot(named)
    )
    # The metadata of the job's log contains the checksums of its files.
    written = None if goes_on is None else read_sidecar_meta(goes_on.log_path)
    same = written is None or written.sha256 == dict(sha256)
    return EarlierWork(
        goes_on,
        tuple(
            one.snapshot
            for one in here
            if goes_on is None or (one.snapshot.log_path != goes_on.log_path)
        ),
        same,
    )


def find_job_to_continue(
    job: Job, machine: Machine, before: Snapshot, same_files: bool = True
) -> Job:
    """Return the job with the values that the operator measured and, for unchanged files, the
    operator's choices. The simulated tractor stands where it stopped."""
    # Changed files are a new intention of the operator, so former choices are dropped.
    update: dict[str, object] = (
        {}
        if not same_files
        else {
            "strategy": Strategy(before.strategy),
            "look_ahead": before.look_ahead,
            "flow_trim": before.flow_trim_on,
        }
    )
    strips = {"ndvi_nrich": before.ndvi_nrich, "ndvi_check": before.ndvi_check}
    # A value in the new files is an explicit choice and has priority over a measured value.
    update |= {
        name: ndvi
        for name, ndvi in strips.items()
        if ndvi is not None and (same_files or getattr(job, name) is None)
    }
    simulated: dict[str, float] = {}
    if before.simulated:
        # The simulated tractor continues where it stopped; a real one stands wherever it is.
        place_m = find_last_place(
            TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg), before
        )
        simulated |= {} if place_m is None else {"begin_m": _find_driven_m(job, machine, place_m)}
        simulated |= {} if before.hopper_kg is None else {"hopper_kg": max(0.0, before.hopper_kg)}
    return job.model_copy(update=update | {"simulated": job.simulated.model_copy(update=simulated)})


def continue_loop(loop: ControlLoop, before: EarlierWork) -> None:
    """Give the loop its earlier totals and the ground that its guard against a second dose must
    know.

    The scale's trim starts anew, because nothing confirms the scale's state before the cut.
    """
    last = before.job
    if last is not None:
        # The loop must use the job's plane, in which its ground is stored.
        plane = None if last.origin_deg is None else TangentPlane(*last.origin_deg)
        loop.resume_job(last.sums, last.ground, plane, last.after_cut_kg)
    for other in before.others:
        loop.add_foreign_ground(other.ground)


def make_first_snapshot(
    options: Options,
    log: Path,
    names: tuple[str, str, str],
    simulated: bool,
    now_utc: str,
    before: Snapshot | None,
) -> Snapshot:
    """Return the snapshot with which a run begins; `names` are those of job, machine and crop."""
    job, machine, crop = names
    # Absolute paths, because the next start may have another working directory.
    config = tuple(os.path.abspath(one) if os.path.exists(one) else one for one in options.config)
    # A resumed job keeps its totals, refills and alarms.
    start = before or Snapshot(str(log), began_utc=now_utc)
    earlier = () if before is None else (*before.logs_before, before.log_path)
    return replace(
        start,
        log_path=os.path.abspath(log),
        saved_utc=now_utc,
        job=job,
        machine=machine,
        crop=crop,
        simulated=simulated,
        config=config,
        seed=options.seed,
        effects=options.effects,
        hz=options.hz,
        logs_before=earlier,
        time_s=0.0,
        sums_s=0.0,
        quit=False,
    )


def _find_driven_m(job: Job, machine: Machine, place_m: tuple[float, float]) -> float:
    """Return how far along its way the simulated tractor had come, m."""
    # The way is deterministic, so its position can be searched.
    path = make_field_path(
        job.simulated, machine.geometry.working_width_m, job.field.pass_heading_deg
    )
    places = (
        k * POSITION_SEARCH_STEP_M for k in range(int(path.length_m / POSITION_SEARCH_STEP_M) + 1)
    )

    def calc_distance_m(driven_m: float) -> float:
        pose = path.find_pose(driven_m)
        return hypot(pose.east_m - place_m[0], pose.north_m - place_m[1])

    return min(places, key=calc_distance_m)
