"""How does a user's field trial compare with the decision paper's? Readings by plot before and
after, the best decision rate, target and weighed masses, yields (tables 1 to 3, figure 7).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit
from topdress.control.agronomy.sampling_frequency import (
    FrequencyChoice,
    ReadingUniformity,
    choose_frequency,
    measure_evenness,
    tabulate_frequencies,
)
from topdress.control.machine.model_elements import Array

from .decision_paper_claims import calc_weighed_rate
from .page import Line, Picture, Section, Table, TableCell
from .published import APPLIED_AMOUNTS

# Number of halvings of the sampling frequency: 2 to 0.125 Hz, as in table 1.
HALVING_COUNT = 4
# Minimum number of a plot's readings at the lowest frequency: fewer readings give no standard
# deviation.
MIN_READINGS = 4
# Confidence of the intervals on these pages.
CONFIDENCE = 0.90


class TrialPlot(NamedTuple):
    """Holds one plot.

    `before`, `after`: the canopy's index, mean of the heads, (n,), in order of the path. Masses of
    the plot, kg: `target_kg`, `logged_kg` by the log, `weighed_kg` by the scales; None means
    unknown. `samples_kg_ha`: yields.
    """

    name: str
    treatment: str
    area_m2: float
    before: Array
    after: Array
    target_kg: float | None
    logged_kg: float | None
    weighed_kg: float | None
    samples_kg_ha: tuple[float, ...]

    @property
    def given_kg_ha(self) -> float | None:
        """Returns the applied rate by weighing, or by the log where nothing was weighed, kg/ha."""
        # Scales come before the log, because they do not depend on the machine's own model.
        kg = self.logged_kg if self.weighed_kg is None else self.weighed_kg
        return None if kg is None else calc_weighed_rate(kg, self.area_m2)


class FieldTrial(NamedTuple):
    """Holds a trial. `hz`: rate of the readings in the log; n_fraction: N in the product;
    grain_n_kg_t: N in the grain."""

    plots: tuple[TrialPlot, ...]
    hz: float
    n_fraction: float
    grain_n_kg_t: float

    @property
    def treatments(self) -> dict[str, list[TrialPlot]]:
        """Returns the plots by treatment, in the order of the plots."""
        found: dict[str, list[TrialPlot]] = {}
        for plot in self.plots:
            found.setdefault(plot.treatment, []).append(plot)
        return found


def make_trial_section(trial: FieldTrial, control: str | None = None) -> Section:
    """Returns the section of a trial. control: the treatment for comparison; None for the
    treatment with the least product. Raises ValueError."""
    # A misspelt treatment would otherwise give an empty comparison.
    if control is not None and control not in trial.treatments:
        raise ValueError(f"--control {control}: allowed is one of {', '.join(trial.treatments)}")
    against = control or _find_least_product(trial)
    frequency, frequency_words = make_frequency_table(trial)
    tables = [
        frequency,
        make_canopy_table(trial),
        make_amount_table(trial),
        *make_yield_tables(trial, against),
    ]
    return Section(
        "Trial",
        (frequency_words, *_describe_trial(trial, against)),
        # A trial without weighing or yields has empty tables, which are omitted.
        tuple(table for table in tables if table.rows),
        _make_pictures(trial),
    )


def choose_plot_frequency(trial: FieldTrial) -> FrequencyChoice | None:
    """Returns the best decision rate by the plots' own readings; None for too few readings."""
    plots = [_list_evenness(plot, trial.hz) for plot in trial.plots]
    try:
        return choose_frequency(plots, trial.hz)
    # choose_frequency raises for too few readings; the page then states this.
    except ValueError:
        return None


def make_frequency_table(trial: FieldTrial) -> tuple[Table, str]:
    """Returns table 1 of these plots, and the best frequency."""
    plots = [_list_evenness(plot, trial.hz) for plot in trial.plots]
    rows: list[tuple[TableCell, ...]] = []
    choice = choose_plot_frequency(trial)
    for k in range(HALVING_COUNT + 1):
        hz = trial.hz / 2**k
        # A short plot has no reading at the lowest frequencies.
        there = [plot[hz] for plot in plots if hz in plot]
        if there:
            rows.append(
                (
                    f"{hz:.3g}",
                    len(there),
                    float(np.mean([one.cv_percent for one in there])),
                    float(np.mean([one.cuc_percent for one in there])),
                    # A frequency that some plot lacks has no comparable change.
                    None if choice is None else choice.departure.get(hz),
                )
            )
    said = (
        "Readings are too few to compare frequencies."
        if choice is None
        else f"Of the frequencies below the {trial.hz:.3g} Hz of the readings, "
        f"{choice.frequency_hz:.3g} Hz changes CV "
        f"and C_uc least ({choice.departure[choice.frequency_hz]:.2f} percentage points): "
        "target.decision_hz "
        f"{choice.frequency_hz:.3g} in the job."
    )
    return Table(
        "CV and uniformity of the readings by sampling frequency, mean of the plots, %; "
        "change against all of "
        "them, percentage points",
        ("Hz", "plots", "CV", "C_uc", "change"),
        tuple(rows),
        (0, 0, 2, 2, 2),
    ), said


