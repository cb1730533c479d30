"""Declares the computations and files that the Calibrate screen needs; the command line supplies
them, and pictures use substitutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from topdress.console.app.pages.calibrate.catch_test import CatchPoint
from topdress.console.app.pages.calibrate.wheel_drive import WheelSample

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
    """Holds a fitted number with its 90 % interval in `unit`. A value of None means that this test
    cannot show the number."""

    name: EstimateName
    value: float | None
    low: float | None
    high: float | None
    unit: str
    decimals: int


class CurvePoint(NamedTuple):
    """Holds a point of the fitted line; 90 % of single measurements lie between low and high."""

    x: float
    y: float
    low: float
    high: float


class CalibrationResult(NamedTuple):
    """Holds the result of a calibration.

    Attributes
    ----------
    kind
        catch, lag, wheel or effort.
    points
        Measured (x, y).
    x_name, y_name
        Untranslated words of the axes, with units.
    range
        Range of x in which the result is valid.
    source
        Data for `save`, which receives it unchanged.
    """

    kind: str
    estimates: tuple[Estimate, ...]
    points: tuple[tuple[float, float], ...] = ()
    line: tuple[CurvePoint, ...] = ()
    x_name: str = ""
    y_name: str = ""
    range: tuple[float, float] = (0.0, 0.0)
    # Standard deviation of the points about the line, as text with its unit.
    scatter: str = ""
    source: tuple[Any, ...] = ()


class LagTable(NamedTuple):
    """Describes a bench table that can be fitted. Where `labels` (the values of its label column)
    is not empty, one label must be chosen."""

    path: str
    rows: int
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class CalibrateService:
    """Holds the ranges of the machine in force, and functions for long work, whose ValueErrors and
    OSErrors have one line.

    Attributes
    ----------
    machine
        Name of the machine file from which the calibration starts.
    shaft_rpm, opening_mm
        Lowest and highest value.
    set_shaft_rpm, set_opening_mm
        The machine's own working point.
    most_kg
        Largest mass of a catch, kg.
    expected_kg
        Returns the mass of a catch, kg, by the machine's flow model for mean shaft speed (r/min),
        mean opening (mm) and revolutions.
    save
        Writes a result to a new file of this name and returns its path; never overwrites.
    """

    machine: str
    shaft_rpm: tuple[float, float]
    opening_mm: tuple[float, float]
    set_shaft_rpm: float
    set_opening_mm: float
    wheel_circumference_m: float
    # A catch cannot be heavier than the hopper.
    most_kg: float
    expected_kg: Callable[[float, float, float], float]
    # The functions run in a thread and may take seconds.
    fit_catch: Callable[[Sequence[CatchPoint]], CalibrationResult]
    lag_tables: Callable[[], Sequence[LagTable]]
    open_lag_table: Callable[[str], LagTable]
    fit_lag: Callable[[str, str | None], CalibrationResult]
    fit_wheel: Callable[[Sequence[WheelSample]], CalibrationResult]
    # Argument: path of the run log.
    fit_effort: Callable[[str], CalibrationResult]
    save: Callable[[CalibrationResult, str], str]
    # Returns a free name for a new machine file of this kind of calibration.
    name_for: Callable[[str], str]
