"""The Job screen: the list before work, the N-rich strip, refills, other files, export, and
going on after a cut."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace

import numpy as np
import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import ChoiceDialog, Confirm
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.job.checklist import (
    LOOK,
    OK,
    STOP,
    JobCheck,
    find_worst_level,
    list_checks,
    make_total_items,
)
from topdress.console.app.pages.job.checklist_panel import CheckList, fit_checks
from topdress.console.app.pages.job.refill import RefillWatch
from topdress.console.app.pages.job.service import EarlierRun, JobOffer
from topdress.console.app.pages.job.strip_measurement import StripRun, calc_standard_error
from topdress.console.app.services import Services
from topdress.console.app.units import METRIC
from topdress.console.frame import JobCounts
from topdress.console.link import WorkerGone
from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.control.agronomy.reference_strips import ReferenceStrips, parse_strip
from topdress.control.field.job import Wanted
from topdress.control.log_row import LogRow
from topdress.control.orders import Do, Order, Severity

from tests.app.gallery import StillSource
from tests.app.harness import feed, looked, settled
from tests.app.made_up.job import FACTS, SampleJobService, facts_of

SIZE = (120, 40)
OFFER = JobOffer(
    "a.resume.json", "2026-03-18T14:18:00+00:00", "2026-03-18T15:02:00+00:00", "division 2", 1.2
)


@pytest.fixture
def desk():
    return SampleJobService()


@pytest.fixture
def app(source, clock, desk):
    return TopdressApp(source, clock, live=False, utc_offset_s=0.0, services=Services(job=desk))


async def on_job(app, pilot):
    await pilot.press("f10")
    await settled(app, pilot)


def levels(frame, facts=FACTS, free=10**11, age_s=0.0, trouble=""):
    return {
        check.label: check.level
        for check in list_checks(frame, age_s, facts, trouble, free, METRIC)
    }


async def test_a_console_of_another_computer_checks_what_it_knows(source, clock):
    """A tablet reads no files of the machine's computer: that is no reason not to work."""
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0)
    async with app.run_test(size=SIZE) as pilot:
        await on_job(app, pilot)
        found = app.page.list_checks()
        assert [check.label for check in found] == ["devices", "hopper", "log"]
        assert find_worst_level(found) == OK, found


def test_what_is_to_be_looked_at_before_work(frames):
    frame = frames[-1]
    assert levels(frame) == {
        "devices": OK,
        "crop": LOOK,
        "N-rich strip": OK,
        "limits": OK,
        "field": OK,
        "machine": OK,
        "hopper": OK,
        "log": OK,
    }
    assert (
        find_worst_level(list_checks(frame, 0.0, facts_of({"examples": ()}), "", 10**11, METRIC))
        == OK
    )
    silent = replace(
        frame,
        devices=tuple(
            replace(one, age_s=5.0) if one.name == "gnss" else one for one in frame.devices
        ),
    )
    assert levels(silent)["devices"] == LOOK
    board = replace(
        frame,
        devices=tuple(
            replace(one, connected=False) if one.name == "board" else one for one in frame.devices
        ),
    )
    assert levels(board)["devices"] == STOP
    assert levels(frame, age_s=2.0)["devices"] == STOP and levels(None)["devices"] == STOP
    assert (
        levels(frame, facts_of({"ndvi_nrich": 0.7}, {"ndvi_nrich": None}))["N-rich strip"] == LOOK
    )
    fixed, none = {"fixed_yield_t_ha": 6.0}, {"ndvi_nrich": None}
    assert levels(frame, facts_of(fixed, none))["N-rich strip"] == LOOK
    assert (
        levels(frame, facts_of(fixed, none | {"target": Wanted(source="map", map="a.csv")}))[
            "N-rich strip"
        ]
        == OK
    )
    assert levels(frame, replace(FACTS, field_ha=None))["field"] == LOOK
    assert levels(frame, facts_of(machine={"adopted": ()}, shipped_machine=True))["machine"] == LOOK
    assert [levels(frame, free=free)["log"] for free in (10**8, 10**9, 10**10, None)] == [
        STOP,
        LOOK,
        OK,
        LOOK,
    ]
    assert levels(replace(frame, log_path=""))["log"] == STOP
    assert (
        levels(replace(frame, tally=JobCounts(trouble="a.resume.json: disk full")))["log"] == LOOK
    )
    assert levels(frame, None, trouble="job.yaml: no such file")["job"] == STOP


