"""Which forms may a term have? The module has a class for each form, with all of its properties
(`form`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from itertools import combinations
from math import cos, pi, sin
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from .model_elements import Array, interpolate_table
from .term_form import (
    ANGLES,
    FORMS,
    SHAFT_ANGLE,
    FormColumns,
    FormSeries,
    FormShape,
    ScaledVariable,
    SentenceNumbers,
    TermForm,
    TermParams,
    TriedForm,
    WrittenForm,
)

if TYPE_CHECKING:
    from .terms import Term


class Form(StrEnum):
    """Lists the forms, a closed list. The index of a form is its number in compiled code."""

    SLOPE = "slope"
    BEND = "bend"
    HINGE = "hinge"
    SATURATION = "saturation"
    DEAD_ZONE = "dead_zone"
    THRESHOLD = "threshold"
    PRODUCT = "product"
    MEMORY = "memory"
    PERIODIC = "periodic"
    SIDE = "side"
    SPAN = "span"
    TABLE = "table"


# Maximum number of nodes of a table. The trial positions are so dense that refinement from the
# nearest reaches the best.
MAX_TABLE_NODES = 8
# Trial time constants of a memory, s.
CANDIDATE_MEMORIES_S = (1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0)
# Time constants over which the direction of a variable's movement is determined, s.
DIRECTION_TAUS_S = (1.5, 5.0)
# Difference that determines the direction, as a share of the variable's spread.
MIN_DIRECTION_CHANGE_OF_SPREAD = 0.1
# Share of the variance along an axis below which there is no variance across the axis.
ONE_AXIS_VARIANCE_SHARE = 0.03
# Angles from an axis, degrees: up to the first the values along the axis are valid, beyond the
# second they are not.
AXIS_VALID_DEG = (15.0, 30.0)
# Trial numbers of cycles in a full turn.
CANDIDATE_CYCLES = {"heading_deg": (1, 2, 3), SHAFT_ANGLE: (1, 2, 3, 4, 5, 6)}
# Number of trial edges of a span.
SPAN_EDGE_COUNT = 24
# Number of distinguishable positions of a span's edge, for its prior: some per cent of the log.
SPAN_POSITION_COUNT = 100
# Number of smooth half-waves that form a table.
TABLE_WAVE_COUNT = 4
# Maximum remaining share of a memory after the last change.
MAX_REMAINING_MEMORY_SHARE = 0.2


# The following forms are straight lines and bends.


def make_line_series(x: ScaledVariable, at: float) -> Array:
    return x.z


def make_hinge_series(x: ScaledVariable, at: float) -> Array:
    return np.maximum(0.0, x.z - at)


def make_ones_series(x: ScaledVariable, at: float) -> Array:
    return np.ones(len(x.x))


def clip_value(x: float, low: float, high: float) -> float:
    return min(high, max(low, x))


class SlopeForm(TermForm, form=Form.SLOPE):
    """Form proportional to its variable."""

    needs, may, main, each_unit = ("slope",), ("at", "level"), "slope", True
    means = "level + slope (x - at)"
    sentences = (
        "{what} rises by {size} {unit} for each {per} of {x}",
        "{what} falls by {size} {unit} for each {per} of {x}",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return p.slope * (x - p.at)

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        size = term.coefficients["slope"]
        return SentenceNumbers(numbers={"size": abs(size)}, which=int(size <= 0.0))

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return ({FormSeries(make_line_series, (x.name,)): 1.0},)

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {"slope": a[0] / x.spread, "at": x.middle, "level": level}


class BendForm(TermForm, form=Form.BEND):
    """Form with a quadratic curve."""

    needs, may = ("bend",), ("slope", "at", "level")
    means = "level + slope (x - at) + bend (x - at)^2"
    sentences = (
        "{what} rises by {size} {unit} for each ({per})2 of {x} away from {at} {per}",
        "{what} falls by {size} {unit} for each ({per})2 of {x} away from {at} {per}",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        away = x - p.at
        return p.slope * away + p.bend * away * away

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        vertex = c.get("at", 0.0) - 0.5 * c.get("slope", 0.0) / c["bend"] if c["bend"] else 0.0
        return SentenceNumbers(
            numbers={"size": abs(c["bend"]), "at": vertex}, which=int(c["bend"] <= 0.0)
        )

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return {FormSeries(make_line_series, (x.name,)): 1.0}, {
            FormSeries(make_product_series, (x.name, x.name)): 1.0
        }

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {
            "slope": a[0] / x.spread,
            "bend": a[1] / x.spread**2,
            "at": x.middle,
            "level": level,
        }


class _PlacedForm(TermForm):
    """Defines a form with a position at which it bends or jumps."""

    needs, may, movable = ("at",), ("below", "above", "level"), ("at",)

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        return [{"at": place} for place in x.candidate_places]


class HingeForm(_PlacedForm, form=Form.HINGE):
    """Form with different slopes below and above a position."""

    means = "level + below (x - at) where x is less than at, above (x - at) where it is more"
    sentences = (
        "{what} changes by {below} for each {per} of {x} below {at} {per}, by {above} above",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return (p.above if x > p.at else p.below) * (x - p.at)

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        return SentenceNumbers(
            {"below": c.get("below", 0.0), "above": c.get("above", 0.0)}, {"at": c["at"]}
        )

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return {FormSeries(make_line_series, (x.name,)): 1.0}, {
            FormSeries(make_hinge_series, (x.name,), shape["at"]): 1.0
        }

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {
            "below": a[0] / x.spread,
            "above": (a[0] + a[1]) / x.spread,
            "at": x.convert_from_z(shape["at"]),
            "level": level + a[0] * shape["at"],
        }


class _EndedForm(TermForm):
    """Defines a form with a lower and an upper end."""

    needs, main = ("slope", "low_end", "high_end"), "slope"
    movable: ClassVar[tuple[str, ...]] = ("low_end", "high_end")

    @classmethod
    def count_places(cls, x: ScaledVariable, shapes: int) -> int:
        return len(x.candidate_places) ** 2 // 2

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {
            "slope": a[0] / x.spread,
            "low_end": x.convert_from_z(shape["low_end"]),
            "high_end": x.convert_from_z(shape["high_end"]),
            "level": level,
        }


class SaturationForm(_EndedForm, form=Form.SATURATION):
    """Form that is linear between two ends and constant beyond them."""

    means = "level + slope (x - low_end), x held between low_end and high_end"
    sentences = (
        "{what} changes by {size} for each {per} of {x} from {low} to {high} {per}, and no further",
        "{what} is off by {size} whatever the command",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return p.slope * (clip_value(x, p.low_end, p.high_end) - p.low_end)

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        if (
            c["low_end"] == 0.0
            and term.acts_on == "shaft_rpm"
            and term.variable_names == ("shaft_rpm",)
        ):
            return SentenceNumbers({"size": c["slope"] * c["high_end"]}, which=1)
        return SentenceNumbers({"size": c["slope"]}, {"low": c["low_end"], "high": c["high_end"]})

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        """Returns shapes between every two positions, and from an end of the range."""
        low, high = x.z_range
        return [
            {"low_end": a, "high_end": b}
            for a, b in combinations((low, *x.candidate_places, high), 2)
            if a < b and (a, b) != (low, high)
        ]

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        """Returns z limited to the ends, and 0 where z is 0."""
        low, high = shape["low_end"], shape["high_end"]
        return (
            {
                FormSeries(make_hinge_series, (x.name,), low): 1.0,
                FormSeries(make_hinge_series, (x.name,), high): -1.0,
                FormSeries(make_ones_series, (x.name,)): low - clip_value(0.0, low, high),
            },
        )

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        low, high = shape["low_end"], shape["high_end"]
        return {
            **super().calc_coefficients(shape, a, level, x, y),
            "level": level + a[0] * (low - clip_value(0.0, low, high)),
        }


class LostConstantForm(SaturationForm):
    """Defines a constant that is lost from every command above 0: a saturation from there on. x:
    the unscaled commands."""

    movable, has_level = (), False

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        return [{}]

    @classmethod
    def count_places(cls, x: ScaledVariable, shapes: int) -> int:
        return 1

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return (
            {
                FormSeries(
                    make_since_series, (x.name,), float(np.min(x.x[x.work], initial=np.inf))
                ): 1.0
            },
        )

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        least = float(np.min(x.x[x.work], initial=abs(a[0]) + 1e-3))
        end = min(max(abs(a[0]), 1e-3), least)
        return {"slope": a[0] / end, "low_end": 0.0, "high_end": end}


class DeadZoneForm(_EndedForm, form=Form.DEAD_ZONE):
    """Form that is zero between two ends and linear beyond them."""

    means = "level between low_end and high_end, + slope for each unit beyond them"
    sentences = (
        "{what} changes by {size} for each {per} of {x} beyond {low} to {high} {per}, and "
        "not between",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return p.slope * (x - clip_value(x, p.low_end, p.high_end))

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        return SentenceNumbers({"size": c["slope"]}, {"low": c["low_end"], "high": c["high_end"]})

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        return [{"low_end": a, "high_end": b} for a, b in combinations(x.candidate_places, 2)]

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        low, high = shape["low_end"], shape["high_end"]
        return (
            {
                FormSeries(make_line_series, (x.name,)): 1.0,
                FormSeries(make_hinge_series, (x.name,), low): -1.0,
                FormSeries(make_hinge_series, (x.name,), high): 1.0,
                FormSeries(make_ones_series, (x.name,)): -low,
            },
        )


class ThresholdForm(_PlacedForm, form=Form.THRESHOLD):
    """Form that jumps at a position."""

    main, leaps = "above", True
    means = "level + above where x is more than at, else + below"
    sentences = ("{what} differs by {size} where {x} is above {at} {per}",)

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return p.above if x > p.at else p.below

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        return SentenceNumbers({"size": c.get("above", 0.0) - c.get("below", 0.0)}, {"at": c["at"]})

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return ({FormSeries(make_beyond_series, (x.name,), shape["at"]): 1.0},)

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {"above": a[0], "at": x.convert_from_z(shape["at"]), "level": level}


def make_beyond_series(x: ScaledVariable, at: float) -> Array:
    return (x.z > at).astype(np.float64)


# The following form has two variables.


def make_product_series(x: ScaledVariable, y: ScaledVariable, at: float) -> Array:
    return x.z * y.z


class ProductForm(TermForm, form=Form.PRODUCT):
    """Form of the product of two variables."""

    needs, may, variables, main = ("slope",), ("at", "second_at", "level"), 2, "slope"
    means = "level + slope (x - at) (y - second_at)"
    sentences = (
        "{what} changes by {size} for each {per} of {x} from {at} times each {per2} of {y} "
        "from {at2}",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return p.slope * (x - p.at) * (y - p.second_at)

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        return SentenceNumbers(
            {"size": c["slope"]}, {"at": c.get("at", 0.0), "at2": c.get("second_at", 0.0)}
        )

    @classmethod
    def list_candidates(cls, x: ScaledVariable) -> list[TriedForm]:
        return []

    @classmethod
    def list_pair_candidates(
        cls, x: ScaledVariable, y: ScaledVariable, alone: int = 2
    ) -> list[TriedForm]:
        """Returns the product together with the separate effects of the variables `alone`."""
        return [
            TriedForm(cls, (x.name, y.name), one, cls.make_columns(one, x, y))
            for one in ({}, {"alone": float(alone)})
        ]

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        alone = (x, y)[: int(shape.get("alone", 0.0))]
        return (
            *({FormSeries(make_line_series, (v.name,)): 1.0} for v in alone),
            {FormSeries(make_product_series, (x.name, y.name)): 1.0},
        )

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        """Returns the coefficients with the square completed; the constant is subtracted from
        the level."""
        first, second, both = a[0] if len(a) > 1 else 0.0, a[1] if len(a) > 2 else 0.0, a[-1]
        return {
            "slope": both / (x.spread * y.spread),
            "at": x.convert_from_z(-second / both),
            "second_at": y.convert_from_z(-first / both),
            "level": level - first * second / both,
        }


# The following forms describe the previous movement of a variable.


def make_memory_series(x: ScaledVariable, tau_s: float) -> Array:
    return x.evaluate_form(TermParams(FORM_NUMBERS[Form.MEMORY], bend=1.0, tau_s=tau_s))


def make_direction_series(x: ScaledVariable, tau_s: float) -> Array:
    """Returns the recent direction of z, -1 to 1."""
    return x.evaluate_form(
        TermParams(
            FORM_NUMBERS[Form.SIDE],
            above=1.0,
            below=-1.0,
            high_end=MIN_DIRECTION_CHANGE_OF_SPREAD,
            tau_s=tau_s,
        )
    )


class MemoryForm(TermForm, form=Form.MEMORY):
    """Form of a first-order memory of its variable."""

    needs, may, positive = ("bend", "tau_s"), ("slope", "at", "level"), ("tau_s",)
    movable, main, of_moves = ("tau_s",), "bend", True
    means = "level + slope (x - at) + bend (m - at), m following x with the time constant tau_s"
    sentences = (
        "{what} follows {x} late, with a time constant of {tau} s: {size} for each {per}",
        "{what} changes by {size} for each {per} by which {x} has just changed, and forgets "
        "it with a time "
        "constant of {tau} s",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return p.slope * (x - p.at) + p.bend * (slow - p.at)

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        now, late = c.get("slope", 0.0), c["bend"]
        forgets = abs(now + late) < MAX_REMAINING_MEMORY_SHARE * max(abs(now), abs(late))
        return SentenceNumbers(
            {"size": now if forgets else now + late}, {"tau": c["tau_s"]}, which=int(forgets)
        )

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        return [
            {"tau_s": tau_s, "alone": float(alone)}
            for tau_s in CANDIDATE_MEMORIES_S
            for alone in (0, 1)
        ]

    @classmethod
    def count_places(cls, x: ScaledVariable, shapes: int) -> int:
        return len(CANDIDATE_MEMORIES_S)

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        late = {FormSeries(make_memory_series, (x.name,), shape["tau_s"]): 1.0}
        return ({FormSeries(make_line_series, (x.name,)): 1.0}, late) if shape["alone"] else (late,)

    @classmethod
    def step_shape(cls, shape: FormShape, name: str, steps: float, x: ScaledVariable) -> float:
        return float(shape[name] * 2.0**steps)

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {
            "slope": a[0] / x.spread if len(a) > 1 else 0.0,
            "bend": a[-1] / x.spread,
            "at": x.middle,
            "tau_s": shape["tau_s"],
            "level": level,
        }


class SideForm(TermForm, form=Form.SIDE):
    """Form that differs between a rising and a falling variable."""

    needs, may, positive = (
        ("high_end",),
        ("below", "above", "at", "tau_s", "level"),
        ("high_end", "tau_s"),
    )
    main, of_moves = "above", True
    means = (
        "level + above on one side of at and below on the other, even between at - high_end "
        "and at + "
        "high_end; with tau_s the side is the way in which x moves"
    )
    sentences = (
        "{what} differs by {size} between both sides of {x}",
        "{what} differs by {size} between {x} rising and falling",
    )

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        away = x - (slow if p.tau_s > 0.0 else p.at)
        return 0.5 * (p.above + p.below) + 0.5 * (p.above - p.below) * clip_value(
            away / p.high_end, -1.0, 1.0
        )

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        return SentenceNumbers(
            {"size": c.get("above", 0.0) - c.get("below", 0.0)},
            which=int(c.get("tau_s", 0.0) > 0.0),
        )

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        return [{"tau_s": tau_s} for tau_s in DIRECTION_TAUS_S]

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return ({FormSeries(make_direction_series, (x.name,), shape["tau_s"]): 1.0},)

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {
            "above": a[0],
            "below": -a[0],
            "high_end": MIN_DIRECTION_CHANGE_OF_SPREAD * x.spread,
            "tau_s": shape["tau_s"],
            "level": level,
        }


# The following forms are periodic, temporary, or tables.


def make_sine_series(x: ScaledVariable, cycles: float) -> Array:
    return np.sin(cycles * np.radians(x.x))


def make_cosine_series(x: ScaledVariable, cycles: float) -> Array:
    return np.cos(cycles * np.radians(x.x))


class PeriodicForm(TermForm, form=Form.PERIODIC):
    """Form that is periodic in an angle."""

    needs, may, positive, only_over = ("cycles",), ("sine", "cosine", "level"), ("cycles",), ANGLES
    means = "level + sine sin(cycles x) + cosine cos(cycles x), x an angle"
    sentences = ("{what} swings by {size} {unit} to both sides, {count} times a turn of {x}",)

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        angle = p.cycles * x * pi / 180.0
        return p.sine * sin(angle) + p.cosine * cos(angle)

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        size = (c.get("sine", 0.0) ** 2 + c.get("cosine", 0.0) ** 2) ** 0.5
        return SentenceNumbers(numbers={"size": size, "count": c["cycles"]})

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        """Returns trial numbers of cycles.

        Where all angles are on one axis (up and down a field), sine and cosine cannot be separated.
        A single cycle along that axis is then tried, which says nothing about other headings.
        """
        strengths, axes = np.linalg.eigh(
            np.cov([make_sine_series(x, 1.0)[x.work], make_cosine_series(x, 1.0)[x.work]])
        )
        if strengths[0] < ONE_AXIS_VARIANCE_SHARE * strengths[1]:
            return [{"cycles": 1.0, "sine": float(axes[0, 1]), "cosine": float(axes[1, 1])}]
        return [{"cycles": float(n)} for n in CANDIDATE_CYCLES[x.name]]

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        first, second = (
            FormSeries(make_sine_series, (x.name,), shape["cycles"]),
            FormSeries(make_cosine_series, (x.name,), shape["cycles"]),
        )
        if "sine" in shape:
            return ({FormSeries(make_axis_series, (x.name,), calc_axis_deg(shape)): 1.0},)
        return {first: 1.0}, {second: 1.0}

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {"cycles": shape["cycles"], "sine": a[0], "cosine": a[1], "level": level}

    @classmethod
    def write_form(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> WrittenForm:
        """Writes a cycle along one axis as a table over the headings 0 to 360: the values along
        the axis in both directions, and the level in other directions."""
        if "sine" not in shape:
            return super().write_form(shape, a, level, x, y)
        nodes, values = make_two_way_table(calc_axis_deg(shape))
        return WrittenForm(Form.TABLE, {}, nodes, [level + a[0] * value for value in values])


def calc_axis_deg(shape: FormShape) -> float:
    return float(np.degrees(np.arctan2(shape["sine"], shape["cosine"])))


def make_two_way_table(axis: float) -> tuple[list[float], list[float]]:
    """Returns a table over the headings 0 to 360: 1 along an axis (degrees), -1 in the opposite
    direction, 0 across."""
    inner, outer = AXIS_VALID_DEG
    half_turns = int((axis + outer) // 180.0)
    # The range is -outer to 180 - outer, so that the direction through north comes first, if there
    # is one.
    axis -= 180.0 * half_turns
    size = (-1.0) ** half_turns
    edges = [axis - outer, axis - inner, axis + inner, axis + outer]
    back = [edge + 180.0 for edge in edges]
    if edges[0] >= 0.0:
        return [*edges, *back], [0.0, size, size, 0.0, 0.0, -size, -size, 0.0]
    return [*edges[2:], *back, *(edge + 360.0 for edge in edges[:2])], [
        size,
        0.0,
        0.0,
        -size,
        -size,
        0.0,
        0.0,
        size,
    ]


def make_axis_series(x: ScaledVariable, axis: float) -> Array:
    return np.interp(x.x, *make_two_way_table(axis))


def make_since_series(x: ScaledVariable, at: float) -> Array:
    return (x.x >= at).astype(np.float64)


class SpanForm(TermForm, form=Form.SPAN):
    """Form that is constant between two times."""

    needs, may, only_over = ("low_end", "high_end", "above"), ("grows", "level"), ("time_s",)
    movable, main, one_run, leaps, has_level = ("low_end", "high_end"), "above", True, True, False
    means = "level + above from low_end to high_end (s), growing to it with grows 1"
    sentences = ("{what} is off by {size} from {begin} s to {end} s",)

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        if not p.low_end <= x < p.high_end:
            return 0.0
        return p.above * ((x - p.low_end) / (p.high_end - p.low_end) if p.grows > 0.0 else 1.0)

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        c = term.coefficients
        return SentenceNumbers(
            {"size": c["above"]}, times_s={"begin": c["low_end"], "end": c["high_end"]}
        )

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        edges = np.linspace(float(x.x[0]), float(x.x[-1]), SPAN_EDGE_COUNT + 1)[1:-1]
        return [{"low_end": float(a), "high_end": float(b)} for a, b in combinations(edges, 2)]

    @classmethod
    def count_places(cls, x: ScaledVariable, shapes: int) -> int:
        return SPAN_POSITION_COUNT**2

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return (
            {
                FormSeries(make_since_series, (x.name,), shape["low_end"]): 1.0,
                FormSeries(make_since_series, (x.name,), shape["high_end"]): -1.0,
            },
        )

    @classmethod
    def step_shape(cls, shape: FormShape, name: str, steps: float, x: ScaledVariable) -> float:
        return shape[name] + 0.5 * float(np.ptp(x.x)) / SPAN_EDGE_COUNT * steps

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        return {
            "low_end": shape["low_end"],
            "high_end": shape["high_end"],
            "above": a[0],
            "level": level,
        }


def make_wave_series(x: ScaledVariable, n: float) -> Array:
    """Returns a half-wave as the machine file stores it: linear interpolation between its values
    at the nodes."""
    low, high = x.z_range
    share = np.linspace(0.0, 1.0, MAX_TABLE_NODES)
    return np.interp(x.z, low + (high - low) * share, np.cos(np.pi * n * share))


class TableForm(TermForm, form=Form.TABLE):
    """Form with values at nodes and linear interpolation."""

    means = "straight lines through nodes and values, held beyond the ends"
    sentences = ("{what} follows {x} in a curve of its own, from {low} to {high}",)

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        return float(interpolate_table(p.nodes, p.values, x))

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        return SentenceNumbers({"low": min(term.values), "high": max(term.values)})

    @classmethod
    def count_places(cls, x: ScaledVariable, shapes: int) -> int:
        return TABLE_WAVE_COUNT

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        return tuple(
            {FormSeries(make_wave_series, (x.name,), float(n)): 1.0}
            for n in range(1, TABLE_WAVE_COUNT + 1)
        )

    @classmethod
    def write_form(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> WrittenForm:
        (low, high), share = x.z_range, np.linspace(0.0, 1.0, MAX_TABLE_NODES)
        waves = np.array([np.cos(np.pi * n * share) for n in range(1, TABLE_WAVE_COUNT + 1)])
        return WrittenForm(
            Form.TABLE,
            {},
            [x.convert_from_z(low + (high - low) * one) for one in share.tolist()],
            (level + np.asarray(a) @ waves).tolist(),
        )


FORM_NUMBERS: dict[str, int] = {form: k for k, form in enumerate(Form)}
FORM_VALUES: tuple[Callable[[TermParams, float, float, float], float], ...] = tuple(
    FORMS[form].calc_value for form in Form
)


def make_params(form: Form, **numbers: Any) -> TermParams:
    return TermParams(FORM_NUMBERS[form], **numbers)
