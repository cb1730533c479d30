"""Which units do machines write, and by which factors are they converted to the unit of a log
column?
"""

from __future__ import annotations

import math
import re
import unicodedata
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import COLUMNS, TEXT_COLUMNS, WHOLE_COLUMNS
from topdress.control.recordings.speed_unit import KMH_PER_MPS, MILE_M, NAUTICAL_MILE_M
from topdress.drivers.files.prescriptions.map_choices import (
    MASS_UNITS,
    NITROGEN_UNITS,
    VOLUME_UNITS,
)

# A slope of 100 % rises 100 m in 100 m; it is converted by the arc tangent instead of a factor.
SLOPE_PERCENT = "slope %"


class ColumnUnit(NamedTuple):
    """Describes a unit. `factor` converts it to the log's unit of that quantity. `other` lists
    further spellings, in small letters."""

    name: str
    quantity: str
    factor: float
    other: tuple[str, ...] = ()


# The international pound, kg.
_POUND_KG = 0.45359237
# The international foot, m, and inch, mm.
_FOOT_M, _INCH_MM = 0.3048, 25.4

# All known units by quantity, with the spellings in machines' logs.
KNOWN_UNITS = (
    ColumnUnit("m/s", "speed", 1.0, ("mps", "m/sec", "ms-1", "m s-1", "m_s", "米/秒")),
    ColumnUnit(
        "km/h",
        "speed",
        1.0 / KMH_PER_MPS,
        (
            "kmh",
            "kph",
            "kmph",
            "km/hr",
            "km/hour",
            "km h-1",
            "km_h",
            "公里/小时",
            "千米/小时",
            "公里/时",
        ),
    ),
    ColumnUnit("mph", "speed", MILE_M / 3600.0, ("mi/h", "miles/h", "mile/h", "miles/hour")),
    ColumnUnit("kn", "speed", NAUTICAL_MILE_M / 3600.0, ("knots", "knot", "kt", "kts")),
    ColumnUnit("ft/s", "speed", _FOOT_M, ("fps", "ft/sec")),
    ColumnUnit("cm/s", "speed", 0.01),
    ColumnUnit("mm/s", "speed", 0.001),
    ColumnUnit(
        "r/min",
        "rotation",
        1.0,
        (
            "rpm",
            "rev/min",
            "u/min",
            "umdr/min",
            "1/min",
            "min-1",
            "tr/min",
            "giri/min",
            "转/分",
            "转/分钟",
            "об/мин",
        ),
    ),
    ColumnUnit("r/s", "rotation", 60.0, ("rps", "rev/s", "1/s", "u/s", "转/秒")),
    ColumnUnit("rad/s", "rotation", 30.0 / math.pi, ("rad/sec", "rads", "rad_s")),
    ColumnUnit("deg/s", "rotation", 1.0 / 6.0, ("°/s", "grad/s")),
    ColumnUnit("mm", "length", 1.0, ("毫米", "millimeter")),
    ColumnUnit("cm", "length", 10.0, ("厘米",)),
    ColumnUnit("m", "length", 1000.0, ("米", "meter", "metre")),
    ColumnUnit("in", "length", _INCH_MM, ("inch", "inches", "zoll", '"')),
    ColumnUnit("ft", "length", 1000.0 * _FOOT_M, ("feet",)),
    ColumnUnit("kg", "mass", 1.0, ("公斤", "千克")),
    ColumnUnit("g", "mass", 0.001, ("gram", "克")),
    ColumnUnit("t", "mass", 1000.0, ("to", "ton", "tons", "tonne", "吨")),
    ColumnUnit("lb", "mass", _POUND_KG, ("lbs", "pound", "pounds")),
    *(
        ColumnUnit(name, "rate", factor, {"kg/ha": ("kgha",), "lb/ac": ("lbac",)}.get(name, ()))
        for name, factor in MASS_UNITS.items()
    ),
    *(ColumnUnit(name, "nitrogen", factor) for name, factor in NITROGEN_UNITS.items()),
    ColumnUnit("kg/s", "flow", 1.0, ("kg_s",)),
    ColumnUnit("kg/min", "flow", 1.0 / 60.0, ("kg_min", "公斤/分")),
    ColumnUnit("kg/h", "flow", 1.0 / 3600.0, ("kg/hr", "kg_h")),
    ColumnUnit("g/s", "flow", 0.001, ("g_s", "克/秒")),
    ColumnUnit("g/min", "flow", 0.001 / 60.0),
    ColumnUnit("mg/s", "flow", 1e-6),
    ColumnUnit("t/h", "flow", 1000.0 / 3600.0),
    ColumnUnit("lb/min", "flow", _POUND_KG / 60.0, ("lbs/min",)),
    *(
        ColumnUnit(name, "volume", factor, {"l/ha": ("lha",), "gal/ac": ("gpa",)}.get(name, ()))
        for name, factor in VOLUME_UNITS.items()
    ),
    *(ColumnUnit(name, "count", 1.0) for name in ("seeds/ha", "seeds/ac", "seeds/m2")),
    ColumnUnit("deg", "angle", 1.0, ("°", "degree", "degrees", "grad", "度", "degrés")),
    ColumnUnit("rad", "angle", 180.0 / math.pi, ("radian", "radians", "弧度")),
    ColumnUnit(SLOPE_PERCENT, "angle", math.nan, ("% slope", "%坡度")),
    ColumnUnit("V", "voltage", 1.0, ("volt", "volts", "伏")),
    ColumnUnit("mV", "voltage", 0.001, ("millivolt",)),
    ColumnUnit("%", "share", 1.0, ("percent", "pct", "prozent", "百分比")),
    ColumnUnit("s", "time", 1.0, ("sec", "secs", "second", "seconds", "sek", "秒")),
    ColumnUnit("ms", "time", 1e-3, ("msec", "millis", "milliseconds", "毫秒")),
    ColumnUnit("us", "time", 1e-6, ("µs", "μs", "usec", "micros", "microseconds", "微秒")),
    ColumnUnit("min", "time", 60.0, ("minutes", "分钟")),
    ColumnUnit("h", "time", 3600.0, ("hours", "小时")),
    # Units without a column of the log; an extra column keeps them in its name.
    *(
        ColumnUnit(name, "other", 1.0, other)
        for name, other in (
            ("Nm", ("n·m", "n.m", "nm")),
            ("N", ("newton",)),
            ("kN", ()),
            ("bar", ()),
            ("kPa", ()),
            ("Pa", ()),
            ("psi", ()),
            ("MPa", ()),
            ("degC", ("°c", "℃", "celsius")),
            ("degF", ("°f", "℉")),
            ("A", ("amp", "ampere", "安")),
            ("mA", ()),
            ("W", ()),
            ("kW", ()),
            ("Hz", ()),
            ("kHz", ()),
            ("l/h", ("lph",)),
            ("l/min", ()),
            ("ha", ("hectare", "公顷")),
            ("ac", ("acre", "acres")),
            ("m2", ()),
            ("km", ()),
            ("l", ("liter", "litre", "liters", "litres", "升")),
            ("ml", ()),
            ("gal", ("gallon", "gallons")),
            ("oz", ("ounce", "ounces", "fl oz")),
            ("counts", ("count", "cnt")),
            ("mg", ()),
        )
    ),
)

