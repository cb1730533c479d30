"""What is tried beyond the catalogue: every form over every variable of every quantity that a
group's channels show.

A form's series over the log's rows becomes, through the model of its stage, a series of the
channel. That is had once for each of the few series that all shapes of all forms share, and
does not depend on the hypothesis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.judgement.noise import coefficients
from topdress.control.machine.compiled import run_term
from topdress.control.machine.form import (
    FORMS,
    SHAFT_ANGLE,
    FormSeries,
    ScaledVariable,
    TriedForm,
    scale_variable,
)
from topdress.control.machine.forms import LostConstantForm, ProductForm
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
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
from .smooth import DOWNSTREAM, MIN_RANGE, RANGES
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
# The wheel is held against the GNSS speed, whose own noise is a dependence on it; in a product
# with another variable that noise adds up to nothing.
NEVER_ALONE = {"speed": frozenset({"speed_mps"})}
SHAFT_PROBE = 0.5  # % or r/min, for a slope ...
SHAFT_NOTHING = 1e-6  # ... and r/min of it that are rounding
TURNS_RPM = 1.0  # a shaft that turns at all: below, nothing flows
# of the fastest command: below, the shaft is commanded to stand
TURNS_SHARE = 1e-3
# of the rows: fewer that turn do not say between what a variable moves
WORKS_SHARE = 0.1
# forms are chosen by what is slower: the variables are means over a second and a half
SLOWER_THAN_HZ = 2.5
LEAST_KEPT = 64  # coefficients: of a short log all
# information on a level that the hypothesis must leave, for it to be fitted along
LEAST_LEVEL = 1e-3


def list_shown_quantities(model: GroupModel) -> list[TermTarget]:
    """Quantities that a group's channels show."""
    # rounding is a dependence of its own
    in_steps = model.data.shaft is not None and model.data.shaft.step > 0.0
    return [
        acts
        for acts, channel in CHANNEL_OF.items()
        if channel in model.names and not (channel == "shaft" and in_steps)
    ]


class ActedOn:
    """One quantity under a hypothesis: series over the log's rows to series of its channel."""

    def __init__(self, model: GroupModel, parts: Hypothesis, acts: TermTarget) -> None:
        self.channel = model.channel(CHANNEL_OF[acts])
        self.acts, self._model, self._parts = acts, model, parts
        unit = UNIT_EFFECT.get(acts)
        self._unit = (
            np.ones(1) if unit is None else model.difference(parts, unit)[self.channel.name]
        )

    @cached_property
    def constant(self) -> Array:
        """Change of the channel by a constant (1, m)."""
        return self.of(np.ones((1, len(self._model.data.row_s))))

    def of(self, rows: Array) -> Array:
        """Change of the channel by one unit of each series: (k, m) of (k, rows)."""
        data, channel = self._model.data, self.channel
        if channel.name in ("shaft", "gate"):
            return channel.grid.of(self._respond_as_drive(rows))
        if channel.name == "speed":
            return (
                np.array([np.interp(channel.grid.even_s, data.row_s, one) for one in rows])
                * self._unit
            )
        hopper = data.hopper
        assert hopper is not None
        if self.acts is TermTarget.SCALE_KG:
            return channel.grid.of(
                np.array([average_bins(one, data.row_s, hopper.time_s)[:-1] for one in rows])
            )
        metered = data.inputs["shaft_rpm"] * data.inputs["opening_mm"]
        share = channel.grid.of(average_metered(rows, metered, data.row_s, hopper.time_s)[:, :-1])
        share = 0.5 * (share + np.concatenate((share[:, :1], share[:, :-1]), axis=1))
        return np.asarray(np.cumsum(np.diff(self._unit, prepend=self._unit[0]) * share, axis=1))

    def _respond_as_drive(self, rows: Array) -> Array:
        """What shows at a row was in force in the row before it; the shaft goes there as its
        stage does."""
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
        """Slope of the shaft's speed in so much of a series over its rows: while it runs up
        nothing of it shows."""
        share = SHAFT_PROBE / max(1e-12, float(np.max(np.abs(one))))
        moved = (
            drive._replace(more=drive.more + share * one)
            if self.acts is TermTarget.SHAFT_PERCENT
            else drive._replace(more_rpm=drive.more_rpm + share * one)
        )
        change = self._respond_as_shaft_rpm(moved) - was
        return np.asarray(
            change / share if np.abs(change).max() > SHAFT_NOTHING else np.zeros(len(change))
        )


