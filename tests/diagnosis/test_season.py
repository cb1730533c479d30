"""Logs together: weak effects add up, wear and repair are told apart, products are seen
through, nothing is made up."""

import numpy as np
import pytest
from topdress.control.diagnosis.season.effect_timelines import SeasonCause, fit_season
from topdress.control.diagnosis.season.log_evidence import QuadraticForm, SeasonLog, stack_logs
from topdress.control.diagnosis.season.mixed_model import find_season_causes as causes_found

NAMES = ("flow.gain", "flow.fill_falloff", "flow.slope", "gate.offset")
GRAM = np.array(
    [[1.0, 0.6, 0.1, 0.0], [0.6, 1.0, 0.0, 0.1], [0.1, 0.0, 1.0, 0.0], [0.0, 0.1, 0.0, 1.0]]
)


def log(
    rng: np.random.Generator,
    number: int,
    truth: dict[str, float],
    sd: float = 1.0,
    machine: str = "m",
    gram: np.ndarray = GRAM,
    **shared: str,
) -> SeasonLog:
    """A log whose sizes have errors of about `sd`."""
    sizes = np.array([truth.get(name, 0.0) for name in NAMES])
    return SeasonLog(
        f"{machine}{number}",
        machine,
        float(number),
        (form(rng, NAMES, gram / sd**2, sizes),),
        shared,
    )


def form(
    rng: np.random.Generator, names: tuple[str, ...], normal: np.ndarray, sizes: np.ndarray
) -> QuadraticForm:
    """What a log says of such sizes."""
    right = normal @ sizes + np.linalg.cholesky(normal) @ rng.normal(size=len(sizes))
    return QuadraticForm(names, tuple(map(tuple, normal)), tuple(right))


def courses(logs: list[SeasonLog]) -> tuple[list[SeasonCause], list[SeasonCause]]:
    fit = fit_season(logs)
    return list(fit.courses), list(fit.shared)


def selected(logs: list[SeasonLog]) -> list[tuple[str, float]]:
    every = stack_logs(logs)
    return [(every.names[one.effect], one.log_odds) for one in causes_found(every).causes]


def test_an_effect_too_weak_for_one_log_is_found_in_thirty() -> None:
    rng = np.random.default_rng(1)
    logs = [log(rng, k, {"flow.fill_falloff": 3.35}) for k in range(30)]
    one = [selected([each]) for each in logs]
    assert sum(bool(found) for found in one) < 15
    assert [name for name, _ in selected(logs)] == ["flow.fill_falloff"]
    (course,), shared = courses(logs)
    assert course.size == pytest.approx(3.35, abs=2.0 * course.half / 1.645) and not shared


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
    assert 0.5 * (wear.end_d + after.begin_d) == pytest.approx(23.5, abs=1.1)
    assert abs(after.begin) < 2.0 * after.begin_half and after.per_day_p > 0.01


def test_a_size_that_scatters_from_log_to_log_is_not_cut_to_pieces() -> None:
    rng = np.random.default_rng(4)
    logs = [log(rng, k, {"flow.gain": 8.0 + 3.0 * rng.normal()}, sd=0.2) for k in range(40)]
    found, _ = courses(logs)
    course = next(one for one in found if one.effect == "flow.gain")
    assert len(course.pieces) == 1
    # the scatter counts, not only each log's own error
    assert course.halves[0] > 3.0


def test_wear_whose_form_is_not_quite_right_is_one_line() -> None:
    """What the form is off by changes with the day's work and grows with the effect."""
    rng = np.random.default_rng(12)
    logs = [
        log(rng, k, {"flow.fill_falloff": 0.5 * k * float(np.exp(0.3 * rng.normal()))}, sd=0.5)
        for k in range(60)
    ]
    (course,), _ = courses(logs)
    assert len(course.pieces) == 1 and course.pieces[0].per_day == pytest.approx(0.5, abs=0.1)


