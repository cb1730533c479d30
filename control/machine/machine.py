"""What does a machine file contain? Stages, dimensions, limits, noise and tolerances of one
machine.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError
from topdress.control.frozen_model import FrozenModel

from .effect import CatalogueEntry, make_catalogue
from .effort import Effort
from .fall import Fall
from .flow import Flow
from .gate import Gate
from .heads import Heads
from .scale import Scale
from .sections import MAX_SECTIONS, Section, SectionStrip, find_section_fault, make_section_strips
from .shaft import Shaft
from .speed import Speed
from .terms import OLD_TABLE_NOTE, Number, Term

STAGES: dict[str, Any] = {
    "shaft": Shaft,
    "gate": Gate,
    "flow": Flow,
    "scale": Scale,
    "speed": Speed,
    "heads": Heads,
    "fall": Fall,
    "effort": Effort,
}
CATALOGUE: dict[str, CatalogueEntry] = make_catalogue(STAGES)

# Valid ranges for any machine, m: the widest booms and discs spread 54 m, the smallest bench has
# one row.
Width = Annotated[float, Field(ge=0.1, le=60)]
Height = Annotated[float, Field(gt=0, le=10)]
# Shaft speed, r/min: fans and small motors of rigs reach this speed.
Turning = Annotated[float, Field(gt=0, le=1e5)]
# Opening, mm, as `gate.full_mm`.
Opening = Annotated[float, Field(gt=0, le=500)]
# Resolution of a drive's set-point.
Resolution = Annotated[float, Field(ge=1e-4, le=50)]
# Share, %.
Share = Annotated[float, Field(ge=1e-6, le=100)]
Seconds = Annotated[float, Field(ge=1e-6, le=60)]
# Number of a head or an outlet.
Member = Annotated[int, Field(ge=1, le=100)]
# Maximum numbers of terms and of other entries in a file that many diagnoses have changed.
MAX_TERMS, MAX_ENTRIES = 100, 2000


StageName = Literal["shaft", "gate", "flow", "scale", "speed", "heads", "effort"]


class Geometry(FrozenModel):
    """Holds the dimensions of the machine. Positions along the track are relative to the
    outlets, forward positive."""

    working_width_m: Width = 2.4
    outlets: Annotated[int, Field(ge=1, le=100)] = 6
    heads: Annotated[int, Field(ge=1, le=6)] = 6
    antenna_m: Annotated[float, Field(ge=-30, le=30)] = 2.0
    heads_m: Annotated[float, Field(ge=-30, le=30)] = 6.5
    head_height_m: Height = 0.8
    outlet_height_m: Height = 0.5


class Limits(FrozenModel):
    """Holds the limits of the commands to the drives. A shaft command of 0 stops the shaft; no
    command lies between 0 and the lowest."""

    shaft_low_rpm: Annotated[float, Field(ge=0, le=1e5)] = 10.0
    shaft_high_rpm: Turning = 100.0
    shaft_resolution_rpm: Resolution = 0.1
    opening_low_mm: Annotated[float, Field(ge=0, le=500)] = 5.0
    opening_high_mm: Opening = 60.0
    opening_resolution_mm: Resolution = 0.1
    # Limits of alarms; None: that of `control.safety.limits.SafetyLimits`, which has the same name.
    hopper_low_kg: Annotated[float, Field(ge=0, le=20000)] = 15.0
    hopper_empty_kg: Annotated[float, Field(ge=0, le=20000)] | None = None
    gate_off_mm: Annotated[float, Field(ge=0.2, le=5)] | None = None
    # None: a share of `shaft.nominal_supply_v`.
    supply_low_v: Annotated[float, Field(ge=0, le=60)] | None = None
    # At 20 % a difference of the shaft is a fault.
    shaft_off_percent: Annotated[float, Field(ge=1, le=15)] | None = None
    # The greatest trim is 10 %.
    trimmed_percent: Annotated[float, Field(ge=1, le=10)] | None = None
    # Longest time that a diagnosis looks for in the shaft's answers, s; a log of a drive alone may
    # raise it.
    longest_answer_s: Annotated[float, Field(ge=5, le=3600)] = 5.0


class SetPoints(FrozenModel):
    """Set-points of the two strategies."""

    # Shaft speed of the strategy opening first, r/min.
    shaft_rpm: Turning = 70.0
    # Opening of the strategy speed first, mm.
    opening_mm: Opening = 25.0


class Noise(FrozenModel):
    """Holds the noise of each sensor, as one standard deviation."""

    shaft_rpm: Annotated[float, Field(ge=0, le=1e4)] = 0.3
    opening_mm: Annotated[float, Field(ge=0, le=50)] = 0.1
    gnss_mps: Annotated[float, Field(ge=0, le=5)] = 0.03
    wheel_mps: Annotated[float, Field(ge=0, le=5)] = 0.02
    ndvi: Annotated[float, Field(ge=0, le=1)] = 0.01
    scale_kg: Annotated[float, Field(ge=0, le=500)] = 0.15
    scale_correlation_s: Annotated[float, Field(ge=0.001, le=600)] = 1.0
    gnss_m: Annotated[float, Field(ge=0, le=20)] = 0.02
    supply_v: Annotated[float, Field(ge=0, le=10)] = 0.05
    pitch_deg: Annotated[float, Field(ge=0, le=20)] = 0.1
    # Noise of the effort in `effort_unit`.
    effort: Annotated[float, Field(ge=0, le=100)] = 1.0


class Tolerance(FrozenModel):
    """Holds the tolerances of the nominal values, as one standard deviation: the priors of
    diagnosis."""

    flow_percent: Share = 0.1
    wheel_percent: Share = 0.05
    shaft_percent: Share = 0.05
    dead_time_s: Seconds = 0.010
    time_constant_s: Seconds = 0.015
    gate_slew_percent: Share = 3.0
    opening_mm: Annotated[float, Field(ge=1e-6, le=100)] = 0.01
    head_percent: Share = 0.1
    # Standard error of the slope of 70 drop times up to 70 r/min, by their own scatter (lag paper,
    # table 3).
    drop_s_per_rpm: Annotated[float, Field(ge=1e-6, le=1)] = 0.001
    # The default means that nobody has measured the share, see `is_tube_measured`.
    carried_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    # The friction of a healthy ball screw differs from run to run by 1.8 %, from session to session
    # by 3.5 % (doi 10.17862/cranfield.rd.5097649).
    effort_percent: Share = 2.5


class Adopted(FrozenModel):
    """Holds the origin of an effect in this file, and the effect's range of validity."""

    id: str
    size: Number
    low: Number | None = None
    high: Number | None = None
    unit: str = ""
    member: Member | None = None
    data: str = ""
    sha256: str = ""
    date: str = ""
    valid: dict[str, tuple[Number, Number]] = {}


