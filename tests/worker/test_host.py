"""The tick sequence on an injected clock: nothing here waits."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from topdress.console.frame import DeviceDo
from topdress.console.worker import limits
from topdress.console.worker.loop_host import FlickerFilter
from topdress.console.worker.requests import ClientQuestion, DeviceOrder
from topdress.control.orders import Answer, Do, Order, SectionState
from topdress.control.safety import Allowances


def ask(rig, what):
    said = []
    assert rig.host.queue_request(what, lambda answer, extra: said.append((answer, extra)))
    return said


def test_a_tick_measures_decides_commands_logs_and_shows(rig):
    r = rig()
    ask(r, Order(Do.START))
    r.host.run_one_tick(0.25)
    frame = r.host.newest_frame
    assert (
        r.bench.commands[-1][0] == 0.25
        and r.bench.commands[-1][1].shaft_rpm == 70.0
        and r.bench.commands[-1][2]
    )
    assert (
        r.writer.rows[-1] is frame.row and frame.row.state == "working" and frame.row.time_s == 0.25
    )
    assert (frame.job, frame.machine, frame.crop, frame.log_path) == (
        "job",
        "huanghai",
        "wheat",
        "run.csv",
    )
    assert (
        frame.simulated
        and frame.dropped_heads == (3,)
        and frame.place_m == (1.0, 2.0)
        and frame.notes == ("note",)
    )
    assert frame.metres_left_m == 120.0 and frame.area_ha == 1.25 and frame.applied_kg == 300.0
    assert (frame.gnss_age_s, frame.gnss_hz, frame.look_ahead, frame.flow_trim_on) == (
        0.1,
        10.0,
        True,
        False,
    )
    assert (frame.why_no_flow, frame.why_state, frame.allow) == (
        ("low_speed",),
        "start",
        Allowances(outside=True),
    )
    assert (frame.no_double, frame.threshold_m, frame.strips) == (False, -0.12, (0.66, None))
    assert (frame.ordered_source, frame.manual_rate_kg_ha) == ("map", 90.0)
    assert frame.source_rates == (310.0, 90.0)
    assert frame.sections == (SectionState(True), SectionState(False, "done"))
    assert (frame.head_ndvi, frame.bench) == ((0.5, None), (50.0, 20.0, 3.0, 117.0))
    assert (
        frame.devices[0].name == "board"
        and frame.devices[0].rejected == 1
        and frame.devices[0].last_raw == "$"
    )


def test_totals_are_made_anew_once_a_second(rig):
    r = rig(hz=20.0)
    seen = []
    for k in range(45):
        r.host.run_one_tick(0.05 * k)
        r.loop.totaliser.add_tick(0.05, 2.0, 300.0)
        seen.append(r.host.newest_frame.totals)
    assert [t.worked_s for t in dict.fromkeys(seen)] == pytest.approx([0.0, 1.0, 2.0])


def test_deadlines_are_absolute(rig):
    """A tick that takes 3 ms does not make the period 3 ms longer."""
    r = rig(hz=20.0)
    measure = r.bench.read_measurements

    def slow(now_s):
        r.now_s += 0.003
        return measure(now_s)

    r.bench.read_measurements = slow
    r.on_sleep = lambda: r.host.request_stop("enough") if len(r.writer.rows) == 100 else None
    r.host.run_until_stopped()
    assert [round(row.time_s, 6) for row in r.writer.rows] == [
        round(0.05 * k, 6) for k in range(101)
    ]
    assert r.host.period.summarise_ms()["max_ms"] < 1e-6
    assert r.host.period.summarise_ms()["busy_max_ms"] == pytest.approx(3.0)


def test_a_pause_is_not_made_up_for_in_a_burst(rig):
    r = rig(hz=20.0)

    def on_sleep():
        if len(r.writer.rows) == 10:
            r.now_s += 1.0
        if len(r.writer.rows) == 20:
            r.host.request_stop("enough")

    r.on_sleep = on_sleep
    r.host.run_until_stopped()
    times = [row.time_s for row in r.writer.rows]
    gaps = [round(b - a, 6) for a, b in pairwise(times)]
    assert sorted(gaps)[0] == 0.05 and max(gaps) == 1.05
    assert r.host.period.summarise_ms()["skipped"] == 20


def test_the_console_age_is_handed_on_and_starts_anew_when_heard(rig):
    r = rig()
    for now_s in (0.0, 0.5, 1.0):
        r.now_s = now_s
        r.host.run_one_tick(now_s)
    r.host.note_console_heard()
    r.host.run_one_tick(1.0)
    assert r.loop.ages == [0.0, 0.5, 1.0, 0.0]


def test_nobody_for_sixty_seconds_is_off_and_exit(rig):
    assert limits.ORPHAN_TIMEOUT_S == 60.0
    r = rig(hz=1.0)
    ask(r, Order(Do.START))
    assert r.host.run_until_stopped() == "orphaned"
    assert (
        r.writer.rows[-1].time_s == 61.0
        and r.writer.rows[-1].state == "off"
        and r.writer.rows[-2].state == "held"
    )
    assert r.bench.commands[-1][1:] == (None, False)
    assert r.bench.closed and r.writer.closed and r.host.ended == "orphaned"


def test_somebody_who_calls_in_time_keeps_it_running(rig):
    r = rig(hz=1.0)

    def on_sleep():
        if r.now_s in (50.0, 100.0):
            r.host.note_console_heard()

    r.on_sleep = on_sleep
    r.host.run_until_stopped()
    assert r.writer.rows[-1].time_s == 161.0


def test_stop_between_ticks_still_logs_a_row_off(rig):
    r = rig()
    r.host.run_one_tick(0.0)
    r.host.request_stop("SIGTERM")
    assert r.host.run_until_stopped() == "SIGTERM"
    assert (
        r.loop.orders[-1] == Order(Do.STOP)
        and r.writer.rows[-1].state == "off"
        and r.host.newest_frame.row.state == "off"
    )


def test_a_loop_that_breaks_in_a_tick_stops_the_drives_and_goes_on(rig, capsys):
    r = rig()
    ask(r, Order(Do.START))
    good, broken = r.loop.run_tick, []

    def tick(measurements, *rest):
        broken.append(measurements.control_failed)
        if 4 <= len(broken) <= 6:
            raise RuntimeError("the loop broke")
        return good(measurements, *rest)

    r.loop.run_tick = tick
    for number in range(4):
        r.host.run_one_tick(0.05 * number)
    assert r.bench.commands[-1][1:] == (None, False)
    assert (
        r.loop.orders[-1] == Order(Do.STOP) and r.host.newest_frame.alarms[0].id == "control_failed"
    )
    for number in range(4, 8):
        r.host.run_one_tick(0.05 * number)
    assert [row.state for row in r.writer.rows] == ["working"] * 3 + ["off"] * 2
    # safety is told, once it can be told
    assert broken == [False] * 4 + [True] * 3 + [False]
    assert capsys.readouterr().err.count("RuntimeError: the loop broke") == 1


def test_a_drive_that_cannot_be_told_costs_neither_log_nor_worker(rig):
    r = rig()

    def command(*_):
        raise OSError("port gone")

    r.bench.send_command = command
    for number in range(5):
        r.host.run_one_tick(0.05 * number)
    assert r.loop.orders == [Order(Do.STOP)] * 5
    with pytest.raises(OSError):
        r.host.close_run("done")
    assert r.writer.closed and r.bench.closed


def test_what_stands_beside_the_loop_costs_no_tick(rig):
    """Log, keeper, tests of devices, an answer that cannot be given."""
    r = rig()

    def broken(*_):
        raise RuntimeError("broken")

    r.writer.append = r.host._device_service.end_due_work = r.host.lag.follow_test = (
        r.host._device_service.obey_device_order
    ) = broken
    said = ask(r, DeviceOrder("board", DeviceDo.TEST))
    r.host.queue_request(Order(Do.MARK), broken)
    r.host.run_one_tick(0.0)
    assert r.host.newest_frame.alarms == () and len(r.bench.commands) == 1
    assert said[0][0].why.startswith("internal_error: test: RuntimeError")


def test_orders_are_answered_by_the_next_tick(rig):
    r = rig()
    good, limit, bad = (
        ask(r, Order(Do.START)),
        ask(r, Order(Do.MANUAL_RATE, 900.0)),
        ask(r, Order(Do.REFILL, 1.0)),
    )
    assert not good
    r.host.run_one_tick(0.0)
    assert good == [(Answer(True), {})]
    assert limit == [(Answer(False, "rate_above_limit"), {})]
    assert bad[0][0] == Answer(False, "internal_error: refill 1.0: RuntimeError: cannot digest")
    r.host.run_one_tick(0.05)
    assert r.writer.rows[-1].state == "working"


def test_alive_stats_and_quit(rig):
    r = rig(hz=50.0)
    alive, stats, quit_ = (
        ask(r, ClientQuestion.ALIVE),
        ask(r, ClientQuestion.STATS),
        ask(r, ClientQuestion.QUIT),
    )
    assert r.host.run_until_stopped() == "asked to quit"
    assert alive == [(Answer(True), {})] and quit_ == [(Answer(True), {})]
    assert stats[0][1]["stats"]["hz"] == pytest.approx(50.0)
    assert len(r.writer.rows) == 1


def test_requests_cannot_make_a_tick_long(rig):
    r = rig()
    said = []
    taken = [
        r.host.queue_request(ClientQuestion.ALIVE, lambda *_: said.append(1))
        for _ in range(limits.MAX_WAITING_REQUESTS + 10)
    ]
    assert taken.count(False) == 10
    r.host.run_one_tick(0.0)
    assert len(said) == limits.MAX_REQUESTS_PER_TICK


@pytest.mark.parametrize(
    "stop", [Order(Do.STOP), Order(Do.HOLD), Order(Do.RELEASE), ClientQuestion.QUIT]
)
def test_what_stops_the_machine_waits_behind_nothing(rig, stop):
    r = rig()
    ask(r, Order(Do.START))
    r.host.run_one_tick(0.0)
    others = [ask(r, Order(Do.NUDGE, 1.0)) for _ in range(limits.MAX_WAITING_REQUESTS)]
    stopped = ask(r, stop)  # `ask` sees to it that it is not refused
    after = [r.host.queue_request(ClientQuestion.ALIVE, lambda *_: None) for _ in range(3)]
    r.host.run_one_tick(0.05)
    assert after == [False] * 3
    assert stopped == [(Answer(True), {})]
    # in the order they came: none overtakes the stop
    assert all(len(one) == 1 for one in others)
    if stop is not ClientQuestion.QUIT:
        assert r.loop.orders[-1] == stop


@pytest.mark.parametrize(("hz", "ticks_a_frame"), [(20.0, 1), (50.0, 3), (100.0, 5), (10.0, 1)])
def test_frames_are_made_no_oftener_than_they_are_sent(rig, hz, ticks_a_frame):
    r = rig(hz=hz)
    seen = []
    for k in range(30):
        r.host.run_one_tick(k / hz)
        seen.append(r.host.newest_frame.seq)
    assert sorted(set(seen)) == list(range(0, 30, ticks_a_frame))


def test_log_trouble_reaches_the_loop(rig):
    r = rig()
    r.host.run_one_tick(0.0)
    r.writer.trouble = "disk full"
    r.host.run_one_tick(0.05)
    assert r.loop.log_oks == [True, False]


def test_a_disk_that_fails_by_turns_is_no_log():
    """Flow went off and on with it, for 3 s of every 8: the first time it is forgiven at once,
    then after a minute."""
    steady = FlickerFilter()
    seen = [steady.filter_flicker(0.1 * k, k < 50 or k % 80 >= 30) for k in range(1500)]
    turns = [k for k in range(1, len(seen)) if seen[k] != seen[k - 1]]
    assert turns == [80, 110, 160]
    assert [steady.filter_flicker(150.0 + k, True) for k in (0, 55, 61)] == [False, False, True]
    assert [steady.filter_flicker(300.0 + 0.1 * k, k > 30) for k in range(40)][-9:] == [True] * 9, (
        "long after, it is the first"
    )


def test_a_log_that_was_cut_short_is_said_and_followed(rig):
    r = rig()
    r.host.run_one_tick(0.0)
    r.writer.path, r.writer.cut_short = Path("logs/run-2.csv"), Path("logs/run.csv")
    for k in range(1, 40):
        r.host.run_one_tick(0.05 * k)
    assert r.host.newest_frame.log_path == str(Path("logs/run-2.csv"))
    assert r.loop.logs_cut[:3] == ["", "run-2.csv", "run-2.csv"]
    events = ";".join(row.events or "" for row in r.writer.rows)
    assert events.count("log_cut_short") == 1 and f"log_cut_short {Path('logs/run.csv')}" in events
    r.host.run_one_tick(70.0)
    assert r.loop.logs_cut[-1] == ""


def test_a_clock_that_is_set_back_takes_no_tick_back_in_time(rig):
    made, times_s = rig(), []
    for now_s in (1.0, 1.05, 1.04993, 1.1, 0.2, 1.15):
        made.host.run_one_tick(now_s)
        times_s.append(made.host.newest_frame.at_s)
    assert times_s == sorted(times_s) and times_s[-1] == 1.15
