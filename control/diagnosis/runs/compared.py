"""Compares two machine files on the same log: the error of each channel under either file, and the
difference.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit
from topdress.control.diagnosis.dataframe_input import LogTable, load_machine, read_columns
from topdress.control.diagnosis.result import load_notebook_module
from topdress.control.machine.machine import Machine
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import ChannelSeries, make_channels
from .findings import note_reverse_turning
from .held_out import HeldOut, list_held_out_errors
from .hypothesis import list_stages, make_schedule
from .log import CleanLog, clean_run_log
from .row_order import find_row_order, shift_log_columns
from .stages import make_run_data

Array = npt.NDArray[np.float64]

# Maximum and minimum number of blocks of a channel; fewer blocks give no estimate of the spread.
MAX_BLOCKS, MIN_BLOCKS = 24, 4
# Length of a block in correlation times of the squared errors: longer blocks are nearly
# independent.
BLOCK_MEMORIES = 5.0
# Probability of the interval, as everywhere in a diagnosis.
INTERVAL_PROB = 0.90


class ComparedChannel(NamedTuple):
    """Errors of one channel under both machine files; no size is fitted.

    unit : of all figures. old, new : r.m.s. of measured minus predicted. low, high : 90 % interval
    of old minus new by a jackknife over blocks of time, NaN where the log is too short. time_s,
    measured, of_old, of_new : series (m,) for pictures: time in the log, reading, and the
    prediction of each file.
    """

    channel: str
    unit: str
    old: float
    new: float
    low: float
    high: float
    time_s: Array
    measured: Array
    of_old: Array
    of_new: Array


class Compared(NamedTuple):
    """Errors of all channels of a log under two machine files. findings : sentences about the data
    for the user."""

    channels: tuple[ComparedChannel, ...]
    findings: tuple[str, ...]

    def __str__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Errors of each channel under both machine files as text, a line for each channel."""
        return str(load_notebook_module().summarise_compared(self))

    def plot(self) -> Any:
        """Draw a picture of each channel, as `Diagnosis.plot` does."""
        return load_notebook_module().draw_compared(self)

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows below a cell that ends with a comparison."""
        return str(self.plot()._repr_html_())


class _PredictedSeries(NamedTuple):
    """A channel's series on its grid, (m,), with its prediction."""

    series: ChannelSeries
    predicted: Array


def compared(
    columns: LogTable,
    old: Machine | str,
    new: Machine | str,
    step: Callable[[float, str], None] = lambda share, word: None,
) -> Compared:
    """Compare how well two machine files predict a run log, channel by channel; nothing is fitted
    to the log.

    Parameters
    ----------
    columns
        Columns of shape (n,) by the run log's names and units, in any form that `diagnose_run`
        takes.
    old, new
        The machine files, or their paths or shipped names. The settings of `old` decide how rows
        are sorted and gaps bridged, for both files.
    step
        `step(share, word)` is called between channels; an exception from it ends the work.

    Returns
    -------
    Compared
        A channel for each that the log can show under both files: shaft (r/min), gate (mm),
        flow (kg/s, means over 10 s of the scale), scale (kg), speed (wheel minus GNSS, m/s),
        heads (NDVI).

    Raises
    ------
    ValueError
        One line, where there is no time column or fewer rows than a diagnosis needs.

    Examples
    --------
    A shaft that turns 4 % faster than its command, and a machine file that declares this gain:

    >>> import numpy as np
    >>> from topdress.control.machine.machine import Machine, add_effect
    >>> rng, time_s = np.random.default_rng(1), np.arange(0.0, 240.0, 0.1)
    >>> command = np.where(time_s % 20.0 < 10.0, 40.0, 60.0)
    >>> columns = {"time_s": time_s, "shaft_rpm_cmd": command, "supply_v": np.full(2400, 13.5),
    ...            "shaft_rpm": 1.04 * np.roll(command, 4) + 0.3 * rng.standard_normal(2400)}
    >>> shaft = compared(columns, Machine(), add_effect(Machine(), "shaft.gain", 4.0)).channels[0]
    >>> shaft.channel, shaft.new < shaft.old, shaft.low > 0.0
    ('shaft', True, True)
    """
    old, new = load_machine(old), load_machine(new)
    log = clean_run_log(read_columns(columns), old.has_stage)
    log = shift_log_columns(log, find_row_order(log, old))
    step(0.1, "data")
    # Numerical warnings are silenced, because a channel without finite numbers is left out below.
    with np.errstate(all="ignore"):
        of_old = _predict_channels(log, old, old, lambda share, word: step(0.1 + 0.4 * share, word))
        of_new = _predict_channels(log, new, old, lambda share, word: step(0.5 + 0.4 * share, word))
        found = [
            one
            for name, series in of_old.items()
            if name in of_new and len(series.predicted) == len(of_new[name].predicted)
            for one in _list_compared_channels(series, of_new[name])
        ]
    step(1.0, "")
    return Compared(tuple(found), (*log.findings, *note_reverse_turning(log, old, counted=True)))


