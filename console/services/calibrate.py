"""How does the Calibrate screen fit bench tables and save the result as a new machine file in the
user's folder?
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from topdress.console.app.pages.calibrate.catch_test import CatchPoint
from topdress.console.app.pages.calibrate.service import (
    CalibrateService,
    CalibrationResult,
    CurvePoint,
    Estimate,
    EstimateName,
    LagTable,
)
from topdress.console.app.pages.calibrate.wheel_drive import WheelSample
from topdress.console.services.launcher import find_data_folder
from topdress.control.machine.flow import calc_grams_per_rev
from topdress.control.machine.machine import Machine
from topdress.drivers import day_clock
from topdress.drivers.files.atomic_files import find_free_path

if TYPE_CHECKING:
    from topdress.control.calibration.bench_table import BenchTable
    from topdress.control.calibration.least_squares import FittedInterval
    from topdress.control.calibration.wheel_fit import WheelFit

# Points of a drawn curve: more than a terminal has columns for it.
CURVE_POINTS = 40
# Largest CSV file that is offered, because bench tables are small, bytes.
MAX_TABLE_BYTES = 1_000_000
# Openings that differ by less count as equal.
MAX_OPENING_DIFFERENCE_MM = 0.5


def make_calibrate_service(
    machine: Machine,
    wheel_circumference_m: float | None = None,
    folder: Path | None = None,
    tables: Sequence[Path] = (),
) -> CalibrateService:
    """Returns the calibrations of this machine.

    Parameters
    ----------
    wheel_circumference_m : circumference by which a cab file counts the wheel; None means the
    machine's.
    folder : folder of new machine files; the folder of the run logs is next to it.
    tables : further folders in which lag tables are searched.
    """
    place = folder or find_data_folder() / "machines"
    # Bench tables may lie next to the logs, next to machine files or in the working folder.
    look_in = (place.parent / "logs", place, Path.cwd(), *tables)
    limits, points = machine.limits, machine.set_points
    # The wheel speeds of this session were computed with the cab's circumference, so the fit must
    # begin with it.
    counted_m = wheel_circumference_m or machine.speed.wheel_circumference_m
    return CalibrateService(
        machine=machine.id,
        shaft_rpm=(limits.shaft_low_rpm, limits.shaft_high_rpm),
        opening_mm=(limits.opening_low_mm, limits.opening_high_mm),
        set_shaft_rpm=points.shaft_rpm,
        set_opening_mm=points.opening_mm,
        wheel_circumference_m=counted_m,
        most_kg=machine.flow.full_kg,
        expected_kg=lambda shaft_rpm, opening_mm, revolutions: (
            # Grams become kilograms, the unit of the weighing field on the screen.
            calc_grams_per_rev(machine.flow, shaft_rpm, opening_mm) * revolutions / 1000.0
        ),
        fit_catch=lambda caught: fit_catch_test(machine, caught),
        lag_tables=lambda: find_lag_tables(look_in),
        open_lag_table=lambda path: open_lag_table(Path(path).expanduser()),
        fit_lag=lambda path, label: fit_lag_table(machine, path, label),
        fit_wheel=lambda samples: fit_wheel_drive(machine, counted_m, samples),
        fit_effort=lambda path: fit_drive_effort(machine, path),
        save=lambda fitted, name: save_calibrated(machine, fitted, name, place, counted_m),
        name_for=lambda kind: (
            find_free_path(
                place, f"{machine.id}-{kind}-{day_clock.read_today():%Y%m%d}", ".yaml"
            ).stem
        ),
    )


def fit_catch_test(machine: Machine, caught: Sequence[CatchPoint]) -> CalibrationResult:
    """Returns the flow per turn from weighed catches, with the line over opening, or over shaft
    speed where only that was changed."""
    # scipy takes a moment to load and is needed only after a test is weighed.
    from scipy.special import stdtrit
    from topdress.control.calibration.flow_fit import fit_flow

    _machine, flow = fit_flow(make_catch_table(caught, "catch test"), machine)
    slope = flow.grams_per_rev_mm.value
    offset = flow.zero_offset_g_rev.value if flow.zero_offset_g_rev else 0.0
    falloff = flow.fill_falloff_percent.value if flow.fill_falloff_percent else 0.0
    # Each fitted parameter costs a degree of freedom of the t distribution.
    terms = 1 + (flow.zero_offset_g_rev is not None) + (flow.fill_falloff_percent is not None)
    # The band is a 90 % prediction interval of one more catch, as a share of the value.
    band = (
        float(stdtrit(flow.rows_used - terms, 0.95))
        * flow.residual_sd_percent
        / 100.0
        * (1.0 + 1.0 / flow.rows_used) ** 0.5
    )

    def calc_full_g_rev(opening_mm: float) -> float:
        return slope * opening_mm + offset

    def calc_fill_share(shaft_rpm: float) -> float:
        # The cubic falloff is that of the flow model in the machine file.
        return 1.0 - falloff / 100.0 * (shaft_rpm / machine.flow.full_rpm) ** 3

    low_mm, high_mm = flow.opening_mm
    low_rpm, high_rpm = flow.shaft_rpm
    # A test at one opening shows nothing over opening, so the axis is shaft speed.
    by_speed = high_mm - low_mm < MAX_OPENING_DIFFERENCE_MM and high_rpm > low_rpm
    middle_mm = sum(one.opening_mm for one in caught) / len(caught)
    middle_rpm = sum(one.shaft_rpm for one in caught) / len(caught)
    if by_speed:
        # The points are shifted to the mean opening by the fitted line, so that they can be
        # compared with the curve.
        points = tuple(
            (
                one.shaft_rpm,
                one.grams_per_revolution
                * calc_full_g_rev(middle_mm)
                / calc_full_g_rev(one.opening_mm),
            )
            for one in caught
        )
        line = [
            (x, calc_full_g_rev(middle_mm) * calc_fill_share(x))
            for x in _make_even_steps(low_rpm, high_rpm)
        ]
    else:
        # The points are shifted to the mean speed by the fitted falloff, for the same reason.
        points = tuple(
            (
                one.opening_mm,
                one.grams_per_revolution
                * calc_fill_share(middle_rpm)
                / calc_fill_share(one.shaft_rpm),
            )
            for one in caught
        )
        line = [
            (x, calc_full_g_rev(x) * calc_fill_share(middle_rpm))
            for x in _make_even_steps(low_mm, high_mm)
        ]
    estimates = (
        _make_estimate("grams_per_rev_mm", flow.grams_per_rev_mm, "g/rev/mm", 4),
        _make_estimate("zero_offset", flow.zero_offset_g_rev, "g/rev", 2),
        _make_estimate("fill_falloff", flow.fill_falloff_percent, "%", 1),
    )
    return CalibrationResult(
        "catch",
        estimates,
        points,
        tuple(CurvePoint(x, y, y * (1 - band), y * (1 + band)) for x, y in line),
        "shaft r/min" if by_speed else "opening mm",
        "g per turn",
        scatter=f"{flow.residual_sd_percent:.2f} %",
        source=tuple(caught),
    )


def make_catch_table(caught: Sequence[CatchPoint], path: str) -> BenchTable:
    # The table has the columns of a bench file, so that page and command line share the fit.
    """Returns the weighed catches as a bench table."""
    import numpy as np
    from topdress.control.calibration.bench_table import BenchTable

    names = ("shaft_rpm", "opening_mm", "duration_s", "mass_kg")
    return BenchTable(
        "catch",
        {name: np.array([getattr(one, name) for one in caught]) for name in names},
        path=path,
    )


def format_catch_csv(caught: Sequence[CatchPoint]) -> str:
    """Returns the text of a catch bench table; the product of shaft_rpm and duration_s is the
    counted revolutions."""
    # The header matches the bench files of `topdress calibrate catch`, which reads this table
    # again.
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("replicate", "shaft_rpm", "opening_mm", "duration_s", "mass_kg"))
    for number, one in enumerate(caught, 1):
        writer.writerow(
            (
                number,
                f"{one.shaft_rpm:.4f}",
                f"{one.opening_mm:.3f}",
                f"{one.duration_s:.3f}",
                f"{one.mass_kg:.4f}",
            )
        )
    return text.getvalue()


def find_lag_tables(folders: Sequence[Path]) -> list[LagTable]:
    """Returns the lag tables in these folders, the newest first. Other files are skipped."""
    found = []
    files = {
        path.resolve() for folder in folders if folder.is_dir() for path in folder.glob("*.csv")
    }
    for path in sorted(files, key=lambda path: path.stat().st_mtime, reverse=True):
        # A look at size and header avoids parsing long run logs, which are CSV files too.
        if path.stat().st_size > MAX_TABLE_BYTES or "shaft_rpm" not in _read_header_line(path):
            continue
        try:
            found.append(open_lag_table(path))
        except (ValueError, OSError):
            # The list offers only tables that can be fitted; a typed path still reports its error.
            continue
    return found


def _read_header_line(path: Path) -> str:
    with path.open("rb") as file:
        # 500 bytes hold the header of every bench table.
        return file.read(500).decode("utf-8", "replace").split("\n")[0]


def open_lag_table(path: Path) -> LagTable:
    """Returns the lag table at a path. Raises ValueError in one line where it cannot be fitted."""
    from topdress.drivers.files.bench_table import read_bench_table

    table = read_bench_table(path, "lag")
    # Response times contain the reaction of the sensor and are no lag of the material.
    if not any(name in table.columns for name in ("lag_s", "drop_s", "lag_m")):
        raise ValueError(
            f"{path}: column response_s holds no drop time: a lag fit needs lag_s, drop_s or lag_m"
        )
    labels = () if table.label is None else tuple(sorted(set(table.label.tolist())))
    return LagTable(str(path), table.rows, labels)


def fit_lag_table(machine: Machine, path: str, label: str | None) -> CalibrationResult:
    """Returns the lag line of a table, with its points inside and outside of the range."""
    import numpy as np
    from scipy.special import stdtrit
    from topdress.control.calibration import lag_fit
    from topdress.control.calibration.tube_fit import settle_tube
    from topdress.drivers.files.bench_table import read_bench_table

    table = read_bench_table(Path(path), "lag")
    # A table of changes alone determines the tube and no lag line.
    if table.find_running_rows().all():
        tube = settle_tube(table, machine)[1]
        return CalibrationResult(
            "lag",
            (_make_estimate("carried_share", tube.carried_share, "", 2),),
            scatter=f"{tube.scatter_s:.3f} s",
            source=(path, label),
        )
    _machine, line = lag_fit.fit_lag(table, machine, label=label)
    # The label selects rows of one way of measuring, e.g. detected drops.
    chosen = np.ones(table.rows, bool) if table.label is None else table.label == label
    lags = table.columns["lag_s"] if "lag_s" in table.columns else table.columns.get("drop_s")
    if lags is None:
        speed = table.find_speed_mps()
        # `fit_lag` refuses a table with lag_m but without speeds.
        assert speed is not None
        lags = table.columns["lag_m"] / speed
    speeds = table.columns["shaft_rpm"]
    chosen = chosen & np.isfinite(lags) & np.isfinite(speeds) & ~table.find_running_rows()
    points = tuple((float(x), float(y)) for x, y in zip(speeds[chosen], lags[chosen], strict=True))
    # The tolerance keeps speeds at the ends, which were rounded in the file.
    used = speeds[chosen & (speeds >= line.from_rpm - 1e-6) & (speeds <= line.to_rpm + 1e-6)]
    # Mean and sum of squares of the shaft speeds are the terms of a line's prediction interval.
    middle, about = float(np.mean(used)), float(np.sum((used - np.mean(used)) ** 2))
    # 0.95 in the upper tail of two sides gives the 90 % interval; a line has two parameters.
    quantile = float(stdtrit(line.rows_used - 2, 0.95)) * line.residual_sd_s

    def calc_half_band_s(x: float) -> float:
        return quantile * math.sqrt(1.0 + 1.0 / line.rows_used + (x - middle) ** 2 / about)

    curve = tuple(
        CurvePoint(
            x,
            line.calc_lag_s(x),
            line.calc_lag_s(x) - calc_half_band_s(x),
            line.calc_lag_s(x) + calc_half_band_s(x),
        )
        for x in _make_even_steps(line.from_rpm, line.to_rpm)
    )
    return CalibrationResult(
        "lag",
        (
            _make_estimate("slope", line.slope_s_per_rpm, "s per r/min", 5),
            _make_estimate("intercept", line.intercept_s, "s", 3),
        ),
        points,
        curve,
        "shaft r/min",
        "lag s",
        (line.from_rpm, line.to_rpm),
        f"{line.residual_sd_s:.3f} s",
        (path, label),
    )


def fit_wheel_drive(
    machine: Machine, counted_m: float, samples: Sequence[WheelSample]
) -> CalibrationResult:
    """Returns the circumference from a straight drive; `counted_m` is the circumference by which
    the wheel speed was computed, m."""
    _machine, fit = _fit_wheel_machine(machine, counted_m, samples)
    return CalibrationResult(
        "wheel",
        (_make_estimate("circumference", fit.circumference_m, "m", 4),),
        source=tuple(samples),
    )


def _fit_wheel_machine(
    machine: Machine, counted_m: float, samples: Sequence[WheelSample], today: str = ""
) -> tuple[Machine, WheelFit]:
    import numpy as np
    from topdress.control.calibration import wheel_fit

    time_s, lat, lon, quality, speed, flowing = (
        np.array(column) for column in zip(*samples, strict=True)
    )
    log = wheel_fit.WheelLog(time_s, lat, lon, quality.astype(float), speed, flowing)
    return wheel_fit.fit_wheel(
        log, machine, counted_m, "straight drive on the Calibrate page", date=today
    )


def fit_drive_effort(machine: Machine, path: str) -> CalibrationResult:
    """Returns the effort of the drives, from a run log as far as it is written; the fit is also
    saved."""
    from topdress.control.diagnosis.runs import effort_reference
    from topdress.drivers.files.any_log import open_any_log

    # A log that is still being written is read as far as its last complete row.
    new, fits = effort_reference.fit_effort(
        dict(open_any_log(Path(path)).columns),
        machine,
        path,
        date=day_clock.read_today().isoformat(),
    )
    numbers = [
        _make_estimate(cast(EstimateName, place.removeprefix("effort.")), one, unit, 4)
        for fit in fits
        for place, one, unit in fit.numbers
    ]
    return CalibrationResult(
        "effort",
        tuple(numbers),
        scatter=f"{fits[0].scatter:.3g} {fits[0].unit}",
        source=(new,),
        # The fitted machine is kept as the source, because saving must not fit the grown log again.
    )


def save_calibrated(
    machine: Machine, fitted: CalibrationResult, name: str, folder: Path, counted_m: float
) -> str:
    """Writes the new machine file and the table of its measurements; returns its path.

    Raises ValueError in one line for a name that exists, OSError where the file cannot be written.
    """
    from topdress.control.calibration.flow_fit import fit_flow
    from topdress.control.calibration.lag_fit import fit_lag as fit_line
    from topdress.control.calibration.tube_fit import settle_tube
    from topdress.drivers.files import config
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.bench_table import read_bench_table
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    path = folder / f"{name.removesuffix('.yaml')}.yaml"
    # A catch test was typed by hand, so its table is saved too: otherwise its data would be lost.
    table_path = path.with_suffix(".catch.csv")
    for taken in (path, table_path) if fitted.kind == "catch" else (path,):
        if taken.exists():
            raise ValueError(f"{taken}: exists already: nothing is overwritten")
    folder.mkdir(parents=True, exist_ok=True)
    today = day_clock.read_today().isoformat()
    if fitted.kind == "effort":
        (new,) = fitted.source
    elif fitted.kind == "wheel":
        new, _fit = _fit_wheel_machine(machine, counted_m, fitted.source, today)
    elif fitted.kind == "lag":
        table, label = fitted.source
        read = read_bench_table(Path(table), "lag")
        new = (
            machine
            if read.find_running_rows().all()
            else fit_line(read, machine, label=label, date=today)[0]
        )
        # The tube is settled on the machine that already has the new lag.
        if read.find_running_rows().any():
            new, _tube = settle_tube(read, new, date=today)
    else:
        # The table is written first, because the machine file names it as the source of its values.
        write_atomically(table_path, format_catch_csv(fitted.source))
        new, _flow = fit_flow(read_bench_table(table_path, "catch"), machine, date=today)
    config.save_config(path, new, MACHINE_KIND)
    return str(path)


def _make_even_steps(low: float, high: float) -> list[float]:
    return [low + (high - low) * k / (CURVE_POINTS - 1) for k in range(CURVE_POINTS)]


def _make_estimate(
    name: EstimateName, interval: FittedInterval | None, unit: str, decimals: int
) -> Estimate:
    if interval is None:
        return Estimate(name, None, None, None, unit, decimals)
    return Estimate(name, interval.value, interval.low, interval.high, unit, decimals)
