"""A job that is cut off and goes on: totals, ground, what is not done a second time, and that
it is off."""

from __future__ import annotations

import datetime as dt
import json
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from topdress.console.worker import resume
from topdress.console.worker.assemble import assemble_run
from topdress.console.worker.loop_host import Host
from topdress.console.worker.options import Options, parse_options
from topdress.console.worker.requests import ClientQuestion
from topdress.console.worker.resume import Snapshot
from topdress.console.worker.resume_alarms import AlarmHistory, AlarmRecord
from topdress.console.worker.resume_assemble import find_job_to_continue
from topdress.console.worker.resume_ground import (
    EMPTY_RASTER,
    MAX_TRACK_PLACES,
    WorkedGroundRecord,
    join_rasters,
    pack_raster,
    unpack_raster,
)
from topdress.console.worker.resume_keeper import SnapshotKeeper
from topdress.console.worker.resume_tail import add_log_tail
from topdress.control.agronomy.reference_strips import ReferenceStrips
from topdress.control.field.coverage import Coverage, Raster
from topdress.control.field.job import make_rule
from topdress.control.field.job_totals import Totaliser, TotalSums
from topdress.control.log_row import LogRow
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.orders import Alarm, Do, Order, Severity
from topdress.drivers.files.plain_data import build_from_plain, convert_to_plain
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_meta import parse_meta_yaml
from topdress.drivers.files.run_setup import load_setup


class PowerCut(BaseException):
    """Nothing of the worker runs after it."""


@pytest.fixture(scope="module")
def morning(tmp_path_factory):
    """Work for 90 s of run time, then the power is gone: no end is written."""
    folder = tmp_path_factory.mktemp("morning")
    return run(folder / "a.csv", 90.0, cut=True)


def silenced(measure, from_s, to_s):
    """What the sensors say, with a receiver that says nothing new for a time."""
    last = None

    def told(now_s):
        nonlocal last
        m = measure(now_s)
        if from_s <= now_s < to_s:
            return m._replace(gnss=last)
        last = m.gnss
        return m

    return told


def run(
    log: Path,
    until_s: float,
    resumed: Path | None = None,
    cut: bool = False,
    orders: dict[float, Order] | None = None,
    work: bool = True,
    silent_s: tuple[float, float] = (inf, inf),
):
    """On an injected clock, faster than real. silent_s: GNSS is, from and to."""
    now_s, given = 0.0, dict(orders or {})
    frames = []

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += max(seconds, 1e-9)
        host.note_console_heard()
        if host.newest_frame is not None:
            frames.append(host.newest_frame)
            state = host.newest_frame.row.state
            if work and now_s > 3.0 and state in ("off", "ready"):
                host.queue_request(
                    Order(Do.READY if state == "off" else Do.START), lambda answer, _: None
                )
        for at_s in [at_s for at_s in given if at_s <= now_s]:
            host.queue_request(given.pop(at_s), lambda answer, _: None)
        if now_s > until_s:
            if cut:
                raise PowerCut
            host.request_stop("enough")

    parts = assemble_run(
        Options((), log.parent / "w.json", log=str(log), resume=resumed), lambda: now_s
    )
    parts.bench.read_measurements = silenced(parts.bench.read_measurements, *silent_s)
    host = Host(parts, lambda: now_s, sleep)
    real_work = parts.writer.after_writing
    if cut:
        host.close_run = lambda why: None  # the process is gone: nobody closes anything
    try:
        host.run_until_stopped()
    except PowerCut:
        parts.writer.after_writing = None
        parts.writer.close()
        real_work(False)
    return frames, parts


class Sensing(NamedTuple):
    """What it senses: nothing."""

    position_ok: bool = False
    heading_deg: float | None = None
    track_m: float = 0.0


