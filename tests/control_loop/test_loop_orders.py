"""What orders do to the loop, and what it refuses."""

from __future__ import annotations

from typing import Any

import pytest
from topdress.control.geodesy import TangentPlane
from topdress.control.loop.events import (
    MAX_EVENT_LETTERS,
    MAX_ROW_LETTERS,
    MAX_WAITING_EVENTS,
    EventQueue,
)
from topdress.control.orders import Do, Order
from topdress.control.readings import GnssFix, Measurements, Reading
from topdress.control.sensing import Sensing

from tests.control_loop.closed import SETUP, Closed


@pytest.fixture
def machine() -> Any:
    """`machine(begin_m=..., speed_kmh=..., ...)`: fields of the job's simulated part."""
    return lambda **sim: Closed(sim={"begin_m": 30.0, **sim})


@pytest.mark.parametrize(
    ("do", "value", "why"),
    [
        (Do.NUDGE, True, "nudge_out_of_range"),
        (Do.NUDGE, 30.5, "nudge_out_of_range"),
        (Do.NUDGE, float("nan"), "nudge_out_of_range"),
        (Do.MANUAL_RATE, True, "rate_out_of_range"),
        (Do.MANUAL_RATE, 5000.0, "rate_out_of_range"),
        (Do.MANUAL_RATE, float("inf"), "rate_out_of_range"),
        (Do.LOOK_AHEAD, "off", "yes_or_no"),
        (Do.FLOW_TRIM, 0.0, "yes_or_no"),
        (Do.STRATEGY, "fast", "unknown_strategy"),
        (Do.SOURCE, "map", "source_not_ready"),
        (Do.REFILL, -5.0, "refill_kg"),
        (Do.REFILL, "much", "refill_kg"),
        (Do.ALLOW_OUTSIDE, 1.0, "yes_or_no"),
        (Do.REFILL, 1e308, "refill_beyond_hopper;hopper_kg=300"),
        (Do.REFILL, 301.0, "refill_beyond_hopper;hopper_kg=300"),
    ],
)
def test_what_makes_no_sense_is_refused_and_changes_nothing(
    machine: Any, do: Do, value: Any, why: str
) -> None:
    one, other = machine(), machine()
    one.start()
    other.start()
    assert one.order(do, value) == (False, why)
    assert one.run(0.5).row == other.run(0.5).row


def test_the_operator_may_choose_the_fallback_rate(machine: Any) -> None:
    m = machine().start()
    m.run(8.0)
    assert m.order(Do.SOURCE, "fallback").accepted
    row = m.run(4.0).row
    assert (row.target_source, row.target_rate_kg_ha) == (
        "fallback",
        SETUP.crop.fallback_rate_kg_ha,
    )
    assert m.order(Do.SOURCE, "canopy").accepted
    assert m.run(4.0).row.target_source == "canopy"


def test_nudge_and_manual_rate_are_what_is_spread(machine: Any) -> None:
    m = machine().start()
    m.order(Do.SOURCE, "manual")
    m.order(Do.MANUAL_RATE, 240.0)
    m.order(Do.NUDGE, 10.0)
    row = m.run(10.0).row
    assert row.target_rate_kg_ha == pytest.approx(264.0)
    assert row.nudge_percent == 10.0
    assert row.applied_rate_kg_ha == pytest.approx(264.0, rel=0.06)


def test_each_tick_tells_what_every_source_gives_here_whichever_is_ordered(machine: Any) -> None:
    m = machine().start()
    m.order(Do.SOURCE, "manual")
    m.order(Do.MANUAL_RATE, 20.0)
    m.order(Do.NUDGE, 10.0)
    tick = m.run(10.0)
    rates = dict(zip(tick.sources, tick.source_rates, strict=True))
    assert rates["manual"] == 20.0 and rates["fallback"] == SETUP.crop.fallback_rate_kg_ha
    m.order(Do.NUDGE, 0.0)
    m.order(Do.SOURCE, "canopy")
    assert m.run(0.1).source_rates[0] == pytest.approx(rates["canopy"], rel=0.2)
    assert m.run(4.0).row.target_rate_kg_ha == pytest.approx(rates["canopy"], rel=0.2)


