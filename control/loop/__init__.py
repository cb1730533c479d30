"""What does one tick of control do? Measurements in, commands and a log row out.

Files:

- `ahead`: What lies along the way ahead?
- `canopy_heads`: Which NDVI do the canopy heads measure, and which rate follows?
- `doses`: Which dose is due in this tick of point mode?
- `effort_watch`: Does the metering drive work as hard as it should?
- `events`: Which events does a row take?
- `expected`: Where should shaft and gate be by now?
- `known_terms`: Which terms of the machine file can control compensate
- `look_ahead_distance`: How far ahead must a change of the target be made?
- `loop`: What does control do in one tick?
- `map_location_check`: Does the map lie where the machine works?
- `order_handlers`: What does each of the operator's orders to the loop change
- `reversing`: Where has material landed while the machine reverses without permission to spread?
- `row`: What stands in the log row of a tick?
- `sections`: Which sections are on when material released then lands
- `situation`: What does safety need to know of a tick?
- `tick`: What is the result of one tick?
- `tick_state`: Which values do the steps of a tick pass on to each other?
- `unintended_flow`: How much leaves the machine although its shaft is commanded to stop?
"""

from __future__ import annotations

from topdress.control.loop.loop import ControlLoop
from topdress.control.loop.tick import Tick

__all__ = ["ControlLoop", "Tick"]
