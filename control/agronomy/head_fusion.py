"""Which of the canopy heads can be trusted, and which NDVI do they measure together? The median
of the trusted heads.

A head is left out when it is silent (no new reading for `silent_s`) or when it disagrees: its
distance from the median of the others exceeds max(`least_apart`, `robust_sds` robust standard
deviations of the others) without a break for `drop_after_s`, and fewer than half of the heads
agree with it. It returns when it has stayed within half of that distance for `return_after_s`.
One bad reading never drops a head, because the median tolerates it."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from topdress.control.readings import Reading, is_reading_fresh
from topdress.control.signals import VALID_FOR

# Ratio of the standard deviation to the median absolute deviation of a normal distribution.
_MAD_TO_SD = 1.4826


class FusionLimits(NamedTuple):
    """Holds the limits by which heads are dropped and taken back."""

    # Time until a head is silent, s.
    silent_s: float = VALID_FOR["ndvi_1"].control_s
    # Minimum difference of NDVI for a disagreement.
    least_apart: float = 0.08
    robust_sds: float = 4.0
    drop_after_s: float = 2.0
    return_after_s: float = 5.0
    # Minimum number of valid heads; with fewer the fusion is degraded.
    least_valid: int = 4
    # A value outside ndvi_low to ndvi_high is no reading.
    ndvi_low: float = -0.2
    ndvi_high: float = 1.0


DEFAULT_LIMITS = FusionLimits()


class HeadState(NamedTuple):
    last: Reading | None = None
    # Start of the uninterrupted disagreement, s.
    apart_since_s: float | None = None
    # Time since which a dropped head agrees again, s.
    close_since_s: float | None = None
    dropped: bool = False


class FusionState(NamedTuple):
    heads: tuple[HeadState, ...] = ()


class FusedNdvi(NamedTuple):
    """Holds the NDVI of all trusted heads (None when no head is left) and the heads that were
    left out.

    Heads are numbered from 1, left to right."""

    ndvi: float | None
    # Number of heads in the median.
    valid: int
    # Heads left out for either reason.
    dropped: tuple[int, ...]
    disagreeing: tuple[int, ...]
    silent: tuple[int, ...]
    # Whether too few heads are valid.
    degraded: bool


def start_fusion(heads: int = 6) -> FusionState:
    """Returns the state of the fusion before any reading, for so many heads."""
    return FusionState((HeadState(),) * heads)


def fuse_readings(
    state: FusionState,
    readings: Sequence[Reading | None],
    time_s: float,
    limits: FusionLimits = DEFAULT_LIMITS,
) -> tuple[FusionState, FusedNdvi]:
    """Fuses the newest reading of each head, however old, into one NDVI.

    Parameters
    ----------
    state : of the step before. A change in the number of heads starts afresh.
    readings : (heads,) NDVI; None where a head has no reading yet (as in
        `control.readings.Measurements`).
    time_s : present time, s.
    limits : by which heads are dropped and taken back; they are the project's own.

    Returns
    -------
    The new state, and the fused NDVI."""
    heads = state.heads if len(state.heads) == len(readings) else (HeadState(),) * len(readings)
    heads = tuple(
        _store_reading(head, reading, limits) for head, reading in zip(heads, readings, strict=True)
    )
    silent = tuple(k for k, head in enumerate(heads) if _is_silent(head, time_s, limits))
    fresh = {
        k: head.last.value
        for k, head in enumerate(heads)
        if head.last is not None and k not in silent
    }
    heads = tuple(
        _update_trust(k, head, heads, fresh, time_s, limits) if k in fresh else _clear_timers(head)
        for k, head in enumerate(heads)
    )
    trusted = [value for k, value in fresh.items() if not heads[k].dropped]
    disagreeing = tuple(k + 1 for k in fresh if heads[k].dropped)
    mute = tuple(k + 1 for k in silent)
    fused = FusedNdvi(
        median(trusted) if trusted else None,
        len(trusted),
        tuple(sorted((*disagreeing, *mute))),
        disagreeing,
        mute,
        len(trusted) < limits.least_valid,
    )
    return FusionState(heads), fused


def _store_reading(head: HeadState, reading: Reading | None, limits: FusionLimits) -> HeadState:
    if reading is None or not limits.ndvi_low <= reading.value <= limits.ndvi_high:
        return head
    return head._replace(last=reading)


def _is_silent(head: HeadState, time_s: float, limits: FusionLimits) -> bool:
    return head.last is None or not is_reading_fresh(head.last.time_s, time_s, limits.silent_s)


def _clear_timers(head: HeadState) -> HeadState:
    return head._replace(apart_since_s=None, close_since_s=None)


def _update_trust(
    k: int,
    head: HeadState,
    heads: tuple[HeadState, ...],
    fresh: dict[int, float],
    time_s: float,
    limits: FusionLimits,
) -> HeadState:
    others = [value for j, value in fresh.items() if j != k and not heads[j].dropped]
    if len(others) < 3:
        return _clear_timers(head)
    middle = median(others)
    robust_sd = _MAD_TO_SD * median([abs(value - middle) for value in others])
    allowed = max(limits.least_apart, limits.robust_sds * robust_sd)
    apart = abs(fresh[k] - middle)
    if head.dropped:
        if apart > 0.5 * allowed:
            return head._replace(close_since_s=None)
        since = head.close_since_s if head.close_since_s is not None else time_s
        back = time_s - since >= limits.return_after_s
        return head._replace(close_since_s=None if back else since, dropped=not back)
    siding = 1 + sum(abs(value - fresh[k]) <= allowed for value in others)
    if apart <= allowed or 2 * siding >= len(others) + 1:
        return head._replace(apart_since_s=None)
    since = head.apart_since_s if head.apart_since_s is not None else time_s
    gone = time_s - since >= limits.drop_after_s
    return head._replace(apart_since_s=None if gone else since, dropped=gone)
