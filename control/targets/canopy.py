"""Canopy mode: fused NDVI under the heads, collected for a decision period, becomes a stretch of decided rate."""
from __future__ import annotations

from control.agronomy.noa import Rule
from control.agronomy.strips import StripValue
from control.orders import TargetSource

from .hold_mean import HoldMean
from .profile import Stretches

STRAIGHT_DEG_S = 8.0            # turning faster, the outlets do not follow the heads: samples are left out
SILENT_HOLDS_S = 2.0            # heads silent: the last decision holds this long


class CanopyDecisions:
    """Turns samples into decisions at `decision_hz` and keeps them along the track (decision paper, section 1.2)."""

    def __init__(self, rule: Rule, heads_m: float, decision_hz: float, stretches: Stretches,
                 hold: HoldMean | None = None) -> None:
        """hold: the field's mean is held; None: the rule's rate as it is."""
        self.rule = rule
        self.hold = hold
        self.stretches = stretches
        self.period_s = 1.0 / decision_hz
        self.ndvi: float | None = None              # of the last decision
        self.rate_kg_ha: float | None = None
        self.zone_factor = 1.0                      # of the rule, where the heads look
        self._heads_m = heads_m
        self._samples: list[float] = []
        self._from_m: float | None = None
        self._started_s = 0.0
        self._sampled_s: float | None = None
        self._source = TargetSource.CANOPY          # of the newest sample

    def take_strip(self, strip: StripValue) -> None:
        """A strip was measured: later decisions go by it."""
        self.rule = self.rule.with_strip(strip)

    def pause(self) -> None:
        """Backing up: the heads see again what is decided already."""
        self._samples.clear()
        self._from_m = None

    def sample(self, ndvi: float | None, track_m: float, now_s: float, turn_deg_s: float,
               source: TargetSource = TargetSource.CANOPY) -> None:
        """One fused reading (None: none valid), with the outlets at `track_m`. source: INDEX_MAP where it is the map's
        in the place of the heads'."""
        if abs(turn_deg_s) > STRAIGHT_DEG_S:
            self.pause()
            self.stretches.forget()
            return
        if ndvi is None:
            return
        if self._from_m is None:
            self._from_m, self._started_s = track_m + self._heads_m, now_s
        if source is not self._source:
            self._samples.clear()                   # one period speaks of one of them
            self._source = source
        self._samples.append(ndvi)
        self._sampled_s = now_s

    def decide(self, track_m: float, now_s: float) -> bool:
        """Once a decision period has passed: a new stretch. True when the decision was made in this tick."""
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
        """Decided for the next `way_m` by the newest NDVI; None as long as the rule waits for its strips."""
        if not self.rule.is_ready:
            return None
        rate = self.rule.decide(self.ndvi, self.zone_factor).rate_kg_ha
        return rate if self.hold is None else min(self.rule.crop.max_rate_kg_ha, self.hold.decided(rate, way_m))
