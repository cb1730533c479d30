"""Ground that is done: as it grows, as it is kept in a file, and as an edge that the loop takes care not to pass."""
from __future__ import annotations

import base64
import zlib
from collections import deque
from math import cos, hypot, isfinite, radians, sin
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.field.coverage import Coverage, Raster
from control.machine.fall import drop_s
from control.machine.machine import Machine
from control.targets.fence import Edge

CELL_M = 0.25               # at most a sixth of the width
STEP_M = 0.1                # along a line that is searched for done ground
TRACK_STEP_M = 1.0          # places kept for the map: at least this far apart ...
TRACK_PLACES = 8_000        # ... and no more than these; then every other one goes and the step doubles
NOTHING_DONE = Raster(0.0, 0.0, CELL_M, np.zeros((1, 1), dtype=np.bool_))

Spot = tuple[float, float, float, float]    # east m, north m, heading degrees, kg/ha


class Done:
    """Grows by the tick. `before`: what an earlier part of the job has done."""

    def __init__(self, machine: Machine, before: Raster = NOTHING_DONE, track: tuple[Spot, ...] = ()) -> None:
        width_m = machine.geometry.working_width_m
        cell_m = before.cell_m if before.done.any() else min(CELL_M, width_m / 6.0)
        self._fall, self._turning_rpm = machine.fall, 0.5 * machine.limits.shaft_low_rpm
        self._before = before
        self._coverage = Coverage(width_m, cell_m)
        self._falling: deque[tuple[float, bool]] = deque()      # when it lands, whether there is any
        self._drop_s = 0.0
        self._flowing = False
        self.track: list[Spot] = list(track)
        self._track_step_m = TRACK_STEP_M

    def pass_over(self, time_s: float, place_m: tuple[float, float], heading_deg: float, shaft_rpm: float | None,
                  applied_kg_ha: float) -> bool:
        """The outlets are here; true where something lands. What is released lands a drop time later."""
        released = shaft_rpm is not None and shaft_rpm >= self._turning_rpm
        if shaft_rpm is not None and released:
            self._drop_s = drop_s(self._fall, shaft_rpm)
        self._falling.append((time_s + self._drop_s, released))
        while self._falling and self._falling[0][0] <= time_s:
            self._flowing = self._falling.popleft()[1]
        self._coverage.lay(place_m, heading_deg, self._flowing)
        if self._flowing:
            self._note_track((round(place_m[0], 1), round(place_m[1], 1), round(heading_deg), round(applied_kg_ha)))
        return self._flowing

    def lost(self) -> None:
        """No place is known: the stretch ends."""
        self._coverage.lay((float("nan"), float("nan")), 0.0, False)

    def raster(self) -> Raster:
        """All that is done, the earlier part too."""
        return joined(self._before, self._coverage.raster())

    def _note_track(self, spot: Spot) -> None:
        if self.track and hypot(spot[0] - self.track[-1][0], spot[1] - self.track[-1][1]) < self._track_step_m:
            return
        self.track.append(spot)
        if len(self.track) > TRACK_PLACES:
            self.track = self.track[::2]
            self._track_step_m *= 2.0


def joined(one: Raster, other: Raster) -> Raster:
    """What either has. Both must have the same cells; one with nothing in it gives the other."""
    if not one.done.any():
        return other
    if not other.done.any():
        return one
    cell = one.cell_m
    west, south = min(one.west_m, other.west_m), min(one.south_m, other.south_m)
    east = max(r.west_m + r.done.shape[1] * cell for r in (one, other))
    north = max(r.south_m + r.done.shape[0] * cell for r in (one, other))
    done = np.zeros((round((north - south) / cell), round((east - west) / cell)), dtype=np.bool_)
    for r in (one, other):
        row, column = round((r.south_m - south) / cell), round((r.west_m - west) / cell)
        done[row:row + r.done.shape[0], column:column + r.done.shape[1]] |= r.done
    return Raster(west, south, cell, done)


def packed(ground: Raster) -> dict[str, Any]:
    """As plain data for a file; `unpacked` reads it."""
    bits = zlib.compress(np.packbits(ground.done).tobytes(), level=1)
    return {"west_m": ground.west_m, "south_m": ground.south_m, "cell_m": ground.cell_m,
            "rows": ground.done.shape[0], "columns": ground.done.shape[1], "bits": base64.b64encode(bits).decode()}


def unpacked(data: dict[str, Any]) -> Raster:
    """Raises ValueError, KeyError, TypeError where the data is not what `packed` made."""
    rows, columns, cell_m = int(data["rows"]), int(data["columns"]), float(data["cell_m"])
    if not (rows > 0 and columns > 0 and 0.0 < cell_m < 10.0):
        raise ValueError("ground: rows, columns and cell_m must be above 0")
    try:
        bits = np.frombuffer(zlib.decompress(base64.b64decode(data["bits"])), dtype=np.uint8)
    except zlib.error as error:
        raise ValueError(f"ground: {error}") from None
    if bits.size != (rows * columns + 7) // 8:
        raise ValueError(f"ground: {bits.size} bytes of cells for {rows} x {columns}")
    done = np.unpackbits(bits, count=rows * columns).reshape(rows, columns).astype(np.bool_)
    return Raster(float(data["west_m"]), float(data["south_m"]), cell_m, done)


class Undone(NamedTuple):
    """The field less what is done, as an edge for `control.targets.fence.Fence`. field: None where none is known.

    The middle of the outlets counts: ground beside a pass that it only overlaps is not done.
    """

    ground: Raster
    field: Edge | None

    def contains(self, east_m: float, north_m: float) -> bool:
        if self.field is not None and not self.field.contains(east_m, north_m):
            return False
        return not bool(self._done(np.array([east_m]), np.array([north_m]))[0])

    def crossings_m(self, east_m: float, north_m: float, heading_deg: float, farthest_m: float) -> list[float]:
        """Distances ahead at which the way passes between what is to be done and what is not, rising. About 60 us."""
        if not (isfinite(east_m) and isfinite(north_m) and isfinite(heading_deg)):
            return []
        ahead = np.arange(0.0, farthest_m + 0.5 * STEP_M, STEP_M)
        angle = radians(heading_deg)
        done = self._done(east_m + ahead * sin(angle), north_m + ahead * cos(angle))
        changes = [float(place) for place in ahead[1:][done[1:] != done[:-1]]]
        if self.field is None:
            return changes
        edges = self.field.crossings_m(east_m, north_m, heading_deg, farthest_m)
        if not changes and not done[0]:
            return edges
        inside, open_now, found = self.field.contains(east_m, north_m), self.contains(east_m, north_m), []
        covered = bool(done[0])
        for place, of_field in sorted([(p, True) for p in edges] + [(p, False) for p in changes]):
            if of_field:
                inside = not inside
            else:
                covered = not covered
            if (inside and not covered) != open_now:
                open_now = not open_now
                found.append(place)
        return found

    def _done(self, east_m: npt.NDArray[np.float64], north_m: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        g = self.ground
        column = np.floor((east_m - g.west_m) / g.cell_m).astype(np.int64)
        row = np.floor((north_m - g.south_m) / g.cell_m).astype(np.int64)
        there = (row >= 0) & (row < g.done.shape[0]) & (column >= 0) & (column < g.done.shape[1])
        found = np.zeros(east_m.shape, dtype=np.bool_)
        found[there] = g.done[row[there], column[there]]
        return found
