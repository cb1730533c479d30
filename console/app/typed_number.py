"""A number as an operator types it: comma and point alike, and nothing else is guessed at. Pure.

What stands there is read as a whole, or refused in words. A key that was dropped would leave
another number behind: `12,5` without its comma is 125, `1e3` without its letter 13.
"""

from __future__ import annotations

import unicodedata
from typing import NamedTuple

from topdress.console.app.units import Unit
from topdress.console.locale import _

# no number of this console has more; what is typed beyond is refused, not cut
MOST_CHARACTERS = 24
# Full-width comma and point; the Chinese full stop, wide and narrow, which the key of the point
# gives under a Chinese input method; the Arabic decimal sign. Then minus, en and figure dash,
# full-width and small hyphen.
_SAME_SIGNS = {
    "\uff0c": ",",
    "\uff0e": ".",
    "\u3002": ".",
    "\uff61": ".",
    "\u066b": ".",
    "\u2212": "-",
    "\u2013": "-",
    "\u2012": "-",
    "\uff0d": "-",
    "\ufe63": "-",
}


class TypedReading(NamedTuple):
    """Holds the number read. value: in the unit shown, None while there is none. why: the fault, in
    words, "" where there is none. half: more keys may still make a number of it."""

    value: float | None
    why: str = ""
    half: bool = False


def read_number(text: str) -> TypedReading:
    """The number in a field, in whatever script its digits are."""
    plain = _normalise_signs(text)
    if not plain:
        return TypedReading(None, _("Type a number."), half=True)
    if len(plain) > MOST_CHARACTERS:
        return TypedReading(
            None, _("{typed}... is too long for a number.").format(typed=plain[:MOST_CHARACTERS])
        )
    digits = plain.removeprefix("-")
    wrong = next((one for one in digits if not (one.isdecimal() or one in ".,")), "")
    if wrong:
        return TypedReading(None, _explain_wrong_sign(plain, wrong))
    signs = [one for one in digits if one in ".,"]
    if len(signs) > 1:
        return TypedReading(None, _explain_many_signs(plain, signs))
    whole, sign, rest = digits.partition(signs[0]) if signs else (digits, "", "")
    if not whole or (sign and not rest):
        return TypedReading(
            None,
            _("{typed} is half a number: digits stand on both sides of the decimal sign.").format(
                typed=plain
            )
            if sign
            else _("{typed} is half a number.").format(typed=plain),
            half=True,
        )
    return TypedReading(float(plain.replace(",", ".")))


def read_in_range(text: str, low: float, high: float, unit: str) -> TypedReading:
    """The number as `read_number`, within low ... high, both as shown in `unit`. Where a sign could
    separate thousands as well, and both readings are allowed, neither is taken."""
    reading = read_number(text)
    if reading.value is None:
        return reading
    thousands = _read_as_thousands(_normalise_signs(text))
    if thousands is not None and low <= thousands <= high and low <= reading.value <= high:
        said = _("{typed} can mean {one} or {other} {unit}: type it without a sign for thousands.")
        return TypedReading(
            None,
            said.format(
                typed=_normalise_signs(text),
                one=f"{reading.value:g}",
                other=f"{thousands:.0f}",
                unit=unit,
            ),
        )
    if low <= reading.value <= high:
        return reading
    refused = (
        _("{number} {unit} is too little: {low} to {high} {unit} is allowed.")
        if reading.value < low
        else (_("{number} {unit} is too much: {low} to {high} {unit} is allowed."))
    )
    return TypedReading(
        None,
        refused.format(
            number=format_number(reading.value), unit=unit, low=f"{low:g}", high=f"{high:g}"
        ),
        half=reading.value < low,
    )


def format_number(value: float) -> str:
    """A typed number again, without trailing zeros and never as 1e+06."""
    return f"{value:.10f}".rstrip("0").rstrip(".") if abs(value) < 1e15 else f"{value:.0f}"


def format_with_unit(unit: Unit, value_si: float) -> str:
    """A taken number with its unit, to as many decimals as were typed."""
    return f"{format_number(round(value_si * unit.per_si, 6))} {unit.name}"


def round_inwards(unit: Unit, low_si: float, high_si: float, decimals: int) -> tuple[float, float]:
    """A range as shown, rounded inwards: what it allows is allowed in SI too."""
    step = 10.0**decimals
    low, high = low_si * unit.per_si * step, high_si * unit.per_si * step
    # of the product itself: 0.1 * 10 is no less than 1
    slack = 1e-9 * max(1.0, abs(low), abs(high))
    return -(-(low - slack) // 1) / step + 0.0, ((high + slack) // 1) / step


def _normalise_signs(text: str) -> str:
    """ASCII digits, signs and minus in place of those of other scripts; the rest as it was
    typed."""
    return "".join(
        str(unicodedata.decimal(one)) if one.isdecimal() else _SAME_SIGNS.get(one, one)
        for one in text.strip()
    )


def _explain_wrong_sign(plain: str, wrong: str) -> str:
    if wrong.isspace():
        return _("{typed}: a blank stands within the number.").format(typed=plain)
    return _(
        '{typed}: "{wrong}" is not part of a number. Digits and one decimal sign, comma or point.'
    ).format(typed=plain, wrong=wrong)


def _explain_many_signs(plain: str, signs: list[str]) -> str:
    if len(set(signs)) > 1:
        return _("{typed} can be read in two ways: type it without a sign for thousands.").format(
            typed=plain
        )
    return _("{typed}: one decimal sign, comma or point, not {count}.").format(
        typed=plain, count=len(signs)
    )


def _read_as_thousands(plain: str) -> float | None:
    """The number `1,250` or `1.250` where its sign separates thousands: one to three digits, not 0
    at first, then just three."""
    whole, _sign, rest = plain.replace(",", ".").partition(".")
    if len(rest) == 3 and 1 <= len(whole) <= 3 and whole.isdigit() and not whole.startswith("0"):
        return float(whole + rest)
    return None
