"""What do the numbers themselves reveal? Speeds are compared with distances, answers with commands,
and numbers that mean "unknown" are found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.calibration.first_machine import is_command_per_row
from topdress.control.recordings.speed_unit import compare_with_track, identify_unit
from topdress.control.recordings.valid_values import flag_sentinels
from topdress.drivers.files.imports.units import KNOWN_UNITS

Floats = NDArray[np.float64]

# Number of each unit of speed in 1 m/s.
SPEED_FACTORS = {unit.name: 1.0 / unit.factor for unit in KNOWN_UNITS if unit.quantity == "speed"}
# Number of rows within which an answer is searched.
MAX_LAG_ROWS = 40
# Number of changes of a command that are needed to find its answer.
MIN_COMMAND_CHANGES = 8
# Smallest correlation between steps of command and answer.
MIN_CORRELATION = 0.3
# Share of the best correlation above which a lag counts as equal. Repeating commands agree at many
# lags, and the shortest lag is chosen.
EQUAL_LAG_CORRELATION_SHARE = 0.98
# Number of known rows from which a command may be a table of settings.
MIN_SETTING_ROWS = 4


class CommandAnswer(NamedTuple):
    """Holds how a reading follows its command. `lag` is in rows; `strength` is the correlation at
    that lag."""

    lag: int
    strength: float


def find_speed_unit(
    time_s: Floats, lat_deg: Floats, lon_deg: Floats, speed: Floats
) -> tuple[str | None, float]:
    """Returns the unit in which a speed gives the distance between the positions.

    Parameters
    ----------
    time_s : (n,) s.
    lat_deg, lon_deg : (n,) degrees.
    speed : (n,) in the file's unit.

    Returns
    -------
    unit (None: no unit fits), and the ratio to m/s (NaN: unknown).
    """
    columns = {"time_s": time_s, "lat_deg": lat_deg, "lon_deg": lon_deg, "speed_mps": speed}
    ratio = compare_with_track(columns, "speed_mps")
    if ratio is None:
        return None, float("nan")
    return identify_unit(ratio, SPEED_FACTORS), ratio


def find_answer(command: Floats, reading: Floats) -> CommandAnswer | None:
    """Returns how a reading (n,) follows a command (n,): the lag at which their steps agree best.
    None for too few steps."""
    both = np.isfinite(command) & np.isfinite(reading)
    command, reading = command[both], reading[both]
    if command.size < MIN_COMMAND_CHANGES + 2:
        return None
    steps, moves = np.diff(command), np.diff(reading)
    if np.count_nonzero(steps) < MIN_COMMAND_CHANGES or steps.std() == 0.0 or moves.std() == 0.0:
        return None
    # The lag is at most a quarter of the steps, so that enough of them overlap.
    most = min(MAX_LAG_ROWS, steps.size // 4)
    strengths = {lag: _calc_correlation(steps, moves, lag) for lag in range(-most, most + 1)}
    best = max(strengths.values())
    lag = min(
        (
            one
            for one, strength in strengths.items()
            if strength >= EQUAL_LAG_CORRELATION_SHARE * best
        ),
        key=abs,
        default=0,
    )
    return CommandAnswer(lag, strengths[lag])


def is_settings_table(time_s: Floats, command: Floats) -> bool:
    """Returns whether a command (n,), some of it unknown, is a table of settings, one in
    each row."""
    known = command[np.isfinite(command)]
    return known.size >= MIN_SETTING_ROWS and is_command_per_row(time_s, known)


def calc_answer_slope(command: Floats, reading: Floats) -> float:
    """Returns the reading per unit of the command, the median of their ratios where both are
    clearly above zero; NaN where unknown."""
    both = np.isfinite(command) & np.isfinite(reading)
    command, reading = command[both], reading[both]
    if not command.size:
        return float("nan")
    there = (np.abs(command) > 0.25 * np.abs(command).max()) & (
        np.abs(reading) > 0.1 * np.abs(reading).max()
    )
    return (
        float(np.median(reading[there] / command[there]))
        if np.count_nonzero(there) >= 3
        else float("nan")
    )


def find_sentinels(values: Floats, limits: tuple[float, float]) -> list[float]:
    """Returns numbers by which programs mean "unknown": numbers that the quantity cannot have, or
    that are far from all other values."""
    return [float(mark) for mark in np.unique(values[flag_sentinels(values, limits)])]


def _calc_correlation(steps: Floats, moves: Floats, lag: int) -> float:
    a, b = (
        (steps[: steps.size - lag], moves[lag:])
        if lag >= 0
        else (steps[-lag:], moves[: moves.size + lag])
    )
    if a.std() == 0.0 or b.std() == 0.0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