class Standing(NamedTuple):
    """A tick of a machine that stands, or of which only the row is looked at."""

    row: LogRow
    alarms: tuple = ()
    place_m: tuple[float, float] | None = None
    sensed: Sensing = Sensing()
    look_ahead: bool = True
    flow_trim_on: bool = True


class Loop(NamedTuple):
    """What a loop that has done nothing yet tells."""

    running_sums: TotalSums = TotalSums()
    flow_trim: float = 1.0
    plane: None = None


def left(folder):
    """The newest job that was left there, with its snapshot; None: none."""
    return next(resume.find_open_jobs(folder, dt.datetime.now(dt.UTC)), None)


def _read(folder, data):
    path = folder / "told.resume.json"
    path.write_text(json.dumps(data))
    return resume.read_snapshot(path)


def test_what_is_kept_of_a_morning(morning):
    frames, parts = morning
    kept = resume.read_snapshot(resume.make_snapshot_path(parts.writer.path))
    last = frames[-1]
    assert (
        kept.is_worth_resuming
        and kept.logs_before == ()
        and kept.strategy == "opening_first"
        and kept.simulated
    )
    assert kept.area_ha == pytest.approx(last.area_ha, rel=0.1)
    area = kept.ground.done.sum() * kept.ground.cell_m**2 / 10_000
    assert area == pytest.approx(kept.area_ha, rel=0.08)
    assert kept.moves > 10 and parts.keeper.tally.moves >= kept.moves
    assert kept.origin_deg == pytest.approx((34.28, 119.88))


def test_the_job_goes_on_where_it_stopped(morning, tmp_path):
    before, parts = morning
    snapshot = resume.make_snapshot_path(parts.writer.path)
    frames, later = run(tmp_path / "b.csv", 40.0, resumed=snapshot)
    assert frames[0].row.state == "off", "all else is the operator's act"
    assert frames[0].area_ha == pytest.approx(before[-1].area_ha, rel=0.01)
    assert (
        frames[-1].area_ha > before[-1].area_ha + 0.005
        and frames[-1].totals.worked_s > before[-1].totals.worked_s
    )
    assert frames[-1].totals.cuc_percent is not None
    log = later.writer.path
    assert log.name == "b.csv" and parse_meta_yaml(log.with_suffix(".yaml").read_text()).extra[
        "resumes"
    ] == str(parts.writer.path)
    kept = resume.read_snapshot(resume.make_snapshot_path(log))
    assert kept.logs_before == (str(parts.writer.path),) and kept.area_ha > before[-1].area_ha
    assert kept.began_utc == resume.read_snapshot(snapshot).began_utc and frames[
        -1
    ].tally.log_before == str(parts.writer.path)
    north = [frame.place_m[1] for frame in frames if frame.place_m is not None]
    assert abs(north[0] - before[-1].place_m[1]) < 3.0, (
        "the simulated tractor stands where it stopped"
    )


@pytest.mark.exam
@pytest.mark.parametrize(
    ("told", "second_dose"),
    [
        (None, False),
        (Order(Do.ALLOW_OUTSIDE, True), False),
        (Order(Do.NO_DOUBLE, False), True),
    ],
)
def test_what_is_done_gets_a_second_dose_only_by_the_order_for_it(
    morning, tmp_path, told, second_dose
):
    """The machine stands 30 m before the place where it stopped, and works."""
    before, parts = morning
    kept = resume.read_snapshot(resume.make_snapshot_path(parts.writer.path))
    stopped = before[-1].place_m[1]
    data = json.loads(resume.make_snapshot_path(parts.writer.path).read_text())
    data["place_m"] = [kept.place_m[0], stopped - 30.0]
    data["time_s"] = data["sums_s"] = 1e9  # the tail is in it
    moved = tmp_path / "moved.resume.json"
    moved.write_text(json.dumps(data))
    _frames, later = run(
        tmp_path / "c.csv", 45.0, resumed=moved, orders={} if told is None else {2.0: told}
    )
    plane_rows = [
        row for row in read_log(later.writer.path).rows() if row.state == "working" and row.lat_deg
    ]
    # of the outlets
    north = [(row.lat_deg - 34.28) * 110_920.0 - 2.0 for row in plane_rows]
    given = [(n, row.shaft_rpm or 0.0) for n, row in zip(north, plane_rows, strict=True)]
    done_to = stopped - 8.0  # the last 5 s are not in this snapshot
    assert (max(rpm for n, rpm in given if n < done_to - 3.0) > 20.0) is second_dose
    assert max(rpm for n, rpm in given if n > stopped + 3.0) > 20.0


