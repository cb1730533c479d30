"""Where did doses land against their plants? Measured behind the machine, and judged over a run."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from topdress.control.machine.model_elements import Array

from .plant import PlantTruth

# A smaller flow ends a dose, kg/s.
MIN_DOSE_FLOW_KG_S = 1e-4
# A smaller mass is no dose, kg.
MIN_DOSE_KG = 1e-6
# A dose ends after this time without flow, s.
DOSE_END_S = 0.1
# Doses are measured this far behind their place, m.
MEASURED_BEHIND_M = 1.0
# Time for which the driven distance is stored, s.
WAY_KEPT_S = 30.0
# Plants closer ahead than this when work begins cannot be met, m.
UNREACHABLE_M = 5.0


class DoseErrors(NamedTuple):
    """Holds the errors of one run: middle of the dose minus its plant, late positive, m;
    unsigned in p50 and p95."""

    # Number of plants that the machine has passed at work.
    plants: int
    doses: int
    p50_m: float
    p95_m: float
    mean_m: float
    # Number of plants without a dose.
    missed: int
    # Number of plants with more than one dose.
    doubled: int
    # Mean mass of a dose, g.
    dose_g: float


class DoseWatch:
    """Watches the doses step by step. `plants_m`: rising places of the plants along the way."""

    def __init__(self, plants_m: Array, seed: int, measured_sd_m: float) -> None:
        self.plants_m = plants_m
        self.errors_m: list[float] = []
        # Plant of each ordered dose.
        self.for_plant: list[int] = []
        self.mass_kg: list[float] = []
        self._rng = np.random.default_rng(seed)
        self._sd_m = measured_sd_m
        # Time, s, and driven distance, m.
        self._way: deque[tuple[float, float]] = deque()
        # Mass of the present dose, kg, and its moment of the landing time, kg s.
        self._dose: tuple[float, float] | None = None
        self._flowed_s = 0.0
        self._number = 0
        # Landing time, s, and mass, kg.
        self._falling: deque[tuple[float, float]] = deque()
        # Position and error of the doses that were not measured yet.
        self._lying: deque[tuple[float, float]] = deque()
        self._last_s = 0.0
        self._from_m = float("inf")
        self._to_m = float("-inf")

    def record_order(self, place_m: float) -> None:
        """Records that a dose was ordered for the plant at this place of the way."""
        if len(self.plants_m):
            self.for_plant.append(int(np.argmin(np.abs(self.plants_m - place_m))))

    def take_step(self, truth: PlantTruth, at_work: bool) -> list[float]:
        """Takes one step and returns the errors measured in it, m."""
        step_s, self._last_s = truth.time_s - self._last_s, truth.time_s
        self._way.append((truth.time_s, truth.driven_m))
        while self._way[0][0] < truth.time_s - WAY_KEPT_S:
            self._way.popleft()
        if at_work:
            self._from_m, self._to_m = min(self._from_m, truth.driven_m), truth.driven_m
        self._collect_flow(truth, step_s)
        while self._falling and self._falling[0][0] <= truth.time_s:
            lands_s, kg = self._falling.popleft()
            place = float(np.interp(lands_s, [t for t, _ in self._way], [d for _, d in self._way]))
            self.mass_kg.append(kg)
            if len(self.errors_m) < len(self.for_plant):
                self.errors_m.append(
                    place - float(self.plants_m[self.for_plant[len(self.errors_m)]])
                )
                self._lying.append((place, self.errors_m[-1]))
        found = []
        while self._lying and self._lying[0][0] <= truth.driven_m - MEASURED_BEHIND_M:
            found.append(self._lying.popleft()[1] + self._sd_m * float(self._rng.standard_normal()))
        return found

    def judge_doses(self, settle: int = 0) -> DoseErrors:
        """Returns the errors of the run. `settle`: so many doses at the start are left out of
        the errors, but not of the misses."""
        last_m = float(self.plants_m[self.for_plant[-1]]) if self.for_plant else float("-inf")
        passed = np.flatnonzero(
            (self.plants_m > self._from_m + UNREACHABLE_M)
            & (self.plants_m <= max(last_m, self._to_m))
        )
        doses = np.bincount(np.array(self.for_plant, dtype=np.int64), minlength=len(self.plants_m))[
            passed
        ]
        errors = np.array(self.errors_m[settle:])
        size = np.abs(errors) if len(errors) else np.zeros(1)
        return DoseErrors(
            len(passed),
            len(self.for_plant),
            float(np.percentile(size, 50)),
            float(np.percentile(size, 95)),
            float(errors.mean()) if len(errors) else 0.0,
            int(np.sum(doses == 0)),
            int(np.sum(doses > 1)),
            1000.0 * float(np.mean(self.mass_kg)) if self.mass_kg else 0.0,
        )

    def _collect_flow(self, truth: PlantTruth, step_s: float) -> None:
        if truth.doses != self._number and self._dose is not None:
            self._finish_dose()
        self._number = truth.doses
        if truth.flow_kg_s > 0.0 and truth.doses > 0:
            part = truth.flow_kg_s * step_s
            kg, moment = self._dose or (0.0, 0.0)
            self._dose = (kg + part, moment + part * (truth.time_s - 0.5 * step_s + truth.drop_s))
            self._flowed_s = (
                truth.time_s if truth.flow_kg_s > MIN_DOSE_FLOW_KG_S else self._flowed_s
            )
        if self._dose is not None and truth.time_s - self._flowed_s > DOSE_END_S:
            self._finish_dose()

    def _finish_dose(self) -> None:
        if self._dose is not None and self._dose[0] > MIN_DOSE_KG:
            kg, moment = self._dose
            self._falling.append((moment / kg, kg))
        self._dose = None
