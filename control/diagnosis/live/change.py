"""The sequential test: has an effect begun within the last minutes?

The window-limited generalised likelihood ratio of Willsky and Jones (IEEE Transactions on Automatic Control 21, 1976,
108), whose run length Lai (IEEE Transactions on Information Theory 44, 1998, 2917) shows to be the best that a window
allows: at each look every effect of the catalogue is tried with every time of beginning in the window, on the residual
whitened by the noise that the diagnosis fits (`runs/changes.py`: the same columns, the same noise). The bar that the
largest gain must pass sets the run length between false alarms; healthy logs set it (benchmarks/live_check.py).

Only effects that are a straight line in their size are tried: dead times, bands and play are taken for each other in so
short a stretch, and wait for the full diagnosis of a quarter of an hour.
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.diagnosis.runs.changes import changes
from control.diagnosis.runs.channels import channels
from control.diagnosis.runs.diagnose import series_of_log
from control.diagnosis.runs.hypothesis import Part
from control.diagnosis.runs.model import GROUPS
from control.diagnosis.runs.robust import draw_in
from control.diagnosis.runs.search import Search
from control.machine.machine import Machine

WINDOW_S = 600.0            # in which an effect begins: a level takes minutes to show a flow


class Begun(NamedTuple):
    """The likeliest beginning in one group of channels."""

    group: str
    part: Part                  # its onset in s of the log
    gain: float                 # of twice the log-likelihood


def begun(columns: Mapping[str, npt.NDArray[Any]], machine: Machine) -> list[Begun]:
    """For each group of channels that the columns of a run log can show, what likeliest began within them.

    Raises ValueError in one line where nothing can be judged.
    """
    begin_s = float(np.asarray(columns["time_s"])[0])
    _, data, _ = series_of_log(columns, machine)
    seen = channels(data, machine)
    found = []
    for group, names in GROUPS.items():
        members = [seen[name] for name in names if name in seen]
        if not members:
            continue
        search = Search(members, machine, data)
        draw_in(search.columns, (), [])
        straight = [each for each in search.candidates if ROWS[each.part.id].probe is not None]
        for best in changes(search.columns, (), search.model.noise, straight)[:1]:
            onset_s = max(begin_s, best.part.onset_s or begin_s)
            found.append(Begun(group, best.part._replace(onset_s=onset_s), best.gain))
    return found
