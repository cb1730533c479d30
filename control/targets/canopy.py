"""Canopy mode: fused NDVI under the heads, collected for a decision period, becomes a stretch
of decided rate."""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.agronomy.noa import Rule
from topdress.control.agronomy.strips import StripValue
from topdress.control.orders import TargetSource

from .profile import Profile, Stretches, Target, TargetChange

# H: long against the metres of heads' lead and lag, short against a field
HORIZON_M = 200.0
MOST_OWED = 0.5  # of R over H
LEAST_FACTOR, MOST_FACTOR = 0.2, 5.0


class HoldMean:
    """Canopy mode with the field's mean held at a given rate: the canopy says where, the farmer
    how much in all.

    A decided rate is multiplied by k = (R + owed / H) / m: R the mean to be held, m the running
    mean of what the rule decided so far where it decided anything, and `owed` what the ground
    worked so far still lacks (kg/ha x m of way), to be given over the next H metres. The first
    part alone keeps a mean only of ground like that before; the second closes the loop over
    what really landed.

    It cannot run away: `owed` is cut to half of R over H, so that the mean of what follows is
    at most half as much again, or half as much; k is cut to 0.2 to 5; the crop's limit holds
    above all. Ground on which the rule gives nothing gets nothing, and what it lacks beyond
    that cut is not made up elsewhere: a bare half of a field is no reason to burn the other.

    One per run. `on`: the canopy decides alone; `learns`: the machine is at work.
    """

    def __init__(self, mean_kg_ha: float) -> None:
        self.mean_kg_ha = mean_kg_ha
        self.on = True
        self.learns = False
        # decided so far, above nothing: way, and its rates times way
        self._way_m = self._rule = 0.0
        self._owed = 0.0  # kg/ha x m

    @property
    def owed_kg_ha(self) -> float:
        """What the coming `HORIZON_M` get beyond the mean, kg/ha; negative: less."""
        return self._owed / HORIZON_M

    def decided(self, rule_kg_ha: float, way_m: float) -> float:
        """What is to be given where the rule decides `rule_kg_ha` for the next `way_m`."""
        if not self.on or rule_kg_ha <= 0.0:
            return rule_kg_ha
        if self.learns and way_m > 0.0:
            self._way_m += way_m
            self._rule += rule_kg_ha * way_m
        mean = self._rule / self._way_m if self._way_m > 0.0 else rule_kg_ha
        # rates so small that a float loses them on the way
        if mean <= 0.0:
            return rule_kg_ha
        factor = (self.mean_kg_ha + self.owed_kg_ha) / mean
        return rule_kg_ha * min(MOST_FACTOR, max(LEAST_FACTOR, factor))

    def landed(self, rate_kg_ha: float, way_m: float) -> None:
        """Over `way_m` of worked ground this much was given, without the operator's nudge."""
        if not self.on:
            return
        most = MOST_OWED * self.mean_kg_ha * HORIZON_M
        self._owed = min(most, max(-most, self._owed + (self.mean_kg_ha - rate_kg_ha) * way_m))

    def go_on(self, area_m: float, given_kg_ha: float) -> None:
        """With a job that was cut off: so many metres of way had this mean."""
        self.landed(given_kg_ha, area_m)


# turning faster, the outlets do not follow the heads: samples are left out
STRAIGHT_DEG_S = 8.0
SILENT_HOLDS_S = 2.0  # heads silent: the last decision holds this long