def test_the_tail_of_the_log_closes_the_gap(morning):
    frames, parts = morning
    kept = resume.read_snapshot(resume.make_snapshot_path(parts.writer.path))
    whole = add_log_tail(kept, Machine(), 0.45)
    assert whole.time_s > kept.time_s - 1e-9
    assert whole.area_ha == pytest.approx(frames[-1].area_ha, rel=0.01)
    assert whole.place_m == pytest.approx(frames[-1].place_m, abs=1.0)
    assert whole.ground.done.sum() >= kept.ground.done.sum()
    assert add_log_tail(Snapshot("nowhere.csv"), Machine(), 0.45).log_path == "nowhere.csv"


@pytest.mark.exam
@pytest.mark.parametrize(("silent_s", "cut_s"), [((14.0, 40.0), 24.0), ((14.0, 23.0), 24.0)])
def test_ground_spread_without_a_place_is_done_after_a_cut(tmp_path, silent_s, cut_s):
    """Killed while the receiver is silent, and just after its place returned."""
    frames, parts = run(tmp_path / "a.csv", cut_s, cut=True, silent_s=silent_s)
    kept = resume.read_snapshot(resume.make_snapshot_path(parts.writer.path))
    whole = add_log_tail(kept, Machine(), 0.45, 1.0)
    way = [frame.place_m for frame in frames if frame.row.time_s > 15.0]
    assert way[-1][1] - way[0][1] > 5.0 and frames[-1].row.shaft_rpm > 20.0
    ground = whole.ground
    cells = np.floor((np.array(way) - (ground.west_m, ground.south_m)) / ground.cell_m).astype(int)
    assert ground.done[cells[:, 1], cells[:, 0]].all()
    rows = read_log(parts.writer.path).rows()
    said = [row.events for row in rows if "spread_un" in (row.events or "")]
    assert said == [] if silent_s[1] > cut_s else said[0].startswith("spread_unplaced ")
    assert whole.area_ha > 0.99 * frames[-1].area_ha, "and what fell after the cut"


def test_refills_holds_and_the_end_of_the_job_are_kept(tmp_path):
    orders = {
        12.0: Order(Do.HOLD),
        20.0: Order(Do.REFILL, 250.0),
        21.0: Order(Do.MARK, "job finished"),
    }
    _frames, parts = run(tmp_path / "a.csv", 30.0, orders=orders)
    kept = resume.read_snapshot(resume.make_snapshot_path(parts.writer.path))
    assert [kg for _utc, kg in kept.refills] == [
        250.0
    ] and parts.keeper.tally.refills == kept.refills
    assert 5.0 < kept.held_s < 25.0 and kept.finished and parts.keeper.tally.finished
    assert left(tmp_path) is None, "a job that was ended is not offered"


def test_a_machine_that_only_stood_there_leaves_nothing(tmp_path):
    _frames, parts = run(tmp_path / "a.csv", 12.0, work=False)
    assert not resume.make_snapshot_path(parts.writer.path).exists()


