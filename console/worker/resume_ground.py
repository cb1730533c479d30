"""Records finished ground while it grows, and converts it to and from a file."""

from __future__ import annotations

import base64
import zlib
from collections import deque
from math import hypot
from typing import Any

import numpy as np
from topdress.control.field.coverage import MAX_RASTER_CELLS, Coverage, Raster
from topdress.control.field.ground_trace import GroundTrace
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.sections import LoggedValves

# Largest side of a cell, m; it is also at most a sixth of the working width.
MAX_CELL_M = 0.25
# Initial distance between stored positions of the map's track, m.
MIN_TRACK_STEP_M = 1.0
# Limit of stored positions: beyond it every second position is dropped and the distance doubles.
MAX_TRACK_PLACES = 8_000
EMPTY_RASTER = Raster(0.0, 0.0, MAX_CELL_M, np.zeros((1, 1), dtype=np.bool_))

# East m, north m, heading degrees, kg/ha.
Spot = tuple[float, float, float, float]


class WorkedGroundRecord:
    """Grows with the ticks. `before` is the ground that an earlier part of the job has finished."""

    def __init__(
        self, machine: Machine, before: Raster = EMPTY_RASTER, track: tuple[Spot, ...] = ()
    ) -> None:
        width_m = machine.geometry.working_width_m
        cell_m = min(MAX_CELL_M, width_m / 6.0)
        # Half of the lowest speed separates a turning shaft from noise of a standing shaft.
        self._fall, self._turning_rpm = machine.fall, 0.5 * machine.limits.shaft_low_rpm
        # The cells differ if the earlier part had a machine of another width.
        if before.cell_m != cell_m and before.done.any():
            redrawn = Coverage(width_m, cell_m)
            redrawn.add_earlier_ground(before)
            before = redrawn.make_raster()
        self._before = before
        strips = [(strip.left_m, strip.right_m) for strip in machine.switched_strips]
        self._width_m, self._cell_m, self._strips = width_m, cell_m, strips
        self._coverage = Coverage(width_m, cell_m, strips=strips)
        self._trace = GroundTrace(self._coverage)
        self._valves = LoggedValves(machine.sections if strips else ())
        # Landing time and open strips of released granules.
        self._falling: deque[tuple[float, tuple[bool, ...]]] = deque()
        self._drop_s = 0.0
        self._flowing = (False,) * max(1, len(strips))
        self.track: list[Spot] = list(track)
        self._track_step_m = MIN_TRACK_STEP_M

    def add_outlet_place(
        self,
        time_s: float,
        place_m: tuple[float, float] | None,
        heading_deg: float | None,
        shaft_rpm: float | None,
        applied_kg_ha: float,
        sections_cmd: str | None = None,
        way_m: float = 0.0,
    ) -> bool:
        """Record the present position of the outlets, and return True if material lands here.
        Granules land a drop time after their release.

        Parameters
        ----------
        time_s
            Time of the row, s.
        place_m, heading_deg
            Position and heading; None where unknown.
        shaft_rpm
            Measured shaft speed; None where unknown.
        applied_kg_ha
            Applied rate.
        sections_cmd
            Column of the section valves.
        way_m
            Distance since the last call, m; used where no position is known.
        """
        released = shaft_rpm is not None and shaft_rpm >= self._turning_rpm
        if shaft_rpm is not None and released:
            self._drop_s = calc_drop_s(self._fall, shaft_rpm)
        opened = self._valves.find_open_valves(time_s, sections_cmd) or (True,)
        self._falling.append((time_s + self._drop_s, tuple([released and on for on in opened])))
        while self._falling and self._falling[0][0] <= time_s:
            self._flowing = self._falling.popleft()[1]
        self._trace.pass_over(place_m, heading_deg, self._flowing, way_m)
        lands = any(self._flowing)
        if lands and place_m is not None and heading_deg is not None:
            self._note_track_place(
                (
                    round(place_m[0], 1),
                    round(place_m[1], 1),
                    round(heading_deg),
                    round(applied_kg_ha),
                )
            )
        return lands

    def make_raster(self) -> Raster:
        """Return all finished ground, including the earlier part. Without positions the way
        continues straight until a position corrects it."""
        done = join_rasters(self._before, self._coverage.make_raster())
        reckoned = self._trace.reckon_open_way()
        if not reckoned:
            return done
        way = Coverage(self._width_m, self._cell_m, strips=self._strips)
        for passed in reckoned:
            way.extend_to(*passed)
        return join_rasters(done, way.make_raster())

    def _note_track_place(self, spot: Spot) -> None:
        """Store a position of the track if it is far enough from the last one."""
        if (
            self.track
            and hypot(spot[0] - self.track[-1][0], spot[1] - self.track[-1][1]) < self._track_step_m
        ):
            return
        self.track.append(spot)
        if len(self.track) > MAX_TRACK_PLACES:
            self.track = self.track[::2]
            self._track_step_m *= 2.0


