"""Are the places of a recording plausible? 0, 0 is no place, and latitude and longitude may be
exchanged; pieces of track between places."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from topdress.control.recordings.finding import Finding, many

Floats = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]

# Length of a degree of latitude, m; one percent is enough to tell units apart.
METRES_PER_DEGREE = 111_200.0
# Length of a piece of track, s: at 1 m/s fifty times a receiver's noise from place to place.
PIECE_S = 5.0
# A piece is straight where the heading turns by less than this, degrees.
STRAIGHT_DEG = 10.0
# Least length of a piece whose course is used, m.
MIN_PIECE_M = 1.0
# Least number of straight pieces.
MIN_STRAIGHT_PIECES = 5
# Mean difference of headings and courses, degrees: below the first they agree, above the second
# they do not.
AGREEING_DEG, DISAGREEING_DEG = 5.0, 10.0


def mend_places(columns: Columns, findings: list[Finding]) -> None:
    """Blanks places that are none, exchanges coordinates where latitudes prove it, and reports a
    doubt where only headings suggest it."""
    if "lat_deg" not in columns or "lon_deg" not in columns:
        return
    lat_deg, lon_deg = columns["lat_deg"], columns["lon_deg"]
    nowhere = (lat_deg == 0.0) & (lon_deg == 0.0)
    if nowhere.any():
        count = int(nowhere.sum())
        findings.append(
            Finding(
                "zero_position",
                f"{many(count)} with latitude and longitude 0: place emptied, not known",
                "lat_deg",
                count,
            )
        )
        lat_deg, lon_deg = np.where(nowhere, np.nan, lat_deg), np.where(nowhere, np.nan, lon_deg)
    known = np.isfinite(lat_deg) & np.isfinite(lon_deg)
    if (
        known.any()
        and np.mean(np.abs(lat_deg[known]) > 90.0) > 0.5
        and np.all(np.abs(lon_deg[known]) <= 90.0)
    ):
        findings.append(
            Finding(
                "swapped_position",
                "lat_deg and lon_deg are exchanged (latitudes beyond 90): put right",
                "lat_deg",
                int(known.sum()),
            )
        )
        lat_deg, lon_deg = lon_deg, lat_deg
    elif _are_places_swapped(columns, lat_deg, lon_deg):
        findings.append(
            Finding(
                "swapped_position_likely",
                "lat_deg and lon_deg look exchanged (the headings fit only then): left as they are",
                "lat_deg",
            )
        )
    columns["lat_deg"], columns["lon_deg"] = lat_deg, lon_deg


def _are_places_swapped(columns: Columns, lat_deg: Floats, lon_deg: Floats) -> bool:
    """Returns whether headings agree with the exchanged places but not with the places as they
    stand."""
    heading_deg = columns.get("heading_deg")
    if heading_deg is None:
        return False
    chord = cut_track_pieces(columns["time_s"], lat_deg, lon_deg)
    if chord is None:
        return False
    start, end, east_m, north_m = chord
    steady = np.abs(_calc_turns_deg(heading_deg[start], heading_deg[end])) < STRAIGHT_DEG
    far = steady & (np.hypot(east_m, north_m) > MIN_PIECE_M)
    if far.sum() < MIN_STRAIGHT_PIECES:
        return False
    swapped = cut_track_pieces(columns["time_s"], lon_deg, lat_deg)
    if swapped is None:
        return False
    as_is_deg = np.abs(
        _calc_turns_deg(heading_deg[start], np.degrees(np.arctan2(east_m, north_m)))
    )[far]
    other_deg = np.abs(
        _calc_turns_deg(heading_deg[start], np.degrees(np.arctan2(swapped[2], swapped[3])))
    )[far]
    return bool(np.median(other_deg) < AGREEING_DEG and np.median(as_is_deg) > DISAGREEING_DEG)


def _calc_turns_deg(from_deg: Floats, to_deg: Floats) -> Floats:
    turn: Floats = (to_deg - from_deg + 180.0) % 360.0 - 180.0
    return turn


def cut_track_pieces(
    time_s: Floats, lat_deg: Floats, lon_deg: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats] | None:
    """Returns first row, last row, metres east and metres north of pieces of track about five
    seconds long."""
    known = np.flatnonzero(np.isfinite(lat_deg) & np.isfinite(lon_deg))
    if known.size < 2:
        return None
    known_s = time_s[known]
    # Numbering pieces by rows bounds the work, however far apart the times are.
    piece = np.floor((known_s - known_s[0]) / PIECE_S)
    begins = np.flatnonzero(np.diff(piece, prepend=-1.0) > 0.0)
    picked = known[begins[known_s[0] + piece[begins] * PIECE_S < known_s[-1]]]
    start, end = picked[:-1], picked[1:]
    north_m = (lat_deg[end] - lat_deg[start]) * METRES_PER_DEGREE
    east_m = (
        (lon_deg[end] - lon_deg[start]) * METRES_PER_DEGREE * np.cos(np.radians(lat_deg[start]))
    )
    return start, end, east_m, north_m