def test_what_is_well_gives_way_where_not_all_have_room():
    """The log's STOP stands last on the list: it must not be cut off by eight lines that are
    well."""
    some = tuple(
        JobCheck(str(k), level, "") for k, level in enumerate((OK, LOOK, OK, OK, OK, STOP))
    )
    assert fit_checks(some, 6) == some
    assert [check.label for check in fit_checks(some, 5)] == ["0", "1", "2", "5"]
    assert [check.label for check in fit_checks(some, 3)] == ["1", "5"]


@pytest.mark.parametrize("height", range(4, 14))
def test_the_list_fills_its_rows_and_no_more(height):
    """What is to be looked at is said in further rows, as far as there are any."""
    some = tuple(
        JobCheck(str(k), level, "short", ("one", "two"))
        for k, level in enumerate((OK, LOOK, OK, OK, STOP))
    )
    rows = CheckList(some).draw_rows(some, 60, height)
    assert len(rows) == min(height, 1 + len(some) + 4)
    assert any("more" in row.plain for row in rows) == (height < 1 + len(some))


def test_every_warning_of_the_crop_stands_in_full(frames):
    facts = facts_of({"flag": "first", "examples": ("second",)})
    crop = next(
        check
        for check in list_checks(frames[-1], 0.0, facts, "", None, METRIC)
        if check.label == "crop"
    )
    assert {"first", "example values, not of this field: second"} <= set(crop.full)


def test_totals_in_words(frames):
    frame = replace(frames[-1], tally=JobCounts(130.0, 60, (("t", 250.0), ("t", 25.0))))
    shown = {item.label: item.value.text for item in make_total_items(frame, 0.0, METRIC)}
    worked_s = frame.totals.worked_s
    assert shown["held"] == "02:10" and shown["filled in"] == "275 kg"
    assert shown["gate moves"] == (
        "--" if worked_s < 60.0 else f"{60 * 3600 / worked_s:.0f} an hour"
    )
    assert shown["mean rate"].endswith("kg/ha") and shown["evenness"].count("%") == 2
    assert shown["covered"].startswith(f"{0.97 * frame.area_ha:.2f} ha  twice")
    assert all(item.value.stale for item in make_total_items(frame, 3.0, METRIC))


def test_ground_covered_and_doses_in_words(frames):
    sums = frames[-1].totals._replace(covered_ha=1.184, overlap_ha=0.023, doses=412, doses_missed=3)
    by_rate = {
        item.label: item.value.text
        for item in make_total_items(replace(frames[-1], totals=sums), 0.0, METRIC)
    }
    assert by_rate["covered"] == "1.18 ha  twice 0.02 ha" and "doses" not in by_rate
    by_plant = {
        item.label: item.value.text
        for item in make_total_items(
            replace(frames[-1], totals=sums, threshold_m=-0.083), 0.0, METRIC
        )
    }
    assert (by_plant["doses"], by_plant["threshold"]) == ("412  missed 3", "-0.08 m")
    assert "evenness" not in by_plant and len(by_plant) == len(by_rate)


async def test_the_screen_says_what_is_wrong_and_shows_it_in_full(app, desk, shown):
    desk.known = facts_of({"flag": "what is not to be forgotten " * 8, "examples": ()})
    async with app.run_test(size=(80, 24)) as pilot:
        await on_job(app, pilot)
        rows = shown(app)
        assert any("crop" in row and "! look" in row for row in rows)
        assert any("forgotten" in row and "... V" in row for row in rows), (
            "the rest of it is a key away"
        )
        await pilot.click(CheckList, offset=(5, 3))
        assert sum("forgotten" in row for row in shown(app)) >= 3


async def test_files_that_are_broken_are_a_line(app, desk, shown):
    desk.trouble = "job.yaml: key crop: missing"
    async with app.run_test(size=SIZE) as pilot:
        await on_job(app, pilot)
        assert any("STOP" in row and "job.yaml: key crop: missing" in row for row in shown(app))


# --- N-rich strip
# --------------------------------------------------------------------------------------------------


