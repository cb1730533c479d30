"""Which target does another display send, and which holds while it is silent?"""

from __future__ import annotations

from collections.abc import Callable

from topdress.control.orders import TargetSource
from topdress.control.readings import Reading, is_reading_fresh
from topdress.control.targets.target_profile import ConstantProfile, Target

# Flow begins at this speed, m/s (`SafetyLimits.start_speed_mps`): a target that arrives while the
# machine stands is judged by it.
JUDGED_FROM_MPS = 0.5


class ExternalTarget:
    """Holds the newest target of another display.

    A display stops sending where it leaves its field. So a last target of 0, or below the
    machine's least rate, stays 0 until the display sends again: no silence starts the flow."""

    def __init__(
        self, silent_rate_kg_ha: float, holds_s: float, least_rate_kg_ha: Callable[[float], float]
    ) -> None:
        """Starts silent.

        Parameters
        ----------
        silent_rate_kg_ha : rate while the display is silent, kg/ha.
        holds_s : a target is valid for so long, s.
        least_rate_kg_ha : returns the rate, kg/ha, up to which nothing flows at a speed in m/s."""
        self._silent_rate_kg_ha = silent_rate_kg_ha
        self._holds_s = holds_s
        self._least_rate_kg_ha = least_rate_kg_ha
        self._heard_s: float | None = None
        self._wants_nothing = False
        self.speaks = False
        self.profile = self._make_silent_profile()

    @property
    def silent_rate_kg_ha(self) -> float:
        """Returns the rate while the display is silent, by its last target."""
        return 0.0 if self._wants_nothing else self._silent_rate_kg_ha

    def take_reading(self, wanted: Reading | None, now_s: float, speed_mps: float) -> None:
        """Takes the display's newest target, kg/ha, however old.

        Parameters
        ----------
        wanted : None where the display never sent any.
        now_s : time of this tick, s.
        speed_mps : ground speed, m/s; 0 where it is unknown."""
        self.speaks = wanted is not None and is_reading_fresh(wanted.time_s, now_s, self._holds_s)
        if wanted is None or not self.speaks:
            self.profile = self._make_silent_profile()
            return
        if wanted.time_s != self._heard_s:
            self._heard_s = wanted.time_s
            least_kg_ha = self._least_rate_kg_ha(max(JUDGED_FROM_MPS, speed_mps))
            self._wants_nothing = wanted.value <= least_kg_ha
        self.profile = ConstantProfile(Target(wanted.value, TargetSource.EXTERNAL))

    def forbid_flow_in_silence(self) -> None:
        """Forbids flow until the display sends again, because its last target is not known any
        more."""
        self._wants_nothing = True
        self.profile = self._make_silent_profile()

    def _make_silent_profile(self) -> ConstantProfile:
        return ConstantProfile(Target(self.silent_rate_kg_ha, TargetSource.FALLBACK))
