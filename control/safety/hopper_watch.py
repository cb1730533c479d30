"""Does the hopper lose what the shaft should have taken? Bridging is invisible to shaft and gate.

The estimator: means of the scale over blocks of one second of expected flow, regressed on the mass expected by
then. The slope is the share of the expected flow that really left. The window is the last `flow_low_s` seconds of
flow, longer where less than `flow_low_kg` was expected in it; the share must stay below its limit for half a window.
The delay: a stream that stops altogether is found after `flow_low_s` (20 s), at small flow after half the longer
window and half of `flow_low_s`; one that falls to 40 % after about 27 s. Pauses count for nothing, a rise of the
scale starts it anew.
"""
from __future__ import annotations

from math import inf
from typing import NamedTuple

from control.safety.limits import SafetyLimits
from control.safety.senses import lasted, since

BLOCK_S = 1.0           # averaging; what is left of the scale's noise is handled by the window


class HopperWatch(NamedTuple):
    last_s: float | None = None
    expected_kg: float = 0.0                    # since the watch began anew
    block_s: float = 0.0
    block_kg_s: float = 0.0                     # integral of the scale over the block
    block_expected_kg_s: float = 0.0            # integral of expected_kg over the block
    blocks: tuple[tuple[float, float], ...] = ()   # (expected kg by then, scale kg), oldest first
    low_blocks: int = 0
    missing: bool = False
    empty_since_s: float | None = None
    low_since_s: float | None = None
    low: bool = False


def watched(before: HopperWatch, now_s: float, hopper_kg: float | None, expected_flow_kg_s: float, flowing: bool,
            limits: SafetyLimits) -> HopperWatch:
    """The watch after this tick. `hopper_kg` None: no scale, or silent; then nothing is judged."""
    if hopper_kg is None:
        return HopperWatch(last_s=now_s, low=before.low)
    edge_kg = limits.hopper_low_kg + (limits.hopper_clear_kg if before.low else 0.0)
    low_since = since(before.low_since_s, now_s, hopper_kg <= edge_kg)
    empty_since = since(before.empty_since_s, now_s, hopper_kg <= limits.hopper_empty_kg)
    low = low_since is not None and (before.low or lasted(low_since, now_s, limits.hopper_confirm_s))
    step_s = 0.0 if before.last_s is None else now_s - before.last_s
    judged = flowing and limits.flow_min_kg_s <= expected_flow_kg_s < inf
    if not judged or not 0.0 < step_s <= BLOCK_S:
        return before._replace(last_s=now_s, empty_since_s=empty_since, low_since_s=low_since, low=low,
                               missing=False)
    expected = before.expected_kg + expected_flow_kg_s * step_s
    after = HopperWatch(
        last_s=now_s, expected_kg=expected, block_s=before.block_s + step_s,
        block_kg_s=before.block_kg_s + hopper_kg * step_s,
        block_expected_kg_s=before.block_expected_kg_s + expected * step_s, blocks=before.blocks,
        low_blocks=before.low_blocks, missing=False, empty_since_s=empty_since, low_since_s=low_since, low=low)
    return after if after.block_s < BLOCK_S - 1e-9 else _block_closed(after, limits)


def refilled(before: HopperWatch) -> HopperWatch:
    """The watch started anew, as after a refill."""
    return HopperWatch(last_s=before.last_s, low=before.low, low_since_s=before.low_since_s)


def _block_closed(w: HopperWatch, limits: SafetyLimits) -> HopperWatch:
    block = (w.block_expected_kg_s / w.block_s, w.block_kg_s / w.block_s)
    if w.blocks and block[1] > min(kg for _, kg in w.blocks) + limits.refill_rise_kg:
        return refilled(w)
    blocks = _window((*w.blocks, block), limits)
    low_blocks = w.low_blocks
    if blocks is None:
        blocks, low_blocks = (*w.blocks, block)[-_most(limits):], 0
    elif _share(blocks) < limits.flow_low_percent / 100.0:
        low_blocks += 1
    else:
        low_blocks = 0
    after = w._replace(block_s=0.0, block_kg_s=0.0, block_expected_kg_s=0.0, blocks=blocks, low_blocks=low_blocks)
    if low_blocks * BLOCK_S < limits.flow_low_s / 2:
        return after
    return refilled(after)._replace(missing=True, empty_since_s=w.empty_since_s)


def _window(blocks: tuple[tuple[float, float], ...],
            limits: SafetyLimits) -> tuple[tuple[float, float], ...] | None:
    """The newest blocks that span enough time and mass, or None while there are too few."""
    newest = blocks[-1][0]
    fewest = round(limits.flow_low_s / BLOCK_S) + 1
    for count in range(fewest, min(len(blocks), _most(limits)) + 1):
        if newest - blocks[-count][0] >= limits.flow_low_kg:
            return blocks[-count:]
    return None


def _most(limits: SafetyLimits) -> int:
    return round(limits.flow_window_max_s / BLOCK_S) + 1


def _share(blocks: tuple[tuple[float, float], ...]) -> float:
    """Least-squares slope of what left the hopper over what was expected to."""
    n = len(blocks)
    mean_expected = sum(e for e, _ in blocks) / n
    mean_kg = sum(kg for _, kg in blocks) / n
    return (-sum((e - mean_expected) * (kg - mean_kg) for e, kg in blocks)
            / sum((e - mean_expected) ** 2 for e, _ in blocks))
