"""The canopy heads in the loop: their newest readings fused, and decided upon."""
from __future__ import annotations

from control.agronomy import fusion
from control.readings import Measurements
from control.sensing import Sensed
from control.targets.canopy import CanopyDecisions

LATENCY_S = 0.5                 # a head's reading may be one period old


class CanopyHeads:
    """`fused`: newest; None before the first look."""

    def __init__(self, heads: int, decisions: CanopyDecisions, index: str = "ndvi") -> None:
        """index: of the crop's rule; readings of another one are as none."""
        self._index = index
        self.decisions = decisions
        self.fused: fusion.Fused | None = None
        self._state = fusion.start(heads)
        self._times: tuple[float | None, ...] = ()
        self._fused_s = float("-inf")

    def look(self, m: Measurements, sensed: Sensed) -> None:
        """Fuse what is new, or has grown old; decide when a period has passed."""
        if m.canopy_index != self._index:
            m = m._replace(ndvi=(None,) * len(m.ndvi))
        now = m.time_s
        times = tuple(None if r is None else r.time_s for r in m.ndvi)
        fresh = times != self._times
        if fresh or now - self._fused_s > LATENCY_S:
            self._times, self._fused_s = times, now
            self._state, self.fused = fusion.fuse_readings(self._state, m.ndvi, now)
            if sensed.backwards:
                self.decisions.pause()
            else:
                self.decisions.sample(self.fused.ndvi if fresh else None, sensed.track_m, now, sensed.turn_deg_s)
        self.decisions.decide(sensed.track_m, now)

    @property
    def valid(self) -> int:
        """Heads that agree."""
        return self.fused.valid if self.fused else 0

    @property
    def dropped(self) -> tuple[int, ...]:
        """Heads left out, 1-based."""
        return self.fused.dropped if self.fused else ()
