"""Channels that share effects, through the machine model: predictions, residuals, and the
nominal values below them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import ROWS, SHAFT_SECOND_ORDER, SHAFT_SLOW
from topdress.control.diagnosis.judgement import noise as noises
from topdress.control.diagnosis.judgement.noise import coefficients
from topdress.control.machine.effect import FULL_REVOLUTION, SLEW_RATE
from topdress.control.machine.effort import GATE_EFFORT_PARTS, SHAFT_EFFORT_PARTS
from topdress.control.machine.machine import CATALOGUE, Machine, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import ChannelSeries
from .effort import EFFORT
from .hypothesis import EffectInstance, Hypothesis, Stages, list_stages, make_schedule
from .stages import RunData

Array = npt.NDArray[np.float64]

# channels that share an effect are judged together
GROUPS: dict[str, tuple[str, ...]] = {
    "shaft": ("shaft",),
    "metering": ("gate", "scale", *EFFORT),
    "speed": ("speed",),
    "heads": ("heads",),
}
STEP_SHARE = 0.05  # of a value, for its slope
# around a drive's halt: how it runs down is nobody's effect
HALT_S = 3.0
# of a row: the speed in a row was read at some time within it
GNSS_STAMP_SHARE = 0.25
# of the mechanical time constant: L / R of small DC motors is 1 to 2 ms of their 20 to 50 ms
ELECTRICAL = 0.04
MAX_PREDICTIONS = 24  # hypotheses whose predictions are kept


class Nuisance(NamedTuple):
    """A nominal value that may be off within its tolerance."""

    stage: str
    field: str
    step: float  # difference of the value for its slope
    sd: float  # tolerance, 1 s.d.

    @property
    def key(self) -> str:
        return f"{self.stage}.{self.field}"


def list_nuisances(channel: str, machine: Machine) -> tuple[Nuisance, ...]:
    """Tolerances of the machine file that bear on a channel."""
    t = machine.tolerance
    if channel == "shaft":
        return (
            Nuisance("shaft", "gain_percent", 0.1, t.shaft_percent),
            Nuisance("shaft", "dead_time_s", 0.01, t.dead_time_s),
            Nuisance("shaft", "time_constant_s", 0.01, t.time_constant_s),
        )
    if channel == "gate":
        return (
            Nuisance("gate", "dead_time_s", 0.01, t.dead_time_s),
            Nuisance(
                "gate",
                "slew_mm_s",
                0.5 * scale_nominal(machine, SLEW_RATE),
                machine.gate.slew_mm_s * t.gate_slew_percent / 100.0,
            ),
            Nuisance("gate", "home_error_mm", 0.05, t.opening_mm),
        )
    if channel == "scale":
        return (
            Nuisance("flow", "gain_percent", 0.5, t.flow_percent),
            Nuisance(
                "flow",
                "zero_offset_g_rev",
                0.5 * scale_nominal(machine, FULL_REVOLUTION),
                t.opening_mm * machine.flow.grams_per_rev_mm,
            ),
        )
    if channel in EFFORT:
        own = SHAFT_EFFORT_PARTS if channel == "effort" else GATE_EFFORT_PARTS
        return tuple(
            Nuisance("effort", field, STEP_SHARE * value, value * t.effort_percent / 100.0)
            for field in own
            if (value := getattr(machine.effort, field)) > 0.0
        )
    if channel == "speed":
        return (Nuisance("speed", "radius_percent", 0.2, t.wheel_percent),)
    return ()


def find_tolerance(effect_id: str, machine: Machine) -> float:
    """Tolerance (1 s.d.) of the nominal value that an effect moves, in the unit of its size; 0
    where it moves none.

    What the tolerance leaves open, the effect's size leaves open too. Where a row is longer
    than the tolerance the two have kinks at different places, and no slope says so.
    """
    row = ROWS[effect_id]
    return sum(n.sd for n in list_nuisances(row.stage, machine) if n.field == row.moves)


def hidden_within(effect_id: str, machine: Machine) -> float:
    """How far (1 s.d.) a sound machine may do what an effect does: within the tolerance of a
    nominal value, or, of a second time constant, as a motor's electrical one, which a data
    sheet's single one leaves out; 0 for others."""
    if effect_id == SHAFT_SECOND_ORDER.id:
        return ELECTRICAL * machine.shaft.time_constant_s
    return find_tolerance(effect_id, machine)


