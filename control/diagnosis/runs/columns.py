"""Builds the regression columns of a group: tolerances, slopes of effects, freedom of shape, and
candidates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.evidence import (
    Column,
    ColumnLabel,
    ColumnRole,
    Problem,
    make_evidence_problem,
    project_out_fixed,
)
from topdress.control.diagnosis.judgement.noise import calc_coefficients, make_series
from topdress.control.diagnosis.judgement.prior import FORM_SHARE, find_size_sd
from topdress.control.machine.effect import HOPPER_CAPACITY
from topdress.control.machine.machine import Machine, find_size_bounds, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
from topdress.control.machine.terms import name_own_command

from .channels import ChannelSeries
from .hypothesis import EffectInstance, Hypothesis, make_schedule
from .model import (
    GroupModel,
    apply_course,
    calc_part_course,
    find_halt_half_width,
    find_replaced_nominals,
    find_stamp_sd_s,
    is_cumulative,
)
from .smooth import STAGE_TABLES, find_variable_span, list_shape_series

Array = npt.NDArray[np.float64]

# Prior standard deviation of a growth's deviation from a straight line, as a share of the size:
# half-wave and whole wave.
GROWTH_BEND_SDS = (0.3, 0.15)
# Number of half-waves in the shapes of a size over time: one for up or down, two for there and
# back.
MAX_HALF_WAVES = 2
# Share of a tolerance by which a nominal value may vary between operating conditions of one
# machine.
VARIATION_SHARE = 0.5
# Standard deviation of a refill that the operator wrote down, kg, on the nominal machine.
REFILL_SD_KG = 0.5
# The noted refill mass has a prior with Cauchy tails: the wrong bag, or a typing error.
NOTED_REFILL = "refill"
# Standard deviation of the level at the start and of a refill without a note, kg, on the nominal
# machine.
UNKNOWN_SD_KG = 20.0
# Standard deviation of the mean rounding error, as a share of an encoder's step.
ROUNDING_SD_SHARE = 0.1
# Share of a gain's largest change below which the shaft counts as standing.
MIN_TURNING_SHARE = 1e-3
# Prior standard deviation of the drive load from a blocked outlet, as a share of the load: nobody
# has measured the load.
PACKING_SD_SHARE = 0.5
# Maximum number of candidate columns in the cache.
MAX_CACHED_COLUMNS = 200
# Maximum number of nuisance column sets in the cache, one set for each dead time.
MAX_CACHED_NUISANCES = 8
# Time difference for the slope of a GNSS reading's latency, s: half a row, the accuracy to which
# the latency is known.
LATENCY_STEP_S = 0.05
# This nominal value delays a drive's motion.
DEAD_TIME = "dead_time_s"


def _make_column(
    model: GroupModel,
    label: ColumnLabel,
    series_of_channel: dict[str, Array],
    sd: float = np.inf,
    mean: float = 0.0,
) -> Column:
    """Build a column from series (m,) by channel. sd, mean : prior of the column's amplitude."""
    cuts = {c.name: c.cut for c in model.channels}
    return Column(
        label,
        {name: calc_coefficients(one, cuts[name]) for name, one in series_of_channel.items()},
        sd,
        mean,
    )


def list_nuisance_columns(model: GroupModel, late: Hypothesis = ()) -> list[Column]:
    """Return the columns that are free under every hypothesis, by channel: tolerances, and the
    uncertainties of the readings.

    late : steady effects of the hypothesis that delay the drives.
    """
    return [
        column
        for channel in model.channels
        for column in (
            *_list_tolerance_columns(model, channel, late),
            *_list_reading_columns(model, channel),
        )
    ]


def _list_tolerance_columns(
    model: GroupModel, channel: ChannelSeries, late: Hypothesis
) -> list[Column]:
    """Return the slopes of the prediction in the uncertain nominal values, at their current values.

    Slopes of time constants are nonzero only while the drive moves. Where an effect delays the
    motion, the slope must include the effect, else the slope falls on rows without motion.
    """
    found: list[Column] = []
    here = tuple(part for part in late if channel.name in EFFECT_ROWS[part.id].channels)
    now = model.predict(here)[channel.name]
    for one, n in model.nuisances:
        if one is not channel:
            continue
        value = getattr(model.base.by_name[n.stage], n.field) + n.step
        plan = make_schedule(model.base.replace_fields(n.stage, **{n.field: value}), here)
        change = (channel.predict(plan, MAX_MODEL_STEP_S) - now) / n.step
        found.append(
            _make_column(
                model,
                ColumnLabel(ColumnRole.TOLERANCE, n.key),
                {channel.name: change},
                n.sd,
                -model.offsets.get(n.key, 0.0),
            )
        )
        if channel.name == "shaft" and n.field != "gain_percent":
            found += _list_variation_columns(model, n.key, change, now, VARIATION_SHARE * n.sd)
    return found