# Words for the applied amount; a unit of a rate is an amount per area.
_AMOUNT_WORDS = {
    spelling: name
    for name, spellings in {
        "kg": "kg kgs kilo kilos kilogram kilograms kilogramm 公斤 千克",
        "g": "g gram grams gramm 克",
        "mg": "mg",
        "t": "t tonne tonnes 吨",
        "lb": "lb lbs pound pounds #",
        "l": "l lt ltr liter litre liters litres 升",
        "gal": "gal gals gallon gallons usgal",
        "m3": "m3 cbm",
        "mm3": "mm3",
        "kg N": "kgn",
        "lb N": "lbn lbsn",
        "seeds": "seed seeds sds plants kernels körner",
    }.items()
    for spelling in spellings.split()
}
# Words for the area.
_GROUND_WORDS = {
    spelling: name
    for name, spellings in {
        "ha": "ha hectare hectares hektar hm2 公顷",
        "ac": "ac acre acres",
        "m2": "m2 sqm 平方米",
        "mu": "mu 亩",
    }.items()
    for spelling in spellings.split()
}
_RATE_RATIO = re.compile(
    rf"({'|'.join(sorted(_AMOUNT_WORDS, key=len, reverse=True))})(?:/|_|·|⋅| |p(?=ha|ac))"
    rf"({'|'.join(sorted(_GROUND_WORDS, key=len, reverse=True))})(?:-1)?"
)
# Quantities of an applied amount per area.
RATE_QUANTITIES = ("rate", "volume", "nitrogen", "count")

