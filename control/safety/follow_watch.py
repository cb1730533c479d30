"""Do shaft and gate follow their set-points at work? Each is held against where the machine model says that it is by
now. Pure.

The set-point alone would accuse every ramp. The model knows the drive's dead time, its slope, and what it loses with
the supply; the host's trims (10 % of the shaft, 2 mm of the gate) take up what a weak battery or a worn motor costs
beyond that. What is left does not do what it is commanded to: a wrong gear, a drive that runs away or is jammed, a gate
that is stuck.
"""
from __future__ import annotations

from typing import NamedTuple

from control.safety.limits import SafetyLimits
from control.safety.senses import Senses, since
from control.safety.words import Situation


class FollowWatch(NamedTuple):
    """`*_off`: reading less model, at this tick. `*_far_since_s`, `*_off_since_s`: beyond its limit, without a
    break."""

    shaft_off_rpm: float = 0.0
    gate_off_mm: float = 0.0
    shaft_far_since_s: float | None = None
    shaft_off_since_s: float | None = None
    gate_far_since_s: float | None = None
    gate_off_since_s: float | None = None


FOLLOWS = FollowWatch()


def followed(before: FollowWatch, now_s: float, s: Situation, seen: Senses, flowing: bool,
             limits: SafetyLimits) -> FollowWatch:
    """The watch after this tick. Judged only while material is to flow by a turning shaft: a stop is `stand_watch`'s, a
    dose the board's own. A share is of the set-point, or of what the model still has from the one before."""
    commanded = s.commanded
    if not flowing or not commanded.shaft_rpm > 0.0:
        return FOLLOWS
    share = limits.drive_far_percent / 100.0
    shaft_off = 0.0 if seen.shaft_rpm is None else seen.shaft_rpm - commanded.expected_rpm
    gate_off = 0.0 if seen.opening_mm is None else seen.opening_mm - commanded.expected_mm
    shaft_most = max(limits.shaft_stands_rpm, share * max(commanded.shaft_rpm, commanded.expected_rpm))
    gate_most = max(limits.gate_off_mm, share * max(commanded.opening_mm, commanded.expected_mm))
    return FollowWatch(
        shaft_off, gate_off,
        since(before.shaft_far_since_s, now_s, abs(shaft_off) > shaft_most),
        since(before.shaft_off_since_s, now_s,
              abs(shaft_off) > max(limits.shaft_stands_rpm, limits.shaft_off_percent / 100.0 * commanded.expected_rpm)),
        since(before.gate_far_since_s, now_s, abs(gate_off) > gate_most),
        since(before.gate_off_since_s, now_s, abs(gate_off) > limits.gate_off_mm))