def test_a_refill_reaches_the_flow_trim(machine: Any) -> None:
    m = machine().start()
    m.run(25.0)
    assert len(m.loop._flow_trim._blocks) > 10
    assert m.order(Do.REFILL, 100.0).accepted
    assert not m.loop._flow_trim._blocks


def outside_kg(m: Any) -> float:
    return sum(t.flow_kg_s * 0.05 for t in m.truths if t.north_m > 40.5)


def test_outside_the_field_flow_needs_the_operators_leave(machine: Any) -> None:
    field = {"pass_length_m": 40.0, "run_in_m": 25.0, "begin_m": 45.0}
    plain = machine(**field).start()
    plain.run(25.0)
    assert plain.truths[-1].north_m > 50.0
    assert outside_kg(plain) < 1e-9
    assert "outside_field" in plain.ticks[-1].why_no_flow
    allowed = machine(**field).start()
    allowed.order(Do.ALLOW_OUTSIDE, True)
    allowed.run(25.0)
    assert outside_kg(allowed) > 0.5
    assert allowed.ticks[-1].row.target_rate_kg_ha > 100.0
    allowed.order(Do.ALLOW_OUTSIDE, False)
    ended = allowed.run(0.1)
    assert "outside_field" in ended.why_no_flow
    assert ended.command.shaft_rpm == 0.0


BACK_UP = [
    {"at_s": 0, "speed_kmh": 4.5},
    {"at_s": 14, "speed_kmh": 0},
    {"at_s": 20, "speed_kmh": -2.0},
    {"at_s": 27, "speed_kmh": 0},
    {"at_s": 30, "speed_kmh": 4.5},
]


def test_backing_up_takes_the_track_back_and_nothing_is_spread_twice(machine: Any) -> None:
    m = machine(speed_changes=BACK_UP).start()
    m.run(45.0)
    off = [t.sensed.track_m - truth.driven_m for t, truth in zip(m.ticks, m.truths, strict=True)]
    assert off[-1] - off[300] == pytest.approx(0.0, abs=0.25)
    assert (
        min(b.driven_m - a.driven_m for a, b in zip(m.truths[400:], m.truths[440:], strict=False))
        < -1.0
    )
    turned = max(t.driven_m for t in m.truths[:500])
    early = [t for t in m.truths[540:] if t.driven_m + t.drop_s * t.speed_mps < turned - 0.5]
    assert early
    assert sum(t.flow_kg_s for t in early) < 1e-9
    assert m.truths[-1].flow_kg_s > 0.0
    backing = [t for t, truth in zip(m.ticks, m.truths, strict=True) if truth.speed_mps < -0.4]
    assert backing[20].sensed.backwards
    assert "reversing" in backing[20].why_no_flow
    assert abs((backing[20].sensed.heading_deg + 180.0) % 360.0 - 180.0) < 10.0


def test_start_spreads_where_the_operator_wants_it_also_on_ground_that_has_some(
    machine: Any,
) -> None:
    m = machine(speed_changes=BACK_UP).start()
    m.run(31.5)
    turned = max(t.driven_m for t in m.truths)
    assert m.order(Do.HOLD).accepted
    assert m.order(Do.START).accepted
    m.run(3.5)
    again = [t for t in m.truths[640:] if t.driven_m + t.drop_s * t.speed_mps < turned - 0.5]
    assert max(t.flow_kg_s for t in again) > 0.02


def test_the_way_made_before_the_direction_was_known_is_put_right() -> None:
    plane = TangentPlane(34.0, 119.0)
    sensing = Sensing(0.0, plane)
    ticks = 0

    def drive(seconds: float, speed: float, course: float | None) -> float:
        nonlocal ticks
        sensed = None
        for _ in range(round(seconds / 0.05)):
            ticks += 1
            now = 0.05 * ticks
            fix = (
                None
                if course is None
                else GnssFix(now, 34.0, 119.0, 4, speed_mps=speed, heading_deg=course)
            )
            sensed = sensing.sense_motion(
                Measurements(now, gnss=fix, wheel_speed_mps=Reading(speed, now))
            )
        assert sensed is not None
        return sensed.track_m

    forwards = drive(5.0, 1.0, 90.0)
    stands = drive(2.0, 0.0, 0.0)
    assert forwards == pytest.approx(5.0, abs=0.1)
    drive(2.0, 1.0, None)  # GNSS is silent: nobody knows which way
    assert drive(1.0, 1.0, 270.0) == pytest.approx(stands - 3.0, abs=0.15)


