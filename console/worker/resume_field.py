"""Selects unfinished jobs by position: those that lie on the field to be worked, converted to its
plane.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from itertools import islice
from math import ceil, floor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from topdress.console.worker.resume import MIN_RESUMABLE_HA, Snapshot, find_open_jobs
from topdress.control.field.boundary import Boundary
from topdress.control.field.coverage import MAX_DISTANCE_M, MAX_RASTER_CELLS, Raster
from topdress.control.field.job import Job
from topdress.control.geodesy import Place, TangentPlane

# Share of a job's finished ground on this field from which the job belongs to this field.
MIN_SAME_FIELD_SHARE = 0.5
# Planes whose origins are closer than this, m, count as equal.
SAME_PLANE_TOLERANCE_M = 0.001
# Number of sampled cells: enough for the share on a field to some 1 %.
MAX_SAMPLED_CELLS = 4_000
# Rows of a raster that are redrawn at a time, which bounds the memory.
_REDRAWN_BLOCK_ROWS = 256


class InterruptedJob(NamedTuple):
    """Holds an interrupted job; `share` is the share of its finished ground on the field in
    question, 0 to 1."""

    path: Path
    snapshot: Snapshot
    share: float

    @property
    def is_same_job(self) -> bool:
        """Whether it is the same job, which continues with its totals; otherwise its ground alone
        counts."""
        return self.share >= MIN_SAME_FIELD_SHARE


def find_jobs_here(folder: Path, job: Job, simulated: bool, now: datetime) -> list[InterruptedJob]:
    """Return the jobs that have spread on this job's field, newest first; simulated and real jobs
    are separate.

    Without a boundary no field exists to decide by: the newest job is returned, whatever its field.
    """
    left = (one for one in find_open_jobs(folder, now) if one[1].simulated == simulated)
    boundary = job.field.make_boundary()
    if boundary is None:
        return [InterruptedJob(*one, 1.0) for one in islice(left, 1)]
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    shares = ((one, _calc_share_on_field(boundary, plane, one[1])) for one in left)
    return [InterruptedJob(*one, share) for one, share in shares if share is not None]


def list_logs_here(folder: Path, job: Job, simulated: bool, now: datetime) -> list[str]:
    """Return the file names of the logs of these jobs, all parts; their ground receives nothing
    again."""
    return [
        Path(log).name
        for one in find_jobs_here(folder, job, simulated, now)
        for log in (*one.snapshot.logs_before, one.snapshot.log_path)
    ]


def _calc_share_on_field(field: Boundary, plane: TangentPlane, snapshot: Snapshot) -> float | None:
    """Return the share of a job's finished ground on the field, 0 to 1; None if next to nothing
    lies there."""
    ground, cells = snapshot.ground, np.argwhere(snapshot.ground.done)
    if snapshot.origin_deg is None or not len(cells):
        place = find_last_place(plane, snapshot)  # cut off before anything has landed
        return 1.0 if place is not None and field.contains_place(*place) else None
    some = cells[:: max(1, len(cells) // MAX_SAMPLED_CELLS)]
    places = (some[:, ::-1] + 0.5) * ground.cell_m + (ground.west_m, ground.south_m)
    share = float(
        field.contains_places(
            _move_places(TangentPlane(*snapshot.origin_deg), plane, places)
        ).mean()
    )
    done_ha = len(cells) * ground.cell_m**2 / 10_000.0
    return share if share >= MIN_SAME_FIELD_SHARE or share * done_ha >= MIN_RESUMABLE_HA else None


def move_snapshot(snapshot: Snapshot, plane: TangentPlane) -> Snapshot:
    """Return the snapshot on another plane: ground, track and position. Parts beyond the reach of a
    field's plane are omitted."""
    if snapshot.origin_deg is None:
        return snapshot
    own = TangentPlane(*snapshot.origin_deg)
    if max(map(abs, plane.project_to_m(own.lat_deg, own.lon_deg))) < SAME_PLANE_TOLERANCE_M:
        return snapshot
    track = (
        _move_places(own, plane, np.array([spot[:2] for spot in snapshot.track]).reshape(-1, 2))
        .round(1)
        .tolist()
    )
    return replace(
        snapshot,
        origin_deg=(plane.lat_deg, plane.lon_deg),
        ground=_redraw_ground(snapshot.ground, own, plane),
        place_m=None if snapshot.place_m is None else find_last_place(plane, snapshot),
        track=tuple(
            (east, north, *spot[2:])
            for (east, north), spot in zip(track, snapshot.track, strict=True)
        ),
    )


def find_last_place(plane: TangentPlane, snapshot: Snapshot) -> Place | None:
    """Return the last position of the outlets on `plane` (east, north, m); None where unknown."""
    if snapshot.place_m is None or snapshot.origin_deg is None:
        return None
    east, north = _move_places(
        TangentPlane(*snapshot.origin_deg), plane, np.array([snapshot.place_m])
    )[0].tolist()
    return east, north


def _move_places(own: TangentPlane, plane: TangentPlane, places: np.ndarray) -> np.ndarray:
    """Convert positions (n, 2) from one plane to another, m.

    Between planes of one neighbourhood the conversion is a rotation and a shift, which three
    positions determine to 1 mm over a field of 5 km.
    """
    if not len(places):
        return places
    middle = places.mean(axis=0)
    reach = max(1.0, float(np.abs(places - middle).max()))
    corners = middle + reach * np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    seen = np.array(
        [plane.project_to_m(*own.convert_to_deg(east, north)) for east, north in corners.tolist()]
    )
    moved: np.ndarray = seen[0] + (places - middle) / reach @ (seen[1:] - seen[0])
    return moved


def _redraw_ground(ground: Raster, own: TangentPlane, plane: TangentPlane) -> Raster:
    """Return the ground on another plane: a cell is finished if its centre lies in a finished
    cell."""
    rows, columns = ground.done.shape
    cell_m = ground.cell_m
    frame = np.array(
        [
            (ground.west_m + k % 2 * columns * cell_m, ground.south_m + k // 2 * rows * cell_m)
            for k in range(4)
        ]
    )
    corners = _move_places(own, plane, frame)
    west, south = (floor(edge / cell_m) for edge in corners.min(axis=0))
    east, north = (ceil(edge / cell_m) for edge in corners.max(axis=0))
    # Ground beyond the reach of the plane is dropped instead of filling the memory.
    if np.abs(corners).max() > MAX_DISTANCE_M or (east - west) * (north - south) > MAX_RASTER_CELLS:
        return ground._replace(done=np.zeros((1, 1), dtype=np.bool_))
    done = np.zeros((north - south, east - west), dtype=np.bool_)
    aside = (np.arange(west, east) + 0.5) * cell_m
    for first in range(0, len(done), _REDRAWN_BLOCK_ROWS):
        part = done[first : first + _REDRAWN_BLOCK_ROWS]
        up = (south + first + np.arange(len(part)) + 0.5) * cell_m
        # The inverse conversion visits every new cell once, so that no cell stays empty by
        # rounding.
        there = _move_places(
            plane, own, np.stack(np.broadcast_arrays(aside, up[:, None]), axis=-1).reshape(-1, 2)
        )
        at = np.floor((there - (ground.west_m, ground.south_m)) / cell_m).astype(np.int64)
        inside = ((at >= 0) & (at < (columns, rows))).all(axis=1)
        found = np.zeros(len(at), dtype=np.bool_)
        found[inside] = ground.done[at[inside, 1], at[inside, 0]]
        part[:] = found.reshape(part.shape)
    return Raster(west * cell_m, south * cell_m, cell_m, done)
