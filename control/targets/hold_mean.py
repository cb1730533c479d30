"""Canopy mode with the field's mean held at a given rate: the canopy says where, the farmer how much in all.

A decided rate is multiplied by k = (R + owed / H) / m: R the mean to be held, m the running mean of what the rule
decided so far where it decided anything, and `owed` what the ground worked so far still lacks (kg/ha x m of way), to be
given over the next H metres. The first part alone keeps a mean only of ground like that before; the second closes the
loop over what really landed.

It cannot run away: `owed` is cut to half of R over H, so that the mean of what follows is at most half as much again,
or half as much; k is cut to 0.2 to 5; the crop's limit holds above all. Ground on which the rule gives nothing gets
nothing, and what it lacks beyond that cut is not made up elsewhere: a bare half of a field is no reason to burn the
other.
"""
from __future__ import annotations

HORIZON_M = 200.0           # H: long against the metres of heads' lead and lag, short against a field
MOST_OWED = 0.5             # of R over H
LEAST_FACTOR, MOST_FACTOR = 0.2, 5.0


class HoldMean:
    """One per run. `on`: the canopy decides alone; `learns`: the machine is at work."""

    def __init__(self, mean_kg_ha: float) -> None:
        self.mean_kg_ha = mean_kg_ha
        self.on = True
        self.learns = False
        self._way_m = self._rule = 0.0      # decided so far, above nothing: way, and its rates times way
        self._owed = 0.0                    # kg/ha x m

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
        if mean <= 0.0:                     # rates so small that a float loses them on the way
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
