"""The examiner is examined: independence, determinism, the log contract, and that z is what it
says."""

from __future__ import annotations

import ast
import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

HIDDEN = Path(__file__).parent / "hidden"
REPO = HIDDEN.parents[2]


@pytest.fixture(scope="module")
def short_eye(hidden: Any) -> Any:
    """Five minutes of field work, seen through AR(1) noise with slow drift."""
    p = next(p for p in hidden.programmes.PROGRAMMES if p.name == "stairs_speed")._replace(
        minutes=(5.0, 5.0)
    )
    plant = hidden.plant.Plant(hidden.programmes.drive(p, 4))
    noises = hidden.noise.noises("drift", plant.drive.row_s, np.random.default_rng(2))
    return hidden.detect.Eye(plant, noises, hidden.nominal.Physics())


def test_generator_imports_nothing_of_the_program() -> None:
    for path in HIDDEN.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = (
                [a.name for a in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            for name in names:
                assert name.split(".")[0] != "topdress", f"{path.name} imports {name}"
        text = path.read_text(encoding="utf-8")
        assert "import_module(" not in text and "__import__(" not in text, path.name


def test_same_seed_same_case_whatever_is_made_beside_it(hidden: Any) -> None:
    lone = hidden.cases.one(7, 3, "tuning", ("single",), ("catch", "lag", "heads"))
    again = list(hidden.cases.cases(3, 3, "tuning", 5, ("single",), ("catch", "lag", "heads")))[2]
    assert lone.truth == again.truth
    for name, column in lone.columns.items():
        assert np.array_equal(column, again.columns[name])
    before = hidden.cases.one(6, 3, "tuning", ("single",), ("catch", "lag", "heads"))
    assert {**before.truth, "case": "", "number": 7} != {**lone.truth, "case": ""}
    other = hidden.cases.one(7, 4, "tuning", ("single",), ("catch", "lag", "heads"))
    assert other.truth != lone.truth


@pytest.mark.exam
def test_a_run_is_the_same_twice_and_keeps_the_contract(hidden: Any, short_eye: Any) -> None:
    make = hidden.runlog.columns
    effects = (hidden.nominal.Effect("flow.slope", 0.5),)
    noises = hidden.noise.noises("tails", 0.05, np.random.default_rng(1))
    a = make(short_eye.plant, hidden.nominal.Physics(), effects, noises, 9)
    b = make(short_eye.plant, hidden.nominal.Physics(), effects, noises, 9)
    for name in a:
        same = a[name] == b[name]
        assert np.all(same | (a[name] != a[name])), name
    known = (REPO / "docs" / "format-run-log.md").read_text(encoding="utf-8")
    for name in a:
        assert f"`{name}`" in known or name.startswith("ndvi_"), (
            f"{name} is no column of the contract"
        )
    assert np.all(np.diff(a["time_s"]) > 0)
    assert {len(c) for c in a.values()} == {len(a["time_s"])}
    assert set(a["state"]) <= {"off", "ready", "working", "held", "calibrating", "fault"}
    assert np.isnan(a["shaft_rpm"]).any(), "tails come with dropouts"
    assert not np.isnan(a["shaft_rpm_cmd"]).any()
    for name, step in (("shaft_rpm_cmd", 0.1), ("opening_mm_cmd", 0.1)):
        assert np.allclose(a[name] / step, np.round(a[name] / step), atol=1e-6), name


def test_written_log_is_read_back_by_the_programs_own_reader(
    hidden: Any, short_eye: Any, tmp_path: Path
) -> None:
    reader = pytest.importorskip("topdress.drivers.files.read_log")
    noises = hidden.noise.noises("tails", 0.05, np.random.default_rng(1))
    columns = hidden.runlog.columns(short_eye.plant, hidden.nominal.Physics(), (), noises, 9)
    case = hidden.cases.Case("case-0", "run", columns, {"category": "none"}, lambda causes: None)
    path = hidden.write.write_case(case, tmp_path)
    log = reader.read_log(path)
    for name in ("shaft_rpm", "hopper_kg", "supply_v"):
        assert np.allclose(log.columns[name], columns[name], equal_nan=True, atol=1e-9), name
    assert (
        not (path.parent / "case-0.json").exists() and (tmp_path / "truth" / "case-0.json").exists()
    )


def test_z_is_the_length_that_monte_carlo_finds(hidden: Any, short_eye: Any) -> None:
    """A matched filter on noisy readings: mean z and unit spread, nuisances drawn from their
    priors included."""
    eye, nominal = short_eye, hidden.nominal
    effect = nominal.Effect("shaft.voltage_sag", 0.6)
    z = eye.z([effect])
    d = eye.trace([effect])
    rng = np.random.default_rng(0)
    noise = eye.noises["shaft"]
    t = eye.plant.drive.time_s
    scores = []
    for _ in range(60):
        p = nominal.Physics()
        p = p._replace(
            **{k: getattr(p, k) + sd * rng.normal() for k, sd in nominal.TOLERANCE.items()}
        )
        seen = eye.plant.run(p, [effect])
        noisy = dict(seen)
        noisy["shaft"] = hidden.noise.readings(seen["shaft"], eye.plant.drive.row_s, noise, rng)
        for name in ("gate", "scale", "wheel", "gnss"):
            noisy[name] = hidden.noise.readings(
                seen[name], eye.plant.drive.row_s, eye.noises[name], rng
            )
        noisy["heads"] = eye.base["heads"]
        scores.append(eye.inner(eye.whitened(noisy), d) / z)
    scores = np.array(scores)
    assert t.size > 5000 and z > 2
    assert abs(scores.mean() - z) < 4 * scores.std() / np.sqrt(scores.size) + 0.05 * z
    assert 0.75 < scores.std() < 1.3


@pytest.mark.parametrize("kind", ["ar1", "drift", "quantised"])
def test_whitened_noise_is_white_and_of_unit_size(hidden: Any, kind: str) -> None:
    rng = np.random.default_rng(8)
    clean = np.cumsum(rng.normal(size=60_000)) * 0.01  # moves across the resolution's steps
    for name, noise in hidden.noise.noises(kind, 0.05, np.random.default_rng(3)).items():
        seen = hidden.noise.readings(clean, 0.05, noise, rng)
        fresh = hidden.noise.fresh_samples(clean.size, noise)
        white = noise.whitened((seen - clean)[None, fresh], fresh * 0.05)[0]
        if noise.step > noise.sd:  # such rounding is white only roughly
            continue
        near = 4.0 / np.sqrt(fresh.size)
        assert white.std() == pytest.approx(1.0, abs=near), name
        assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < near, name


def test_sizes_get_the_z_that_was_drawn(hidden: Any, short_eye: Any) -> None:
    made = hidden.run_cases.sized(
        short_eye, hidden.nominal.Effect("shaft.voltage_sag", 0.2), 12.0, 30.0
    )
    assert made is not None
    assert short_eye.z([made[0]]) == pytest.approx(12.0, rel=0.06)
    assert (
        hidden.run_cases.sized(
            short_eye, hidden.nominal.Effect("shaft.voltage_sag", 0.2), 12.0, 0.01
        )
        is None
    )


def test_known_look_alikes_come_out_equal_and_others_do_not(hidden: Any, short_eye: Any) -> None:
    effect = hidden.nominal.Effect
    like = short_eye.likeness(
        short_eye.trace([effect("flow.gain", 0.5)]), short_eye.trace([effect("scale.gain", 0.5)])
    )
    assert abs(like) > 0.99, "no refill: a scale that reads more looks like a flow that is more"
    like = short_eye.likeness(
        short_eye.trace([effect("flow.slope", 0.5)]), short_eye.trace([effect("flow.gain", 0.5)])
    )
    assert abs(like) < 0.9


def test_traits_stay_below_what_can_be_seen(hidden: Any, short_eye: Any) -> None:
    rng = np.random.default_rng(5)
    for _ in range(4):
        for trait in hidden.run_cases.traits_of(short_eye, rng, short_eye.plant):
            assert short_eye.z([trait]) < 1.0


def test_halves_share_no_programme_and_no_layout(hidden: Any) -> None:
    for what in (hidden.programmes.PROGRAMMES, hidden.tables.LAYOUTS):
        tuning, unseen = ({p.name for p in what if p.split == s} for s in ("tuning", "unseen"))
        assert len(tuning) == len(unseen) and not tuning & unseen
    with pytest.raises(ValueError, match="tuning"):
        hidden.programmes.chosen("held-back")


def test_every_id_can_be_shown_by_both_halves(hidden: Any) -> None:
    for split in ("tuning", "unseen"):
        on_tables = {
            i
            for lay in hidden.tables.LAYOUTS
            if lay.split == split
            for i in hidden.tables.shown(lay)
        }
        on_runs = {
            i
            for i, k in hidden.nominal.IDS.items()
            if "run" in k.seen
            and any(hidden.run_cases.fits(i, p) for p in hidden.programmes.chosen(split))
        }
        assert {i for i, k in hidden.nominal.IDS.items() if k.seen} == on_tables | on_runs


def test_catalogue_and_examination_hold_the_same_ids(hidden: Any) -> None:
    """The examiner's list is its own; where it and the program differ, one of them forgot
    something."""
    machine = pytest.importorskip("topdress.control.machine.machine")
    assert set(machine.CATALOGUE) == set(hidden.nominal.IDS)


@pytest.mark.parametrize(
    ("verdict", "causes", "exact", "honest"),
    [
        ("named", [("flow.gain", [])], True, True),
        ("named", [("scale.gain", [])], True, True),  # equal on this data
        ("ambiguous", [("flow.gain", ["scale.gain"])], True, True),
        # a rival that data rule out
        ("ambiguous", [("flow.slope", ["flow.gain"])], False, False),
        ("ambiguous", [("flow.gain", ["flow.slope"])], False, False),
        ("ambiguous", [("flow.leak", ["flow.gain"])], False, True),  # near: honest, not exact
        ("named", [("flow.gain", []), ("flow.slope", [])], False, False),
        ("none", [], False, False),
        ("unexplained", [("flow.gain", [])], False, False),
    ],
)
def test_scorer_marks(
    hidden: Any, verdict: str, causes: list[Any], exact: bool, honest: bool
) -> None:
    truth = {
        "category": "single",
        "outside": None,
        "noise": "ar1",
        "data_kind": "run",
        "split": "tuning",
        "rows": 9,
        "causes": [
            {
                "id": "flow.gain",
                "size": 2.0,
                "z": 9.0,
                "equal": {"scale.gain": 1.0},
                "near": {"flow.leak": 0.9},
                "size_defined": True,
            }
        ],
    }
    answer = {
        "verdict": verdict,
        "unexplained": [],
        "causes": [
            {
                "id": i,
                "rivals": [{"id": r, "probability": 0.1} for r in rivals],
                "size": {"value": 2.0, "low": 1.9, "high": 2.1, "unit": "%"},
            }
            for i, rivals in causes
        ],
    }
    marked = hidden.score.mark(truth, answer)
    assert (marked.exact, marked.honest) == (exact, honest)
    assert "| figure |" in hidden.report.report([marked])


def test_scorer_knows_false_alarms_and_the_outside(hidden: Any) -> None:
    base = {
        "outside": None,
        "causes": [],
        "noise": "ar1",
        "data_kind": "run",
        "split": "tuning",
        "rows": 9,
    }
    nothing = {"verdict": "none", "causes": [], "unexplained": []}
    odd = {
        "verdict": "unexplained",
        "causes": [],
        "unexplained": [{"channel": "flow", "variable": "roll_deg"}],
    }
    assert hidden.score.mark({**base, "category": "none"}, nothing).false_alarm is False
    assert hidden.score.mark({**base, "category": "none"}, odd).false_alarm is True
    assert hidden.score.mark({**base, "category": "none"}, None).false_alarm is True
    outside = {
        **base,
        "category": "outside",
        "outside": {"name": "x.flow_roll", "z": 9, "variables": ["roll_deg"]},
    }
    assert hidden.score.mark(outside, odd).right_variable is True
    assert hidden.score.mark(outside, nothing).right_variable is False
    assert hidden.score.mark(outside, nothing).falsely_named is False


def test_wilson_interval_of_a_known_case(hidden: Any) -> None:
    """Ten of ten: the interval of Wilson (1927) begins at n / (n + z^2)."""
    assert hidden.report.wilson(10, 10)[1] == pytest.approx(10 / (10 + 1.96**2), abs=1e-9)


def test_gain_share_is_one_for_the_truth_and_little_for_another_cause(hidden: Any) -> None:
    case = hidden.cases.one(0, 8, "tuning", ("single",), ("catch",), ("flow.fill_falloff",))
    cause = case.truth["causes"][0]
    said = {"id": cause["id"], "size": {"value": cause["size"]}, "onset_s": None, "member": None}
    assert case.gain_share([said]) == pytest.approx(1.0, abs=1e-6)
    assert case.gain_share([{**said, "size": {"value": 0.5 * cause["size"]}}]) == pytest.approx(
        0.75, abs=0.05
    )


def test_the_timetable_is_a_fair_mixture_however_many_cases_are_taken(hidden: Any) -> None:
    dealt = [(k % 2, hidden.plan.wanted(k, 5)) for k in range(480)]
    for data in (True, False):
        some = [w for _, w in dealt if (w.kinds == ("run",)) is data]
        assert len(some) >= 200
        assert sum(w.category == "none" for w in some) >= 0.3 * len(some)
        assert {w.category for w in some} == set(hidden.cases.CATEGORIES)
    asked = [
        w.ids for half, w in dealt if w.category == "single" and w.kinds == ("run",) and half == 0
    ]
    counts = {i: asked.count(i) for i in asked}
    assert max(counts.values()) - min(counts.values()) <= 1, "every effect as often as the others"
    seen = {(w.kinds[0], w.ids[0]) for _, w in dealt if w.category == "single"}
    assert {i for _, i in seen} == {i for i, k in hidden.nominal.IDS.items() if k.seen}
    assert hidden.plan.wanted(7, 5) == dealt[7][1] and [
        hidden.plan.wanted(k, 6) for k in range(60)
    ] != [w for _, w in dealt[:60]]


def test_every_case_of_the_timetable_on_tables_can_be_made(hidden: Any) -> None:
    for k in range(120):
        w = hidden.plan.wanted(k, 5)
        if w.kinds != ("run",):
            case = hidden.cases.one(k, 5, "all", (w.category,), w.kinds, w.ids)
            assert case.kind in w.kinds and case.truth["category"] == w.category
            assert case.truth["split"] == ("tuning", "unseen")[k % 2]


def test_outside_effects_of_tables_are_beyond_the_whole_catalogue(hidden: Any) -> None:
    """Least squares of all catalogued effects together leaves at least the z that is told."""
    for name, (kind, *_) in hidden.nominal.OUTSIDE_TABLES.items():
        truth = hidden.cases.one(1, 4, "unseen", ("outside",), (kind,), (name,)).truth
        assert truth["outside"]["name"] == name and 5.9 < truth["outside"]["z"] < 40.1
        assert truth["outside"]["likest_catalogued"] <= 0.87


def test_a_coarse_clock_makes_what_is_beside_it_harder_to_see(hidden: Any) -> None:
    layout = next(lay for lay in hidden.tables.LAYOUTS if lay.name == "lag_plain")
    table = hidden.tables.Table(layout, np.random.default_rng(1))
    late = [hidden.nominal.Effect("lag.offset", 0.2)]
    fine = np.linalg.norm(table.trace(late))
    table.clock_s = 0.4
    assert np.linalg.norm(table.trace(late)) < 0.5 * fine


def test_what_the_program_proposes_is_known_to_the_examiner(hidden: Any) -> None:
    """Every run that the program may propose can be driven here."""
    plans = pytest.importorskip("topdress.control.experiments.manoeuvres").list_manoeuvres(
        importlib.import_module("topdress.control.machine.machine").Machine()
    )
    driven = {hidden.manoeuvres.asked_for(one.plan) for one in plans}
    assert len(driven) == len(plans) and None not in driven


@pytest.mark.parametrize("name", ["stairs", "slope", "standing", "refill"])
def test_a_manoeuvre_is_driven_after_the_rest(hidden: Any, short_eye: Any, name: str) -> None:
    drive = short_eye.plant.drive
    used_kg = (
        float(np.sum(drive.shaft_rpm_cmd * drive.opening_mm_cmd)) * 5.5e-3 / 60.0 * drive.row_s
    )
    thirsty = 80.0 / used_kg  # so that too little is left for a manoeuvre
    before = drive._replace(start_kg=110.0, opening_mm_cmd=thirsty * drive.opening_mm_cmd)
    after = hidden.manoeuvres.driven_too(name)(before)
    assert {len(v) for v in after if isinstance(v, np.ndarray)} == {after.time_s.size}
    assert np.allclose(np.diff(after.time_s), before.row_s)
    assert 600.0 < after.time_s.size * after.row_s
    assert (after.refill_row is not None) == (name == "refill")
    level = (
        after.start_kg
        - np.cumsum(5.5e-3 / 60.0 * after.shaft_rpm_cmd * after.opening_mm_cmd - after.refill_kg_s)
        * after.row_s
    )
    assert level.min() > 0.0


def test_score_counts_halves_kinds_and_goals(hidden: Any) -> None:
    base = {
        "outside": None,
        "causes": [],
        "noise": "ar1",
        "split": "tuning",
        "rows": 9,
        "category": "none",
    }
    nothing = {"verdict": "none", "causes": [], "unexplained": []}
    odd = {
        "verdict": "unexplained",
        "causes": [],
        "unexplained": [{"channel": "flow", "variable": "roll_deg"}],
    }
    marks = [
        hidden.score.mark({**base, "data_kind": kind}, answer)
        for kind, answer in (("run", nothing), ("run", odd), ("lag", nothing))
    ]
    text = hidden.report.report(marks)
    line = next(
        row
        for row in text.splitlines()
        if row.startswith("| false alarms, nothing hidden, no slow drift")
    )
    assert "| 1/2: short |" in line and "| 0/1: reached |" in line
    assert hidden.report.percent(3, 6) == "50.0 % (19-81), 3/6"
    assert "## Runs: false alarms by noise" in text and "## Tables: false alarms by noise" in text


def test_probabilities_are_scored_against_a_constant(hidden: Any) -> None:
    """Scores by hand: who says what he knows gains over the constant, who is too sure loses."""
    scores = hidden.probability_report
    sure = [(1.0, True)] * 3 + [(1.0, False)]
    assert scores.calc_brier_score(sure) == 0.25
    assert scores.calc_log_score(sure) == pytest.approx(-math.log(0.001) / 4)
    # the constant of a share of 3 in 4: 3/4 * 1/16 + 1/4 * 9/16 = 3/16
    assert scores.calc_skill(scores.calc_brier_score, sure) == pytest.approx(1 - 0.25 / (3 / 16))
    honest = [(0.9, True)] * 3 + [(0.1, False)]
    assert scores.calc_skill(scores.calc_brier_score, honest) == pytest.approx(1 - 0.01 / (3 / 16))
    assert scores.calc_skill(scores.calc_log_score, honest) > 0.8
