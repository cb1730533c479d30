"""Which columns does a run log have? One row, the public column contract in its published order;
None: unknown.

Row k holds the measurements as sampled at `time_s`, and the commands computed from them, in
force until row k+1."""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple


class LogRow(NamedTuple):
    time_s: float
    utc: str | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    fix_quality: int | None = None
    satellites: int | None = None
    hdop: float | None = None
    heading_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    speed_mps: float | None = None
    wheel_speed_mps: float | None = None
    speed_used_mps: float | None = None
    ndvi_1: float | None = None
    ndvi_2: float | None = None
    ndvi_3: float | None = None
    ndvi_4: float | None = None
    ndvi_5: float | None = None
    ndvi_6: float | None = None
    ndvi: float | None = None
    target_rate_kg_ha: float | None = None
    nudge_percent: float | None = None
    shaft_rpm_cmd: float | None = None
    shaft_rpm: float | None = None
    opening_mm_cmd: float | None = None
    opening_mm: float | None = None
    hopper_kg: float | None = None
    flow_trim: float | None = None
    supply_v: float | None = None
    applied_rate_kg_ha: float | None = None
    lag_s: float | None = None
    lag_m: float | None = None
    state: str | None = None
    strategy: str | None = None
    target_source: str | None = None
    work_switch: int | None = None
    # Alarm ids and events are separated by semicolons.
    alarms: str | None = None
    events: str | None = None
    # A speed that was announced in this row (`control.readings.describe_announcement`).
    speed_told: str | None = None
    # These columns replace ndvi_1 to ndvi where the heads measure NDRE.
    ndre_1: float | None = None
    ndre_2: float | None = None
    ndre_3: float | None = None
    ndre_4: float | None = None
    ndre_5: float | None = None
    ndre_6: float | None = None
    ndre: float | None = None
    # Effort of a drive in the machine file's unit: % of full duty, A or N m.
    shaft_effort: float | None = None
    gate_effort: float | None = None
    # Commands of the section valves, left to right, separated by semicolons.
    sections_cmd: str | None = None


ALL_COLUMNS: tuple[str, ...] = LogRow._fields
# The last columns stand only in logs of machines whose sections have valves.
SECTION_COLUMNS = ("sections_cmd",)
COLUMNS: tuple[str, ...] = ALL_COLUMNS[: -len(SECTION_COLUMNS)]
HEAD_COLUMNS = ("ndvi_1", "ndvi_2", "ndvi_3", "ndvi_4", "ndvi_5", "ndvi_6")
NDRE_COLUMNS = ("ndre_1", "ndre_2", "ndre_3", "ndre_4", "ndre_5", "ndre_6")
# Time for which a row keeps the last value of a column, s; after it the cell is empty.
VALID_FOR_S = MappingProxyType(
    {
        "wheel_speed_mps": 1.0,
        "shaft_rpm": 0.5,
        "opening_mm": 0.5,
        "hopper_kg": 2.0,
        "supply_v": 2.0,
        "pitch_deg": 1.0,
        "roll_deg": 1.0,
        "shaft_effort": 0.5,
        "gate_effort": 0.5,
        **dict.fromkeys(HEAD_COLUMNS + NDRE_COLUMNS, 1.25),
    }
)
# Time for which a row keeps all values of a GNSS epoch, s.
GNSS_VALID_FOR_S = 1.0
# This event says that from here on each command is in force until the next row.
COMMANDS_HELD = "commands_held"
# These events, followed by a name, mark the first row of each file of a joined log.
FILE_BEGINS, LOG_BEGINS = "mark file ", "mark log "

TEXT_COLUMNS = frozenset(
    {"utc", "state", "strategy", "target_source", "alarms", "events", "speed_told", "sections_cmd"}
)
WHOLE_COLUMNS = frozenset({"fix_quality", "satellites", "work_switch"})

EFFORT_COLUMNS = ("shaft_effort", "gate_effort")
SPEED_COLUMNS = ("speed_mps", "wheel_speed_mps", "speed_used_mps")

# Range of each quantity on any machine of this kind; wide on purpose.
PLAUSIBLE_RANGES = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-180.0, 180.0),
    "fix_quality": (0, 9),
    "satellites": (0, 100),
    "hdop": (0, 100),
    "heading_deg": (-180.0, 360.0),
    "pitch_deg": (-60.0, 60.0),
    "roll_deg": (-60.0, 60.0),
    **dict.fromkeys(SPEED_COLUMNS, (-15.0, 30.0)),
    **dict.fromkeys((*HEAD_COLUMNS, "ndvi", *NDRE_COLUMNS, "ndre"), (-1.0, 1.0)),
    "target_rate_kg_ha": (0.0, 5000.0),
    "nudge_percent": (-100.0, 100.0),
    "shaft_rpm_cmd": (-1e5, 1e5),
    "shaft_rpm": (-1e5, 1e5),
    "opening_mm_cmd": (-50.0, 500.0),
    "opening_mm": (-50.0, 500.0),
    "hopper_kg": (-500.0, 50_000.0),
    "flow_trim": (0.0, 10.0),
    "supply_v": (0.0, 60.0),
    "applied_rate_kg_ha": (0.0, 20_000.0),
    "lag_s": (0.0, 60.0),
    "lag_m": (-100.0, 500.0),
    **dict.fromkeys(EFFORT_COLUMNS, (-1000.0, 1000.0)),
}

# Sent or decided values are written as the shortest text that reads back as the same number.
EXACT_COLUMNS = frozenset(
    {"target_rate_kg_ha", "nudge_percent", "shaft_rpm_cmd", "opening_mm_cmd", "flow_trim"}
)

# Measured and derived values have more decimals than any sensor resolves.
DECIMALS = {
    "time_s": 3,
    "lat_deg": 9,
    "lon_deg": 9,
    "hdop": 2,
    "heading_deg": 3,
    "pitch_deg": 3,
    "roll_deg": 3,
    "speed_mps": 4,
    "wheel_speed_mps": 4,
    "speed_used_mps": 4,
    **dict.fromkeys((*HEAD_COLUMNS, *NDRE_COLUMNS), 4),
    "ndvi": 5,
    "ndre": 5,
    "shaft_rpm": 3,
    "opening_mm": 3,
    "hopper_kg": 3,
    "supply_v": 3,
    "applied_rate_kg_ha": 3,
    "lag_s": 4,
    "lag_m": 4,
    **dict.fromkeys(EFFORT_COLUMNS, 3),
}
