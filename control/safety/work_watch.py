"""Do shaft and gate follow at work, is the rate on its target, is the hopper empty or low? Pure.

Shaft and gate are compared with the machine model's present values, because every ramp would differ
from the set-point. The model includes the drive's dead time, its slope, and its loss with the
supply voltage; the host's trims (10 % of the shaft, 2 mm of the gate) correct the effects of a weak
battery or a worn motor. A larger difference is a fault: a wrong gear, a drive that is out of
control or jammed, a gate that is stuck. `metering/flow_trim.py` compares the mass that leaves the
hopper with the model.
"""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.safety_interface import SafetySituation
from topdress.control.safety.sensor_validity import ValidReadings, find_since_s, has_lasted


class FollowWatch(NamedTuple):
    """Holds how well the drives follow. `*_off`: reading minus model at this tick.
    `*_far_since_s`, `*_off_since_s`: since when the limit is exceeded without a break."""

    shaft_off_rpm: float = 0.0
    gate_off_mm: float = 0.0
    shaft_far_since_s: float | None = None
    shaft_off_since_s: float | None = None
    gate_far_since_s: float | None = None
    gate_off_since_s: float | None = None


DRIVES_FOLLOWING = FollowWatch()


def watch_drives(
    before: FollowWatch,
    now_s: float,
    s: SafetySituation,
    seen: ValidReadings,
    flowing: bool,
    limits: SafetyLimits,
) -> FollowWatch:
    """Returns the state of the drives after this tick.

    The drives are judged only while a turning shaft should meter: `standstill_monitor` monitors a
    stop, the board a dose. A relative error refers to the set-point, or to the model's remainder of
    the previous set-point.
    """
    commanded = s.commanded
    if not flowing or not commanded.shaft_rpm > 0.0:
        return DRIVES_FOLLOWING
    share = limits.drive_far_percent / 100.0
    shaft_off = 0.0 if seen.shaft_rpm is None else seen.shaft_rpm - commanded.expected_rpm
    gate_off = 0.0 if seen.opening_mm is None else seen.opening_mm - commanded.expected_mm
    shaft_most = max(
        limits.shaft_stands_rpm, share * max(commanded.shaft_rpm, commanded.expected_rpm)
    )
    gate_most = max(limits.gate_off_mm, share * max(commanded.opening_mm, commanded.expected_mm))
    return FollowWatch(
        shaft_off,
        gate_off,
        find_since_s(before.shaft_far_since_s, now_s, abs(shaft_off) > shaft_most),
        find_since_s(
            before.shaft_off_since_s,
            now_s,
            abs(shaft_off)
            > max(
                limits.shaft_stands_rpm, limits.shaft_off_percent / 100.0 * commanded.expected_rpm
            ),
        ),
        find_since_s(before.gate_far_since_s, now_s, abs(gate_off) > gate_most),
        find_since_s(before.gate_off_since_s, now_s, abs(gate_off) > limits.gate_off_mm),
    )


class RateWatch(NamedTuple):
    """Holds how long the applied rate has been off its target. Values are raw: no smoothing
    between machine and alarm."""

    # Error of this tick, signed: applied minus expected, %.
    error_percent: float = 0.0
    # Start of the uninterrupted excess, s.
    amber_since_s: float | None = None
    red_since_s: float | None = None
    # Start of the excess over the product's absolute limit, s.
    above_since_s: float | None = None


RATE_NOT_JUDGED = RateWatch()


def watch_rate(
    before: RateWatch, now_s: float, s: SafetySituation, flowing: bool, limits: SafetyLimits
) -> RateWatch:
    """Returns the state of the rate after this tick; every interruption of an excess and every stop
    of the flow restart its time.

    The error is applied minus expected rate (the target after the nominal response of the
    actuators), relative to the larger of the target and `rate_floor_kg_ha`.
    """
    if not flowing or s.applied_rate_kg_ha is None:
        return RATE_NOT_JUDGED
    error = 0.0
    if s.expected_rate_kg_ha is not None:
        off_kg_ha = s.applied_rate_kg_ha - s.expected_rate_kg_ha
        error = 100.0 * off_kg_ha / max(limits.rate_floor_kg_ha, s.target_rate_kg_ha)
    return RateWatch(
        error,
        find_since_s(before.amber_since_s, now_s, abs(error) > limits.rate_amber_percent),
        find_since_s(before.red_since_s, now_s, abs(error) > limits.rate_red_percent),
        find_since_s(before.above_since_s, now_s, s.applied_rate_kg_ha > limits.rate_max_kg_ha),
    )


class HopperTimes(NamedTuple):
    """Holds since when the hopper is empty or low."""

    empty_since_s: float | None = None
    low_since_s: float | None = None
    low: bool = False


def watch_hopper(
    before: HopperTimes, now_s: float, hopper_kg: float | None, limits: SafetyLimits
) -> HopperTimes:
    """Returns the state of the hopper after this tick. `hopper_kg` None means no scale or a
    silent scale; then nothing is judged."""
    if hopper_kg is None:
        return HopperTimes(low=before.low)
    edge_kg = limits.hopper_low_kg + (limits.hopper_clear_kg if before.low else 0.0)
    low_since = find_since_s(before.low_since_s, now_s, hopper_kg <= edge_kg)
    # Noise of the scale must not end a confirmed empty hopper.
    empty = has_lasted(before.empty_since_s, now_s, limits.hopper_confirm_s)
    empty_since = find_since_s(
        before.empty_since_s,
        now_s,
        hopper_kg <= limits.hopper_empty_kg + (limits.hopper_clear_kg if empty else 0.0),
    )
    low = low_since is not None and (
        before.low or has_lasted(low_since, now_s, limits.hopper_confirm_s)
    )
    return HopperTimes(empty_since, low_since, low)