def _list_evenness(plot: TrialPlot, hz: float) -> dict[float, ReadingUniformity]:
    wanted = [
        hz / 2**k for k in range(HALVING_COUNT + 1) if len(plot.before) / 2**k >= MIN_READINGS
    ]
    return tabulate_frequencies(plot.before, hz, wanted) if wanted else {}


def make_canopy_table(trial: FieldTrial) -> Table:
    """Returns figure 7 as a table: each plot, and the plots of each treatment together."""
    rows: list[tuple[TableCell, ...]] = []
    for treatment, plots in trial.treatments.items():
        rows += [
            _make_canopy_row(
                treatment, plot.name, measure_evenness(plot.before), measure_evenness(plot.after)
            )
            for plot in plots
        ]
        # A single plot is its own mean.
        if len(plots) > 1:
            both = [
                _combine_evenness([measure_evenness(part) for part in parts])
                for parts in ([p.before for p in plots], [p.after for p in plots])
            ]
            rows.append(_make_canopy_row(treatment, "mean of plots", *both))
    return Table(
        "Canopy index by plot, before and after",
        (
            "treatment",
            "plot",
            "readings",
            "mean before",
            "CV %",
            "C_uc %",
            "mean after",
            "CV %",
            "C_uc %",
            "CV grown by",
        ),
        tuple(rows),
        (0, 0, 0, 3, 2, 2, 3, 2, 2, 2),
    )


def _combine_evenness(parts: Sequence[ReadingUniformity]) -> ReadingUniformity:
    seen = [part for part in parts if part.n]
    # A treatment without readings after the dressing shows empty cells.
    if not seen:
        return ReadingUniformity(0, *(float("nan"),) * 3)
    return ReadingUniformity(
        sum(part.n for part in seen),
        *(float(np.nanmean([part[k] for part in seen])) for k in (1, 2, 3)),
    )


def _make_canopy_row(
    treatment: str, name: str, before: ReadingUniformity, after: ReadingUniformity
) -> tuple[TableCell, ...]:
    return (
        treatment,
        name,
        before.n,
        *(
            _replace_nan(figure)
            for figure in (*before[1:], *after[1:], after.cv_percent - before.cv_percent)
        ),
    )


