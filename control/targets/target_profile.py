"""Which target holds at a place of the track, and where does it change next?"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from typing import NamedTuple, Protocol

from topdress.control.orders import TargetSource


class Target(NamedTuple):
    """Holds a rate and its source."""

    rate_kg_ha: float
    source: TargetSource


class TargetChange(NamedTuple):
    """Holds a change: at `place_m` along the track the target becomes `target`."""

    place_m: float
    target: Target


class TargetProfile(Protocol):
    """Defines what every source of targets answers. Places are metres along the track of the
    outlets."""

    def find_target(self, place_m: float) -> Target: ...

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        """Returns the first place in (after_m, before_m] at which the target differs from
        `holding`."""
        ...


class ConstantProfile:
    """Gives one target wherever the machine goes: a manual rate, or the fallback rate by the
    operator's choice."""

    def __init__(self, target: Target) -> None:
        self.target = target

    def find_target(self, place_m: float) -> Target:
        return self.target

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        # A constant target changes at once or never.
        return TargetChange(after_m, self.target) if holding != self.target else None


class DecidedStretches:
    """Holds decided rates for stretches of the track, appended in order; where none is within
    reach the fallback holds."""

    # Stretches farther back than this are dropped, m.
    # The machine never asks for ground so far behind it.
    WAY_KEPT_M = 60.0

    def __init__(
        self, fallback_rate_kg_ha: float, reach_m: float = 1.5, first_reach_m: float | None = None
    ) -> None:
        """Starts without stretches. first_reach_m: how far the first one reaches back, as far as
        the heads look ahead: behind a turn they have read by then, and the nearest ground that
        they saw is better evidence than the crop file's single rate. None: as far as all others."""
        self.fallback = Target(fallback_rate_kg_ha, TargetSource.FALLBACK)
        self.reach_m = reach_m
        self._first_reach_m = reach_m if first_reach_m is None else first_reach_m
        self._from: list[float] = []
        self._to: list[float] = []
        self._target: list[Target] = []

    def append_stretch(
        self,
        from_m: float,
        to_m: float,
        rate_kg_ha: float,
        source: TargetSource = TargetSource.CANOPY,
    ) -> None:
        """Appends a decision for [from_m, to_m). It replaces the overlapping part of an earlier
        one."""
        # A newer decision has seen the ground more recently and replaces the older one.
        while self._from and self._from[-1] >= from_m:
            self._from.pop()
            self._to.pop()
            self._target.pop()
        if self._to and self._to[-1] > from_m:
            self._to[-1] = from_m
        self._from.append(from_m)
        self._to.append(to_m)
        self._target.append(Target(rate_kg_ha, source))
        # One stretch is removed for each that is added, so the list stays short.
        if self._to[0] < from_m - self.WAY_KEPT_M:
            del self._from[0], self._to[0], self._target[0]

    def forget_stretches(self) -> None:
        self._from.clear()
        self._to.clear()
        self._target.clear()

    def find_target(self, place_m: float) -> Target:
        """Returns the decided target there, or that of the nearest stretch within reach, or the
        fallback."""
        if not self._from:
            return self.fallback
        # The lists are sorted by place, so bisection finds the stretch.
        k = bisect_right(self._from, place_m) - 1
        if k >= 0 and place_m < self._to[k]:
            return self._target[k]
        behind = place_m - self._to[k] if k >= 0 else float("inf")
        ahead = self._from[k + 1] - place_m if k + 1 < len(self._from) else float("inf")
        if behind >= self.reach_m and ahead > (self.reach_m if k >= 0 else self._first_reach_m):
            return self.fallback
        # Between two stretches the nearer one counts.
        return self._target[k] if behind < ahead else self._target[k + 1]

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        for place in self._iterate_edges(after_m):
            if place > before_m:
                break
            target = self.find_target(place)
            if target != holding:
                return TargetChange(place, target)
        return None

    def _iterate_edges(self, after_m: float) -> Iterator[float]:
        """Yields every place from `after_m` on where the target may change, rising, `after_m`
        itself first."""
        # The place itself comes first, since the target may differ from the held one already.
        yield after_m
        k = max(0, bisect_right(self._from, after_m) - 1)
        if self._from and self._from[0] - self._first_reach_m > after_m:
            yield self._from[0] - self._first_reach_m
        for j in range(k, len(self._from)):
            following = self._from[j + 1] if j + 1 < len(self._from) else float("inf")
            gap, behind_m = following - self._to[j], self._to[j] + self.reach_m
            places = (
                (behind_m, following - self.reach_m)
                # In a gap that is wider than both reaches the fallback holds; else the middle is
                # the edge.
                if gap > 2.0 * self.reach_m
                else ((self._to[j] + 0.5 * gap,) if gap > 0.0 else ())
            )
            for place in (self._from[j], *places):
                if place > after_m:
                    yield place


class UnspreadProfile:
    """Gives nothing up to `spread_to_m`, the place up to which material has landed, and the
    inner profile beyond it."""

    def __init__(self, inner: TargetProfile, spread_to_m: float, source: TargetSource) -> None:
        self._inner = inner
        self._to_m = spread_to_m
        self._nothing = Target(0.0, source)

    def find_target(self, place_m: float) -> Target:
        return self._inner.find_target(place_m) if place_m >= self._to_m else self._nothing

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        if after_m >= self._to_m:
            return self._inner.find_next_change(after_m, before_m, holding)
        # Flow must stop at once on ground that already has material.
        if holding.rate_kg_ha > 0.0:
            return TargetChange(after_m, self._nothing)
        return (
            self._inner.find_next_change(self._to_m, before_m, holding)
            if before_m >= self._to_m
            else None
        )
