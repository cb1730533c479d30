"""Which plants does a simulated camera report? Each picture arrives when its computer has
finished."""

from __future__ import annotations

from collections import deque

import numpy as np
from topdress.control.field.job import Camera
from topdress.control.machine.model_elements import Array
from topdress.control.readings import CameraPlant


class SimulatedCamera:
    """Simulates the camera. `plants_m`: rising places of the plants along the way."""

    def __init__(self, camera: Camera, plants_m: Array, seed: int) -> None:
        self._camera = camera
        self._plants_m = plants_m
        self._rng = np.random.default_rng(seed)
        self._next_s = 0.0
        self._pictures: deque[tuple[float, list[CameraPlant]]] = deque()

    def report_plants(self, now_s: float, driven_m: float) -> tuple[CameraPlant, ...]:
        """Returns the plants reported at `now_s`; takes a new picture where one is due."""
        camera = self._camera
        if now_s >= self._next_s - 1e-9:
            self._next_s += 1.0 / camera.hz
            begin = driven_m + camera.ahead_m
            first, last = np.searchsorted(self._plants_m, (begin, begin + camera.view_m))
            ahead = self._plants_m[first:last] - driven_m
            ahead = ahead + camera.seen_sd_m * self._rng.standard_normal(len(ahead))
            self._pictures.append(
                (now_s + camera.computing_s, [CameraPlant(now_s, float(d)) for d in ahead])
            )
        reported: list[CameraPlant] = []
        while self._pictures and self._pictures[0][0] <= now_s + 1e-9:
            reported += self._pictures.popleft()[1]
        return tuple(reported)
