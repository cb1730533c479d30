"""What the owner of machines is one_log of a course: where it was repaired, whether it wears,
what it is at a time."""

from __future__ import annotations

import math

import pytest
from topdress.control.diagnosis.season.effect_timelines import (
    MAX_WEAR_SLOPE_P_VALUE,
    MIN_EFFECT_SHARE_REPAIRED,
    CoursePiece,
    SeasonCause,
    SeasonFit,
    _calc_repair_probability,
    is_wearing,
)
from topdress.control.diagnosis.season.log_evidence import LogWork
from topdress.control.diagnosis.season.mixed_model import Alternative
from topdress.control.diagnosis.season.season_cost import (
    LogCostInput,
    find_low_hoppers,
    find_size_at,
    is_still_there,
    rank_machines_by_cost,
)


def piece(
    begin_d: float,
    end_d: float,
    begin: float,
    end: float,
    *,
    half: float = 0.1,
    per_day_p: float = 1.0,
) -> CoursePiece:
    return CoursePiece(
        begin_d, end_d, begin, end, half, half, (end - begin) / (end_d - begin_d), per_day_p
    )


def course(*pieces: CoursePiece) -> SeasonCause:
    return SeasonCause("machine", "m01", "flow.gain", 0.0, 0.1, 1.0, 1, pieces=pieces)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_repair_makes_an_effect_less_and_not_as_large_the_other_way(sign: float) -> None:
    exact = 1e-6
    left = (1.0 - MIN_EFFECT_SHARE_REPAIRED) * 10.0
    assert _calc_repair_probability(
        sign * 10.0, exact, sign * (left - 0.1), exact
    ) == pytest.approx(1.0)
    assert _calc_repair_probability(
        sign * 10.0, exact, sign * (left + 0.1), exact
    ) == pytest.approx(0.0)
    assert _calc_repair_probability(sign * 10.0, exact, -sign * 9.0, exact) == pytest.approx(0.0), (
        "as wrong the other way"
    )
    assert _calc_repair_probability(sign * 10.0, 1.0, sign * left, 1.0) == pytest.approx(0.5), (
        "on the edge"
    )


def one_log(percent: dict[str, float], kg: float = 100.0, **shared: str) -> LogCostInput:
    return LogCostInput("a", "m01", 0.0, LogWork(1.0, kg, 1.0, 0.0, 0), percent, shared)


def alternative(effect: str, size: float, probability: float, machine: str = "m01") -> Alternative:
    return Alternative("machine", machine, effect, size, probability)


def test_the_dose_is_what_a_set_makes_likely_between_what_it_agrees_on_and_its_most() -> None:
    """Less flow, 5 %, or a scale that drifts: what the scale alone says wrong spreads nothing
    wrongly."""
    one = course(piece(0.0, 10.0, -5.0, -5.0))
    two_doses = one._replace(
        alternatives=(alternative("flow.gain", -5.0, 0.6), alternative("flow.leak", -3.0, 0.4))
    )
    no_dose = one._replace(
        alternatives=(alternative("flow.gain", -5.0, 0.6), alternative("scale.drift", 5.5, 0.4))
    )
    percent = {"flow.gain": 1.0, "flow.leak": 1.0}
    found = [
        each
        for set_ in (one, two_doses, no_dose)
        for each in rank_machines_by_cost([one_log(percent)], SeasonFit((set_,)))
    ]
    assert [(each.least_kg, each.most_kg) for each in found] == [(5.0, 5.0), (3.0, 5.0), (0.0, 5.0)]
    assert [each.wrong_kg for each in found] == pytest.approx([5.0, 4.2, 3.0])
    assert [each.now_percent for each in found] == pytest.approx([-5.0, -4.2, -3.0])
    assert [(each.now_least, each.now_most) for each in found] == [
        (-5.0, -5.0),
        (-3.0, -5.0),
        (0.0, -5.0),
    ]


@pytest.mark.parametrize("probability", [0.3, 0.995, 1.0])
def test_what_is_to_be_expected_lies_between_its_bounds_however_sure_the_cause_is(
    probability: float,
) -> None:
    cause = course(piece(0.0, 10.0, -3.755, -3.755))._replace(probability=probability)
    (found,) = rank_machines_by_cost([one_log({"flow.gain": 1.0})], SeasonFit((cause,)))
    assert found.now_percent == pytest.approx(-3.755 * probability)
    assert found.now_most <= found.now_percent <= found.now_least


def test_the_sums_of_a_machine_are_the_same_in_any_order_of_arrival() -> None:
    logs = [one_log({"flow.gain": 1.0}, kg)._replace(key=str(kg)) for kg in (0.1, 0.2, 0.3, 1e6)]
    fit = SeasonFit((course(piece(0.0, 10.0, -5.0, -5.0)),))
    assert rank_machines_by_cost(logs, fit) == rank_machines_by_cost(logs[::-1], fit)


