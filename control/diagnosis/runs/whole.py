"""A long log is looked at in windows: what was found there is held against every row of it, once."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from control.diagnosis.effects import ROWS
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S

from .channels import gate_channel, shaft_channel
from .hypothesis import schedule
from .log import Clean
from .selection import Named
from .stages import drives, looked_at

CHANNEL = {"shaft": shaft_channel, "gate": gate_channel}


def on_the_whole(log: Clean, named: Sequence[Named], machine: Machine) -> list[str]:
    """Sentences on a long log: the share of rows looked at, and the error over all rows before and after naming.

    Flow and scale are always judged over the whole time; empty for a log that was looked at in full.
    """
    count = len(log.time_s)
    rows = looked_at(count)
    if len(rows) == count:
        return []
    said = [f"long log: shaft, gate, speed and heads are judged on {100.0 * len(rows) / count:.0f} % of {count} rows, "
            "evenly chosen; flow and scale on the whole time"]
    every = drives(log, machine, whole=True)
    for one in named:
        for name in ("shaft", "gate"):
            parts = tuple(p for p in one.found.parts if ROWS[p.id].stage == name)
            if not parts or name not in every or name not in one.group.names:
                continue
            channel = CHANNEL[name](every[name], machine)
            left = [channel.measured - channel.predict(schedule(one.group.base, p), MOST_STEP_S) for p in ((), parts)]
            errors = [float(np.sqrt(np.mean(series ** 2))) for series in left]
            words = "holds" if errors[1] < errors[0] else "does NOT hold"
            said.append(f"stage {name}: what was named {words} on every row: error {errors[0]:.3g} -> {errors[1]:.3g} "
                        f"{channel.unit}")
    return said