class Resized(FrozenModel):
    """Holds an effect whose size a change has set, in its catalogue unit."""

    id: str
    member: Member | None = None
    before: Number
    after: Number


class Change(FrozenModel):
    """Holds a change of this file by a diagnosis, with its data; `undone`: the day of its
    undoing."""

    date: str = ""
    data: str = ""
    sha256: str = ""
    effects: Annotated[tuple[Resized, ...], Field(max_length=MAX_TERMS)] = ()
    terms: Annotated[tuple[Term, ...], Field(max_length=MAX_TERMS)] = ()
    undone: str = ""


class Machine(FrozenModel):
    """Holds a machine file. Effects are stage parameters with a neutral default; `adopted` gives
    their origin, and `history` their changes, so that they can be undone."""

    format: Literal["topdress-machine/1"] = "topdress-machine/1"
    id: str = "huanghai"
    title: str = ""
    stages: Annotated[
        tuple[StageName, ...], Field(max_length=7, description="what it has; left out: all")
    ] = ()
    geometry: Geometry = Geometry()
    shaft: Shaft = Shaft()
    gate: Gate = Gate()
    flow: Flow = Flow()
    scale: Scale = Scale()
    speed: Speed = Speed()
    heads: Heads = Heads()
    fall: Fall = Fall()
    effort: Effort = Effort()
    # Unit of the drives' effort.
    effort_unit: Literal["%", "A", "N m"] = "%"
    limits: Limits = Limits()
    set_points: SetPoints = SetPoints()
    noise: Noise = Noise()
    tolerance: Tolerance = Tolerance()
    # Sections from left to right; empty for a machine without sections.
    sections: Annotated[tuple[Section, ...], Field(max_length=MAX_SECTIONS)] = ()
    terms: Annotated[tuple[Term, ...], Field(max_length=MAX_TERMS)] = ()
    adopted: Annotated[tuple[Adopted, ...], Field(max_length=MAX_ENTRIES)] = ()
    history: Annotated[tuple[Change, ...], Field(max_length=MAX_ENTRIES)] = ()

    @model_validator(mode="after")
    def _check_consistency(self) -> Machine:
        if self.limits.shaft_low_rpm >= self.limits.shaft_high_rpm:
            raise ValueError("limits.shaft_low_rpm must be below limits.shaft_high_rpm")
        if self.limits.opening_low_mm >= self.limits.opening_high_mm:
            raise ValueError("limits.opening_low_mm must be below limits.opening_high_mm")
        if self.shaft.zero_stops <= 0.0 and self.has_stage("flow"):
            raise PydanticCustomError(
                "size_of_effect",
                "{allowed}",
                {
                    "wrong_key": ("shaft", "zero_stops"),
                    "allowed": "allowed 1 of a machine that meters: a command of 0 "
                    "must stop it; 0 of one whose stages are [shaft]",
                },
            )
        if -105.0 < self.shaft.gain_percent < -95.0 and self.has_stage("flow"):
            raise PydanticCustomError(
                "size_of_effect",
                "{allowed}",
                {
                    "wrong_key": ("shaft", "gain_percent"),
                    "allowed": "allowed -95 to 1900, or -300 to -105 (slower the "
                    "higher its command), of a machine that meters: between them a command "
                    "hardly turns it",
                },
            )
        trouble = find_section_fault(self.sections, self.geometry.outlets)
        if trouble:
            raise PydanticCustomError(
                "size_of_effect", "{allowed}", {"wrong_key": ("sections",), "allowed": trouble}
            )
        for effect_id, entry in CATALOGUE.items():
            low, high = find_size_bounds(effect_id, self)
            value = getattr(getattr(self, entry.stage), entry.field)
            if not low <= value - entry.neutral <= high:
                raise PydanticCustomError(
                    "size_of_effect",
                    "{allowed}",
                    {
                        "wrong_key": (entry.stage, entry.field),
                        "allowed": describe_allowed_sizes(effect_id, self),
                    },
                )
        ids = [term.id for term in self.terms]
        for k, name in enumerate(ids):
            if name in ids[:k]:
                raise PydanticCustomError(
                    "size_of_effect",
                    "allowed an id that no other term has",
                    {"wrong_key": ("terms", k, "id")},
                )
        return self

    def has_stage(self, stage: str) -> bool:
        """Returns whether the machine has a stage; a missing stage is neither required nor
        reported.

        `gate_effort`: whether the gate's drive reports its effort; `effort`: whether the shaft's
        does.
        """
        if stage in ("effort", "gate_effort"):
            e = self.effort
            own = e.coulomb + e.viscous if stage == "effort" else e.gate_coulomb + e.gate_viscous
            return own > 0.0 and (not self.stages or "effort" in self.stages)
        return not self.stages or stage in self.stages

    @property
    def switched_strips(self) -> tuple[SectionStrip, ...]:
        """Returns the strips of the sections with valves, left to right; empty for a machine
        without sections."""
        if not self.sections or self.sections[0].valve is None:
            return ()
        return make_section_strips(self.sections, self.geometry.working_width_m)

    @property
    def is_tube_measured(self) -> bool:
        """Returns whether the air stream's share of the pace in the tube was measured."""
        return self.tolerance.carried_share <= MAX_MEASURED_TUBE_SD

    @property
    def warnings(self) -> tuple[str, ...]:
        """Returns remarks on a valid file."""
        return tuple(
            f"term {term.id} {OLD_TABLE_NOTE}"
            for term in self.terms
            if term.source.note == OLD_TABLE_NOTE
        )