def join_rasters(one: Raster, other: Raster) -> Raster:
    """Return the union of two rasters with equal cells. If they are too far apart for one raster,
    the newer (`other`) is returned."""
    if not one.done.any():
        return other
    if not other.done.any():
        return one
    cell = one.cell_m
    west, south = min(one.west_m, other.west_m), min(one.south_m, other.south_m)
    east = max(r.west_m + r.done.shape[1] * cell for r in (one, other))
    north = max(r.south_m + r.done.shape[0] * cell for r in (one, other))
    rows, columns = round((north - south) / cell), round((east - west) / cell)
    if rows * columns > MAX_RASTER_CELLS:
        return other
    done = np.zeros((rows, columns), dtype=np.bool_)
    for r in (one, other):
        row, column = round((r.south_m - south) / cell), round((r.west_m - west) / cell)
        done[row : row + r.done.shape[0], column : column + r.done.shape[1]] |= r.done
    return Raster(west, south, cell, done)


def pack_raster(ground: Raster) -> dict[str, Any]:
    """Return a raster as plain data for a file; `unpack_raster` reads it."""
    # One bit per cell and the fastest compression: the snapshot is written every few seconds.
    bits = zlib.compress(np.packbits(ground.done).tobytes(), level=1)
    return {
        "west_m": ground.west_m,
        "south_m": ground.south_m,
        "cell_m": ground.cell_m,
        "rows": ground.done.shape[0],
        "columns": ground.done.shape[1],
        "bits": base64.b64encode(bits).decode(),
    }


class RasterSchema:
    """Defines for pydantic how a `Raster` is read."""

    @classmethod
    def __get_pydantic_core_schema__(cls, _kind: Any, _next: Any) -> Any:
        """Return a schema that calls `unpack_raster`."""
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(unpack_raster)


def unpack_raster(data: dict[str, Any]) -> Raster:
    """Return the raster of a file. Raises ValueError, KeyError or TypeError for data that
    `pack_raster` did not make."""
    rows, columns, cell_m = int(data["rows"]), int(data["columns"]), float(data["cell_m"])
    if not (rows > 0 and columns > 0 and 0.0 < cell_m < 10.0):
        raise ValueError("ground: rows, columns and cell_m must be above 0")
    if rows * columns > MAX_RASTER_CELLS:
        raise ValueError(f"ground: {rows} x {columns} cells: allowed up to {MAX_RASTER_CELLS}")
    try:
        # The limit of the output protects against data that expands without end.
        unpacker = zlib.decompressobj()
        bits = np.frombuffer(
            unpacker.decompress(base64.b64decode(data["bits"]), rows * columns // 8 + 2), np.uint8
        )
    except zlib.error as error:
        raise ValueError(f"ground: {error}") from None
    if bits.size != (rows * columns + 7) // 8:
        raise ValueError(f"ground: {bits.size} bytes of cells for {rows} x {columns}")
    done = np.unpackbits(bits, count=rows * columns).reshape(rows, columns).astype(np.bool_)
    return Raster(float(data["west_m"]), float(data["south_m"]), cell_m, done)
