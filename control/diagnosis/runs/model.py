"""Models a group of channels that share effects: predictions, residuals, and nominal values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS, SHAFT_SECOND_ORDER, SHAFT_SLOW
from topdress.control.diagnosis.judgement import noise as noises
from topdress.control.diagnosis.judgement.noise import calc_coefficients
from topdress.control.machine.effect import FULL_REVOLUTION, SLEW_RATE
from topdress.control.machine.effort import GATE_EFFORT_PARTS, SHAFT_EFFORT_PARTS
from topdress.control.machine.machine import CATALOGUE, Machine, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import ChannelSeries
from .effort import EFFORT_CHANNELS
from .hypothesis import EffectInstance, Hypothesis, StageParams, list_stages, make_schedule
from .stages import RunData

Array = npt.NDArray[np.float64]

# Channels that share an effect form a group and are judged together.
CHANNEL_GROUPS: dict[str, tuple[str, ...]] = {
    "shaft": ("shaft",),
    "metering": ("gate", "scale", *EFFORT_CHANNELS),
    "speed": ("speed",),
    "heads": ("heads",),
}
# Share of a value by which the value is changed for its slope.
SLOPE_STEP_SHARE = 0.05
# Time around a drive's halt that is not judged, s: no effect describes how a drive runs down.
HALT_S = 3.0
# Standard deviation of a GNSS speed's time, as a share of a row: the speed was read at some time
# within the row.
GNSS_STAMP_SHARE = 0.25
# Ratio of electrical to mechanical time constant: L / R of small DC motors is 1 to 2 ms, against 20
# to 50 ms.
ELECTRICAL_RATIO = 0.04
# Maximum number of hypotheses whose predictions are cached.
MAX_CACHED_PREDICTIONS = 24


class Nuisance(NamedTuple):
    """A nominal value that is uncertain within its tolerance."""

    stage: str
    field: str
    # Change of the value for its slope.
    step: float
    # Tolerance, 1 s.d.
    sd: float

    @property
    def key(self) -> str:
        return f"{self.stage}.{self.field}"


def list_nuisances(channel: str, machine: Machine) -> tuple[Nuisance, ...]:
    """Return the tolerances of the machine file that affect a channel."""
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
    if channel in EFFORT_CHANNELS:
        own = SHAFT_EFFORT_PARTS if channel == "effort" else GATE_EFFORT_PARTS
        return tuple(
            Nuisance("effort", field, SLOPE_STEP_SHARE * value, value * t.effort_percent / 100.0)
            for field in own
            if (value := getattr(machine.effort, field)) > 0.0
        )
    if channel == "speed":
        return (Nuisance("speed", "radius_percent", 0.2, t.wheel_percent),)
    return ()


def find_tolerance(effect_id: str, machine: Machine) -> float:
    """Return the tolerance (1 s.d.) of the nominal value that an effect changes, in the unit of the
    effect's size; 0 where it changes none.

    The effect's size is known no better than the tolerance. Where a row is longer than the
    tolerance, value and effect have kinks at different places, and no slope shows that.
    """
    row = EFFECT_ROWS[effect_id]
    return sum(n.sd for n in list_nuisances(row.stage, machine) if n.field == row.moves)


def calc_equivalent_sd(effect_id: str, machine: Machine) -> float:
    """Return the standard deviation up to which a healthy machine may behave as an effect does; 0
    for most effects.

    The value is the tolerance of a nominal value, or, for a second time constant, the motor's
    electrical time constant, which a data sheet with a single time constant omits.
    """
    if effect_id == SHAFT_SECOND_ORDER.id:
        return ELECTRICAL_RATIO * machine.shaft.time_constant_s
    return find_tolerance(effect_id, machine)


def find_absorbed_effects(effect_id: str) -> tuple[str, ...]:
    """Return the effects that no nominal value off its tolerance explains where this effect is
    present: the first of two time constants is not the data sheet's."""
    return (SHAFT_SLOW.id,) if effect_id == SHAFT_SECOND_ORDER.id else ()


