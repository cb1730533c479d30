"""Which unit does a speed column have? The way between places, or another speed, shows it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import SPEED_COLUMNS
from topdress.control.recordings.finding import Finding
from topdress.control.recordings.place_check import cut_track_pieces

Floats = NDArray[np.float64]

KMH_PER_MPS = 3.6
# International miles of 1959 and of 1929, m.
MILE_M, NAUTICAL_MILE_M = 1609.344, 1852.0
KNOTS_PER_MPS, MPH_PER_MPS = 3600.0 / NAUTICAL_MILE_M, 3600.0 / MILE_M
UNITS = {"km/h": KMH_PER_MPS, "knots": KNOTS_PER_MPS, "mph": MPH_PER_MPS}
# Relative tolerance of a unit's factor: a wheel slips, or its radius is wrong.
UNIT_TOLERANCE = 0.11
# Below this, m/s, a speed may be held at zero and a course is noise.
MOVING_MPS = 0.3
# No spreader works faster than 29 km/h.
IMPLAUSIBLE_MPS = 8.0
# Least number of pieces of track for a ratio.
MIN_TRACK_PIECES = 5
# Least number of moving rows: four seconds at 10 Hz, as long as a piece of track.
MIN_MOVING_ROWS = 40


def identify_unit(ratio: float, units: Mapping[str, float] = UNITS) -> str | None:
    """Returns the unit of a speed whose numbers are `ratio` times those in m/s; None where it is
    none of these units.

    The nearest unit by its factor is taken if a wheel's slip can explain the rest. units:
    numbers for 1 m/s."""
    near = min(
        (*units.items(), ("m/s", 1.0)), key=lambda one: abs(np.log(max(ratio, 1e-9) / one[1]))
    )
    return near[0] if near[0] in units and abs(ratio / near[1] - 1.0) < UNIT_TOLERANCE else None


def compare_with_track(columns: Mapping[str, NDArray[Any]], name: str) -> float | None:
    """Returns the median of a speed column over the speed between places; None where there are
    too few rows."""
    if "lat_deg" not in columns or "lon_deg" not in columns:
        return None
    found = cut_track_pieces(columns["time_s"], columns["lat_deg"], columns["lon_deg"])
    if found is None:
        return None
    start, end, east_m, north_m = found
    track_mps = np.hypot(east_m, north_m) / (columns["time_s"][end] - columns["time_s"][start])
    said = (columns[name][start] + columns[name][end]) / 2.0
    usable = (track_mps > MOVING_MPS) & (said > MOVING_MPS)
    return (
        float(np.median(said[usable] / track_mps[usable]))
        if usable.sum() >= MIN_TRACK_PIECES
        else None
    )


def mend_speeds(columns: dict[str, NDArray[Any]], findings: list[Finding]) -> None:
    """Converts speeds of other units where places or another speed prove them; a speed that is
    only implausibly fast is reported.

    The other speed proves km/h alone: a wheel that reads twice the speed may just as well count
    its pulses twice."""
    for name in SPEED_COLUMNS:
        if name not in columns:
            continue
        ratio, by = compare_with_track(columns, name), "the speed along the track"
        unit = None if ratio is None else identify_unit(ratio)
        if ratio is None:
            ratio, by = compare_with_other(columns, name)
            unit = None if ratio is None else identify_unit(ratio, {"km/h": KMH_PER_MPS})
            if unit is None:
                _report_doubt(name, columns[name], findings)
        if unit is not None:
            findings.append(
                Finding(
                    "speed_unit",
                    f"column {name} is in {unit} (it is {ratio:.2f} times {by}): divided",
                    name,
                )
            )
            columns[name] = columns[name] / UNITS[unit]


def compare_with_other(columns: Mapping[str, NDArray[Any]], name: str) -> tuple[float | None, str]:
    """Returns the median of a moving speed over that of the first other speed column, and the
    other's name."""
    own = _find_typical_speed(columns[name])
    for other in SPEED_COLUMNS:
        if other != name and other in columns and own is not None:
            theirs = _find_typical_speed(columns[other])
            if theirs is not None:
                return own / theirs, other
    return None, ""


def _find_typical_speed(speed: Floats) -> float | None:
    moving = speed[speed > MOVING_MPS]
    return float(np.median(moving)) if moving.size > MIN_MOVING_ROWS else None


def _report_doubt(name: str, speed: Floats, findings: list[Finding]) -> None:
    moving = speed[speed > MOVING_MPS]
    if moving.size and np.median(moving) > IMPLAUSIBLE_MPS:
        findings.append(
            Finding(
                "speed_unit_likely",
                f"column {name} looks like km/h (median {np.median(moving):.1f}); "
                "no places to tell by: left as read",
                name,
            )
        )