class Variables(NamedTuple):
    """What the forms of one quantity may be over."""

    by_name: dict[str, ScaledVariable]
    one: tuple[str, ...]
    two: tuple[str, ...]  # in products with each other
    never_alone: tuple[str, ...] = ()  # in products with those of `two` only

    def has_level(self, form: TriedForm) -> bool:
        """Whether a form has a free level: it would take up what a variable does that is never
        alone."""
        return form.kind.has_level and form.over[-1] not in self.never_alone

    def pairs(self) -> list[tuple[str, str]]:
        return [(a, b) for k, a in enumerate(self.two) for b in self.two[k + 1 :]]


class FormGroup(NamedTuple):
    """Forms over the same variables, or over all pairs of two, of one quantity."""

    forms: tuple[TriedForm, ...]
    # of each form: its columns from the series (k, amplitudes)
    mixes: tuple[Array, ...]
    # cosine coefficients of the series, the slowest (k, kept); last a constant's
    kept: npt.NDArray[np.float32]
    level: bool  # whether a constant is fitted along

    def only(self, forms: Sequence[bool]) -> FormGroup:
        """The same with some of its forms."""
        chosen = np.flatnonzero(forms)
        return self._replace(
            forms=tuple(self.forms[k] for k in chosen), mixes=tuple(self.mixes[k] for k in chosen)
        )


class FormCandidate(NamedTuple):
    """A form of a quantity. gain : in twice the log-likelihood; score : less what ranks forms."""

    acts: TermTarget
    tried: TriedForm
    gain: float = 0.0
    score: float = 0.0


class Dictionary:
    """Everything that is tried on a group of channels. of : each quantity with its variables."""

    def __init__(self, model: GroupModel) -> None:
        self._data = model.data
        self.of = {
            acts: (ActedOn(model, (), acts), _list_variables(model.data, model.machine, acts))
            for acts in list_shown_quantities(model)
        }
        self._made: dict[TermTarget, list[FormGroup]] = {}

    def entries(self, acts: TermTarget) -> list[FormGroup]:
        if acts not in self._made:
            acted, variables = self.of[acts]
            self._made[acts] = [
                _make_form_group(forms, acted, variables)
                for forms in _list_tried_forms(acts, variables, self._data)
                if forms
            ]
        return self._made[acts]

    def scanned(self, residual: WhitenedResidual, temporary: bool) -> list[FormCandidate]:
        """The best forms over each variable, or two, under a given noise. temporary : those of
        one run alone, or all else."""
        return [
            one
            for acts, (acted, _) in self.of.items()
            for one in scan_dictionary(
                residual,
                acted,
                [entry for entry in self.entries(acts) if entry.forms[0].kind.one_run == temporary],
            )
        ]