def find_replaced_nominals(parts: Hypothesis) -> frozenset[str]:
    """Return the nominal values (by key) that a steady effect changes or leaves to another effect.

    The size of the effect then replaces the tolerance of the value.
    """
    ids = [part.id for part in parts if part.onset_s is None]
    rows = [EFFECT_ROWS[name] for one in ids for name in (one, *find_absorbed_effects(one))]
    return frozenset(f"{row.stage}.{row.moves}" for row in rows if row.moves)


def find_stamp_sd_s(machine: Machine, step_s: float) -> float:
    """Return the standard deviation of a GNSS reading's time, s, in a log with rows of `step_s`."""
    return float(np.hypot(machine.tolerance.dead_time_s, GNSS_STAMP_SHARE * step_s))


def is_cumulative(part: EffectInstance, channel: str) -> bool:
    """Tell whether a channel accumulates an effect: a scale reads everything that has flowed."""
    return channel == "scale" and EFFECT_ROWS[part.id].stage != "scale"


def shape_over_time(change: Array, channel: ChannelSeries, part: EffectInstance) -> Array:
    """Return the change of a channel over a log from the change of a permanent effect: both (m,).

    A scale reads accumulated flow, so an effect changes nothing before its onset. Every other
    channel answers at once. This is exact for effects whose prediction is linear in their size.
    """
    return apply_course(
        change, calc_part_course(channel, part), channel.copies, is_cumulative(part, channel.name)
    )


def calc_part_course(channel: ChannelSeries, part: EffectInstance) -> Array:
    """Return the active share of an effect at each sample, from 0 to 1: (m,)."""
    time_s, onset_s = channel.grid.even_s, 0.0 if part.onset_s is None else part.onset_s
    weight = (time_s >= onset_s).astype(np.float64)
    if part.grows:
        weight = np.clip((time_s - onset_s) / max(1e-9, float(time_s[-1]) - onset_s), 0.0, 1.0)
    return weight if part.until_s is None else np.where(time_s < part.until_s, weight, 0.0)


def apply_course(change: Array, weight: Array, copies: int, summed: bool) -> Array:
    """Apply the time course of weights (..., m) to changes (..., copies x m). summed : whether the
    channel accumulates the effect."""
    if summed:
        return np.asarray(np.cumsum(np.diff(change, prepend=change[..., :1]) * weight, axis=-1))
    shaped = change.reshape(*change.shape[:-1], copies, -1) * weight[..., None, :]
    return np.asarray(shaped.reshape(*shaped.shape[:-2], -1))


def find_halt_half_width(channel: ChannelSeries) -> float:
    """Return the time before and after a halt that is not judged, s. It ends between two rows,
    because at a row a rounding error would decide whether the row counts."""
    return HALT_S - 0.5 * channel.grid.step_s