def test_a_snapshot_survives_its_file(tmp_path):
    written = Snapshot(
        "a.csv",
        began_utc="2026-03-18T06:00:00+00:00",
        saved_utc="2026-03-18T07:00:00+00:00",
        config=("x.yaml",),
        sums=TotalSums(1.0, 0.5, 150.0, 3.0, 4.0, 5.0, ((3, 0.5, 150.0),)),
        refills=(("t", 250.0),),
        place_m=(1.0, 2.0),
        track=((1.0, 2.0, 0.0, 300.0),),
    )
    resume.write_snapshot(tmp_path / "a.resume.json", written)
    again = resume.read_snapshot(tmp_path / "a.resume.json")
    for name in Snapshot.__dataclass_fields__:
        if name != "ground":
            assert getattr(again, name) == getattr(written, name), name
    resume.mark_finished(tmp_path / "a.resume.json")
    assert resume.read_snapshot(tmp_path / "a.resume.json").finished


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", '{"format": "topdress-resume/1"}', '{"format": "other/2"}']
)
def test_what_is_no_snapshot_is_named_in_one_line(tmp_path, text):
    path = tmp_path / "a.resume.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"a\.resume\.json: not a job that can go on: ") as caught:
        resume.read_snapshot(path)
    assert "\n" not in str(caught.value)
    assert left(tmp_path) is None


def test_jobs_that_were_left_are_found_the_newest_first(tmp_path):
    """Not those that were ended, gone on with in a later log, or left more than two weeks ago;
    an ended one hides its own parts, not what was left on another field."""
    import os

    now = dt.datetime.now(dt.UTC)

    def keep(number, name, **known):
        path = tmp_path / f"{name}.resume.json"
        resume.write_snapshot(
            path,
            Snapshot(
                str(tmp_path / f"{name}.csv"), sums=TotalSums(area_ha=known.pop("ha", 1.0)), **known
            ),
        )
        os.utime(path, (number, number))

    keep(1, "old", saved_utc=(now - dt.timedelta(days=15)).isoformat())
    keep(2, "west")
    keep(3, "north")
    keep(4, "east_1")
    keep(5, "east_2", logs_before=(str(tmp_path / "east_1.csv"),), finished=True)
    keep(6, "stood", ha=0.0)
    keep(6.5, "no_clock", saved_utc="1970-01-01T00:00:00.000+00:00")
    keep(7, "south", saved_utc=(now - dt.timedelta(days=13)).isoformat(), quit=True)
    found = [path.name.partition(".")[0] for path, _kept in resume.find_open_jobs(tmp_path, now)]
    assert found == ["south", "no_clock", "north", "west"]


def test_a_cut_in_the_first_second_of_work_leaves_something_to_go_on_with(tmp_path):
    keeper = SnapshotKeeper(
        tmp_path / "x.resume.json",
        Machine(),
        Snapshot("x.csv", sums=TotalSums()),
        Loop(),
        lambda: "",
    )
    keeper.take_tick(Standing(LogRow(1.0, shaft_rpm_cmd=0.0, state="working")))
    keeper.save_due(False)
    assert left(tmp_path) is None
    keeper.take_tick(Standing(LogRow(1.05, shaft_rpm_cmd=40.0, state="working")))
    keeper.save_due(False)
    _, kept = left(tmp_path)
    assert kept.worked and kept.area_ha == 0.0 and kept.time_s == 1.05


def test_the_begin_of_work_is_kept_at_once_also_where_something_was_kept_a_moment_before(tmp_path):
    keeper = SnapshotKeeper(
        tmp_path / "x.resume.json",
        Machine(),
        Snapshot("x.csv", sums=TotalSums()),
        Loop(),
        lambda: "",
    )
    alarm = Alarm("hopper_low", Severity.AMBER, 1.0, False, ())
    keeper.take_tick(Standing(LogRow(1.0, shaft_rpm_cmd=0.0, state="ready"), alarms=(alarm,)))
    keeper.save_due(False)
    assert (tmp_path / "x.resume.json").exists() and left(tmp_path) is None
    keeper.take_tick(Standing(LogRow(1.05, shaft_rpm_cmd=40.0, state="working"), alarms=(alarm,)))
    keeper.save_due(False)
    assert left(tmp_path)[1].worked


