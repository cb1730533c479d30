"""How does a run log become frames for the Replay screen? The frames show the recorded decisions,
or those of a simulated what-if.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from topdress.console.app.pages.replay.service import IsCancelled, ReplayJob, TellShare, WhatIf
from topdress.console.app.replay_source import ReplaySource
from topdress.console.frame import Frame
from topdress.console.services.field import find_job_plane
from topdress.control.geodesy import TangentPlane
from topdress.control.log_row import LogRow
from topdress.control.orders import Alarm
from topdress.control.safety import ALARMS

if TYPE_CHECKING:
    from topdress.drivers.files.read_log import RunLog

# Number of rows between two reports of progress.
ROWS_PER_PROGRESS = 64


def open_replay(recorded: RunLog) -> ReplayJob:
    """Returns the log opened for the Replay screen, with its what-if."""
    from topdress.drivers.files.config import find_shipped_files

    frames = list(make_frames(recorded.rows(), recorded))
    return ReplayJob(
        ReplaySource(frames, time.monotonic),
        recorded.path.name,
        tuple(str(finding) for finding in recorded.findings),
        partial(_make_what_if_frames, recorded),
        tuple(find_shipped_files("crops")),
        tuple(find_shipped_files("machines")),
    )


def make_frames(
    rows: Iterator[LogRow],
    recorded: RunLog,
    width_m: float = 2.4,
    plane: TangentPlane | None = None,
) -> Iterator[Frame]:
    """Yields one frame for each row. Area and mass are summed from the rows; an alarm begins at its
    first row.

    `plane` is the plane of the positions; None means the plane of the log's loop, else of its first
    fix. For a log that does not name its machine, positions are used as those of the outlets.
    """
    meta = recorded.meta
    machine = dict(meta.machine or {}) if meta else {}
    crop = dict(meta.crop or {}) if meta else {}
    job = dict(meta.job or {}) if meta else {}
    width_m = float(dict(machine.get("geometry", {})).get("working_width_m", width_m))
    ahead_m = float(dict(machine.get("geometry", {})).get("antenna_m", 2.0 if machine else 0.0))
    plane = plane or (find_job_plane(meta, recorded.path.parent) if meta is not None else None)
    since: dict[str, float] = {}
    area = mass = 0.0
    last_s: float | None = None
    place: tuple[float, float] | None = None
    for number, row in enumerate(rows):
        dt = 0.0 if last_s is None else max(0.0, row.time_s - last_s)
        last_s = row.time_s
        if row.lat_deg is not None and row.lon_deg is not None:
            plane = plane or TangentPlane(row.lat_deg, row.lon_deg)
            place = _find_outlet_place(plane, row, ahead_m)
        speed, rate = row.speed_used_mps or row.speed_mps, row.applied_rate_kg_ha
        if speed and rate and dt < 5.0:
            area += speed * width_m * dt / 10_000.0
            mass += rate * speed * width_m * dt / 10_000.0
        ids = [name for name in (row.alarms or "").split(";") if name in ALARMS]
        since = {name: since.get(name, row.time_s) for name in ids}
        alarms = tuple(Alarm(name, ALARMS[name].severity, since[name]) for name in ids)
        yield Frame(
            seq=number,
            at_s=row.time_s,
            row=row,
            alarms=alarms,
            area_ha=area,
            applied_kg=mass,
            job=str(job.get("title") or job.get("id") or ""),
            machine=str(machine.get("title") or machine.get("id") or ""),
            crop=str(crop.get("name") or ""),
            log_path=str(recorded.path),
            simulated=bool(meta and meta.seed is not None),
            place_m=place,
            gnss_age_s=None if row.lat_deg is None else 0.0,
        )


def _find_outlet_place(plane: TangentPlane, row: LogRow, ahead_m: float) -> tuple[float, float]:
    from topdress.control.geodesy import offset_place

    antenna = plane.project_to_m(row.lat_deg or 0.0, row.lon_deg or 0.0)
    back = antenna if row.heading_deg is None else offset_place(antenna, row.heading_deg, -ahead_m)
    return float(back[0]), float(back[1])


def _make_what_if_frames(
    recorded: RunLog, options: WhatIf, cancelled: IsCancelled, tell: TellShare
) -> Sequence[Frame]:
    """Returns frames of the control loop run again on the log's measurements; the frames so far if
    it is cancelled. Raises ValueError in one line."""
    import dataclasses

    from topdress.console.services.replay_rerun import load_rerun_setup, rerun_loop
    from topdress.control.field.job import make_rule
    from topdress.control.orders import Strategy
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import CROP_KIND

    setup = load_rerun_setup(
        recorded, options.machine, None, Strategy(options.strategy) if options.strategy else None
    )
    if options.crop:
        crop = load_config(options.crop, CROP_KIND).model
        setup = dataclasses.replace(setup, crop=crop, rule=make_rule(crop, setup.job))
    rows = (tick.row for tick in rerun_loop(recorded, setup))
    return list(
        make_frames(
            _report_progress(rows, len(recorded), cancelled, tell),
            recorded,
            setup.machine.geometry.working_width_m,
        )
    )


def _report_progress(
    rows: Iterator[LogRow], count: int, cancelled: IsCancelled, tell: TellShare
) -> Iterator[LogRow]:
    """Yields the rows until it is cancelled; reports progress every `ROWS_PER_PROGRESS` rows."""
    for number, row in enumerate(rows):
        if cancelled():
            return
        if number % ROWS_PER_PROGRESS == 0:
            tell(number / max(1, count))
        yield row