def _list_variation_columns(
    model: GroupModel, key: str, change: Array, rpm: Array, sd: float
) -> list[Column]:
    """Return columns of a tolerance that differs between low and high speed, and between rising and
    falling commands."""
    middle, half = 0.5 * float(rpm.max() + rpm.min()), 0.5 * float(np.ptp(rpm)) + 1e-9
    way = np.sign(np.gradient(rpm))
    return [
        _make_column(
            model, ColumnLabel(ColumnRole.TRAIT, key), {"shaft": change * (rpm - middle) / half}, sd
        ),
        _make_column(model, ColumnLabel(ColumnRole.TRAIT, key), {"shaft": change * way}, sd),
    ]


def _list_reading_columns(model: GroupModel, channel: ChannelSeries) -> list[Column]:
    """Return columns of the uncertainties of the readings: rounding, level and refills, time
    stamps, heads."""
    label, data = ColumnLabel(ColumnRole.READING), model.data
    if channel.name == "shaft" and data.shaft is not None and data.shaft.step > 0.0:
        turning = (model.predict(())["shaft"] > data.shaft.step).astype(np.float64)
        if data.shaft.steps_from_s is not None:
            turning = turning * (channel.grid.even_s >= data.shaft.steps_from_s)
        return [_make_column(model, label, {"shaft": turning}, ROUNDING_SD_SHARE * data.shaft.step)]
    if channel.name == "scale" and data.hopper is not None:
        bins, hopper = (
            np.arange(len(data.hopper.reading_kg)),
            scale_nominal(model.machine, HOPPER_CAPACITY),
        )
        steps = [
            channel.grid.interpolate((bins >= jump).astype(np.float64))
            for jump in data.hopper.jumps
        ]
        return [
            _make_column(
                model, label, {"scale": np.ones(len(channel.measured))}, hopper * UNKNOWN_SD_KG
            ),
            *(
                _make_column(
                    model,
                    ColumnLabel(ColumnRole.READING, NOTED_REFILL) if written else label,
                    {"scale": after},
                    hopper * (REFILL_SD_KG if written else UNKNOWN_SD_KG),
                )
                for after, written in zip(steps, data.hopper.written, strict=True)
            ),
            *(
                _make_column(
                    model,
                    label,
                    {"scale": channel.grid.interpolate((bins >= end).astype(np.float64))},
                    metered * model.machine.flow.grams_per_rev_mm / 60_000.0,
                )
                for end, metered in data.hopper.gaps
            ),
        ]
    if channel.name == "speed":
        late = model.calc_difference(
            (), EffectInstance(effects.SPEED_GNSS_LATENCY.id, LATENCY_STEP_S)
        )
        stamp = {name: change / LATENCY_STEP_S for name, change in late.items()}
        found = [
            _make_column(model, label, stamp, find_stamp_sd_s(model.machine, channel.grid.step_s))
        ]
        if data.speed is not None and data.speed.unseen_percent > 0.0:
            short = model.calc_difference((), EffectInstance(effects.SPEED_WHEEL_RADIUS.id, 1.0))
            found.append(_make_column(model, label, short, data.speed.unseen_percent))
        return found
    if channel.name == "heads":
        ones = [
            model.calc_difference(
                (), EffectInstance(effects.CANOPY_HEAD_FOULED.id, 1.0, None, k + 1)
            )
            for k in range(model.heads)
        ]
        return [
            _make_column(model, label, one, model.machine.tolerance.head_percent) for one in ones
        ]
    return []


