"""An attribute's value as a number: numbers, and texts of numbers with a decimal comma or a unit behind."""
from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from drivers.files.imports.header import NOTHING

_NUMBER = re.compile(r"^(?P<number>[-+]?[\d.,'’\s]*\d[.,]?(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d\s].*)?$")


class Cell(NamedTuple):
    """`value`: NaN for nothing. `unit`: behind the number, as written."""

    value: float
    unit: str = ""


def cell_of(value: Any) -> Cell | None:
    """None for what is no number."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return Cell(math.nan)
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return Cell(float(value)) if math.isfinite(value) else None
    if not isinstance(value, str):
        return None
    text = value.strip()
    if text.casefold() in NOTHING:
        return Cell(math.nan)
    found = _NUMBER.match(text)
    number = None if found is None else _number(re.sub(r"['’\s]", "", found["number"]))
    return None if found is None or number is None else Cell(number, (found["unit"] or "").strip())


def _number(text: str) -> float | None:
    """Of a point and a comma the last is the decimal sign, and the other groups digits; a comma alone is one."""
    if "," in text and "." in text:
        group = "," if text.rfind(".") > text.rfind(",") else "."
        text = text.replace(group, "")
    text = text.replace(",", ".")
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
