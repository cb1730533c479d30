"""Which columns does a run log have? Tables of the columns, made of their declarations in
`control.signals`."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any, get_args, get_type_hints

from topdress.control.signals import SIGNALS, VALID_FOR
from topdress.control.signals import LogRow as LogRow

ALL_COLUMNS: tuple[str, ...] = LogRow._fields
# The last columns stand only in logs of machines whose sections have valves.
SECTION_COLUMNS = ("sections_cmd",)
COLUMNS: tuple[str, ...] = ALL_COLUMNS[: -len(SECTION_COLUMNS)]
HEAD_COLUMNS = tuple(f"ndvi_{head}" for head in range(1, 7))
NDRE_COLUMNS = tuple(f"ndre_{head}" for head in range(1, 7))
# Time for which a row keeps the last value of a column, s; after it the cell is empty.
VALID_FOR_S = MappingProxyType({name: times.log_s for name, times in VALID_FOR.items()})
# Time for which a row keeps all values of a GNSS epoch, s.
GNSS_VALID_FOR_S = VALID_FOR_S["lat_deg"]
# This event says that from here on each command is in force until the next row.
COMMANDS_HELD_EVENT = "commands_held"
# This event, followed by an angle in degrees, orders one dose: the shaft turns without a set-point.
DOSE_EVENT = "dose "
# These events, followed by a name, mark the first row of each file of a joined log.
FILE_BEGINS, LOG_BEGINS = "mark file ", "mark log "

_KINDS = {name: set(get_args(kind)) for name, kind in get_type_hints(LogRow).items()}
TEXT_COLUMNS = frozenset(name for name, kinds in _KINDS.items() if str in kinds)
WHOLE_COLUMNS = frozenset(name for name, kinds in _KINDS.items() if int in kinds)

EFFORT_COLUMNS = ("shaft_effort", "gate_effort")
SPEED_COLUMNS = tuple(name for name, one in SIGNALS.items() if one.group == "speed")

PLAUSIBLE_RANGES = {
    name: one.plausible for name, one in SIGNALS.items() if one.plausible is not None
}
EXACT_COLUMNS = frozenset(name for name, one in SIGNALS.items() if one.exact)
# Measured and derived values have more decimals than any sensor resolves.
DECIMALS = {name: one.decimals for name, one in SIGNALS.items() if one.decimals is not None}


def make_row_schema() -> dict[str, Any]:
    """Returns the JSON schema (2020-12) of a row of a run log: type, unit, plausible range and
    meaning of each column."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Row of a run log",
        "type": "object",
        "properties": {
            name: {
                "type": [
                    "string"
                    if name in TEXT_COLUMNS
                    else "integer"
                    if name in WHOLE_COLUMNS
                    else "number",
                    "null",
                ],
                **({"unit": one.unit} if one.unit else {}),
                **({"plausible": list(one.plausible)} if one.plausible else {}),
                "description": one.meaning,
            }
            for name, one in SIGNALS.items()
        },
        "required": ["time_s"],
    }