class ShapeColumns:
    """Columns of the smooth shapes of each stage over each recorded variable, built at the first
    use."""

    def __init__(self, model: GroupModel) -> None:
        self._model = model
        self._units = {
            stage: _calc_unit_response(model, table.unit)
            for stage, table in STAGE_TABLES.items()
            if table.channel in model.names and stage != "scale"
        }
        self._made: dict[tuple[str, str], list[Column]] = {}

    def list_over_variable(self, stage: str, variable: str, moves: Hypothesis = ()) -> list[Column]:
        """Return the columns of a stage over a variable; empty where the variable hardly changes.

        moves : effects of a hypothesis that change how the stage's drive moves, because a shape
        acts when the drive moves.
        """
        if moves:
            return self._list_form_columns(stage, variable, moves)
        if (stage, variable) not in self._made:
            self._made[(stage, variable)] = self._list_form_columns(stage, variable, ())
        return self._made[(stage, variable)]

    def _list_form_columns(self, stage: str, variable: str, moves: Hypothesis) -> list[Column]:
        model, name, data = self._model, STAGE_TABLES[stage].channel, self._model.data
        over = find_variable_span(data, variable, model.machine)
        if over is None or name not in model.names:
            return []
        unit = (
            _calc_unit_response(model, STAGE_TABLES[stage].unit, moves)
            if moves
            else self._units.get(stage, np.ones(1))
        )
        own = (
            model.predict(moves)[name]
            if moves and name_own_command(stage, variable) != variable
            else None
        )
        rows = list_shape_series(
            stage,
            over,
            model.find_channel(name),
            unit,
            data=data,
            base=model.base,
            machine=model.machine,
            own=own,
        )
        return [_make_column(model, ColumnLabel(ColumnRole.FORM), {name: row}) for row in rows]


def _calc_unit_response(model: GroupModel, part: EffectInstance, others: Hypothesis = ()) -> Array:
    """Return the change per unit of an effect in the first channel that the effect changes, from
    the difference at the probe size."""
    size = EFFECT_ROWS[part.id].scale_to_machine(model.machine).probe
    assert size is not None
    return next(iter(model.calc_difference(others, part._replace(size=size)).values())) / size


