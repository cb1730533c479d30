"""Logs together: weak effects add up, wear and repair are told apart, products are seen through, nothing is made up."""
import numpy as np
import pytest

from control.diagnosis.season.courses import OneLog, courses, selected
from control.diagnosis.season.evidence import Form

NAMES = ("flow.gain", "flow.fill_falloff", "flow.slope", "gate.offset")
GRAM = np.array([[1.0, 0.6, 0.1, 0.0], [0.6, 1.0, 0.0, 0.1], [0.1, 0.0, 1.0, 0.0], [0.0, 0.1, 0.0, 1.0]])


def log(rng: np.random.Generator, number: int, truth: dict[str, float], sd: float = 1.0, machine: str = "m",
        **shared: str) -> OneLog:
    """A log whose sizes have errors of about `sd`."""
    normal = GRAM / sd ** 2
    truly = np.array([truth.get(name, 0.0) for name in NAMES])
    right = normal @ truly + np.linalg.cholesky(normal) @ rng.normal(size=4)
    return OneLog(f"{machine}{number}", machine, float(number), (Form(NAMES, tuple(map(tuple, normal)), tuple(right)),),
                  shared)


def test_an_effect_too_weak_for_one_log_is_found_in_thirty() -> None:
    rng = np.random.default_rng(1)
    logs = [log(rng, k, {"flow.fill_falloff": 3.35}) for k in range(30)]
    one = [selected([each]) for each in logs]
    assert sum(bool(found) for found in one) < 15
    assert [name for name, _ in selected(logs)] == ["flow.fill_falloff"]
    (course,), shared = courses(logs)
    assert course.mean == pytest.approx(3.35, abs=2.0 * course.mean_half / 1.645) and not shared


def test_a_healthy_season_has_no_effects() -> None:
    rng = np.random.default_rng(2)
    found = [selected([log(rng, k, {}) for k in range(30)]) for _ in range(60)]
    assert sum(bool(one) for one in found) <= 1


def test_wear_and_its_repair() -> None:
    rng = np.random.default_rng(3)
    logs = [log(rng, k, {"flow.fill_falloff": 0.5 * k if k < 24 else 0.0}) for k in range(40)]
    (course,), _ = courses(logs)
    assert course.effect == "flow.fill_falloff" and len(course.pieces) == 2
    wear, after = course.pieces
    assert wear.per_day == pytest.approx(0.5, abs=0.1) and wear.per_day_p < 1e-4
    assert course.breaks_d[0] == pytest.approx(23.5, abs=1.1)
    assert abs(after.begin) < 2.0 * after.begin_half and after.per_day_p > 0.01


def test_a_size_that_scatters_from_log_to_log_is_not_cut_to_pieces() -> None:
    rng = np.random.default_rng(4)
    logs = [log(rng, k, {"flow.gain": 8.0 + 3.0 * rng.normal()}, sd=0.2) for k in range(40)]
    found, _ = courses(logs)
    course = next(one for one in found if one.effect == "flow.gain")
    assert len(course.pieces) == 1
    assert course.half[0] > 3.0                         # the scatter counts, not only each log's own error


def test_a_product_that_flows_otherwise_is_shared_and_taken_off_the_courses() -> None:
    rng = np.random.default_rng(5)
    logs = []
    for machine in ("a", "b", "c", "d"):
        for k in range(24):
            product = "urea" if (k // 4 + ord(machine)) % 3 else "compound"
            truth = {"flow.gain": (5.0 if product == "compound" else 0.0) + (0.0 if machine != "d" else -6.0)}
            logs.append(log(rng, k, truth, machine=machine, product=product, operator="o" + machine))
    found, shared = courses(logs)
    (seen,) = shared
    assert (seen.factor, seen.level, seen.effect) == ("product", "compound", "flow.gain")
    assert seen.size == pytest.approx(5.0, abs=1.5 * seen.half)
    by_machine = {one.machine: one for one in found if one.effect == "flow.gain"}
    assert by_machine["d"].mean == pytest.approx(-6.0, abs=0.8)
    assert all(len(one.pieces) == 1 for one in by_machine.values())


def test_logs_that_tell_nothing_are_no_trouble() -> None:
    nothing = Form(NAMES, tuple(map(tuple, np.zeros((4, 4)))), (0.0,) * 4)
    assert courses([OneLog("a", "m", 0.0, ()), OneLog("b", "m", 1.0, (nothing,))]) == ([], [])
    assert courses([]) == ([], [])
