"""Runs one tick of control: measurements in, commands and a log row out.

Files:

- `canopy_heads`: Which NDVI do the canopy heads measure, and which rate follows?
- `dose_planner`: Which dose is due in this tick of point mode?
- `effort_watch`: Is the effort of the metering drive as expected?
- `events`: Which events does a log row contain?
- `expected_drives`: Which shaft speed and opening are expected now?
- `known_terms`: Which terms of the machine file can control compensate
- `look_ahead_distance`: How far ahead must a change of the target be made?
- `loop`: Runs one tick of control
- `map_location_check`: Is the map at the machine's location?
- `order_handlers`: What does each of the operator's orders to the loop change
- `reversing`: Where has material landed while the machine reverses without permission to spread?
- `section_control`: Which sections are on when material released then lands
- `situation`: Which facts of a tick does safety need?
- `tick`: What is the result of one tick?
- `tick_row`: What does the log row of a tick contain?
- `tick_state`: Which values do the steps of a tick pass to each other?
- `unintended_flow`: How much material leaves the machine although its shaft is commanded to stop?
- `way_ahead`: What lies along the path ahead?
"""

from __future__ import annotations

from topdress.control.loop.loop import ControlLoop
from topdress.control.loop.tick import Tick

__all__ = ["ControlLoop", "Tick"]
