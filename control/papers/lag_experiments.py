"""Does one machine reproduce every table of the lag paper, each by its own experiment, and what do
the tables leave open?

Table 2: command to 2 r/min. Table 3: from there to the first granule of a start
(`control.machine.start_lag`), as the plate of the rig detects it. Table 4: the sum of both, and
table 1's distances divided by a speed. Table 1: the start over the field at the speed of the test.
The line of starts and its rise above 70 r/min are fitted to table 3; the speed of the test, or a
delay that only the field has, is fitted to table 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, minimize_scalar
from scipy.special import stdtrit
from topdress.control.machine.fall import Fall, calc_drop_s, find_start_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.model_elements import Array
from topdress.control.machine.shaft import step_first_order
from topdress.control.machine.start_lag import calc_response_s, find_first_fall_s

from .page import Table
from .published import DROP_S, LAG_M, LAG_SPEED_KMH, RESPONSE_S, TOTAL_LAG_S

# Shaft speeds of all tables, r/min, in the order of table 1.
TEST_SPEEDS_RPM = tuple(LAG_M)
STATED_MPS = LAG_SPEED_KMH / 3.6
# Speed by which table 4's field times follow from table 1's distances, m/s.
CONVERTED_MPS = 4.5 / 3.6
# Time step of the simulations, s.
# A step of 2.5 ms is far below the 0.01 s to which drop times are printed.
STEP_S = 0.0025
# Means of table 1 (m) and table 3 (s), and standard errors of the latter, (10,).
MEAN_LAG_M = np.array([np.mean(LAG_M[n]) for n in TEST_SPEEDS_RPM])
MEAN_DROP_S = np.array([np.mean(DROP_S[n]) for n in TEST_SPEEDS_RPM])
DROP_SE_S = np.array([np.std(DROP_S[n], ddof=1) / np.sqrt(len(DROP_S[n])) for n in TEST_SPEEDS_RPM])


class FittedNumber(NamedTuple):
    """Holds a fitted number with its 90 % interval."""

    value: float
    low: float
    high: float

    def text(self, form: str) -> str:
        return f"{form.format(self.value)} ({form.format(self.low)} to {form.format(self.high)})"


class FieldConversion(NamedTuple):
    """Holds the conversion of the rig's lags to the field's distances: the speed of the test, or
    a delay."""

    mps: FittedNumber
    mps_rms_m: float
    delay: FittedNumber
    delay_rms_m: float


def fit_rise(machine: Machine) -> tuple[Machine, FittedNumber]:
    """Returns the machine with the rise above 70 r/min fitted to table 3's means at 80 to 100
    r/min, through the rig's test."""
    # Up to this speed the line of the machine file holds.
    above = [k for k, n in enumerate(TEST_SPEEDS_RPM) if n > machine.fall.valid_to_rpm]

    def risen(rise_s: float) -> Fall:
        return machine.fall._replace(rebound_s=rise_s)

    def off(rise_s: float) -> Array:
        falls = np.array(
            [find_first_fall_s(machine, risen(rise_s), TEST_SPEEDS_RPM[k]) for k in above]
        )
        # Residuals are in standard errors, so that exact means weigh more.
        return np.asarray((MEAN_DROP_S[above] - falls) / DROP_SE_S[above])

    rise = float(
        minimize_scalar(
            # A rise of 2 s exceeds every printed drop time, so the bound is no constraint.
            lambda size: float(np.sum(off(size) ** 2)),
            bounds=(0.0, 2.0),
            method="bounded",
        ).x
    )
    # The slope at the optimum, by a central difference of 0.02 s, gives the interval; 1.645 is the
    # normal quantile.
    half = 1.645 * 0.02 / float(np.linalg.norm(off(rise + 0.01) - off(rise - 0.01)))
    return machine.model_copy(update={"fall": risen(rise)}), FittedNumber(
        rise, rise - half, rise + half
    )