@pytest.mark.parametrize("quits", [True, False])
def test_a_snapshot_tells_a_quit_from_a_cut(tmp_path, quits):
    keeper = SnapshotKeeper(
        tmp_path / "x.resume.json",
        Machine(),
        Snapshot("x.csv", sums=TotalSums()),
        Loop(),
        lambda: "",
    )
    keeper.take_tick(Standing(LogRow(1.0, shaft_rpm_cmd=40.0, state="working")))
    if quits:
        keeper.note_quit()
    keeper.save_due(True)
    assert resume.read_snapshot(tmp_path / "x.resume.json").quit is quits


def test_a_job_whose_log_was_cut_short_has_both_as_its_parts(tmp_path):
    first, second = str(tmp_path / "x.csv"), str(tmp_path / "x-2.csv")
    keeper = SnapshotKeeper(
        tmp_path / "x.resume.json",
        Machine(),
        Snapshot(first, sums=TotalSums(area_ha=1.0)),
        Loop(),
        lambda: "",
    )
    keeper.take_tick(Standing(LogRow(1.0, state="working", shaft_rpm_cmd=40.0)))
    keeper.save_due(False)
    keeper.follow_log(second)
    keeper.take_tick(Standing(LogRow(1.1, state="working", shaft_rpm_cmd=40.0)))
    keeper.save_due(False)
    path, kept = left(tmp_path)
    assert path.name == "x-2.resume.json" and (kept.log_path, kept.logs_before) == (
        second,
        (first,),
    )
    assert (
        len(list(resume.find_open_jobs(tmp_path, dt.datetime.now(dt.UTC)))) == 1
        and keeper.tally.log_before == first
    )


def test_a_clock_set_back_does_not_bring_an_older_job_forward(tmp_path):
    import os
    import time

    hour_ns = 3_600_000_000_000
    resume.write_snapshot(
        tmp_path / "a.resume.json", Snapshot("a.csv", sums=TotalSums(area_ha=1.0))
    )
    os.utime(tmp_path / "a.resume.json", ns=(time.time_ns() + hour_ns, time.time_ns() + hour_ns))
    resume.write_snapshot(
        tmp_path / "b.resume.json", Snapshot("b.csv", sums=TotalSums(area_ha=2.0))
    )
    path, _ = left(tmp_path)
    assert path.name == "b.resume.json"


def test_totals_that_go_on_are_those_of_one_run():
    def add(totals: Totaliser, rates: list[float]) -> None:
        for rate in rates:
            totals.add_tick(0.1, 2.0, rate, 300.0)

    rates = [250.0 + 5.0 * (k % 23) for k in range(500)]
    one, first = Totaliser(2.4, 0.46), Totaliser(2.4, 0.46)
    add(one, rates)
    add(first, rates[:200])
    later = Totaliser(2.4, 0.46, first.running_sums)
    add(later, rates[200:])
    assert later.make_totals() == pytest.approx(one.make_totals(), rel=1e-9)


def test_the_workers_option():
    assert parse_options(["--run-file", "w.json", "--resume", "a.resume.json"]).resume == Path(
        "a.resume.json"
    )


