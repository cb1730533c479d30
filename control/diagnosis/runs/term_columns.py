"""What a series over a log's rows does to a channel when it acts on a quantity of a stage (the quantities of terms)."""
from __future__ import annotations

import numpy as np
import numpy.typing as npt

from control.diagnosis import effects
from control.machine.over_log import MOST_STEP_S
from control.machine.terms import Acts

from .channels import drive_rows
from .hypothesis import EffectInstance, Hypothesis, schedule
from .model import GroupModel
from .stages import Drive, bin_mean, metered_mean

Array = npt.NDArray[np.float64]

CHANNEL_OF: dict[Acts, str] = {
    Acts.SHAFT_PERCENT: "shaft", Acts.SHAFT_RPM: "shaft", Acts.GATE_MM: "gate", Acts.FLOW_PERCENT: "scale",
    Acts.SCALE_KG: "scale", Acts.WHEEL_PERCENT: "speed"}
FLOW_UNIT = EffectInstance(effects.FLOW_GAIN.id, 1.0)
SHAFT_PROBE = 0.5           # % or r/min, for a slope ...
SHAFT_NOTHING = 1e-6        # ... and r/min of it that are rounding
WHEEL_UNIT = EffectInstance(effects.SPEED_WHEEL_RADIUS.id, 1.0)


def tried(model: GroupModel) -> list[Acts]:
    """Quantities that a group's channels show."""
    in_steps = model.data.shaft is not None and model.data.shaft.step > 0.0     # rounding is a dependence of its own
    return [acts for acts, channel in CHANNEL_OF.items()
            if channel in model.names and not (channel == "shaft" and in_steps)]


class ActedOn:
    """One quantity under a hypothesis: series over the log's rows to series of its channel."""

    def __init__(self, model: GroupModel, parts: Hypothesis, acts: Acts) -> None:
        self.channel = model.channel(CHANNEL_OF[acts])
        self.acts, self._model, self._parts = acts, model, parts
        unit = {Acts.FLOW_PERCENT: FLOW_UNIT, Acts.WHEEL_PERCENT: WHEEL_UNIT}.get(acts)
        self._unit = np.ones(1) if unit is None else model.difference(parts, unit)[self.channel.name]

    def of(self, rows: Array) -> Array:
        """Change of the channel by one unit of each series: (k, m) of (k, rows)."""
        data, channel = self._model.data, self.channel
        if channel.name in ("shaft", "gate"):
            return channel.grid.of(self._of_drive(rows))
        if channel.name == "speed":
            return np.array([np.interp(channel.grid.even_s, data.row_s, one) for one in rows]) * self._unit
        hopper = data.hopper
        assert hopper is not None
        if self.acts is Acts.SCALE_KG:
            return channel.grid.of(np.array([bin_mean(one, data.row_s, hopper.time_s)[:-1] for one in rows]))
        metered = data.inputs["shaft_rpm"] * data.inputs["opening_mm"]
        share = channel.grid.of(np.array([metered_mean(one, metered, data.row_s, hopper.time_s)[:-1] for one in rows]))
        share = 0.5 * (share + np.concatenate((share[:, :1], share[:, :-1]), axis=1))
        return np.asarray(np.cumsum(np.diff(self._unit, prepend=self._unit[0]) * share, axis=1))

    def _of_drive(self, rows: Array) -> Array:
        """What shows at a row was in force in the row before it; the shaft goes there as its stage does."""
        data = self._model.data
        drive = data.shaft if self.channel.name == "shaft" else data.gate
        assert drive is not None
        at = np.clip(np.searchsorted(data.row_s, drive.time_s), 0, len(data.row_s) - 1)
        picked = rows[:, at]
        if self.channel.name == "shaft":
            was = self._shaft_rpm(drive)
            return np.array([self._of_shaft(drive, was, one) for one in picked])
        return np.concatenate((picked[:, :1], picked[:, :-1]), axis=1)

    def _shaft_rpm(self, drive: Drive) -> Array:
        return drive_rows(drive)(schedule(self._model.base, self._parts), MOST_STEP_S)[:, 0]

    def _of_shaft(self, drive: Drive, was: Array, one: Array) -> Array:
        """Slope of the shaft's speed in so much of a series over its rows: while it runs up it is not told apart."""
        share = SHAFT_PROBE / max(1e-12, float(np.max(np.abs(one))))
        moved = drive._replace(more=drive.more + share * one) if self.acts is Acts.SHAFT_PERCENT else \
            drive._replace(more_rpm=drive.more_rpm + share * one)
        change = self._shaft_rpm(moved) - was
        return np.asarray(change / share if np.abs(change).max() > SHAFT_NOTHING else np.zeros(len(change)))
