"""How long the applied rate has been off its target. Raw values: no smoothing between machine and alarm."""
from __future__ import annotations

from typing import NamedTuple

from control.safety.limits import SafetyLimits
from control.safety.senses import since
from control.safety.words import Situation


class RateWatch(NamedTuple):
    error_percent: float = 0.0              # at this tick, signed: applied minus expected
    amber_since_s: float | None = None      # without a break
    red_since_s: float | None = None
    above_since_s: float | None = None      # above the product's absolute limit


NOT_JUDGED = RateWatch()


def rated(before: RateWatch, now_s: float, s: Situation, flowing: bool, limits: SafetyLimits) -> RateWatch:
    """The watch after this tick; every break in an excess, and every stop of flow, starts its count again.

    The error is applied less expected rate (target passed through the nominal response of the actuators), relative
    to the larger of the target and `rate_floor_kg_ha`.
    """
    if not flowing or s.applied_rate_kg_ha is None:
        return NOT_JUDGED
    error = 0.0
    if s.expected_rate_kg_ha is not None:
        off_kg_ha = s.applied_rate_kg_ha - s.expected_rate_kg_ha
        error = 100.0 * off_kg_ha / max(limits.rate_floor_kg_ha, s.target_rate_kg_ha)
    return RateWatch(
        error,
        since(before.amber_since_s, now_s, abs(error) > limits.rate_amber_percent),
        since(before.red_since_s, now_s, abs(error) > limits.rate_red_percent),
        since(before.above_since_s, now_s, s.applied_rate_kg_ha > limits.rate_max_kg_ha))