class CanopyDecisions:
    """Turns samples into decisions at `decision_hz` and keeps them along the track (decision
    paper, section 1.2)."""

    def __init__(
        self,
        rule: Rule,
        heads_m: float,
        decision_hz: float,
        stretches: Stretches,
        hold: HoldMean | None = None,
    ) -> None:
        """hold: the field's mean is held; None: the rule's rate as it is."""
        self.rule = rule
        self.hold = hold
        self.stretches = stretches
        self.period_s = 1.0 / decision_hz
        self.ndvi: float | None = None  # of the last decision
        self.rate_kg_ha: float | None = None
        self.zone_factor = 1.0  # of the rule, where the heads look
        self._heads_m = heads_m
        self._samples: list[float] = []
        self._from_m: float | None = None
        self._started_s = 0.0
        self._sampled_s: float | None = None
        self._source = TargetSource.CANOPY  # of the newest sample

    def take_strip(self, strip: StripValue) -> None:
        """A strip was measured: later decisions go by it."""
        self.rule = self.rule.with_strip(strip)

    def pause(self) -> None:
        """Backing up: the heads see again what is decided already."""
        self._samples.clear()
        self._from_m = None

    def sample(
        self,
        ndvi: float | None,
        track_m: float,
        now_s: float,
        turn_deg_s: float,
        source: TargetSource = TargetSource.CANOPY,
    ) -> None:
        """One fused reading (None: none valid), with the outlets at `track_m`. source:
        INDEX_MAP where it is the map's in the place of the heads'."""
        if abs(turn_deg_s) > STRAIGHT_DEG_S:
            self.pause()
            self.stretches.forget()
            return
        if ndvi is None:
            return
        if self._from_m is None:
            self._from_m, self._started_s = track_m + self._heads_m, now_s
        if source is not self._source:
            self._samples.clear()  # one period speaks of one of them
            self._source = source
        self._samples.append(ndvi)
        self._sampled_s = now_s

    def decide(self, track_m: float, now_s: float) -> bool:
        """Once a decision period has passed: a new stretch. True when the decision was made in
        this tick."""
        if self._from_m is None or now_s - self._started_s < self.period_s - 1e-6:
            return False
        here = track_m + self._heads_m
        if self._samples:
            self.ndvi = sum(self._samples) / len(self._samples)
            self.rate_kg_ha = self._rate(here - self._from_m)
        elif self._sampled_s is None or now_s - self._sampled_s > SILENT_HOLDS_S:
            self._from_m = None
            return False
        if here > self._from_m and self.rate_kg_ha is not None:
            self.stretches.append(self._from_m, here, self.rate_kg_ha, self._source)
            self._from_m = here
        self._samples.clear()
        self._started_s = now_s
        return True

    def _rate(self, way_m: float) -> float | None:
        """Decided for the next `way_m` by the newest NDVI; None as long as the rule waits for
        its strips."""
        if not self.rule.is_ready:
            return None
        rate = self.rule.decide(self.ndvi, self.zone_factor).rate_kg_ha
        return (
            rate
            if self.hold is None
            else min(self.rule.crop.max_rate_kg_ha, self.hold.decided(rate, way_m))
        )


class Around(NamedTuple):
    """How far the heads may move from the map's rate: kg/ha where given, else a share of it."""

    percent: float = 20.0
    kg_ha: float | None = None

    def held(self, base_kg_ha: float, wanted_kg_ha: float) -> float:
        most = self.kg_ha if self.kg_ha is not None else base_kg_ha * self.percent / 100.0
        return max(0.0, min(base_kg_ha + most, max(base_kg_ha - most, wanted_kg_ha)))


class MapAndCanopy:
    """Map and sensor together: the map's rate is the base, the heads' rate is followed within
    limits around it.

    The map knows what the place can yield, the heads what the crop lacks today (map overlay,
    Auernhammer 2001, Comput. Electron. Agric. 30:31-43). Where the map has a rate and the heads
    have decided, the heads' rate holds, at most so far from the map's. Without a reading the
    map alone holds; outside the map, and where it says zero, the heads change nothing. Each
    keeps its own lead: the map is seen as far as it reaches, the heads' decisions as far as
    they look ahead.

    A profile made of two. `base`: the map; `canopy`: decisions of the heads, fallback where
    there are none.
    """

    def __init__(self, base: Profile, canopy: Profile, around: Around) -> None:
        self._base, self._canopy, self._around = base, canopy, around

    def at(self, place_m: float) -> Target:
        base = self._base.at(place_m)
        if base.source is not TargetSource.MAP or base.rate_kg_ha <= 0.0:
            return base
        seen = self._canopy.at(place_m)
        if seen.source is not TargetSource.CANOPY:
            return base
        return Target(
            self._around.held(base.rate_kg_ha, seen.rate_kg_ha), TargetSource.MAP_AND_CANOPY
        )

    def next_change(self, after_m: float, before_m: float, holding: Target) -> TargetChange | None:
        """The first place at which either of the two changes and what they come to differs from
        what is held."""
        place: float | None = after_m
        while place is not None and place <= before_m:
            target = self.at(place)
            if target != holding:
                return TargetChange(place, target)
            place = self._next_edge(place, before_m)
        return None

    def _next_edge(self, after_m: float, before_m: float) -> float | None:
        changes = [
            one.next_change(after_m, before_m, one.at(after_m))
            for one in (self._base, self._canopy)
        ]
        places = [
            change.place_m for change in changes if change is not None and change.place_m > after_m
        ]
        return min(places, default=None)
