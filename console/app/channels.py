"""Declares every number of a log row as a channel that the Trends page can plot: label, unit and
shared scale.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from topdress.console.app.panel_views import find_rate_error
from topdress.console.app.units import Unit, Units
from topdress.console.locale import N_
from topdress.control.log_row import COLUMNS, NDRE_COLUMNS, TEXT_COLUMNS, LogRow

UnitChooser = Callable[[Units], Unit]


def _choose_unit(name: str, decimals: int | None = None) -> UnitChooser:
    """Return a function that selects one of the units in use.

    Parameters
    ----------
    name
        Field of `Units`, e.g. "speed".
    decimals
        Decimals that replace the unit's own; None keeps them.
    """

    def find_unit(units: Units) -> Unit:
        found: Unit = getattr(units, name)
        return found if decimals is None else found._replace(decimals=decimals)

    return find_unit


def _make_plain_unit(name: str, decimals: int) -> UnitChooser:
    """Return a chooser of a unit that is independent of the user's system of units."""
    unit = Unit(name, 1.0, decimals)
    return lambda units: unit


class TrendChannel(NamedTuple):
    """Describes a channel. `id` is the log's column; channels of one `group` share their scale when
    they are plotted together."""

    id: str
    label: str
    unit: UnitChooser
    group: str = ""


# This channel is calculated, so no column of the log has its name.
RATE_ERROR_ID = "rate_error_percent"
_DEGREES, _NDVI, _COUNT = _make_plain_unit("°", 1), _make_plain_unit("", 3), _make_plain_unit("", 0)
_RATE, _SPEED, _MASS = _choose_unit("rate"), _choose_unit("speed", 2), _choose_unit("mass", 1)
_SHAFT, _OPENING, _DISTANCE = (
    _choose_unit("shaft"),
    _choose_unit("opening"),
    _choose_unit("fine_distance"),
)

# The order is that of the list on the Trends page: what an operator compares most often comes
# first.
_LABELLED = (
    TrendChannel("target_rate_kg_ha", N_("target rate"), _RATE, "rate"),
    TrendChannel("applied_rate_kg_ha", N_("applied rate"), _RATE, "rate"),
    TrendChannel(RATE_ERROR_ID, N_("rate error"), _make_plain_unit("%", 1)),
    TrendChannel("speed_used_mps", N_("speed used"), _SPEED, "speed"),
    TrendChannel("speed_mps", N_("GNSS speed"), _SPEED, "speed"),
    TrendChannel("wheel_speed_mps", N_("wheel speed"), _SPEED, "speed"),
    TrendChannel("ndvi", N_("NDVI, fused"), _NDVI, "ndvi"),
    TrendChannel("ndvi_1", N_("NDVI, head 1"), _NDVI, "ndvi"),
    TrendChannel("ndvi_2", N_("NDVI, head 2"), _NDVI, "ndvi"),
    TrendChannel("ndvi_3", N_("NDVI, head 3"), _NDVI, "ndvi"),
    TrendChannel("ndvi_4", N_("NDVI, head 4"), _NDVI, "ndvi"),
    TrendChannel("ndvi_5", N_("NDVI, head 5"), _NDVI, "ndvi"),
    TrendChannel("ndvi_6", N_("NDVI, head 6"), _NDVI, "ndvi"),
    TrendChannel("shaft_rpm_cmd", N_("shaft, set"), _SHAFT, "shaft"),
    TrendChannel("shaft_rpm", N_("shaft, measured"), _SHAFT, "shaft"),
    TrendChannel("opening_mm_cmd", N_("opening, set"), _OPENING, "opening"),
    TrendChannel("opening_mm", N_("opening, measured"), _OPENING, "opening"),
    TrendChannel("hopper_kg", N_("hopper"), _MASS),
    TrendChannel("flow_trim", N_("scale trim"), _NDVI),
    TrendChannel("lag_s", N_("look-ahead, time"), _make_plain_unit("s", 2)),
    TrendChannel("lag_m", N_("look-ahead, way"), _DISTANCE),
    TrendChannel("nudge_percent", N_("nudge"), _make_plain_unit("%", 0)),
    TrendChannel("heading_deg", N_("heading"), _DEGREES),
    TrendChannel("pitch_deg", N_("pitch"), _DEGREES, "tilt"),
    TrendChannel("roll_deg", N_("roll"), _DEGREES, "tilt"),
    TrendChannel("supply_v", N_("supply"), _make_plain_unit("V", 2)),
    TrendChannel("shaft_effort", N_("effort of the shaft"), _make_plain_unit("", 1), "effort"),
    TrendChannel("gate_effort", N_("effort of the gate"), _make_plain_unit("", 1), "effort"),
    TrendChannel("work_switch", N_("work switch"), _COUNT),
    TrendChannel("fix_quality", N_("GNSS fix quality"), _COUNT),
    TrendChannel("satellites", N_("satellites"), _COUNT),
    TrendChannel("hdop", N_("GNSS dilution (HDOP)"), _make_plain_unit("", 2)),
    TrendChannel("lat_deg", N_("latitude"), _make_plain_unit("°", 7)),
    TrendChannel("lon_deg", N_("longitude"), _make_plain_unit("°", 7)),
    TrendChannel("ndre", N_("NDRE, fused"), _NDVI, "ndvi"),
)
# The red-edge values of single heads appear on the Run page only: a channel takes 0.7 MB, and these
# columns are empty on most machines.
_NOT_PLOTTED = TEXT_COLUMNS | {"time_s", *NDRE_COLUMNS}
_LABELLED_IDS = {channel.id for channel in _LABELLED}
# A column without a label is plotted under its own name with two decimals, so that a new column
# needs no change here.
CHANNELS = (
    *_LABELLED,
    *(
        TrendChannel(column, column, _make_plain_unit("", 2))
        for column in COLUMNS
        if column not in _LABELLED_IDS | _NOT_PLOTTED
    ),
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
    at = _COLUMN_INDEX[CHANNEL_INDEX[channel]]
    if at >= 0:
        value = row[at]
        return NAN if value is None else float(value)
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
