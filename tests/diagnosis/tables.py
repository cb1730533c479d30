"""The one builder of bench tables in which tests plant something, by formulas of its own: never
by the program's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.tables import diagnose_tables
from topdress.control.machine.machine import Machine
from topdress.drivers.files.bench_table import read_bench_table

from tests.places import PAPERS

Array = npt.NDArray[Any]
Rng = np.random.Generator
MACHINE = Machine()
SEVENS = np.arange(10.0, 71.0, 10.0)  # shaft speeds of a lag table


def paper(name: str) -> BenchTable:
    return read_bench_table(PAPERS / f"{name}.csv")


def diagnosed(*tables: BenchTable) -> Diagnosis:
    return diagnose_tables(list(tables), MACHINE)


def total_s(rpm: Array) -> Array:
    """Nominal whole lag, written out: response 0.383 s, drop 1.8288 - 0.0083 n."""
    return 0.383 + 1.8288 - 0.0083 * rpm


def lags(
    rpm: Array,
    rng: Rng,
    off_s: npt.ArrayLike = 0.0,
    sd: float = 0.03,
    *,
    factor: npt.ArrayLike = 1.0,
    step_s: float = 0.0,
    digits: int | None = 3,
    path: str = "",
    label_column: str = "",
    label: Array | None = None,
) -> BenchTable:
    """Whole lags by the nominal line times a factor and later, as a clock of `step_s` tells
    them."""
    lag = total_s(rpm) * factor + off_s + sd * rng.standard_normal(len(rpm))
    lag = np.round(lag / step_s) * step_s if step_s else lag
    lag = lag if digits is None else np.round(lag, digits)
    return BenchTable("lag", {"shaft_rpm": rpm, "lag_s": lag}, label_column, path, label)


def responses(rpm: Array, rng: Rng, response_s: float, sd: float, path: str = "") -> BenchTable:
    read = response_s + sd * rng.standard_normal(len(rpm))
    return BenchTable("lag", {"shaft_rpm": rpm, "response_s": read}, path=path)


def crossed(*axes: npt.ArrayLike) -> list[Array]:
    """Every setting of the axes, a column each."""
    return [axis.ravel() for axis in np.meshgrid(*(np.asarray(one, float) for one in axes))]


def catches(
    rng: Rng,
    factor: Callable[[Array, Array], npt.ArrayLike],
    rpm: Array,
    opening: Array,
    outlet: Array | None = None,
) -> BenchTable:
    """Half a minute of catching at each setting, of all outlets or one. factor : of speed, and
    opening or outlet."""
    grams = 5.5 * opening * rpm / 60.0 * 30.0 / (1.0 if outlet is None else 6.0)
    scatter = 1.0 + 0.004 * rng.standard_normal(len(rpm))
    mass = grams / 1000.0 * np.asarray(factor(rpm, opening if outlet is None else outlet)) * scatter
    columns = {
        "shaft_rpm": rpm,
        "opening_mm": opening,
        "duration_s": np.full(len(rpm), 30.0),
        "mass_kg": mass,
    }
    return BenchTable(
        "catch", columns if outlet is None else columns | {"outlet": outlet}, path="catch.csv"
    )


def catch_grid(
    rng: Rng,
    factor: Callable[[Array, Array], npt.ArrayLike],
    outlets: bool = False,
    speeds: tuple[float, ...] = (20, 50, 80, 100),
) -> BenchTable:
    rpm, opening, outlet, _ = crossed(speeds, (10, 30), range(1, 7) if outlets else (1,), (0, 1))
    return catches(rng, factor, rpm, opening, outlet if outlets else None)


def weighs(
    rng: Rng, factor: float = 1.0, plots: int = 8, targets: tuple[float, ...] = (15.0, 18.0, 21.0)
) -> BenchTable:
    target = rng.choice(targets, plots)
    applied = np.round(target * factor + 0.25 * rng.standard_normal(plots), 2)
    return BenchTable(
        "weigh", {"area_m2": np.full(plots, 600.0), "target_kg": target, "applied_kg": applied}
    )


def heads(
    rng: Rng, reads: Callable[[Array, Array, Array], Array], timed: bool = True, heads: int = 6
) -> BenchTable:
    """reads : of the true NDVI, head and minute."""
    head, ndvi, minute = crossed(
        range(1, heads + 1), (0.3, 0.6, 0.8), (1.0, 6, 25) if timed else (1.0, 1.0)
    )
    read = reads(ndvi, head, minute) + 0.008 * rng.standard_normal(len(head))
    return BenchTable(
        "heads",
        {"head": head, "ndvi_reference": ndvi, "ndvi": np.round(read, 4)}
        | ({"warm_min": minute} if timed else {}),
    )


def misses(
    rpm: Array, speed_mps: npt.ArrayLike, miss_m: Array, path: str = "", **columns: Array
) -> BenchTable:
    return BenchTable(
        "place",
        {
            "shaft_rpm": rpm,
            "speed_mps": np.broadcast_to(speed_mps, rpm.shape) * 1.0,
            "miss_m": np.round(miss_m, 3),
        }
        | columns,
        path=path,
    )


def place_grid(
    rng: Rng, late_s: float = 0.0, arm_m: float = 0.0, speeds: tuple[float, ...] = (0.9, 1.7)
) -> BenchTable:
    rpm, speed, _ = crossed((30.0, 60), speeds, range(5))
    return misses(rpm, speed, arm_m + speed * late_s + 0.08 * rng.standard_normal(len(rpm)))


def labelled_lags(later_s: float, blue_s: float = 0.0) -> BenchTable:
    """Half of the rows are labelled blue and `blue_s` later still."""
    label = np.repeat(["blue", "green"], 21)
    return lags(
        np.tile(SEVENS, 6),
        np.random.default_rng(3),
        later_s + blue_s * (label == "blue"),
        0.02,
        label_column="tractor",
        path="two.csv",
        label=label,
    )
