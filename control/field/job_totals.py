"""Sums a job: area, product, nitrogen, and the uniformity of the rate over the worked area."""

from __future__ import annotations

import math
from typing import NamedTuple

# Share of the target from which material counts as arrived; a standing shaft reads up to 1 r/min,
# some 1 % of it.
ARRIVED_RATE_OF_TARGET = 0.1
# Bin width of the rate histogram for C_uc, kg/ha; the error of C_uc is below this over the mean
# rate.
_BIN_KG_HA = 0.25


class Totals(NamedTuple):
    """Totals of a job. Rates are means over worked area; None before any area was worked."""

    # Worked area, ha: open width times distance while material left, overlaps included.
    area_ha: float
    applied_kg: float
    applied_n_kg: float
    # Target mass on the area with a known target, kg.
    target_kg: float
    worked_s: float
    mean_rate_kg_ha: float | None
    # Area-weighted standard deviation over the mean, %.
    cv_percent: float | None
    # Christiansen's uniformity, %, paper A, eq 1, weighted by area.
    cuc_percent: float | None
    # Applied over target minus 1, %, on the area with a known target.
    error_percent: float | None
    # Covered area with each position counted once, including earlier parts of the job, ha.
    covered_ha: float | None = None
    # Area that was passed over again, counted every time, since the console's start, ha.
    overlap_ha: float | None = None
    # Distance for the present mass in the hopper at the present rate, m.
    metres_left_m: float | None = None
    # Number of doses of point mode.
    doses: int | None = None
    doses_missed: int | None = None
    # Part of applied_kg that was released despite a stop command, on no area, kg.
    stopped_kg: float = 0.0


class TotalSums(NamedTuple):
    """Sums of a totaliser, from which a later totaliser continues."""

    worked_s: float = 0.0
    area_ha: float = 0.0
    kg: float = 0.0
    kg2_ha: float = 0.0
    known_kg: float = 0.0
    target_kg: float = 0.0
    # Rate bin, area, ha, and mass, kg.
    bins: tuple[tuple[int, float, float], ...] = ()
    # Mass released despite a stop command, kg.
    stopped_kg: float = 0.0
    # Nitrogen in all products, kg; None means that of the present product.
    n_kg: float | None = None


NO_SUMS = TotalSums()


class MaterialArrival:
    """Tells whether material has arrived since work began, or none is wanted; no ground counts
    until then.

    At the start of a pass the drives need their dead time before material leaves, and at its end
    the last material leaves that much later. If both distances counted, each pass would be too
    long.
    """

    def __init__(self) -> None:
        self._here = False

    def stop_work(self) -> None:
        """End the work."""
        self._here = False

    def note_arrival(self, applied_rate_kg_ha: float, target_rate_kg_ha: float | None) -> bool:
        """Tell whether a tick of work adds ground; with a target of 0 or none it does, although
        nothing is applied."""
        wanted = 0.0 if target_rate_kg_ha is None else target_rate_kg_ha
        self._here = self._here or applied_rate_kg_ha >= ARRIVED_RATE_OF_TARGET * wanted
        return self._here


