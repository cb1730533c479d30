"""Numbers as people write them: few digits, no powers of ten, an interval with the digits that
it deserves."""

from __future__ import annotations

from math import floor, isfinite, log10

MINUS_SIGN = "\N{MINUS SIGN}"
MOST_DECIMALS = 6
MOST_VALUE_DIGITS = 4  # of a value, however narrow its interval


def format_number(value: float | None, digits: int = 3) -> str:
    """Value with so many significant digits; a dash where it is not known."""
    if value is None or not isfinite(value):
        return "\N{EN DASH}"
    if abs(value) < 0.5 * 10.0**-MOST_DECIMALS:
        return "0"
    return format_fixed(value, digits - 1 - floor(log10(abs(value))))


def format_fixed(value: float, decimals: int) -> str:
    """Value with so many decimals; negative ones round to tens, hundreds."""
    decimals = min(MOST_DECIMALS, decimals)
    text = f"{round(value, decimals):.{max(0, decimals)}f}"
    if not text.strip("-0."):
        return text.lstrip("-")
    return text.replace("-", MINUS_SIGN)


def use_plain_minus(text: str) -> str:
    """The text with a minus that every terminal has."""
    return text.replace(MINUS_SIGN, "-")


def format_short(value: float, digits: int = 3) -> str:
    """The number without trailing zeros, for a terminal."""
    text = use_plain_minus(format_number(value, digits))
    return text.rstrip("0").rstrip(".") if "." in text else text


def count_decimals(half_width: float) -> int:
    """Decimals that an interval of this half width deserves: two of its own digits."""
    if not isfinite(half_width) or half_width <= 0.0:
        return 3
    return 1 - floor(log10(half_width))


def format_with_interval(value: float, low: float | None, high: float | None) -> tuple[str, str]:
    """Value, and its interval in words ("" where there is none), to the same decimals."""
    if low is None or high is None or not high > low:
        return format_number(value), ""
    largest = max(abs(low), abs(high))
    decimals = max(
        0, min(count_decimals(0.5 * (high - low)), MOST_VALUE_DIGITS - 1 - floor(log10(largest)))
    )
    least, most = format_fixed(low, decimals), format_fixed(high, decimals)
    return format_fixed(
        value, decimals
    ), f"{least} to {most}" if least != most else "narrower than the last digit"


def format_percent(share: float) -> str:
    """A probability that does not claim certainty."""
    return ">99 %" if share > 0.995 else "<1 %" if share < 0.005 else f"{100.0 * share:.0f} %"


def format_p_value(value: float) -> str:
    """A p value with three decimals."""
    return f"{value:.3f}" if value >= 0.001 else "<0.001"


def format_duration(duration_s: float) -> str:
    """A duration, s, as on a clock."""
    seconds = int(round(duration_s))
    if seconds < 120:
        return f"{seconds} s"
    minutes, rest = divmod(seconds, 60)
    if minutes < 120:
        return f"{minutes} min {rest:02d} s" if rest else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min"
