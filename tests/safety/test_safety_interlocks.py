"""Each interlock alone stops flow, and flow comes back when it is gone."""

from __future__ import annotations

from math import inf, nan

import pytest
from topdress.control.orders import Do, State, TargetSource
from topdress.control.readings import RangeBreach, RefusedSpeed, SpeedDoubt
from topdress.control.safety import INTERLOCKS

from tests.safety.steps import NEVER, creep, order, play, stop_and_go, tick

FORBIDDEN = [
    ("speed_silent", {"speed_used_mps": None}),
    ("speed_silent", {"speed_used_mps": nan}),
    ("low_speed", {"speed_mps": 0.29}),
    ("standstill", {"wheel_standstill": True}),
    ("position_lost", {"position_ok": False, "target_source": TargetSource.MAP}),
    ("position_lost", {"position_ok": False, "target_source": TargetSource.POINT}),
    ("position_lost", {"position_ok": False, "target_source": TargetSource.MAP_AND_CANOPY}),
    ("outside_field", {"landing_inside": False}),
    ("map_elsewhere", {"target_source": TargetSource.MAP, "map_elsewhere": True}),
    ("work_switch_up", {"work_switch": False}),
    ("log_failed", {"log_ok": False}),
    ("target_refused", {"target_rate_kg_ha": nan}),
    ("target_refused", {"target_rate_kg_ha": inf}),
    ("target_refused", {"target_rate_kg_ha": -1.0}),
    ("target_refused", {"target_rate_kg_ha": 1000.5}),
]


@pytest.mark.parametrize(("interlock", "changes"), FORBIDDEN)
def test_one_interlock_alone_stops_flow_and_lets_it_return(working, interlock, changes):
    run = working()
    verdict = run.tick(**changes)
    assert (verdict.state, verdict.flow_allowed, verdict.why_no_flow) == (
        State.WORKING,
        False,
        (interlock,),
    )
    assert run.tick().flow_allowed


def test_every_interlock_of_the_list_is_tested():
    seen = {interlock for interlock, _ in FORBIDDEN}
    elsewhere = {
        "not_working",
        "drive_silent",
        "reversing",
        "course_unknown",
        "below_range",
        "wheel_speed_missing",
        "gnss_speed_missing",
    }
    assert seen | elsewhere == set(INTERLOCKS)


@pytest.mark.parametrize("given_kg_ha", [0.0, 23.0])
def test_flow_below_the_range_of_the_machine_names_its_interlock_where_nothing_flows(
    working, given_kg_ha
):
    run = working()
    breach = RangeBreach(False, 12.0, given_kg_ha, 1.6)
    assert run.tick(2.9, range_breach=breach).flow_allowed
    named = ("below_range",) if given_kg_ha == 0.0 else ()
    assert run.tick(0.2, range_breach=breach).why_no_flow == named
    assert run.tick(0.05).flow_allowed


@pytest.mark.parametrize(
    ("missing", "interlock"),
    [("wheel_age_s", "wheel_speed_missing"), ("gnss_age_s", "gnss_speed_missing")],
)
def test_a_start_without_one_speed_sensor_names_the_sensor(new_run, missing, interlock):
    run = new_run()
    run.order(Do.READY)
    run.order(Do.START)
    assert run.tick(2.0, **{missing: NEVER}).why_no_flow == (interlock,)
    assert run.tick(0.5).flow_allowed


def test_gnss_alone_serves_where_the_wheel_was_never_heard_and_is_allowed_to_be_dead(new_run):
    run = new_run()
    run.order(Do.READY)
    run.order(Do.START)
    run.order(Do.ALLOW_NO_WHEEL, True)
    by_gnss = {"wheel_age_s": NEVER, "gnss_period_s": 0.1}
    assert run.tick(0.5, **by_gnss).flow_allowed
    assert run.tick(0.5, **by_gnss | {"gnss_period_s": 0.2}).flow_allowed


def test_no_flow_when_not_working(new_run):
    run = new_run()
    assert run.tick().why_no_flow == ("not_working",)
    run.order(Do.READY)
    assert run.tick().why_no_flow == ("not_working",)


@pytest.mark.parametrize(
    "source", [TargetSource.CANOPY, TargetSource.MANUAL, TargetSource.FALLBACK]
)
def test_position_is_needed_in_map_and_point_mode_only(working, source):
    assert working().tick(position_ok=False, target_source=source).flow_allowed


def test_no_known_field_forbids_nothing(working):
    assert working().tick(landing_inside=None).flow_allowed