def test_a_strip_is_the_mean_by_way_not_by_time():
    run = StripRun()
    time_s = 0.0
    for speed, ndvi, seconds in ((1.0, 0.6, 10.0), (2.0, 0.8, 10.0), (0.0, 0.1, 50.0)):
        for _ in range(round(seconds / 0.2)):
            run.add_row(LogRow(time_s, ndvi=ndvi, speed_used_mps=speed))
            time_s += 0.2
    strip = run.strip
    assert strip.length_m == pytest.approx(30.0, abs=0.5)
    assert strip.ndvi == pytest.approx((6.0 + 16.0) / 30.0, abs=0.005)
    assert (
        strip.cv_percent == pytest.approx(100 * 0.0943 / 0.7333, abs=0.5) and strip.is_long_enough
    )


def test_gaps_and_silent_heads_add_nothing():
    run = StripRun()
    for time_s, ndvi in ((0.0, 0.7), (10.0, 0.7), (10.2, None), (10.4, 0.7)):
        run.add_row(LogRow(time_s, ndvi=ndvi, speed_used_mps=2.0))
    assert (
        run.strip.length_m == pytest.approx(0.4)
        and not run.strip.is_long_enough
        and StripRun().strip.ndvi is None
    )


async def test_a_strip_is_driven_counts_at_once_and_is_kept(app, desk, source, clock, pilot):
    """An order to the worker that runs, and a job file for the next start; nothing is started
    again."""
    await on_job(app, pilot)
    feed(app, [{"state": "ready"}])
    await pilot.press("b")
    start_s = source.current_frame.row.time_s
    feed(
        app,
        [
            {"time_s": start_s + 0.2 * k, "ndvi": 0.70 + 0.02 * (k % 2), "speed_used_mps": 2.0}
            for k in range(1, 30)
        ],
    )
    await pilot.press("b")
    assert isinstance(app.screen, Confirm) and "Cancel the strip" in app.screen.heading, (
        "11 m are too few"
    )
    await pilot.press("escape")
    feed(app, [{"time_s": start_s + 0.2 * k, "ndvi": 0.70 + 0.02 * (k % 2)} for k in range(30, 90)])
    await pilot.press("b")
    assert app.screen.heading == "NDVI 0.710 as the N-rich strip of this job?" and desk.asked == []
    assert "CV 1.4 %, standard error 0.001, 88 samples" in app.screen.text
    await pilot.press("enter")
    await settled(app, pilot)
    assert desk.asked == [("strip", "nrich", "0.710")] and not isinstance(app.screen, Confirm)
    given = [order for order in source.orders if order.do is Do.STRIP]
    assert [parse_strip(order.value)[:2] for order in given] == [
        ("nrich", pytest.approx(0.71, abs=1e-3))
    ]


async def test_by_the_fields_index_the_strip_is_chosen_and_the_index_judged(app, desk, source):
    desk.known = facts_of(job={"response_index": "field", "ndvi_nrich": 0.60})
    async with app.run_test(size=SIZE) as pilot:
        await on_job(app, pilot)
        await pilot.press("b")
        assert isinstance(app.screen, ChoiceDialog) and len(app.screen.choices) == 2
        await pilot.press("2", "enter")
        start_s = source.current_frame.row.time_s
        feed(
            app,
            [
                {"time_s": start_s + 0.2 * k, "ndvi": 0.65, "speed_used_mps": 2.0}
                for k in range(1, 90)
            ],
        )
        await pilot.press("b")
        assert app.screen.heading == "NDVI 0.650 as the farmer check of this job?"
        assert "RI 0.92: the N-rich strip is no greener" in app.screen.text
        await pilot.press("enter")
        await settled(app, pilot)
        assert desk.asked == [("strip", "check", "0.650")]


def test_strips_and_index_on_the_list(frames):
    frame, facts = frames[-1], facts_of(job={"response_index": "field"})
    texts = {
        check.label: (check.level, check.text)
        for check in list_checks(frame, 0.0, facts, "", 10**11, METRIC)
    }
    assert texts["response index"] == (LOOK, "farmer check missing: drive one with B")
    live = replace(frame, strips=ReferenceStrips(0.66, 0.55))
    texts = {
        check.label: (check.level, check.text)
        for check in list_checks(live, 0.0, facts, "", 10**11, METRIC)
    }
    assert texts["response index"] == (OK, "RI 1.20: N-rich 0.660 over check 0.550")
    assert texts["N-rich strip"] == (OK, "NDVI 0.660  measured on the way")
    for strips, said in (
        (ReferenceStrips(0.5, 0.55), "no greener"),
        (ReferenceStrips(0.9, 0.29), "above 3"),
    ):
        level, text = {
            check.label: (check.level, check.text)
            for check in list_checks(replace(frame, strips=strips), 0.0, facts, "", 10**11, METRIC)
        }["response index"]
        assert level == LOOK and said in text


