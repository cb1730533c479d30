"""Which colours do rates, errors and passes have? The scale of rates is perceptually uniform and
safe for colour-blind eyes, from the screen's dark to its light end.

The scales are straight lines in OKLab (B. Ottosson, 2020, "A perceptual color space for image
processing"). Rates go from a dark blue over a full green to a light yellow: lightness rises
uniformly, blue to yellow is the axis that all common colour deficiencies preserve, and the middle
is a colour instead of the grey half-way between the ends. Errors go from a dark blue (too little)
over a pale grey (right) to a dark orange (too much). Passes go from that blue (once) to that orange
(overlap).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from math import ceil, floor

Rgb = tuple[int, int, int]
Lab = tuple[float, float, float]

_LOW_RATE: Lab = (0.38, -0.015, -0.135)
_MIDDLE_RATE: Lab = (0.62, -0.105, 0.030)
_HIGH_RATE: Lab = (0.86, -0.020, 0.165)
_TOO_LITTLE: Lab = (0.42, -0.02, -0.16)
_RIGHT_RATE: Lab = (0.88, 0.0, 0.0)
_TOO_MUCH: Lab = (0.58, 0.12, 0.12)


def _convert_to_srgb(lab: Lab) -> Rgb:
    lightness, a, b = lab
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    medium = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    linear = (
        4.0767416621 * long - 3.3077115913 * medium + 0.2309699292 * short,
        -1.2684380046 * long + 2.6097574011 * medium - 0.3413193965 * short,
        -0.0041960863 * long - 0.7034186147 * medium + 1.7076147010 * short,
    )

    def encode_channel(value: float) -> int:
        value = min(1.0, max(0.0, value))
        value = 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055
        return round(255 * value)

    red, green, blue = (encode_channel(value) for value in linear)
    return red, green, blue


@cache
def _calc_rate_colour(step: int, steps: int) -> Rgb:
    share = 2.0 * step / (steps - 1)
    return _convert_to_srgb(
        _interpolate_lab(_LOW_RATE, _MIDDLE_RATE, share)
        if share < 1.0
        else _interpolate_lab(_MIDDLE_RATE, _HIGH_RATE, share - 1.0)
    )


@cache
def _calc_error_colour(step: int, steps: int) -> Rgb:
    share = 2.0 * step / (steps - 1) - 1.0
    return _convert_to_srgb(
        _interpolate_lab(_RIGHT_RATE, _TOO_MUCH if share > 0.0 else _TOO_LITTLE, abs(share))
    )


def _interpolate_lab(begin: Lab, end: Lab, share: float) -> Lab:
    lightness, a, b = (low + share * (high - low) for low, high in zip(begin, end, strict=True))
    return lightness, a, b


@cache
def _calc_passes_colour(step: int, steps: int) -> Rgb:
    return _convert_to_srgb(_interpolate_lab(_TOO_LITTLE, _TOO_MUCH, step / (steps - 1)))


COLOUR_STEPS = 32


def find_rate_colour(share: float) -> Rgb:
    """Returns the sRGB colour (0 to 255 each) of a rate; share 0 is the low end, 1 the high end,
    and shares outside are clamped."""
    return _calc_rate_colour(round(min(1.0, max(0.0, share)) * (COLOUR_STEPS - 1)), COLOUR_STEPS)


def find_error_colour(share: float) -> Rgb:
    """Returns the sRGB colour of an error; share 0 is the largest shortfall, 0.5 is right, 1 the
    largest excess."""
    return _calc_error_colour(round(min(1.0, max(0.0, share)) * (COLOUR_STEPS - 1)), COLOUR_STEPS)


def find_passes_colour(share: float) -> Rgb:
    """Returns the sRGB colour of the number of passes; share 0 is one pass, 1 two or more."""
    return _calc_passes_colour(round(min(1.0, max(0.0, share)) * (COLOUR_STEPS - 1)), COLOUR_STEPS)


def round_calm_ends(
    values: Iterable[float], step: float = 50.0, least: float = 100.0
) -> tuple[float, float]:
    """Returns round ends of a scale that contains all values and does not change with every sample.

    The ends are multiples of `step` and at least `least` apart. Below `least` the scale begins at
    0; without values it is 0 ... `least`.
    """
    values = list(values)
    if not values:
        return 0.0, least
    low = floor(min(values) / step) * step
    low = 0.0 if low < least else low
    high = ceil(max(values) / step) * step
    if high - low < least:
        high = low + least
    return low, high