def find_absorbed_effects(effect_id: str) -> tuple[str, ...]:
    """Effects that no nominal value off its tolerance does where this one is there: of two
    orders the first is no data sheet's time constant."""
    return (SHAFT_SLOW.id,) if effect_id == SHAFT_SECOND_ORDER.id else ()


def find_replaced_nominals(parts: Hypothesis) -> frozenset[str]:
    """Nominal values (by key) that a steady part moves, or leaves to another effect: sizes say
    how far, and no tolerance along with them."""
    ids = [part.id for part in parts if part.onset_s is None]
    rows = [ROWS[name] for one in ids for name in (one, *find_absorbed_effects(one))]
    return frozenset(f"{row.stage}.{row.moves}" for row in rows if row.moves)


def find_stamp_sd_s(machine: Machine, step_s: float) -> float:
    """How well the time of a GNSS reading is known (1 s.d.), in a log with rows of `step_s`."""
    return float(np.hypot(machine.tolerance.dead_time_s, GNSS_STAMP_SHARE * step_s))


def is_cumulative(part: EffectInstance, channel: str) -> bool:
    """Whether a channel reads the sum of what an effect did until then: a scale reads all that
    flowed."""
    return channel == "scale" and ROWS[part.id].stage != "scale"


def shape_over_time(change: Array, channel: ChannelSeries, part: EffectInstance) -> Array:
    """What an effect does to a channel in the course of a log, from what it would do all along:
    both (m,).

    A scale reads what flowed until then: what begins late has changed nothing before. Every
    other channel answers at once, so that this is right for effects whose prediction is a
    straight line in their size.
    """
    return apply_course(
        change, calc_part_course(channel, part), channel.copies, is_cumulative(part, channel.name)
    )


def calc_part_course(channel: ChannelSeries, part: EffectInstance) -> Array:
    """How much of a part is there at each sample, from 0 to 1: (m,)."""
    time_s, onset_s = channel.grid.even_s, 0.0 if part.onset_s is None else part.onset_s
    weight = (time_s >= onset_s).astype(np.float64)
    if part.grows:
        weight = np.clip((time_s - onset_s) / max(1e-9, float(time_s[-1]) - onset_s), 0.0, 1.0)
    return weight if part.until_s is None else np.where(time_s < part.until_s, weight, 0.0)


def apply_course(change: Array, weight: Array, copies: int, summed: bool) -> Array:
    """Changes (..., copies x m) in the course of weights (..., m). summed : the channel adds up
    what an effect does."""
    if summed:
        return np.asarray(np.cumsum(np.diff(change, prepend=change[..., :1]) * weight, axis=-1))
    shaped = change.reshape(*change.shape[:-1], copies, -1) * weight[..., None, :]
    return np.asarray(shaped.reshape(*shaped.shape[:-2], -1))