class Totaliser:
    """Sums a run, with one call a tick. width_m: working width; product_n_fraction: N in the
    product, 0 to 1. before: sums from which to continue.

    Raises ValueError for a width that is not above 0 or a fraction outside 0 to 1.
    """

    def __init__(
        self, width_m: float, product_n_fraction: float, before: TotalSums = NO_SUMS
    ) -> None:
        if not width_m > 0.0:
            raise ValueError(f"width {width_m:g} m: allowed is above 0")
        if not 0.0 <= product_n_fraction <= 1.0:
            raise ValueError(f"product_n_fraction {product_n_fraction:g}: allowed is 0 to 1")
        self._arrival = MaterialArrival()
        self._width_m = width_m
        self._n_fraction = product_n_fraction
        (
            self._worked_s,
            self._area_ha,
            self._kg,
            self._kg2_ha,
            self._known_kg,
            self._target_kg,
            bins,
            self._stopped_kg,
            n_kg,
        ) = before
        self._other_n_kg = 0.0 if n_kg is None else n_kg - self.applied_kg * product_n_fraction
        # Maps a rate bin to area, ha, and mass, kg.
        self._bins = {key: (ha, kg) for key, ha, kg in bins}

    @property
    def running_sums(self) -> TotalSums:
        """Return the present sums, from which a later totaliser continues."""
        return TotalSums(
            self._worked_s,
            self._area_ha,
            self._kg,
            self._kg2_ha,
            self._known_kg,
            self._target_kg,
            tuple((key, ha, kg) for key, (ha, kg) in self._bins.items()),
            self._stopped_kg,
            self.applied_n_kg,
        )

    def add_tick(
        self,
        step_s: float,
        speed_mps: float | None,
        applied_rate_kg_ha: float | None,
        target_rate_kg_ha: float | None = None,
        open_share: float = 1.0,
    ) -> bool:
        """Add one tick of work, and tell whether it was counted.

        The method is called only while working (state working, speed above the minimum, flow wanted
        or not), and `stop_work` otherwise. step_s: time since the last tick, s. open_share: open
        share of the working width; the rates apply to that width. Values that are unknown, not
        finite or negative add nothing, nor does distance before the material has arrived
        (`MaterialArrival`).
        """
        if speed_mps is None or applied_rate_kg_ha is None:
            return False
        area_ha = open_share * self._width_m * speed_mps * step_s / 10_000.0
        if not (0.0 < area_ha < math.inf and 0.0 <= applied_rate_kg_ha < math.inf):
            return False
        if not self._arrival.note_arrival(applied_rate_kg_ha, target_rate_kg_ha):
            return False
        kg = applied_rate_kg_ha * area_ha
        self._worked_s += step_s
        self._area_ha += area_ha
        self._kg += kg
        self._kg2_ha += kg * applied_rate_kg_ha
        key = int(applied_rate_kg_ha / _BIN_KG_HA)
        ha, in_bin = self._bins.get(key, (0.0, 0.0))
        self._bins[key] = (ha + area_ha, in_bin + kg)
        if target_rate_kg_ha is not None and 0.0 <= target_rate_kg_ha < math.inf:
            self._known_kg += kg
            self._target_kg += target_rate_kg_ha * area_ha
        return True

    def stop_work(self) -> None:
        """Record a tick without work."""
        self._arrival.stop_work()

    def add_stopped(self, kg: float) -> None:
        """Add mass that left the machine despite a stop command, kg, which belongs to no area
        and no mean rate. A value that is negative or not finite adds nothing."""
        if 0.0 < kg < math.inf:
            self._stopped_kg += kg

    @property
    def area_ha(self) -> float:
        return self._area_ha

    @property
    def applied_kg(self) -> float:
        """Return the mass that left the machine, kg, including mass released despite a stop
        command."""
        return self._kg + self._stopped_kg

    @property
    def applied_n_kg(self) -> float:
        """Return the applied nitrogen, kg. `_other_n_kg`: additional nitrogen of the products of
        earlier parts."""
        return max(0.0, self.applied_kg * self._n_fraction + self._other_n_kg)

    def make_totals(self) -> Totals:
        """Return the present totals; the call is fast enough for a few times a second."""
        mean = self._kg / self._area_ha if self._area_ha > 0.0 else None
        cv = cuc = None
        if mean is not None and mean > 0.0:
            variance = max(0.0, self._kg2_ha / self._area_ha - mean * mean)
            cv = 100.0 * math.sqrt(variance) / mean
            away_kg = sum(abs(kg - mean * ha) for ha, kg in self._bins.values())
            cuc = 100.0 * (1.0 - away_kg / self._kg)
        error = 100.0 * (self._known_kg / self._target_kg - 1.0) if self._target_kg > 0.0 else None
        return Totals(
            self._area_ha,
            self.applied_kg,
            self.applied_n_kg,
            self._target_kg,
            self._worked_s,
            mean,
            cv,
            cuc,
            error,
            stopped_kg=self._stopped_kg,
        )