def test_a_strip_is_measured_by_whatever_source_the_machine_works():
    """By a map or by hand the row has no fused value: the middle head stands in."""
    run = StripRun()
    for k in range(120):
        run.add_row(LogRow(0.2 * k, ndvi_1=0.5, ndvi_2=0.7, ndvi_3=0.72, speed_used_mps=1.0))
    assert run.strip.ndvi == pytest.approx(0.7) and run.strip.is_long_enough


def test_samples_that_are_alike_count_for_less():
    """White noise: s over the root of n. A slow wave of the same spread: neighbours tell the
    same twice."""
    rng = np.random.default_rng(1)
    white = (0.7 + 0.02 * rng.standard_normal(400)).tolist()
    assert calc_standard_error(white) == pytest.approx(0.02 / 20.0, rel=0.15)
    wave = (0.7 + 0.02 * np.sqrt(2.0) * np.sin(np.arange(400) / 10.0)).tolist()
    assert calc_standard_error(wave) > 4.0 * calc_standard_error(white)
    assert calc_standard_error([0.7, 0.7]) is None and calc_standard_error([0.7] * 5) == 0.0


async def test_a_working_machine_is_not_started_again(app, desk, source, shown, pilot):
    await on_job(app, pilot)
    await pilot.press("q", "2", "enter", "2", "enter")
    await settled(app, pilot)
    assert desk.asked == [("take", "machine", "machines/bench.yaml"), ("drop",)]
    assert not isinstance(app.screen, Confirm) and app.notice_text.startswith("the machine works")
    assert any("not taken: bench.yaml; the job goes on as it was" in row for row in shown(app))
    feed(app, [{"state": "off"}])
    await pilot.press("f2")
    await on_job(app, pilot)
    await pilot.press("q", "2", "enter", "2", "enter")
    await settled(app, pilot)
    assert isinstance(app.screen, Confirm)
    await pilot.press("escape")
    await settled(app, pilot)
    assert desk.asked[-1] == ("drop",) and app.page.pending == "" and ("restart",) not in desk.asked


@pytest.mark.parametrize(
    ("keys", "how"),
    [(("enter",), ["restart"]), (("2", "enter"), ["restart anew"]), (("escape",), [])],
)
async def test_what_would_be_spread_twice_is_asked_first(
    app, desk, source, frames, shown, keys, how
):
    """A map, a job, a machine taken in the middle of a field: what was done there was forgotten
    without a word."""
    desk.cut_off, desk.next = OFFER, StillSource(frames[-1])
    async with app.run_test(size=SIZE) as pilot:
        await on_job(app, pilot)
        feed(app, [{"state": "off"}])
        await pilot.press("q", "2", "enter", "2", "enter")
        await settled(app, pilot)
        text = " ".join(" ".join(shown(app)).split())
        assert (
            isinstance(app.screen, ChoiceDialog)
            and "resume the job of 14:18 (1.20 ha done)" in text
        )
        assert (
            "gets nothing a second time" in app.screen.text
            and "gets material again" in app.screen.text
        )
        await pilot.press(*keys)
        await settled(app, pilot)
        assert [one[0] for one in desk.asked if one[0].startswith("restart")] == how
        assert (("drop",) in desk.asked) is (not how)


async def test_what_was_said_of_one_run_is_not_said_of_the_next(app, desk, source, shown, pilot):
    """Taken after all, the map ran under "not taken"; and what the hopper held in the run
    before was no refill."""
    await on_job(app, pilot)
    app.page.add_note("written: report.html in reports")
    await pilot.press("q", "2", "enter", "2", "enter")
    await settled(app, pilot)
    assert any("not taken: bench.yaml" in row for row in shown(app))
    app.page.refill.seen_kg = 16.0
    source.current_frame = replace(
        source.current_frame, seq=source.current_frame.seq + 1, log_path="logs/next.csv"
    )
    app.show_newest()
    await settled(app, pilot)
    text = "\n".join(shown(app))
    assert (
        "not taken" not in text and "the scale saw" not in text and "written: report.html" in text
    )


async def test_a_file_that_is_refused_is_a_line(app, desk, source, shown, pilot):
    await on_job(app, pilot)
    desk.trouble = "crops/durum.yaml: key y_max_t_ha: missing"
    await pilot.press("q", "1", "enter", "2", "enter")
    await settled(app, pilot)
    assert any("not taken: crops/durum.yaml: key y_max_t_ha: missing" in row for row in shown(app))
    assert desk.asked == [("take", "crop", "crops/durum.yaml")]


