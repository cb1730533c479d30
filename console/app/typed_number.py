"""Reads a number that an operator types: comma and point are equal, and nothing else is guessed.
Pure.

The text is read as a whole or refused in words. Dropping a character would change the number:
`12,5` without its comma is 125, `1e3` without its letter is 13.
"""

from __future__ import annotations

import unicodedata
from typing import NamedTuple

from topdress.console.app.units import Unit
from topdress.console.locale import _

# No number of this console is longer. A longer text is refused, not cut.
MAX_NUMBER_CHARACTERS = 24
# Full-width comma and point; the Chinese full stop, wide and narrow, which the key of the point
# yields under a Chinese input method; the Arabic decimal sign. Then minus sign, en dash, figure
# dash, full-width hyphen and small hyphen.
_ASCII_OF_TYPED_SIGN = {
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
    """Holds the number that was read.

    Attributes
    ----------
    value
        Number in the displayed unit; None for a fault.
    why
        Fault in words, or "".
    half
        True if more characters may complete the number.
    """

    value: float | None
    why: str = ""
    half: bool = False


def read_number(text: str) -> TypedReading:
    """Read the number of a field, with digits of any script."""
    plain = _normalise_signs(text)
    if not plain:
        return TypedReading(None, _("Type a number."), half=True)
    if len(plain) > MAX_NUMBER_CHARACTERS:
        return TypedReading(
            None,
            _("{typed}... is too long for a number.").format(typed=plain[:MAX_NUMBER_CHARACTERS]),
        )
    digits = plain.removeprefix("-")
    wrong = next((one for one in digits if not (one.isdecimal() or one in ".,")), "")
    if wrong:
        return TypedReading(None, _explain_wrong_sign(plain, wrong))
    signs = [one for one in digits if one in ".,"]
    if len(signs) > 1:
        return TypedReading(None, _explain_many_signs(plain, signs))
    whole, sign, rest = digits.partition(signs[0]) if signs else (digits, "", "")
    # `float` would accept "5." and ".5", which an operator may not have finished.
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
    """Read a number within low to high, in displayed units.

    Where a sign may separate thousands and both readings are in the range, the text is refused.
    """
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
        # A number that is too small may become larger with the next digit.
        half=reading.value < low,
    )


def format_number(value: float) -> str:
    """Return a number without trailing zeros and without an exponent."""
    return f"{value:.10f}".rstrip("0").rstrip(".") if abs(value) < 1e15 else f"{value:.0f}"


def format_with_unit(unit: Unit, value_si: float) -> str:
    """Return a number with its unit, with the decimals that were typed."""
    return f"{format_number(round(value_si * unit.per_si, 6))} {unit.name}"


def round_inwards(unit: Unit, low_si: float, high_si: float, decimals: int) -> tuple[float, float]:
    """Return a range in displayed units, rounded inwards, so that every displayed value is allowed
    in SI too."""
    step = 10.0**decimals
    low, high = low_si * unit.per_si * step, high_si * unit.per_si * step
    # Tolerance for the rounding error of the product: 0.1 * 10 must not be less than 1.
    slack = 1e-9 * max(1.0, abs(low), abs(high))
    return -(-(low - slack) // 1) / step + 0.0, ((high + slack) // 1) / step


def _normalise_signs(text: str) -> str:
    """Replace digits, signs and minus of other scripts by ASCII; other characters stay."""
    return "".join(
        str(unicodedata.decimal(one)) if one.isdecimal() else _ASCII_OF_TYPED_SIGN.get(one, one)
        for one in text.strip()
    )


def _explain_wrong_sign(plain: str, wrong: str) -> str:
    """Return why a character does not belong to a number."""
    if wrong.isspace():
        return _("{typed}: a blank stands within the number.").format(typed=plain)
    return _(
        '{typed}: "{wrong}" is not part of a number. Digits and one decimal sign, comma or point.'
    ).format(typed=plain, wrong=wrong)


def _explain_many_signs(plain: str, signs: list[str]) -> str:
    """Return why several decimal signs are refused."""
    if len(set(signs)) > 1:
        return _("{typed} can be read in two ways: type it without a sign for thousands.").format(
            typed=plain
        )
    return _("{typed}: one decimal sign, comma or point, not {count}.").format(
        typed=plain, count=len(signs)
    )


def _read_as_thousands(plain: str) -> float | None:
    """Read `1,250` or `1.250` as thousands: one to three digits without a leading 0, then exactly
    three; None otherwise."""
    whole, _sign, rest = plain.replace(",", ".").partition(".")
    if len(rest) == 3 and 1 <= len(whole) <= 3 and whole.isdigit() and not whole.startswith("0"):
        return float(whole + rest)
    return None
