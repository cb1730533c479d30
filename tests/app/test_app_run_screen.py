"""What the Run screen shows: freshness, a worker that is gone, sizes, how often it draws."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.impossible_reasons import explain_not_ready
from topdress.console.app.panel_views import MAX_FRESH_AGE_S, explain_rate
from topdress.console.app.screens.worker_lost_screen import WorkerLostScreen
from topdress.console.app.widgets.alarm_bar import AlarmBar
from topdress.console.app.widgets.base_panel import Panel
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.app.widgets.rate_panels import RatesPanel
from topdress.console.link import WorkerGone
from topdress.console.running import WorkerFailed
from topdress.control.orders import Alarm, Do, Order, Severity
from topdress.control.safety import Allowances

from tests.app.gallery import StillSource
from tests.app.harness import later, turned

SIZE = (120, 40)


def panels(app):
    return [*app.page.query(Panel).results(), *app.page.query(Canvas).results()]


async def test_before_the_first_frame_nothing_is_claimed(clock, shown):
    app = TopdressApp(StillSource(), clock, live=False)
    async with app.run_test(size=(80, 24)):
        text = "\n".join(shown(app))
        assert "NO DATA" in text and "WORKING" not in text


async def test_values_older_than_a_second_are_grey_and_said(
    app, source, clock, frames, shown, pilot
):
    rates = app.page.query_one("#rates", RatesPanel)
    assert not rates.view.target.stale
    clock.now_s += MAX_FRESH_AGE_S - 0.05
    app.show_newest()
    assert not rates.view.target.stale
    await later(app, pilot, 0.25)
    assert rates.view.target.stale and rates.view.applied.stale
    assert "NO DATA 1 s" in shown(app)[0]
    grey = app.get_css_variables()["stale"]
    assert grey == app.theme_variables["stale"]
    strip = rates.render_line(1)
    colours = {
        segment.style.color.name for segment in strip if segment.style and "█" in segment.text
    }
    assert colours == {grey}
    source.current_frame = replace(frames[-1], seq=frames[-1].seq + 1, at_s=frames[-1].at_s + 1)
    await later(app, pilot, 0.2)
    assert not rates.view.target.stale
    assert "NO DATA" not in shown(app)[0]


async def test_between_two_frames_nothing_is_looked_at_but_what_was_asked_for(
    app, source, clock, frames, pilot, monkeypatch
):
    looked = []
    show = app.page.show_numbers
    monkeypatch.setattr(
        app.page,
        "show_numbers",
        lambda view: (looked.append(round(clock.now_s - start_s, 1)), show(view)),
    )
    source.current_frame, start_s = replace(frames[-1], seq=frames[-1].seq + 1), clock.now_s
    for _tick in range(5):
        clock.now_s += 0.2
        app.show_newest()
    assert looked == [0.2, 0.8]  # at once, then twice a second
    app.page.refresh_all_next_tick()
    clock.now_s += 0.1
    app.show_newest()
    assert looked[-1] == 1.1


@pytest.mark.parametrize(
    ("gnss_from", "looked_at"),
    [(0, [0]), (3, [0, 1, 2, 3]), (9, [0, 1, 2, 3, 4, 5])],
    ids=["with its first frame", "with its fourth", "after half a second"],
)
async def test_first_frames_are_shown_as_they_come_until_the_receiver_speaks(
    app, source, clock, frames, pilot, monkeypatch, gnss_from, looked_at
):
    looked, stopped = [], []
    monkeypatch.setattr(app.page, "show_numbers", lambda view: looked.append(number))
    app._until_first = SimpleNamespace(stop=lambda: stopped.append(True))
    for number in range(8):
        age_s = 0.1 if number >= gnss_from else None
        source.current_frame = replace(
            frames[-1], seq=frames[-1].seq + 1 + number, gnss_age_s=age_s
        )
        for _look in range(2):  # twice between two frames
            if not stopped:
                app._show_first_frames()
        clock.now_s += 0.1
    assert stopped and looked == looked_at


async def test_a_frame_of_the_same_number_is_not_a_new_one(app, source, clock, frames, pilot):
    clock.now_s += 2.0
    source.current_frame = replace(frames[-1])
    app.show_newest()
    assert app.page.query_one("#rates", RatesPanel).view.target.stale


async def test_an_old_fix_or_silent_heads_are_grey_alone(app, source, frames):
    devices = tuple(replace(d, age_s=3.0) if d.name == "heads" else d for d in frames[-1].devices)
    source.current_frame = replace(frames[-1], gnss_age_s=1.4, devices=devices)
    async with app.run_test(size=SIZE):
        items = {item.label: item.value.stale for item in app.page.query_one("#items-side").view}
        assert items["GNSS"] and items["fix age"] and not items["look-ahead"]
        assert app.page.query_one("#heads").view.fused.stale
        assert not app.page.query_one("#tiles").view[1].value.stale


async def test_a_widget_is_touched_only_when_what_it_shows_changes(
    app, clock, source, frames, pilot
):
    app.show_newest()
    before = {panel.id: panel.redraws for panel in panels(app)}
    for _tick in range(4):
        clock.now_s += 0.2
        app.show_newest()
    assert {panel.id: panel.redraws for panel in panels(app)} == before
    row = frames[-1].row._replace(hopper_kg=12.0)
    source.current_frame = replace(frames[-1], seq=frames[-1].seq + 1, row=row)
    clock.now_s += 0.2
    app.show_newest()
    changed = {panel.id for panel in panels(app) if panel.redraws != before[panel.id]}
    assert changed == {"tiles"}


@pytest.mark.usefixtures("drawn_at_once")
async def test_of_a_panel_those_rows_alone_are_drawn_that_look_other(
    app, source, frames, monkeypatch
):
    source.current_frame = frames[-1]
    async with app.run_test(size=SIZE):
        app.show_newest()
        heads, rows = app.page.query_one("#heads"), []
        monkeypatch.setattr(
            heads, "refresh", lambda *regions, **_: rows.append([region.y for region in regions])
        )
        first, *rest = heads.view.heads
        heads.show_view(
            heads.view._replace(heads=(first._replace(share=first.share + 1e-9), *rest))
        )
        assert rows == [], "another view that looks the same"
        heads.show_view(heads.view._replace(heads=(first._replace(value="0.01"), *rest)))
        assert rows == [[1]]


async def test_numbers_5_plots_2_maps_1_a_second(source, clock, frames):
    source.current_frame = frames[0]
    app = TopdressApp(source, clock, live=False)
    async with app.run_test(size=SIZE):
        start = {panel.id: panel.redraws for panel in panels(app)}
        for step in range(1, 201):  # 10 s of ticks at 20 Hz, a new frame with each
            clock.now_s += 0.05
            source.current_frame = replace(frames[step], seq=step)
            app.show_newest()
        drawn = {panel.id: panel.redraws - start[panel.id] for panel in panels(app)}
        assert 45 <= drawn["rates"] <= 50
        assert 19 <= drawn["trend"] <= 20
        assert 9 <= drawn["map"] <= 10


async def test_alarms_say_word_symbol_place_time_and_what_to_do(app, source, frames, shown):
    at_s = frames[-1].at_s
    source.current_frame = replace(
        frames[-1],
        alarms=(
            Alarm(
                "hopper_low",
                Severity.AMBER,
                at_s - 70,
                details=(("hopper_kg", 18.5), ("metres_left", 640.0)),
            ),
            Alarm("shaft_silent", Severity.RED, at_s - 35),
        ),
    )
    async with app.run_test(size=SIZE):
        first, todo, second = shown(app)[1:4]
        assert "✖ ALARM" in first and "drive board: The metering shaft does not answer." in first
        assert "06:12:24 (00:35)" in first
        assert "Check power and cable" in todo and "A: acknowledge" in todo
        assert "! CAUTION" in second and "18.5 kg left in the hopper, enough for 640 m" in second
        assert "(01:10)" in second


@pytest.mark.parametrize(
    ("alarms", "row", "said"),
    [
        (
            [
                Alarm(name, Severity.RED, 0.0)
                for name in ("shaft_silent", "gate_silent", "log_failed", "rate_off")
            ],
            3,
            ["+2 more"],
        ),
        (
            [
                Alarm(
                    "hopper_low",
                    Severity.AMBER,
                    0.0,
                    details=(("hopper_kg", 18.5), ("metres_left", 640.0)),
                )
            ],
            1,
            ["enough for 640 m.", "06:12:00"],
        ),
        ([Alarm("from_a_newer_worker", Severity.RED, 0.0)], 1, ["from_a_newer_worker"]),
    ],
    ids=["counted where they do not fit", "whole at 80 columns", "unknown, by its id"],
)
async def test_alarms_of_a_small_terminal(app, source, frames, shown, alarms, row, said):
    source.current_frame = replace(frames[-1], alarms=tuple(alarms))
    async with app.run_test(size=(80, 24)):
        assert all(one in shown(app)[row] for one in said)


async def test_speeds_in_alarms_are_shown_in_the_units_in_use(app, source, frames, shown):
    source.current_frame = replace(
        frames[-1],
        alarms=(Alarm("lead_short", Severity.AMBER, 0.0, details=(("usable_speed_mps", 2.0),)),),
    )
    async with app.run_test(size=SIZE) as pilot:
        assert "at most 7.2 km/h" in shown(app)[1]
        await pilot.press("u", "enter")
        assert "at most 4.5 mph" in shown(app)[1]


@pytest.mark.usefixtures("drawn_at_once")
async def test_an_alarm_is_seen_while_a_dialog_is_open(app, source, clock, frames, shown):
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("m")
        source.current_frame = replace(
            frames[-1], seq=9999, alarms=(Alarm("shaft_silent", Severity.RED, 0.0),)
        )
        await later(app, pilot, 0.2)
        rows = shown(app)
        assert "ALARM" in rows[1]
        assert "STOP" in rows[-1]
        assert any("allowed: 0 to 600 kg/ha" in row for row in rows)


async def test_a_gone_worker_is_said_at_once_and_can_be_started_again(source, clock, frames, shown):
    second = StillSource(replace(frames[-1], seq=1))
    asked = []

    async def start():
        asked.append("start")
        return second

    app = TopdressApp(source, clock, start=start, live=False)
    async with app.run_test(size=SIZE) as pilot:
        source.end.set_exception(WorkerGone("the connection to the machine broke off"))
        await pilot.pause()
        await pilot.pause()
        assert isinstance(app.screen, WorkerLostScreen)
        text = "\n".join(shown(app))
        assert (
            "NO CONNECTION TO THE MACHINE" in text
            and "broke off" in text
            and "hard-wired stop" in text
        )
        assert "attach" not in text, "only what can be done is offered"
        assert app.page.query_one("#rates", RatesPanel).view.target.stale, (
            "old at once, not after a second"
        )
        await pilot.press("enter")
        assert asked == [], "what is done must be chosen"
        await pilot.press("1", "enter")
        clock.now_s += 0.2
        app.show_newest()
        assert asked == ["start"] and app.source is second and not app.gone
        assert not app.page.query_one("#rates", RatesPanel).view.target.stale
        await pilot.press("space")
        assert second.orders == [Order(Do.HOLD)] and source.orders == []


async def test_a_worker_that_does_not_start_is_said_again(source, clock, shown):
    async def start():
        raise RuntimeError("the machine did not start: no such port")

    app = TopdressApp(source, clock, start=start, live=False)
    async with app.run_test(size=SIZE) as pilot:
        source.end.set_exception(WorkerGone("gone"))
        await pilot.pause()
        await pilot.pause()
        await pilot.press("1", "enter")
        assert isinstance(app.screen, WorkerLostScreen)
        assert "no such port" in "\n".join(shown(app))
        await pilot.press("escape")
        assert "NO CONNECTION" in shown(app)[0]
        await pilot.press("c")
        assert isinstance(app.screen, WorkerLostScreen)


async def test_any_other_failure_of_the_link_is_as_a_worker_gone(source, clock):
    app = TopdressApp(source, clock, live=False)
    async with app.run_test(size=SIZE) as pilot:
        source.end.set_exception(KeyError("odd"))
        await pilot.pause()
        await pilot.pause()
        assert isinstance(app.screen, WorkerLostScreen) and "odd" in app.gone


async def test_trends_go_first_then_the_map_and_never_numbers_and_alarms(app, shown, pilot):
    page = app.page
    for *size, trend, map_, body in (
        (120, 40, True, True, True),
        (100, 30, False, True, True),
        (80, 24, False, False, True),
        (80, 40, True, False, True),
        (79, 24, False, False, False),
        (80, 23, False, False, False),
    ):
        await pilot.resize_terminal(*size)
        await later(app, pilot)
        seen = {
            name: page.query_one(name).region.area > 0
            for name in ("#trend", "#map", "#rates", "#tiles", "#heads")
        }
        assert seen["#map"] is map_, size
        assert seen["#rates"] is seen["#tiles"] is seen["#heads"] is body, size
        assert seen["#trend"] is (trend and body), size
        assert page.query_one(AlarmBar).region.area > 0, size
        assert ("80 x 24 shows the whole page" in "\n".join(shown(app))) is not body, size


@pytest.mark.exam
async def test_the_theme_key_goes_round_day_night_contrast(app):
    async with app.run_test(size=(80, 24)) as pilot:
        seen = []
        for _press in range(3):
            await pilot.press("d")
            seen.append(app.theme)
        assert seen == ["night", "contrast", "day"]


async def test_help_is_one_key_away(app, shown, pilot):
    await pilot.press("f1")
    text = "\n".join(shown(app))
    assert "Keys of this screen" in text and "Stops the flow at once" in text
    await pilot.press("f1")
    assert len(app.screen_stack) == 1


async def test_why_no_flow_stands_beside_the_applied_rate(app, source, frames, shown):
    source.current_frame = replace(frames[-1], notes=("outside_field",))
    async with app.run_test(size=(80, 24)):
        assert any("applied" in row and "lands outside field" in row for row in shown(app))


def state_of(frame, state, **more):
    return replace(frame, row=frame.row._replace(state=state, target_rate_kg_ha=0.0), **more)


@pytest.mark.parametrize(
    ("state", "seen", "says"),
    [
        ("working", {"why_no_flow": ("low_speed",), "notes": ("limited_zero",)}, ("too slow",)),
        (
            "working",
            {"why_no_flow": ("outside_field", "reversing")},
            ("lands outside field", "reversing"),
        ),
        ("working", {"notes": ("already_spread",)}, ("already spread",)),
        ("working", {"notes": ("on_headland", "lag_out_of_range")}, ("headland",)),
        ("working", {}, ("rate here is zero",)),
        ("held", {"why_no_flow": ("not_working",), "notes": ("already_spread",)}, ()),
    ],
)
def test_why_nothing_flows_in_words(frames, state, seen, says):
    assert explain_rate(state_of(frames[-1], state, **seen)) == says


async def test_what_is_allowed_stands_in_the_status_line_and_in_the_dialog(
    app, source, frames, shown
):
    source.current_frame = replace(frames[-1], allow=Allowances(outside=True), no_double=False)
    async with app.run_test(size=(120, 40)) as pilot:
        assert "OUTSIDE OK" in shown(app)[0] and "REVERSE OK" not in shown(app)[0]
        await pilot.press("h")
        text = "\n".join(shown(app))
        assert "forbid again (now allowed): flow outside the field" in text
        assert "allow: flow while reversing" in text
        await pilot.press("4", "enter")
        assert source.orders == [Order(Do.NO_DOUBLE, True)]


async def test_a_machine_that_is_recorded_only_says_so_in_place_of_a_state(
    app, source, frames, shown
):
    source.current_frame = replace(
        frames[-1], row=frames[-1].row._replace(state=None), why_state="record_only"
    )
    async with app.run_test(size=(120, 40)):
        assert "RECORDS ONLY" in shown(app)[0]
        assert "recorded only: its drives are somebody else's" in explain_not_ready(app)


async def test_no_colour_shows_the_same_words(monkeypatch, source, clock, shown):
    monkeypatch.setenv("NO_COLOR", "1")
    app = TopdressApp(source, clock, live=False)
    assert app.no_color
    async with app.run_test(size=(80, 24)):
        text = "\n".join(shown(app))
        assert "WORKING" in text and "█" in text and "STOP" in text


async def test_the_first_frame_waits_for_no_tick(frames, monkeypatch, shown):
    monkeypatch.setattr("topdress.console.app.app.NUMBERS_PERIOD_S", 3600.0)
    source = StillSource(None)
    app = TopdressApp(source, utc_offset_s=0.0)
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause(0.1)
        assert "NO DATA" in "".join(shown(app))
        source.current_frame = frames[-1]
        for _ in range(200):
            await pilot.pause(0.05)
            if "WORKING" in "".join(shown(app)):
                break
        assert "WORKING" in "".join(shown(app))


async def test_a_worker_that_never_came_up_ends_the_console_with_its_line():
    class NeverThere(StillSource):
        async def run_connection(self):
            raise WorkerFailed("the machine did not start: no such port")

    app = TopdressApp(NeverThere(None), live=False, utc_offset_s=0.0)
    async with app.run_test() as pilot:
        await pilot.pause(0.1)
    assert app.not_started == "the machine did not start: no such port"


async def test_a_page_that_a_small_terminal_cannot_show_says_that_it_is_open(app, shown):
    async with app.run_test(size=(60, 20)) as pilot:
        assert not any("shows the whole page" in row for row in shown(app)[:6]), (
            "the numbers are the Run page's own"
        )
        for where, name in (("map", "map"), ("settings", "settings")):
            await turned(app, pilot, where)
            assert any(f" {name}: 80 x 24 shows the whole page" in row for row in shown(app))


async def test_the_replay_page_without_a_log_waits_for_none(app, shown):
    async with app.run_test(size=(100, 30)) as pilot:
        await turned(app, pilot, "replay")
        assert "no log is open" in shown(app)[0] and "waiting" not in shown(app)[0]