def test_a_product_that_flows_otherwise_is_shared_and_taken_off_the_courses() -> None:
    rng = np.random.default_rng(5)
    logs = []
    for machine in ("a", "b", "c", "d"):
        for k in range(24):
            product = "urea" if (k // 4 + ord(machine)) % 3 else "compound"
            truth = {
                "flow.gain": (5.0 if product == "compound" else 0.0)
                + (0.0 if machine != "d" else -6.0)
            }
            logs.append(
                log(rng, k, truth, machine=machine, product=product, operator="o" + machine)
            )
    fit = fit_season(logs)
    found, (seen,) = fit.courses, fit.shared
    assert (seen.factor, seen.level, seen.effect) == ("product", "compound", "flow.gain")
    assert seen.size == pytest.approx(5.0, abs=1.5 * seen.half)
    by_machine = {one.level: one for one in found if one.effect == "flow.gain"}
    assert by_machine["d"].size == pytest.approx(-6.0, abs=0.8)
    assert all(len(one.pieces) == 1 for one in by_machine.values())
    sets = {(one.factor, one.level): one.probability for one in by_machine["d"].alternatives}
    assert sets == {
        ("machine", "d"): pytest.approx(0.5, abs=0.05),
        ("operator", "od"): pytest.approx(0.5, abs=0.05),
    }
    # whose it is, such a season does not say
    assert ("machine", "d", "operator", "od") in fit.same


def test_a_field_is_not_blamed_for_what_one_machine_shows_while_it_stands_there() -> None:
    """Four machines go from field to field together; one gets a new setting on the day of such
    a move."""
    rng = np.random.default_rng(8)
    logs = [
        log(
            rng,
            k,
            {"flow.gain": 4.0 if machine == "d" and k >= 20 else 0.0},
            sd=0.3,
            machine=machine,
            field=f"f{k // 10}",
        )
        for machine in "abcd"
        for k in range(40)
    ]
    (course,), shared = courses(logs)
    assert not shared and course.level == "d" and course.effect == "flow.gain"
    assert [(one.end_d, one.begin_d) for one in course.pieces] == [(19.0, 0.0), (39.0, 20.0)]
    assert course.pieces[-1].end == pytest.approx(4.0, abs=0.4)


def test_an_operator_is_not_blamed_for_the_product_that_he_spreads_more_of() -> None:
    rng, logs = np.random.default_rng(9), []
    for machine in "abcd":
        for k in range(40):
            product = "compound" if (k // 4 + ord(machine)) % 3 == 0 else "urea"
            by_li = 0.8 if product == "compound" else 0.2
            logs.append(
                log(
                    rng,
                    k,
                    {"flow.gain": 5.0 * (product == "compound")},
                    sd=0.3,
                    machine=machine,
                    product=product,
                    operator="Li" if rng.random() < by_li else "Wang",
                )
            )
    found, shared = courses(logs)
    assert [(one.factor, one.level) for one in shared] == [("product", "compound")] and not found


def test_a_gate_that_stands_surely_wrong_does_not_hide_what_a_product_does() -> None:
    """What the gate's form may leave to the flow is no more than the product shows in that
    machine's logs."""
    rng, gram, logs = np.random.default_rng(14), np.diag([9.0, 1.0, 1.0, 1e6]), list[SeasonLog]()
    gram[0, 3] = gram[3, 0] = 1.0
    for machine in "abcd":
        for k in range(24):
            product = "compound" if (k // 4 + ord(machine)) % 3 == 0 else "urea"
            truth = {
                "flow.gain": 5.0 * (product == "compound"),
                "gate.offset": 0.8 * (machine == "a"),
            }
            logs.append(log(rng, k, truth, machine=machine, gram=gram, product=product))
    fit = fit_season(logs)
    assert [(one.factor, one.level, one.effect) for one in fit.shared] == [
        ("product", "compound", "flow.gain")
    ]
    assert [(one.level, one.effect) for one in fit.courses] == [("a", "gate.offset")]
    sure = {(one.factor, one.level, one.effect) for one in fit.levels if one.probability > 0.5}
    assert sure == {("product", "compound", "flow.gain"), ("machine", "a", "gate.offset")}


@pytest.mark.exam
def test_what_the_forms_of_many_machines_may_leave_is_no_more_than_a_product_shows_on_them() -> (
    None
):
    """Half of them have a gate that stands surely wrong. Sizes scatter far more than a log
    errs: what each gate may leave, by the information without that scatter, is all that the
    product shows."""
    rng, logs = np.random.default_rng(15), list[SeasonLog]()
    gram = np.diag([100.0, 1.0, 1.0, 1e6])
    gram[0, 3] = gram[3, 0] = 1.0
    for machine in range(60):
        for k in range(4):
            truth = {
                "flow.gain": 5.0 * (k % 2) + rng.normal(),
                "gate.offset": (0.8, 0.0, -0.8, 0.0)[machine % 4],
            }
            logs.append(
                log(
                    rng,
                    k,
                    truth,
                    machine=f"m{machine}",
                    gram=gram,
                    product=("urea", "compound")[k % 2],
                )
            )
    assert [(one.factor, one.level) for one in fit_season(logs).shared] == [("product", "compound")]


@pytest.mark.exam
def test_of_look_alikes_on_many_machines_none_is_sure_because_all_bear_its_name() -> None:
    """A third has the one, the others the other, and the logs of a machine hardly tell which."""
    rng, close, names = np.random.default_rng(16), np.eye(4), NAMES[:2]
    close[0, 1] = close[1, 0] = 0.99
    logs = [
        log(
            rng,
            k,
            {names[machine % 3 == 0]: 6.0 * (-1.0) ** machine},
            machine=f"m{machine}",
            gram=close,
        )
        for machine in range(120)
        for k in range(3)
    ]
    sets = {
        one.level: {each.effect: each.probability for each in one.alternatives}
        for one in fit_season(logs).courses
    }
    said = [
        (sets.get(f"m{machine}", {}).get(name, 0.0), name == names[machine % 3 == 0])
        for machine in range(120)
        for name in names
    ]
    assert len(sets) > 115
    for low, high in ((0.0, 0.5), (0.5, 1.01)):
        p, true = np.array([one for one in said if low <= one[0] < high]).T
        assert true.mean() == pytest.approx(p.mean(), abs=0.1)
    assert max(p for p, true in said if not true) < 0.99


def test_another_machines_effect_does_not_give_this_ones_its_name() -> None:
    """Fill loss, on one machine too weak to be told from less flow, keeps its name beside a
    flow that is truly off."""
    rng, close = np.random.default_rng(12), GRAM.copy()
    close[0, 1] = close[1, 0] = 0.92
    logs = [
        log(rng, k, truth, machine=machine, gram=close)
        for k in range(40)
        for machine, truth in (
            ("a", {"flow.fill_falloff": 0.3 * k}),
            ("b", {"flow.fill_falloff": 1.05}),
            ("c", {"flow.gain": -60.0}),
        )
    ]
    found, _ = courses(logs)
    assert {(one.level, one.effect) for one in found} == {
        ("a", "flow.fill_falloff"),
        ("b", "flow.fill_falloff"),
        ("c", "flow.gain"),
    }
    assert next(one for one in found if one.level == "b").other_effects == ("flow.gain",)


def season_with_operators(rng: np.random.Generator, share: float = 0.6) -> list[SeasonLog]:
    """Wang, who drives most of five machines, loses 5 %; nobody else does anything."""
    return [
        log(rng, k, {"flow.gain": -5.0 * (name == "Wang")}, sd=0.5, machine=machine, operator=name)
        for machine in "abcde"
        for k in range(20)
        for name in ("Wang" if rng.random() < share else str(rng.choice(["Li", "Sun"])),)
    ]


def test_the_commonest_operator_is_examined_as_any_other() -> None:
    fit = fit_season(season_with_operators(np.random.default_rng(21)))
    assert [(one.factor, one.level, one.effect) for one in fit.shared] == [
        ("operator", "Wang", "flow.gain")
    ]
    assert not fit.courses and abs(fit.shared[0].size + 5.0) < fit.shared[0].half * 2.0
    others = {
        one.level: one for one in fit.levels if one.factor == "operator" and one.level != "Wang"
    }
    assert set(others) == {"Li", "Sun"} and all(
        abs(one.size) < 2.0 * one.half for one in others.values()
    )


def test_what_scatters_about_shared_causes_is_what_all_of_them_leave() -> None:
    """Whichever was made first: 20 % are three standard errors of a variance by 360 logs, a
    sixth of them spent."""
    rng, by = (
        np.random.default_rng(23),
        {"Wang": -5.0, "Li": 0.0, "Sun": 3.0, "urea": 0.0, "compound": 4.0},
    )
    logs = []
    for machine in "abcdefghijkl":
        for k in range(30):
            operator, product = (
                str(rng.choice(["Wang", "Li", "Sun"])),
                str(rng.choice(["urea", "compound"])),
            )
            logs.append(
                log(
                    rng,
                    k,
                    {"flow.gain": by[operator] + by[product] + rng.normal()},
                    sd=0.3,
                    machine=machine,
                    product=product,
                    operator=operator,
                )
            )
    season = causes_found(stack_logs(logs))
    scatter = [float(one.scatter[0]) for one in season.causes]
    assert len(scatter) >= 3 and scatter == pytest.approx([1.0] * len(scatter), rel=0.2)


@pytest.mark.exam
def test_ninety_of_a_hundred_intervals_hold_the_truth() -> None:
    """Of all operators of twelve seasons, told or not: 28 of 36 or more are what 90 % give in
    98 of 100 such tests."""
    rng, held = np.random.default_rng(22), list[bool]()
    for _ in range(12):
        held += [
            abs(one.size - (-5.0 if one.level == "Wang" else 0.0)) <= one.half
            for one in fit_season(season_with_operators(rng)).levels
            if one.factor == "operator"
        ]
    assert len(held) == 36 and 28 <= sum(held), sum(held)


@pytest.mark.parametrize("after", [1, 2, 3])
def test_a_repair_is_told_with_its_probability_from_the_first_log_after(after: int) -> None:
    rng = np.random.default_rng(23)
    logs = [log(rng, k, {"flow.gain": 8.0 if k < 20 else 0.0}, sd=0.8) for k in range(20 + after)]
    (course,) = fit_season(logs).courses
    change = course.changes[-1]
    assert change.logs_after == after and change.time_d == 19.5 and change.repair > 0.9
    assert abs(course.pieces[-1].end) < course.pieces[-1].end_half
    never = fit_season(logs[:20]).courses[0]
    assert not never.changes and never.pieces[-1].end == pytest.approx(8.0, abs=1.0)


def test_look_alikes_are_a_set_and_stay_one_with_more_logs() -> None:
    rng, close = np.random.default_rng(24), np.eye(4)
    close[0, 1] = close[1, 0] = 0.9995
    logs = [log(rng, k, {"flow.gain": 6.0}, gram=close) for k in range(30)]
    for count in (5, 10, 30):
        (course,) = fit_season(logs[:count]).courses
        sets = {one.effect: one.probability for one in course.alternatives}
        assert set(sets) == {"flow.gain", "flow.fill_falloff"} and min(sets.values()) > 0.05


def test_a_scale_reads_wrong_on_a_machine_and_by_nobodys_hand() -> None:
    """Wang loses 2 %, machine e's scale reads 5 % more; the logs hardly tell one from the other."""
    rng, names, logs = np.random.default_rng(25), ("flow.gain", "scale.gain"), list[SeasonLog]()
    normal = 40.0 * np.array([[1.0, 0.99999], [0.99999, 1.0]])
    for one in season_with_operators(rng):
        truly = np.array([-2.0 * (one.shared["operator"] == "Wang"), 5.0 * (one.machine == "e")])
        logs.append(one._replace(forms=(form(rng, names, normal, truly),)))
    fit = fit_season(logs)
    (wang,) = fit.shared
    assert (wang.factor, wang.level, wang.effect, wang.other_effects) == (
        "operator",
        "Wang",
        "flow.gain",
        (),
    )
    (course,) = fit.courses
    assert course.level == "e" and {course.effect, *course.other_effects} == set(names)
    assert {one.factor for one in fit.levels if one.effect == "scale.gain"} <= {"machine", "fleet"}


def test_a_machine_called_a_scale_keeps_its_only_operators_flow_in_the_set() -> None:
    """Whose it is and what it is the logs cannot tell: machine's flow, machine's scale,
    operator's flow."""
    rng, names = np.random.default_rng(26), ("flow.gain", "scale.gain")
    normal = 4.0 * np.array([[1.0, 0.997], [0.997, 1.0]])
    logs = [
        SeasonLog(
            f"{machine}{k}",
            machine,
            float(k),
            (form(rng, names, normal, np.array([0.0, 5.0 * (machine == "a")])),),
            {"operator": f"o{machine}"},
        )
        for machine in "abc"
        for k in range(30)
    ]
    (course,) = fit_season(logs).courses
    assert course.effect == "scale.gain"
    assert {(one.factor, one.effect) for one in course.alternatives} == {
        ("machine", "scale.gain"),
        ("machine", "flow.gain"),
        ("operator", "flow.gain"),
    }


def within_tolerance(
    rng: np.random.Generator, logs: int, off: float, remembered: bool = True
) -> list[SeasonLog]:
    """A healthy machine whose flow is off by `off` tolerances, the same in all logs; each log
    alone cannot tell."""
    found = []
    for number in range(logs):
        plain, pull = GRAM / 0.3**2, (GRAM / 0.3**2)[:, 0] * 0.5
        # the tolerance (0.5 %) taken out
        normal = plain - np.outer(pull, pull) / (1.0 + 0.25 * plain[0, 0])
        pulls = pull / (1.0 + 0.25 * plain[0, 0])
        noise = np.linalg.cholesky(normal - np.outer(pulls, pulls)) @ rng.normal(size=4)
        of_log = QuadraticForm(NAMES, tuple(map(tuple, normal)), tuple(pulls * off + noise))
        if remembered:
            of_log = of_log._replace(
                open=("flow.gain_percent",), pulls=tuple((one,) for one in pulls)
            )
        found.append(SeasonLog(str(number), "m", float(number), (of_log,)))
    return found


def test_what_is_within_a_machines_tolerance_is_no_effect_however_many_its_logs() -> None:
    rng, offs = np.random.default_rng(6), np.random.default_rng(7).normal(size=20)
    told = [selected(within_tolerance(rng, 50, off)) for off in offs]
    assert sum(bool(one) for one in told) == 0
    forgotten = [selected(within_tolerance(rng, 50, off, remembered=False)) for off in offs]
    # what would be told if each log had a tolerance of its own
    assert sum(bool(one) for one in forgotten) > 5
    (course,), _ = courses(
        [
            one._replace(forms=tuple(_shifted(of_log) for of_log in one.forms))
            for one in within_tolerance(rng, 50, 0.0)
        ]
    )
    assert course.size == pytest.approx(8.0, abs=0.4)
    # the tolerance: 50 logs make it no less
    assert course.half == pytest.approx(1.645 * 0.5, rel=0.2)


def _shifted(one: QuadraticForm) -> QuadraticForm:
    """8 % of flow more."""
    return one._replace(right=tuple(np.array(one.right) + 8.0 * np.array(one.normal)[:, 0]))


def test_logs_that_tell_nothing_are_no_trouble() -> None:
    nothing = QuadraticForm(NAMES, tuple(map(tuple, np.zeros((4, 4)))), (0.0,) * 4)
    assert courses([SeasonLog("a", "m", 0.0, ()), SeasonLog("b", "m", 1.0, (nothing,))]) == ([], [])
    assert courses([]) == ([], [])
