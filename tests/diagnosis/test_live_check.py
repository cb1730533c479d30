"""The live check: what begins is said within minutes, nothing is said of a healthy machine or
of a single odd look."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from topdress.control.diagnosis.judgement.noise import Noise
from topdress.control.diagnosis.live.growing_log_check import (
    CHECK_INTERVAL_S,
    DIAGNOSIS_INTERVAL_S,
    MAX_STRETCH_S,
    RETRY_INTERVAL_S,
    LiveCheck,
    find_departure,
)
from topdress.control.diagnosis.live.sequential_test import (
    ALARM_THRESHOLD,
    ChangePoint,
    SequentialTest,
)
from topdress.control.diagnosis.result import (
    Cause,
    Diagnosis,
    FieldCost,
    ModelDeviation,
    Rival,
    Size,
    SourceSummary,
    UnexplainedStructure,
)
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.machine.machine import Machine

from tests.diagnosis.logs import speeds

WHEEL, GATE = (
    EffectInstance("speed.wheel_radius", 1.0, 300.0),
    EffectInstance("gate.offset", 0.1, 500.0),
)
MACHINE = Machine()


def wheel_log(seconds: float, wrong_from_s: float = np.inf, percent: float = 4.0) -> dict[str, Any]:
    """Wheel and GNSS, ten rows a second; the wheel reads too much from some time on."""
    time_s = np.arange(0.0, seconds, 0.1)
    factor = np.where(time_s >= wrong_from_s, 1.0 + percent / 100.0, 1.0)
    return speeds(4, time_s, 1.3 + 0.2 * np.sin(time_s / 7.0), factor) | {
        "state": np.full(len(time_s), "working", object)
    }


def change_points(columns: dict[str, Any], machine: Machine) -> list[ChangePoint]:
    """The test asked once, of the end of a log."""
    time_s = columns["time_s"]
    return SequentialTest(machine)(
        lambda since_s: {name: column[time_s >= since_s] for name, column in columns.items()},
        float(time_s[-1]),
    )


def fed(check: LiveCheck, columns: dict[str, Any]) -> list[tuple[float, ModelDeviation | None]]:
    time_s, seen = columns["time_s"], []
    for at_s in np.arange(CHECK_INTERVAL_S, time_s[-1] + CHECK_INTERVAL_S, CHECK_INTERVAL_S):
        new = (time_s >= at_s - CHECK_INTERVAL_S) & (time_s < at_s)
        check.add_rows({name: array[new] for name, array in columns.items()})
        if check.is_due:
            seen.append((check.now_s, check.check_rows()))
    return seen


def diagnosis(*causes: Cause) -> Diagnosis:
    return Diagnosis(
        SourceSummary("", "run", 1, 1.0, "m"),
        (),
        "named" if causes else "none",
        causes,
        (),
        (),
        None,
        (),
        None,
    )


def cause(effect_id: str, *rivals: Rival, onset_s: float | None = None) -> Cause:
    return Cause(
        effect_id,
        Size(-4.0, -5.0, -3.0, "%"),
        onset_s,
        0.99,
        rivals,
        None,
        "",
        FieldCost(-4.0, 0.0),
    )


def test_the_test_sees_a_wheel_that_begins_to_read_too_much_and_nothing_before() -> None:
    calm = change_points(wheel_log(500.0), MACHINE)
    assert [one.group for one in calm] == ["speed"] and calm[0].evidence < ALARM_THRESHOLD
    (found,) = change_points(wheel_log(500.0, 400.0), MACHINE)
    assert found.part.id.startswith("speed.wheel_") and found.evidence > ALARM_THRESHOLD
    assert found.part.onset_s == pytest.approx(400.0, abs=10.0)
    assert found.part.size == pytest.approx(4.0, abs=1.0)


def test_a_departure_is_said_with_its_time_and_its_name() -> None:
    seen = fed(LiveCheck(MACHINE), wheel_log(870.0, 500.0))
    said = [(at_s, one) for at_s, one in seen if one is not None]
    assert said and 500.0 < said[0][0] <= 660.0  # without a name at first: a minute more
    assert said[0][1].since_s == pytest.approx(500.0, abs=20.0)
    assert said[-1][1].cause.startswith("speed.wheel") and said[-1][1].since_s == pytest.approx(
        500.0, abs=20.0
    )


def shaft_log(seconds: float, wrong_from_s: float, percent: float) -> dict[str, Any]:
    """A shaft alone, ten rows a second, another speed every twenty seconds; it turns too slowly
    from some time on."""
    rng, time_s = np.random.default_rng(5), np.arange(0.0, seconds, 0.1)
    asked = np.array([40.0, 55.0, 70.0])[(time_s // 20.0).astype(int) % 3]
    turns = np.convolve(np.r_[np.full(9, asked[0]), asked], np.ones(10) / 10.0, "valid")
    factor = np.where(time_s >= wrong_from_s, 1.0 + percent / 100.0, 1.0)
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": asked,
        "state": np.full(len(time_s), "working", object),
        "shaft_rpm": factor * turns + 0.3 * rng.standard_normal(len(time_s)),
    }


def test_every_effect_of_a_group_is_tried_and_the_likeliest_one_is_said() -> None:
    (found,) = change_points(shaft_log(500.0, 400.0, -5.0), MACHINE)
    assert found.part.id in ("shaft.gain", "shaft.load_droop") and found.evidence > ALARM_THRESHOLD
    assert found.part.onset_s == pytest.approx(400.0, abs=5.0)


def test_the_statistic_grows_by_one_a_sample_where_nothing_begins() -> None:
    """Its mean, by theory; it passes the bar in none of these logs."""
    most = []
    for seed in range(12):
        rng, columns = np.random.default_rng(seed), wheel_log(620.0)
        columns["wheel_speed_mps"] = columns["speed_mps"] + 0.03 * rng.standard_normal(
            len(columns["time_s"])
        )
        most.append(change_points(columns, MACHINE)[0].evidence)
    assert (
        np.log(100.0) - 3.0 < np.median(most) < np.log(600.0) + 1.0 and max(most) < ALARM_THRESHOLD
    )


@pytest.mark.exam
def test_times_are_those_of_the_log_however_late_it_is() -> None:
    late = wheel_log(2070.0, 1700.0)
    (found,) = change_points(late, MACHINE)
    assert found.part.onset_s == pytest.approx(1700.0, abs=10.0)
    said = [one for _, one in fed(LiveCheck(MACHINE), late) if one is not None]
    assert said and all(one.since_s == pytest.approx(1700.0, abs=20.0) for one in said)


def test_a_beginning_that_the_diagnosis_refutes_is_not_said_and_is_asked_again() -> None:
    asked: list[float] = []

    def diagnose(columns: Any, _: Machine) -> Diagnosis:
        asked.append(float(columns["time_s"][-1]))
        return diagnosis()

    check = LiveCheck(MACHINE, lambda *_: [ChangePoint("speed", WHEEL, 50.0)], diagnose)
    seen = fed(check, wheel_log(800.0))
    assert all(one is None for _, one in seen)
    assert asked == pytest.approx([330.0, 390.0, 450.0, 510.0, 570.0, 630.0, 690.0, 750.0], abs=0.2)


def test_another_channels_finding_does_not_bear_it_out() -> None:
    check = LiveCheck(
        MACHINE,
        lambda *_: [ChangePoint("speed", WHEEL, 50.0)],
        lambda *_: diagnosis(cause("flow.gain")),
    )
    assert all(one is None for _, one in fed(check, wheel_log(600.0)))


def test_a_beginning_is_borne_out_by_what_begins_or_by_the_same_name() -> None:
    def said(found: Cause) -> list[ModelDeviation | None]:
        check = LiveCheck(
            MACHINE, lambda *_: [ChangePoint("metering", GATE, 50.0)], lambda *_: diagnosis(found)
        )
        return [one for _, one in fed(check, wheel_log(600.0)) if one is not None]

    assert not said(cause("flow.hopper_head"))  # all along, and another name
    assert said(cause("flow.hopper_head", onset_s=480.0))[0].since_s == pytest.approx(480.0)
    assert said(cause("gate.offset"))[0].since_s == pytest.approx(500.0)


def test_a_beginning_below_the_bar_is_not_diagnosed() -> None:
    check = LiveCheck(
        MACHINE,
        lambda *_: [ChangePoint("speed", WHEEL, ALARM_THRESHOLD - 0.1)],
        lambda *_: pytest.fail("diagnosed"),
    )
    assert all(one is None for _, one in fed(check, wheel_log(800.0)))


def test_the_drift_is_learnt_of_the_looks_before_and_not_of_what_begins_now() -> None:
    """A change would pass for a noise that drifts as much as it changed."""
    rolling = SequentialTest(MACHINE)
    quiet, loud = (Noise((-3.0, 0.0, float(np.log(sd)), 5.0)) for sd in (0.1, 0.9))
    first = rolling._find_usual_noise("shaft", quiet)
    assert first == quiet  # nothing learnt yet
    for at_s in range(30, 1500, 30):
        rolling._until_s = float(at_s)
        usual = rolling._find_usual_noise("shaft", quiet if at_s < 1300 else loud)
    assert usual.slow_sd == pytest.approx(0.1)
    for at_s in range(1500, 6000, 30):  # what has been there for an hour is its noise
        rolling._until_s = float(at_s)
        usual = rolling._find_usual_noise("shaft", loud)
    assert usual.slow_sd == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("until_s", "ended_s", "said"),
    [
        pytest.param(380.0, np.inf, False, id="seen_once"),
        pytest.param(800.0, np.inf, True, id="goes_on"),
        pytest.param(800.0, 320.0, False, id="of_two_seconds"),
    ],
)
def test_what_has_no_name_must_be_seen_twice(until_s: float, ended_s: float, said: bool) -> None:
    """A minute apart, and in rows of its own: a moment's noise has no name either, and a fault
    of two seconds is seen by everything that looks back as far as to it."""

    def nameless(columns: Any, _: Machine) -> Diagnosis:
        left = UnexplainedStructure("speed", "", 0.3, 0.05, 0.02, "m/s")
        there = bool(columns["time_s"][0] < ended_s)
        return (
            replace(diagnosis(), verdict="unexplained", unexplained=(left,))
            if there
            else diagnosis()
        )

    def begins(_: Any, now_s: float) -> list[ChangePoint]:
        return (
            [ChangePoint("speed", EffectInstance("speed.wheel_radius", 1.0, 400.0), 50.0)]
            if now_s < until_s
            else []
        )

    seen = fed(LiveCheck(MACHINE, begins, nameless), wheel_log(800.0))
    times = [at_s for at_s, one in seen if one is not None]
    assert bool(times) is said and all(at_s >= seen[0][0] + RETRY_INTERVAL_S for at_s in times)


def by_quarter(*causes: tuple[Cause, ...], asked: list[int]) -> Any:
    """A diagnosis that answers for the quarter that it is asked about."""

    def diagnose(columns: Any, _: Machine) -> Diagnosis:
        asked.append(round(float(columns["time_s"][-1]) / DIAGNOSIS_INTERVAL_S) - 1)
        return diagnosis(*causes[asked[-1]])

    return diagnose


def test_what_was_there_from_the_start_must_be_found_twice() -> None:
    asked: list[int] = []
    flow = (cause("flow.gain"),)
    check = LiveCheck(MACHINE, lambda *_: [], by_quarter(flow, (), flow, flow, (), (), asked=asked))
    quarters = [
        one
        for at_s, one in fed(check, wheel_log(6 * DIAGNOSIS_INTERVAL_S + 100.0))
        if at_s % DIAGNOSIS_INTERVAL_S < CHECK_INTERVAL_S
    ]
    assert [one is not None for one in quarters] == [False, False, False, True, True, False]
    # the first says nothing alone: it is asked once the second says so
    assert asked == [1, 3, 2, 4, 5]


def test_healthy_work_is_diagnosed_once_in_half_an_hour() -> None:
    asked: list[int] = []
    check = LiveCheck(MACHINE, lambda *_: [], by_quarter(*6 * [()], asked=asked))
    fed(check, wheel_log(6 * DIAGNOSIS_INTERVAL_S + 100.0))
    assert asked == [1, 3, 5]


def test_a_quarter_that_departs_alone_is_followed_by_the_next() -> None:
    asked: list[int] = []
    flow = (cause("flow.gain"),)
    check = LiveCheck(MACHINE, lambda *_: [], by_quarter((), flow, flow, (), asked=asked))
    seen = fed(check, wheel_log(4 * DIAGNOSIS_INTERVAL_S + 100.0))
    assert asked[:3] == [1, 0, 2]
    assert next(at_s for at_s, one in seen if one is not None) == pytest.approx(
        3 * DIAGNOSIS_INTERVAL_S, abs=CHECK_INTERVAL_S
    )


def test_what_is_only_suspected_is_not_said() -> None:
    assert find_departure(diagnosis(cause("flow.gain", Rival("unknown", 0.5)))) is None
    told = find_departure(diagnosis(cause("flow.gain", Rival("flow.fill_falloff", 0.4))))
    assert told is not None and not told.certain and told.percent == -4.0
    assert find_departure(diagnosis(cause("flow.fill_falloff"))).adoptable
    assert not find_departure(diagnosis(cause("flow.fill_falloff", onset_s=3.0))).adoptable
    for gain in ("flow.gain", "scale.gain"):
        assert not find_departure(diagnosis(cause(gain))).adoptable, (
            "a scale that nothing confirms is not adopted from"
        )


@pytest.mark.parametrize("state", ["held", None])
def test_standing_still_costs_no_look_and_a_log_that_does_not_say_is_looked_at(
    state: str | None,
) -> None:
    looks: list[int] = []
    columns = {name: array for name, array in wheel_log(600.0).items() if name != "state" or state}
    columns |= {"state": np.full(6000, state, object)} if state else {}
    fed(LiveCheck(MACHINE, lambda *_: looks.append(1) or [], lambda *_: diagnosis()), columns)
    assert bool(looks) is (state is None)


def test_rows_may_lack_a_column_and_old_ones_are_forgotten() -> None:
    kept: list[Any] = []
    check = LiveCheck(MACHINE, lambda rows, _: kept.append(rows(0.0)) or [], lambda *_: diagnosis())
    columns = wheel_log(4000.0)
    fed(check, {name: array[:20_000] for name, array in columns.items() if name != "state"})
    fed(check, {name: array[20_000:] for name, array in columns.items()})
    assert check.now_s == pytest.approx(3999.9)
    assert len(kept[-1]["time_s"]) == len(kept[-1]["state"])
    assert np.ptp(kept[-1]["time_s"]) == pytest.approx(
        MAX_STRETCH_S + DIAGNOSIS_INTERVAL_S, abs=CHECK_INTERVAL_S
    )
