"""Which claims does the lag paper make, and does each hold here?"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from topdress.control.geodesy import TangentPlane, calc_ellipsoid_distance_m, calc_paper_distance_m
from topdress.control.machine.fall import find_paper_lag_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.start_lag import calc_response_s, find_start_lag_s

from .map_geometry import EDGE_AHEAD_M, PLACE_DEG, count_agreeing_cells, make_boundary_table
from .page import ROUNDING_TEXT, Claim, ResultOrigin, compare_numbers
from .published import (
    CORRECTED_M,
    CORRECTION_GAIN_M,
    DROP_S,
    LAG_LINE,
    LAG_M,
    LAG_SPEED_KMH,
    RESPONSE_S,
    TOTAL_LAG_S,
)

# Ground speed of the paper's field tests, m/s.
TEST_SPEED_MPS = LAG_SPEED_KMH / 3.6
# Mean response by table 2, s.
MEAN_RESPONSE_S = float(np.mean([value for pair in RESPONSE_S.values() for value in pair]))
# Mean lag distance by shaft speed, m (table 1).
MEAN_M = {rpm: float(np.mean(values)) for rpm, values in LAG_M.items()}
# Mean drop time by shaft speed, s (table 3).
MEAN_DROP_S = {rpm: float(np.mean(values)) for rpm, values in DROP_S.items()}
# Shaft speeds of the line, 10 to 70 r/min.
LINE_SPEEDS_RPM = tuple(CORRECTION_GAIN_M)


def calc_rms(values: Iterable[float]) -> float:
    """Returns the root mean square."""
    return float(np.sqrt(np.mean(np.square(list(values)))))


def list_equation_claims() -> list[Claim]:
    """Returns the claims of the equations."""
    plane = TangentPlane(*PLACE_DEG)
    there = plane.convert_to_deg(10.0, 0.0)
    east = calc_paper_distance_m(*PLACE_DEG, *there), calc_ellipsoid_distance_m(*PLACE_DEG, *there)
    agree, asked = count_agreeing_cells()
    printed_m, right_m = (float(cell or 0.0) for cell in make_boundary_table().rows[0][1:])
    rpm = np.array(LINE_SPEEDS_RPM, dtype=np.float64)
    detected = np.array([TOTAL_LAG_S[n][1] for n in LINE_SPEEDS_RPM])
    # The fit of this program repeats the paper's on the paper's own data.
    slope, intercept = (float(v) for v in np.polyfit(rpm, detected, 1))
    r = float(np.corrcoef(rpm, detected)[0, 1])
    # Distance over time gives the speed with which table 4 was computed.
    kmh = [3.6 * MEAN_M[n] / TOTAL_LAG_S[n][0] for n in LAG_M]
    return [
        Claim(
            "eq 1",
            "L = v T / 3.6: table 4's field times from table 1's distances",
            f"{LAG_SPEED_KMH:g} km/h",
            f"{np.mean(kmh):.3f} km/h ({min(kmh):.3f} to {max(kmh):.3f} in {len(kmh)} of "
            f"{len(kmh)} rows)",
            ResultOrigin.RECOMPUTED,
            abs(float(np.mean(kmh)) - LAG_SPEED_KMH) < 0.01,
            "the times were made with 4.5 km/h; text and table 1 say 4.25",
            "0.01 km/h: ten distances rounded to 0.01 m",
        ),
        Claim(
            "eq 2",
            "cell of a place",
            "a rule without figures",
            f"right at {agree} of {asked} distances over 10 cells",
            ResultOrigin.RECOMPUTED,
            agree == asked,
            "",
            "none: a rule holds or does not",
        ),
        Claim(
            "eq 3",
            "distance of two places, radius 6 356 755 m",
            "10 m east at 40 N",
            f"{east[0]:.2f} m as printed, {east[1]:.2f} m on WGS84",
            ResultOrigin.RECOMPUTED,
            # An error of 0.05 m matters less than a receiver's own.
            abs(east[0] - east[1]) < 0.05,
            "the cosine stands with the wrong product",
            "0.05 m: the digits that an arccosine leaves of 10 m",
        ),
        Claim(
            "eq 4, 5",
            "distance to a border cell's edge",
            f"{EDGE_AHEAD_M:g} m ahead at 30 degrees",
            f"{printed_m:.2f} m as printed, {right_m:.2f} m by vectors",
            ResultOrigin.RECOMPUTED,
            abs(printed_m - right_m) < 0.05,
            "eq 5 takes X1 where X belongs, and eq 4 has no slope due north",
            "0.05 m: a good receiver's own error",
        ),
        Claim(
            "eq 6",
            "T = a + b n, fitted to the detected lags",
            f"{LAG_LINE[0]:.4f} s, {LAG_LINE[1]:.4f} s per r/min",
            f"{intercept:.4f} s, {slope:.4f} s per r/min",
            ResultOrigin.FITTED,
            abs(slope - LAG_LINE[1]) < 5e-5 and abs(intercept - LAG_LINE[0]) < 5e-4,
            "",
            "5e-5 s per r/min: half of its last digit; 5e-4 s: the lags are rounded to 0.001 s",
        ),
        Claim(
            "section 2.4.3",
            "correlation of shaft speed and lag",
            "0.97",
            f"r {r:.3f}, its square {r * r:.3f}",
            ResultOrigin.FITTED,
            abs(abs(r) - 0.97) < 0.005,
            "what is printed is the square",
            f"0.005: {ROUNDING_TEXT}",
        ),
    ]


def list_table_claims(machine: Machine) -> list[Claim]:
    """Returns the claims of tables 1 to 3."""
    first = {n: find_start_lag_s(machine, n) for n in LAG_M}
    repeats_m = float(np.sqrt(np.mean([np.var(values, ddof=1) for values in LAG_M.values()])))
    # Only speeds within the line's range are compared.
    off_m = calc_rms(MEAN_M[n] - TEST_SPEED_MPS * first[n] for n in LINE_SPEEDS_RPM)
    response = calc_rms(
        value - calc_response_s(machine, n) for n, pair in RESPONSE_S.items() for value in pair
    )
    drop = calc_rms(
        MEAN_DROP_S[n] - first[n] + calc_response_s(machine, n) for n in LINE_SPEEDS_RPM
    )
    # Each pair has the value of the standing tractor and that of the moving one.
    still, moving = (np.array([pair[k] for pair in RESPONSE_S.values()]) for k in (0, 1))
    apart = float((moving - still).mean())
    # 1.833 is the t quantile for nine degrees of freedom, 90 % two-sided.
    sure = float(1.833 * (moving - still).std(ddof=1) / np.sqrt(len(still)))
    return [
        Claim(
            "table 1",
            "lag distance, 10 shaft speeds three times",
            "2.29 to 3.18 m",
            f"r.m.s. {off_m:.3f} m, 10 to 70 r/min, at the written speed",
            ResultOrigin.SIMULATED,
            # Three standard deviations of a replicate separate a systematic difference from
            # scatter.
            off_m < 3.0 * repeats_m,
            "the field's lag is longer than the rig's; see the tables across each other",
            f"{3.0 * repeats_m:.2f} m: three times the s.d. of its replicates",
        ),
        compare_numbers(
            "section 2.4.1",
            "distance at 70 below that at 10 r/min by",
            25.0,
            100.0 * (1.0 - MEAN_M[70] / MEAN_M[10]),
            0.5,
            "{:.1f} %",
        ),
        Claim(
            "table 2",
            "response, standing and moving",
            "0.374 to 0.391 s",
            f"r.m.s. {response:.4f} s",
            ResultOrigin.FITTED,
            response < 0.01,
            "dead time and time constant of the machine file come from this table",
            "0.01 s: twice the s.d. of its own rows",
        ),
        compare_numbers(
            "section 2.4.2", "mean response", 0.383, MEAN_RESPONSE_S, 0.0005, "{:.3f} s"
        ),
        Claim(
            "section 2.4.2",
            "shaft speed and moving make no difference",
            "no difference",
            f"moving less standing {1000.0 * apart:+.1f} ms (90 %: "
            f"{1000.0 * (apart - sure):.1f} to "
            f"{1000.0 * (apart + sure):.1f})",
            ResultOrigin.RECOMPUTED,
            # A difference below 5 ms cannot be seen in rows with that standard deviation.
            abs(apart) <= sure or abs(apart) < 0.005,
            "",
            f"{1000.0 * sure:.1f} ms: half of the 90 % interval of ten pairs; or 5 ms, the "
            "s.d. of a row",
        ),
        Claim(
            "table 3",
            "drop time, 10 shaft speeds ten times",
            "0.659 to 1.865 s",
            f"r.m.s. {drop:.3f} s of the means, 10 to 70 r/min",
            ResultOrigin.FITTED,
            drop < 0.05,
            "the machine file's line is eq 6 less the response, and eq 6 was fitted to these",
            "0.05 s: the standard error of a mean of ten (0.04 s usually, 0.11 s at 70 r/min)",
        ),
        compare_numbers(
            "section 2.4.3",
            "drop time at 70 below that at 10 r/min by",
            30.0,
            100.0 * (1.0 - MEAN_DROP_S[70] / MEAN_DROP_S[10]),
            1.05,
            "{:.1f} %",
            why="printed without decimals, cut off",
        ),
    ]


def list_table_4_claims(machine: Machine) -> list[Claim]:
    """Returns the claims of table 4."""
    first = {n: find_start_lag_s(machine, n) for n in LAG_M}
    errors = {n: 100.0 * (1.0 - detected / field) for n, (field, detected) in TOTAL_LAG_S.items()}
    # The same error at the written speed shows how much the conversion contributes.
    restated = {
        n: 100.0 * (1.0 - detected * TEST_SPEED_MPS / MEAN_M[n])
        for n, (_, detected) in TOTAL_LAG_S.items()
    }
    summed = calc_rms(MEAN_DROP_S[n] + MEAN_RESPONSE_S - TOTAL_LAG_S[n][1] for n in LAG_M)
    # The turning point is the speed with the smallest mean.
    turns = min(MEAN_DROP_S, key=lambda n: MEAN_DROP_S[n]), min(MEAN_M, key=lambda n: MEAN_M[n])
    # A detector that misses granules would be late; a negative difference contradicts this.
    early = [detected - field for field, detected in TOTAL_LAG_S.values()]
    return [
        Claim(
            "table 4",
            "detected: response and drop time",
            "1.620 to 2.176 s",
            f"response and mean of table 3: r.m.s. {summed:.4f} s; machine model, 10 to 70 r/min: "
            f"{calc_rms(TOTAL_LAG_S[n][1] - first[n] for n in LINE_SPEEDS_RPM):.3f} s",
            ResultOrigin.RECOMPUTED,
            summed < 0.002,
            "",
            "0.002 s: three figures rounded to 0.001 s",
        ),
        Claim(
            "table 4",
            "actual: table 1's distances at the written speed",
            "1.867 to 2.496 s",
            f"{min(MEAN_M.values()) / TEST_SPEED_MPS:.3f} to "
            f"{max(MEAN_M.values()) / TEST_SPEED_MPS:.3f} s",
            ResultOrigin.RECOMPUTED,
            calc_rms(MEAN_M[n] / TEST_SPEED_MPS - TOTAL_LAG_S[n][0] for n in LAG_M) < 0.01,
            "published with 4.5 km/h, not 4.25",
            "0.01 s: distances rounded to 0.01 m",
        ),
        Claim(
            "table 4",
            "detector short by",
            "11.7 to 15.9 %",
            f"{min(errors.values()):.1f} to "
            f"{max(errors.values()):.1f} % "
            f"of the printed times; {min(restated.values()):.1f} to "
            f"{max(restated.values()):.1f} % of table 1 at "
            f"4.25 km/h",
            ResultOrigin.RECOMPUTED,
            abs(max(errors.values()) - 15.9) < 0.06,
            "",
            f"0.06 %: {ROUNDING_TEXT}, of rounded times",
        ),
        Claim(
            "abstract, conclusion 3",
            "accuracy of detection",
            "84.1 %",
            f"{100.0 - max(errors.values()):.1f} % as "
            f"printed, "
            f"{100.0 - max(restated.values()):.1f} % at the written speed",
            ResultOrigin.RECOMPUTED,
            abs(max(restated.values()) - 15.9) < 0.06,
            "printed figures give it; the written speed does not",
            f"0.06 %: {ROUNDING_TEXT}, of rounded times",
        ),
        Claim(
            "section 2.4.3",
            "why the detector differs: it misses the first granules",
            "an explanation",
            f"detected less field {np.mean(early):+.2f} s",
            ResultOrigin.RECOMPUTED,
            float(np.mean(early)) > 0.0,
            "the sign is wrong: a detector that misses the first granules is late, and this "
            "one is early in "
            f"{sum(value < 0.0 for value in early)} of {len(early)} rows",
            "the sign: late is above 0",
        ),
        Claim(
            "section 2.4.3, figure 9",
            "lag turns at 70 r/min in rig and field",
            "70 r/min",
            f"{turns[0]} r/min (table 3), {turns[1]} r/min (table 1)",
            ResultOrigin.RECOMPUTED,
            turns == (70, 70),
            "on the rig two of ten readings (0.66 s) make it; the field confirms it",
            "none: the shaft speed of the least mean",
        ),
    ]


def list_correction_claims() -> list[Claim]:
    """Returns the claims of the correction."""
    # Expected miss: the field's distance minus the distance that the correction used.
    left = {n: MEAN_M[n] - TEST_SPEED_MPS * find_paper_lag_s(n) for n in LINE_SPEEDS_RPM}
    after = {n: float(np.mean(values)) for n, values in CORRECTED_M.items()}
    missed, remains = float(np.mean(list(after.values()))), float(np.mean(list(left.values())))
    spread, explained = (float(np.std(list(values.values()), ddof=1)) for values in (after, left))
    gains = {n: 100.0 * (1.0 - late / before) for n, (before, late) in CORRECTION_GAIN_M.items()}
    line = calc_rms(find_paper_lag_s(n) - TOTAL_LAG_S[n][1] for n in LINE_SPEEDS_RPM)
    # The needed error of the speed, % on average, tests the paper's explanation.
    faster = 100.0 * float(
        np.mean([after[n] / (TEST_SPEED_MPS * find_paper_lag_s(n)) for n in LINE_SPEEDS_RPM])
    )
    late = sum(value > 0.0 for values in CORRECTED_M.values() for value in values)
    return [
        Claim(
            "table 5",
            "miss after the correction",
            f"{missed:.3f} m in the mean",
            f"{remains:.3f} m ({min(left.values()):.2f} to {max(left.values()):.2f})",
            ResultOrigin.RECOMPUTED,
            abs(remains - missed) < 0.1,
            "table 1's distances less eq 6 at the written speed: the correction took off "
            "the rig's lag",
            "0.1 m: the standard error of 21 misses, 0.09 m",
        ),
        Claim(
            "table 5",
            "spread between shaft speeds",
            f"s.d. {spread:.2f} m",
            f"s.d. {explained:.2f} m",
            ResultOrigin.RECOMPUTED,
            abs(spread - explained) < 0.1,
            "no lag of shaft speed alone gives it; see the readings of table 5",
            "0.1 m: what an s.d. of seven means leaves open",
        ),
        Claim(
            "table 6",
            "before the correction",
            "2.33 to 3.12 m",
            f"{min(MEAN_M[n] for n in LINE_SPEEDS_RPM):.2f} to "
            f"{max(MEAN_M[n] for n in LINE_SPEEDS_RPM):.2f} m",
            ResultOrigin.RECOMPUTED,
            # 0.0051 allows half of the last digit and rounding of floats.
            all(abs(MEAN_M[n] - CORRECTION_GAIN_M[n][0]) < 0.0051 for n in LINE_SPEEDS_RPM),
            "the means of table 1",
            f"0.005 m: {ROUNDING_TEXT}",
        ),
        compare_numbers(
            "abstract, table 6",
            "least gain of the correction",
            61.8,
            min(gains.values()),
            0.15,
            "{:.1f} %",
            remark="1 - after / before; the share of a distance that the correction was given, "
            "1.9 of 2.6 m",
            why="distances before rounded to 0.01 m",
        ),
        Claim(
            "table 6",
            "gain by shaft speed",
            "61.8 to 91.6 %",
            f"{min(gains.values()):.1f} to {max(gains.values()):.1f} %",
            ResultOrigin.RECOMPUTED,
            abs(max(gains.values()) - 91.6) < 0.1 and abs(min(gains.values()) - 61.8) < 0.15,
            "",
            "0.15 %: distances before rounded to 0.01 m",
        ),
        Claim(
            "section 2.4.3",
            "what is left comes of the model's accuracy and of uneven speed",
            "an explanation",
            f"eq 6 misses the detected lags by {1000.0 * line:.0f} ms r.m.s., "
            f"{TEST_SPEED_MPS * line:.2f} m; an uneven speed "
            f"would have "
            f"to be {faster:.0f} % high",
            ResultOrigin.RECOMPUTED,
            TEST_SPEED_MPS * line > 0.5 * missed,
            f"too small by {missed / (TEST_SPEED_MPS * line):.0f}, "
            "and uneven speed has both signs: "
            f"{late} of 21 drives "
            f"landed late",
            f"{0.5 * missed:.2f} m: half of what is left",
        ),
    ]


def list_uncomputable_claims() -> list[Claim]:
    """Returns claims about the set-up, which cannot be calculated from other numbers."""
    return [
        # Explanations and drawings are listed, so that no statement of the paper is missing.
        Claim(
            "section 2.4.3",
            "why lag rises above 70 r/min: granules strike the tube more often",
            "an explanation",
            remark="the sign fits; rise and shaft speed are all that is measured, a size "
            "cannot be computed",
        ),
        Claim("section 2.2", "field and cells", "30 m x 30 m, 10 m x 10 m"),
        Claim("section 2.2", "ground speed of every test", "4.25 km/h", remark="see eq 1"),
        Claim(
            "section 2.4.2",
            "the shaft turns at",
            "2 r/min and more",
            remark="the detector's threshold, here too",
        ),
        Claim("figure 1", "finding the response time", "a diagram; no figures"),
        Claim("figure 2", "parts of the detector", "a diagram; no figures"),
        Claim("figure 3", "flow of the correction", "a diagram; no figures"),
        Claim(
            "figure 4",
            "tractor, cells and edge",
            "a sketch; no figures",
            remark="its source is eq 4 and 5",
        ),
        Claim("figures 5 to 8", "machine and tests", "photographs"),
        Claim(
            "figure 9",
            "by its caption drop time over shaft speed, by the text the two lags of table 4",
            "a drawing",
            remark="drawn below from table 4, as section 2.4.3 says; the drop times, table 3, "
            "in a picture of their "
            "own",
        ),
        Claim(
            "figure 10",
            "lag over shaft speed and eq 6",
            "table 4 and eq 6, drawn",
            remark="drawn below",
        ),
    ]


def list_lag_claims(machine: Machine) -> list[Claim]:
    """Returns all claims of the paper, in the order of its subjects."""
    return [
        *list_equation_claims(),
        *list_table_claims(machine),
        *list_table_4_claims(machine),
        *list_correction_claims(),
        *list_uncomputable_claims(),
    ]
