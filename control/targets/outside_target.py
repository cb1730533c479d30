"""The target that another display tells, and what holds while it is silent."""

from __future__ import annotations

from collections.abc import Callable

from topdress.control.orders import TargetSource
from topdress.control.readings import Reading, is_fresh
from topdress.control.targets.profile import Everywhere, Target

# m/s; flow begins at this speed (`SafetyLimits.start_speed_mps`): a target that is heard while
# the machine stands is judged by it
JUDGED_FROM_MPS = 0.5


class OutsideTarget:
    """Holds the newest target of another display.

    A display stops sending where it leaves its field. So what it last wanted as nothing, or as
    less than the machine can give, stays nothing until it speaks again: no silence begins flow.
    """

    def __init__(
        self, silent_rate_kg_ha: float, holds_s: float, least_rate_kg_ha: Callable[[float], float]
    ) -> None:
        """Starts silent.

        Parameters
        ----------
        silent_rate_kg_ha: what is spread while the display is silent, kg/ha.
        holds_s: for so long a target is believed, s.
        least_rate_kg_ha: gives the rate, kg/ha, up to which nothing flows at a speed in m/s.
        """
        self._silent_rate_kg_ha = silent_rate_kg_ha
        self._holds_s = holds_s
        self._least_rate_kg_ha = least_rate_kg_ha
        self._heard_s: float | None = None
        self._wants_nothing = False
        self.speaks = False
        self.profile = self._silent_profile()

    @property
    def silent_rate_kg_ha(self) -> float:
        """What is spread while the display is silent, by what it wanted last."""
        return 0.0 if self._wants_nothing else self._silent_rate_kg_ha

    def hear(self, wanted: Reading | None, now_s: float, speed_mps: float) -> None:
        """Take the display's newest target, kg/ha, however old.

        Parameters
        ----------
        wanted: None where the display never spoke.
        now_s: time of this tick, s.
        speed_mps: ground speed, m/s; 0 where it is not known.
        """
        self.speaks = wanted is not None and is_fresh(wanted.time_s, now_s, self._holds_s)
        if wanted is None or not self.speaks:
            self.profile = self._silent_profile()
            return
        if wanted.time_s != self._heard_s:
            self._heard_s = wanted.time_s
            least_kg_ha = self._least_rate_kg_ha(max(JUDGED_FROM_MPS, speed_mps))
            self._wants_nothing = wanted.value <= least_kg_ha
        self.profile = Everywhere(Target(wanted.value, TargetSource.EXTERNAL))

    def forbid_flow_in_silence(self) -> None:
        """Let nothing flow until the display speaks: what it wanted last is not known any more."""
        self._wants_nothing = True
        self.profile = self._silent_profile()

    def _silent_profile(self) -> Everywhere:
        return Everywhere(Target(self.silent_rate_kg_ha, TargetSource.FALLBACK))