def test_what_fell_after_the_last_row_is_counted_and_said(morning, tmp_path):
    """A board goes on for a second without its host, then its shaft runs down, then what is in
    the air lands."""
    _frames, parts = morning
    kept = resume.read_snapshot(resume.make_snapshot_path(parts.writer.path))
    machine = Machine()
    known, beyond = (add_log_tail(kept, machine, 0.46, stops_s) for stops_s in (None, 1.0))
    last = list(read_log(parts.writer.path).rows())[-1]
    assert last.shaft_rpm_cmd > 0.0 and last.state == "working"
    flow_kg_s = (
        last.applied_rate_kg_ha
        * last.flow_trim
        * machine.geometry.working_width_m
        * last.speed_used_mps
        / 1e4
    )
    assert known.after_cut_kg == 0.0 and 1.2 * flow_kg_s < beyond.after_cut_kg < 1.8 * flow_kg_s
    assert beyond.sums.kg - known.sums.kg == pytest.approx(beyond.after_cut_kg)
    more_m2 = (beyond.ground.done.sum() - known.ground.done.sum()) * known.ground.cell_m**2
    metres = more_m2 / machine.geometry.working_width_m
    assert 2.5 * last.speed_used_mps < metres < 4.5 * last.speed_used_mps, (
        "a second, run-down and fall"
    )
    longer = add_log_tail(kept, machine, 0.46, 4.0)
    assert longer.after_cut_kg - beyond.after_cut_kg == pytest.approx(3.0 * flow_kg_s, rel=0.05)


def test_the_scale_says_what_it_lost_over_the_cut(morning, tmp_path):
    _frames, parts = morning
    kept = json.loads(resume.make_snapshot_path(parts.writer.path).read_text())
    data = kept | {"after_cut_kg": 0.17, "cut_hopper_kg": 100.0}
    keeper = SnapshotKeeper(
        tmp_path / "x.resume.json", Machine(), _read(tmp_path, data), parts.loop, lambda: ""
    )
    assert (keeper.tally.after_cut_kg, keeper.tally.after_cut_scale_kg) == (0.17, None)
    for number in range(120):
        keeper.take_tick(
            Standing(LogRow(0.05 * number, hopper_kg=99.8, shaft_rpm_cmd=0.0, state="off"))
        )
    keeper.save_due(False)
    assert keeper.tally.after_cut_scale_kg == pytest.approx(0.2)


@pytest.mark.exam
def test_a_job_goes_on_after_a_quit_too(tmp_path):
    """Nothing was cut off, and nothing fell after the last row; the ground is done all the same."""
    frames, parts = run(tmp_path / "a.csv", 60.0, orders={50.0: ClientQuestion.QUIT})
    path = resume.make_snapshot_path(parts.writer.path)
    kept = resume.read_snapshot(path)
    assert kept.quit and kept.is_worth_resuming and left(tmp_path)[0] == path
    later, _parts = run(tmp_path / "b.csv", 5.0)
    assert later[0].area_ha == pytest.approx(frames[-1].area_ha, rel=0.02)
    assert not resume.read_snapshot(resume.make_snapshot_path(tmp_path / "b.csv")).quit, (
        "told to stop, but not by anybody's QUIT"
    )


# --- The book of a run's alarms
# --------------------------------------------------------------------------------------

RED = Alarm("shaft_silent", Severity.RED, 1.0)
AMBER = Alarm(
    "hopper_low", Severity.AMBER, 2.0, False, (("hopper_kg", 18.0), ("metres_left", 640.0))
)


def test_first_last_times_and_acknowledged():
    book = AlarmHistory()
    assert [one.id for one in book.add_row_alarms(1.0, "t1", (RED,))] == ["shaft_silent"]
    assert book.add_row_alarms(2.0, "t2", (RED, AMBER))[0].id == "hopper_low"
    assert book.add_row_alarms(3.0, "t3", (RED._replace(acknowledged=True), AMBER)) == ()
    book.add_row_alarms(4.0, "t4", (AMBER,))
    assert [one.id for one in book.add_row_alarms(9.0, "t9", (RED, AMBER))] == ["shaft_silent"], (
        "it came again"
    )
    red, amber = book.records
    assert (red.id, red.first_utc, red.last_utc, red.times, red.stands) == (
        "shaft_silent",
        "t1",
        "t9",
        2,
        True,
    )
    assert red.acknowledged_utc == "t3" and not red.acknowledged, (
        "what came anew is not acknowledged"
    )
    assert (amber.first_s, amber.last_s, amber.times) == (2.0, 9.0, 1)


