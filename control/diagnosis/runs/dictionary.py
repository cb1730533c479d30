"""Searches terms beyond the catalogue: every functional form over every variable of every quantity
that a group's channels show.

The model of a stage converts a form's series over the log's rows into a series of the channel. All
shapes of all forms share a few series, so the conversion runs once for each shared series and does
not depend on the hypothesis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.judgement.noise import calc_coefficients
from topdress.control.machine.compiled import run_term
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
from topdress.control.machine.term_form import (
    FORMS,
    SHAFT_ANGLE,
    FormSeries,
    ScaledVariable,
    TriedForm,
    scale_variable,
)
from topdress.control.machine.term_forms import LostConstantForm, ProductForm
from topdress.control.machine.terms import (
    COMMANDED_RPM,
    TARGET_STAGES,
    TermTarget,
    name_own_command,
)

from .channels import simulate_drive_rows
from .drives import Drive
from .hopper import average_bins, average_metered
from .hypothesis import EffectInstance, Hypothesis, make_schedule
from .model import GroupModel
from .smooth import DOWNSTREAM_VARIABLES, MIN_RANGE, NOMINAL_RANGES
from .stages import RunData
from .whitened import WhitenedResidual

Array = npt.NDArray[np.float64]

CHANNEL_OF: dict[TermTarget, str] = {
    TermTarget.SHAFT_PERCENT: "shaft",
    TermTarget.SHAFT_RPM: "shaft",
    TermTarget.GATE_MM: "gate",
    TermTarget.FLOW_PERCENT: "scale",
    TermTarget.SCALE_KG: "scale",
    TermTarget.WHEEL_PERCENT: "speed",
}
UNIT_EFFECT = {
    TermTarget.FLOW_PERCENT: EffectInstance(effects.FLOW_GAIN.id, 1.0),
    TermTarget.WHEEL_PERCENT: EffectInstance(effects.SPEED_WHEEL_RADIUS.id, 1.0),
}
# The wheel speed is compared with the GNSS speed, so the GNSS noise would appear as a dependence on
# speed. In a product with another variable that noise averages to zero.
NEVER_ALONE = {"speed": frozenset({"speed_mps"})}
# Change of the shaft, in % or r/min, for a numerical slope.
SHAFT_SLOPE_STEP = 0.5
# Responses below this, r/min, are rounding errors.
MIN_RESPONSE_RPM = 1e-6
# Minimum speed of a turning shaft, r/min: nothing flows below this speed.
MIN_TURNING_RPM = 1.0
# Share of the fastest command below which the shaft is commanded to stand.
MIN_COMMAND_SHARE = 1e-3
# Minimum share of rows with a turning shaft: fewer rows do not show the range of a variable.
MIN_WORKING_SHARE = 0.1
# Forms are selected by components below this frequency, Hz, because the variables are means over
# 1.5 s.
MAX_FREQUENCY_HZ = 2.5
# Minimum number of cosine coefficients; a short log uses all its coefficients.
MIN_COEFFICIENTS = 64
# Minimum share of the information on a constant, after the hypothesis, for a constant to be fitted
# as well.
MIN_LEVEL_SHARE = 1e-3


def list_shown_quantities(model: GroupModel) -> list[TermTarget]:
    """Return the quantities that a group's channels show."""
    # Rounding of an encoder is itself a dependence on speed.
    in_steps = model.data.shaft is not None and model.data.shaft.step > 0.0
    return [
        acts
        for acts, channel in CHANNEL_OF.items()
        if channel in model.names and not (channel == "shaft" and in_steps)
    ]