class GroupModel:
    """Channels that share effects, under any hypothesis about them.

    channels, names : of the group. data : the log; its hopper level is the predicted one. noise
    : where fits start. base : the stages' parameters now; offsets : by how much nominal values
    were moved (by key). moves : how often they were moved, for those who keep what they made of
    the model. drawn_in : what is taken off each measurement for its tails (m,). ask : called at
    each run of the model; what it raises ends the work.
    """

    def __init__(
        self,
        channels: Sequence[ChannelSeries],
        machine: Machine,
        data: RunData,
        ask: Callable[[], None] = lambda: None,
    ) -> None:
        self.ask = ask
        self.channels = tuple(channels)
        self.names = tuple(channel.name for channel in channels)
        self.machine = machine
        self.base = list_stages(machine)
        self.noise = {c.name: noises.find_starting_noise(c.prior) for c in channels}
        self.offsets: dict[str, float] = {}
        self.moves = 0
        self.drawn_in: dict[str, Array] = {c.name: np.zeros(len(c.measured)) for c in channels}
        self._predictions: dict[Hypothesis, dict[str, Array]] = {}
        self.data = self._with_hopper_level(data)

    def _with_hopper_level(self, data: RunData) -> RunData:
        """The level as predicted: the reading's own noise must not come back as a dependence on
        itself."""
        if "scale" not in self.names or data.hopper is None:
            return data
        level = np.interp(
            data.time_s, self.channel("scale").grid.even_s, self.predicted(())["scale"]
        )
        return data._replace(variables={**data.variables, "hopper_kg": level})

    def channel(self, name: str) -> ChannelSeries:
        """One of the group's channels; ValueError where it has none of that name."""
        return self.channels[self.names.index(name)]

    @property
    def heads(self) -> int:
        """Canopy heads that read something."""
        return (
            0
            if self.data.heads is None
            else int(np.isfinite(self.data.heads.ndvi).any(axis=1).sum())
        )

    @property
    def nuisances(self) -> tuple[tuple[ChannelSeries, Nuisance], ...]:
        """Every tolerance that bears on the group, with its channel."""
        return tuple((c, n) for c in self.channels for n in list_nuisances(c.name, self.machine))

    def predicted(self, parts: Hypothesis) -> dict[str, Array]:
        """What each channel would read under a hypothesis: (m,) by channel."""
        if parts not in self._predictions:
            if len(self._predictions) > MAX_PREDICTIONS:
                self._predictions.pop(next(iter(self._predictions)))
            self._predictions[parts] = self.run(parts)
        return self._predictions[parts]

    def run(
        self, parts: Hypothesis, base: Stages | None = None, only: Collection[str] | None = None
    ) -> dict[str, Array]:
        """The model run under a hypothesis: (m,) by channel. base : other stages; only : these
        channels."""
        channels = [c for c in self.channels if only is None or c.name in only]
        if not any(part.grows for part in parts):
            return self._predict_steady(parts, channels, base)
        there = tuple(part for part in parts if not part.grows)
        steady = self._predict_cached(there, channels, base)
        now = dict(steady)
        for part in parts:
            if part.grows:
                touched = [c for c in channels if c.name in ROWS[part.id].channels]
                grown = self._predict_cached(
                    (*there, part._replace(onset_s=None, grows=False)), touched, base
                )
                for c in touched:
                    now[c.name] = now[c.name] + shape_over_time(
                        grown[c.name] - steady[c.name], c, part
                    )
        return now

    def _predict_steady(
        self, parts: Hypothesis, channels: Sequence[ChannelSeries], base: Stages | None
    ) -> dict[str, Array]:
        self.ask()
        plan = make_schedule(base or self.base, parts)
        return {c.name: c.predict(plan, MAX_MODEL_STEP_S) for c in channels}

    def _predict_cached(
        self, parts: Hypothesis, channels: Sequence[ChannelSeries], base: Stages | None
    ) -> dict[str, Array]:
        """The same, kept where all channels are asked for: growths of many sizes share them."""
        if base is not None or (
            parts not in self._predictions and len(channels) < len(self.channels)
        ):
            return self._predict_steady(parts, channels, base)
        known = self.predicted(parts)
        return {c.name: known[c.name] for c in channels}

    def residual(self, parts: Hypothesis) -> dict[str, Array]:
        """Measured, tails drawn in, less predicted: (m,) by channel; 0 while a drive that halts
        runs down."""
        now = self.predicted(parts)
        left = {c.name: c.measured - self.drawn_in[c.name] - now[c.name] for c in self.channels}
        for part in parts:
            if CATALOGUE[part.id].effect.onset_only and part.onset_s is not None:
                channel = self.channel(ROWS[part.id].stage)
                after_s = channel.grid.even_s - part.onset_s
                left[channel.name] = np.where(
                    (after_s > -HALT_S) & (after_s < HALT_S), 0.0, left[channel.name]
                )
        return left

    def banded_residual(self, parts: Hypothesis) -> dict[str, Array]:
        """Cosine coefficients of the residual, sorted by band: (m,) by channel."""
        left = self.residual(parts)
        return {c.name: coefficients(left[c.name], c.cut) for c in self.channels}

    def difference(self, parts: Hypothesis, more: EffectInstance) -> dict[str, Array]:
        """What one more part does to the channels that it touches: (m,) by channel."""
        now = self.predicted(parts)
        return {
            name: one - now[name]
            for name, one in self.run((*parts, more), only=ROWS[more.id].channels).items()
        }

    def nominal(self, nuisance: Nuisance) -> float:
        """A value as the machine file has it."""
        return float(getattr(getattr(self.machine, nuisance.stage), nuisance.field))

    def move(self, offsets: Mapping[str, float]) -> None:
        """Nominal values set off from the machine file's by so much (by key; others stand where
        it has them)."""
        for _, n in self.nuisances:
            self.base = self.base.put(
                n.stage, **{n.field: float(self.nominal(n) + offsets.get(n.key, 0.0))}
            )
        self.offsets = dict(offsets)
        self.moves += 1
        self._predictions.clear()
