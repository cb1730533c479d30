"""Hidden cases of the tuning half that were answered wrongly once, each for a reason of its own."""

from __future__ import annotations

import pytest
from topdress.control.diagnosis.runs.diagnose import diagnose_run

from tests.diagnosis.hidden import cases, class_plan, score
from tests.diagnosis.logs import HUANGHAI

pytestmark = pytest.mark.exam


def answered(
    number: int,
    seed: int,
    categories: tuple[str, ...],
    ids: tuple[str, ...] = (),
    split: str = "tuning",
):
    case = cases.one(number, seed, split, categories, ("run",), ids, None)
    return case, diagnose_run(case.columns, HUANGHAI)


WRONG_ONCE = [
    pytest.param(
        9,
        123,
        ("single", "lookalike", "pair"),
        id="a dead band between two commands: the likelihood has one narrow peak",
    ),
    pytest.param(14, 121, ("onset",), id="a dead band that begins, met four times after it began"),
    pytest.param(
        39,
        121,
        ("growth",),
        id="a growth that levels off, taken for drift though none was left beside it",
    ),
    pytest.param(
        48,
        125,
        ("growth", "onset", "temporary"),
        id="a head fouled for a while: its end was taken for a drift that begins again",
    ),
]


@pytest.mark.parametrize("number, seed, categories", WRONG_ONCE)
def test_a_case_that_was_wrong_once_is_right(number, seed, categories):
    case, found = answered(number, seed, categories)
    assert score.mark(case.truth, found.to_json()).honest, (
        case.truth["causes"],
        found.causes,
        found.unexplained,
    )


# Unseen cases of seeds 33105, 52906, 70411 and 88117 that were named at p 1.00 and wrong.
SURE_AND_WRONG = [
    pytest.param(26, 52906, id="a loss by roll: the lower tail of the readings was missing pulses"),
    pytest.param(56, 52906, id="loud uneven noise: its lower tail was missing pulses"),
    pytest.param(
        53, 33105, id="a log that is read a row late was a dead time, though the gate is late too"
    ),
    pytest.param(19, 70411, id="a delay of GNSS was measured in noise, at a row a second"),
    pytest.param(43, 70411, id="a delay of GNSS was measured in noise, in a foreign log"),
    pytest.param(53, 88117, id="a stall was a gain of -97 % and a dead band of 52 r/min"),
]


@pytest.mark.parametrize("number, seed", SURE_AND_WRONG)
def test_no_cause_is_sure_and_wrong(number, seed):
    wanted = class_plan.wanted(number, seed)
    case, found = answered(number, seed, (wanted.category,), wanted.ids, "unseen")
    said = score.mark(case.truth, found.to_json()).said
    assert all(right for p, right in said if p >= 0.9), (case.truth["causes"], found.causes)


TERMS_WRONG_ONCE = [
    pytest.param(
        4,
        22,
        "dead_zone",
        "dead_zone",
        id="a slope, as a drift stood for a part of what the dead zone did",
    ),
    pytest.param(
        73, 20, "product", "product", id="nothing: no term of the wheel could be over the speed"
    ),
    pytest.param(
        82,
        20,
        "product",
        "product",
        id="pitch in place of speed, the better one under a noise of its own",
    ),
    pytest.param(
        13,
        20,
        "dead_zone",
        "dead_zone",
        id="missing pulses beside it: dips that began with the roll",
    ),
]


@pytest.mark.parametrize("number, seed, kind, form", TERMS_WRONG_ONCE)
def test_a_term_that_was_wrong_once_is_right(number, seed, kind, form):
    case, found = answered(number, seed, ("term",), (kind,))
    mark = score.mark(case.truth, found.to_json())
    assert (mark.right_stage, mark.all_variables, found.causes) == (True, True, ()), (
        found.terms,
        found.causes,
    )
    assert found.terms[0].term["form"] == form


def test_loud_readings_of_a_gate_that_moves_little_are_no_stuck_gate():
    """A stop's gain was counted as if each reading spoke for itself; now by blocks of time, as
    every other effect's."""
    _, found = answered(77, 5151, ("healthy_loud",), split="unseen")
    assert (found.causes, found.verdict) == ((), "none")