class TargetResponse:
    """Converts series of one quantity over the log's rows into series of its channel, under a
    hypothesis."""

    def __init__(self, model: GroupModel, parts: Hypothesis, acts: TermTarget) -> None:
        self.channel = model.find_channel(CHANNEL_OF[acts])
        self.acts, self._model, self._parts = acts, model, parts
        unit = UNIT_EFFECT.get(acts)
        self._unit = (
            np.ones(1) if unit is None else model.calc_difference(parts, unit)[self.channel.name]
        )

    @cached_property
    def constant(self) -> Array:
        """Change of the channel for a constant change of the quantity (1, m)."""
        return self.calc_response(np.ones((1, len(self._model.data.row_s))))

    def calc_response(self, rows: Array) -> Array:
        """Return the change of the channel for one unit of each series: (k, m) of (k, rows)."""
        data, channel = self._model.data, self.channel
        if channel.name in ("shaft", "gate"):
            return channel.grid.interpolate(self._respond_as_drive(rows))
        if channel.name == "speed":
            return (
                np.array([np.interp(channel.grid.even_s, data.row_s, one) for one in rows])
                * self._unit
            )
        hopper = data.hopper
        assert hopper is not None
        if self.acts is TermTarget.SCALE_KG:
            return channel.grid.interpolate(
                np.array([average_bins(one, data.row_s, hopper.time_s)[:-1] for one in rows])
            )
        metered = data.inputs["shaft_rpm"] * data.inputs["opening_mm"]
        share = channel.grid.interpolate(
            average_metered(rows, metered, data.row_s, hopper.time_s)[:, :-1]
        )
        share = 0.5 * (share + np.concatenate((share[:, :1], share[:, :-1]), axis=1))
        return np.asarray(np.cumsum(np.diff(self._unit, prepend=self._unit[0]) * share, axis=1))

    def _respond_as_drive(self, rows: Array) -> Array:
        """Shift the series by a row, because a row shows the change that was in force in the row
        before; the shaft then follows its stage's dynamics."""
        data = self._model.data
        drive = data.shaft if self.channel.name == "shaft" else data.gate
        assert drive is not None
        picked = rows[:, np.clip(np.searchsorted(data.row_s, drive.time_s), 0, len(data.row_s) - 1)]
        if self.channel.name == "gate":
            return np.concatenate((picked[:, :1], picked[:, :-1]), axis=1)
        was = self._respond_as_shaft_rpm(drive)
        return np.array([self._respond_as_shaft(drive, was, one) for one in picked])

    def _respond_as_shaft_rpm(self, drive: Drive) -> Array:
        return simulate_drive_rows(drive)(
            make_schedule(self._model.base, self._parts), MAX_MODEL_STEP_S
        )[:, 0]

    def _respond_as_shaft(self, drive: Drive, was: Array, one: Array) -> Array:
        """Return the slope of the shaft speed in a series over its rows; the slope is zero while
        the shaft accelerates at its limit."""
        share = SHAFT_SLOPE_STEP / max(1e-12, float(np.max(np.abs(one))))
        moved = (
            drive._replace(more=drive.more + share * one)
            if self.acts is TermTarget.SHAFT_PERCENT
            else drive._replace(more_rpm=drive.more_rpm + share * one)
        )
        change = self._respond_as_shaft_rpm(moved) - was
        return np.asarray(
            change / share if np.abs(change).max() > MIN_RESPONSE_RPM else np.zeros(len(change))
        )


class FormVariables(NamedTuple):
    """Variables over which the forms of one quantity are tried."""

    by_name: dict[str, ScaledVariable]
    one: tuple[str, ...]
    # These variables are combined in products of two.
    two: tuple[str, ...]
    # These variables appear only in products with those of `two`.
    never_alone: tuple[str, ...] = ()

    def has_level(self, form: TriedForm) -> bool:
        """Tell whether a form has a free constant. The constant would absorb the dependence on a
        variable that is excluded alone."""
        return form.kind.has_level and form.over[-1] not in self.never_alone

    def list_pairs(self) -> list[tuple[str, str]]:
        return [(a, b) for k, a in enumerate(self.two) for b in self.two[k + 1 :]]


class FormGroup(NamedTuple):
    """Forms of one quantity over the same variables, or over all pairs of variables."""

    forms: tuple[TriedForm, ...]
    # Each form has a matrix that makes its columns from the shared series (k, amplitudes).
    mixes: tuple[Array, ...]
    # Slowest cosine coefficients of the shared series (k, kept); the last row is a constant.
    kept: npt.NDArray[np.float32]
    # Whether a constant is fitted as well.
    level: bool

    def select_forms(self, forms: Sequence[bool]) -> FormGroup:
        """Return the group reduced to some of its forms."""
        chosen = np.flatnonzero(forms)
        return self._replace(
            forms=tuple(self.forms[k] for k in chosen), mixes=tuple(self.mixes[k] for k in chosen)
        )


