"""Is the hopper empty, or nearly? What leaves it against what should is watched by `metering/flow_trim.py`."""
from __future__ import annotations

from typing import NamedTuple

from control.safety.limits import SafetyLimits
from control.safety.senses import lasted, since


class HopperWatch(NamedTuple):
    empty_since_s: float | None = None
    low_since_s: float | None = None
    low: bool = False


def watched(before: HopperWatch, now_s: float, hopper_kg: float | None, limits: SafetyLimits) -> HopperWatch:
    """The watch after this tick. `hopper_kg` None: no scale, or silent; then nothing is judged."""
    if hopper_kg is None:
        return HopperWatch(low=before.low)
    edge_kg = limits.hopper_low_kg + (limits.hopper_clear_kg if before.low else 0.0)
    low_since = since(before.low_since_s, now_s, hopper_kg <= edge_kg)
    empty = lasted(before.empty_since_s, now_s, limits.hopper_confirm_s)     # no noise of the scale fills a hopper
    empty_since = since(before.empty_since_s, now_s,
                        hopper_kg <= limits.hopper_empty_kg + (limits.hopper_clear_kg if empty else 0.0))
    low = low_since is not None and (before.low or lasted(low_since, now_s, limits.hopper_confirm_s))
    return HopperWatch(empty_since, low_since, low)
