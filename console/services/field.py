"""How is the field of a frame drawn on the maps? Outline and planned rates come from the files next
to its run log.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from topdress.console.app.field_picture import FieldPicture, PlannedRates, Ring
from topdress.console.frame import Frame

if TYPE_CHECKING:
    from topdress.control.field.job import Job
    from topdress.control.geodesy import TangentPlane
    from topdress.control.targets.map_profile import MapProfile
    from topdress.drivers.files.run_meta import RunMeta

MAX_CELLS = 250_000
MIN_CELL_M = 1.0
# Number of cells that are sampled at once.
_SLICE_CELLS = 20_000


def make_field_picture(frame: Frame) -> FieldPicture | None:
    """Returns the picture of the job in the frame's log; None where the log does not name its job.

    Raises ValueError, one line, where the job's files cannot be read.
    """
    from topdress.drivers.files.atomic_files import find_sidecar
    from topdress.drivers.files.config_kinds import JOB_KIND, MACHINE_KIND
    from topdress.drivers.files.run_meta import parse_meta_yaml

    if not frame.log_path:
        return None
    described = find_sidecar(Path(frame.log_path))
    try:
        meta = parse_meta_yaml(described.read_text(encoding="utf-8"))
    except OSError:
        return None
    if meta.job is None:
        return None
    try:
        job = JOB_KIND.model.model_validate(dict(meta.job))
        machine = MACHINE_KIND.model.model_validate(dict(meta.machine)) if meta.machine else None
        picture = make_job_picture(
            job,
            find_job_folder(meta, job, described.parent),
            2.4 if machine is None else machine.geometry.working_width_m,
        )
        if machine is None or not machine.switched_strips:
            return picture
        return replace(
            picture, sections=tuple(accumulate(strip.share for strip in machine.switched_strips))
        )
    except (ValueError, OSError) as error:
        raise ValueError(" ".join(str(error).split())) from None


def find_map_plane(meta: RunMeta, log_folder: Path) -> TangentPlane | None:
    """Returns the plane of a job without an outline, which is its map's plane; None for other jobs.
    `log_folder` is the folder of the log."""
    from topdress.drivers.files.config_kinds import JOB_KIND
    from topdress.drivers.files.prescriptions.job_targets import read_job_map

    try:
        job = JOB_KIND.model.model_validate(dict(meta.job or {}))
        profile = (
            None
            if job.field.boundary_m
            else read_job_map(job, find_job_folder(meta, job, log_folder))
        )
    except (ValueError, OSError):
        return None
    return None if profile is None else profile.plane


def find_job_plane(meta: RunMeta, log_folder: Path) -> TangentPlane | None:
    """Returns the plane on which the loop of a log worked: its field's, else its map's; None for
    the plane of the first fix."""
    from topdress.control.field.job import Ground
    from topdress.control.geodesy import TangentPlane

    field = dict((meta.job or {}).get("field") or {})
    if not field.get("boundary_m"):
        return find_map_plane(meta, log_folder)
    ground = Ground.model_validate(field)
    return TangentPlane(ground.origin_lat_deg, ground.origin_lon_deg)


def make_job_picture(job: Job, folder: Path, width_m: float) -> FieldPicture:
    """Returns outline and plan of a job whose files are in `folder`. Raises ValueError, OSError."""
    from topdress.control.field.boundary import Boundary
    from topdress.drivers.files.prescriptions.job_targets import read_job_map

    rings: tuple[Ring, ...] = ()
    area_ha = None
    if job.field.boundary_m:
        area_ha = Boundary(job.field.boundary_m, job.field.holes_m).area_ha
        spread = job.field.make_spread_ground(0.0)
        rings = () if spread is None else spread.rings
    profile = read_job_map(job, folder)
    planned = None if profile is None else _sample_planned_rates(job, folder, profile, rings)
    return FieldPicture(job.field.title or job.title or job.id, rings, area_ha, width_m, planned)


def find_job_folder(meta: RunMeta, job: Job, log_folder: Path) -> Path:
    """Returns the folder of a recorded job's map and plants: the folder of the log if they are in
    it, else the folder of the run's job file."""
    names = job.named_files
    written = meta.extra.get("job_folder")
    if not isinstance(written, str) or all((log_folder / name).exists() for name in names):
        return log_folder
    return Path(written)


def _sample_planned_rates(
    job: Job, folder: Path, profile: MapProfile, rings: tuple[Ring, ...]
) -> PlannedRates:
    """Returns the map sampled at the centres of square cells, at most MOST_CELLS; NaN outside of
    the field."""
    from topdress.control.field.boundary import Boundary
    from topdress.control.orders import TargetSource
    from topdress.drivers.files.prescriptions.map_reader import read_prescription

    assert job.target.map is not None
    south, west, north, east = read_prescription(folder / job.target.map).data.box_deg
    corners = profile.plane.project_many_to_m(
        [south, south, north, north], [west, east, west, east]
    )
    (west_m, south_m), (east_m, north_m) = (
        corners.min(axis=0).tolist(),
        corners.max(axis=0).tolist(),
    )
    cell_m = max(MIN_CELL_M, math.sqrt((east_m - west_m) * (north_m - south_m) / MAX_CELLS))
    columns, rows = (
        max(1, math.ceil(span / cell_m)) for span in (east_m - west_m, north_m - south_m)
    )
    easts = west_m + (np.arange(columns) + 0.5) * cell_m
    norths = south_m + (np.arange(rows) + 0.5) * cell_m
    places = np.column_stack((np.tile(easts, rows), np.repeat(norths, columns)))
    rates = np.full(len(places), np.nan, dtype=np.float32)
    for begin in range(0, len(places), _SLICE_CELLS):
        targets = profile.prescription.find_targets(places[begin : begin + _SLICE_CELLS])
        rates[begin : begin + _SLICE_CELLS] = [
            target.rate_kg_ha if target.source is TargetSource.MAP else np.nan for target in targets
        ]
    if rings:
        rates[~Boundary(rings[0], rings[1:]).contains_places(places)] = np.nan
    return PlannedRates(west_m, south_m, cell_m, rates.reshape(rows, columns))