def _replace_nan(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def make_amount_table(trial: FieldTrial) -> Table:
    """Returns table 2 of these plots: errors relative to the target, as in the paper. Logged and
    weighed masses show whether the log or the machine is wrong."""

    def percent(kg: float | None, of_kg: float | None) -> float | None:
        # A target of 0, as in a control plot, has no percentage.
        return None if kg is None or not of_kg else 100.0 * (kg / of_kg - 1.0)

    rows = [
        (
            plot.treatment,
            plot.name,
            plot.area_m2,
            plot.target_kg,
            plot.logged_kg,
            plot.weighed_kg,
            percent(plot.weighed_kg, plot.target_kg),
            percent(plot.logged_kg, plot.weighed_kg),
            plot.given_kg_ha,
        )
        for plot in trial.plots
    ]
    return Table(
        "Amounts by plot: control error of what was weighed against the target, and of the "
        "log against what "
        "was weighed",
        (
            "treatment",
            "plot",
            "area m2",
            "target kg",
            "by the log kg",
            "weighed kg",
            "control error %",
            "log off %",
            "given kg/ha",
        ),
        tuple(rows),
        (0, 0, 0, 2, 2, 2, 2, 2, 1),
    )


def make_yield_tables(trial: FieldTrial, control: str) -> tuple[Table, ...]:
    """Returns table 3 of these plots, with the test whether treatments differ by more than their
    samples' scatter.

    A plot is one replicate, the mean of its samples; samples of one plot are not independent
    replicates.
    """
    means = {
        # Samples are averaged by plot: plots are the replicates of the trial.
        name: [float(np.mean(plot.samples_kg_ha)) for plot in plots if plot.samples_kg_ha]
        for name, plots in trial.treatments.items()
    }
    if not any(means.values()):
        return ()
    rows: list[tuple[TableCell, ...]] = []
    for name, plots in trial.treatments.items():
        samples = np.array([one for plot in plots for one in plot.samples_kg_ha])
        if not len(samples):
            continue
        more, half = (
            _compare_means(means[name], means[control]) if name != control else (None, None)
        )
        # Nitrogen and yield are compared with the same control, so their quotient is an efficiency.
        given = _calc_mean([plot.given_kg_ha for plot in plots])
        base = _calc_mean([plot.given_kg_ha for plot in trial.treatments[control]])
        # Product becomes nitrogen by the product's share.
        more_n = None if given is None or base is None else (given - base) * trial.n_fraction
        share = (
            100.0 * more * trial.grain_n_kg_t / 1000.0 / more_n
            if more is not None and more_n
            else None
        )
        rows.append(
            (
                name,
                len(means[name]),
                len(samples),
                float(np.mean(means[name])),
                # The CV needs at least two samples.
                float(100.0 * samples.std(ddof=1) / samples.mean()) if len(samples) > 1 else None,
                more,
                half,
                more_n,
                share,
            )
        )
    return (
        Table(
            f"Yields by treatment, and what each has more than {control}",
            (
                "treatment",
                "plots",
                "samples",
                "yield kg/ha",
                "CV of samples %",
                "more kg/ha",
                "90 % +-",
                "more N given kg/ha",
                "of it in the grain %",
            ),
            tuple(rows),
            (0, 0, 0, 0, 2, 0, 0, 1, 1),
        ),
    )


def _compare_means(
    ours: Sequence[float], others: Sequence[float]
) -> tuple[float | None, float | None]:
    """Returns the difference of two means, and half of its 90 % interval (Welch 1947, Biometrika
    34:28-35); no interval where either has a single plot."""
    if not ours or not others:
        return None, None
    more = float(np.mean(ours) - np.mean(others))
    # With one plot the scatter between plots is unknown.
    if len(ours) < 2 or len(others) < 2:
        return more, None
    parts = [float(np.var(side, ddof=1)) / len(side) for side in (ours, others)]
    # Without any scatter the interval has the width 0.
    if sum(parts) <= 0.0:
        return more, 0.0
    # Degrees of freedom by Welch and Satterthwaite for unequal variances.
    freedom = sum(parts) ** 2 / sum(
        part**2 / (len(side) - 1) for part, side in zip(parts, (ours, others), strict=True)
    )
    return more, float(stdtrit(freedom, 0.5 + 0.5 * CONFIDENCE) * np.sqrt(sum(parts)))


def _calc_mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _find_least_product(trial: FieldTrial) -> str:
    means = {
        name: _calc_mean([plot.given_kg_ha for plot in plots])
        for name, plots in trial.treatments.items()
    }
    # Treatments without a known amount come last.
    return min(means, key=lambda name: (means[name] is None, means[name] or 0.0))


def _describe_trial(trial: FieldTrial, control: str) -> list[str]:
    found = [
        f"{len(trial.plots)} plots of {len(trial.treatments)} treatments; held against {control}."
    ]
    errors = [
        100.0 * (plot.weighed_kg / plot.target_kg - 1.0)
        for plot in trial.plots
        if plot.weighed_kg is not None and plot.target_kg
    ]
    if errors:
        # The paper's own control errors stand next to the user's for scale.
        papers = [row[3] for row in APPLIED_AMOUNTS.values()]
        found.append(
            f"Control error of what was weighed: {np.mean(errors):+.2f} % in the mean, "
            f"{np.max(np.abs(errors)):.2f} % at most; the paper's are {np.mean(papers):+.2f} and "
            f"{max(papers):.2f} %."
        )
    # Without a second plot a difference between treatments may be one between soils.
    single = [
        name
        for name, plots in trial.treatments.items()
        if sum(bool(p.samples_kg_ha) for p in plots) == 1
    ]
    if single:
        found.append(
            f"One plot alone of {', '.join(single)}: no difference to it parts from the "
            "field's own."
        )
    return found


def _make_pictures(trial: FieldTrial) -> tuple[Picture, ...]:
    numbered = (
        "plot ("
        + ", ".join(f"{k} {plot.name}" for k, plot in enumerate(trial.plots, start=1))
        + ")"
    )
    before, after = (
        [_replace_nan(measure_evenness(part).cv_percent) for part in parts]
        # Both series use the order of the plots, whose numbers label the axis.
        for parts in ([plot.before for plot in trial.plots], [plot.after for plot in trial.plots])
    )
    pictures = [
        Picture(
            "Given by plot",
            numbered,
            "kg/ha",
            (
                _make_line(
                    "target",
                    "other",
                    [
                        None
                        if plot.target_kg is None
                        else calc_weighed_rate(plot.target_kg, plot.area_m2)
                        for plot in trial.plots
                    ],
                ),
                _make_line(
                    "as weighed, else by the log",
                    "ours",
                    [plot.given_kg_ha for plot in trial.plots],
                ),
            ),
        ),
        Picture(
            "CV of the canopy by plot",
            numbered,
            "CV, %",
            (_make_line("before", "published", before), _make_line("after", "ours", after)),
        ),
    ]
    if any(plot.samples_kg_ha for plot in trial.plots):
        pictures.append(
            Picture(
                "Yield over what was given, plot by plot",
                "given, kg/ha",
                "yield, kg/ha",
                (
                    Line(
                        "plots",
                        "ours",
                        [plot.given_kg_ha or 0.0 for plot in trial.plots if plot.samples_kg_ha],
                        [
                            # The amount is an x value, so plots without yield are omitted from both
                            # lists.
                            float(np.mean(plot.samples_kg_ha))
                            for plot in trial.plots
                            if plot.samples_kg_ha
                        ],
                    ),
                ),
            )
        )
    return tuple(pictures)


def _make_line(name: str, kind: str, values: Sequence[float | None]) -> Line:
    there = [(float(k), value) for k, value in enumerate(values, start=1) if value is not None]
    return Line(name, kind, [k for k, _ in there], [value for _, value in there])