# Maximum tolerance of the carried share for the tube to count as measured.
MAX_MEASURED_TUBE_SD = 0.2
# Longest time in the answers of a drive, s.
LONGEST_ANSWER_S = 3600.0
# Machine with all defaults; not validated, because validation needs this constant.
NOMINAL_MACHINE = Machine.model_construct()


def scale_nominal(machine: Machine, figures: tuple[str, ...]) -> float:
    """Returns the product of numbers of the machine file ("limits.shaft_high_rpm"), relative to
    the nominal machine's."""
    share = 1.0
    for figure in figures:
        share *= _read_figure(machine, figure) / _read_figure(NOMINAL_MACHINE, figure)
    return share


def _read_figure(machine: Machine, name: str) -> float:
    value: Any = machine
    for part in name.split("."):
        value = getattr(value, part)
    return float(value)


def allow_long_answers(machine: Machine, answer_s: float) -> Machine:
    """Returns a drive alone with answers that may last `answer_s`; a machine that meters is
    returned as it is."""
    answer_s = min(answer_s, LONGEST_ANSWER_S)
    if machine.has_stage("flow") or answer_s <= machine.limits.longest_answer_s:
        return machine
    limits = machine.limits.model_copy(update={"longest_answer_s": answer_s})
    return machine.model_copy(update={"limits": limits})