def test_the_numbers_of_the_pictures_add_up(frames):
    """What is in the hopper now, spread and filled in: it began with some of a hopper."""
    last = frames[-1]
    began_kg = last.row.hopper_kg + last.applied_kg - sum(kg for _, kg in last.tally.refills)
    assert 0.0 <= began_kg <= 300.0
    assert last.mean_rate_kg_ha == pytest.approx(last.applied_kg / last.area_ha, rel=0.01)


# --- refills
# --------------------------------------------------------------------------------------------------


def rows(masses, state="held", from_s=0.0, speed=0.0):
    return [
        LogRow(from_s + 0.2 * k, hopper_kg=kg, state=state, speed_used_mps=speed)
        for k, kg in enumerate(masses)
    ]


def seen(*parts) -> float | None:
    watch = RefillWatch()
    for row in sorted((row for part in parts for row in part), key=lambda row: row.time_s):
        watch.add_row(row)
    return watch.seen_kg


def test_a_step_of_the_scale_is_a_refill_once_it_has_settled():
    before = rows([40.0 + 0.1 * (k % 2) for k in range(30)])
    pouring = rows([40.0 + 5.0 * k for k in range(42)], from_s=6.0)
    after = rows([250.0 - 0.1 * (k % 2) for k in range(30)], from_s=14.4)
    assert seen(before, pouring) is None, "it still rises"
    assert seen(before, pouring, after) == pytest.approx(209.9, abs=0.3)


def test_what_is_no_refill():
    small = rows([40.0] * 30 + [44.0] * 30)
    assert seen(small) is None
    assert seen(rows([40.0] * 30 + [80.0] * 30, state="working")) is None
    assert seen(rows([40.0] * 30 + [80.0] * 30, speed=1.0)) is None
    assert seen(rows([None] * 30 + [80.0] * 30)) is None, "nothing was known before"
    assert seen(rows([40.0 if k % 5 else 90.0 for k in range(80)])) is None, "it never settles"


def test_two_bags_add_up_and_what_was_recorded_does_not_come_again():
    watch = RefillWatch()
    for row in rows([40.0] * 30 + [65.0] * 30 + [90.0] * 30):
        watch.add_row(row)
    assert watch.seen_kg == pytest.approx(50.0)
    watch.end_refill()
    for row in rows([90.0] * 30, from_s=30.0):
        watch.add_row(row)
    assert watch.seen_kg is None


async def test_a_refill_is_offered_on_every_page_and_recorded_by_enter(app, source, pilot):
    start_s = source.current_frame.row.time_s
    feed(
        app,
        [
            {
                "time_s": start_s + 0.2 * k,
                "hopper_kg": 40.0 if k < 30 else 290.0,
                "state": "held",
                "speed_used_mps": 0.0,
            }
            for k in range(1, 60)
        ],
    )
    assert (
        app.notice_text == "the scale saw 250 kg filled in: F10, F records it"
        and source.orders == []
    )
    await on_job(app, pilot)
    await pilot.press("f")
    assert isinstance(app.screen, NumberDialog) and app.screen.typed == "250.0"
    await pilot.press("enter")
    assert source.orders == [Order(Do.REFILL, 250.0)] and app.page.refill.seen_kg is None


# --- export and end
# --------------------------------------------------------------------------------------------------


async def test_the_end_of_the_job_is_asked_marked_exported_and_reported(
    app, desk, source, shown, pilot
):
    await on_job(app, pilot)
    await pilot.press("q", "5", "enter")
    assert "the machine works" in "\n".join(shown(app)) and desk.asked == []
    await pilot.press("escape")
    feed(app, [{"state": "off"}])
    await pilot.press("q", "5", "enter", "enter")
    await settled(app, pilot)
    assert source.orders == [Order(Do.MARK, "job finished")]
    assert desk.asked == [("export", "run.csv", ".geojson"), ("report", "run.csv")]
    text = "\n".join(shown(app))
    assert "written: run-applied.geojson in ." in text and "written: run-report.html" in text


