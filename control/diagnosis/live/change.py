"""The sequential test: has an effect started within the last minutes?

The window-limited generalised likelihood ratio of Willsky and Jones (IEEE Transactions on Automatic Control 21, 1976,
108), whose run length Lai (IEEE Transactions on Information Theory 44, 1998, 2917) shows to be the best that a window
allows: at each look every effect of the catalogue is tried with every time of beginning in the window, on the residual
whitened by the noise that is fitted to it, with the drift of the hour before (`runs/changepoint.py`, on the series of
`rolling`). The bar that the largest gain must pass sets the run length between false alarms; healthy logs set it
(benchmarks/live_check.py).

Only effects that are a straight line in their size are tried: dead times, bands and play are taken for each other in so
short a stretch, and wait for the full diagnosis of a quarter of an hour.
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.runs.hypothesis import EffectInstance
from control.machine.machine import Machine

from .rolling import Rolling, Rows


class ChangePoint(NamedTuple):
    """The likeliest beginning in one group of channels."""

    group: str
    part: EffectInstance                  # its onset in s of the log
    gain: float                 # of twice the log-likelihood


class Beginnings:
    """Asked again and again of a log that grows: what was worked out for the rows before is kept."""

    def __init__(self, machine: Machine) -> None:
        self._rolling = Rolling(machine)

    def __call__(self, rows: Rows, now_s: float) -> list[ChangePoint]:
        """For each group of channels that the rows can show, what likeliest began within the last minutes.

        rows : columns of a run log since a time. Raises ValueError in one line where nothing can be judged.
        """
        self._rolling.take(rows, now_s)
        best = {group: self._rolling.best(group) for group in self._rolling.groups}
        return [ChangePoint(group, found.part, found.gain) for group, found in best.items() if found is not None]


def change_points(columns: Mapping[str, npt.NDArray[Any]], machine: Machine) -> list[ChangePoint]:
    """The same asked once, of the end of a log."""
    time_s = np.asarray(columns["time_s"])

    def since(begin_s: float) -> dict[str, npt.NDArray[Any]]:
        return {name: np.asarray(column)[time_s >= begin_s] for name, column in columns.items()}
    return Beginnings(machine)(since, float(time_s[-1]))
