"""How are numbers written for people? They have few digits, no powers of ten, and as many digits as
their interval justifies.
"""

from __future__ import annotations

from math import floor, isfinite, log10

MINUS_SIGN = "\N{MINUS SIGN}"
MAX_DECIMALS = 6
# Number of digits of a value, however narrow its interval.
MAX_VALUE_DIGITS = 4


def format_number(value: float | None, digits: int = 3) -> str:
    """Returns the value with `digits` significant digits; a dash for an unknown value."""
    if value is None or not isfinite(value):
        return "\N{EN DASH}"
    if abs(value) < 0.5 * 10.0**-MAX_DECIMALS:
        return "0"
    return format_fixed(value, digits - 1 - floor(log10(abs(value))))


def format_fixed(value: float, decimals: int) -> str:
    """Returns the value with `decimals` decimals; negative numbers round to tens, hundreds."""
    decimals = min(MAX_DECIMALS, decimals)
    text = f"{round(value, decimals):.{max(0, decimals)}f}"
    if not text.strip("-0."):
        return text.lstrip("-")
    return text.replace("-", MINUS_SIGN)


def use_plain_minus(text: str) -> str:
    """Returns the text with a minus that every terminal can show."""
    return text.replace(MINUS_SIGN, "-")


def format_short(value: float, digits: int = 3) -> str:
    """Returns the number without trailing zeros, for a terminal."""
    text = use_plain_minus(format_number(value, digits))
    return text.rstrip("0").rstrip(".") if "." in text else text


def count_decimals(half_width: float) -> int:
    """Returns the number of decimals for an interval of this half width: two of its own digits."""
    if not isfinite(half_width) or half_width <= 0.0:
        return 3
    return 1 - floor(log10(half_width))


def format_with_interval(value: float, low: float | None, high: float | None) -> tuple[str, str]:
    """Returns the value and its interval in words ("" without an interval) with the same
    decimals."""
    if low is None or high is None or not high > low:
        return format_number(value), ""
    largest = max(abs(low), abs(high))
    decimals = max(
        0, min(count_decimals(0.5 * (high - low)), MAX_VALUE_DIGITS - 1 - floor(log10(largest)))
    )
    least, most = format_fixed(low, decimals), format_fixed(high, decimals)
    return format_fixed(
        value, decimals
    ), f"{least} to {most}" if least != most else "narrower than the last digit"


def format_percent(share: float) -> str:
    """Returns a probability as a percentage that is never 0 or 100."""
    return ">99 %" if share > 0.995 else "<1 %" if share < 0.005 else f"{100.0 * share:.0f} %"


def format_p_value(value: float) -> str:
    """Returns a p value with three decimals."""
    return f"{value:.3f}" if value >= 0.001 else "<0.001"


def format_duration(duration_s: float) -> str:
    """Returns a duration, given in s, as on a clock."""
    seconds = int(round(duration_s))
    if seconds < 120:
        return f"{seconds} s"
    minutes, rest = divmod(seconds, 60)
    if minutes < 120:
        return f"{minutes} min {rest:02d} s" if rest else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min"
