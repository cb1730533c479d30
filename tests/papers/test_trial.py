"""`topdress trial`: a simulated trial whose machine gives 7 % too much, weighed by the truth,
found again by plot."""

from __future__ import annotations

import csv
import json
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.stats import ttest_ind
from topdress.control.geodesy import TangentPlane
from topdress.control.papers import published
from topdress.control.papers.field_trial import (
    FieldTrial,
    TrialPlot,
    choose_plot_frequency,
    make_trial_section,
)
from topdress.drivers.files.trial_plots import (
    TrialError,
    read_trial,
    read_trial_plots,
    read_weights,
)

from tests.command import topdress
from tests.geojson import feature, geojson

PLANE = TangentPlane(34.28, 119.88)
JOB = """format: topdress-job/1
id: trial
flow_trim: false
field: {title: Trial, boundary_m: [[0, 0], [0, 60], [4.8, 60], [4.8, 0]]}
simulated: {passes: 2, pass_length_m: 60, speed_kmh: 4.5, 
            canopy: {mean_ndvi: 0.52, cv_percent: 9.5, correlation_m: 1}}
"""
# the first and the second pass, from 5 to 55 m north
NAMES = ("A-1", "B-1")


class Driven(NamedTuple):
    folder: Path
    fallen_kg: dict[str, float]  # by the machine's own truth

    def __getattr__(self, name: str) -> Path:
        return (
            self.folder
            / {"plots": "plots.geojson", "log": "run.csv", "weights": "weights.csv"}[name]
        )


def outline(k: int) -> list[list[float]]:
    east = 2.4 * k
    ring = ((east, 5.0), (east + 2.4, 5.0), (east + 2.4, 55.0), (east, 55.0), (east, 5.0))
    return [list(PLANE.convert_to_deg(*place)[::-1]) for place in ring]


