"""What must a form of a term define? Its coefficients, its value, its sentence, and its fit.
`term_forms` defines the forms.

**In the machine file**: its coefficients and their meaning. **Its value**: `calc_value`, a function
that is interpreted for a tick and compiled over a log, so it uses plain arithmetic on numbers only.
**In words**: `find_numbers`. **Fitted**: a form has a shape (nonlinear coefficients, each tried at
several positions and refined from there) and amplitudes, in which it is linear. Its columns are
sums of series over the rows. Columns of many shapes share few series, so the effect of a series on
a channel is calculated once. Variables are fitted as z = (x - middle) / spread.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from .model_elements import FLAT_TABLE, TABLE_X, Array, Table

if TYPE_CHECKING:
    from .terms import Term


class TermParams(NamedTuple):
    """Holds a term as numbers. A form leaves unused numbers at their default; the form's class
    defines the meaning of each."""

    form: int
    # Range of validity: beyond it the variable is limited to the edge.
    low: float = -1e300
    high: float = 1e300
    second_low: float = -1e300
    second_high: float = 1e300
    level: float = 0.0
    at: float = 0.0
    second_at: float = 0.0
    slope: float = 0.0
    bend: float = 0.0
    below: float = 0.0
    above: float = 0.0
    low_end: float = 0.0
    high_end: float = 0.0
    cycles: float = 0.0
    sine: float = 0.0
    cosine: float = 0.0
    tau_s: float = 0.0
    grows: float = 0.0
    nodes: Table = TABLE_X
    values: Table = FLAT_TABLE


# Type of `compiled.run_term`, or of the same function interpreted.
TermRun = Callable[[TermParams, Array, Array, Array], Array]

SHAFT_ANGLE = "shaft_angle_deg"
ANGLES = ("heading_deg", SHAFT_ANGLE)

# Quantiles of a variable, %, at which a form may bend.
PLACE_QUANTILES = (6, 18, 30, 42, 50, 58, 70, 82, 94)
# Penalty for an amplitude where forms are ranked before their sizes have a prior, in twice the
# log-likelihood.
PRICE_PER_AMPLITUDE = 4.0
# Step by which a position is moved, in spreads of the variable.
POSITION_STEP_IN_SPREADS = 0.3


@dataclass(frozen=True)
class ScaledVariable:
    """Holds a variable for fitting. x: values at the rows, limited to low and high (rows,).

    work: rows that determine the trial positions of a form (rows,). run: evaluates a form over a
    log.
    """

    name: str
    x: Array
    middle: float
    spread: float
    low: float
    high: float
    work: npt.NDArray[np.bool_]
    time_s: Array
    run: TermRun

    @cached_property
    def z(self) -> Array:
        return np.asarray((self.x - self.middle) / self.spread)

    @property
    def valid_range(self) -> tuple[float, float] | None:
        """Returns the observed range of the variable; None for angles, for the time, and without
        a range."""
        return (
            None
            if self.name in (*ANGLES, "time_s") or self.low == -np.inf
            else (self.low, self.high)
        )

    @cached_property
    def z_range(self) -> tuple[float, float]:
        """Returns the range of z."""
        low, high = np.percentile(self.z[self.work], (0.5, 99.5))
        return float(low), float(high)

    @cached_property
    def candidate_places(self) -> list[float]:
        """Returns positions in z at which a form may bend: quantiles, and 0 where the variable
        changes its sign."""
        found = np.percentile(self.z[self.work], PLACE_QUANTILES)
        zero = (0.0 - self.middle) / self.spread
        if found[0] < zero < found[-1]:
            found = np.append(found, zero)
        return [float(one) for one in np.unique(np.round(found, 6))]

    def convert_from_z(self, z: float) -> float:
        """Converts a position in z to the variable's own unit."""
        return self.middle + self.spread * z

    def evaluate_form(self, params: TermParams) -> Array:
        """Evaluates a form over z (rows,)."""
        z = np.ascontiguousarray(self.z)
        return self.run(params, z, z, self.time_s)


def scale_variable(
    name: str, x: Array, work: npt.NDArray[np.bool_], time_s: Array, run: TermRun
) -> ScaledVariable:
    """Returns a variable limited to its range in the working rows."""
    low, q10, middle, q90, high = (
        float(v) for v in np.percentile(x[work], (0.5, 10, 50, 90, 99.5))
    )
    spread = max(0.5 * (q90 - q10), 1e-3 * (high - low), 1e-9)
    held = x if name in (*ANGLES, "time_s") else np.clip(x, low, high)
    return ScaledVariable(
        name, held, middle, spread, low, high if high > low else low + 1.0, work, time_s, run
    )


class FormSeries(NamedTuple):
    """Defines a series over the rows: a function of one or two variables, and of a position."""

    function: Callable[..., Array]
    over: tuple[str, ...]
    at: float = 0.0

    def calc_rows(self, by: Mapping[str, ScaledVariable]) -> Array:
        return self.function(*(by[name] for name in self.over), self.at)


FormShape = Mapping[str, float]
# Weights of the series of each column.
FormColumns = tuple[dict[FormSeries, float], ...]


class WrittenForm(NamedTuple):
    """Holds a fitted form in the notation of the machine file."""

    form: str
    coefficients: dict[str, float]
    nodes: list[float] = []
    values: list[float] = []


