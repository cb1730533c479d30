"""Which results of the decision paper do the models reproduce? Sampling (table 1), rate over
NDVI (figure 4), amounts (table 2).
"""

from __future__ import annotations

import numpy as np
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import CropRule, make_rate_table, prepare_rule
from topdress.control.agronomy.sampling_frequency import (
    FREQUENCIES_HZ,
    ReadingUniformity,
    choose_frequency,
    tabulate_frequencies,
)
from topdress.control.field.job import Canopy, Job, Simulated
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.machine.machine import Machine
from topdress.control.machine.model_elements import Array
from topdress.control.papers.decision_paper_claims import (
    calc_extra_nitrogen,
    calc_weighed_rate,
)
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import simulate_run
from topdress.control.simulation.simulated_canopy import CanopyField

from .decision_paper_claims import (
    list_decision_claims,
    list_grain_nitrogen,
    make_grain_table,
    make_yield_table,
)
from .page import Line, Picture, Section, Table, TableCell, make_claim_table
from .published import (
    APPLIED_AMOUNTS,
    EXTRA_N_KG_HA,
    MAIN_SPEED_KMH,
    PLOT_NAMES,
    PLOT_NDVI,
    SAMPLING_PERCENT,
    UNIFORM_KG_HA,
)

# Length and width of a plot, m: 600 m2 in one pass.
PLOT_LENGTH_M, PLOT_WIDTH_M = 250.0, 2.4
# Approximate mean NDVI and CV, %, of the paper's plots.
MEAN_NDVI, CV_PERCENT = 0.51, 9.7
# Correlation length of the simulated canopy, m.
CORRELATION_M = 6.0
# Number of simulated trials.
TRIAL_COUNT = 4
# Number of random draws of the simulated canopy that fits the published changes best: the standard
# error of the mean of 30 is a fifth of the spread of one.
DRAW_COUNT = 30
# Trial canopies: name, length of a plot in one pass, m (600 m2, or a third), and correlation length
# of the readings, m.
TRIAL_CANOPIES = (
    ("plots of 200 m2 and readings that hardly depend on one another", 83.0, 0.3),
    ("plots of 200 m2 and a correlation of 6 m", 83.0, 6.0),
    ("plots of 600 m2 and readings that hardly depend on one another", 250.0, 0.3),
    ("plots of 600 m2 and a correlation of 6 m", 250.0, 6.0),
)


def make_decision_section(machine: Machine, crop: Crop, seed: int = 1) -> Section:
    """Returns the section with all published and obtained values of the paper."""
    # The rule is prepared once, because the crop is the same in all tables.
    rule = prepare_rule(crop)
    sampled, words = simulate_sampling(seed)
    forward, forward_words = compare_forward_targets(crop)
    table_2 = simulate_amounts(machine, crop, rule, seed)
    claims = tuple(list_decision_claims(crop, sampled[0], forward, table_2))
    return Section(
        "Decision system: NDVI to urea rate",
        (*words, *forward_words, describe_grain_nitrogen()),
        (
            make_claim_table("decision paper", claims),
            *sampled,
            forward,
            table_2,
            make_nitrogen_table(),
            make_grain_table(),
            make_grade_table(crop),
            make_yield_table(),
        ),
        (make_rate_picture(crop), make_sampling_picture(sampled[0]), make_grain_picture()),
        claims,
    )