def _predict_channels(
    log: CleanLog, machine: Machine, other: Machine, step: Callable[[float, str], None]
) -> dict[str, _PredictedSeries]:
    """Predict every channel that the log can show with a machine file, on the rows that the sensors
    of `other` can judge.

    Rows that command a shaft beyond the limits of its file are included, for the limit may be the
    file's error.
    """
    shaft = machine.shaft._replace(one_way=0.0)
    seen = make_channels(
        make_run_data(log, machine.model_copy(update={"shaft": shaft, "noise": other.noise})),
        machine,
    )
    plan = make_schedule(list_stages(machine), ())
    found = {}
    for number, (name, series) in enumerate(seen.items()):
        step(number / len(seen), name)
        found[name] = _PredictedSeries(series, series.predict(plan, MAX_MODEL_STEP_S))
    return found


def _list_compared_channels(old: _PredictedSeries, new: _PredictedSeries) -> list[ComparedChannel]:
    """Return the compared channel itself, and for the scale also the flow, because the scale is
    there to measure the flow."""
    name, unit = old.series.name, old.series.unit
    measured = old.series.measured
    time_s = np.tile(old.series.grid.even_s, old.series.copies)
    found = [
        _compare_errors(
            name,
            unit,
            measured - old.predicted,
            measured - new.predicted,
            time_s=time_s,
            measured=measured,
            of_old=old.predicted,
            of_new=new.predicted,
        )
    ]
    if name == "scale":
        whole = HeldOut(old.series, old.series, (slice(0, len(measured)),))
        flow, flow_unit, before, after = list_held_out_errors(
            whole, measured - old.predicted, measured - new.predicted
        )
        read = list_held_out_errors(whole, measured, measured)[2]
        at = np.interp(
            np.linspace(0.0, 1.0, len(before)), np.linspace(0.0, 1.0, len(time_s)), time_s
        )
        if len(before):
            found.insert(
                0,
                _compare_errors(
                    flow,
                    flow_unit,
                    before,
                    after,
                    time_s=at,
                    measured=read,
                    of_old=read - before,
                    of_new=read - after,
                ),
            )
    return [one for one in found if np.isfinite([one.old, one.new]).all()]


def _compare_errors(
    name: str,
    unit: str,
    before: Array,
    after: Array,
    *,
    time_s: Array,
    measured: Array,
    of_old: Array,
    of_new: Array,
) -> ComparedChannel:
    low, high = calc_rms_interval(before, after)
    return ComparedChannel(
        name, unit, calc_rms(before), calc_rms(after), low, high, time_s, measured, of_old, of_new
    )


def calc_rms(errors: Array) -> float:
    """Return the root mean square of errors (m,)."""
    return float(np.sqrt(np.mean(np.square(errors))))


def calc_rms_interval(before: Array, after: Array) -> tuple[float, float]:
    """Return the 90 % interval of rms(before) - rms(after), for errors (m,) of the same rows.

    The interval is a jackknife over blocks of time. Errors within a block are correlated, so blocks
    are counted, not rows (Kunsch, Annals of Statistics 17, 1989). The result is NaN, NaN for fewer
    than MIN_BLOCKS blocks.
    """
    count = int(
        min(
            MAX_BLOCKS,
            max(
                MIN_BLOCKS,
                len(before)
                / (BLOCK_MEMORIES * max(_calc_memory_rows(before), _calc_memory_rows(after))),
            ),
        )
    )
    if len(before) < 2 * MIN_BLOCKS:
        return np.nan, np.nan
    parts = [
        np.array(
            [[len(piece), np.sum(np.square(piece))] for piece in np.array_split(errors, count)]
        )
        for errors in (before, after)
    ]
    without = [
        np.sqrt((np.sum(part[:, 1]) - part[:, 1]) / (np.sum(part[:, 0]) - part[:, 0]))
        for part in parts
    ]
    left_out = without[0] - without[1]
    sd = float(np.sqrt((count - 1) / count * np.sum(np.square(left_out - left_out.mean()))))
    half = float(stdtrit(count - 1, 0.5 + 0.5 * INTERVAL_PROB)) * sd
    difference = calc_rms(before) - calc_rms(after)
    return difference - half, difference + half


def _calc_memory_rows(errors: Array) -> float:
    """Return the correlation time of the squared errors (m,) in rows, as the time constant of a
    first-order noise, at least 1 row."""
    squares = np.square(errors) - np.mean(np.square(errors))
    total = float(np.sum(np.square(squares)))
    alike = float(np.sum(squares[1:] * squares[:-1])) / total if total > 0.0 else 0.0
    return max(1.0, -1.0 / float(np.log(alike))) if 0.0 < alike < 1.0 else 1.0