class HypothesisColumns:
    """Columns of a group's hypotheses, built by running the group's model; candidate columns are
    cached while the model is unchanged."""

    def __init__(self, model: GroupModel) -> None:
        self.model = model
        self.forms = ShapeColumns(model)
        self._kept: dict[tuple[Hypothesis, EffectInstance], Column] = {}
        # Caches the time course of the shaft's gain by effect instance.
        self._courses: dict[EffectInstance, Array] = {}
        # Caches nuisance columns by the effects that delay the drives.
        self._fixed: dict[Hypothesis, list[Column]] = {}
        # Revision of the model's nominal values for which the caches are valid.
        self._made_at = -1

    def _refresh_model(self) -> None:
        if self._made_at != self.model.moves:
            self._made_at = self.model.moves
            self._kept.clear()
            self._courses.clear()
            self._fixed.clear()

    def list_fixed_columns(self, parts: Hypothesis = ()) -> list[Column]:
        """Return the nuisance columns at the current nominal values, without the values that an
        effect of the hypothesis replaces."""
        self._refresh_model()
        moved = find_replaced_nominals(parts)
        return [
            *(
                c
                for c in self._list_nuisance_columns(parts)
                if c.label.role is not ColumnRole.TOLERANCE or c.label.name not in moved
            ),
            *self.list_stop_columns(parts),
        ]

    def list_stop_columns(self, parts: Hypothesis) -> list[Column]:
        """Return a column for the position of each stuck gate, and for the load of each blocked
        outlet."""
        return [
            self._make_stop_column(parts, part)
            for part in parts
            if part.id == effects.GATE_STUCK.id
        ] + [
            self._make_packing_column(parts)
            for part in parts
            if part.id == effects.FLOW_BLOCKED_OUTLET.id
            and "effort" in self.model.names
            and self.model.machine.effort.jam > 0.0
        ]

    def _list_nuisance_columns(self, parts: Hypothesis) -> list[Column]:
        late = tuple(
            part
            for part in parts
            if EFFECT_ROWS[part.id].moves == DEAD_TIME and part.onset_s is None
        )
        if late not in self._fixed:
            if len(self._fixed) > MAX_CACHED_NUISANCES:
                self._fixed.clear()
            self._fixed[late] = list_nuisance_columns(self.model, late)
        return self._fixed[late]

    def _make_stop_column(self, parts: Hypothesis, stuck: EffectInstance) -> Column:
        """Return the column of the unknown position at which a gate stuck within a move.

        The gate stands anywhere on its way between two rows. The first seconds after a halt are not
        judged.
        """
        model, home = (
            self.model,
            EFFECT_ROWS[effects.GATE_HOME_ERROR.id].scale_to_machine(self.model.machine),
        )
        assert home.probe is not None
        channel = model.find_channel("gate")
        halted_s = (stuck.onset_s or 0.0) + find_halt_half_width(channel)
        off = self.make_candidate_column(parts, EffectInstance(home.id, home.probe, halted_s))
        return off._replace(
            label=ColumnLabel(ColumnRole.READING),
            sd=model.machine.gate.slew_mm_s * channel.grid.step_s,
        )

    def _make_packing_column(self, parts: Hypothesis) -> Column:
        """Return the column of the load behind a closed outlet, which varies with the product and
        with how the outlet closed."""
        jam = self.model.base.by_name["effort"].jam
        harder = self.model.run_model(
            parts, self.model.base.replace_fields("effort", jam=jam + 1.0), ("effort",)
        )["effort"]
        return _make_column(
            self.model,
            ColumnLabel(ColumnRole.READING),
            {"effort": harder - self.model.predict(parts)["effort"]},
            PACKING_SD_SHARE * jam,
        )

    def list_slopes(self, parts: Hypothesis) -> list[Column]:
        """Return the slope of the prediction in each effect's size, at the hypothesis."""
        model, found = self.model, []
        for k, part in enumerate(parts):
            row = EFFECT_ROWS[part.id]
            if not row.has_slope:
                continue
            step = _choose_slope_step(part, model.machine)
            moved = (*parts[:k], part._replace(size=part.size + step), *parts[k + 1 :])
            now = model.predict(parts)
            change = {
                name: (one - now[name]) / step
                for name, one in model.run_model(moved, only=row.channels).items()
            }
            found.append(
                _make_column(
                    self.model,
                    ColumnLabel(ColumnRole.SLOPE, part.id, k),
                    change,
                    find_size_sd(part.size, row.scale_to_machine(model.machine).usual),
                    -part.size,
                )
            )
        return found

    def list_shape_columns(self, parts: Hypothesis, slopes: Sequence[Column]) -> list[Column]:
        """Return the freedom of shape of each effect: smooth functions of its variable, with a
        prior proportional to its signal."""
        found: list[Column] = []
        fixed = self.list_fixed_columns(parts)
        for slope in slopes:
            part = parts[slope.label.part]
            found += self._list_growth_bends(parts, slope.label.part)
            wobbles = self._list_form_wobbles(parts, part)
            if not wobbles:
                continue
            nothing = {c.name: np.zeros(len(c.cut.order)) for c in self.model.channels}
            p = make_evidence_problem(self.model.channels, nothing, [*fixed, slope, *wobbles])
            normal = project_out_fixed(p, np.arange(len(fixed)), self.model.noise).A
            own = normal[len(fixed), len(fixed)]
            for k, wobble in enumerate(wobbles):
                at = len(fixed) + 1 + k
                ratio = max(own, 0.0) / max(normal[at, at], 1e-12) / len(wobbles)
                sd = FORM_SHARE * abs(part.size) * np.sqrt(ratio)
                free = wobble._replace(
                    label=ColumnLabel(ColumnRole.FORM, part.id, slope.label.part),
                    sd=max(1e-9, float(sd)),
                )
                found.append(_remove_slopes(free, slopes))
        return found

    def _list_growth_bends(self, parts: Hypothesis, k: int) -> list[Column]:
        """Return time shapes by which effect k may grow unevenly; empty where the effect does not
        grow."""
        part, model = parts[k], self.model
        if not part.grows or part.size == 0.0:
            return []
        there = tuple(other for other in parts if not other.grows)
        steady, grown = (
            model.predict(there),
            model.predict((*there, part._replace(onset_s=None, grows=False))),
        )
        channels = [c for c in model.channels if c.name in EFFECT_ROWS[part.id].channels]
        whole = {c.name: grown[c.name] - steady[c.name] for c in channels}
        return [
            _make_column(
                model,
                ColumnLabel(ColumnRole.FORM, part.id, k),
                {
                    c.name: apply_course(
                        whole[c.name],
                        np.sin(waves * np.pi * calc_part_course(c, part)),
                        c.copies,
                        is_cumulative(part, c.name),
                    )
                    / part.size
                    for c in channels
                },
                max(1e-9, bend * abs(part.size)),
            )
            for waves, bend in enumerate(GROWTH_BEND_SDS, start=1)
        ]

    def _list_form_wobbles(self, parts: Hypothesis, part: EffectInstance) -> list[Column]:
        """Return shapes by which an effect may deviate from its functional form, over its own
        variable and over those of its sibling effects."""
        row = EFFECT_ROWS[part.id]
        moves = tuple(
            p
            for p in parts
            if EFFECT_ROWS[p.id].stage == row.stage
            and EFFECT_ROWS[p.id].move_shaped
            and p.id != part.id
        )
        over = (
            self.forms.list_over_variable(row.stage, row.form_over, moves) if row.form_over else []
        )
        found = [self._restrict_to_course(column, part, row.stage) for column in over]
        for sibling in row.siblings:
            step = EFFECT_ROWS[sibling].scale_to_machine(self.model.machine).trial_sizes[1]
            change = self.model.calc_difference(parts, part._replace(id=sibling, size=step))
            found.append(
                _make_column(
                    self.model,
                    ColumnLabel(ColumnRole.FORM),
                    {name: one / step for name, one in change.items()},
                )
            )
        return found

    def _restrict_to_course(self, column: Column, part: EffectInstance, stage: str) -> Column:
        """Multiply a shape column by the time course of an effect that begins, ends or grows."""
        if part.onset_s is None:
            return column
        found = {}
        for channel in self.model.channels:
            if channel.name in column.coefficients:
                whole = make_series(column.coefficients[channel.name], channel.cut)
                # The shape follows the motor's time constant, as the column of the effect itself
                # does.
                if stage == "shaft":
                    found[channel.name] = whole * self._calc_shaft_course(channel, part)
                else:
                    found[channel.name] = apply_course(
                        whole,
                        calc_part_course(channel, part),
                        channel.copies,
                        is_cumulative(part, channel.name),
                    )
        return _make_column(self.model, column.label, found)

    def _calc_shaft_course(self, channel: ChannelSeries, part: EffectInstance) -> Array:
        """Return the share of a constant shaft gain that shows at each sample, when the gain has
        the time course of an effect: (m,)."""
        self._refresh_model()
        unit = STAGE_TABLES["shaft"].unit
        size = EFFECT_ROWS[unit.id].scale_to_machine(self.model.machine).probe
        assert size is not None
        here = part._replace(id=unit.id, size=size)
        if here not in self._courses:
            if len(self._courses) > MAX_CACHED_COLUMNS:
                self._courses.clear()
            all_along, there = (
                self.model.calc_difference((), one)[channel.name]
                for one in (unit._replace(size=size), here)
            )
            turns = np.abs(all_along) > MIN_TURNING_SHARE * float(
                np.abs(all_along).max(initial=1e-12)
            )
            self._courses[here] = np.divide(
                there, all_along, out=calc_part_course(channel, part), where=turns
            )
        return self._courses[here]

    def make_candidate_column(self, parts: Hypothesis, part: EffectInstance) -> Column:
        """Return the predicted change for one unit of a candidate effect that is added to a
        hypothesis."""
        self._refresh_model()
        if (parts, part) not in self._kept:
            if len(self._kept) > MAX_CACHED_COLUMNS:
                self._kept.clear()
            change = self.model.calc_difference(parts, part)
            self._kept[(parts, part)] = _make_column(
                self.model,
                ColumnLabel(ColumnRole.CANDIDATE, part.id),
                {name: one / part.size for name, one in change.items()},
                EFFECT_ROWS[part.id].scale_to_machine(self.model.machine).usual,
            )
        return self._kept[(parts, part)]

    def list_time_shapes(self, slope: Column, part: EffectInstance) -> list[Column]:
        """Return an effect's slope multiplied by smooth functions of the time during which the
        effect acts: its size may vary over time."""
        found: list[dict[str, Array]] = [{} for _ in range(MAX_HALF_WAVES)]
        for channel in (c for c in self.model.channels if c.name in slope.coefficients):
            time_s, series = (
                channel.grid.even_s,
                make_series(slope.coefficients[channel.name], channel.cut),
            )
            begin_s = time_s[0] if part.onset_s is None else part.onset_s
            end_s = time_s[-1] if part.until_s is None else part.until_s
            share = np.clip((time_s - begin_s) / max(1e-9, end_s - begin_s), 0.0, 1.0)
            for waves, shape in enumerate(found, start=1):
                shape[channel.name] = apply_course(
                    series,
                    np.cos(waves * np.pi * share),
                    channel.copies,
                    is_cumulative(part, channel.name),
                )
        return [
            _make_column(
                self.model,
                ColumnLabel(ColumnRole.FORM, part.id, slope.label.part),
                shape,
                max(1e-9, abs(part.size)),
            )
            for shape in found
        ]

    def make_effect_column(self, parts: Hypothesis, k: int) -> Column:
        """Return the change from the whole of effect k, with the other effects in place."""
        return _make_column(
            self.model,
            ColumnLabel(ColumnRole.TRACE, parts[k].id, k),
            self.model.calc_difference((*parts[:k], *parts[k + 1 :]), parts[k]),
        )

    def make_difference_column(self, parts: Hypothesis, others: Hypothesis) -> Column:
        """Return the difference between a hypothesis and another. The sizes of the other hypothesis
        may differ far from those of this one."""
        with_it, without = self.model.predict(parts), self.model.predict(others)
        return _make_column(
            self.model,
            ColumnLabel(ColumnRole.TRACE),
            {name: one - without[name] for name, one in with_it.items()},
        )

    def list_columns(self, parts: Hypothesis) -> list[Column]:
        """Return nuisances, slopes and shapes of a hypothesis, in the order of
        `compress_hypothesis`."""
        slopes = self.list_slopes(parts)
        return [*self.list_fixed_columns(parts), *slopes, *self.list_shape_columns(parts, slopes)]

    def compress_hypothesis(
        self, parts: Hypothesis, more: Sequence[Column] = ()
    ) -> tuple[Problem, int]:
        """Return the regression problem at a hypothesis, with columns in the order nuisances,
        slopes, shapes, `more`, and the number of columns before `more`."""
        base = self.list_columns(parts)
        self.model.ask()
        return make_evidence_problem(
            self.model.channels, self.model.calc_banded_residual(parts), [*base, *more]
        ), len(base)

    def group_by_channel(self, parts: Hypothesis) -> dict[str, list[tuple[Column, Array]]]:
        """Return the nuisances and slopes of a hypothesis by the channel that they change, each
        with its series (m,)."""
        found: dict[str, list[tuple[Column, Array]]] = {c.name: [] for c in self.model.channels}
        for column in [*self.list_fixed_columns(parts), *self.list_slopes(parts)]:
            for channel in self.model.channels:
                if channel.name in column.coefficients:
                    found[channel.name].append(
                        (column, make_series(column.coefficients[channel.name], channel.cut))
                    )
        return found


def _remove_slopes(form: Column, slopes: Sequence[Column]) -> Column:
    """Make a shape orthogonal to the slopes, over all rows alike.

    The sizes are then those with which the machine file, which has no freedom of shape, predicts
    best (orthogonal discrepancy: Plumlee, JASA 112, 2017, 1274).
    """
    found = {}
    for name, values in form.coefficients.items():
        there = [slope.coefficients[name] for slope in slopes if name in slope.coefficients]
        basis = np.array(there).T if there else np.zeros((len(values), 0))
        found[name] = (
            values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0] if there else values
        )
    return form._replace(coefficients=found)


def _choose_slope_step(part: EffectInstance, machine: Machine) -> float:
    """Return the size difference for an effect's slope, with the sign that points away from the
    bound of the size."""
    row = EFFECT_ROWS[part.id].scale_to_machine(machine)
    step = row.probe or max(0.002, 0.02 * abs(part.size))
    if row.trial_sizes:
        step = max(0.02 * abs(part.size), 0.02 * abs(row.tried[-1]))
    if part.id == effects.SPEED_GNSS_LATENCY.id:
        step = LATENCY_STEP_S
    return step if part.size + step <= find_size_bounds(part.id, machine).high else -step
