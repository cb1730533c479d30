"""Ground that has its material already: after backing up, nothing falls there a second time."""
from __future__ import annotations

from control.orders import TargetSource

from .profile import Change, Profile, Target


class Unspread:
    """A profile that is nothing up to `spread_to_m`, the place up to which material has landed."""

    def __init__(self, inner: Profile, spread_to_m: float, source: TargetSource) -> None:
        self._inner = inner
        self._to_m = spread_to_m
        self._nothing = Target(0.0, source)

    def at(self, place_m: float) -> Target:
        return self._inner.at(place_m) if place_m >= self._to_m else self._nothing

    def next_change(self, after_m: float, before_m: float, holding: Target) -> Change | None:
        if after_m >= self._to_m:
            return self._inner.next_change(after_m, before_m, holding)
        if holding.rate_kg_ha > 0.0:
            return Change(after_m, self._nothing)
        return self._inner.next_change(self._to_m, before_m, holding) if before_m >= self._to_m else None