def simulate_sampling(seed: int) -> tuple[tuple[Table, Table], tuple[str, ...]]:
    """Returns table 1 for simulated canopies: for each plot a canopy of the published CV at 2
    Hz, read by each interpretation."""
    # The paper's statistics take the place of readings, so that the program's own choice can be
    # applied.
    papers = [
        {hz: ReadingUniformity(0, 0.0, *SAMPLING_PERCENT[hz][k]) for hz in FREQUENCIES_HZ}
        for k in range(len(PLOT_NAMES))
    ]
    chosen = choose_frequency(papers)
    rows: list[tuple[str | float, ...]] = [
        ("published", *(chosen.departure[hz] for hz in FREQUENCIES_HZ[1:]))
    ]
    apart: dict[str, float] = {}
    for name, length_m, correlation_m in TRIAL_CANOPIES:
        runs = [
            # Seeds 100 apart keep the twelve plots of each trial independent.
            choose_frequency(_simulate_plots(length_m, correlation_m, seed + 100 * run))
            for run in range(TRIAL_COUNT)
        ]
        mean = [float(np.mean([run.departure[hz] for run in runs])) for hz in FREQUENCIES_HZ[1:]]
        rows.append((name, *mean))
        apart[name] = float(
            np.mean(
                [
                    abs(ours - chosen.departure[hz])
                    for ours, hz in zip(mean, FREQUENCIES_HZ[1:], strict=True)
                ]
            )
        )
    # The canopy whose changes are nearest to the published ones is used for table 1.
    fits = min(apart, key=lambda name: apart[name])
    _, length_m, correlation_m = next(canopy for canopy in TRIAL_CANOPIES if canopy[0] == fits)
    draws = [
        _simulate_plots(length_m, correlation_m, seed + 100 * run) for run in range(DRAW_COUNT)
    ]
    table: list[tuple[TableCell, ...]] = []
    for hz in FREQUENCIES_HZ:
        figures: list[float | None] = [
            *_calc_mean_sd([plot[hz].cv_percent for plot in papers]),
            *_calc_mean_sd([plot[hz].cuc_percent for plot in papers]),
            *_calc_mean_sd(
                [float(np.mean([plot[hz].cv_percent for plot in draw])) for draw in draws]
            ),
            *_calc_mean_sd(
                [float(np.mean([plot[hz].cuc_percent for plot in draw])) for draw in draws]
            ),
        ]
        if hz == FREQUENCIES_HZ[0]:
            # These columns are inputs of the simulated canopy.
            figures[4:6] = [None, None]
        table.append((f"{hz:g}", *figures))
    words = (
        "Table 1 needs the NDVI of the field, which is not printed: the canopy is "
        "simulated, each plot with its "
        "published CV at 2 Hz. The frequency that changes CV and C_uc least is "
        f"{chosen.frequency_hz:g} Hz in the paper's figures and 1 Hz in "
        f"{_count_best_draws(draws)} of "
        f"{DRAW_COUNT} draws of ours.",
        "How much they change tells how the canopy was read: the published changes fit "
        f"best with {fits} (apart by "
        f"{apart[fits]:.2f} percentage points in the mean; "
        + ", ".join(f"{value:.2f} with {name}" for name, value in apart.items() if name != fits)
        + "). That the published CV "
        "falls by a quarter at 0.125 Hz no reading gives: leaving readings out does not "
        "make the others alike.",
    )
    return (
        Table(
            "Table 1: CV and uniformity by sampling frequency, mean and s.d. over twelve "
            "plots, %; ours the mean "
            f"of {DRAW_COUNT} draws of twelve plots and the s.d. of one draw, with " + fits,
            (
                "Hz",
                "CV published",
                "s.d.",
                "C_uc published",
                "s.d.",
                "CV obtained",
                "s.d. of a draw",
                "C_uc obtained",
                "s.d. of a draw",
            ),
            tuple(table),
            (0, 2, 2, 2, 2, 2, 2, 2, 2),
        ),
        Table(
            "Change of CV plus change of C_uc against 2 Hz, percentage points, by how the "
            "canopy is read",
            ("", *(f"{hz:g} Hz" for hz in FREQUENCIES_HZ[1:])),
            tuple(rows),
            (0, 2, 2, 2, 2),
        ),
    ), words


def _count_best_draws(draws: list[list[dict[float, ReadingUniformity]]]) -> int:
    """Returns the number of draws in which 1 Hz changes the statistics of the canopy least."""
    return sum(choose_frequency(draw).frequency_hz == 1.0 for draw in draws)


def _simulate_plots(
    length_m: float, correlation_m: float, seed: int
) -> list[dict[float, ReadingUniformity]]:
    return [
        tabulate_frequencies(_simulate_readings(cv_percent, length_m, correlation_m, seed + k))
        # Each plot has a seed of its own.
        for k, (cv_percent, _) in enumerate(SAMPLING_PERCENT[2.0])
    ]


def _simulate_readings(
    cv_percent: float, length_m: float, correlation_m: float, seed: int
) -> Array:
    """Returns simulated NDVI at 2 Hz along a plot, mean of six heads, with the given CV."""
    field = CanopyField(
        Canopy(mean_ndvi=MEAN_NDVI, cv_percent=cv_percent, correlation_m=correlation_m),
        # The strip is 12 m wide, wider than a plot, so that all heads lie inside.
        (0.0, 12.0),
        (0.0, length_m),
        seed,
    )
    # The distance between readings is speed over 2 Hz.
    ways = np.arange(0.0, length_m, MAIN_SPEED_KMH / 3.6 / 2.0)
    # Six heads are spread evenly over the width.
    heads = (np.arange(6) - 2.5) * PLOT_WIDTH_M / 6
    readings = np.mean(
        [field.find_many_ndvi(np.full(len(ways), 6.0 + aside), ways) for aside in heads], axis=0
    )
    return np.asarray(
        MEAN_NDVI
        # The readings are scaled to the published CV, so that only their order in space is
        # simulated.
        + (readings - readings.mean()) * (cv_percent / 100.0 * MEAN_NDVI / readings.std(ddof=1)),
        dtype=np.float64,
    )


def _calc_mean_sd(values: list[float]) -> tuple[float, float]:
    return float(np.mean(values)), float(np.std(values, ddof=1))


