"""Which claims does the decision paper make, and does each hold here?"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import (
    calc_requirement_kg_ha,
    calc_yield_without_t_ha,
    make_rate_table,
    prepare_rule,
)
from topdress.control.agronomy.sampling_frequency import (
    FREQUENCIES_HZ,
    ReadingUniformity,
    choose_frequency,
)

from .page import ROUNDING_TEXT, Claim, ResultOrigin, Table, compare_numbers
from .published import (
    APPLIED_AMOUNTS,
    EXTRA_N_KG_HA,
    PLOT_NAMES,
    PLOT_NDVI,
    SAMPLING_PERCENT,
    TREATMENT_YIELDS,
    UNIFORM_KG_HA,
)


def calc_weighed_rate(product_kg: float, area_m2: float) -> float:
    """Returns the rate of a product weighed over an area, kg/ha. ValueError unless the area is
    above 0."""
    if not area_m2 > 0.0:
        raise ValueError(f"area {area_m2:g} m2: allowed is above 0")
    return product_kg * 10_000.0 / area_m2


def calc_extra_nitrogen(
    rates_kg_ha: Sequence[float], uniform_kg_ha: float, product_n_fraction: float = 0.45
) -> float:
    """Returns the additional nitrogen of variable over uniform dressing, kg N/ha, as the mean of
    plots of equal size.

    With the applied rates of table 2 the result is 28.75, the paper's "about 28 kg/ha more
    nitrogen"; with the target rates it is 17.75. ValueError without plots.
    """
    if not rates_kg_ha:
        raise ValueError("no plots: at least one rate is needed")
    return (sum(rates_kg_ha) / len(rates_kg_ha) - uniform_kg_ha) * product_n_fraction


# CV of the NDVI on 28 March, % (section 3.1 and conclusion 2).
CV_AFTER_PERCENT = {"CK": 11.32, "CP": 10.21, "variable": 8.68}
# Area of a yield sample, m2 (section 3).
HARVESTED_M2 = 5.0
# Nitrogen share of urea, and nitrogen in the grain, kg/t (eq 2).
UREA_N, GRAIN_N_KG_T = 0.45, 23.9
# Base dressing by section 1.1; diammonium phosphate as traded, 18-46-0.
BASE_N_KG_HA = 225.0 * UREA_N + 150.0 * 0.18
# Yield without the N-rich strip, t/ha.
WITHOUT_STRIP_T_HA = 6.73
# Days of growth.
GROWTH_DAYS = 82.0
# Yield curve of eq 3: t/ha, and exponent times days.
PAPER_CURVE = (0.359, 324.4)


def make_yield_table() -> Table:
    # 10,000 m2 are a hectare in all conversions of this module.
    """Returns table 3: yields from the sample weights, and by eq 3 for the plots with printed
    NDVI."""
    rows = []
    for plot, (sample_kg, cv, kg_ha) in TREATMENT_YIELDS.items():
        ndvi = PLOT_NDVI.get(plot)
        potential = (
            # Only plots with a printed NDVI have a potential by eq 3.
            None
            if ndvi is None
            else 1000.0 * calc_yield_without_t_ha(ndvi / GROWTH_DAYS, *PAPER_CURVE)
        )
        rows.append(
            (
                plot,
                sample_kg,
                cv,
                kg_ha,
                sample_kg / HARVESTED_M2 * 10_000.0,
                # The weight is computed backwards too, because printed sample weights are rounded
                # more coarsely.
                kg_ha / 10_000.0 * HARVESTED_M2,
                ndvi,
                potential,
            )
        )
    return Table(
        "Table 3 and eq 3: yields. Obtained: kg/ha of the printed sample weight on 5 m2, "
        "the weight behind "
        "the "
        "printed kg/ha, and eq 3's potential without topdressing",
        (
            "plot",
            "sample kg published",
            "CV %",
            "kg/ha published",
            "kg/ha of the sample",
            "kg of the kg/ha",
            "NDVI of 7 March published",
            "eq 3, kg/ha",
        ),
        tuple(rows),
        (0, 2, 2, 1, 1, 4, 3, 0),
    )


class GrainNitrogen(NamedTuple):
    """Holds the additional nitrogen, relative to CK, that a plot received and has in its grain,
    kg N/ha."""

    plot: str
    given_kg_ha: float
    grain_kg_ha: float

    @property
    def share(self) -> float:
        return self.grain_kg_ha / self.given_kg_ha


def list_grain_nitrogen() -> list[GrainNitrogen]:
    """Returns the nitrogen of FA, FB and FC: base dressing of a third, two thirds and all
    (section 1.1), and table 2's applied urea, with table 3's yields."""
    found = []
    # The plots differ in their base dressing, so their total nitrogen does too.
    for thirds, plot in enumerate(("FA", "FB", "FC"), start=1):
        topdressed = calc_weighed_rate(APPLIED_AMOUNTS[plot][2], APPLIED_AMOUNTS[plot][0]) * UREA_N
        found.append(
            GrainNitrogen(
                plot,
                BASE_N_KG_HA * thirds / 3.0 + topdressed,
                # CK received no nitrogen, hence its yield is the reference.
                (TREATMENT_YIELDS[plot][2] - TREATMENT_YIELDS["CK"][2]) * GRAIN_N_KG_T / 1000.0,
            )
        )
    return found


def make_grain_table() -> Table:
    return Table(
        "Eq 2 against table 3: nitrogen given and held by the grain, both more than CK; eq "
        "2 takes 60 %",
        ("plot", "given, kg N/ha", "in the grain, kg N/ha", "share, %"),
        tuple(
            (one.plot, one.given_kg_ha, one.grain_kg_ha, 100.0 * one.share)
            for one in list_grain_nitrogen()
        ),
        (0, 1, 2, 1),
    )


def list_sampling_claims(simulated: Table) -> list[Claim]:
    """Returns the claims of section 1.2 and figure 3 from table 1. `simulated`: table 1 on a
    simulated canopy."""
    # The first row is 2 Hz, which is an input of the simulation.
    ours = [float(row[5] or 0.0) for row in simulated.rows[1:]]
    cv = {hz: np.array([pair[0] for pair in SAMPLING_PERCENT[hz]]) for hz in FREQUENCIES_HZ}
    cuc = np.concatenate([[pair[1] for pair in SAMPLING_PERCENT[hz]] for hz in FREQUENCIES_HZ])
    # Two standard deviations of a draw allow chance, but no systematic difference.
    within = 2.0 * max(float(row[6] or 0.0) for row in simulated.rows)
    table = np.array([cv[hz] for hz in FREQUENCIES_HZ])
    # The spread of a plot is its largest minus its smallest CV over all frequencies.
    spread = table.max(axis=0) - table.min(axis=0)
    most, least = int(spread.argmax()), int(spread.argmin())
    # The function of the program takes the paper's figures in place of readings.
    plots = [
        {hz: ReadingUniformity(0, 0.0, *SAMPLING_PERCENT[hz][k]) for hz in FREQUENCIES_HZ}
        for k in range(len(PLOT_NAMES))
    ]
    chosen = choose_frequency(plots)
    # The quotient of mean deviation and standard deviation tells the shape of the distribution.
    deviation = float(np.mean((100.0 - cuc) / table.ravel()))
    groups = {
        name: float(
            np.mean([cv[2.0][k] for k, plot in enumerate(PLOT_NAMES) if plot.startswith(name)])
        )
        for name in ("CK", "FA", "FB", "FC")
    }
    largest = max(groups, key=lambda name: groups[name])
    low, high = float(cuc.min()), float(cuc.max())
    return [
        Claim(
            "eq 1",
            "C_uc of readings spread normally: mean deviation over s.d. is 0.798",
            f"{deviation:.3f} (table 1)",
            # No verdict is given, because the paper states the distribution nowhere.
            "0.798",
            ResultOrigin.SIMULATED,
            None,
            "eq 1 on a normal distribution; published is the mean of (100 - C_uc) / CV over "
            "the 60 cells of table 1: "
            "readings more peaked than normal",
        ),
        Claim(
            "table 1",
            "CV at 2, 1, 0.5, 0.25, 0.125 Hz, mean of 12 plots",
            ", ".join(f"{cv[hz].mean():.2f}" for hz in cv) + " %",
            "input, " + ", ".join(f"{value:.2f}" for value in ours) + " %",
            ResultOrigin.SIMULATED,
            all(
                abs(value - cv[hz].mean()) < within
                for value, hz in zip(ours, FREQUENCIES_HZ[1:], strict=True)
            ),
            "the readings are not printed; leaving readings out cannot make the CV fall as "
            "at 0.125 Hz",
            f"{within:.1f} percentage points: twice the s.d. of a draw of twelve plots at "
            "0.125 Hz, by the canopy "
            "that fits",
        ),
        Claim(
            "figure 2",
            "largest mean NDVI (FC), its CV is the largest",
            "0.546; 11.46 %",
            f"largest CV of one plot {cv[2.0].max():.2f} %; of a treatment's mean "
            f"{groups[largest]:.2f} % in "
            f"{largest}, "
            # The paper's statement is about treatments, so plots are averaged first.
            f"FC {groups['FC']:.2f} %",
            ResultOrigin.RECOMPUTED,
            largest == "FC",
            "true of plot FC-1, not of the treatment",
            "none: the largest of four",
        ),
        Claim(
            "figure 2",
            "smallest mean NDVI (CK), CV at least",
            "0.467; 8.22 %",
            f"{min(cv[2.0][:3]):.2f} %",
            ResultOrigin.RECOMPUTED,
            # 0.005 is half of the last printed digit.
            abs(min(cv[2.0][:3]) - 8.22) < 0.005,
            "the CV; the NDVI is copied",
            f"0.005 %: {ROUNDING_TEXT}",
        ),
        Claim(
            "section 1.2",
            "C_uc stays within",
            "90 to 96 %",
            f"{low:.2f} to {high:.2f} %",
            ResultOrigin.RECOMPUTED,
            # 96.05 allows for a printed 96 that was rounded.
            low >= 90.0 and high <= 96.05,
            "",
            "0.05 %: printed as whole percents",
        ),
        compare_numbers(
            "section 1.2",
            "largest CV (0.25 Hz, FB-0)",
            13.85,
            float(table.max()),
            0.005,
            "{:.2f} %",
        ),
        compare_numbers(
            "section 1.2",
            "smallest CV (0.125 Hz, FB-2)",
            4.81,
            float(table.min()),
            0.005,
            "{:.2f} %",
        ),
        Claim(
            "section 1.2",
            "largest spread of CV over frequencies",
            "8.35 % (FB-2)",
            f"{spread[most]:.2f} % ({PLOT_NAMES[most]})",
            ResultOrigin.RECOMPUTED,
            PLOT_NAMES[most] == "FB-2",
            "",
            "none: the plot that is named",
        ),
        Claim(
            "section 1.2",
            "smallest spread of CV over frequencies",
            "1.91 % (FC-2)",
            f"{spread[least]:.2f} % ({PLOT_NAMES[least]})",
            ResultOrigin.RECOMPUTED,
            PLOT_NAMES[least] == "FC-2",
            ""
            if PLOT_NAMES[least] == "FC-2"
            else f"FC-2: {spread[PLOT_NAMES.index('FC-2')]:.2f} %",
            "none: the plot that is named",
        ),
        Claim(
            "figure 3",
            "1 Hz differs least from 2 Hz",
            "1 Hz",
            f"{chosen.frequency_hz:g} Hz: change of CV plus C_uc "
            + ", ".join(f"{chosen.departure[hz]:.2f} at {hz:g} Hz" for hz in FREQUENCIES_HZ[1:]),
            ResultOrigin.RECOMPUTED,
            chosen.frequency_hz == 1.0,
            "",
            "none: the frequency that is named",
        ),
    ]


def list_ndvi_claims() -> list[Claim]:
    """Returns the claims of section 3.1: the effect of topdressing on the NDVI."""
    # Raw data are at 2 Hz; the first three plots are CK.
    raw = np.array([pair[0] for pair in SAMPLING_PERCENT[2.0]])
    ck, variable = float(raw[:3].mean()), float(raw[3:].mean())
    return [
        Claim("figure 7", "mean NDVI on 28 March: CK, CP", "0.671, 0.803"),
        Claim(
            "figure 7",
            "CV of CK on 28 March, grown by",
            "11.32 %, by 3 %",
            f"by {CV_AFTER_PERCENT['CK'] - ck:.2f} (mean of CK at 2 Hz {ck:.2f} %); by "
            f"{CV_AFTER_PERCENT['CK'] - 8.22:.2f} from the "
            "smallest plot",
            ResultOrigin.RECOMPUTED,
            # The paper prints a whole percent, so half a percent is allowed.
            abs(CV_AFTER_PERCENT["CK"] - ck - 3.0) < 0.5,
            "3 is had from CK-2 alone" if abs(CV_AFTER_PERCENT["CK"] - ck - 3.0) >= 0.25 else "",
            f"0.5 %: {ROUNDING_TEXT}",
        ),
        Claim(
            "figure 7",
            "CV of CP on 28 March, fallen by",
            "10.21 %, by 0.33 %",
            remark="CP is not in table 1",
        ),
        Claim(
            "abstract, section 3.1",
            "CV of the variable plots fallen by, at most",
            "3.57 %",
            remark="the CV of single plots on 28 March are not printed",
        ),
        compare_numbers(
            "abstract, section 3.1",
            "CV of the variable plots fallen by, mean",
            1.46,
            variable - CV_AFTER_PERCENT["variable"],
            0.011,
            "{:.2f} %",
            remark=f"table 1 at 2 Hz ({variable:.2f} %) less the conclusion's 8.68 %",
            why="two means rounded to 0.01 %",
        ),
        Claim(
            "conclusion 2",
            "CV after: variable below CP",
            "8.68 below 10.21 %",
            remark="one field of each: no replicate of CP, no test possible",
        ),
    ]


def list_rate_claims(crop: Crop, forward: Table, simulated: Table) -> list[Claim]:
    """Returns the claims of section 2.1 and table 2. `forward`: FC's target from its NDVI;
    `simulated`: table 2 on the machine."""
    # Without grades the rule is the smooth curve of eq 2 to 5.
    smooth = prepare_rule(crop.model_copy(update={"grades": False}))
    # 0.75 is the upper end of the NDVI range, where the need is lowest.
    at_edge = calc_requirement_kg_ha(
        WITHOUT_STRIP_T_HA, calc_yield_without_t_ha(0.75 / GROWTH_DAYS, *PAPER_CURVE)
    )
    rates = {plot: calc_weighed_rate(row[1], row[0]) for plot, row in APPLIED_AMOUNTS.items()}
    errors = {plot: 100.0 * (row[2] / row[1] - 1.0) for plot, row in APPLIED_AMOUNTS.items()}
    targets, applied = ([row[column] for row in APPLIED_AMOUNTS.values()] for column in (1, 2))
    # 600 m2 is the area of each plot (table 2).
    extra = [
        calc_extra_nitrogen([calc_weighed_rate(kg, 600.0) for kg in amounts], UNIFORM_KG_HA)
        for amounts in (targets, applied)
    ]
    # Sowing and sensing date give the number of days that eq 4 could count at most.
    sown, sensed = dt.date(2013, 11, 1), dt.date(2014, 3, 7)
    index = WITHOUT_STRIP_T_HA / calc_yield_without_t_ha(
        PLOT_NDVI["CK"] / GROWTH_DAYS, *PAPER_CURVE
    )
    grades = make_rate_table(crop)
    # The width follows from the grades themselves, not from the paper's text.
    width = grades[0].ndvi_to - grades[0].ndvi_above
    reached = float(np.mean([TREATMENT_YIELDS[plot][2] for plot in APPLIED_AMOUNTS])) / 1000.0
    ck, fc = (
        1000.0 * calc_yield_without_t_ha(PLOT_NDVI[plot] / GROWTH_DAYS, *PAPER_CURVE)
        for plot in ("CK", "FC")
    )
    # The first two columns are the plot's name and the published target.
    forward_kg = [float(cell or 0.0) for cell in forward.rows[0][2:]]
    sim = [abs(float(row[6] or 0.0)) for row in simulated.rows]
    return [
        Claim(
            "eq 2",
            "urea for a yield: R = 23.9 (Y_PN - Y_P0) / (0.45 x 0.6)",
            "no value printed",
            f"{at_edge:.1f} kg/ha at NDVI 0.75",
            ResultOrigin.RECOMPUTED,
            None,
            "below zero as printed; here never below 0",
        ),
        Claim("eq 2", "N in grain, N in urea, efficiency", "23.9 kg/t, 0.45, 0.6 (0.5 to 0.7)"),
        Claim(
            "eq 2, table 3",
            "share of the nitrogen that the grain holds, FA, FB, FC",
            "0.6",
            ", ".join(f"{one.share:.3f}" for one in list_grain_nitrogen()),
            ResultOrigin.RECOMPUTED,
            all(0.5 <= one.share <= 0.7 for one in list_grain_nitrogen()),
            "more than CK holds, over base and topdressing; the yield hardly answered to nitrogen",
            "0.1: 0.5 to 0.7 is printed",
        ),
        Claim(
            "eq 3",
            "potential of CK without topdressing (NDVI 0.467), against its yield",
            f"{TREATMENT_YIELDS['CK'][2]:.1f} kg/ha",
            f"{ck:.0f} kg/ha",
            ResultOrigin.RECOMPUTED,
            abs(ck / TREATMENT_YIELDS["CK"][2] - 1.0) < 0.1,
            f"eq 3 leaves {100.0 * ck / TREATMENT_YIELDS['CK'][2]:.0f} % "
            "of what the control plot gave",
            "10 %: less than the plot's own CV of 15.2 %",
        ),
        Claim(
            "eq 3",
            "potential of FC without topdressing (NDVI 0.546), below its yield with it",
            f"{TREATMENT_YIELDS['FC'][2]:.1f} kg/ha",
            f"{fc:.0f} kg/ha",
            ResultOrigin.RECOMPUTED,
            fc < TREATMENT_YIELDS["FC"][2],
            "",
            "none: below",
        ),
        Claim(
            "eq 4",
            "days above 0 degC from 1 November to 7 March",
            "82",
            remark=f"of {(sensed - sown).days} days; "
            f"no weather "
            "is printed. The constants of eq 3 were published for days above 4.4 degC",
        ),
        Claim(
            "eq 5",
            "yield with topdressing, no N-rich strip",
            f"{WITHOUT_STRIP_T_HA:.2f} t/ha",
            f"{reached:.2f} t/ha, mean of FA, FB, FC",
            ResultOrigin.RECOMPUTED,
            abs(reached / WITHOUT_STRIP_T_HA - 1.0) < 0.05,
            f"a response index of {index:.2f} over eq 3 at CK's NDVI; 2.0 is the usual cap",
            "5 %: the standard error of three plots with a CV of some 8 %",
        ),
        Claim(
            "section 2.1",
            "grades: number, width",
            "11, 0.5",
            f"{len(grades) + 1}, {width:.2f}",
            ResultOrigin.RECOMPUTED,
            # The program's grades have the width of the paper's example, 0.05.
            abs(width - 0.5) < 0.01,
            "a width of 0.5 leaves one grade between 0.25 and 0.75; 0.05 gives the eleven",
            "0.01: widths are printed in steps of 0.05",
        ),
        Claim(
            "figure 4",
            "rate over NDVI",
            "a curve without figures",
            f"{smooth.decide_rate(0.30).rate_kg_ha:.0f} kg/ha at 0.30, "
            f"{smooth.decide_rate(0.50).rate_kg_ha:.0f} at 0.50, "
            f"{smooth.decide_rate(0.70).rate_kg_ha:.0f} at 0.70",
            ResultOrigin.RECOMPUTED,
            None,
            "drawn below from eq 2 to 5; the figure itself is a picture and was not read off",
        ),
        # Each interpretation is compared by itself, because the text allows several.
        *(
            compare_numbers(
                "table 2",
                f"target of FC from its NDVI of {PLOT_NDVI['FC']}: {way}",
                APPLIED_AMOUNTS["FC"][1],
                kg,
                0.1,
                "{:.1f} kg",
                remark="the text's rule, over the canopy" if "grades" in way else "",
                why="last digits of target (0.05 kg) and NDVI (0.03 kg)",
            )
            for way, kg in zip(forward.columns[2:], forward_kg, strict=True)
        ),
        Claim(
            "table 2",
            "targets of FA and FB",
            "22.0, 20.2 kg",
            remark="their NDVI is not printed: no test",
        ),
        *(
            compare_numbers(
                "table 2",
                f"control error of {plot}",
                APPLIED_AMOUNTS[plot][3],
                errors[plot],
                0.006,
                "{:.2f} %",
            )
            for plot in APPLIED_AMOUNTS
        ),
        Claim(
            "table 2",
            "applied against target",
            "+5.82 to +8.42 %",
            f"{max(sim):.2f} % at most",
            ResultOrigin.SIMULATED,
            # The simulated machine has no unknown error, so it cannot confirm the published errors.
            None,
            "the nominal machine on FC's plot, its scale not correcting; an outflow 7 % "
            "high gives the published "
            "errors (below)",
        ),
        Claim(
            "abstract, section 3.2",
            "control accuracy above",
            "90 %",
            f"{100.0 - max(errors.values()):.2f} %",
            ResultOrigin.RECOMPUTED,
            max(errors.values()) < 10.0,
            "on plots' totals; all three errors have the same sign",
            "none: above",
        ),
        Claim(
            "abstract, section 3.2",
            "nitrogen above the uniform 300 kg/ha of urea",
            f"about {EXTRA_N_KG_HA:g} kg/ha",
            f"{extra[1]:.2f} by the applied, {extra[0]:.2f} by the target amounts",
            ResultOrigin.RECOMPUTED,
            # Both results are shown: the text does not state from which amounts it was computed.
            abs(extra[1] - EXTRA_N_KG_HA) < 1.0,
            "counted from the applied amounts: 11 kg/ha of it is the control error",
            '1 kg/ha: "about"',
        ),
        Claim(
            "section 3.2",
            "targets fall as the base fertilizer grows",
            "FA > FB > FC",
            ", ".join(f"{rate:.1f}" for rate in rates.values()) + " kg/ha",
            ResultOrigin.RECOMPUTED,
            rates["FA"] > rates["FB"] > rates["FC"],
            "",
            "none: the order",
        ),
        compare_numbers(
            "section 3",
            "area: five treatments of 600 m2 in the test field of 0.33 ha",
            0.33,
            0.30,
            0.05,
            "{:.2f} ha",
            remark="the sum",
            why="paths and headlands are not printed",
        ),
    ]


def list_yield_claims() -> list[Claim]:
    """Returns the claims about table 3."""
    kg_ha = {plot: row[2] for plot, row in TREATMENT_YIELDS.items()}
    cv = {plot: row[1] for plot, row in TREATMENT_YIELDS.items()}
    return [
        # The yield should follow from the sample weight; a difference shows a rounded weight.
        *(
            compare_numbers(
                "table 3",
                f"yield of {plot} from its sample of 5 m2",
                kg_ha[plot],
                sample / HARVESTED_M2 * 10_000.0,
                0.005 / HARVESTED_M2 * 10_000.0,
                "{:.1f} kg/ha",
                remark=f"the printed yield is {kg_ha[plot] / 2000.0:.4f} kg on 5 m2",
                why="half of the last digit of the sample, 0.005 kg",
            )
            for plot, (sample, _, _) in TREATMENT_YIELDS.items()
        ),
        Claim(
            "section 3.3",
            "CV of the variable plots below 10 %, below CK and CP",
            "below 10 %",
            ", ".join(f"{plot} {value:.2f}" for plot, value in cv.items()) + " %",
            ResultOrigin.RECOMPUTED,
            max(cv[p] for p in ("FA", "FB", "FC")) < min(10.0, cv["CK"], cv["CP"]),
            "",
            "none: below",
        ),
        Claim(
            "section 3.3",
            "yield of the variable plots slightly below CP",
            "7000.2 against 7125.1 kg/ha",
            ", ".join(
                f"{plot} {100.0 * (kg_ha[plot] / kg_ha['CP'] - 1.0):+.1f} %"
                for plot in ("FA", "FB", "FC")
            ),
            ResultOrigin.RECOMPUTED,
            # 5 % is the tolerance for the paper's word "slightly".
            all(kg_ha[p] > 0.95 * kg_ha["CP"] for p in ("FA", "FB", "FC")),
            "true of FC; FA and FB had less base fertilizer",
            '5 %: "slightly"',
        ),
        Claim(
            "section 3.3",
            "yield grows with the base fertilizer",
            "CK < FA < FB < FC",
            ", ".join(f"{kg_ha[plot]:.0f}" for plot in ("CK", "FA", "FB", "FC")),
            ResultOrigin.RECOMPUTED,
            kg_ha["CK"] < kg_ha["FA"] < kg_ha["FB"] < kg_ha["FC"],
            "",
            "none: the order",
        ),
    ]


def list_uncomputable_claims() -> list[Claim]:
    """Returns claims about the trial and the machine, which are inputs here."""
    # Inputs are listed so that the table has every statement of the paper.
    return [
        Claim(
            "introduction",
            "nitrogen used in China, in developed countries",
            "30 to 50 %, 50 to 80 %",
            remark="cited",
        ),
        Claim(
            "section 1.1", "place; row spacing", "34.22 to 34.37 N, 119.80 to 119.97 E; 17 to 20 cm"
        ),
        Claim("section 1.1", "base urea and phosphate, topdressed urea", "225, 150 and 300 kg/ha"),
        Claim("figure 1", "plots", "CK, FA, FB, FC three times each, and CP"),
        Claim("section 1.1", "heads: number, before the nose, above the crop", "6, 1.2 m, 0.8 m"),
        Claim("section 1.1", "sampling possible, chosen", "0.7 to 33.3 Hz, 2 Hz"),
        Claim("section 1.2", "ground speed", "about 4.5 km/h"),
        Claim("section 2.1", "rate 0 below and above NDVI", "0.25 and 0.75"),
        Claim("figure 5", "principle of control", "a diagram; no figures"),
        Claim("figure 6", "flow of the main program", "a diagram; no figures"),
        Claim("section 3", "harvested", "5 m2, three times a plot"),
    ]


def list_decision_claims(
    crop: Crop, sampled: Table, forward: Table, simulated: Table
) -> list[Claim]:
    """Returns all claims of the paper, in the order of its subjects."""
    return [
        *list_sampling_claims(sampled),
        *list_rate_claims(crop, forward, simulated),
        *list_ndvi_claims(),
        *list_yield_claims(),
        *list_uncomputable_claims(),
    ]
