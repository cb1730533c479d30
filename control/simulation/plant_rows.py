"""Where do the plants of the simulated field stand along the machine's way?"""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
from topdress.control.field.job import Job
from topdress.control.machine.model_elements import Array

from .tractor import TractorPath, order_passes


def make_simulated_plants(job: Job, width_m: float, seed: int) -> Array:
    """Returns the places (n, 2) of the plants of `simulated.plants`, east and north, m; empty
    without it."""
    plants, sim = job.simulated.plants, job.simulated
    if plants is None:
        return np.zeros((0, 2))
    rng = np.random.default_rng(seed)
    north = radians(job.field.pass_heading_deg)
    rows = []
    for k in order_passes(sim.passes):
        along = np.arange(plants.spacing_m, sim.pass_length_m, plants.spacing_m)
        along = along + plants.scatter_percent / 100.0 * plants.spacing_m * rng.standard_normal(
            len(along)
        )
        across = (k + 0.5) * width_m
        rows.append(
            np.column_stack(
                (along * sin(north) + across * cos(north), along * cos(north) - across * sin(north))
            )
        )
    return np.concatenate(rows)


def find_plants_along_way(path: TractorPath, places: Array, half_width_m: float) -> Array:
    """Returns the rising distances (k,) at which the outlet passes the plants (n, 2) within
    `half_width_m`, on the straight legs of its way, m."""
    found = []
    for begin_m, leg in path.list_straight_legs():
        angle = radians(leg.heading_deg)
        off = places - np.array([leg.east_m, leg.north_m])
        ahead = off[:, 0] * sin(angle) + off[:, 1] * cos(angle)
        aside = off[:, 0] * cos(angle) - off[:, 1] * sin(angle)
        met = (ahead >= 0.0) & (ahead <= leg.length_m) & (np.abs(aside) <= half_width_m)
        found.append(begin_m + ahead[met])
    return np.sort(np.concatenate(found)) if found else np.zeros(0)
