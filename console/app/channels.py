"""Every number of a log row as a channel that can be plotted: its words, its unit, and what it
is compared with."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from topdress.console.app.units import Unit, Units
from topdress.console.app.view import find_rate_error
from topdress.console.locale import N_
from topdress.control.log_row import COLUMNS, NDRE_COLUMNS, TEXT_COLUMNS, LogRow

UnitOf = Callable[[Units], Unit]


def _of(name: str, decimals: int | None = None) -> UnitOf:
    """One of the units in use, to as many decimals where they are said."""

    def unit(units: Units) -> Unit:
        found: Unit = getattr(units, name)
        return found if decimals is None else found._replace(decimals=decimals)

    return unit


def _plain(name: str, decimals: int) -> UnitOf:
    unit = Unit(name, 1.0, decimals)
    return lambda units: unit


class TrendChannel(NamedTuple):
    """id: the log's column. group: channels of one group share their scale when they are
    plotted together."""

    id: str
    label: str
    unit: UnitOf
    group: str = ""


ERROR = "rate_error_percent"
_DEGREES, _NDVI, _COUNT = _plain("°", 1), _plain("", 3), _plain("", 0)
_RATE, _SPEED, _MASS = _of("rate"), _of("speed", 2), _of("mass", 1)
_SHAFT, _OPENING, _DISTANCE = _of("shaft"), _of("opening"), _of("fine_distance")

_LABELLED = (
    TrendChannel("target_rate_kg_ha", N_("target rate"), _RATE, "rate"),
    TrendChannel("applied_rate_kg_ha", N_("applied rate"), _RATE, "rate"),
    TrendChannel(ERROR, N_("rate error"), _plain("%", 1)),
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
    TrendChannel("lag_s", N_("look-ahead, time"), _plain("s", 2)),
    TrendChannel("lag_m", N_("look-ahead, way"), _DISTANCE),
    TrendChannel("nudge_percent", N_("nudge"), _plain("%", 0)),
    TrendChannel("heading_deg", N_("heading"), _DEGREES),
    TrendChannel("pitch_deg", N_("pitch"), _DEGREES, "tilt"),
    TrendChannel("roll_deg", N_("roll"), _DEGREES, "tilt"),
    TrendChannel("supply_v", N_("supply"), _plain("V", 2)),
    TrendChannel("shaft_effort", N_("effort of the shaft"), _plain("", 1), "effort"),
    TrendChannel("gate_effort", N_("effort of the gate"), _plain("", 1), "effort"),
    TrendChannel("work_switch", N_("work switch"), _COUNT),
    TrendChannel("fix_quality", N_("GNSS fix quality"), _COUNT),
    TrendChannel("satellites", N_("satellites"), _COUNT),
    TrendChannel("hdop", N_("GNSS dilution (HDOP)"), _plain("", 2)),
    TrendChannel("lat_deg", N_("latitude"), _plain("°", 7)),
    TrendChannel("lon_deg", N_("longitude"), _plain("°", 7)),
    TrendChannel("ndre", N_("NDRE, fused"), _NDVI, "ndvi"),
)
# Single heads by red edge are seen on the Run page: a channel takes 0.7 MB, and these are empty
# on most machines.
_NOT_PLOTTED = TEXT_COLUMNS | {"time_s", *NDRE_COLUMNS}
_LABELLED_IDS = {channel.id for channel in _LABELLED}
# A column that has no label yet is plotted under its own name, to two decimals.
CHANNELS = (
    *_LABELLED,
    *(
        TrendChannel(column, column, _plain("", 2))
        for column in COLUMNS
        if column not in _LABELLED_IDS | _NOT_PLOTTED
    ),
)
BY_ID = {channel.id: channel for channel in CHANNELS}
COLUMN = {channel.id: index for index, channel in enumerate(CHANNELS)}
AT_FIRST = ("target_rate_kg_ha", "applied_rate_kg_ha", "speed_used_mps")
NAN = float("nan")

_AT = tuple(COLUMNS.index(channel.id) if channel.id in COLUMNS else -1 for channel in CHANNELS)


def value_of(row: LogRow, channel: str) -> float:
    """One channel of a row, NaN where it is not known. The error counts only while the machine
    works."""
    at = _AT[COLUMN[channel]]
    if at >= 0:
        value = row[at]
        return NAN if value is None else float(value)
    error = (
        find_rate_error(row.target_rate_kg_ha, row.applied_rate_kg_ha)
        if row.state in (None, "working")
        else None
    )
    return NAN if error is None else 100.0 * error


def list_values(row: LogRow) -> list[float]:
    """All channels of a row, in the order of CHANNELS."""
    values = [NAN if at < 0 or (value := row[at]) is None else float(value) for at in _AT]
    values[COLUMN[ERROR]] = value_of(row, ERROR)
    return values