class GroupModel:
    """Model of channels that share effects, under any hypothesis.

    channels, names : of the group. data : the log, with the predicted hopper level. noise : start
    of the noise fits. base : current parameters of the stages; offsets : offsets of nominal values
    (by key). moves : revision of the nominal values, for caches of derived results. drawn_in :
    correction of each measurement for heavy tails (m,). ask : called at each run of the model; an
    exception from it ends the work.
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
        """Replace the hopper level with the predicted level: the noise of the reading would appear
        as a dependence on itself."""
        if "scale" not in self.names or data.hopper is None:
            return data
        level = np.interp(
            data.time_s, self.find_channel("scale").grid.even_s, self.predict(())["scale"]
        )
        return data._replace(variables={**data.variables, "hopper_kg": level})

    def find_channel(self, name: str) -> ChannelSeries:
        """Return a channel of the group by name; ValueError where the group has none of that
        name."""
        return self.channels[self.names.index(name)]

    @property
    def heads(self) -> int:
        """Number of canopy heads with readings."""
        return (
            0
            if self.data.heads is None
            else int(np.isfinite(self.data.heads.ndvi).any(axis=1).sum())
        )

    @property
    def nuisances(self) -> tuple[tuple[ChannelSeries, Nuisance], ...]:
        """Tolerances that affect the group, each with its channel."""
        return tuple((c, n) for c in self.channels for n in list_nuisances(c.name, self.machine))

    def predict(self, parts: Hypothesis) -> dict[str, Array]:
        """Predict each channel's reading under a hypothesis: (m,) by channel."""
        if parts not in self._predictions:
            if len(self._predictions) > MAX_CACHED_PREDICTIONS:
                self._predictions.pop(next(iter(self._predictions)))
            self._predictions[parts] = self.run_model(parts)
        return self._predictions[parts]

    def run_model(
        self,
        parts: Hypothesis,
        base: StageParams | None = None,
        only: Collection[str] | None = None,
    ) -> dict[str, Array]:
        """Run the model under a hypothesis: (m,) by channel. base : other stages; only : the
        channels to predict."""
        channels = [c for c in self.channels if only is None or c.name in only]
        if not any(part.grows for part in parts):
            return self._predict_steady(parts, channels, base)
        there = tuple(part for part in parts if not part.grows)
        steady = self._predict_cached(there, channels, base)
        now = dict(steady)
        for part in parts:
            if part.grows:
                touched = [c for c in channels if c.name in EFFECT_ROWS[part.id].channels]
                grown = self._predict_cached(
                    (*there, part._replace(onset_s=None, grows=False)), touched, base
                )
                for c in touched:
                    now[c.name] = now[c.name] + shape_over_time(
                        grown[c.name] - steady[c.name], c, part
                    )
        return now

    def _predict_steady(
        self, parts: Hypothesis, channels: Sequence[ChannelSeries], base: StageParams | None
    ) -> dict[str, Array]:
        self.ask()
        plan = make_schedule(base or self.base, parts)
        return {c.name: c.predict(plan, MAX_MODEL_STEP_S) for c in channels}

    def _predict_cached(
        self, parts: Hypothesis, channels: Sequence[ChannelSeries], base: StageParams | None
    ) -> dict[str, Array]:
        """Return the cached prediction where all channels are requested: growths of many sizes
        share the prediction."""
        if base is not None or (
            parts not in self._predictions and len(channels) < len(self.channels)
        ):
            return self._predict_steady(parts, channels, base)
        known = self.predict(parts)
        return {c.name: known[c.name] for c in channels}

    def calc_residual(self, parts: Hypothesis) -> dict[str, Array]:
        """Return measured, with corrected tails, minus predicted: (m,) by channel; 0 while a
        halting drive runs down."""
        now = self.predict(parts)
        left = {c.name: c.measured - self.drawn_in[c.name] - now[c.name] for c in self.channels}
        for part in parts:
            if CATALOGUE[part.id].effect.onset_only and part.onset_s is not None:
                channel = self.find_channel(EFFECT_ROWS[part.id].stage)
                even_s, half_s = channel.grid.even_s, find_halt_half_width(channel)
                halts = np.abs(even_s - part.onset_s) < half_s
                left[channel.name] = np.where(halts, 0.0, left[channel.name])
        return left

    def calc_banded_residual(self, parts: Hypothesis) -> dict[str, Array]:
        """Return cosine coefficients of the residual, sorted by band: (m,) by channel."""
        left = self.calc_residual(parts)
        return {c.name: calc_coefficients(left[c.name], c.cut) for c in self.channels}

    def calc_difference(self, parts: Hypothesis, more: EffectInstance) -> dict[str, Array]:
        """Return the change from a further effect in the channels that the effect changes: (m,) by
        channel."""
        now = self.predict(parts)
        return {
            name: one - now[name]
            for name, one in self.run_model(
                (*parts, more), only=EFFECT_ROWS[more.id].channels
            ).items()
        }

    def find_nominal(self, nuisance: Nuisance) -> float:
        """Return a value as the machine file declares it."""
        return float(getattr(getattr(self.machine, nuisance.stage), nuisance.field))

    def set_weights(self, name: str, weights: Array | None) -> None:
        """Weight the samples of a channel (m,), whose noise differs between them; None: equally."""
        self.channels = tuple(
            c._replace(cut=c.cut._replace(weights=weights)) if c.name == name else c
            for c in self.channels
        )
        self.moves += 1

    def set_offsets(self, offsets: Mapping[str, float]) -> None:
        """Set offsets of nominal values from the machine file's values (by key; other values have
        no offset)."""
        for _, n in self.nuisances:
            self.base = self.base.replace_fields(
                n.stage, **{n.field: float(self.find_nominal(n) + offsets.get(n.key, 0.0))}
            )
        self.offsets = dict(offsets)
        self.moves += 1
        self._predictions.clear()
