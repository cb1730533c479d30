"""What a stage may depend on: recorded variables, how far they must move, and which of them follow its own reading."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis import effects
from control.machine.effect import HOPPER, OPENING_RANGE, SHAFT_RANGE

from .hypothesis import EffectInstance
from .stages import RunData

Array = npt.NDArray[np.float64]

# Of a variable, for a dependence on it to show; for those in RANGES on the nominal machine.
MIN_RANGE = {"time_s": 60.0, "shaft_rpm": 2.0, "opening_mm": 1.0, "supply_v": 0.2, "pitch_deg": 0.5,
               "roll_deg": 0.5, "speed_mps": 0.15, "hopper_kg": 10.0, "heading_deg": 30.0}
RANGES = {"shaft_rpm": SHAFT_RANGE, "opening_mm": OPENING_RANGE, "hopper_kg": HOPPER}

# Recorded variables that follow a stage's own reading, so that its noise comes back through them. Control sets shaft
# and gate by the measured speed, and by the scale through the flow trim; shaft_rpm and opening_mm are the commands
# (drives see them before they answer). A gate knows nothing of the shaft; the shaft bears the load of the opening.
DOWNSTREAM: dict[str, frozenset[str]] = {
    "shaft": frozenset(),
    "gate": frozenset({"shaft_rpm"}),
    "flow": frozenset(),
    "scale": frozenset({"hopper_kg", "shaft_rpm", "opening_mm"}),
    "speed": frozenset({"speed_mps", "shaft_rpm", "opening_mm"}),
}


def variables_of(data: RunData) -> tuple[str, ...]:
    """What a stage may depend on: the published variables, and the log's further columns."""
    return (*MIN_RANGE, *(name for name in data.variables if name not in MIN_RANGE))


class StageTable(NamedTuple):
    """The smooth extension of one stage: the channel that shows it, and the effect whose column it multiplies."""

    channel: str
    unit: EffectInstance


TABLES: dict[str, StageTable] = {
    "shaft": StageTable("shaft", EffectInstance(effects.SHAFT_GAIN.id, 1.0)),
    "gate": StageTable("gate", EffectInstance(effects.GATE_HOME_ERROR.id, 1.0)),
    "flow": StageTable("scale", EffectInstance(effects.FLOW_GAIN.id, 1.0)),
    "scale": StageTable("scale", EffectInstance(effects.SCALE_DRIFT.id, 1.0)),
    "speed": StageTable("speed", EffectInstance(effects.SPEED_WHEEL_RADIUS.id, 1.0)),
}