_UNIT_BY_NAME = {unit.name: unit for unit in KNOWN_UNITS}
_UNIT_BY_SPELLING = {unit.name: unit for unit in KNOWN_UNITS} | {
    spelling: unit
    for unit in reversed(KNOWN_UNITS)
    for spelling in (unit.name.lower(), *unit.other)
}

# Unit of a log column by the ending of its name (docs/format-run-log.md); the longest matching
# ending decides.
UNIT_OF_ENDING = {
    "_kg_ha": "kg/ha",
    "_mps": "m/s",
    "_kmh": "km/h",
    "_rpm": "r/min",
    "_rpm_cmd": "r/min",
    "_mm": "mm",
    "_mm_cmd": "mm",
    "_kg": "kg",
    "_deg": "deg",
    "_v": "V",
    "_percent": "%",
    "_s": "s",
    "_m": "m",
    "_min": "min",
}
# Units as they are written in names of columns.
_UNIT_IN_NAMES = {
    "r/min": "rpm",
    "m/s": "mps",
    "km/h": "kmh",
    "%": "percent",
    SLOPE_PERCENT: "slope_percent",
}


def find_named_unit(text: str) -> ColumnUnit | None:
    """Returns the unit that a text names in any known spelling; None for another text."""
    plain = _normalise_text(text)
    return (
        _UNIT_BY_NAME.get(plain)
        or _UNIT_BY_SPELLING.get(plain)
        or _UNIT_BY_SPELLING.get(plain.lower())
        or _find_ratio_unit(plain.lower())
    )


def _find_ratio_unit(plain: str) -> ColumnUnit | None:
    """Returns the unit of an amount per area: `pounds per acre`, `l ha-1`, `kg N/ha`."""
    found = _RATE_RATIO.fullmatch(
        re.sub(r"(?<=[a-z]) n(?=\W)|-n(?=\W)", "n", plain.replace("us gal", "usgal"))
    )
    return (
        None
        if found is None
        else _UNIT_BY_NAME.get(f"{_AMOUNT_WORDS[found[1]]}/{_GROUND_WORDS[found[2]]}")
    )


def is_rate_unit(text: str) -> bool:
    """Returns whether a text names a unit of an applied amount per area."""
    found = find_named_unit(text)
    return found is not None and found.quantity in RATE_QUANTITIES


def find_quantity(column: str) -> str | None:
    """Returns the quantity of a column of the run log; None for plain numbers, texts and extra
    columns."""
    if column not in COLUMNS or column in TEXT_COLUMNS or column in WHOLE_COLUMNS:
        return None
    unit = find_column_unit(column)
    return None if unit is None else unit.quantity


def find_column_unit(column: str) -> ColumnUnit | None:
    """Returns the unit by the ending of a column's name; None for a name without a unit."""
    ending = max((one for one in UNIT_OF_ENDING if column.endswith(one)), key=len, default=None)
    return None if ending is None else _UNIT_BY_NAME[UNIT_OF_ENDING[ending]]


def convert_to_log_unit(
    values: NDArray[np.float64], unit: ColumnUnit, column: str
) -> NDArray[np.float64]:
    """Returns numbers (n,) given in `unit` in the unit of the log column. Both units must have the
    same quantity."""
    if unit.name == SLOPE_PERCENT:
        return np.degrees(np.arctan(values / 100.0))
    own = find_column_unit(column)
    return values * (unit.factor / (1.0 if own is None else own.factor))


def make_name_slug(text: str) -> str:
    """Returns a name or a unit in small letters, digits and underscores, as columns are named: `N
    m` becomes `nm`."""
    unit = find_named_unit(text)
    plain = unit.name if unit is not None else text
    if plain in _UNIT_IN_NAMES:
        return _UNIT_IN_NAMES[plain]
    folded = unicodedata.normalize("NFKC", plain)
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", "_", folded) if unit is None else folded
    return re.sub(r"[^\w]+", "_", spaced.casefold()).strip("_")


def _normalise_text(text: str) -> str:
    """Returns a text in a uniform spelling: superscripts as digits, no blanks around a slash."""
    folded = (
        unicodedata.normalize("NFKC", text).replace("−", "-").replace("⋅", "·").replace("^", "")
    )
    spaced = re.sub(r"\s+", " ", folded.strip(" .[](){}<>"))
    return re.sub(r"(?<=[^\W\d])[ _]per[ _](?=[^\W\d])|\s*/\s*", "/", spaced, flags=re.IGNORECASE)
