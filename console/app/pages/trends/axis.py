"""Round ends of a plot's axis."""
from __future__ import annotations

from math import ceil, floor, isfinite, log10

_PIECES = 4


def round_ends(low: float, high: float, decimals: int) -> tuple[float, float]:
    """Round numbers that hold low ... high, wide enough that their last shown decimal differs. NaN: 0 ... 1."""
    if not (isfinite(low) and isfinite(high)):
        return 0.0, 1.0
    least = _PIECES * 10.0 ** -decimals
    if high - low < least:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * least, middle + 0.5 * least
    step = _round_step((high - low) / _PIECES)
    return floor(low / step + 1e-9) * step, ceil(high / step - 1e-9) * step


def _round_step(about: float) -> float:
    """1, 2 or 5 times a power of ten, not below `about`."""
    power = 10.0 ** floor(log10(about))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= about * (1.0 - 1e-9))