def compare_forward_targets(crop: Crop) -> tuple[Table, tuple[str, ...]]:
    """Returns FC's target of table 2 from the mean NDVI printed in figure 2, by four
    interpretations of section 2.1."""
    # FC is the only variable plot whose NDVI is printed.
    ndvi = PLOT_NDVI["FC"]
    cv_percent = float(
        np.mean(
            [
                SAMPLING_PERCENT[2.0][k][0]
                for k, plot in enumerate(PLOT_NAMES)
                if plot.startswith("FC")
            ]
        )
    )
    # Without grades the rate is the smooth curve.
    smooth = crop.model_copy(update={"grades": False})
    area_m2, target_kg, _, _ = APPLIED_AMOUNTS["FC"]
    kg = {
        "smooth rate at the mean": _calc_mean_rate(smooth, ndvi, 0.0),
        "smooth rate over the canopy": _calc_mean_rate(smooth, ndvi, cv_percent),
        "grades over the canopy": _calc_mean_rate(crop, ndvi, cv_percent),
        "one grade, of the mean": _calc_mean_rate(crop, ndvi, 0.0),
    }
    found = {name: rate * area_m2 / 10_000.0 for name, rate in kg.items()}
    words = (
        "Table 2's target can be held against the rule where an NDVI is printed, in FC: "
        f"{ndvi} (figure 2), CV "
        f"{cv_percent:.1f} % (table 1). Published are {target_kg:.1f} kg on {area_m2:.0f} m2; "
        + ", ".join(f"{value:.1f} with {name}" for name, value in found.items())
        + ". The text's rule, a grade for each reading, is the one that does not come near.",
    )
    return Table(
        "Table 2 forward: target of FC, kg, from its printed NDVI, by reading of section 2.1",
        ("plot", "published", *found),
        (("FC", target_kg, *found.values()),),
        (0, 1, *(1,) * len(found)),
    ), words


def _calc_mean_rate(crop: Crop, ndvi: float, cv_percent: float) -> float:
    """Returns the mean rate of a canopy with normally distributed NDVI of this mean and CV,
    kg/ha."""
    rule = prepare_rule(crop)
    # Three standard deviations contain 99.7 % of a normal canopy.
    z = np.linspace(-3.0, 3.0, 121) if cv_percent > 0.0 else np.zeros(1)
    values = [
        rule.decide_rate(float(ndvi * (1.0 + cv_percent / 100.0 * step))).rate_kg_ha for step in z
    ]
    return float(np.average(values, weights=np.exp(-0.5 * z * z)))


def simulate_amounts(machine: Machine, crop: Crop, rule: CropRule, seed: int) -> Table:
    """Returns FC of table 2 on the simulated machine and a canopy of its printed NDVI: with the
    machine file, and with an unknown additional outflow of 7 %."""
    # The second machine releases 7 % more than its machine file states.
    _, target_kg, applied_kg, error_percent = APPLIED_AMOUNTS["FC"]
    nominal, planted = (
        _simulate_plot(machine, crop, rule, PLOT_NDVI["FC"], seed, effect)
        for effect in ((), ("flow.gain=7",))
    )
    row = ("FC", target_kg, applied_kg, error_percent, *nominal, *planted)
    return Table(
        "Table 2: amounts, kg, and control error, %. Simulated on one pass of 600 m2 with "
        "FC's printed NDVI",
        (
            "plot",
            "target published",
            "applied",
            "error %",
            "target simulated",
            "applied, nominal machine",
            "error %",
            "target simulated",
            "applied, outflow +7 %",
            "error %",
        ),
        (row,),
        (0, 1, 1, 2, 1, 1, 2, 1, 1, 2),
    )


def _simulate_plot(
    machine: Machine, crop: Crop, rule: CropRule, ndvi: float, seed: int, effects: tuple[str, ...]
) -> tuple[float, float, float]:
    """Returns the target mass, kg, the truly released mass over the plot, kg, and the error, %."""
    canopy = Canopy(mean_ndvi=ndvi, cv_percent=CV_PERCENT, correlation_m=CORRELATION_M)
    job = add_simulated_field(
        Job(
            # The flow trim is off, because it would correct the outflow that this table compares.
            flow_trim=False,
            simulated=Simulated(
                speed_kmh=MAIN_SPEED_KMH, passes=1, pass_length_m=PLOT_LENGTH_M, canopy=canopy
            ),
        ),
        machine,
    )
    plant = make_plant(machine, job, seed, 0.05, [parse_planted(text) for text in effects])
    loop = make_control_loop(machine, crop, rule, job)
    # The time covers run-in and run-out, and the material that lands last.
    seconds = (PLOT_LENGTH_M + 24.0) / (MAIN_SPEED_KMH / 3.6) + 6.0
    target = released = 0.0
    for step in simulate_run(plant, loop, seconds):
        # The target is integrated over the ground that the machine passes, kg.
        target += (
            step.target_rate_kg_ha
            * step.truth.speed_mps
            * 0.05
            * machine.geometry.working_width_m
            / 10_000.0
        )
        released += step.truth.flow_kg_s * 0.05
    return target, released, 100.0 * (released / target - 1.0)