def calc_start_rise(machine: Machine, parameter: FittedNumber) -> FittedNumber:
    """Returns the additional time of a start at 100 r/min over the line, s.

    The parameter is the rise of a granule's own drop time at 100 r/min. Granules that leave while
    the shaft accelerates take less, and the first granule is among them.
    """
    line = find_first_fall_s(machine, machine.fall, 100.0)
    return FittedNumber(
        *(
            find_first_fall_s(machine, machine.fall._replace(rebound_s=size), 100.0) - line
            for size in parameter
        )
    )


class LagExplanations(NamedTuple):
    """Holds three explanations of table 1's distances by tables 2 and 3, each with its best size
    and its log likelihood."""

    speed_kmh: float
    # Delay at the stated speed, s.
    delay_s: float
    # Delay at the speed that table 4's times assume, s.
    delay_at_4_5_s: float
    of_speed: float
    of_delay: float
    of_delay_at_4_5: float

    @property
    def calc_delay_odds(self) -> float:
        # The quotient of two likelihoods is the odds of both explanations.
        return float(np.exp(self.of_speed - self.of_delay))

    @property
    def calc_delay_odds_at_4_5(self) -> float:
        return float(np.exp(self.of_speed - self.of_delay_at_4_5))


def compare_speed_and_delay() -> LagExplanations:
    """Compares table 1's means at 10 to 70 r/min with the line through table 3's seventy drop times
    plus the mean response.

    The line's own uncertainty is included: it is common to all seven distances, and with a steeper
    line a delay fits as well.
    """
    rpm = np.array([n for n in TEST_SPEEDS_RPM if n <= 70], dtype=np.float64)
    drops = np.concatenate([DROP_S[int(n)] for n in rpm])
    # Each shaft speed has equally many drops.
    design = np.column_stack([np.ones(len(drops)), np.repeat(rpm, len(drops) // len(rpm))])
    line = np.linalg.lstsq(design, drops, rcond=None)[0]
    left = drops - design @ line
    at = np.column_stack([np.ones(len(rpm)), rpm])
    # The covariance of the line at all seven speeds: an error of the slope is common to them.
    unsure = at @ np.linalg.inv(design.T @ design) @ at.T * float(left @ left) / (len(drops) - 2)
    # Table 2 shows no influence of the shaft speed, so the mean response serves.
    lag = at @ line + float(np.mean([value for pair in RESPONSE_S.values() for value in pair]))
    repeats = float(np.mean([np.var(values, ddof=1) / len(values) for values in LAG_M.values()]))

    # Minus the logarithm of a normal likelihood with correlated errors.
    def minus_log(mps: float, delay_s: float) -> float:
        spread = mps * mps * unsure + repeats * np.eye(len(rpm))
        off = MEAN_LAG_M[: len(rpm)] - mps * (lag + delay_s)
        return float(
            0.5 * (off @ np.linalg.solve(spread, off) + np.linalg.slogdet(2.0 * np.pi * spread)[1])
        )

    speed = minimize_scalar(lambda mps: minus_log(mps, 0.0), bounds=(0.8, 2.5), method="bounded")
    # The delay is fitted twice: at the stated speed, and at the speed by which table 4 was
    # converted.
    delay, delay_at_4_5 = (
        minimize_scalar(lambda s, v=mps: minus_log(v, s), bounds=(-1.0, 1.5), method="bounded")
        for mps in (STATED_MPS, CONVERTED_MPS)
    )
    return LagExplanations(
        3.6 * float(speed.x),
        float(delay.x),
        float(delay_at_4_5.x),
        -float(speed.fun),
        -float(delay.fun),
        -float(delay_at_4_5.fun),
    )


def calc_overtaking_fall_s(
    machine: Machine, shaft_rpm: float, intercept_s: float, slope_s_per_rpm: float
) -> float:
    """Returns the drop time in the same test for granules that fall singly, s: each has the drop
    time of the shaft speed at its release, so later granules overtake.

    With eq 6 as that drop time this is the earlier model, kept for comparison.
    """
    # Material flows from 2 r/min on, which is the paper's threshold of turning.
    shaft, rpm, at_s, first = machine.shaft, 2.0, 0.0, float("inf")
    # After 1.5 s every shaft speed of the tests is reached.
    while at_s < 1.5:
        first = min(first, at_s + intercept_s + slope_s_per_rpm * rpm)
        rpm = step_first_order(
            rpm, shaft_rpm, shaft.time_constant_s, shaft.acceleration_rpm_s, STEP_S
        )
        at_s += STEP_S
    return first


def calc_start_lags(machine: Machine, falls: Callable[[float], float]) -> Array:
    """Returns the total lags of a start at the paper's shaft speeds, (10,) s."""
    return np.array([calc_response_s(machine, n) + falls(n) for n in TEST_SPEEDS_RPM])


def fit_field_conversion(lags_s: Array) -> FieldConversion:
    """Returns the speed or delay that converts the lags to table 1's distances, by least squares
    over all ten shaft speeds."""
    # Each shaft speed gives an estimate, and their scatter gives the interval.
    mps = MEAN_LAG_M / lags_s
    delay = MEAN_LAG_M / STATED_MPS - lags_s
    return FieldConversion(
        _fit_mean(mps),
        _calc_rms(MEAN_LAG_M - float(np.mean(mps)) * lags_s),
        _fit_mean(delay),
        _calc_rms(MEAN_LAG_M - STATED_MPS * (lags_s + float(np.mean(delay)))),
    )


def _fit_mean(values: Array) -> FittedNumber:
    middle = float(np.mean(values))
    # The t quantile at 0.95 gives a two-sided 90 % interval.
    half = float(stdtrit(len(values) - 1, 0.95) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return FittedNumber(middle, middle - half, middle + half)


def _calc_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def make_experiment_tables(machine: Machine) -> tuple[tuple[Table, ...], tuple[str, ...]]:
    """Returns the tables of rows, of r.m.s. errors next to the old model's, and of what each
    table determines, with sentences."""
    risen, parameter = fit_rise(machine)
    rise = calc_start_rise(machine, parameter)
    lags = calc_start_lags(risen, lambda n: find_first_fall_s(risen, risen.fall, n))
    # The earlier model is kept so that the report shows what the present one improves.
    old = calc_start_lags(
        machine,
        lambda n: calc_overtaking_fall_s(
            machine, n, machine.fall.intercept_s, machine.fall.slope_s_per_rpm
        ),
    )
    field, odds = fit_field_conversion(lags), compare_speed_and_delay()
    turns = np.array([calc_response_s(machine, n) for n in TEST_SPEEDS_RPM])
    driven = field.mps.value * lags
    detected, actual = (np.array([TOTAL_LAG_S[n][k] for n in TEST_SPEEDS_RPM]) for k in (1, 0))
    responses = np.array([np.mean(RESPONSE_S[n]) for n in TEST_SPEEDS_RPM])
    rows = tuple(
        (
            rpm,
            *(
                float(value[k])
                for value in (
                    responses,
                    turns,
                    MEAN_DROP_S,
                    lags - turns,
                    old - turns,
                    detected,
                    lags,
                    old,
                    actual,
                    driven / CONVERTED_MPS,
                    STATED_MPS * old / CONVERTED_MPS,
                    MEAN_LAG_M,
                    driven,
                    STATED_MPS * old,
                )
            ),
        )
        for k, rpm in enumerate(TEST_SPEEDS_RPM)
    )
    line = np.array([n <= machine.fall.valid_to_rpm for n in TEST_SPEEDS_RPM])
    held = (
        # Table 2 has no line, so all its rows count (`line | True`).
        ("table 2, s", responses, turns, turns, line | True),
        ("table 3, s", MEAN_DROP_S, lags - turns, old - turns, line),
        ("table 4 detected, s", detected, lags, old, line),
        (
            "table 4 actual, s",
            actual,
            driven / CONVERTED_MPS,
            STATED_MPS * old / CONVERTED_MPS,
            line,
        ),
        ("table 1, m", MEAN_LAG_M, driven, STATED_MPS * old, line),
    )
    # Difference between a start and a running shaft at 70 r/min, s.
    more = find_start_drop_s(machine.fall, 70.0) - calc_drop_s(machine.fall, 70.0)
    slopes = tuple(
        float(np.polyfit(np.array(TEST_SPEEDS_RPM)[line], lag[line], 1)[0]) for lag in (lags, old)
    )
    sums = tuple(
        (
            name,
            _calc_rms((ours - paper)[part]),
            _calc_rms((before - paper)[part]),
            _calc_rms(ours - paper),
            _calc_rms(before - paper),
        )
        for name, paper, ours, before, part in held
    )
    return (
        (
            *_make_row_tables(rows),
            Table(
                "R.m.s. by table, one model through each table's own experiment, next to "
                "the model before (eq 6 as the drop "
                "time "
                "of a running shaft, granules overtaking)",
                ("table", "10 to 70 r/min", "before", "10 to 100 r/min", "before"),
                sums,
                (0, 4, 4, 4, 4),
            ),
            _make_settled_table(risen, rise, field, odds),
        ),
        (
            f"The paper's own test played through the model has a slope of {slopes[0]:.4f} "
            "s per r/min and takes "
            f"{lags[6]:.3f} s at 70 r/min (published -0.0083 and 1.620; the model before "
            f"{slopes[1]:.4f} and "
            f"{old[6]:.3f} s). "
            "There granules are carried along by the stream behind them and do not "
            "overtake; a running shaft's drop time "
            f"at 70 r/min is then {calc_drop_s(machine.fall, 70.0):.2f} s, {1000.0 * more:.0f} "
            "ms less than a start's. No table "
            "settles that: granules that fall each by itself, "
            f"{_fit_single_fall(machine):.2f} s at 70 r/min, give the same starts.",
            "What reconciles table 1 with the rig's times is a test speed of "
            f"{field.mps.text('{:.2f}')} m/s, "
            f"{3.6 * field.mps.value:.2f} km/h where {LAG_SPEED_KMH:g} is written (r.m.s. "
            f"{field.mps_rms_m:.3f} m over "
            f"ten shaft "
            f"speeds), or a delay of {field.delay.text('{:.2f}')} s that only the field has "
            "(r.m.s. "
            f"{field.delay_rms_m:.3f} m). The slope of the rig's line is known to a fifth "
            "of itself, and with that the "
            f"speed is likelier than the delay by {odds.calc_delay_odds:.1f} to 1 only; and "
            f"than {3.6 * CONVERTED_MPS:.2f} "
            f"km/h, by which table 4 was made, with a delay of {odds.delay_at_4_5_s:.2f} s by "
            f"{odds.calc_delay_odds_at_4_5:.1f} to 1. That is a tie, and the last is the "
            "plainest: it needs no speed but "
            "the one that the authors used themselves. "
            "One ground speed cannot tell them apart. Where the field is driven as the "
            "paper did it, the lag that lands "
            "right is table 1's own, whichever it is.",
        ),
    )


def _make_row_tables(rows: tuple[tuple[float, ...], ...]) -> tuple[Table, Table]:
    return (
        Table(
            "One model, the rig's tables: published, obtained, model before; 80 to 100 "
            "r/min with the rise "
            "fitted to "
            "table 3",
            (
                "r/min",
                "table 2, s",
                "obtained",
                "table 3, s",
                "obtained",
                "before",
                "table 4 detected, s",
                "obtained",
                "before",
            ),
            tuple(row[:9] for row in rows),
            (0, *(3,) * 8),
        ),
        Table(
            "One model, the field's tables: published, obtained with the speed fitted to "
            "table 1, model before "
            "with "
            "none fitted",
            (
                "r/min",
                "table 4 actual, s",
                "obtained",
                "before",
                "table 1, m",
                "obtained",
                "before",
            ),
            tuple((row[0], *row[9:]) for row in rows),
            (0, 3, 3, 3, 2, 2, 2),
        ),
    )


def _make_settled_table(
    machine: Machine, rise: FittedNumber, field: FieldConversion, odds: LagExplanations
) -> Table:
    fall = machine.fall
    response = np.array([value for pair in RESPONSE_S.values() for value in pair])
    rpm = np.array([n for n in TEST_SPEEDS_RPM if n <= fall.valid_to_rpm], dtype=np.float64)
    singles = np.array([DROP_S[int(n)] for n in rpm])
    x = np.repeat(rpm, singles.shape[1])
    slope, intercept = np.polyfit(x, singles.ravel(), 1)
    left = singles.ravel() - intercept - slope * x
    sd = float(np.sqrt(np.sum(left**2) / (len(x) - 2)))
    about = float(np.sum((x - x.mean()) ** 2))
    # 1.668 is the t quantile for 68 degrees of freedom, 90 % two-sided.
    half = 1.668 * sd / np.sqrt(about), 1.668 * sd * np.sqrt(1.0 / len(x) + x.mean() ** 2 / about)
    singly = _fit_single_fall(machine)
    return Table(
        "What the tables settle and what they leave open, 90 % intervals",
        ("quantity", "value", "settled by"),
        (
            ("response to 2 r/min, s", _fit_mean(response).text("{:.4f}"), "table 2, 20 rows"),
            (
                "a start's drop at 0 r/min, s",
                FittedNumber(intercept, intercept - half[1], intercept + half[1]).text("{:.3f}"),
                "table 3, 70 rows; the machine file's 1.8288 is eq 6 less the response",
            ),
            (
                "its slope, s per r/min",
                FittedNumber(slope, slope - half[0], slope + half[0]).text("{:.4f}"),
                "table 3, 70 rows",
            ),
            (
                "its rise at 100 r/min over the line, s",
                rise.text("{:.3f}"),
                "table 3; table 1 confirms it",
            ),
            (
                "speed by which table 4's field times were made, km/h",
                _fit_mean(
                    3.6 * MEAN_LAG_M / np.array([TOTAL_LAG_S[n][0] for n in TEST_SPEEDS_RPM])
                ).text("{:.3f}"),
                "table 1 over table 4",
            ),
            (
                "speed of the test, km/h",
                _fit_mean(
                    3.6
                    * MEAN_LAG_M
                    / calc_start_lags(machine, lambda n: find_first_fall_s(machine, fall, n))
                ).text("{:.2f}"),
                "table 1 over tables 2 and 3, if nothing else differs",
            ),
            (
                "or: a delay of the field alone, s",
                field.delay.text("{:.2f}"),
                "tables 1, 2 and 3, if the written speed holds",
            ),
            (
                f"or: a delay at {3.6 * CONVERTED_MPS:.2f} km/h, s",
                f"{odds.delay_at_4_5_s:.2f}",
                "tables 1, 2 and 3, if the speed of table 4 holds",
            ),
            (
                "likelihood of the three, the slope's own uncertainty in it",
                f"1 : {1.0 / odds.calc_delay_odds:.2f} : {1.0 / odds.calc_delay_odds_at_4_5:.2f}",
                "no table; a second ground speed would",
            ),
            (
                "carrying along: a running shaft's drop at 70 r/min, s",
                f"{calc_drop_s(fall, 70.0):.2f} (carried along) to {singly:.2f} (each granule by "
                "itself)",
                "no table: every test is a start; a change between two rates would settle it",
            ),
            (
                # 0.32 s is the free fall from the outlet's height of 0.5 m.
                "first fill of an empty tube, s",
                f"0 to {calc_drop_s(fall, 70.0) - 0.32:.2f}",
                "no table; bounded by a free fall of 0.32 s from the outlet's 0.5 m",
            ),
        ),
        (0, 0, 0),
    )


def _fit_single_fall(machine: Machine) -> float:
    """Returns the drop time of a running shaft at 70 r/min, s, if granules fall singly and
    overtake.

    The line of drop times is the one whose overtaking start equals that of the machine (least
    squares, 10 to 70 r/min).
    """
    speeds = [n for n in TEST_SPEEDS_RPM if n <= machine.fall.valid_to_rpm]

    def off(line: Array) -> Array:
        return np.array(
            [
                calc_overtaking_fall_s(machine, n, float(line[0]), float(line[1]))
                - find_start_drop_s(machine.fall, n)
                for n in speeds
            ]
        )

    intercept, slope = least_squares(
        off,
        [machine.fall.intercept_s, machine.fall.slope_s_per_rpm - 1.0 / 200.0],
    ).x
    return float(intercept + 70.0 * slope)
