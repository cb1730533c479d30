"""Which lag model does a lag test give? A straight line over shaft speed, with its range (lag
paper eq 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from topdress.control.machine.fall import Fall, find_start_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.start_lag import calc_response_s, find_first_fall_s, refit_start

from .bench_table import Array, BenchTable, select_usable_rows
from .calibration_record import make_record, make_title, merge_records
from .least_squares import FittedInterval, fit_linear

# Rounded speeds at the ends of the range must still count as inside, r/min.
_RANGE_TOLERANCE_RPM = 1e-6
# Greatest start_more_per_rpm that the machine file allows.
MAX_START_MORE_PER_RPM = 0.1
# Number of shaft speeds over the line's range at which the start is compared.
START_FIT_SPEEDS = 7


@dataclass(frozen=True, slots=True)
class LagFit:
    """Holds the fitted line lag_s = intercept_s + slope_s_per_rpm n, n in r/min, from `from_rpm`
    to `to_rpm` and nowhere else.

    `measured`: the column fitted (lag_s, drop_s, or lag_m over the written speed).
    `residuals_s`: (n,), rows used."""

    measured: str
    intercept_s: FittedInterval
    slope_s_per_rpm: FittedInterval
    from_rpm: float
    to_rpm: float
    rows_used: int
    residual_sd_s: float
    correlation: float
    residuals_s: Array
    notes: tuple[str, ...]

    def calc_lag_s(self, shaft_rpm: float) -> float:
        """Returns the lag on the line, s. Raises ValueError outside the fitted range: the line
        is not extrapolated."""
        if (
            not self.from_rpm - _RANGE_TOLERANCE_RPM
            <= shaft_rpm
            <= self.to_rpm + _RANGE_TOLERANCE_RPM
        ):
            raise ValueError(
                f"shaft speed {shaft_rpm:g} r/min: the lag line holds from {self.from_rpm:g} to "
                f"{self.to_rpm:g} r/min"
            )
        return self.intercept_s.value + self.slope_s_per_rpm.value * shaft_rpm


def fit_lag(
    table: BenchTable,
    machine: Machine,
    *,
    label: str | None = None,
    from_rpm: float | None = None,
    to_rpm: float | None = None,
    date: str = "",
) -> tuple[Machine, LagFit]:
    """Fits the lag line of starts, and returns a copy of the machine with its drop time, and the
    fit (lag paper eq 6).

    The machine's present response is subtracted from a whole lag. Times are of starts from a
    standing shaft, as a rig and the papers measure them; the machine's running shaft is then
    adjusted so that its own start gives the line (`start_more_per_rpm`).

    Parameters
    ----------
    table : the lag test.
    machine : the machine model.
    label : rows of that value of the table's label column only (needed where it has one).
    from_rpm, to_rpm : range of shaft speeds, r/min; None: the machine's own. Rows beyond it are
        compared with the line and noted, but do not bend it.
    date : of the test, for the record.

    Raises
    ------
    ValueError : in one line, where the table cannot give a line."""
    # Rows with missing numbers would make the whole fit invalid.
    table = select_usable_rows(table)
    if table.kind != "lag":
        raise ValueError(f"{table.path}: a {table.kind} table: a lag fit needs a lag table")
    measured, whole, lags = _find_measured_lags(table)
    chosen = _find_label_rows(table, label)
    speeds = table.columns["shaft_rpm"]
    low = machine.fall.valid_from_rpm if from_rpm is None else from_rpm
    high = machine.fall.valid_to_rpm if to_rpm is None else to_rpm
    chosen &= np.isfinite(lags)
    # A running shaft has a shorter drop time, so its rows would bend the line of starts.
    running = int(np.sum(chosen & table.find_running_rows()))
    chosen &= ~table.find_running_rows()
    used = chosen & (speeds >= low - _RANGE_TOLERANCE_RPM) & (speeds <= high + _RANGE_TOLERANCE_RPM)
    if low > high:
        raise ValueError(
            f"{table.path}: shaft speeds from {low:g} to {high:g} r/min: allowed is a range "
            "that rises; "
            f"the machine's line holds from {machine.fall.valid_from_rpm:g} to "
            f"{machine.fall.valid_to_rpm:g} r/min"
        )
    # Two speeds determine a line and leave nothing to test it.
    if len(np.unique(speeds[used])) < 3:
        raise ValueError(
            f"{table.path}: column shaft_rpm: {len(np.unique(speeds[used]))} different "
            "shaft speeds from "
            f"{low:g} to {high:g} r/min: at least 3 are needed"
        )
    n, y = speeds[used], lags[used]
    fit = fit_linear(np.column_stack([np.ones(len(n)), n]), y, np.ones(len(n)))
    # Only a whole lag contains the response; a drop time begins after it.
    response = float(np.mean([calc_response_s(machine, rpm) for rpm in n])) if whole else 0.0
    # The line holds between the speeds that were measured, not those that were requested.
    first, last = float(n.min()), float(n.max())
    line = LagFit(
        measured,
        fit.calc_interval(0),
        fit.calc_interval(1),
        first,
        last,
        len(n),
        float(np.sqrt(np.sum(fit.residuals**2) / fit.dof)),
        float(np.corrcoef(n, y)[0, 1]),
        fit.residuals,
        (
            f"the line holds from {first:g} to {last:g} r/min",
            *(
                [
                    f"{running} rows of a shaft that turned before are not used: the line "
                    "is that of starts"
                ]
                if running
                else []
            ),
            *_compare_rows_beyond(
                fit.coefficients, speeds, lags, chosen & ~used, response, machine
            ),
        ),
    )
    return _calibrate_machine(machine, line, response, table, date), line


def _find_label_rows(table: BenchTable, label: str | None) -> np.ndarray:
    if table.label is None:
        if label is not None:
            raise ValueError(f"{table.path}: label {label!r}: the table has no label column")
        return np.ones(table.rows, bool)
    values = sorted(set(table.label.tolist()))
    if label is None:
        # Different methods of measuring give different lags, so the user must choose.
        raise ValueError(
            f"{table.path}: column {table.label_column}: say which rows to fit: {', '.join(values)}"
        )
    if label not in values:
        raise ValueError(
            f"{table.path}: column {table.label_column}: no rows {label!r}: allowed "
            f"{', '.join(values)}"
        )
    return np.asarray(table.label == label)


def _find_measured_lags(table: BenchTable) -> tuple[str, bool, Array]:
    """Returns the fitted column, whether it contains the response too, and lags in s."""
    # The order prefers the most direct column.
    for name in ("lag_s", "drop_s"):
        if name in table.columns:
            return name, name == "lag_s", table.columns[name]
    speed = table.find_speed_mps()
    if "lag_m" in table.columns and speed is not None:
        # A distance becomes a time by the ground speed of its row.
        return "lag_m", True, table.columns["lag_m"] / speed
    raise ValueError(
        f"{table.path}: column response_s holds no drop time: a lag fit needs lag_s, drop_s "
        "or lag_m"
    )


def _compare_rows_beyond(
    line: Array, speeds: Array, lags: Array, rest: np.ndarray, response: float, machine: Machine
) -> tuple[str, ...]:
    notes = []
    for rpm in np.unique(speeds[rest]):
        # Rows beyond the range are reported, so that the user sees whether the line continues.
        off = float(np.mean(lags[rest & (speeds == rpm)]) - line[0] - line[1] * rpm)
        notes.append(
            f"at {rpm:g} r/min, outside the range and not used, the mean lag is {off:+.3f} "
            "s off the line; "
            "the machine file before says "
            f"{find_start_drop_s(machine.fall, float(rpm)) + response:.3f} s"
        )
    return tuple(notes)


def _calibrate_machine(
    machine: Machine, line: LagFit, response: float, table: BenchTable, date: str
) -> Machine:
    # The machine file has the drop time alone, because the response is a property of the drive.
    drop = FittedInterval(*(value - response for value in line.intercept_s))
    valid = {"shaft_rpm": (line.from_rpm, line.to_rpm)}
    fall = machine.fall._replace(
        intercept_s=drop.value,
        slope_s_per_rpm=line.slope_s_per_rpm.value,
        # Earlier corrections of the line are contained in the new one and return to zero.
        offset_s=0.0,
        valid_from_rpm=line.from_rpm,
        valid_to_rpm=line.to_rpm,
        rebound_s=0.0,
    )
    if fall.carried_share >= 1.0:
        fall = fall._replace(start_more_per_rpm=fit_start_more_per_rpm(machine, fall))
    else:
        fall = refit_start(machine.model_copy(update={"fall": fall})).fall
    records = (
        make_record("fall.intercept_s", drop, "s", table.path, date, valid),
        make_record(
            "fall.slope_s_per_rpm", line.slope_s_per_rpm, "s per r/min", table.path, date, valid
        ),
    )
    # The model is validated again, because a fit can leave the allowed range.
    checked = Machine.model_validate({**dict(machine), "fall": fall})
    return checked.model_copy(
        update={
            "adopted": merge_records(machine, records, ("lag.offset", "lag.rebound")),
            "title": make_title(machine, "lag", table.path, date),
        }
    )


def fit_start_more_per_rpm(machine: Machine, fall: Fall) -> float:
    """Returns how much longer a start takes than the running shaft's drop, an r/min, so that the
    machine's own start gives `fall`'s line over its range as closely as possible (least
    squares). `fall`'s own value where its line does not fall with shaft speed."""
    speeds = np.linspace(fall.valid_from_rpm, fall.valid_to_rpm, START_FIT_SPEEDS).tolist()
    falls = [-fall.slope_s_per_rpm * n * n for n in speeds]
    if max(falls) <= 0.0:
        return fall.start_more_per_rpm
    most = min(
        # 0.9 keeps the drop time of the running shaft above zero.
        0.9 * find_start_drop_s(fall, n) / more
        for n, more in zip(speeds, falls, strict=True)
        if more > 0.0
    )

    def off(more: float) -> float:
        settled = fall._replace(start_more_per_rpm=more)
        return float(
            sum(
                (find_first_fall_s(machine, settled, n) - find_start_drop_s(fall, n)) ** 2
                for n in speeds
            )
        )

    return float(
        minimize_scalar(
            off,
            bounds=(0.0, min(most, MAX_START_MORE_PER_RPM)),
            method="bounded",
            options={"xatol": 1e-6},
        ).x
    )