def make_nitrogen_table() -> Table:
    """Returns the sources of the abstract's additional 28 kg/ha of nitrogen, by the columns of
    table 2."""
    extra = [
        calc_extra_nitrogen(
            [calc_weighed_rate(row[column], row[0]) for row in APPLIED_AMOUNTS.values()],
            UNIFORM_KG_HA,
        )
        for column in (1, 2)
    ]
    return Table(
        "Nitrogen given more than the uniform 300 kg/ha of urea, kg/ha",
        ("published (about)", "from the target amounts", "from the applied amounts"),
        ((EXTRA_N_KG_HA, *extra),),
        (0, 2, 2),
    )


def describe_grain_nitrogen() -> str:
    """Describes the nitrogen found in the grain."""
    shares = ", ".join(f"{100.0 * one.share:.1f}" for one in list_grain_nitrogen())
    return (
        f"Eq 2 takes 60 % of the nitrogen to be found in the grain; table 3 holds {shares} "
        "% of what FA, FB and FC "
        "got more than CK, base and topdressing. The default crop, huanghai_wheat, works by "
        "eq 2 as printed: in "
        "this field its rates bought hardly any grain, for CK yielded 6.0 t/ha with nothing "
        "where eq 3 expects 2.3."
        " It is for repeating the paper, not for dosing a field."
    )


def make_grain_picture() -> Picture:
    """Returns a picture of eq 2's assumption and table 3's result."""
    found = list_grain_nitrogen()
    return Picture(
        "Table 3 against eq 2: nitrogen in the grain over nitrogen given, both more than CK",
        "N given, kg/ha",
        "N in the grain, kg/ha",
        (
            Line(
                "table 3: FA, FB, FC",
                "published",
                [one.given_kg_ha for one in found],
                [one.grain_kg_ha for one in found],
            ),
            Line(
                "eq 2, by which the default crop doses: 60 %",
                "ours",
                [0.0, 300.0],
                # 180 of 300 kg/ha are the 60 % of eq 2.
                [0.0, 180.0],
                True,
            ),
        ),
    )


def make_grade_table(crop: Crop) -> Table:
    """Returns the grades of figure 4; the width of 0.5 in the text should be 0.05."""
    rows = tuple(
        (f"({grade.ndvi_above:.2f}, {grade.ndvi_to:.2f}]", grade.rate_kg_ha)
        for grade in make_rate_table(crop)
    )
    return Table(
        "Figure 4 as a table: rate of each grade, kg/ha; below 0.25 and above 0.75 none",
        ("NDVI", "kg/ha"),
        rows,
        (0, 1),
    )


def make_sampling_picture(table: Table) -> Picture:
    """Returns figure 3 from table 1 and from the simulated canopy; `table`: the first of
    `simulate_sampling`."""
    hz = [float(str(row[0])) for row in table.rows]
    return Picture(
        "Figure 3: CV over sampling frequency, mean of twelve plots",
        "frequency, Hz",
        "CV, %",
        (
            Line("published", "published", hz, [float(row[1] or 0.0) for row in table.rows], True),
            Line(
                "simulated canopy",
                "ours",
                hz[1:],
                [float(row[5] or 0.0) for row in table.rows[1:]],
                True,
            ),
        ),
    )


def make_rate_picture(crop: Crop) -> Picture:
    """Returns the picture of rate over NDVI."""
    smooth, graded = prepare_rule(crop.model_copy(update={"grades": False})), prepare_rule(crop)
    # 601 points show the steps of the grades as steps.
    ndvi = np.linspace(0.2, 0.8, 601)
    at = calc_weighed_rate(APPLIED_AMOUNTS["FC"][1], APPLIED_AMOUNTS["FC"][0])
    return Picture(
        "Figure 4: rate over NDVI, drawn from eq 2 to 5 (the paper's own curve was not read off)",
        "NDVI",
        "urea, kg/ha",
        (
            Line(
                "eq 2 to 4",
                "other",
                ndvi.tolist(),
                [smooth.decide_rate(float(v)).rate_kg_ha for v in ndvi],
                True,
            ),
            Line(
                "grades",
                "ours",
                ndvi.tolist(),
                [graded.decide_rate(float(v)).rate_kg_ha for v in ndvi],
                True,
            ),
            Line(
                "FC: target of table 2 at the NDVI of figure 2",
                "published",
                [PLOT_NDVI["FC"]],
                [at],
            ),
        ),
    )
