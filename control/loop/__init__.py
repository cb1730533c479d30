"""One tick of control: measurements in, commands and a log row out.

Files:

- `ahead`: What lies along the way ahead
- `canopy_heads`: The canopy heads in the loop
- `doses`: Point mode in the loop: the dose that is due, nothing outside the field, no plant twice
- `effort_watch`: Does the metering drive work as hard as it should?
- `events`: Events on their way into rows
- `expected`: Where shaft and gate should be by now
- `known_terms`: The machine file's terms as control knows them
- `look_ahead_distance`: How far ahead a change of the target must be made
- `loop`: One tick of control: measurements in, commands and a log row out
- `map_near`: Does the map lie where the machine works?
- `order_handlers`: The operator's orders to the loop
- `reversing`: Backing up without leave to spread
- `row`: The log row of a tick: what the sensors said, as long as it holds, and what came of it
- `sections`: The sections of a machine with valves
- `situation`: What safety is given of a tick
- `tick`: What one tick yields
- `tick_state`: The values that the steps of a tick hand on to each other
- `unintended_flow`: What the drives were commanded
"""

from __future__ import annotations

from topdress.control.loop.loop import ControlLoop
from topdress.control.loop.tick import Tick

__all__ = ["ControlLoop", "Tick"]
