"""Which rate does the canopy ask for along the track? Fused NDVI under the heads, collected over
a decision period, becomes a stretch of decided rate."""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.agronomy.reference_strips import StripMean
from topdress.control.orders import TargetSource

from .target_profile import DecidedStretches, Target, TargetChange, TargetProfile

# H, the way over which a deficit is made up, m: long against the lead and lag of the heads, short
# against a field.
HOLD_HORIZON_M = 200.0
# Greatest deficit, as a share of R over H.
MAX_DEFICIT_SHARE = 0.5
# Limits of the factor k.
MIN_FACTOR, MAX_FACTOR = 0.2, 5.0


class MeanRateHold:
    """Scales the canopy's rates so that the field's mean is a given rate: the canopy decides
    where, the farmer how much in all.

    A decided rate is multiplied by k = (R + owed / H) / m: R is the mean to hold, m the running
    mean of the rule's rates so far where they were above 0, and `owed` the deficit of the ground
    worked so far (kg/ha x m of way), which is made up over the next H metres. The first term
    alone holds the mean only while the ground resembles that before; the second closes the loop
    over the rate that really landed.

    It cannot run away: `owed` is limited to half of R over H, so that the mean of what follows
    changes by at most one half; k is limited to 0.2 to 5; the crop's limit has priority. Ground
    on which the rule gives nothing gets nothing, and its deficit beyond that limit is not made
    up elsewhere: a bare half of a field is no reason to overdose the other.

    There is one in a run. `on`: the canopy decides alone; `is_learning`: the machine is at work."""

    def __init__(self, mean_kg_ha: float) -> None:
        self.mean_kg_ha = mean_kg_ha
        self.is_active = True
        self.is_learning = False
        # Way with a decided rate above 0, m, and the sum of rate times way.
        self._way_m = self._rule = 0.0
        # The deficit, kg/ha x m.
        self._owed = 0.0

    @property
    def owed_kg_ha(self) -> float:
        """Returns how much more than the mean the coming `HOLD_HORIZON_M` get, kg/ha; negative:
        less."""
        return self._owed / HOLD_HORIZON_M

    def scale_decision(self, rule_kg_ha: float, way_m: float) -> float:
        """Returns the rate to give where the rule decides `rule_kg_ha` for the next `way_m`."""
        if not self.is_active or rule_kg_ha <= 0.0:
            return rule_kg_ha
        if self.is_learning and way_m > 0.0:
            self._way_m += way_m
            self._rule += rule_kg_ha * way_m
        mean = self._rule / self._way_m if self._way_m > 0.0 else rule_kg_ha
        # The sum of very small rates may be lost in rounding.
        if mean <= 0.0:
            return rule_kg_ha
        factor = (self.mean_kg_ha + self.owed_kg_ha) / mean
        return rule_kg_ha * min(MAX_FACTOR, max(MIN_FACTOR, factor))

    def record_landed(self, rate_kg_ha: float, way_m: float) -> None:
        """Adds worked ground: over `way_m` this rate landed, without the operator's nudge."""
        if not self.is_active:
            return
        most = MAX_DEFICIT_SHARE * self.mean_kg_ha * HOLD_HORIZON_M
        self._owed = min(most, max(-most, self._owed + (self.mean_kg_ha - rate_kg_ha) * way_m))

    def resume_job(self, area_m: float, given_kg_ha: float) -> None:
        """Resumes a job that was cut off: so many metres of way had this mean."""
        self.record_landed(given_kg_ha, area_m)


# When turning faster, degrees/s, the outlets do not follow the heads, and samples are left out.
STRAIGHT_BELOW_DEG_S = 8.0
# While the heads are silent the last decision is kept for this long, s.
DECISION_HOLD_S = 2.0


