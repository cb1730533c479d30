"""A job that was left, put together again: the loop goes on with what was done, off and with
all else as usual."""

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

SEARCH_M = 0.5  # along the simulated tractor's way


class EarlierWork(NamedTuple):
    """Holds what was done on this field.

    job: the job that goes on, None where another begins; others: jobs whose ground counts alone.
    same_files: whether the configuration files are those with which the job was worked.
    """

    job: Snapshot | None = None
    others: tuple[Snapshot, ...] = ()
    same_files: bool = True

    def move_to_plane(self, plane: TangentPlane | None) -> EarlierWork:
        """The earlier work on the plane of the loop. None: the loop has none yet and takes that of
        the job."""
        if plane is None:
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
    """Find the job to go on with and the ground of other jobs on its field.

    named: the job to go on with (`--resume`); None: the one that was left on this job's field,
    where it has a boundary. folder: of the logs; sha256: of the files. Raises ValueError, OSError:
    the named snapshot cannot be read.
    """
    here = find_jobs_here(folder, job, simulated, now) if job.field.boundary_m else []
    goes_on = (
        next((one.snapshot for one in here if one.is_same_job), None)
        if named is None
        else resume.read_snapshot(named)
    )
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
    """The job with the values that the operator measured and, where its files are the same, his
    choices; where it is simulated, the tractor stands where it stopped."""
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
    update |= {
        name: ndvi
        for name, ndvi in strips.items()
        if ndvi is not None and (same_files or getattr(job, name) is None)
    }
    simulated: dict[str, float] = {}
    if before.simulated:
        place_m = find_last_place(
            TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg), before
        )
        simulated |= {} if place_m is None else {"begin_m": _find_driven_m(job, machine, place_m)}
        simulated |= {} if before.hopper_kg is None else {"hopper_kg": max(0.0, before.hopper_kg)}
    return job.model_copy(update=update | {"simulated": job.simulated.model_copy(update=simulated)})


def continue_loop(loop: ControlLoop, before: EarlierWork) -> None:
    """Give the loop its earlier totals; where something lies already its guard against a second
    dose knows it.

    The scale's trim begins anew: nothing confirms what a scale showed before the cut.
    """
    last = before.job
    if last is not None:
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
    """The snapshot that a run begins with. names: of job, machine, crop."""
    job, machine, crop = names
    config = tuple(os.path.abspath(one) if os.path.exists(one) else one for one in options.config)
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
    """How far along its way the simulated tractor had come, m."""
    path = make_field_path(
        job.simulated, machine.geometry.working_width_m, job.field.pass_heading_deg
    )
    places = (k * SEARCH_M for k in range(int(path.length_m / SEARCH_M) + 1))

    def calc_distance_m(driven_m: float) -> float:
        pose = path.find_pose(driven_m)
        return hypot(pose.east_m - place_m[0], pose.north_m - place_m[1])

    return min(places, key=calc_distance_m)
