"""What a job amounts to so far: area, product, nitrogen, and how even the rate was over the
worked area."""

from __future__ import annotations

import math
from typing import NamedTuple

# of the target; a standing shaft reads up to 1 r/min, some 1 % of it
ARRIVED_SHARE = 0.1
# of the rate histogram behind C_uc; its error is below this over the mean rate
_BIN_KG_HA = 0.25


class Totals(NamedTuple):
    """Frozen. Rates are means over worked area; None before any was worked."""

    # worked: open width x way while material left, overlaps included
    area_ha: float
    applied_kg: float
    applied_n_kg: float
    target_kg: float  # of the area whose target was known
    worked_s: float
    mean_rate_kg_ha: float | None
    cv_percent: float | None  # area-weighted standard deviation over the mean
    # Christiansen's uniformity, paper A, eq 1, weighted by area
    cuc_percent: float | None
    # applied over target - 1, on the area whose target was known
    error_percent: float | None
    covered_ha: float | None = None  # each place once, earlier parts of the job too
    # passed over again, every time; since the console's start
    overlap_ha: float | None = None
    metres_left_m: float | None = None  # with what the hopper holds, at the present rate
    doses: int | None = None  # of point mode
    doses_missed: int | None = None
    # of applied_kg: released while commanded to stop, on no area
    stopped_kg: float = 0.0


class TotalSums(NamedTuple):
    """All that a totaliser has added up: what a later one needs to go on where it stopped."""

    worked_s: float = 0.0
    area_ha: float = 0.0
    kg: float = 0.0
    kg2_ha: float = 0.0
    known_kg: float = 0.0
    target_kg: float = 0.0
    bins: tuple[tuple[int, float, float], ...] = ()  # rate bin, ha, kg
    stopped_kg: float = 0.0  # released while commanded to stop
    # nitrogen in all of it, whatever the products; None: of the product at hand
    n_kg: float | None = None


NO_SUMS = TotalSums()


class MaterialArrival:
    """Has material come since work began, or is none wanted? Until then no ground gets any: at
    a pass's begin the drives take their dead time before anything leaves, and the last of the
    pass runs out as much later. Way in which nothing leaves yet, counted along with the way in
    which the last runs out, makes each pass longer than it is."""

    def __init__(self) -> None:
        self._here = False

    def stop_work(self) -> None:
        """No work goes on."""
        self._here = False

    def note_arrival(self, applied_rate_kg_ha: float, target_rate_kg_ha: float | None) -> bool:
        """Whether a tick of work adds ground; a target of 0, or none, does with nothing applied."""
        wanted = 0.0 if target_rate_kg_ha is None else target_rate_kg_ha
        self._here = self._here or applied_rate_kg_ha >= ARRIVED_SHARE * wanted
        return self._here


class Totaliser:
    """Fed once a tick. width_m: working width; product_n_fraction: N in the product, 0 to 1.
    before: to go on from.

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
        self._bins = {key: (ha, kg) for key, ha, kg in bins}  # rate bin -> (ha, kg)

    @property
    def running_sums(self) -> TotalSums:
        """What was added up so far, to go on from later."""
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
        """One tick of work. Call it only where work is done (working, speed above the lowest,
        flow wanted or not), and `rest` where none is. True: it was counted.

        step_s: time since the last tick, s. open_share: of the working width; the rates are
        those under it. What is not known, not finite or negative adds nothing, nor does way
        before material has come (`MaterialArrival`).
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
        """No work goes on in this tick."""
        self._arrival.stop_work()

    def add_stopped(self, kg: float) -> None:
        """What left the machine while it was commanded to stop: mass that no area and no mean
        rate answer for. Not finite or negative adds nothing."""
        if 0.0 < kg < math.inf:
            self._stopped_kg += kg

    @property
    def area_ha(self) -> float:
        return self._area_ha

    @property
    def applied_kg(self) -> float:
        """All that left the machine, what was released while commanded to stop included."""
        return self._kg + self._stopped_kg

    @property
    def applied_n_kg(self) -> float:
        """Nitrogen in it. `_other_n_kg`: what products of earlier parts had more of it than
        this one."""
        return max(0.0, self.applied_kg * self._n_fraction + self._other_n_kg)

    def make_totals(self) -> Totals:
        """The totals so far; cheap enough for a few times a second."""
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