class FormCandidate(NamedTuple):
    """A form of a quantity. gain : in twice the log-likelihood; score : gain minus the penalty for
    ranking."""

    acts: TermTarget
    tried: TriedForm
    gain: float = 0.0
    score: float = 0.0


class FormDictionary:
    """All forms that are tried on a group of channels. of : the variables of each quantity."""

    def __init__(self, model: GroupModel) -> None:
        self._data = model.data
        self.of = {
            acts: (
                TargetResponse(model, (), acts),
                _list_variables(model.data, model.machine, acts),
            )
            for acts in list_shown_quantities(model)
        }
        self._made: dict[TermTarget, list[FormGroup]] = {}

    def list_form_groups(self, acts: TermTarget) -> list[FormGroup]:
        if acts not in self._made:
            acted, variables = self.of[acts]
            self._made[acts] = [
                _make_form_group(forms, acted, variables)
                for forms in _list_tried_forms(acts, variables, self._data)
                if forms
            ]
        return self._made[acts]

    def scan_forms(self, residual: WhitenedResidual, temporary: bool) -> list[FormCandidate]:
        """Return the best forms over each variable or pair of variables, under a given noise.

        temporary : whether only variables of this run alone are tried, or only the others.
        """
        return [
            one
            for acts, (acted, _) in self.of.items()
            for one in scan_dictionary(
                residual,
                acted,
                [
                    entry
                    for entry in self.list_form_groups(acts)
                    if entry.forms[0].kind.one_run == temporary
                ],
            )
        ]


def scan_dictionary(
    residual: WhitenedResidual, acted: TargetResponse, entries: Sequence[FormGroup]
) -> list[FormCandidate]:
    """Return the best form over each variable or pair, and the best discontinuous form.

    A small error in the position of an edge hides how well a discontinuous form fits, so the best
    is always kept.
    """
    found: list[FormCandidate] = []
    for entry in entries:
        left = residual.project_out_base(acted.channel, entry.kept)
        if entry.level and left.A[-1, -1] > MIN_LEVEL_SHARE:
            left = left.project_out(
                left.A[:, -1:], left.select_columns(np.array([-1])).fit(np.array([np.inf]))
            )
        left = left.select_columns(np.arange(len(left.s) - 1))
        single = [k for k, mix in enumerate(entry.mixes) if mix.shape[1] == 1]
        gains = (
            dict(
                zip(
                    single,
                    left.calc_single_gains(np.hstack([entry.mixes[k] for k in single])).tolist(),
                    strict=True,
                )
            )
            if single
            else {}
        )
        best: dict[tuple[tuple[str, ...], bool], FormCandidate] = {}
        for k, (form, mix) in enumerate(zip(entry.forms, entry.mixes, strict=True)):
            gain = gains[k] if k in gains else left.calc_gain_of_mixes(mix)
            one = FormCandidate(acted.acts, form, gain, gain - form.price)
            place = (form.over, form.kind.leaps)
            if place not in best or one.score > best[place].score:
                best[place] = one
        found += best.values()
    return found


def _list_variables(data: RunData, machine: Machine, acts: TermTarget) -> FormVariables:
    """Return the variables that change in the log, by name, and those that may be multiplied with
    each other."""
    stage = TARGET_STAGES[acts]
    inputs = dict(data.inputs)
    # The predicted level is used, because the reading's own noise would appear as a dependence on
    # itself.
    if "hopper_kg" in data.variables:
        inputs["hopper_kg"] = np.interp(data.row_s, data.time_s, data.variables["hopper_kg"])
    work = np.ones(len(data.row_s), bool)
    turning = inputs.get("shaft_rpm", np.ones(len(work))) > MIN_TURNING_RPM
    if stage in ("shaft", "flow") and turning.sum() > MIN_WORKING_SHARE * len(work):
        work = turning
    found: dict[str, ScaledVariable] = {}
    for name in _list_variable_names(data, acts):
        values = inputs.get(name_own_command(stage, name))
        if values is None or not np.isfinite(values).all():
            continue
        one = scale_variable(name, values, work, data.row_s, run_term)
        least = scale_nominal(machine, NOMINAL_RANGES.get(name, ())) * MIN_RANGE.get(
            name, float(np.finfo(float).tiny)
        )
        if one.high - one.low >= least:
            found[name] = one
    if acts is TermTarget.SHAFT_RPM:
        commands = data.inputs[COMMANDED_RPM]
        turning = commands > MIN_COMMAND_SHARE * float(commands.max(initial=0.0))
        found["shaft_rpm"] = ScaledVariable(
            "shaft_rpm", commands, 0.0, 1.0, -np.inf, np.inf, turning, data.row_s, run_term
        )
    never_alone = tuple(name for name in found if name in NEVER_ALONE.get(stage, ()))
    single = tuple(
        name
        for name in found
        if name not in never_alone and (acts is not TermTarget.SHAFT_RPM or name == "time_s")
    )
    double = tuple(
        name for name in found if name not in ("time_s", "heading_deg", SHAFT_ANGLE, *never_alone)
    )
    return FormVariables(
        found, single, double if acts is not TermTarget.SHAFT_RPM else (), never_alone
    )


