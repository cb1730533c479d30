"""The examiner of the classes is examined: what begins, grows or ends, poor or foreign logs,
more columns, terms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.exam


@pytest.fixture(scope="module")
def plant(hidden: Any) -> Any:
    """Six minutes on hills, every variable moving, with one column that no standard log has."""
    p = next(p for p in hidden.programmes.PROGRAMMES if p.name == "grid_long")._replace(
        minutes=(6.0, 6.0)
    )
    drive = hidden.programmes.drive(p, 4)
    return hidden.plant.Plant(
        drive, {"engine_torque_nm": 300.0 + 60.0 * np.sin(drive.time_s / 9.0)}
    )


def _eye(hidden: Any, plant: Any, rows: Any = None) -> Any:
    noises = hidden.noise.noises("ar1", plant.drive.row_s, np.random.default_rng(2))
    return hidden.detect.Eye(plant, noises, hidden.nominal.Physics(), hidden.logged.Logged(rows))


def _healthy_log(hidden: Any, plant: Any) -> Any:
    noises = hidden.noise.noises("ar1", 0.05, np.random.default_rng(1))
    return hidden.runlog.columns(plant, hidden.nominal.Physics(), (), noises, 9)


def _values(plant: Any) -> dict[str, Any]:
    names = (
        "time_s",
        "roll_deg",
        "pitch_deg",
        "supply_v",
        "speed_mps",
        "heading_deg",
        "shaft_rpm_cmd",
        "opening_mm_cmd",
    )
    return {**{v: np.asarray(getattr(plant.drive, v), dtype=float) for v in names}, **plant.columns}


def _term(
    hidden: Any, plant: Any, kind: str, stage: str, variables: Sequence[str], form: int = 1
) -> Any:
    term = hidden.terms.term_over(
        kind, tuple(variables), _values(plant), form, 0.4, 20.0, 100.0, 180.0
    )
    return hidden.nominal.Effect(stage, hidden.terms.STAGES[stage][2], term=term)


def _oracle(hidden: Any, eye: Any, effect: Any, draws: int = 40) -> tuple[float, float]:
    """Mean and spread of z as the true form finds it in noisy readings, one matched filter a
    draw."""
    trace, z, rng = eye.trace([effect]), eye.z([effect]), np.random.default_rng(0)
    clean = eye.plant.run(eye.around, [effect])
    scores = []
    for _ in range(draws):
        noisy = {
            k: clean[k]
            if k == "heads"
            else hidden.noise.readings(clean[k], eye.plant.drive.row_s, eye.noises[k], rng)
            for k in ("shaft", "gate", "scale", "wheel", "gnss", "heads")
        }
        scores.append(eye.inner(eye.whitened(noisy), trace) / z)
    return float(np.mean(scores)), float(np.std(scores))


@pytest.mark.parametrize(
    ("kind", "name", "guess"),
    [
        ("onset", "shaft.gain", 0.3),
        ("growth", "shaft.voltage_sag", 0.5),
        ("temporary", "gate.offset", 0.1),
        ("growth", "gate.slow", 3.0),
        ("growth", "gate.backlash", 0.1),
        ("onset", "shaft.dead_time", 0.05),
        ("growth", "flow.gain", 3.0),
        ("onset", "scale.drift", 3.0),
        ("growth", "speed.wheel_radius", 2.0),
    ],
)
def test_what_comes_and_goes_is_as_strong_as_the_truth_says(
    hidden: Any, plant: Any, kind: str, name: str, guess: float
) -> None:
    course = hidden.courses.dealt(kind, plant.drive.time_s, np.random.default_rng(3))
    eye = _eye(hidden, plant)
    made = hidden.run_cases.sized(
        eye, hidden.nominal.Effect(name, guess, course=course), 12.0, 50.0
    )
    assert made is not None and made[1] == pytest.approx(12.0, rel=0.25)
    mean, spread = _oracle(hidden, eye, made[0])
    assert mean == pytest.approx(
        eye.inner(*2 * (eye.trace([made[0]]),)) / made[1], abs=4 * spread / 40**0.5 + 0.6
    )
    assert 0.6 < spread < 1.4


@pytest.mark.parametrize(
    ("kind", "stage", "variables"),
    [
        ("variable", "y.flow", ["roll_deg"]),
        ("product", "y.wheel", ["roll_deg", "speed_mps"]),
        ("memory", "y.gate", ["supply_v"]),
        ("periodic", "y.shaft", ["shaft_angle"]),
        ("dead_zone", "y.shaft_rpm", ["shaft_rpm_cmd"]),
        ("saturation", "y.gate", ["opening_mm_cmd"]),
        ("side", "y.flow", ["shaft_rpm_cmd"]),
        ("span", "y.scale", ["time_s"]),
        ("column", "y.wheel", ["engine_torque_nm"]),
    ],
)
def test_a_term_is_as_strong_as_the_truth_says_and_stays_in_its_stage(
    hidden: Any, plant: Any, kind: str, stage: str, variables: list[str]
) -> None:
    eye = _eye(hidden, plant)
    made = hidden.run_cases.sized(eye, _term(hidden, plant, kind, stage, variables), 12.0, 400.0)
    assert made is not None and made[1] == pytest.approx(12.0, rel=0.06)
    mean, spread = _oracle(hidden, eye, made[0])
    assert mean == pytest.approx(12.0, abs=4 * spread / 40**0.5 + 0.6)
    without, with_it = plant.run(eye.around), plant.run(eye.around, [made[0]])
    moved = {
        k for k in ("shaft", "gate", "scale", "wheel") if not np.array_equal(without[k], with_it[k])
    }
    stage_of = {
        "y.flow": {"scale"},
        "y.wheel": {"wheel"},
        "y.gate": {"gate", "scale"},
        "y.scale": {"scale"},
    }
    assert moved == stage_of.get(stage, {"shaft", "scale"})


def test_a_begin_is_told_as_sharply_as_the_data_hold_it(hidden: Any, plant: Any) -> None:
    """Least squares over size and begin in noisy readings: its spread is the one that the truth
    tells."""
    eye, t = _eye(hidden, plant), plant.drive.time_s
    course = hidden.courses.Course("growth", 120.0, float(t[-1]) - 120.0)
    e, _ = hidden.run_cases.sized(
        eye, hidden.nominal.Effect("shaft.gain", 0.3, course=course), 40.0, 50.0
    )
    told = hidden.classes.onset_sd(eye, e)
    assert 3.0 < told < 60.0
    by_size = eye.trace([e]) / e.size
    by_begin = (
        eye.trace([hidden.classes.begun_at(e, 125.0)])
        - eye.trace([hidden.classes.begun_at(e, 115.0)])
    ) / 10.0
    found, rng = [], np.random.default_rng(1)
    for _ in range(60):
        noisy = {k: np.asarray(v).copy() for k, v in eye.base.items()}
        noisy["shaft"] = hidden.noise.readings(eye.base["shaft"], 0.05, eye.noises["shaft"], rng)
        seen = eye.whitened(noisy)
        gram = [[eye.inner(a, b) for b in (by_size, by_begin)] for a in (by_size, by_begin)]
        found.append(np.linalg.solve(gram, [eye.inner(a, seen) for a in (by_size, by_begin)])[1])
    assert np.std(found) == pytest.approx(told, rel=0.35)


def test_every_class_of_terms_can_be_dealt_in_many_forms(hidden: Any, plant: Any) -> None:
    assert {"shaft_angle"} <= {v for _, vs in hidden.terms.choices("periodic") for v in vs}
    for kind in hidden.terms.CLASSES[:-1]:
        seen = set()
        for seed in range(40):
            stage, term = hidden.terms.dealt(kind, _values(plant), np.random.default_rng(seed))
            assert stage in hidden.terms.STAGES and len(term.variables) == (
                2 if kind == "product" else 1
            )
            values = {**_values(plant), "shaft_angle": plant.drive.time_s}
            g = term.signal(values, plant.drive.row_s)
            assert np.all(np.isfinite(g)) and g.std() < 20.0
            seen.add((stage, term.variables, term.form))
        assert len(seen) >= 15, kind


@pytest.mark.parametrize("kind", ["onset", "growth", "temporary"])
def test_a_course_is_nothing_before_it_begins_and_whole_at_its_end(hidden: Any, kind: str) -> None:
    t = np.arange(0.0, 2000.0, 0.05)
    for seed in range(60):
        c = hidden.courses.dealt(kind, t, np.random.default_rng(seed))
        share = c.at(t)
        assert share.min() == 0.0 and share.max() == pytest.approx(1.0, abs=1e-3)
        assert not share[t < c.from_s].any() and share[t > c.from_s + 2.0].any()
        assert (share[-1] == 0.0) == (kind == "temporary")
        if kind != "temporary":
            assert np.all(np.diff(share) >= 0) and share[-1] == pytest.approx(1.0, abs=1e-3)


def test_an_effect_from_the_first_row_is_the_same_with_and_without_a_course(
    hidden: Any, plant: Any
) -> None:
    """Every site that knows a course does what it did without one."""
    always = hidden.courses.Course("onset", -100.0, 0.0)
    for name in hidden.classes.WITH_ONSET:
        e = hidden.nominal.Effect(name, hidden.nominal.IDS[name].guess, 1, 0.5, None, 1)
        plain = plant.run(hidden.nominal.Physics(), [e._replace(onset_s=-100.0)])
        course = plant.run(hidden.nominal.Physics(), [e._replace(course=always)])
        for reading in ("shaft", "gate", "scale", "wheel", "gnss", "heads"):
            # which counts its hours from the begin
            near = 0.02 if name.endswith("drift") else 1e-6
            assert np.allclose(
                plain[reading], course[reading], rtol=0, atol=near * max(1.0, e.size)
            ), (name, reading)


def test_an_effect_that_never_begins_is_not_there(hidden: Any, plant: Any) -> None:
    never = hidden.courses.Course("onset", 1e6, 0.0)
    without = plant.run(hidden.nominal.Physics())
    for name in hidden.classes.WITH_ONSET:
        e = hidden.nominal.Effect(name, hidden.nominal.IDS[name].guess, 2, 0.5, None, 1, 0, never)
        with_it = plant.run(hidden.nominal.Physics(), [e])
        for reading in ("shaft", "gate", "scale", "wheel", "gnss", "heads"):
            assert np.allclose(without[reading], with_it[reading], rtol=0, atol=1e-4), (
                name,
                reading,
            )


def test_coarse_rows_are_rows_of_the_fine_log_and_lose_no_event(hidden: Any, plant: Any) -> None:
    columns = _healthy_log(hidden, plant)
    columns["events"][101], columns["events"][103] = "refill 50.0", "mark"
    for hz in hidden.classes.COARSE_HZ:
        rows = hidden.logged.coarse_rows(columns["time_s"].size, 0.05, hz, np.random.default_rng(2))
        out = hidden.logged.written(columns, hidden.logged.Logged(rows))
        assert np.mean(np.diff(out["time_s"])) == pytest.approx(1.0 / hz, rel=0.02)
        assert np.array_equal(out["shaft_rpm"], columns["shaft_rpm"][rows], equal_nan=True)
        assert "refill 50.0" in ";".join(out["events"]) and "mark" in ";".join(out["events"])
    kept, _ = hidden.logged.thinned(np.arange(7000), 0.05, np.random.default_rng(3))
    assert 2000 < kept.size < 6990 and np.all(np.diff(kept) > 0)


def test_what_a_coarse_log_does_not_hold_makes_an_effect_harder_to_see(
    hidden: Any, plant: Any
) -> None:
    slow = hidden.nominal.Effect("shaft.slow", 0.4)
    rows = hidden.logged.coarse_rows(plant.drive.time_s.size, 0.05, 1.0, np.random.default_rng(2))
    fine, coarse = _eye(hidden, plant), _eye(hidden, plant, rows)
    seen_fine, seen_coarse = (eye.inner(*2 * (eye.trace([slow]),)) for eye in (fine, coarse))
    assert 0.0 < seen_coarse < 0.1 * seen_fine
    unsure = coarse.doubt["shaft"]
    assert unsure.shape == plant.drive.time_s.shape and 0.1 < np.max(unsure[rows]) < 100.0


@pytest.mark.parametrize("convention", ["same_row", "in_force", "row_later"])
def test_foreign_rows(hidden: Any, plant: Any, convention: str) -> None:
    columns = _healthy_log(hidden, plant)
    rows = np.arange(0, columns["time_s"].size, 40)
    out = hidden.logged.written(columns, hidden.logged.Logged(rows), "", convention)
    command, answer = columns["shaft_rpm_cmd"][rows], columns["shaft_rpm"][rows]
    if convention == "same_row":
        assert np.array_equal(
            out["shaft_rpm"][:-1], columns["shaft_rpm"][rows[1:] - 1], equal_nan=True
        )
    if convention == "in_force":
        assert np.array_equal(out["shaft_rpm_cmd"][1:], command[:-1])
    if convention == "row_later":
        assert np.array_equal(out["shaft_rpm"][1:], answer[:-1], equal_nan=True)


def test_a_log_that_lacks_a_column_is_asked_only_for_what_it_can_tell(
    hidden: Any, plant: Any
) -> None:
    columns = _healthy_log(hidden, plant)
    for lacks in hidden.logged.LACKS:
        out = hidden.logged.written(columns, hidden.logged.Logged(), lacks)
        assert "time_s" in out and not set(hidden.logged.LACKS[lacks][0]) & set(out)
        able = hidden.logged.judged(lacks, hidden.classes.RUN_IDS, hidden.classes.NEEDS)
        assert 0 < len(able) < len(hidden.classes.RUN_IDS)
    assert set(
        hidden.logged.judged("shaft_only", hidden.classes.RUN_IDS, hidden.classes.NEEDS)
    ) == {
        "shaft.gain",
        "shaft.slow",
        "shaft.dead_time",
        "shaft.dead_band",
        "shaft.voltage_sag",
        "shaft.coarse_encoder",
        "shaft.stall",
    }


def test_further_columns_hold_one_cause_and_decoys(hidden: Any, plant: Any) -> None:
    likes = set()
    for seed in range(30):
        some = hidden.extras.dealt(plant.drive, 5, np.random.default_rng(seed), cause=True)
        assert len({x.name for x in some}) == 5 and hidden.extras.KNOWN[some[0].name].drives
        assert some[0].like not in ("time", "noise", "speed"), (
            "such a cause is not to be told from the decoys"
        )
        for x in some:
            assert x.like in ("noise", "gusts") or np.std(x.told - x.true) < 0.3 * np.std(x.true), (
                x.name,
                x.like,
            )
        likes |= {x.like for x in some[1:]}
    assert likes == set(hidden.extras.LIKE)


@pytest.mark.parametrize("kind", ["loud", "loud_drift", "pink", "hum", "uneven"])
def test_louder_noise_is_as_loud_as_it_says(hidden: Any, kind: str) -> None:
    usual = {"shaft": 0.3, "gate": 0.1, "scale": 0.15, "gnss": 0.03, "wheel": 0.02, "heads": 0.01}
    clean = np.zeros(60_000)
    for name, n in hidden.noise.louder(kind, 0.05, np.random.default_rng(4)).items():
        got = hidden.noise.readings(clean, 0.05, n, np.random.default_rng(5))
        assert 1.0 < n.sd / usual[name] < 7.1
        assert np.std(got) == pytest.approx(np.hypot(n.sd, n.slow_sd), rel=0.35), name


def test_a_loop_corrects_what_the_scale_tells(hidden: Any) -> None:
    p = next(p for p in hidden.programmes.PROGRAMMES if p.name == "steady_rate")._replace(
        minutes=(14.0, 14.0)
    )
    drive = hidden.programmes.drive(p, 3)
    noises = hidden.noise.noises("ar1", drive.row_s, np.random.default_rng(1))
    less = hidden.nominal.Effect("flow.gain", -10.0)

    def logged(driven: Any) -> Any:
        return hidden.runlog.columns(
            hidden.plant.Plant(driven), hidden.nominal.Physics(), [less], noises, 5
        )

    driven, trim = hidden.closed_loop.trimmed(drive, logged, np.random.default_rng(1))
    assert trim[0] == 1.0 and trim[-1] == pytest.approx(0.9, abs=0.02)
    assert driven.opening_mm_cmd[-1] == pytest.approx(
        drive.opening_mm_cmd[-1] / trim[-1], abs=0.051
    )


def test_nothing_is_hidden_in_a_healthy_case_and_every_class_says_what_it_is(hidden: Any) -> None:
    for category in ("healthy_coarse", "healthy_foreign", "healthy_columns"):
        truth = hidden.cases.one(2, 31, "tuning", (category,), ("run",)).truth
        assert truth["causes"] == [] and truth["outside"] is None and truth["category"] == category
    case = hidden.cases.one(2, 31, "tuning", ("onset",), ("run",), ("canopy.head_fouled",))
    again = hidden.cases.one(2, 31, "tuning", ("onset",), ("run",), ("canopy.head_fouled",))
    assert case.truth == again.truth
    assert all(
        np.array_equal(case.columns[n], again.columns[n], equal_nan=case.columns[n].dtype != object)
        for n in case.columns
    )
    cause = case.truth["causes"][0]
    assert cause["onset_s"] == cause["course"]["from_s"] and 1.9 < cause["z"] < 101.0
    assert 0.0 < cause["onset_sd_s"] < 2000.0
    said = {
        "id": cause["id"],
        "size": {"value": cause["size"]},
        "onset_s": cause["onset_s"],
        "member": cause["member"],
    }
    assert case.gain_share([said]) == pytest.approx(1.0, abs=1e-6)


def test_the_second_timetable_covers_every_class_in_any_thousand_cases(hidden: Any) -> None:
    plan, classes = hidden.class_plan, hidden.classes.CLASSES
    dealt = [plan.wanted(k, 7) for k in range(1000)]
    counts = {c: sum(w.category == c for w in dealt) for c in {w.category for w in dealt}}
    assert set(counts) == {*classes, *hidden.cases.CATEGORIES}
    assert min(counts.values()) >= 12
    healthy = [w for w in dealt if w.category == "none" or classes.get(w.category, ()) is None]
    assert 0.33 * len(dealt) <= len(healthy) <= 0.45 * len(dealt)
    assert {w.ids[0] for w in dealt if w.category == "onset"} == set(hidden.classes.WITH_ONSET)
    assert {w.ids[0] for w in dealt if w.category == "growth"} == set(hidden.classes.WITH_GROWTH)
    assert {w.ids[0] for w in dealt if w.category == "term"} == set(hidden.terms.CLASSES[:-1])
    assert plan.wanted(3, 7) == dealt[3] and [plan.wanted(k, 8) for k in range(60)] != dealt[:60]


# Sums of columns of the first timetable's cases, seed 1, before there were classes: number ->
# column, sum.
OLD = {
    4: {
        "speed_mps": 19709.2278,
        "shaft_rpm": 531315.348,
        "hopper_kg": 2984498.2,
        "ndvi_3": 7820.7034,
        "opening_mm_cmd": 377206.2,
        "supply_v": 206296.7,
    },
    5: {"shaft_rpm": 2525.0, "lag_s": 70.97},
    9: {"target_kg": 162.0, "applied_kg": 162.556},
    10: {"shaft_rpm": 1080.0, "miss_m": 0.18},
    23: {
        "wheel_speed_mps": 52767.2586,
        "shaft_rpm": 2163707.819,
        "hopper_kg": 5411984.3,
        # With the roughness that the ground got later.
        "pitch_deg": -12484.042,
    },
}


@pytest.mark.parametrize("number", sorted(OLD))
def test_cases_of_the_first_timetable_stay_as_they_were(hidden: Any, number: int) -> None:
    w = hidden.plan.wanted(number, 1)
    case = hidden.cases.one(number, 1, "all", (w.category,), w.kinds, w.ids)
    for name, total in OLD[number].items():
        assert np.nansum(case.columns[name]) == pytest.approx(total, rel=1e-7), name


def _truth(**more: Any) -> dict[str, Any]:
    return {
        "category": "onset",
        "outside": None,
        "causes": [],
        "noise": "ar1",
        "data_kind": "run",
        "split": "unseen",
        "rows": 9,
        "log": {"row_s": 0.05},
        **more,
    }


def _cause(name: str, onset_s: float | None = None, probability: float = 0.97) -> dict[str, Any]:
    return {
        "id": name,
        "rivals": [],
        "size": {"value": 1.0, "low": 0.9, "high": 1.1},
        "onset_s": onset_s,
        "probability": probability,
        "member": None,
    }


def test_begin_and_name_are_counted_apart(hidden: Any) -> None:
    mark = hidden.score.mark
    course = {"kind": "onset", "from_s": 300.0}
    truth = _truth(
        causes=[
            {
                "id": "flow.gain",
                "size": 1.0,
                "z": 20.0,
                "equal": {},
                "near": {},
                "size_defined": True,
                "onset_s": 300.0,
                "course": course,
            }
        ]
    )
    early = mark(
        truth, {"verdict": "named", "causes": [_cause("flow.gain", 180.0)], "unexplained": []}
    )
    assert early.exact and early.onset_error_s == 120.0
    untold = mark(truth, {"verdict": "named", "causes": [_cause("flow.gain")], "unexplained": []})
    assert untold.exact and untold.onset_error_s == float("inf")
    grown = {**_cause("flow.gain"), "growth": {"from_s": 310.0}}
    assert (
        mark(truth, {"verdict": "named", "causes": [grown], "unexplained": []}).onset_error_s
        == 10.0
    )
    wrong = mark(
        truth, {"verdict": "named", "causes": [_cause("flow.slope", 300.0)], "unexplained": []}
    )
    assert not wrong.exact and wrong.onset_error_s is None and wrong.said == ((0.97, False),)


def test_of_causes_said_one_answers_to_one_hidden_effect(hidden: Any) -> None:
    hidden_one = {
        "id": "flow.gain",
        "size": 1.0,
        "z": 20.0,
        "equal": {"scale.gain": 1.0},
        "near": {},
        "size_defined": True,
        "onset_s": None,
    }
    both = {
        "verdict": "named",
        "unexplained": [],
        "causes": [_cause("scale.gain", probability=0.92), _cause("flow.gain", probability=0.99)],
    }
    marked = hidden.score.mark(_truth(category="coarse", causes=[hidden_one]), both)
    assert marked.said == ((0.99, True), (0.92, False)) and not marked.exact
    three = [{**hidden_one, "id": i, "equal": {}} for i in ("gate.slow", "flow.leak", "shaft.gain")]
    answer = {
        "verdict": "named",
        "unexplained": [],
        "causes": [_cause(c["id"]) for c in reversed(three)],
    }
    assert hidden.score.mark(_truth(category="triple", causes=three), answer).exact


@pytest.mark.parametrize(
    ("entries", "stage", "first", "every"),
    [
        (
            [
                {"channel": "flow", "variable": "roll_deg"},
                {"channel": "flow", "variable": "speed_used_mps"},
            ],
            True,
            True,
            True,
        ),
        (
            [{"channel": "flow", "variable": "roll_deg", "variables": ["roll_deg", "speed_mps"]}],
            True,
            True,
            True,
        ),
        ([{"channel": "flow", "variable": "roll_deg"}], True, True, False),
        (
            [{"channel": "flow", "variable": "roll_deg", "variables": ["roll_deg", "time_s"]}],
            True,
            True,
            False,
        ),
        (
            [
                {"channel": "gate", "variable": "time_s"},
                {"channel": "flow", "variable": "roll_deg"},
            ],
            False,
            False,
            False,
        ),
        ([], False, False, False),
    ],
)
def test_a_term_is_judged_by_stage_and_variables(
    hidden: Any, entries: list[dict[str, Any]], stage: bool, first: bool, every: bool
) -> None:
    speeds = ["speed_mps", "wheel_speed_mps", "speed_used_mps"]
    outside = {
        "name": "product.flow",
        "class": "product",
        "channel": "flow",
        "z": 20.0,
        "variables": ["roll_deg", *speeds],
        "each": [["roll_deg"], speeds],
    }
    answer = {"verdict": "unexplained", "causes": [], "unexplained": entries}
    marked = hidden.score.mark(_truth(category="term", outside=outside), answer)
    assert (marked.right_stage, marked.right_variable, marked.all_variables) == (
        stage,
        first,
        every,
    )
    named = {"verdict": "named", "causes": [_cause("flow.slope")], "unexplained": []}
    assert hidden.score.mark(_truth(category="term", outside=outside), named).falsely_named is True


def test_a_poor_log_may_be_refused_and_the_figures_count_what_they_say(hidden: Any) -> None:
    mark = hidden.score.mark
    refused = {"verdict": "not_judged", "causes": [], "unexplained": []}
    nothing = {**refused, "verdict": "none"}
    assert mark(_truth(category="healthy_coarse"), refused).false_alarm is False
    strong = _truth(
        causes=[
            {
                "id": "flow.gain",
                "size": 1.0,
                "z": 20.0,
                "equal": {},
                "near": {},
                "size_defined": True,
                "onset_s": 300.0,
                "course": {},
            }
        ]
    )
    marks = [
        mark(strong, nothing),
        mark(strong, refused),
        mark(_truth(category="healthy_coarse"), nothing),
        mark(
            _truth(category="none"),
            {"verdict": "named", "causes": [_cause("flow.gain")], "unexplained": []},
        ),
    ]
    lines = hidden.class_report.sections(marks)
    assert any("z >= 12 is hidden | <= 1 % | 1/2: short" in line for line in lines)
    assert any("p >= 0.9: right | >= 90 % | 0/1: short" in line for line in lines)
    assert any("5 to 0.5 Hz | <= 2 % | 0/1: reached" in line for line in lines)
    said = hidden.report.list_probability_lines(marks, "runs")
    assert any(line.startswith("| 0.95 to 0.99 | 1 | 0.970 | 0/1 |") for line in said)