@pytest.mark.parametrize("refused", RefusedSpeed)
def test_a_speed_that_is_not_believed_goes_on_with_flow_and_begins_none(working, refused):
    run, doubt = working(), {"speed_doubt": SpeedDoubt(refused, 100.0, 100.0, 5.0, 1.25, 1.0)}
    assert run.tick(2.0, **doubt).flow_allowed
    run.tick(1.0, speed_mps=0.0, wheel_mps=5.0, **doubt)
    assert run.tick(3.0, wheel_mps=5.0, **doubt).why_no_flow in (
        ("low_speed",),
        ("course_unknown",),
    )
    assert run.tick(1.0).flow_allowed


def test_a_fitted_work_switch_that_is_silent_counts_as_up(working, new_run):
    run = new_run(has_work_switch=True)
    run.order(Do.READY)
    run.order(Do.START)
    assert run.tick(work_switch=True).flow_allowed
    assert run.tick(work_switch=None).why_no_flow == ("work_switch_up",)
    assert working().tick(work_switch=None).flow_allowed


def test_flow_starts_above_half_and_stops_below_0_3(working):
    run = working()
    assert run.tick(speed_mps=0.31).flow_allowed
    assert not run.tick(speed_mps=0.29).flow_allowed
    assert not run.tick(1.0, speed_mps=0.45).flow_allowed
    assert run.tick(speed_mps=0.51).flow_allowed


# Flow from a walking creep on, with START held: it lands a lag later, where the machine is
# then. From a standstill on.
LAUNCHED = {
    "from the creep on while START is held": (
        tick(0.3, speed_mps=0.25, flows=False),
        creep(flows=True),
        tick(0.6, speed_mps=0.25, flows=False),
        creep(flows=True),
    ),
    "not at a standstill however long it is held": (
        creep(2.0, speed_mps=0.0, why=("standstill",)),
    ),
    "not while it hardly moves": (creep(2.0, speed_mps=0.05, flows=False),),
    **{
        f"not where one sensor does not say so: {still}": (creep(**still, flows=False),)
        for still in (
            {"gnss_mps": 0.05},
            {"wheel_mps": 0.05},
            {"gnss_age_s": 5.0},
            {"fix_quality": 0},
        )
    },
    "for three seconds and not again under the same press": (
        creep(2.6, flows=True),
        creep(1.0, flows=False),
        tick(0.6, speed_mps=0.25),
        creep(flows=True),
    ),
    "the course must be known since it stood": (creep(course_deg=None, why=("low_speed",)),),
    "and forwards": (creep(course_deg=270.0, why=("reversing",)),),
    "the work switch holds": (creep(work_switch=False, why=("work_switch_up",)),),
    "a press that outlived work does not begin it again": (
        order(Do.START, True),
        order(Do.HOLD),
        order(Do.START, True, refused="start_held"),
        tick(0.6),
        order(Do.START, True),
    ),
}


@pytest.mark.parametrize("name", LAUNCHED)
def test_launching(working, name):
    play(working(), (tick(1.0, speed_mps=0.0), *LAUNCHED[name]))


@pytest.mark.parametrize(
    "one_still",
    [
        {"gnss_mps": 0.05},
        {"wheel_mps": 0.05},
        {"gnss_age_s": 5.0},
        {"wheel_age_s": 5.0},
        {"fix_quality": 0},
    ],
)
def test_both_speed_sensors_must_move_to_start_but_one_is_enough_to_go_on(working, one_still):
    run = working()
    assert run.tick(**one_still).flow_allowed
    run.tick(speed_mps=0.2)
    assert run.tick(0.5, **one_still).why_no_flow in (
        ("low_speed",),
        ("course_unknown",),
        ("wheel_speed_missing",),
    )
    assert run.tick().flow_allowed


def test_the_wheel_s_standstill_wins_over_a_late_gnss_speed(working):
    verdict = working().tick(wheel_mps=0.0)
    assert verdict.why_no_flow == ("standstill",)


def test_field_edge_and_low_speed_keep_working(working):
    run = working()
    assert run.tick(30.0, landing_inside=False).state is State.WORKING
    assert run.tick(30.0, speed_mps=0.25).state is State.WORKING


AGAIN = (order(Do.STOP), order(Do.READY), order(Do.START))

