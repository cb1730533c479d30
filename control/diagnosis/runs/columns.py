"""What one unit of anything does to a group's channels: tolerances, slopes of parts, freedom of form, candidates."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from control.diagnosis import effects
from control.diagnosis.effects import ROWS
from control.diagnosis.judgement.evidence import Column, Label, Problem, Role, problem
from control.diagnosis.judgement.noise import coefficients, series_of
from control.diagnosis.judgement.prior import FORM_SHARE, sd_of_size
from control.machine.effect import HOPPER
from control.machine.machine import Machine, bounds, of_nominal
from control.machine.over_log import MOST_STEP_S
from control.machine.terms import own_command

from .channels import ChannelSeries
from .hypothesis import EffectInstance, Hypothesis, schedule
from .model import HALT_S, GroupModel, adds_up, course, stamp_sd_s, stood_for, with_course
from .smooth import MIN_RANGE, RANGES, TABLES

Array = npt.NDArray[np.float64]

SHAPES = 4                  # half-waves over the range of a variable: slope, bend, and two finer ones
TRAIT_SHARE = 0.5           # of a tolerance, by which it may differ from case to case within one machine
REFILL_SD_KG = 0.5          # of what the operator wrote down; on the nominal machine, as the next
WRITTEN = "refill"          # ... which has the tails of a Cauchy distribution: the wrong bag, or a slip of the pen
UNKNOWN_KG = 20.0           # (1 s.d.) the level at the start, and a refill that nobody wrote down
ROUNDING_SHARE = 0.1        # of an encoder's step: how well the mean error of rounding is known
MAX_KEPT = 200              # columns of candidates that are kept
MOST_LATE = 8               # ... and sets of nuisances: one for each dead time
LATENCY_STEP_S = 0.05       # difference for the slope of a GNSS reading's latency: half a row, as it is known
DEAD_TIME = "dead_time_s"   # nominal value: with another one a drive moves later


def _column(model: GroupModel, label: Label, series_of_channel: dict[str, Array], sd: float = np.inf,
            mean: float = 0.0) -> Column:
    """A column of series (m,) by channel. sd, mean : prior of its amplitude."""
    cuts = {c.name: c.cut for c in model.channels}
    return Column(label, {name: coefficients(one, cuts[name]) for name, one in series_of_channel.items()}, sd, mean)


def nuisance_columns(model: GroupModel, late: Hypothesis = ()) -> list[Column]:
    """What is open under every hypothesis, channel by channel: tolerances, and what the readings leave open.

    late : steady parts of a hypothesis with which drives move later.
    """
    return [column for channel in model.channels
            for column in (*_of_tolerances(model, channel, late), *_of_readings(model, channel))]


def _of_tolerances(model: GroupModel, channel: ChannelSeries, late: Hypothesis) -> list[Column]:
    """Slopes of the prediction in the nominal values that may be off, where these stand now. Those of times show when
    the drive moves: where a part has it move later, a slope without that part is where nothing moves."""
    found: list[Column] = []
    here = tuple(part for part in late if channel.name in ROWS[part.id].channels)
    now = model.predicted(here)[channel.name]
    for one, n in model.nuisances:
        if one is not channel:
            continue
        value = getattr(model.base.by_name[n.stage], n.field) + n.step
        plan = schedule(model.base.put(n.stage, **{n.field: value}), here)
        change = (channel.predict(plan, MOST_STEP_S) - now) / n.step
        found.append(_column(model, Label(Role.TOLERANCE, n.key), {channel.name: change}, n.sd,
                             -model.offsets.get(n.key, 0.0)))
        if channel.name == "shaft" and n.field != "gain_percent":
            found += _by_speed_and_way(model, n.key, change, now, TRAIT_SHARE * n.sd)
    return found


def _by_speed_and_way(model: GroupModel, key: str, change: Array, rpm: Array, sd: float) -> list[Column]:
    """The same tolerance, unlike at low and high speed and for rising and falling commands."""
    middle, half = 0.5 * float(rpm.max() + rpm.min()), 0.5 * float(np.ptp(rpm)) + 1e-9
    way = np.sign(np.gradient(rpm))
    return [_column(model, Label(Role.TRAIT, key), {"shaft": change * (rpm - middle) / half}, sd),
            _column(model, Label(Role.TRAIT, key), {"shaft": change * way}, sd)]


def _of_readings(model: GroupModel, channel: ChannelSeries) -> list[Column]:
    """What the readings themselves leave open: rounding, level and refills, time stamps, heads."""
    label, data = Label(Role.READING), model.data
    if channel.name == "shaft" and data.shaft is not None and data.shaft.step > 0.0:
        turning = (model.predicted(())["shaft"] > data.shaft.step).astype(np.float64)
        if data.shaft.steps_from_s is not None:
            turning = turning * (channel.grid.even_s >= data.shaft.steps_from_s)
        return [_column(model, label, {"shaft": turning}, ROUNDING_SHARE * data.shaft.step)]
    if channel.name == "scale" and data.hopper is not None:
        bins, hopper = np.arange(len(data.hopper.reading_kg)), of_nominal(model.machine, HOPPER)
        steps = [channel.grid.of((bins >= jump).astype(np.float64)) for jump in data.hopper.jumps]
        return [_column(model, label, {"scale": np.ones(len(channel.measured))}, hopper * UNKNOWN_KG),
                *(_column(model, Label(Role.READING, WRITTEN) if written else label, {"scale": after},
                          hopper * (REFILL_SD_KG if written else UNKNOWN_KG))
                  for after, written in zip(steps, data.hopper.written, strict=True)),
                *(_column(model, label, {"scale": channel.grid.of((bins >= end).astype(np.float64))},
                          metered * model.machine.flow.grams_per_rev_mm / 60_000.0)
                  for end, metered in data.hopper.gaps)]
    if channel.name == "speed":
        late = model.difference((), EffectInstance(effects.SPEED_GNSS_LATENCY.id, LATENCY_STEP_S))
        stamp = {name: change / LATENCY_STEP_S for name, change in late.items()}
        found = [_column(model, label, stamp, stamp_sd_s(model.machine, channel.grid.step_s))]
        if data.speed is not None and data.speed.unseen_percent > 0.0:
            short = model.difference((), EffectInstance(effects.SPEED_WHEEL_RADIUS.id, 1.0))
            found.append(_column(model, label, short, data.speed.unseen_percent))
        return found
    if channel.name == "heads":
        ones = [model.difference((), EffectInstance(effects.CANOPY_HEAD_FOULED.id, 1.0, None, k + 1))
                for k in range(model.heads)]
        return [_column(model, label, one, model.machine.tolerance.head_percent) for one in ones]
    return []


def place_along(model: GroupModel, variable: str, channel: ChannelSeries, parts: Hypothesis = ()) -> Array | None:
    """A recorded variable at a channel's samples, from 0 to 1 between its 1st and 99th percentile: (m,); None where it
    hardly moves. Of what a drive is asked for, where the drive is: a form comes when it does."""
    values = model.data.variables.get(variable)
    if values is None:
        return None
    low, high = np.percentile(values, (1.0, 99.0))
    least = of_nominal(model.machine, RANGES.get(variable, ())) * MIN_RANGE.get(variable, float(np.finfo(float).tiny))
    if not high - low >= least:
        return None
    there = model.predicted(parts)[channel.name] if own_command(channel.name, variable) != variable else np.interp(
        channel.grid.even_s, model.data.time_s, values)
    return np.asarray(np.clip((there - low) / (high - low), 0.0, 1.0))


def half_waves(change: Array, place: Array, channel: ChannelSeries, summed: bool) -> list[Array]:
    """A change (copies x m) times cos(pi k place), k from 1 to SHAPES. summed : the channel adds it up."""
    return [with_course(change, np.cos(np.pi * k * place), channel.copies, summed) for k in range(1, SHAPES + 1)]


class Columns:
    """Columns of a group's hypotheses, made by running its model; those of candidates are kept while it stands."""

    def __init__(self, model: GroupModel) -> None:
        self.model = model
        self._kept: dict[tuple[Hypothesis, EffectInstance], Column] = {}
        self._fixed: dict[Hypothesis, list[Column]] = {}        # by the parts with which drives move later
        self._made_at = -1          # of the model's moves

    def _refresh(self) -> None:
        if self._made_at != self.model.moves:
            self._made_at = self.model.moves
            self._kept.clear()
            self._fixed.clear()

    def fixed(self, parts: Hypothesis = ()) -> list[Column]:
        """The nuisances, at the nominal values as they stand, but for those that a part of the hypothesis moves."""
        self._refresh()
        moved = stood_for(parts)
        return [*(c for c in self._nuisances(parts) if c.label.role is not Role.TOLERANCE or c.label.name not in moved),
                *self.of_stops(parts)]

    def of_stops(self, parts: Hypothesis) -> list[Column]:
        """Where each gate that stuck stands."""
        return [self._where_it_stands(parts, part) for part in parts if part.id == effects.GATE_STUCK.id]

    def _nuisances(self, parts: Hypothesis) -> list[Column]:
        late = tuple(part for part in parts if ROWS[part.id].moves == DEAD_TIME and part.onset_s is None)
        if late not in self._fixed:
            if len(self._fixed) > MOST_LATE:
                self._fixed.clear()
            self._fixed[late] = nuisance_columns(self.model, late)
        return self._fixed[late]

    def _where_it_stands(self, parts: Hypothesis, stuck: EffectInstance) -> Column:
        """A gate that stuck within a move stands anywhere on the way that it goes from row to row. The first seconds
        after a halt are left out of what is judged (HALT_S)."""
        model, home = self.model, ROWS[effects.GATE_HOME_ERROR.id].on(self.model.machine)
        assert home.probe is not None
        off = self.of_candidate(parts, EffectInstance(home.id, home.probe, (stuck.onset_s or 0.0) + HALT_S))
        return off._replace(label=Label(Role.READING),
                            sd=model.machine.gate.slew_mm_s * model.channel("gate").grid.step_s)

    def slopes(self, parts: Hypothesis) -> list[Column]:
        """Slope of the prediction in each part's size, at the hypothesis."""
        model, found = self.model, []
        for k, part in enumerate(parts):
            row = ROWS[part.id]
            if not row.has_slope:
                continue
            step = _slope_step(part, model.machine)
            moved = (*parts[:k], part._replace(size=part.size + step), *parts[k + 1:])
            now = model.predicted(parts)
            change = {name: (one - now[name]) / step for name, one in model.run(moved, only=row.channels).items()}
            found.append(_column(self.model, Label(Role.SLOPE, part.id, k), change,
                                 sd_of_size(part.size, row.on(model.machine).usual), -part.size))
        return found

    def form_columns(self, parts: Hypothesis, slopes: Sequence[Column]) -> list[Column]:
        """Freedom of form of each part: with x(t) what one unit of it does and u(t) in [0, 1] its own variable, the
        machine may do x(t) (1 + sum of a_k cos(pi k u)), a_k ~ N(0, FORM_SHARE^2 / SHAPES). So a form begins, ends and
        passes through the drive as its part does. What grows may do so unevenly: u is then how far the log is."""
        found: list[Column] = []
        for slope in slopes:
            part = parts[slope.label.part]
            series: list[dict[str, Array]] = [{} for _ in range(SHAPES)]
            for channel in self.model.channels:
                if channel.name in slope.coefficients and (place := self._own_place(parts, part, channel)) is not None:
                    own = series_of(slope.coefficients[channel.name], channel.cut)
                    for shape, one in zip(series, half_waves(own, place, channel, adds_up(part, channel.name)),
                                          strict=True):
                        shape[channel.name] = one
            sd = max(1e-9, FORM_SHARE * abs(part.size) / float(np.sqrt(SHAPES)))
            label = Label(Role.FORM, part.id, slope.label.part)
            forms = [_column(self.model, label, shape, sd) for shape in series if shape]
            for sibling in ROWS[part.id].siblings:
                step = ROWS[sibling].on(self.model.machine).trial_sizes[1]
                other = _column(self.model, label, self.model.difference(parts, part._replace(id=sibling, size=step)))
                forms.append(other._replace(sd=max(1e-9, FORM_SHARE * abs(part.size) * _length(slope) / max(
                    1e-12, _length(other)))))
            found += [_less_slopes(form, slopes) for form in forms]
        return found

    def nameless(self, stage: str, variable: str) -> list[Column]:
        """A stage's smooth dependence on a variable, whatever its cause: half-waves of its unit (empty: the variable
        hardly moves)."""
        channel, unit = self.model.channel(TABLES[stage].channel), TABLES[stage].unit
        place = place_along(self.model, variable, channel)
        if place is None:
            return []
        change = np.ones(len(channel.measured))
        if stage != "scale":
            size = ROWS[unit.id].on(self.model.machine).tried[0]
            change = self.model.difference((), unit._replace(size=size))[channel.name] / size
        return [_column(self.model, Label(Role.FORM), {channel.name: one})
                for one in half_waves(change, place, channel, adds_up(unit, channel.name))]

    def _own_place(self, parts: Hypothesis, part: EffectInstance, channel: ChannelSeries) -> Array | None:
        """u of a part's form."""
        over = ROWS[part.id].form_over
        return course(channel, part) if part.grows else place_along(self.model, over, channel, parts) if over else None

    def of_candidate(self, parts: Hypothesis, part: EffectInstance) -> Column:
        """What one unit of a further part does on top of a hypothesis."""
        self._refresh()
        if (parts, part) not in self._kept:
            if len(self._kept) > MAX_KEPT:
                self._kept.clear()
            change = self.model.difference(parts, part)
            self._kept[(parts, part)] = _column(self.model, Label(Role.CANDIDATE, part.id),
                                                    {name: one / part.size for name, one in change.items()},
                                                    ROWS[part.id].on(self.model.machine).usual)
        return self._kept[(parts, part)]

    def trace(self, parts: Hypothesis, k: int) -> Column:
        """What the whole of part k does, the others in place."""
        return _column(self.model, Label(Role.TRACE, parts[k].id, k),
                           self.model.difference((*parts[:k], *parts[k + 1:]), parts[k]))

    def between(self, parts: Hypothesis, others: Hypothesis) -> Column:
        """What a hypothesis does more than another: the others' sizes may have moved far in its place."""
        with_it, without = self.model.predicted(parts), self.model.predicted(others)
        return _column(self.model, Label(Role.TRACE), {name: one - without[name] for name, one in with_it.items()})

    def of_hypothesis(self, parts: Hypothesis) -> list[Column]:
        """Nuisances, slopes and forms of a hypothesis, in the order of `compressed`."""
        slopes = self.slopes(parts)
        return [*self.fixed(parts), *slopes, *self.form_columns(parts, slopes)]

    def compressed(self, parts: Hypothesis, more: Sequence[Column] = ()) -> tuple[Problem, int]:
        """Problem at a hypothesis: nuisances, slopes, forms, then `more`; and how many come before `more`."""
        base = self.of_hypothesis(parts)
        self.model.ask()
        return problem(self.model.channels, self.model.banded_residual(parts), [*base, *more]), len(base)

    def by_channel(self, parts: Hypothesis) -> dict[str, list[tuple[Column, Array]]]:
        """By channel: nuisances and slopes of a hypothesis that touch it, along with their series (m,)."""
        found: dict[str, list[tuple[Column, Array]]] = {c.name: [] for c in self.model.channels}
        for column in [*self.fixed(parts), *self.slopes(parts)]:
            for channel in self.model.channels:
                if channel.name in column.coefficients:
                    found[channel.name].append((column, series_of(column.coefficients[channel.name], channel.cut)))
        return found


def _length(column: Column) -> float:
    return float(np.sqrt(sum(float(one @ one) for one in column.coefficients.values())))


def _less_slopes(form: Column, slopes: Sequence[Column]) -> Column:
    """A form without what the sizes of the parts do, over all rows alike: sizes are then those with which the machine
    file, which has no freedom of form, predicts best (Plumlee, JASA 112, 2017, 1274: orthogonal discrepancy)."""
    found = {}
    for name, values in form.coefficients.items():
        there = [slope.coefficients[name] for slope in slopes if name in slope.coefficients]
        basis = np.array(there).T if there else np.zeros((len(values), 0))
        found[name] = values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0] if there else values
    return form._replace(coefficients=found)


def _slope_step(part: EffectInstance, machine: Machine) -> float:
    """Difference of size over which a part's slope is taken, away from the bound of its size."""
    row = ROWS[part.id].on(machine)
    step = row.probe or max(0.002, 0.02 * abs(part.size))
    if row.trial_sizes:
        step = max(0.02 * abs(part.size), 0.02 * abs(row.trial_sizes[-1]))
    if part.id == effects.SPEED_GNSS_LATENCY.id:
        step = LATENCY_STEP_S
    return step if part.size + step <= bounds(part.id, machine).high else -step
