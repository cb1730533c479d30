"""The Calibrate screen: what is ordered while a key is held, what is asked, what is computed
and saved."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import ChoiceDialog
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.calibrate.guide_panel import GuidePanel
from topdress.console.app.pages.calibrate.progress_rows import BarRow, ProgressRows
from topdress.console.app.services import Services
from topdress.console.app.widgets.action_chips import Chips, place_chips
from topdress.console.link import WorkerGone
from topdress.control.orders import Answer, Do, Order
from topdress.control.safety import BenchRun

from tests.app.harness import feed, later, looked, settled, tell
from tests.app.made_up.calibrate import (
    POINTS,
    lag_under_way,
    many_devices,
    sample_calibrate_job,
    standing,
)

SIZE = (100, 30)
BEGIN = [Order(Do.CALIBRATE), Order(Do.CALIBRATE_OPENING, 25.0), Order(Do.CALIBRATE_SHAFT, 70.0)]


@pytest.fixture
def job():
    return sample_calibrate_job()


@pytest.fixture
def app(source, frames, clock, job):
    source.current_frame = standing(frames[-1])
    return TopdressApp(
        source, clock, live=False, utc_offset_s=0.0, services=Services(calibrate=job)
    )


@pytest.fixture
def opened(app):
    """Opens the page at one of its calibrations."""

    async def go(pilot, right: int = 0):
        await pilot.pause()
        await pilot.press("f6", *(["right"] * right))
        return app.page

    return go


def chip_of(page, action):
    chips = page.query_one("#cal-chips", Chips)
    return next(one for one in place_chips(chips.view, chips.size.width) if one[0].action == action)


async def hold_mouse(pilot, page, action):
    _chip, row, start, _cells = chip_of(page, action)
    await pilot.mouse_down("#cal-chips", offset=(start + 1, row))
    await pilot.pause()


@pytest.fixture
async def page(opened, pilot):
    return await opened(pilot)


async def test_one_press_of_the_key_turns_nothing(source, clock, pilot, page):
    await pilot.press("i")
    assert source.orders == []
    assert "Keep it pressed" in page.runner.standstill_reason


async def test_a_held_key_runs_and_half_a_second_after_the_last_repeat_it_is_released(
    source, clock, pilot, page
):
    await pilot.press("i")
    clock.now_s += 0.5
    for _repeat in range(10):
        await pilot.press("i")
        clock.now_s += 0.05
    assert source.orders[:3] == BEGIN
    assert source.orders[3:] and set(source.orders[3:]) == {Order(Do.CALIBRATE)}
    assert len(source.orders) <= 3 + 6, "no more than ten a second"
    released_s = clock.now_s
    while Order(Do.RELEASE) not in source.orders and clock.now_s - released_s < 0.45:
        clock.now_s += 0.05
        page.watch_hold()
        await pilot.pause()
    assert source.orders[-1] == Order(Do.RELEASE)


async def test_the_mouse_button_runs_and_its_release_stops_at_once(app, source, clock, pilot, page):
    await hold_mouse(pilot, page, "cal_run")
    assert source.orders == BEGIN
    for _tick in range(10):
        await later(app, pilot, 0.2)
    assert source.orders[3:] == [Order(Do.CALIBRATE)] * 10
    await pilot.mouse_up("#cal-chips", offset=(1, 0))
    await pilot.pause()
    assert source.orders[-1] == Order(Do.RELEASE)


async def test_the_button_slipping_off_stops(source, pilot, page):
    await hold_mouse(pilot, page, "cal_run")
    await pilot.hover("#cal-sheet", offset=(3, 3))
    assert source.orders[-1] == Order(Do.RELEASE)


@pytest.mark.parametrize("how", ["page", "lock", "other calibration"])
async def test_what_takes_the_screen_away_stops(app, source, clock, how, pilot, page):
    await hold_mouse(pilot, page, "cal_run")
    if how == "page":
        await pilot.press("f2")
    elif how == "lock":
        await pilot.press("f8")
        page.watch_hold()
    else:
        await pilot.press("right")
    await pilot.pause()
    assert source.orders[-1] == Order(Do.RELEASE)
    count = len(source.orders)
    clock.now_s += 1.0
    app.show_newest()
    page.watch_hold()
    await pilot.pause()
    assert len(source.orders) == count


async def test_a_refusal_is_said_in_words_and_not_asked_again_by_the_same_press(
    app, source, clock, opened, shown
):
    source.answer = Answer(False, "calibrate_moving;speed_mps=0.1")
    async with app.run_test(size=SIZE) as pilot:
        page = await opened(pilot)
        await hold_mouse(pilot, page, "cal_run")
        await later(app, pilot, 0.2)
        text = " ".join(row.strip() for row in shown(app))
        assert "Calibrating needs wheel and GNSS" in text
        assert source.orders == [Order(Do.CALIBRATE), Order(Do.RELEASE)], "no shaft speed was sent"
        await later(app, pilot, 0.2)
        assert len(source.orders) == 2


async def test_an_answer_that_is_late_does_not_end_the_run(app, source, clock, pilot, page):
    await hold_mouse(pilot, page, "cal_run")
    source.answer = Answer(False, "no_answer")
    await later(app, pilot, 0.2)
    assert source.orders[-1] == Order(Do.CALIBRATE)


async def test_a_worker_that_is_gone_ends_the_run(app, source, clock, pilot, page):

    async def gone(order):
        raise WorkerGone("gone")

    source.send_order = gone
    await hold_mouse(pilot, page, "cal_run")
    assert not page.runner.held.is_down(clock.now_s) and app.gone


async def test_locked_nothing_of_the_page_works(app, source, pilot, page):
    await pilot.press("f8")
    chips = page.query_one("#cal-chips", Chips).view
    assert not any(chip.on or chip.lead for chip in chips), "drawn as if they worked"
    await pilot.press(
        "i",
        "i",
        "i",
        "r",
        "q",
        "1",
        "enter",
        "q",
        "2",
        "enter",
        "q",
        "3",
        "enter",
        "b",
        "q",
        "5",
        "enter",
        "e",
        "right",
    )
    app.notice_text = ""
    await hold_mouse(pilot, page, "cal_run")
    await pilot.pause()
    assert "locked" in app.notice_text
    assert source.orders == [] and len(app.screen_stack) == 2 and page.at == 0
    await pilot.press("space", "x")
    assert source.orders == [Order(Do.HOLD), Order(Do.STOP)]


async def test_settings_are_typed_within_the_machine_s_range_and_sent_at_the_next_run(
    app, source, pilot, page
):
    await pilot.press("q", "1", "enter", "1", "0", "1", "enter")
    assert isinstance(app.screen, NumberDialog), "101 r/min is more than the machine has"
    await pilot.press("delete", "9", "0", "enter", "q", "2", "enter", "4", "0", "enter")
    assert source.orders == []
    await hold_mouse(pilot, page, "cal_run")
    assert source.orders[1:] == [Order(Do.CALIBRATE_OPENING, 40.0), Order(Do.CALIBRATE_SHAFT, 90.0)]


async def caught(app, source, clock, pilot, *, frame, rpm, mm, seconds):
    """Frames of a run at these settings, five a second."""
    time_s = source.current_frame.row.time_s
    seq = source.current_frame.seq
    for index in range(int((seconds + 2.0) / 0.2)):
        time_s, seq = time_s + 0.2, seq + 1
        running = index * 0.2 < seconds
        row = frame.row._replace(
            time_s=time_s,
            state="calibrating" if running else "ready",
            opening_mm=mm,
            shaft_rpm=rpm if running else 0.0,
        )
        source.current_frame = replace(
            frame,
            seq=seq,
            at_s=time_s,
            row=row,
            why_no_flow=(),
            bench=BenchRun(rpm, mm, 0.2 * index, 100.0) if running else None,
        )
        clock.now_s += 0.2
        if index % 5 == 0:
            app.show_newest()
        else:
            app.page.gather_frame(source.current_frame)
    await later(app, pilot)


async def test_a_catch_test_from_settling_to_the_new_machine_file(
    app, source, clock, frames, opened, shown
):
    frame = standing(frames[-1])
    # a scale that stood still would be asked about
    frame = replace(frame, row=frame.row._replace(hopper_kg=None))
    async with app.run_test(size=SIZE) as pilot:
        page = await opened(pilot)
        for rpm, mm, mass in ((70.0, 20.0, "3.87"), (70.0, 35.0, "6.7"), (90.0, 50.0, "12.4")):
            for digit, value in (("1", rpm), ("2", mm)):
                await pilot.press("q", digit, "enter", *f"{value:.0f}", "enter")
            await pilot.press("q", "3", "enter")
            assert len(app.screen_stack) == 2, "nothing is caught yet"
            await caught(app, source, clock, pilot, frame=frame, rpm=rpm, mm=mm, seconds=5.4)
            assert page.calibration.test.phase == "weigh"
            await caught(app, source, clock, pilot, frame=frame, rpm=rpm, mm=mm, seconds=30.0)
            bar = next(
                row
                for row in page.query_one("#cal-sheet", ProgressRows).view
                if isinstance(row, BarRow) and row.label == "catch"
            )
            assert bar.share == 1.0
            await pilot.press(
                "q", "3", "enter", *("full_stop" if c == "." else c for c in mass), "enter"
            )
        points = page.calibration.test.points
        assert [(round(one.shaft_rpm), round(one.opening_mm)) for one in points] == [
            (70, 20),
            (70, 35),
            (90, 50),
        ]
        assert points[1].mass_kg == 6.7
        await pilot.press("q", "5", "enter")
        await settled(app, pilot)
        text = "\n".join(shown(app))
        assert "flow 5.4972 g per turn and mm" in text and "90 % lie between" in text
        await pilot.press("e")
        assert isinstance(app.screen, NameDialog)
        await pilot.press("-", "x", "1", "enter")
        await settled(app, pilot)
        assert page.calibration.saved == "machines/huanghai-catch-20260318-x1.yaml"
        text = "\n".join(shown(app))
        assert "saved: " in text and "use it with: topdress run --config FILE" in text
        assert Order(Do.STOP) not in source.orders, "an x in a name is a letter"


async def test_what_the_shaft_turns_at_work_is_no_catch(app, source, clock, frames, page):
    frame = standing(frames[-1])
    feed(
        app,
        (
            {
                "time_s": frame.row.time_s + 0.2 * step,
                "shaft_rpm": 70.0 if step < 50 else 0.0,
                "state": "working" if step < 50 else "held",
            }
            for step in range(60)
        ),
        step_s=0.2,
    )
    assert (
        page.calibration.test.shaft_turns.revolutions == 0.0
        and page.calibration.test.phase == "settle"
    )


async def test_a_name_that_is_taken_is_said_in_one_line_and_nothing_counts_as_saved(
    app, shown, pilot, page
):
    page.calibration.test.points = list(POINTS)
    page.calibration.take_result(page.service.fit_catch(POINTS))
    await pilot.press("e")
    app.screen.query_one("#name-input").value = "a/b"
    await pilot.press("enter")
    assert isinstance(app.screen, NameDialog) and any(
        "letters, digits" in row for row in shown(app)
    )
    app.screen.query_one("#name-input").value = "taken"
    await pilot.press("enter")
    await settled(app, pilot)
    assert "exists already" in app.notice_text and page.calibration.saved == ""


async def test_escape_forgets_a_computation(app, opened):
    import threading

    gate = threading.Event()
    async with app.run_test(size=SIZE) as pilot:
        page = await opened(pilot)

        def slow(points):
            gate.wait(5.0)
            return sample_calibrate_job().fit_catch(points)

        page.service = replace(page.service, fit_catch=slow)
        page.calibration.test.points = list(POINTS)
        await pilot.press("q", "5", "enter")
        assert page.busy
        await pilot.press("escape")
        gate.set()
        await pilot.pause(0.1)
        assert not page.busy and page.calibration.fitted is None


async def test_points_can_be_taken_back_and_then_nothing_is_fitted(app, pilot, page):
    page.calibration.test.points = list(POINTS[:3])
    page.calibration.take_result(page.service.fit_catch(POINTS[:3]))
    await pilot.press("backspace")
    assert len(page.calibration.test.points) == 2 and page.calibration.fitted is None
    await pilot.press("q", "5", "enter", "e")
    assert page.calibration.fitted is None and len(app.screen_stack) == 2


async def test_the_lag_rig_is_begun_held_and_ended(app, source, frames, clock, opened, shown):
    source.current_frame = lag_under_way(many_devices(standing(frames[-1])))
    source.current_frame = replace(source.current_frame, lag_test=None)
    async with app.run_test(size=SIZE) as pilot:
        page = await opened(pilot, right=1)
        await pilot.press("b")
        assert source.lag_tests == [True]
        source.current_frame = replace(
            lag_under_way(source.current_frame), seq=source.current_frame.seq + 1
        )
        clock.now_s += 0.5
        app.show_newest()
        await hold_mouse(pilot, page, "cal_run")
        assert source.orders == [Order(Do.CALIBRATE)], "the rig sets the shaft"
        text = "\n".join(shown(app))
        assert "nothing landed" in text and "16 %" in text
        await pilot.press("b")
        assert source.lag_tests == [True, False]
        await pilot.mouse_up("#cal-chips", offset=(1, 0))
        source.current_frame = replace(
            source.current_frame, lag_test=None, seq=source.current_frame.seq + 1
        )
        clock.now_s += 0.5
        app.show_newest()
        await pilot.press("q", "5", "enter")
        await settled(app, pilot)
        assert page.calibration.fitted.source == ("logs/run.lag.1.csv", None), (
            "what was measured stays"
        )


async def test_without_a_rig_a_bench_table_is_fitted(app, source, opened, shown, pilot):
    page = await opened(pilot, right=1)
    await pilot.press("b")
    assert source.lag_tests == [] and "no lag rig" in app.notice_text
    await pilot.press("j")
    await settled(app, pilot)
    assert isinstance(app.screen, ChoiceDialog)
    await pilot.press("2", "enter")
    await pilot.press("2", "enter")
    await settled(app, pilot)
    assert page.calibration.label == "field"
    text = "\n".join(shown(app))
    assert (
        "slope -0.00830 s per r/min" in text
        and "holds from 10 to 70 r/min" in text
        and "lag_both.csv" in text
    )


async def test_a_fouled_head_is_named_after_thirty_seconds(
    app, source, clock, frames, opened, shown
):
    frame = frames[-1]
    async with app.run_test(size=SIZE) as pilot:
        await opened(pilot, right=2)
        await pilot.press("b")
        source.current_frame = frame
        for index in range(160):
            heads = tuple(
                0.5 + 0.004 * ((index + k) % 3) - (0.06 if k == 4 else 0.0) for k in range(6)
            )
            feed(app, [{"time_s": frame.row.time_s + 0.2 * index}], step_s=0.2, head_ndvi=heads)
        await pilot.pause()
        text = "\n".join(shown(app))
        assert "head 5: clean it" in text and text.count("good") == 5 and "FOULED" in text


async def test_the_wheel_is_measured_also_while_another_page_is_looked_at(
    app, source, clock, frames, opened, shown
):
    frame = frames[-1]
    async with app.run_test(size=SIZE) as pilot:
        page = await opened(pilot, right=3)
        await pilot.press("b", "f2")
        source.current_frame = frame
        feed(
            app,
            (
                {
                    "time_s": frame.row.time_s + 0.2 * index,
                    "wheel_speed_mps": 2.02,
                    "fix_quality": 4,
                    "lat_deg": 34.8 + index * 0.4 / 110_940.0,
                    "lon_deg": 113.6,
                }
                for index in range(300)
            ),
            step_s=0.2,
        )
        await pilot.press("f6")
        await later(app, pilot)
        assert page.at == 3 and "Enough" in "\n".join(shown(app))
        await pilot.press("b")
        await settled(app, pilot)
        samples = page.calibration.fitted.source
        assert len(samples) > 250 and {sample.wheel_speed_mps for sample in samples} == {2.02}
        assert "circumference 2.4868 m (90 %: 2.4849 to 2.4887)" in " ".join(
            "\n".join(shown(app)).split()
        )


@pytest.mark.exam
async def test_a_reference_of_effort_is_fitted_to_the_log_of_this_run_and_saved(
    app, source, frames, opened, shown
):
    source.current_frame = replace(
        frames[-1], row=frames[-1].row._replace(shaft_effort=58.25), log_path=""
    )
    async with app.run_test(size=SIZE) as pilot:
        page = await opened(pilot, right=4)
        await later(app, pilot)
        assert page.calibration.kind == "effort" and "58.2" in "\n".join(shown(app))
        await pilot.press("q", "5", "enter")
        assert "nothing is recorded yet" in app.notice_text
        tell(source, log_path="/logs/sound.csv")
        await looked(app, pilot)
        await pilot.press("q", "5", "enter")
        await settled(app, pilot)
        assert page.calibration.fitted.source == ("/logs/sound.csv",)
        assert "shaft, with its speed 0.5980 % for each r/min (90 %: 0.5900 to 0.6060)" in " ".join(
            "\n".join(shown(app)).split()
        )
        assert chip_of(page, "cal_save")[0].lead


async def test_every_chip_stands_whole_on_the_screen(app, opened):
    async with app.run_test(size=(120, 40)) as pilot:
        page = await opened(pilot)
        for size in ((80, 24), (100, 30), (120, 40)):
            await pilot.resize_terminal(*size)
            for right in range(5):
                page.choose_calibration(right)
                page.refresh_all_next_tick()
                await later(app, pilot)
                chips = page.query_one("#cal-chips", Chips)
                for chip, row, start, cells in place_chips(chips.view, chips.size.width):
                    assert row < chips.size.height and start + cells <= chips.size.width, (
                        size,
                        chip.action,
                    )
                assert page.query_one("#cal-guide", GuidePanel).region.area > 0


async def test_tabs_are_clickable(pilot, page):
    await pilot.click("#cal-tabs", offset=(30, 0))
    assert page.calibration.kind == "heads"


async def test_without_files_the_page_says_so(source, clock, frames):
    source.current_frame = standing(frames[-1])
    app = TopdressApp(source, clock, live=False)
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("f6", "q", "1", "enter")
        assert "not available here" in app.notice_text and len(app.screen_stack) == 2
