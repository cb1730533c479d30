"""The values of a log: sentinels, positions, NDVI and units that cannot be what their column says."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from control.log_limits import SENTINELS, stand_for_nothing
from control.log_row import HEAD_COLUMNS, NDRE_COLUMNS, PLAUSIBLE, SPEEDS
from drivers.files.findings import Finding, many
from drivers.files.table import Columns

Floats = NDArray[np.float64]


_HEADS = (*HEAD_COLUMNS, "ndvi")

# Left out where they stand outside: NDVI by its definition, places by theirs.
_EMPTIED_OUTSIDE = frozenset({"lat_deg", "lon_deg", *_HEADS, *NDRE_COLUMNS, "ndre"})

_M_PER_DEG = 111_200.0       # one percent is enough to tell units apart
_CHORD_S = 5.0
_MOVING_MPS = 0.3
_UNITS = {"km/h": 3.6, "knots": 1.944, "mph": 2.237}
_UNIT_TOLERANCE = 0.08
_FAST_MPS = 8.0              # no spreader works at more than 29 km/h


def with_good_values(columns: Columns) -> tuple[Columns, list[Finding]]:
    """The columns put right, and what was found. Arrays that change are copied."""
    columns = dict(columns)
    findings: list[Finding] = []
    no_latitude = np.isin(columns.get("lat_deg", np.zeros_like(columns["time_s"])), SENTINELS)
    for name, limits in PLAUSIBLE.items():
        if name in columns:
            columns[name] = _without_sentinels(name, columns[name], limits, findings,
                                               no_latitude if name == "lon_deg" else None)
    _positions(columns, findings)
    for name in _HEADS:
        _percent(name, columns, findings)
    for name, limits in PLAUSIBLE.items():
        if name in columns:
            columns[name] = _inside(name, columns[name], limits, findings)
    _speed_units(columns, findings)
    return columns, findings


def _without_sentinels(name: str, values: Floats, limits: tuple[float, float], findings: list[Finding],
                       inside: NDArray[np.bool_] | None) -> Floats:
    """A number inside the limits is one where it is far larger than all others; or in the rows `inside`, where given.

    For longitudes those in which the latitude is one: -99 degrees next to a latitude is a place in Mexico.
    """
    sentinel = stand_for_nothing(values, limits, inside)
    count = int(sentinel.sum())
    if count == 0:
        return values
    kinds = ", ".join(f"{value:g}" for value in np.unique(values[sentinel])[:3])
    findings.append(Finding("sentinel", f"column {name}: {many(count, 'value')} {kinds} emptied: not known", name,
                            count))
    return np.where(sentinel, np.nan, values)


def _positions(columns: Columns, findings: list[Finding]) -> None:
    if "lat_deg" not in columns or "lon_deg" not in columns:
        return
    lat_deg, lon_deg = columns["lat_deg"], columns["lon_deg"]
    nowhere = (lat_deg == 0.0) & (lon_deg == 0.0)
    if nowhere.any():
        count = int(nowhere.sum())
        findings.append(Finding("zero_position", f"{many(count)} with latitude and longitude 0: place emptied, not "
                                "known", "lat_deg", count))
        lat_deg, lon_deg = np.where(nowhere, np.nan, lat_deg), np.where(nowhere, np.nan, lon_deg)
    known = np.isfinite(lat_deg) & np.isfinite(lon_deg)
    if known.any() and np.mean(np.abs(lat_deg[known]) > 90.0) > 0.5 and np.all(np.abs(lon_deg[known]) <= 90.0):
        findings.append(Finding("swapped_position", "lat_deg and lon_deg are exchanged (latitudes beyond 90): put "
                                "right", "lat_deg", int(known.sum())))
        lat_deg, lon_deg = lon_deg, lat_deg
    elif _fits_swapped(columns, lat_deg, lon_deg):
        findings.append(Finding("swapped_position_likely", "lat_deg and lon_deg look exchanged (the headings fit only "
                                "then): left as they are", "lat_deg"))
    columns["lat_deg"], columns["lon_deg"] = lat_deg, lon_deg


def _fits_swapped(columns: Columns, lat_deg: Floats, lon_deg: Floats) -> bool:
    """Whether headings agree with the places exchanged, and do not as they stand."""
    heading_deg = columns.get("heading_deg")
    if heading_deg is None:
        return False
    chord = _chords(columns["time_s"], lat_deg, lon_deg)
    if chord is None:
        return False
    start, end, east_m, north_m = chord
    steady = np.abs(_turn_deg(heading_deg[start], heading_deg[end])) < 10.0
    far = steady & (np.hypot(east_m, north_m) > 1.0)
    if far.sum() < 5:
        return False
    swapped = _chords(columns["time_s"], lon_deg, lat_deg)
    if swapped is None:
        return False
    as_is_deg = np.abs(_turn_deg(heading_deg[start], np.degrees(np.arctan2(east_m, north_m))))[far]
    other_deg = np.abs(_turn_deg(heading_deg[start], np.degrees(np.arctan2(swapped[2], swapped[3]))))[far]
    return bool(np.median(other_deg) < 5.0 and np.median(as_is_deg) > 10.0)


def _turn_deg(from_deg: Floats, to_deg: Floats) -> Floats:
    turn: Floats = (to_deg - from_deg + 180.0) % 360.0 - 180.0
    return turn


def _chords(time_s: Floats, lat_deg: Floats, lon_deg: Floats
            ) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats] | None:
    """First row, last row, metres east and north of pieces of track about five seconds long."""
    known = np.flatnonzero(np.isfinite(lat_deg) & np.isfinite(lon_deg))
    if known.size < 2:
        return None
    told_s = time_s[known]
    piece = np.floor((told_s - told_s[0]) / _CHORD_S)           # a bounded work, however far apart the times are
    begins = np.flatnonzero(np.diff(piece, prepend=-1.0) > 0.0)
    picked = known[begins[told_s[0] + piece[begins] * _CHORD_S < told_s[-1]]]
    start, end = picked[:-1], picked[1:]
    north_m = (lat_deg[end] - lat_deg[start]) * _M_PER_DEG
    east_m = (lon_deg[end] - lon_deg[start]) * _M_PER_DEG * np.cos(np.radians(lat_deg[start]))
    return start, end, east_m, north_m


def _percent(name: str, columns: Columns, findings: list[Finding]) -> None:
    values = columns.get(name)
    if values is None:
        return
    known = values[np.isfinite(values)]
    if known.size and np.median(known) > 1.0 and known.min() >= 0.0 and known.max() <= 100.0:
        findings.append(Finding("ndvi_percent", f"column {name} is in percent: divided by 100", name, int(known.size)))
        columns[name] = values / 100.0


def _inside(name: str, values: Floats, limits: tuple[float, float], findings: list[Finding]) -> Floats:
    outside = (values < limits[0]) | (values > limits[1])
    count = int(np.count_nonzero(outside))
    if count == 0:
        return values
    example = f"{values[outside][0]:g}"
    allowed = f"allowed {limits[0]:g} to {limits[1]:g}"
    if name in _EMPTIED_OUTSIDE:
        findings.append(Finding("outside", f"column {name}: {many(count, 'value')} such as {example} emptied: "
                                f"{allowed}", name, count))
        return np.where(outside, np.nan, values)
    findings.append(Finding("implausible", f"column {name}: {many(count, 'value')} such as {example}, {allowed}: left "
                            "as read", name, count))
    return values


def _speed_units(columns: Columns, findings: list[Finding]) -> None:
    for name in SPEEDS:
        if name not in columns:
            continue
        ratio = speed_over_track(columns, name)
        unit = _unit_of(ratio)
        if unit is not None:
            findings.append(Finding("speed_unit", f"column {name} is in {unit} (it is {ratio:.2f} times the speed "
                                    "along the track): divided", name))
            columns[name] = columns[name] / _UNITS[unit]
        elif ratio is None:
            moving = columns[name][columns[name] > _MOVING_MPS]
            if moving.size and np.median(moving) > _FAST_MPS:
                findings.append(Finding("speed_unit_likely", f"column {name} looks like km/h (median "
                                        f"{np.median(moving):.1f}); no places to tell by: left as read", name))


def _unit_of(ratio: float | None) -> str | None:
    if ratio is None:
        return None
    return next((unit for unit, factor in _UNITS.items() if abs(ratio / factor - 1.0) < _UNIT_TOLERANCE), None)


def speed_over_track(columns: Columns, name: str) -> float | None:
    """Median of a speed column over the speed between places; None where there is not enough to say."""
    if "lat_deg" not in columns or "lon_deg" not in columns:
        return None
    chord = _chords(columns["time_s"], columns["lat_deg"], columns["lon_deg"])
    if chord is None:
        return None
    start, end, east_m, north_m = chord
    track_mps = np.hypot(east_m, north_m) / (columns["time_s"][end] - columns["time_s"][start])
    said = (columns[name][start] + columns[name][end]) / 2.0
    usable = (track_mps > _MOVING_MPS) & (said > _MOVING_MPS)
    return float(np.median(said[usable] / track_mps[usable])) if usable.sum() >= 5 else None