class SizeBounds(NamedTuple):
    """Holds the range of an effect's size, in its unit."""

    low: float
    high: float


def calc_size_scale(effect_id: str, machine: Machine) -> float:
    """Returns the factor of this machine on the bounds and trial sizes of an effect on the
    nominal machine."""
    return scale_nominal(machine, CATALOGUE[effect_id].effect.scales_with)


def find_size_bounds(effect_id: str, machine: Machine) -> SizeBounds:
    """Returns the range of an effect's size on a machine. Raises KeyError for an unknown id."""
    entry, scale = CATALOGUE[effect_id], calc_size_scale(effect_id, machine)
    return SizeBounds(scale * (entry.low - entry.neutral), scale * (entry.high - entry.neutral))


def describe_unit(effect_id: str, machine: Machine) -> str:
    """Returns the unit of an effect's size on a machine, which may contain a number of its file."""
    return CATALOGUE[effect_id].effect.unit_form.format(
        **{name: getattr(machine, name) for name in STAGES}
    )


def describe_allowed_sizes(effect_id: str, machine: Machine) -> str:
    """Returns the allowed sizes as text: "allowed 0 to 390 r/min where limits.shaft_high_rpm is
    650"."""
    low, high = find_size_bounds(effect_id, machine)
    figures = [
        f"{name} is {_read_figure(machine, name):g}"
        for name in CATALOGUE[effect_id].effect.scales_with
    ]
    return f"allowed {low:g} to {high:g} {describe_unit(effect_id, machine)}" + (
        f" where {' and '.join(figures)}" if figures else ""
    )


def add_effect(machine: Machine, effect_id: str, size: float, member: int | None = None) -> Machine:
    """Returns the machine with one effect at `size` (in its catalogue unit; 1 for effects whose
    size is an onset).

    Raises
    ------
    KeyError : the id is not in the catalogue. ValueError : size or member are out of the machine's
    bounds.
    """
    entry = CATALOGUE[effect_id]
    low, high = find_size_bounds(effect_id, machine)
    if not entry.effect.onset_only and not low <= size <= high:
        raise ValueError(
            f"{effect_id}: size {size:g}: {describe_allowed_sizes(effect_id, machine)}"
        )
    value = 1.0 if entry.effect.onset_only else entry.neutral + size
    changes: dict[str, float] = {entry.field: value}
    if entry.effect.member_field:
        most = machine.geometry.heads if entry.stage == "heads" else machine.geometry.outlets
        if member is None or not 1 <= member <= most:
            raise ValueError(f"{effect_id}: member {member}: say which with #1 to #{most}")
        changes[entry.effect.member_field] = float(member)
    stage = getattr(machine, entry.stage)._replace(**changes)
    return machine.model_copy(update={entry.stage: stage})


def list_effect_sizes(machine: Machine) -> dict[str, float]:
    """Returns the effects of the machine that are not neutral, by id."""
    found = {}
    for effect_id, entry in CATALOGUE.items():
        value = getattr(getattr(machine, entry.stage), entry.field)
        if value != entry.neutral:
            found[effect_id] = value
    return found