def test_standing_before_gone_and_red_before_amber():
    book = AlarmHistory()
    book.add_row_alarms(1.0, None, (AMBER,))
    book.add_row_alarms(2.0, None, (RED,))
    assert [(one.id, one.stands) for one in book.records] == [
        ("shaft_silent", True),
        ("hopper_low", False),
    ]
    book.add_row_alarms(3.0, None, (AMBER,))
    assert [one.id for one in book.records] == ["hopper_low", "shaft_silent"]


def test_records_survive_a_file_and_the_time_before_is_added():
    first = AlarmHistory()
    first.add_row_alarms(1.0, "2026-03-18T06:00:00Z", (RED, AMBER))
    kept = tuple(
        build_from_plain(AlarmRecord, one)
        for one in json.loads(json.dumps(convert_to_plain(first.records)))
    )
    assert kept == first.records
    later = AlarmHistory()
    later.add_row_alarms(0.5, "2026-03-18T07:00:00Z", (RED,))
    later.add_earlier_records(kept)
    red, amber = later.records
    assert (
        red.stands
        and red.first_utc == "2026-03-18T06:00:00Z"
        and red.last_utc == "2026-03-18T07:00:00Z"
    )
    assert amber.id == "hopper_low" and not amber.stands
    assert AlarmHistory(kept).add_row_alarms(5.0, "t", (RED,))[0].times == 2


# --- Strips that were measured on the way are still known after a power cut
# ------------------------------------------


def test_the_job_goes_on_with_its_strips(tmp_path):
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    path = tmp_path / "a.resume.json"
    keeper = SnapshotKeeper(
        path,
        setup.machine,
        Snapshot(str(tmp_path / "a.csv")),
        Loop(),
        lambda: "2026-03-18T06:00:00+00:00",
    )
    keeper.take_tick(Standing(LogRow(0.0, state="working", shaft_rpm_cmd=50.0)))
    keeper.take_tick(
        Standing(LogRow(1.0, state="working", events="mark;strip nrich 0.66 0.0041 38"))
    )
    keeper.take_tick(
        Standing(LogRow(2.0, state="working", events="strip check 0.55;strip check x"))
    )
    keeper.save_due(False)
    assert not keeper.trouble
    before = resume.read_snapshot(path)
    assert (before.ndvi_nrich, before.ndvi_check) == (0.66, 0.55)
    job = find_job_to_continue(setup.job, setup.machine, before)
    assert make_rule(setup.crop, job).strip_ndvi == ReferenceStrips(0.66, 0.55)


def test_a_snapshot_of_before_has_no_strips_and_the_trim_that_nobody_reads(tmp_path):
    path = tmp_path / "a.resume.json"
    resume.write_snapshot(path, Snapshot("a.csv"))
    text = path.read_text().replace('"ndvi_nrich":null,', "").replace('"ndvi_check":null,', "")
    assert "ndvi" not in text and '"flow_trim":' not in text
    path.write_text(text.replace('"flow_trim_on"', '"flow_trim":1.02,"flow_trim_on"'))
    assert resume.read_snapshot(path).ndvi_nrich is None


# --- Ground that is done: how it grows and is kept
# -------------------------------------------------------------------

MACHINE = Machine()
WIDTH_M = MACHINE.geometry.working_width_m
STEP_S, SPEED_MPS = 0.05, 2.0
FALL_M = calc_drop_s(MACHINE.fall, 60.0) * SPEED_MPS
NORTH_M = np.arange(0.0, 60.0, 0.1)


def drive(
    done: WorkedGroundRecord,
    north_m: tuple[float, float],
    east_m: float = 0.0,
    rpm: float = 60.0,
    at_s: float = 0.0,
) -> float:
    """Due north at 2 m/s; returns the time at the end."""
    for north in np.arange(*north_m, SPEED_MPS * STEP_S):
        done.add_outlet_place(at_s, (east_m, float(north)), 0.0, rpm, 300.0)
        at_s += STEP_S
    return at_s


