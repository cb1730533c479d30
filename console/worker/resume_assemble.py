"""A job that was cut off, put together again: the loop goes on with what was done, off and with all else as usual."""
from __future__ import annotations

import os
from dataclasses import replace
from math import hypot
from pathlib import Path

from console.worker import resume
from console.worker.options import Options
from console.worker.resume import Snapshot
from console.worker.resume_tail import with_tail
from control.field.job import Job
from control.geodesy import TangentPlane
from control.loop import ControlLoop
from control.machine.machine import Machine
from control.orders import Strategy
from control.simulation.tractor import field_path

SEARCH_M = 0.5              # along the simulated tractor's way


def before_of(options: Options, machine: Machine, n_fraction: float, stops_s: float | None) -> Snapshot | None:
    """What was done before, up to the last row that reached the disk, and what fell after it; None where nothing is to
    go on. stops_s: as `with_tail` has it.

    Raises ValueError, OSError.
    """
    if options.resume is None:
        return None
    return with_tail(resume.read(options.resume), machine, n_fraction, stops_s)


def job_to_go_on(job: Job, machine: Machine, before: Snapshot) -> Job:
    """The job with what the operator had chosen and measured; where it is simulated, the tractor stands where it
    stopped."""
    update: dict[str, object] = {"strategy": Strategy(before.strategy), "look_ahead": before.look_ahead,
                                 "flow_trim": before.flow_trim_on}
    strips = {"ndvi_nrich": before.ndvi_nrich, "ndvi_check": before.ndvi_check}
    update |= {name: ndvi for name, ndvi in strips.items() if ndvi is not None}
    simulated: dict[str, float] = {}
    if before.simulated and before.place_m is not None:
        simulated["begin_m"] = _driven_m(job, machine, before.place_m)
    if before.simulated and before.hopper_kg is not None:
        simulated["hopper_kg"] = max(0.0, before.hopper_kg)
    return job.model_copy(update=update | {"simulated": job.simulated.model_copy(update=simulated)})


def go_on(loop: ControlLoop, before: Snapshot) -> None:
    """Totals and trim as they were; where something lies already the loop's guard against a second dose knows it."""
    plane = None if before.origin_deg is None else TangentPlane(*before.origin_deg)
    loop.go_on(before.sums, before.flow_trim, before.ground, plane, before.after_cut_kg)


def started(options: Options, log: Path, names: tuple[str, str, str], simulated: bool, now_utc: str,
          before: Snapshot | None) -> Snapshot:
    """The snapshot that a run begins with. names: of job, machine, crop."""
    job, machine, crop = names
    config = tuple(os.path.abspath(one) if os.path.exists(one) else one for one in options.config)
    start = before or Snapshot(str(log), began_utc=now_utc)
    earlier = () if before is None else (*before.logs_before, before.log_path)
    return replace(start, log_path=os.path.abspath(log), saved_utc=now_utc, job=job, machine=machine, crop=crop,
                   simulated=simulated, config=config, seed=options.seed, effects=options.effects, hz=options.hz,
                   logs_before=earlier, time_s=0.0, sums_s=0.0, quit=False)


def _driven_m(job: Job, machine: Machine, place_m: tuple[float, float]) -> float:
    """How far along its way the simulated tractor had come."""
    path = field_path(job.simulated, machine.geometry.working_width_m, job.field.pass_heading_deg)
    places = (k * SEARCH_M for k in range(int(path.length_m / SEARCH_M) + 1))

    def apart(driven_m: float) -> float:
        pose = path.at(driven_m)
        return hypot(pose.east_m - place_m[0], pose.north_m - place_m[1])

    return min(places, key=apart)
