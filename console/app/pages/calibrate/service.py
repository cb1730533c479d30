"""What the Calibrate screen can have computed and saved: given by the command line, made up for
pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from topdress.console.app.pages.calibrate.catch import CatchPoint
from topdress.console.app.pages.calibrate.wheel import WheelSample

EstimateName = Literal[
    "grams_per_rev_mm",
    "zero_offset",
    "fill_falloff",
    "slope",
    "intercept",
    "circumference",
    "carried_share",
    "coulomb",
    "coulomb_back",
    "viscous",
    "viscous_back",
    "load",
    "gate_coulomb",
    "gate_coulomb_back",
    "gate_viscous",
    "gate_viscous_back",
]


class Estimate(NamedTuple):
    """Holds a fitted number with its 90 % interval, in `unit`. value None: not shown by this
    test."""

    name: EstimateName
    value: float | None
    low: float | None
    high: float | None
    unit: str
    decimals: int


class CurvePoint(NamedTuple):
    """Holds a place of the fitted line; low, high: between them lie 90 % of single measurements."""

    x: float
    y: float
    low: float
    high: float


class Calibrated(NamedTuple):
    """Holds the result of a calibration. `source` goes back to `save` as it is.

    kind: catch, lag, wheel, effort. x_name, y_name: words of the axes (untranslated), with units.
    range: of x, where it holds.
    """

    kind: str
    estimates: tuple[Estimate, ...]
    points: tuple[tuple[float, float], ...] = ()
    line: tuple[CurvePoint, ...] = ()
    x_name: str = ""
    y_name: str = ""
    range: tuple[float, float] = (0.0, 0.0)
    # 1 s.d. of the points about the line, with its unit
    scatter: str = ""
    source: tuple[Any, ...] = ()


class LagTable(NamedTuple):
    """Describes a bench table that can be fitted. labels: the values of its label column, of which
    one must be chosen."""

    path: str
    rows: int
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class CalibrateService:
    """Holds the ranges of the machine in force, and the long work. Errors are one-line ValueErrors
    or OSErrors.

    machine: name of the file calibrated from. shaft_rpm, opening_mm: lowest and highest; set: the
    machine's own. expected_kg: (mean shaft r/min, mean opening mm, revolutions) -> mass of a catch
    by the machine's own flow model. save: (result, name of the new file) -> its path; it never
    overwrites.
    """

    machine: str
    shaft_rpm: tuple[float, float]
    opening_mm: tuple[float, float]
    set_shaft_rpm: float
    set_opening_mm: float
    wheel_circumference_m: float
    most_kg: float
    expected_kg: Callable[[float, float, float], float]
    fit_catch: Callable[[Sequence[CatchPoint]], Calibrated]
    lag_tables: Callable[[], Sequence[LagTable]]
    open_lag_table: Callable[[str], LagTable]
    fit_lag: Callable[[str, str | None], Calibrated]
    fit_wheel: Callable[[Sequence[WheelSample]], Calibrated]
    fit_effort: Callable[[str], Calibrated]  # to the run log at this path
    save: Callable[[Calibrated, str], str]
    # a free name for a new machine file of this kind of calibration
    name_for: Callable[[str], str]