class CanopyDecisions:
    """Turns samples into decisions at `decision_hz` and keeps them along the track (decision
    paper, section 1.2)."""

    def __init__(
        self,
        rule: CropRule,
        heads_m: float,
        decision_hz: float,
        stretches: DecidedStretches,
        hold: MeanRateHold | None = None,
    ) -> None:
        """Starts without decisions. hold: holds the field's mean; None: the rule's rate is used
        as it is."""
        self.rule = rule
        self.hold = hold
        self.stretches = stretches
        self.period_s = 1.0 / decision_hz
        # NDVI of the last decision.
        self.ndvi: float | None = None
        self.rate_kg_ha: float | None = None
        # Factor on the rule in the zone that the heads look at.
        self.zone_factor = 1.0
        self._heads_m = heads_m
        self._samples: list[float] = []
        self._from_m: float | None = None
        self._started_s = 0.0
        self._sampled_s: float | None = None
        # Source of the newest sample.
        self._source = TargetSource.CANOPY

    def replace_strip(self, strip: StripMean) -> None:
        """Takes a newly measured strip; later decisions use it."""
        self.rule = self.rule.replace_strip(strip)

    def pause_sampling(self) -> None:
        """Drops the samples while reversing: the heads see ground again that is already decided."""
        self._samples.clear()
        self._from_m = None

    def take_sample(
        self,
        ndvi: float | None,
        track_m: float,
        now_s: float,
        turn_deg_s: float,
        source: TargetSource = TargetSource.CANOPY,
    ) -> None:
        """Takes one fused reading (None: no valid head), with the outlets at `track_m`. source:
        INDEX_MAP where the map replaces the heads."""
        if abs(turn_deg_s) > STRAIGHT_BELOW_DEG_S:
            self.pause_sampling()
            self.stretches.forget_stretches()
            return
        if ndvi is None:
            return
        if self._from_m is None:
            self._from_m, self._started_s = track_m + self._heads_m, now_s
        if source is not self._source:
            # The samples of a period have a single source.
            self._samples.clear()
            self._source = source
        self._samples.append(ndvi)
        self._sampled_s = now_s

    def decide_stretch(self, track_m: float, now_s: float) -> bool:
        """Decides a new stretch once a decision period has passed; True when that happened in
        this tick."""
        if self._from_m is None or now_s - self._started_s < self.period_s - 1e-6:
            return False
        here = track_m + self._heads_m
        if self._samples:
            self.ndvi = sum(self._samples) / len(self._samples)
            self.rate_kg_ha = self._decide_rate(here - self._from_m)
        elif self._sampled_s is None or now_s - self._sampled_s > DECISION_HOLD_S:
            self._from_m = None
            return False
        if here > self._from_m and self.rate_kg_ha is not None:
            self.stretches.append_stretch(self._from_m, here, self.rate_kg_ha, self._source)
            self._from_m = here
        self._samples.clear()
        self._started_s = now_s
        return True

    def _decide_rate(self, way_m: float) -> float | None:
        """Returns the rate for the next `way_m` by the newest NDVI; None while the rule waits
        for its strips."""
        if not self.rule.is_ready:
            return None
        rate = self.rule.decide_rate(self.ndvi, self.zone_factor).rate_kg_ha
        return (
            rate
            if self.hold is None
            else min(self.rule.crop.max_rate_kg_ha, self.hold.scale_decision(rate, way_m))
        )


class RateBounds(NamedTuple):
    """Limits how far the heads may move from the map's rate: kg/ha where given, else a share of
    it."""

    percent: float = 20.0
    kg_ha: float | None = None

    def limit_rate(self, base_kg_ha: float, wanted_kg_ha: float) -> float:
        most = self.kg_ha if self.kg_ha is not None else base_kg_ha * self.percent / 100.0
        return max(0.0, min(base_kg_ha + most, max(base_kg_ha - most, wanted_kg_ha)))


class MapAndCanopy:
    """Combines map and heads: the map's rate is the base, and the heads' rate is followed within
    limits around it.

    The map knows the yield of a place, the heads the present need of the crop (map overlay,
    Auernhammer 2001, Comput. Electron. Agric. 30:31-43). Where the map has a rate and the heads
    have decided, the heads' rate is used within the limits. Without a reading the map's rate is
    used; outside the map, and where its rate is zero, the heads change nothing. Each keeps its
    own lead: the map is seen as far as it reaches, decisions as far as the heads look ahead.

    `base`: profile of the map; `canopy`: profile of the heads' decisions, with fallbacks."""

    def __init__(self, base: TargetProfile, canopy: TargetProfile, around: RateBounds) -> None:
        self._base, self._canopy, self._around = base, canopy, around

    def find_target(self, place_m: float) -> Target:
        base = self._base.find_target(place_m)
        if base.source is not TargetSource.MAP or base.rate_kg_ha <= 0.0:
            return base
        seen = self._canopy.find_target(place_m)
        if seen.source is not TargetSource.CANOPY:
            return base
        return Target(
            self._around.limit_rate(base.rate_kg_ha, seen.rate_kg_ha), TargetSource.MAP_AND_CANOPY
        )

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        """Returns the first place at which either profile changes and the combined target
        differs from the one in force."""
        place: float | None = after_m
        while place is not None and place <= before_m:
            target = self.find_target(place)
            if target != holding:
                return TargetChange(place, target)
            place = self._find_next_edge(place, before_m)
        return None

    def _find_next_edge(self, after_m: float, before_m: float) -> float | None:
        changes = [
            one.find_next_change(after_m, before_m, one.find_target(after_m))
            for one in (self._base, self._canopy)
        ]
        places = [
            change.place_m for change in changes if change is not None and change.place_m > after_m
        ]
        return min(places, default=None)