def test_with_leave_it_spreads_backwards_but_not_out_of_the_field(machine: Any) -> None:
    back = [
        {"at_s": 0, "speed_kmh": 4.5},
        {"at_s": 6, "speed_kmh": 0},
        {"at_s": 10, "speed_kmh": -4.0},
    ]
    m = machine(begin_m=17.0, speed_changes=back).start()
    m.order(Do.ALLOW_REVERSE, True)
    m.run(28.0)
    back = [t for t in m.truths if t.speed_mps < 0.0]
    landed = [(t.north_m + t.drop_s * t.speed_mps, t.flow_kg_s * 0.05) for t in back]
    assert min(t.north_m for t in back) < -5.0
    assert sum(kg for north_m, kg in landed if north_m > 0.0) > 0.5
    assert sum(kg for north_m, kg in landed if north_m < -0.8) < 0.01, (
        "the edge lies at 0; the shaft runs down"
    )


def test_totals_come_from_the_totaliser(machine: Any) -> None:
    m = machine().start()
    tick = m.run(30.0)
    totals = m.loop.totals
    assert (tick.area_ha, tick.applied_kg) == (totals.area_ha, totals.applied_kg)
    released = sum(t.flow_kg_s * 0.05 for t in m.truths)
    assert totals.applied_kg == pytest.approx(released, rel=0.02)
    assert totals.applied_n_kg == pytest.approx(totals.applied_kg * SETUP.crop.product_n_fraction)
    assert totals.mean_rate_kg_ha == pytest.approx(totals.applied_kg / totals.area_ha)
    assert totals.cuc_percent > 50.0


def test_a_start_that_is_held_is_one_event_and_launches(simulated: Any) -> None:
    """Flow from the creep on; the same from standstill with one press waits for 0.5 m/s."""
    sim = {
        "run_in_m": 0.5,
        "begin_m": 20.0,
        "speed_changes": [{"at_s": 0, "speed_kmh": 0}, {"at_s": 3, "speed_kmh": 4.5}],
    }
    held = [(0.5, Order(Do.READY)), *((1.0 + 0.2 * k, Order(Do.START, True)) for k in range(30))]
    runs = [simulated(9.0, orders=orders, sim=sim) for orders in ([*held], [*held[:2]])]
    begins = [
        next(s.truth.speed_mps for s in run.steps if s.tick.command.shaft_rpm > 0.0) for run in runs
    ]
    assert 0.1 < begins[0] < 0.3 < 0.5 <= begins[1] + 0.02
    assert sum("start" in (s.tick.row.events or "") for s in runs[0].steps) == 1
    assert runs[0].alarms() == runs[1].alarms() == set()


# --- Events on their way into rows: bounded, in their order, none lost without a word
# --------------------------------


def test_what_one_row_cannot_hold_waits_for_the_next():
    events = EventQueue()
    given = [f"mark {k} " + "x" * 900 for k in range(232)]
    events.add_events(*given)
    rows = []
    while found := events.take_row_events():
        rows.append(found)
    assert [event for row in rows for event in row] == given
    assert max(len(";".join(row)) for row in rows) <= MAX_ROW_LETTERS
    assert len(rows) == 232


def test_one_event_is_no_longer_than_a_mark():
    events = EventQueue()
    events.add_events("mark " + "x" * 50_000)
    (found,) = events.take_row_events()
    assert len(found) == MAX_EVENT_LETTERS and found.endswith("...")


def test_of_more_than_can_wait_the_number_is_kept():
    events = EventQueue()
    events.add_events(*(["nudge 5"] * (MAX_WAITING_EVENTS + 17)))
    assert events.is_full
    found = []
    while row := events.take_row_events():
        found += row
    assert found == ["nudge 5"] * MAX_WAITING_EVENTS + ["events_left_out 17"]
    assert not events.is_full and events.take_row_events() == []