def scan_dictionary(
    residual: WhitenedResidual, acted: ActedOn, entries: Sequence[FormGroup]
) -> list[FormCandidate]:
    """The best form over each variable, or two, and the best that leaps: an edge that is a
    little off hides how good it is."""
    found: list[FormCandidate] = []
    for entry in entries:
        left = residual.beyond(acted.channel, entry.kept)
        if entry.level and left.A[-1, -1] > LEAST_LEVEL:
            left = left.beyond(left.A[:, -1:], left.of(np.array([-1])).fit(np.array([np.inf])))
        left = left.of(np.arange(len(left.s) - 1))
        single = [k for k, mix in enumerate(entry.mixes) if mix.shape[1] == 1]
        gains = (
            dict(
                zip(
                    single,
                    left.gains_of_single(np.hstack([entry.mixes[k] for k in single])).tolist(),
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


def _list_variables(data: RunData, machine: Machine, acts: TermTarget) -> Variables:
    """Variables that move, by their names, and those that may be multiplied with each other."""
    stage = TARGET_STAGES[acts]
    inputs = dict(data.inputs)
    # as predicted: a reading's own noise must not come back
    if "hopper_kg" in data.variables:
        inputs["hopper_kg"] = np.interp(data.row_s, data.time_s, data.variables["hopper_kg"])
    work = np.ones(len(data.row_s), bool)
    turning = inputs.get("shaft_rpm", np.ones(len(work))) > TURNS_RPM
    if stage in ("shaft", "flow") and turning.sum() > WORKS_SHARE * len(work):
        work = turning
    found: dict[str, ScaledVariable] = {}
    for name in _list_variable_names(data, acts):
        values = inputs.get(name_own_command(stage, name))
        if values is None or not np.isfinite(values).all():
            continue
        one = scale_variable(name, values, work, data.row_s, run_term)
        least = scale_nominal(machine, RANGES.get(name, ())) * MIN_RANGE.get(
            name, float(np.finfo(float).tiny)
        )
        if one.high - one.low >= least:
            found[name] = one
    if acts is TermTarget.SHAFT_RPM:
        commands = data.inputs[COMMANDED_RPM]
        turning = commands > TURNS_SHARE * float(commands.max(initial=0.0))
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
    return Variables(found, single, double if acts is not TermTarget.SHAFT_RPM else (), never_alone)


def _list_variable_names(data: RunData, acts: TermTarget) -> list[str]:
    """What a quantity may depend on; of the shaft, temporary terms are looked for in r/min."""
    stage = TARGET_STAGES[acts]
    further = [name for name in data.variables if name not in MIN_RANGE]
    names = [
        name
        for name in (*MIN_RANGE, *further)
        if name not in DOWNSTREAM[stage] - NEVER_ALONE.get(stage, frozenset())
    ]
    drive = {"shaft": data.shaft, "gate": data.gate}.get(stage)
    # on a bench, time and command are one
    if acts is TermTarget.SHAFT_PERCENT or (drive is not None and drive.settled):
        names.remove("time_s")
    return [*names, SHAFT_ANGLE] if acts is TermTarget.SHAFT_PERCENT else names


def _list_tried_forms(
    acts: TermTarget, variables: Variables, data: RunData
) -> Iterator[list[TriedForm]]:
    """The forms of one quantity, those that share series together."""
    by_name = variables.by_name
    if acts is TermTarget.SHAFT_RPM:
        yield LostConstantForm.list_candidates(by_name["shaft_rpm"])
    for name in variables.one:
        unseen = _moves_unseen(acts, name, data)
        yield [
            form
            for kind in FORMS.values()
            if not (kind.of_moves and unseen)
            for form in kind.list_candidates(by_name[name])
        ]
    yield [
        form
        for a, b in variables.pairs()
        for form in ProductForm.list_pair_candidates(by_name[a], by_name[b])
    ]
    for last in variables.never_alone:
        yield [
            form
            for name in variables.two
            for form in ProductForm.list_pair_candidates(by_name[name], by_name[last], alone=1)
        ]


def _moves_unseen(acts: TermTarget, name: str, data: RunData) -> bool:
    """Whether the log lacks some of a drive's commands, so that a form over the command would only
    describe the moves that were not logged."""
    drive, own = {"shaft": (data.shaft, "shaft_rpm"), "gate": (data.gate, "opening_mm")}.get(
        TARGET_STAGES[acts], (None, "")
    )
    return drive is not None and not drive.moves_seen and name == own


def _make_form_group(forms: Sequence[TriedForm], acted: ActedOn, variables: Variables) -> FormGroup:
    """Forms with what the series that they share do to the channel."""
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
    every = coefficients(
        np.concatenate((acted.of(rows), acted.constant)).astype(np.float32), acted.channel.cut
    )
    slow = (
        2.0 * SLOWER_THAN_HZ * acted.channel.grid.step_s
        if SHAFT_ANGLE not in forms[0].over
        else 1.0
    )
    count = max(LEAST_KEPT, int(min(1.0, slow) * every.shape[1]))
    return FormGroup(
        tuple(forms),
        tuple(mixes),
        np.ascontiguousarray(every[:, :count], dtype=np.float32),
        variables.has_level(forms[0]),
    )