def _list_variable_names(data: RunData, acts: TermTarget) -> list[str]:
    """Return the names of variables on which a quantity may depend. Temporary terms of the shaft
    are searched for in r/min."""
    stage = TARGET_STAGES[acts]
    further = [name for name in data.variables if name not in MIN_RANGE]
    names = [
        name
        for name in (*MIN_RANGE, *further)
        if name not in DOWNSTREAM_VARIABLES[stage] - NEVER_ALONE.get(stage, frozenset())
    ]
    drive = {"shaft": data.shaft, "gate": data.gate}.get(stage)
    # On a bench, time and command are confounded.
    if acts is TermTarget.SHAFT_PERCENT or (drive is not None and drive.settled):
        names.remove("time_s")
    return [*names, SHAFT_ANGLE] if acts is TermTarget.SHAFT_PERCENT else names


def _list_tried_forms(
    acts: TermTarget, variables: FormVariables, data: RunData
) -> Iterator[list[TriedForm]]:
    """Yield the forms of one quantity, grouped by the series that they share."""
    by_name = variables.by_name
    if acts is TermTarget.SHAFT_RPM:
        yield LostConstantForm.list_candidates(by_name["shaft_rpm"])
    for name in variables.one:
        unseen = _lacks_commands(acts, name, data)
        yield [
            form
            for kind in FORMS.values()
            if not (kind.of_moves and unseen)
            for form in kind.list_candidates(by_name[name])
        ]
    yield [
        form
        for a, b in variables.list_pairs()
        for form in ProductForm.list_pair_candidates(by_name[a], by_name[b])
    ]
    for last in variables.never_alone:
        yield [
            form
            for name in variables.two
            for form in ProductForm.list_pair_candidates(by_name[name], by_name[last], alone=1)
        ]


def _lacks_commands(acts: TermTarget, name: str, data: RunData) -> bool:
    """Tell whether the log lacks some of a drive's commands. A form over the command would then
    only describe the moves that were not logged."""
    drive, own = {"shaft": (data.shaft, "shaft_rpm"), "gate": (data.gate, "opening_mm")}.get(
        TARGET_STAGES[acts], (None, "")
    )
    return drive is not None and not drive.moves_seen and name == own


def _make_form_group(
    forms: Sequence[TriedForm], acted: TargetResponse, variables: FormVariables
) -> FormGroup:
    """Build a group of forms with the channel responses of their shared series."""
    places: dict[FormSeries, int] = {}
    for series in (series for form in forms for column in form.columns for series in column):
        places.setdefault(series, len(places))
    mixes = []
    for form in forms:
        mix = np.zeros((len(places), len(form.columns)))
        for k, column in enumerate(form.columns):
            for series, weight in column.items():
                mix[places[series], k] = weight
        mixes.append(mix)
    rows = np.array([series.calc_rows(variables.by_name) for series in places])
    every = calc_coefficients(
        np.concatenate((acted.calc_response(rows), acted.constant)).astype(np.float32),
        acted.channel.cut,
    )
    slow = (
        2.0 * MAX_FREQUENCY_HZ * acted.channel.grid.step_s
        if SHAFT_ANGLE not in forms[0].over
        else 1.0
    )
    count = max(MIN_COEFFICIENTS, int(min(1.0, slow) * every.shape[1]))
    return FormGroup(
        tuple(forms),
        tuple(mixes),
        np.ascontiguousarray(every[:, :count], dtype=np.float32),
        variables.has_level(forms[0]),
    )