def test_what_a_machine_does_now_stands_apart_from_its_operators_share() -> None:
    by_li = SeasonCause("operator", "Li", "flow.gain", -4.0, 0.1, 1.0, 9)
    (one,) = rank_machines_by_cost(
        [one_log({"flow.gain": 1.0}, operator="Li")],
        SeasonFit((course(piece(0.0, 9.0, 1.0, 1.0)),), (by_li,)),
    )
    assert one.now_percent == 1.0 and one.others_percent == -4.0 and one.wrong_kg == 3.0
    (other,) = rank_machines_by_cost(
        [one_log({"flow.gain": 1.0}, operator="Wang")], SeasonFit((), (by_li,))
    )
    assert other.others_percent == 0.0 and not other.costs


def test_what_was_repaired_is_not_there_any_more() -> None:
    gone = course(piece(0.0, 30.0, 0.0, 10.0), piece(32.0, 60.0, 0.0, 0.0))
    assert not is_still_there(gone) and is_still_there(course(piece(0.0, 9.0, 1.0, 1.0)))


def test_it_wears_where_its_last_piece_surely_grows_away_from_zero() -> None:
    sure, unsure = 0.5 * MAX_WEAR_SLOPE_P_VALUE, 2.0 * MAX_WEAR_SLOPE_P_VALUE
    assert is_wearing(course(piece(0.0, 10.0, 1.0, 2.0, per_day_p=sure)))
    assert is_wearing(course(piece(0.0, 10.0, -1.0, -2.0, per_day_p=sure)))
    assert not is_wearing(course(piece(0.0, 10.0, 1.0, 2.0, per_day_p=unsure)))
    assert not is_wearing(course(piece(0.0, 10.0, 2.0, 1.0, per_day_p=sure))), "it gets better"
    assert not is_wearing(
        course(
            piece(0.0, 10.0, 1.0, 2.0, per_day_p=sure), piece(12.0, 20.0, 0.5, 0.4, per_day_p=sure)
        )
    )


@pytest.mark.parametrize(
    ("time_d", "size"),
    [
        (-5.0, 1.0),
        (0.0, 1.0),
        (2.5, 1.5),
        (10.0, 3.0),
        (10.5, 8.0),
        (12.0, 8.0),
        (14.0, 7.0),
        (16.0, 6.0),
        (99.0, 6.0),
    ],
)
def test_a_size_at_a_time_lies_on_its_piece(time_d: float, size: float) -> None:
    """Before the first and after the last as there; between two pieces as the next begins."""
    one = course(piece(0.0, 10.0, 1.0, 3.0), piece(12.0, 16.0, 8.0, 6.0))
    assert math.isclose(find_size_at(one, time_d), size)


def test_a_piece_of_one_log_has_one_size() -> None:
    assert find_size_at(course(CoursePiece(3.0, 3.0, 2.0, 2.0, 0.1, 0.1, 0.0, 1.0)), 7.0) == 2.0


def test_the_owner_reads_the_dearest_first() -> None:
    """Machines by what they spread wrongly, then by what they may have; the causes of one
    likewise."""

    def of(machine: str, effect: str, size: float, *alternatives: Alternative) -> SeasonCause:
        return course(piece(0.0, 9.0, size, size))._replace(
            level=machine, effect=effect, alternatives=alternatives
        )

    logs = [
        one_log({"flow.gain": 1.0, "flow.leak": 1.0})._replace(machine=name)
        for name in ("a", "b", "c", "d")
    ]
    # dearer than a's
    unsure = (alternative("flow.gain", 2.0, 0.6, "d"), alternative("flow.leak", -9.0, 0.4, "d"))
    courses = (
        of("a", "flow.gain", 2.0),
        of("b", "flow.gain", -6.0),
        of("b", "flow.leak", -7.0),
        of("c", "flow.gain", 2.0),
        of("d", "flow.gain", 2.0, *unsure),
        of(
            "c",
            "flow.leak",
            1.0,
            alternative("flow.leak", 1.0, 0.5, "c"),
            alternative("flow.gain", -8.0, 0.5, "c"),
        ),
    )
    found = rank_machines_by_cost(logs, SeasonFit(courses))
    wrong = [(one.wrong_kg, one.most_kg) for one in found]
    assert wrong == sorted(wrong, reverse=True) and wrong[0][0] == 13.0 and len(set(wrong)) == 4
    for one in found:
        assert [(cost.kg, cost.most_kg) for cost in one.costs] == sorted(
            ((cost.kg, cost.most_kg) for cost in one.costs), reverse=True
        )
    assert [cost.cause.effect for cost in found[0].costs] == ["flow.leak", "flow.gain"]


def test_operators_stand_by_their_minutes_with_a_low_hopper() -> None:
    """Two who let it run low, each twice as long as the others together; nobody else is named."""
    logs = [
        LogCostInput(
            f"{who}{k}",
            "m01",
            k,
            LogWork(1.0, 100.0, 1.0, minutes + 0.01 * k, 0),
            {},
            {"operator": who},
        )
        for who, minutes in (("Ann", 18.0), ("Li", 20.0), ("Wang", 0.0), ("Xu", 0.5), ("Zhao", 1.0))
        for k in range(30)
    ]
    assert [one.operator for one in find_low_hoppers(logs)] == ["Li", "Ann"]
    assert not find_low_hoppers([one._replace(shared={"operator": "Li"}) for one in logs]), (
        "no others to hold against"
    )
