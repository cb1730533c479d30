"""Which NDVI do the canopy heads measure, and which rate follows? The newest readings are fused
and converted to decisions.
"""

from __future__ import annotations

from topdress.control.agronomy import head_fusion
from topdress.control.geodesy import Place, offset_place
from topdress.control.orders import TargetSource
from topdress.control.readings import Measurements
from topdress.control.sensing import SensedMotion
from topdress.control.targets.canopy_target import CanopyDecisions
from topdress.control.targets.index_map import IndexMap

# A head's reading may be one period old, s.
HEAD_LATENCY_S = 0.5


class CanopyHeads:
    """Fuses the heads of a run. `fused`: newest result; None before the first. `by_map`: whether
    the index map replaces the heads."""

    def __init__(
        self,
        heads: int,
        decisions: CanopyDecisions,
        index: str = "ndvi",
        under: IndexMap | None = None,
        heads_m: float = 0.0,
        zones: IndexMap | None = None,
    ) -> None:
        """Creates the object without readings.

        Parameters
        ----------
        heads : number of heads. decisions : converts samples to decided rates. index : index of the
        crop's rule; readings of another index are ignored. under : index map that replaces silent
        heads. heads_m : distance of the heads ahead of the outlets, m. zones : factors of the rule
        by position.
        """
        self._index = index
        self.decisions = decisions
        self.fused: head_fusion.FusedNdvi | None = None
        self._state = head_fusion.start_fusion(heads)
        self._times: tuple[float | None, ...] = ()
        self._fused_s = float("-inf")
        self._under, self._heads_m, self._zones = under, heads_m, zones
        self.by_map = False

    def fuse_and_decide(self, m: Measurements, sensed: SensedMotion) -> None:
        """Fuses new readings, drops old readings, and decides at the end of a decision period."""
        if m.canopy_index != self._index:
            m = m._replace(ndvi=(None,) * len(m.ndvi))
        now = m.time_s
        times = tuple([None if r is None else r.time_s for r in m.ndvi])
        fresh = times != self._times
        if fresh or now - self._fused_s > HEAD_LATENCY_S:
            self._times, self._fused_s = times, now
            self._state, self.fused = head_fusion.fuse_readings(self._state, m.ndvi, now)
            if sensed.backwards:
                self.decisions.pause_sampling()
            else:
                self._take_sample(self.fused.ndvi, fresh, sensed)
        # Without a known position the last zone continues.
        if self._zones is not None and (place := self._find_seen_place(sensed)) is not None:
            factor = self._zones.find_index(*place)
            self.decisions.zone_factor = 1.0 if factor is None else factor
        self.decisions.decide_stretch(sensed.track_m, now)

    def _take_sample(self, read: float | None, fresh: bool, sensed: SensedMotion) -> None:
        """Takes the heads' reading as a sample, or the map's value under silent heads."""
        place = None if self._under is None else self._find_seen_place(sensed)
        mapped = None if self._under is None or place is None else self._under.find_index(*place)
        self.by_map = read is None and mapped is not None
        if self._under is not None and mapped is not None and read is not None and fresh:
            self._under.learn_offset(read, mapped)
        if self._under is not None and mapped is not None and read is None:
            self.decisions.take_sample(
                self._under.adjust_to_heads(mapped),
                sensed.track_m,
                sensed.time_s,
                sensed.turn_deg_s,
                TargetSource.INDEX_MAP,
            )
        else:
            self.decisions.take_sample(
                read if fresh else None, sensed.track_m, sensed.time_s, sensed.turn_deg_s
            )

    def _find_seen_place(self, sensed: SensedMotion) -> tuple[Place, float] | None:
        """Returns the position under the heads, and the course; None without a known position."""
        if (
            not sensed.position_ok
            or sensed.east_m is None
            or sensed.north_m is None
            or sensed.heading_deg is None
        ):
            return None
        return offset_place(
            (sensed.east_m, sensed.north_m), sensed.heading_deg, self._heads_m
        ), sensed.heading_deg

    @property
    def valid_heads(self) -> int:
        """Returns the number of heads whose readings agree."""
        return self.fused.valid if self.fused else 0

    @property
    def dropped_heads(self) -> tuple[int, ...]:
        """Returns the heads that are left out, counted from 1."""
        return self.fused.dropped if self.fused else ()
