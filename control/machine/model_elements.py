"""Which small elements with memory or a curve do the stages share? The functions use scalars
only, so that they compile.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

Table = tuple[float, float, float, float, float, float, float, float]
TABLE_X: Table = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
FLAT_TABLE: Table = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
# Number of stored changes of a signal: 2.5 s at 400 changes a second.
LINE_SIZE = 1024


class DelayLine(NamedTuple):
    """Stores the changes of a piecewise constant signal; the oldest change is overwritten. The
    arrays are written in place.

    Compiled steps use arrays; interpreted steps use lists, which Python reads four times as fast.
    """

    times_s: Array | list[float]
    values: Array | list[float]
    newest: int
    # Index of the change that applies at the last requested time.
    in_force: int


def make_line(value: float, time_s: float = -1e9) -> DelayLine:
    """Returns a line with the value `value` since `time_s`, in arrays."""
    return DelayLine(np.full(LINE_SIZE, time_s), np.full(LINE_SIZE, value), 0, 0)


def convert_to_lists(line: DelayLine) -> DelayLine:
    """Returns the line with lists, for interpreted steps."""
    return line._replace(
        times_s=[float(time_s) for time_s in line.times_s],
        values=[float(value) for value in line.values],
    )


def put_in_line(line: DelayLine, time_s: float, value: float) -> DelayLine:
    """Records that the signal has the value `value` from `time_s` on. Times must not decrease."""
    if value == line.values[line.newest]:
        return line
    newest = (line.newest + 1) % LINE_SIZE
    line.times_s[newest] = time_s
    line.values[newest] = value
    return DelayLine(line.times_s, line.values, newest, line.in_force)


def read_held_line(line: DelayLine, from_s: float, to_s: float) -> tuple[DelayLine, float, float]:
    """Returns the signal's value at `from_s`, and the end of its validity: its next change or
    `to_s`, whichever is sooner.

    A step that is divided at these times is exact for held commands, whatever its length. Times
    must be requested in order.
    """
    at = line.in_force
    if at == line.newest:
        return line, float(line.values[at]), to_s
    while at != line.newest:
        after = (at + 1) % LINE_SIZE
        if line.times_s[after] > from_s:
            return (
                DelayLine(line.times_s, line.values, line.newest, at),
                float(line.values[at]),
                min(to_s, float(line.times_s[after])),
            )
        at = after
    return DelayLine(line.times_s, line.values, line.newest, at), float(line.values[at]), to_s


def average_line(line: DelayLine, from_s: float, to_s: float) -> tuple[DelayLine, float]:
    """Returns the mean of the held signal over [from_s, to_s], and the line with its index moved to
    `from_s`.

    The mean varies smoothly with the delay, unlike a sample, so that a dead time has a slope.
    Windows must be requested in order of time.
    """
    at = line.in_force
    while at != line.newest:
        after = (at + 1) % LINE_SIZE
        if line.times_s[after] > from_s:
            break
        at = after
    reading = at
    total = 0.0
    begin = from_s
    while at != line.newest:
        after = (at + 1) % LINE_SIZE
        if line.times_s[after] >= to_s:
            break
        total += line.values[at] * (line.times_s[after] - begin)
        begin = line.times_s[after]
        at = after
    if begin == from_s:
        mean = line.values[at]
    else:
        mean = (total + line.values[at] * (to_s - begin)) / (to_s - from_s)
    return DelayLine(line.times_s, line.values, line.newest, reading), float(mean)


def interpolate_table(x: Table, y: Table, at: float) -> float:
    """Interpolates linearly between (x, y), constant beyond the ends. The neutral table has y
    all zero."""
    i = 0
    while i < len(x) - 2 and at > x[i + 1]:
        i += 1
    share = min(1.0, max(0.0, (at - x[i]) / (x[i + 1] - x[i])))
    return y[i] + share * (y[i + 1] - y[i])


def round_to_step(value: float, step: float) -> float:
    """Rounds `value` to the nearest multiple of `step`; unchanged where `step` is 0."""
    if step <= 0.0:
        return value
    return (value / step + 0.5) // 1.0 * step