def done_at(ground: Raster, places: list[tuple[float, float]]) -> np.ndarray:
    """As a later run's bitmap knows it."""
    coverage = Coverage(WIDTH_M)
    coverage.add_earlier_ground(ground)
    return coverage.find_covered_earlier(places)


@pytest.fixture
def one_pass():
    """From 0 to 50 m north, 10 to 40 of it with flow."""
    done = WorkedGroundRecord(MACHINE)
    at_s = drive(done, (0.0, 10.0), rpm=0.0)
    at_s = drive(done, (10.0, 40.0), at_s=at_s)
    drive(done, (40.0, 50.0), rpm=0.0, at_s=at_s)
    return done


def test_only_where_something_landed_is_done_and_it_lands_later(one_pass):
    ground = one_pass.make_raster()
    area_m2 = ground.done.sum() * ground.cell_m**2
    assert area_m2 == pytest.approx(30.0 * WIDTH_M, rel=0.06)
    landed = np.flatnonzero(done_at(ground, [(0.0, north) for north in NORTH_M]))
    fall_m = NORTH_M[landed[0]] - 10.0
    assert fall_m == pytest.approx(FALL_M, abs=0.3), "what is released at 10 m lands after its drop"
    assert NORTH_M[landed[-1]] - 40.0 == pytest.approx(fall_m, abs=0.3)


def test_a_pass_beside_it_is_not_done_but_the_same_way_is(one_pass):
    places = [(0.0, 25.0), (0.45 * WIDTH_M, 25.0), (WIDTH_M, 25.0), (0.0, 45.0)]
    assert done_at(one_pass.make_raster(), places).tolist() == [True, True, False, False]


def test_kept_and_read_back_it_is_the_same_and_two_parts_are_one(one_pass):
    first = one_pass.make_raster()
    again = unpack_raster(pack_raster(first))
    assert again[:3] == first[:3] and (again.done == first.done).all()
    later = WorkedGroundRecord(MACHINE, again, tuple(one_pass.track))
    drive(later, (100.0, 130.0), east_m=-70.0)
    both = later.make_raster()
    assert done_at(both, [(0.0, 25.0), (-70.0, 115.0), (-35.0, 60.0)]).tolist() == [
        True,
        True,
        False,
    ]
    assert both.done.sum() > 1.8 * first.done.sum()
    assert len(later.track) > len(one_pass.track)


@pytest.mark.parametrize(
    "change", [{"bits": "AAAA"}, {"rows": 0}, {"cell_m": -1.0}, {"columns": 7}]
)
def test_ground_that_was_not_kept_whole_is_refused(one_pass, change):
    with pytest.raises((ValueError, KeyError)):
        unpack_raster(pack_raster(one_pass.make_raster()) | change)


@pytest.mark.exam
def test_a_long_day_is_thinned_not_forgotten():
    done = WorkedGroundRecord(MACHINE)
    for k in range(int(MAX_TRACK_PLACES * 1.5)):
        done.add_outlet_place(0.5 * k, (0.0, 1.0 * k), 0.0, 60.0, 300.0)
    norths = [spot[1] for spot in done.track]
    assert (
        len(norths) <= MAX_TRACK_PLACES
        and norths[0] < 5.0
        and norths[-1] > MAX_TRACK_PLACES * 1.5 - 10.0
    )


def test_an_empty_raster_joins_with_anything():
    some = Raster(0.0, 0.0, 0.25, np.ones((4, 4), dtype=np.bool_))
    assert join_rasters(EMPTY_RASTER, some) is some and join_rasters(some, EMPTY_RASTER) is some


def test_parts_too_far_apart_for_one_picture_give_the_newer_one():
    here = Raster(0.0, 0.0, 0.25, np.ones((4, 4), dtype=bool))
    assert join_rasters(here, here._replace(west_m=80_000.0, south_m=80_000.0)).west_m == 80_000.0