async def test_an_export_that_fails_is_a_line_and_escape_cancels(app, desk, shown, pilot):
    await on_job(app, pilot)
    desk.trouble = "run.csv: no row of work with a place"
    await pilot.press("e", "2", "enter")
    await settled(app, pilot)
    assert desk.asked == [("export", "run.csv", ".shp")]
    assert any("not written: run.csv: no row of work with a place" in row for row in shown(app))

    begun, go = asyncio.Event(), []
    loop = asyncio.get_running_loop()

    def slow(log_path, progress, cancelled):
        progress(1, 3, "gathering")
        loop.call_soon_threadsafe(begun.set)
        while not cancelled():
            time.sleep(0.01)
        go.append("ended")
        return ("never.html",)

    desk.write_reports = slow
    await pilot.press("q", "4", "enter")
    await asyncio.wait_for(begun.wait(), 30)
    await looked(app, pilot)
    assert any("report: gathering (1 of 3)   Esc cancels" in row for row in shown(app))
    await pilot.press("escape")
    async with asyncio.timeout(30):
        while not go:
            await asyncio.sleep(0.01)
    await settled(app, pilot)
    text = "\n".join(shown(app))
    assert "cancelled" in text and "never.html" not in text


# --- power cuts
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("keys", "asked"), [(("enter",), "resume"), (("2", "enter"), "anew")])
async def test_a_job_that_was_cut_off_is_offered_at_the_start(frames, clock, keys, asked):
    desk = SampleJobService(cut_off=OFFER)
    desk.next = StillSource(frames[-1])
    app = TopdressApp(None, clock, live=False, utc_offset_s=0.0, services=Services(job=desk))
    async with app.run_test(size=SIZE) as pilot:
        assert (
            isinstance(app.screen, ChoiceDialog)
            and app.screen.heading == "A job was left at 15:02: division 2"
        )
        labels = [choice.label for choice in app.screen.choices]
        assert labels == ["resume the job of 14:18 (1.20 ha done)", "begin anew"]
        await pilot.press(*keys)
        await settled(app, pilot)
        assert desk.asked == [(asked,)] and app.source is desk.next and desk.next.orders == []


async def test_another_job_on_the_command_line_holds_either_way_and_that_is_said(frames, clock):
    """`topdress run other.yaml` and Enter resumed the old job by its own files, without a word."""
    desk = SampleJobService(cut_off=OFFER._replace(others=("/home/ann/other.yaml",)))
    desk.next = StillSource(frames[-1])
    app = TopdressApp(None, clock, live=False, utc_offset_s=0.0, services=Services(job=desk))
    async with app.run_test(size=SIZE) as pilot:
        assert "Either way it goes by other.yaml from now on." in app.screen.text
        await pilot.press("enter")
        await settled(app, pilot)
        assert desk.asked == [("resume",)]


async def test_escape_begins_nothing_and_c_asks_again(clock):
    desk = SampleJobService(cut_off=OFFER)
    app = TopdressApp(
        None, clock, live=False, services=Services(job=desk), start=desk.restart_worker
    )
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("escape")
        assert desk.asked == [] and "X connects" in app.notice_text
        await pilot.press("c", "1", "enter")
        assert isinstance(app.screen, ChoiceDialog)


async def test_a_worker_that_died_is_offered_to_go_on(app, desk, source, frames):
    app.start = desk.restart_worker
    async with app.run_test(size=SIZE) as pilot:
        desk.cut_off, desk.next = OFFER, StillSource(frames[-1])
        source.end.set_exception(WorkerGone("gone"))
        await pilot.pause()
        await pilot.press("1", "enter")
        assert isinstance(app.screen, ChoiceDialog)
        await pilot.press("enter")
        await settled(app, pilot)
        assert desk.asked == [("resume",)] and app.source is desk.next and not app.gone


async def test_what_was_before_this_console_is_learned(source, clock):
    before = EarlierRun(
        (
            AlarmRecord(
                "shaft_silent",
                Severity.RED,
                1.0,
                2.0,
                3,
                "2026-03-18T06:00:00Z",
                "2026-03-18T06:01:00Z",
            ),
        ),
        tuple((500.0 + k, 500.0, 90.0, 300.0) for k in range(20)),
    )
    app = TopdressApp(
        source,
        clock,
        live=False,
        services=Services(job=SampleJobService(), earlier=lambda _: before),
    )
    async with app.run_test(size=SIZE) as pilot:
        await settled(app, pilot)
        assert [record.times for record in app.alarm_history.records] == [3]
        box = app.history.worked.box
        assert box is not None and box.east_m > 515.0