def plots_file(path: Path, names: tuple[str, ...] = NAMES) -> Path:
    return geojson(path, *(feature([outline(k)], name=name) for k, name in enumerate(names)))


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    folder = tmp_path_factory.mktemp("trial")
    (folder / "job.yaml").write_text(JOB)
    ran = topdress(
        "simulate",
        "--job",
        folder / "job.yaml",
        "--seconds",
        "140",
        "--seed",
        "3",
        "--effect",
        "flow.gain=7",
        "--out",
        folder / "run.csv",
    )
    assert ran.exit_code == 0, ran.output
    with (folder / "run.truth.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    fallen = dict.fromkeys(NAMES, 0.0)
    for before, row in pairwise(rows):
        lands_north = row["north_m"] + (1.0 if row["east_m"] < 2.4 else -1.0) * (
            row["landed_place_m"] - row["place_m"]
        )
        name = NAMES[int(row["east_m"] > 2.4)]
        if 5.0 < lands_north < 55.0:
            fallen[name] += row["flow_kg_s"] * (row["time_s"] - before["time_s"])
    plots_file(folder / "plots.geojson")
    (folder / "weights.csv").write_text(
        "plot,treatment,applied_kg,sample_kg,sample_m2\n"
        + "".join(f"{name},{name[0]},{fallen[name]:.4f},3.0,5\n{name},,,3.1,5\n" for name in NAMES)
    )
    return Driven(folder, fallen)


@pytest.mark.exam
def test_the_machines_7_percent_are_found_again(driven: Driven) -> None:
    trial = read_trial(driven.plots, driven.log, driven.weights)
    for plot in trial.plots:
        assert plot.area_m2 == pytest.approx(120.0, rel=1e-3) and plot.treatment == plot.name[0]
        assert plot.weighed_kg / plot.target_kg == pytest.approx(1.07, abs=0.02), (
            "the control error of table 2"
        )
        assert plot.logged_kg / plot.weighed_kg == pytest.approx(1.0 / 1.07, abs=0.01), (
            "the log cannot know"
        )
        assert plot.samples_kg_ha == pytest.approx((6000.0, 6200.0))


def test_readings_are_counted_where_the_heads_look(driven: Driven) -> None:
    """50 m at 1.25 m/s and 2 Hz are 80 readings; those of the first pass picked by hand, 4.5 m
    before the antenna."""
    trial = read_trial(driven.plots, driven.log, driven.weights)
    assert trial.hz == pytest.approx(2.0, rel=0.01) and all(
        len(plot.before) in range(76, 85) for plot in trial.plots
    )
    with driven.log.open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    seen: list[float] = []
    last: tuple[str, ...] = ()
    for row in rows:
        heads = tuple(row[f"ndvi_{k}"] for k in range(1, 7))
        east, north = PLANE.project_to_m(
            float(row["lat_deg"] or "nan"), float(row["lon_deg"] or "nan")
        )
        if heads != last and all(heads) and east < 2.4 and 5.0 < north + 4.5 < 55.0:
            seen.append(float(np.mean([float(one) for one in heads])))
        last = heads
    assert float(np.mean(trial.plots[0].before)) == pytest.approx(float(np.mean(seen)), abs=0.001)


def test_the_decision_rate_is_that_of_the_papers_own_rule(driven: Driven) -> None:
    trial = read_trial(driven.plots, driven.log, driven.weights)
    choice = choose_plot_frequency(trial)
    assert choice is not None and choice.frequency_hz == min(
        choice.departure, key=lambda hz: choice.departure[hz]
    )
    few = trial._replace(plots=tuple(plot._replace(before=plot.before[:5]) for plot in trial.plots))
    assert choose_plot_frequency(few) is None and "too few" in make_trial_section(few).words[0]


def test_one_page(driven: Driven) -> None:
    page = driven.folder / "trial.html"
    arguments = [
        "trial",
        str(driven.plots),
        str(driven.log),
        str(driven.weights),
        "--after",
        str(driven.log),
        "--out",
        str(page),
    ]
    told = topdress(*arguments, "--control", "A")
    assert told.exit_code == 0, told.output
    assert "target.decision_hz" in told.stdout and "the paper's are +7.17 and 8.42 %" in told.stdout
    text = page.read_text()
    assert (
        text.count("<svg") == 3
        and "Canopy index by plot" in text
        and "what each has more than A" in text
    )
    assert "target.decision_hz" in json.loads(topdress(*arguments, "--json").stdout)["words"][0]
    wrong = topdress(*arguments, "--control", "C", "--force")
    assert wrong.exit_code == 2 and "--control C: allowed is one of A, B" in wrong.output


def plot(name: str, *samples: float, kg: float = 20.0) -> TrialPlot:
    return TrialPlot(name, name[:-2], 600.0, np.zeros(0), np.zeros(0), kg, kg, None, samples)


def test_differences_of_yields_have_the_interval_of_plots() -> None:
    """Welch's, of plots: samples of one plot are no replicates."""
    plots = (
        plot("CK-0", 6000.0, 6100.0, kg=0.0),
        plot("CK-1", 5900.0, kg=0.0),
        plot("CK-2", 6200.0, kg=0.0),
        plot("FA-0", 6500.0),
        plot("FA-1", 6800.0, 7000.0),
        plot("FA-2", 6400.0),
        plot("CP-0", 7000.0),
    )
    table = make_trial_section(FieldTrial(plots, 2.0, 0.45, 23.9)).tables[-1]
    rows = {row[0]: row for row in table.rows}
    ours, others = [6500.0, 6900.0, 6400.0], [6050.0, 5900.0, 6200.0]
    found = ttest_ind(ours, others, equal_var=False).confidence_interval(0.90)
    assert rows["FA"][5:7] == (pytest.approx(550.0), pytest.approx(0.5 * (found.high - found.low)))
    assert rows["FA"][7] == pytest.approx(20.0 / 0.06 * 0.45)
    assert rows["FA"][8] == pytest.approx(100.0 * 550.0 * 0.0239 / 150.0)
    assert rows["CK"][5] is None and rows["CP"][6] is None, "no interval against one plot"


def test_the_papers_own_table_3_comes_out_of_it() -> None:
    """Its printed yields, one plot a treatment: the same shares as on the papers' page, without
    the base."""
    plots = tuple(
        plot(f"{name}-0", kg_ha, kg=published.APPLIED_AMOUNTS.get(name, (0.0,) * 3)[2])
        for name, (_, _, kg_ha) in published.TREATMENT_YIELDS.items()
        if name != "CP"
    )
    rows = {
        row[0]: row
        for row in make_trial_section(FieldTrial(plots, 2.0, 0.45, 23.9), "CK").tables[-1].rows
    }
    assert [round(rows[name][5], 1) for name in ("FA", "FB", "FC")] == [124.7, 311.9, 999.6]


BAD_WEIGHTS = {
    "no_such_plot": ("plot,applied_kg\nC-1,3\n", "plot 'C-1': allowed is one of A-1, B-1"),
    "below_0": ("plot,applied_kg\nA-1,-3\n", "row 1: applied_kg -3: allowed is 0 or more"),
    "no_area": ("plot,sample_kg\nA-1,3\n", "row 1: sample_m2 missing"),
    "area_0": ("plot,sample_kg,sample_m2\nA-1,3,0\n", "sample_m2 0: allowed is 0.01 or more"),
    "two_treatments": (
        "plot,treatment,applied_kg\nA-1,x,3\nA-1,y,3\n",
        "treatment 'y': allowed is 'x'",
    ),
    "no_plot": ("name,applied_kg\nA-1,3\n", "column plot missing"),
    "nothing": ("plot,remark\nA-1,wet\n", "neither applied_kg nor sample_kg"),
}


@pytest.mark.parametrize("text, said", BAD_WEIGHTS.values(), ids=BAD_WEIGHTS)
def test_weights_that_are_none(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "w.csv").write_text(text)
    known: dict[str, Any] = dict.fromkeys(NAMES)
    with pytest.raises(TrialError) as caught:
        read_weights(tmp_path / "w.csv", known)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_plots_that_are_none(driven: Driven, tmp_path: Path) -> None:
    with pytest.raises(TrialError, match="plot A: allowed is a name of its own"):
        read_trial_plots(plots_file(tmp_path / "twice.geojson", ("A", "A")))
    far = plots_file(tmp_path / "far.geojson")
    far.write_text(far.read_text().replace("119.8", "118.8"))
    with pytest.raises(TrialError, match="lies in none of the plots"):
        read_trial(far, driven.log, None)
