"""Which channels can the Trends page plot? The numbers of a log row as they are declared in
`control.signals`, and the rate error.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from topdress.console.app.panel_views import find_rate_error
from topdress.console.app.units import Unit, Units, choose_unit
from topdress.console.locale import N_
from topdress.control.log_row import COLUMNS, NDRE_COLUMNS, TEXT_COLUMNS, LogRow
from topdress.control.signals import SIGNALS, Signal


class TrendChannel(NamedTuple):
    """Describes a channel. `id` is the log's column; channels of one `group` share their scale when
    they are plotted together."""

    id: str
    label: str
    unit: Callable[[Units], Unit]
    group: str = ""


# This channel is calculated, so no column of the log has its name.
RATE_ERROR_ID = "rate_error_percent"
_RATE_ERROR = Signal("%", label=N_("rate error"), rank=30, shown_decimals=1)
# The red-edge values of single heads appear on the Run page only: a channel takes 0.7 MB, and these
# columns are empty on most machines.
_NOT_PLOTTED = {"time_s", *NDRE_COLUMNS, *TEXT_COLUMNS}
CHANNELS = tuple(
    TrendChannel(name, one.label or name, partial(choose_unit, one), one.group)
    for name, one in sorted(
        (SIGNALS | {RATE_ERROR_ID: _RATE_ERROR}).items(), key=lambda item: item[1].rank
    )
    if name not in _NOT_PLOTTED
)
BY_ID = {channel.id: channel for channel in CHANNELS}
CHANNEL_INDEX = {channel.id: index for index, channel in enumerate(CHANNELS)}
# Channels that the Trends page plots until the operator chooses others.
DEFAULT_TREND_CHANNELS = ("target_rate_kg_ha", "applied_rate_kg_ha", "speed_used_mps")
NAN = float("nan")

# Position of each channel in a log row; -1 marks the calculated channel. The lookup runs for every
# channel of every frame.
_COLUMN_INDEX = tuple(
    COLUMNS.index(channel.id) if channel.id in COLUMNS else -1 for channel in CHANNELS
)


def find_value(row: LogRow, channel: str) -> float:
    """Return the value of one channel of a row, NaN where unknown. The rate error is defined only
    while the machine works."""
    if channel != RATE_ERROR_ID:
        return NAN if (value := getattr(row, channel)) is None else float(value)
    # A foreign log has no state; every row of it counts as work.
    error = (
        find_rate_error(row.target_rate_kg_ha, row.applied_rate_kg_ha)
        if row.state in (None, "working")
        else None
    )
    return NAN if error is None else 100.0 * error


def list_values(row: LogRow) -> list[float]:
    """Return the values of all channels of a row, in the order of CHANNELS."""
    values = [NAN if at < 0 or (value := row[at]) is None else float(value) for at in _COLUMN_INDEX]
    values[CHANNEL_INDEX[RATE_ERROR_ID]] = find_value(row, RATE_ERROR_ID)
    return values