# From work on, due east.
GOES_ON = {
    "backwards after a standstill: no flow until forwards again": (
        stop_and_go(270.0, why=("reversing",)),
        tick(5.0, course_deg=265.0, why=("reversing",)),
        stop_and_go(88.0, flows=True),
    ),
    "north is no flip": (tick(0.5, course_deg=350.0), stop_and_go(10.0, flows=True)),
    "a turn without a standstill is none": (tick(5.0, course_deg=270.0, flows=True),),
    "a quick shuttle counts": (
        tick(speed_mps=0.1, course_deg=90.0),
        tick(0.5, course_deg=270.0, why=("reversing",)),
    ),
    # the wheel stops for 0.3 s and goes backwards while GNSS still tells of going forwards
    "a GNSS speed late by a second does not hide it": (
        tick(0.3, wheel_mps=0.0, speed_used_mps=0.0),
        tick(0.7, gnss_mps=1.0),
        tick(0.2, gnss_mps=0.1),
        tick(0.5, course_deg=270.0, why=("reversing",)),
    ),
    "the operator may allow reversing until STOP": (
        stop_and_go(270.0),
        order(Do.ALLOW_REVERSE, True),
        tick(course_deg=270.0, flows=True),
        *AGAIN,
        tick(course_deg=270.0, why=("reversing",)),
    ),
    "the operator may allow landing outside": (
        order(Do.ALLOW_OUTSIDE, True),
        tick(landing_inside=False, flows=True),
        order(Do.ALLOW_OUTSIDE, False),
        tick(landing_inside=False, flows=False),
    ),
    "with a dead wheel the operator may go on by a GNSS that speaks ten times a second, "
    "until STOP": (
        tick(1.0, wheel_mps=0.0, gnss_period_s=0.1, why=("standstill",)),
        order(Do.ALLOW_NO_WHEEL, True),
        order(Do.ACKNOWLEDGE, ""),
        tick(0.5, wheel_mps=0.0, gnss_period_s=0.1, flows=True, alarms=("wheel_fault",)),
        tick(20.0, wheel_mps=0.0, gnss_period_s=0.1, flows=True),
        tick(0.5, wheel_mps=0.0, gnss_period_s=0.2, why=("standstill",)),
        tick(0.5, wheel_mps=0.0, gnss_period_s=0.1, flows=True),
        tick(
            0.2, wheel_mps=0.0, gnss_period_s=0.1, speed_mps=0.25, gnss_mps=0.25, why=("low_speed",)
        ),
        tick(0.6, wheel_mps=0.0, gnss_period_s=0.1, gnss_age_s=1.1, why=("standstill",)),
        *AGAIN,
        tick(0.5, wheel_mps=0.0, gnss_period_s=0.1, why=("standstill",)),
    ),
    "the operator may want the outside rate of a map elsewhere until STOP": (
        order(Do.ALLOW_MAP_ELSEWHERE, 1.0, refused="yes_or_no"),
        order(Do.ALLOW_MAP_ELSEWHERE, True),
        tick(map_elsewhere=True, flows=True),
        *AGAIN,
        tick(map_elsewhere=True, why=("map_elsewhere",)),
    ),
}


@pytest.mark.parametrize("name", GOES_ON)
def test_what_goes_on_with_flow_and_what_does_not(working, name):
    play(working(), GOES_ON[name])


def test_a_receiver_without_courses_is_not_judged(new_run):
    play(new_run(), (order(Do.READY), order(Do.START), tick(1.0, course_deg=None, flows=True)))


@pytest.mark.parametrize(
    ("course_deg", "flow"), [(205.0, True), (215.0, False), (-25.0, True), (325.0, False)]
)
def test_the_flip_is_more_than_120_degrees_either_way(working, course_deg, flow):
    play(working(), (stop_and_go(course_deg, flows=flow),))


def test_no_flow_before_the_new_course_is_known(working):
    play(
        working(),
        (
            tick(2.0, speed_mps=0.0),
            tick(1.0, course_deg=None, why=("course_unknown",)),
            tick(0.5, flows=True),
        ),
    )


def test_without_a_log_work_goes_on_only_if_the_operator_says_so(working):
    run = working()
    assert not run.order(Do.GO_ON_UNLOGGED, True).accepted
    assert run.tick(log_ok=False).why_no_flow == ("log_failed",)
    assert run.order(Do.GO_ON_UNLOGGED, True).accepted
    assert run.tick(log_ok=False).flow_allowed
    run.tick()
    assert run.tick(log_ok=False).why_no_flow == ("log_failed",), (
        "asked anew after the log had recovered"
    )