class SentenceNumbers(NamedTuple):
    """Holds the numbers of a sentence. changes: numbers shown with sign and the term's unit.
    which: index of the form's sentence."""

    changes: Mapping[str, float] = {}
    numbers: Mapping[str, float] = {}
    times_s: Mapping[str, float] = {}
    which: int = 0


class TriedForm(NamedTuple):
    """Holds a form with a fixed shape."""

    kind: type[TermForm]
    over: tuple[str, ...]
    shape: FormShape
    columns: FormColumns
    # Number of such forms that are tried, at different positions or with different memory.
    places: int = 1

    @property
    def price(self) -> float:
        """Returns the penalty that ranks forms in a scan, in twice the log-likelihood."""
        return PRICE_PER_AMPLITUDE * len(self.columns) + 2.0 * float(np.log(self.places))

    def change_shape(self, shape: FormShape, by: Mapping[str, ScaledVariable]) -> TriedForm:
        """Returns the form with another shape."""
        return self._replace(
            shape=shape, columns=self.kind.make_columns(shape, by[self.over[0]], by[self.over[-1]])
        )

    def calc_rows(self, by: Mapping[str, ScaledVariable]) -> Array:
        """Returns the form's columns over the rows (amplitudes, rows)."""
        return np.array(
            [
                sum(weight * series.calc_rows(by) for series, weight in one.items())
                for one in self.columns
            ]
        )

    def write_form(
        self, amplitude: Sequence[float], level: float, by: Mapping[str, ScaledVariable]
    ) -> WrittenForm:
        return self.kind.write_form(
            self.shape, amplitude, level, by[self.over[0]], by[self.over[-1]]
        )


# Forms in the order in which they are listed.
FORMS: dict[str, type[TermForm]] = {}


class TermForm:
    """Defines one form. x is its first variable; y is its second, or x again for a form of one
    variable."""

    form: ClassVar[str]
    # Required coefficients.
    needs: ClassVar[tuple[str, ...]] = ()
    # Optional coefficients.
    may: ClassVar[tuple[str, ...]] = ("level",)
    # Formula as text.
    means: ClassVar[str]
    # Coefficients that must be positive.
    positive: ClassVar[tuple[str, ...]] = ()
    variables: ClassVar[int] = 1
    only_over: ClassVar[tuple[str, ...]] = ()
    # Sentences with placeholders: {what} the term acts on, its {unit}, variables {x} and {y}, their
    # units {per}, {per2}.
    sentences: ClassVar[tuple[str, ...]]
    # Whether the sentence states a change per unit of x and no other number of x.
    each_unit: ClassVar[bool] = False
    # Whether the form describes a single run only, not the machine.
    one_run: ClassVar[bool] = False
    # Coefficient whose interval is reported.
    main: ClassVar[str] = ""
    # Whether the form is discontinuous: a small error of its edge then hides a good fit.
    leaps: ClassVar[bool] = False
    # Whether the form describes the previous movement of its variable.
    of_moves: ClassVar[bool] = False
    # Coefficients of the shape that are refined.
    movable: ClassVar[tuple[str, ...]] = ()
    # Whether the form's mean is fitted as well.
    has_level: ClassVar[bool] = True

    def __init_subclass__(cls, form: str | None = None) -> None:
        if form is not None:
            cls.form = form
            FORMS[form] = cls

    @staticmethod
    def calc_value(p: TermParams, x: float, y: float, slow: float) -> float:
        """Returns the form's value without the level. slow: x, filtered with the time constant
        tau_s."""
        raise NotImplementedError

    @staticmethod
    def find_numbers(term: Term) -> SentenceNumbers:
        raise NotImplementedError

    @classmethod
    def list_candidates(cls, x: ScaledVariable) -> list[TriedForm]:
        """Returns the form over one variable, at all positions of the search."""
        if (
            (x.name not in cls.only_over)
            if cls.only_over
            else (x.name in ANGLES or x.name == "time_s")
        ):
            return []
        shapes = cls.list_shapes(x)
        return [
            TriedForm(
                cls, (x.name,), one, cls.make_columns(one, x, x), cls.count_places(x, len(shapes))
            )
            for one in shapes
        ]

    @classmethod
    def list_shapes(cls, x: ScaledVariable) -> list[FormShape]:
        return [{}]

    @classmethod
    def count_places(cls, x: ScaledVariable, shapes: int) -> int:
        """Returns the number of different forms among its shapes, which share its prior."""
        return shapes

    @classmethod
    def make_columns(cls, shape: FormShape, x: ScaledVariable, y: ScaledVariable) -> FormColumns:
        raise NotImplementedError

    @classmethod
    def step_shape(cls, shape: FormShape, name: str, steps: float, x: ScaledVariable) -> float:
        """Returns a coefficient of the shape moved by a number of steps."""
        return shape[name] + POSITION_STEP_IN_SPREADS * steps

    @classmethod
    def calc_coefficients(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> dict[str, float]:
        """Returns the machine file's coefficients for amplitudes `a` and a level."""
        raise NotImplementedError

    @classmethod
    def write_form(
        cls,
        shape: FormShape,
        a: Sequence[float],
        level: float,
        x: ScaledVariable,
        y: ScaledVariable,
    ) -> WrittenForm:
        return WrittenForm(cls.form, cls.calc_coefficients(shape, a, level, x, y))
