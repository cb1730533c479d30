"""What do the numbers themselves show: speeds against distances, answers behind commands,
numbers that mean not known?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.calibration.first_machine import is_command_per_row
from topdress.control.recordings.speeds import compare_with_track, identify_unit
from topdress.control.recordings.values import flag_sentinels
from topdress.drivers.files.imports.units import KNOWN_UNITS

Floats = NDArray[np.float64]

# Units of speed to one m/s.
SPEED_FACTORS = {unit.name: 1.0 / unit.factor for unit in KNOWN_UNITS if unit.quantity == "speed"}
# Rows within which an answer is searched.
MAX_LAG_ROWS = 40
# Changes of a command that are needed to find its answer.
MIN_CHANGES = 8
# Correlation of steps of command and answer.
MIN_CORRELATION = 0.3
# Share of the best correlation: repeating commands agree at many lags, and the nearest wins.
EQUAL_CORRELATION_SHARE = 0.98
# Known rows of a command that may be a table of settings.
MIN_SETTINGS = 4


class CommandAnswer(NamedTuple):
    """Holds how a reading follows its command. `lag`: rows; `strength`: the correlation there."""

    lag: int
    strength: float


def find_speed_unit(
    time_s: Floats, lat_deg: Floats, lon_deg: Floats, speed: Floats
) -> tuple[str | None, float]:
    """Returns the unit in which a speed makes the distance between the places.

    Parameters
    ----------
    time_s : (n,) s.
    lat_deg : (n,).
    lon_deg : (n,).
    speed : (n,) in the file's unit.

    Returns
    -------
    unit (None : no unit fits), and the ratio to m/s (NaN: unknown).
    """
    columns = {"time_s": time_s, "lat_deg": lat_deg, "lon_deg": lon_deg, "speed_mps": speed}
    ratio = compare_with_track(columns, "speed_mps")
    if ratio is None:
        return None, float("nan")
    return identify_unit(ratio, SPEED_FACTORS), ratio


def find_answer(command: Floats, reading: Floats) -> CommandAnswer | None:
    """Returns how a reading (n,) follows a command (n,): the lag at which their steps agree
    best. None: too few steps."""
    both = np.isfinite(command) & np.isfinite(reading)
    command, reading = command[both], reading[both]
    if command.size < MIN_CHANGES + 2:
        return None
    steps, moves = np.diff(command), np.diff(reading)
    if np.count_nonzero(steps) < MIN_CHANGES or steps.std() == 0.0 or moves.std() == 0.0:
        return None
    # A quarter of the steps at most, so that enough of them overlap.
    most = min(MAX_LAG_ROWS, steps.size // 4)
    strengths = {lag: _calc_correlation(steps, moves, lag) for lag in range(-most, most + 1)}
    best = max(strengths.values())
    lag = min(
        (one for one, strength in strengths.items() if strength >= EQUAL_CORRELATION_SHARE * best),
        key=abs,
        default=0,
    )
    return CommandAnswer(lag, strengths[lag])


def is_settings_table(time_s: Floats, command: Floats) -> bool:
    """Tells whether a command (n,), some of it unknown, is a table of settings, one a row."""
    known = command[np.isfinite(command)]
    return known.size >= MIN_SETTINGS and is_command_per_row(time_s, known)


def calc_answer_slope(command: Floats, reading: Floats) -> float:
    """Returns the reading for one of the command, where both are clearly there: the median of
    their ratios; NaN: not known."""
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
    """Returns numbers by which programs say "not known": where the quantity cannot have them, or
    where no other value comes near."""
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
