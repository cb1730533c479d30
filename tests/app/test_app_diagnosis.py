"""The Diagnosis page: what is asked of its service, what is shown, what it refuses."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import pytest
from textual.geometry import Size
from topdress.console.app import actions
from topdress.console.app.action import DIAGNOSIS
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import ChoiceDialog, Confirm, TextDialog
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.diagnosis import diagnosis_words as diagnosis_words
from topdress.console.app.pages.diagnosis import panel_views as diagnosis_shown
from topdress.console.app.pages.diagnosis.causes import CauseList, draw_interval_bar
from topdress.console.app.pages.diagnosis.page import (
    SourceList,
    SourcesView,
    WorkEstimate,
    estimate_duration_s,
)
from topdress.console.app.pages.diagnosis.residual_plot import (
    PlotView,
    ResidualPlot,
    rasterise_line,
    round_plot_ends,
)
from topdress.console.app.pages.diagnosis.service import DiagnosisView, ResidualCurve, WorkStopped
from topdress.console.app.services import Services
from topdress.console.app.units import IMPERIAL, METRIC
from topdress.console.locale import read_catalogue, use_language
from topdress.console.reports.diagnosis_wording import find_effect_title, format_verdict_line
from topdress.control.diagnosis.result import UNKNOWN, FieldCost, UnexplainedStructure
from topdress.control.machine.machine import CATALOGUE
from topdress.control.orders import Do
from topdress.drivers.files.plain_data import build_from_plain, convert_to_plain

from tests.app.made_up.diagnosis import SOURCES, MadeUpDiagnosis, having, sample_found


@pytest.fixture
def service():
    return MadeUpDiagnosis()


@pytest.fixture
def app(source, clock, service):
    return TopdressApp(
        source, clock, live=False, utc_offset_s=0.0, services=Services(diagnosis=service)
    )


async def opened(app, pilot):
    await pilot.pause()
    await pilot.press("f9")
    await settled(app, pilot)
    return app.pages[DIAGNOSIS]


async def settled(app, pilot):
    await pilot.pause()
    app.show_newest()
    for worker in [worker for worker in app.workers if worker.group in ("list", "work")]:
        await worker.wait()
    await pilot.pause()
    app.page.refresh_all_next_tick()
    app.show_newest()
    await pilot.pause()


async def found_shown(app, pilot):
    page = await opened(app, pilot)
    await pilot.press("enter")
    await settled(app, pilot)
    return page


@pytest.fixture
async def page(app, pilot):
    return await opened(app, pilot)


@pytest.fixture
async def answered(app, pilot):
    """The page with the answer for the newest log."""
    return await found_shown(app, pilot)


async def test_newest_files_are_listed_and_the_chosen_one_is_diagnosed(
    app, service, shown, pilot, page
):
    text = "\n".join(shown(app))
    assert all(source.name in text for source in SOURCES) and "< now" in text
    await pilot.press("down", "down", "up", "enter")
    await settled(app, pilot)
    assert service.asked == ["diagnose 20260317-134500.csv None"]
    assert page.shown is not None and page.shown.found.verdict == "ambiguous"


@pytest.mark.parametrize("size", [(80, 24), (100, 30), (120, 40)])
async def test_the_verdict_the_size_and_the_cost_are_seen_at_every_size(app, shown, size, answered):
    text = "\n".join(shown(app))
    assert "NOT TOLD APART" in text and "Flutes fill less at high shaft speed" in text
    assert "12.4 % lost at 100 r/min  (9.9 to 15)" in text
    assert "-6.1 % = -20 kg/ha" in text
    assert "Test next: Shaft staircase" in text and "(10 min)." in text.replace("\n", " ")


@pytest.mark.exam
async def test_narrow_screens_go_through_all_views_and_wide_ones_show_them_beside(app):
    async with app.run_test(size=(80, 24)) as pilot:
        page = await found_shown(app, pilot)
        seen = []
        for _view in range(6):
            visible = [
                widget.id
                for widget in page.query("#dia-left > *, #dia-right > *")
                if widget.region.area
            ]
            seen.append((page.visible_view, visible))
            await pilot.press("v")
        assert seen == [
            ("causes", ["dia-causes"]),
            ("channels", ["dia-channels"]),
            ("over", ["dia-over"]),
            ("time", ["dia-time"]),
            ("run", ["dia-run"]),
            ("causes", ["dia-causes"]),
        ]
        await pilot.resize_terminal(120, 40)
        visible = {
            widget.id
            for widget in page.query("#dia-left > *, #dia-right > *")
            if widget.region.area
        }
        assert visible == {"dia-causes", "dia-channels", "dia-over", "dia-time"}


async def test_the_plots_follow_the_chosen_cause(app, pilot, answered):
    assert answered.query_one("#dia-over", ResidualPlot).view.title == "error of flow, g/s"
    await pilot.press("down")
    await settled(app, pilot)
    plot = answered.query_one("#dia-over", ResidualPlot)
    assert plot.view.title == "error of shaft, r/min" and plot.view.label == "supply, V"
    redraws = plot.redraws
    await settled(app, pilot)
    assert plot.redraws == redraws


@pytest.mark.parametrize("size", [(120, 40), (80, 24)])
async def test_nothing_of_an_undecided_group_is_adopted_by_enter_alone(app, service, shown, size):
    """The page says to drive the next test first: K and Enter do just that, whatever is
    likeliest."""
    service.found = having(
        service.found._replace(adoptable=("flow.fill_falloff",), offers=service.found.offers[1:]),
        causes=service.found.found.causes[:1],
    )
    async with app.run_test(size=size) as pilot:
        await found_shown(app, pilot)
        await pilot.press("q", "1", "enter")
        assert isinstance(app.screen, ChoiceDialog) and app.screen.at == 0
        text = " ".join(" ".join(shown(app)).replace("┃", " ").split())
        assert "Undecided: this data cannot tell these apart." in text
        assert "> 1 none of these: the next test is driven first" in text
        await pilot.press("enter")
        assert (
            service.asked[1:] == []
            and app.notice_text == "nothing is adopted: the next test decides"
        )


async def test_one_is_picked_by_its_name_with_a_reason_and_the_undo_is_said(
    app, service, shown, pilot, answered
):
    await pilot.press("q", "1", "enter")
    assert ["size is not known" in choice.why for choice in app.screen.choices] == [
        False,
        False,
        True,
        True,
    ]
    await pilot.press("3", "enter")
    assert isinstance(app.screen, ChoiceDialog), "a cause without a size cannot be taken up"
    await pilot.press("2", "enter")
    assert isinstance(app.screen, NameDialog)
    await pilot.press("enter")
    assert isinstance(app.screen, NameDialog), "why is not left empty"
    await pilot.press(*"flutes", "space", *"worn", "enter")
    assert isinstance(app.screen, Confirm) and service.asked[1:] == []
    text = app.screen.text
    assert "Adopted: Flutes fill less at high shaft speed, Shaft loses speed" in text
    assert (
        "flow.fill_falloff: 0 -> 12.4 %" in text
        and "The running job keeps its machine file" in text
    )
    await pilot.press("enter")
    assert service.asked[1:] == ["adopt flow.fill_falloff, shaft.voltage_sag: flutes worn"]
    said = "\n".join(shown(app))
    assert isinstance(app.screen, TextDialog) and "huanghai-2026-03-18.yaml" in said
    assert "Del on the Diagnosis page takes the last change of it back." in said
    await pilot.press("escape")
    assert answered.adopted == "/data/machines/huanghai-2026-03-18.yaml"


async def test_escape_after_adopting_stays_on_the_page(full, turned, pilot):
    """It went on to the Job page, where the keys that were meant here ended the job."""
    await turned(full, pilot, "diagnosis")
    full.page.write_file("The machine file", lambda: "/data/machines/new.yaml", machine=True)
    await settled(full, pilot)
    assert isinstance(full.screen, TextDialog)
    await pilot.press("escape")
    assert isinstance(full.screen, Confirm) and full.screen.heading == "Use it now?"
    assert full.page.where == "diagnosis"
    await pilot.press("escape")
    assert full.screen is full.page and full.page.where == "diagnosis"
    full.job_page.ask_to_use_machine("/data/machines/new.yaml")
    await pilot.pause()
    await pilot.press("enter")
    await pilot.pause()
    assert (
        full.page.where == "job"
        and ("take", "machine", "/data/machines/new.yaml") in full.services.job.asked
    )


async def test_undo_stands_on_the_page_after_adopting_and_takes_that_file_back(app, service, shown):
    service.found = sample_found("named")
    async with app.run_test(size=(120, 40)) as pilot:
        page = await found_shown(app, pilot)
        await pilot.press("q", "1", "enter")
        assert isinstance(app.screen, Confirm), "what is sure is asked once"
        await pilot.press("enter")
        assert service.asked[-1] == "adopt flow.fill_falloff"
        await pilot.press("escape", "f9")
        await settled(app, pilot)
        assert "Del take back" in " ".join(" ".join(shown(app)).split())
        await pilot.press("delete", "enter")
        assert service.asked[-1] == "take back /data/machines/huanghai-2026-03-18.yaml"
        assert page.adopted == "/data/machines/bench-2026-03-19.yaml"


async def test_what_is_sure_alone_is_adopted_where_none_is_picked(app, service, pilot, answered):
    await pilot.press("q", "1", "enter", "enter")
    assert isinstance(app.screen, Confirm)
    text = app.screen.text
    assert "Adopted: Shaft loses speed when the supply falls below nominal" in text
    assert "Not adopted, undecided: Flutes fill less at high shaft speed" in text
    await pilot.press("enter")
    assert service.asked[1:] == ["adopt shaft.voltage_sag"]


async def test_tied_causes_are_equals_and_the_next_test_leads(app, shown, answered):
    rows = shown(app)
    head = next(row for row in rows if "Test next: Shaft staircase" in row)
    assert rows.index(head) < 8
    text = " ".join(" ".join(rows).split())
    assert (
        "It tells apart: Flutes fill less at high shaft speed; Kilograms per revolution off "
        "by a factor" in text
    )
    assert "one of these 3, this data cannot tell which" in text
    marked = [row for row in rows if row.strip().startswith("o ")]
    assert [row.split("%")[0].split()[-1] for row in marked] == ["58", "27", "15"]


@pytest.mark.exam
async def test_the_list_is_read_anew_when_another_job_is_at_work(app, source, pilot, page):
    assert page.sources is not None
    source.current_frame = replace(
        source.current_frame, seq=source.current_frame.seq + 1, log_path="another.csv"
    )
    app.show_newest()
    assert page.sources is None or page._listing is not None
    await settled(app, pilot)
    assert page.sources is not None


def test_the_bar_moves_from_the_start_and_never_back_and_its_time_is_honest():
    work = WorkEstimate(estimate_duration_s(20.0))
    seen = [work.estimate_progress(t, 0.0) for t in (0.0, 1.0, 3.0, 8.0)]
    assert [share for share, _left in seen] == sorted({share for share, _left in seen}) and seen[1][
        0
    ] > 0.05
    assert seen[0][1] == pytest.approx(15.0) and seen[3][1] == pytest.approx(7.0)
    assert work.estimate_progress(9.0, 0.3)[0] >= seen[3][0], "never back"
    slow = WorkEstimate(5.0)
    assert slow.estimate_progress(6.0, 0.0) == (0.3, None), "longer than expected, and it says so"
    slow = WorkEstimate(5.0)
    assert slow.estimate_progress(10.0, 0.25) == (0.25, pytest.approx(30.0)), "its own pace"
    assert slow.estimate_progress(40.0, 1.0) == (1.0, None)


@pytest.mark.exam
async def test_the_last_change_is_taken_back_after_a_question(app, service, shown, pilot, answered):
    await pilot.press("delete")
    assert not isinstance(app.screen, Confirm)  # the shipped file has no history
    answered.machine = "bench"
    await pilot.press("delete")
    assert isinstance(app.screen, Confirm) and "flow.gain: 0 -> 3 %" in "\n".join(shown(app))
    await pilot.press("escape", "delete", "enter")
    assert service.asked[1:] == ["take back bench"]
    assert isinstance(app.screen, TextDialog) and "bench-2026-03-19.yaml" in "\n".join(shown(app))


async def test_what_cannot_be_adopted_is_refused_with_its_reason(app, service, shown):
    service.found = sample_found("named")._replace(
        adoptable=(), offers=(), refused=("flow.gain: holds in the rows of before.csv only",)
    )
    async with app.run_test(size=(120, 40)) as pilot:
        await found_shown(app, pilot)
        await pilot.press("q", "1", "enter")
        assert isinstance(app.screen, TextDialog)
        assert "holds in the rows of before.csv only" in "\n".join(shown(app))
        await pilot.press("enter")
        assert not any(asked.startswith("adopt") for asked in service.asked)


async def test_the_separating_run_is_written_driven_and_both_verdicts_stand_beside(
    app, service, source, shown, pilot, answered
):
    await pilot.press("q", "7", "enter")
    await pilot.press("escape", "q", "5", "enter")
    assert isinstance(app.screen, Confirm) and service.asked[1:] == ["write_run"]
    await pilot.press("enter")
    await settled(app, pilot)
    assert service.asked[-1] == "drive stairs" and answered.which == 1
    text = "\n".join(shown(app))
    assert "log: 20260317-134500.csv" in text and "separating run: separating.csv" in text
    assert "NOT TOLD APART" in text and "CAUSE NAMED" in text
    await pilot.press("right")
    assert answered.which == 0
    assert source.orders == []  # nothing of all this orders the machine


async def test_report_data_and_type_a_path(app, service, shown, pilot, page):
    await pilot.press("q", "2", "enter")
    assert isinstance(app.screen, NameDialog)
    await pilot.press(*"no", "enter")
    assert "neither a run log" in "\n".join(shown(app))
    await pilot.press("backspace", "backspace", *"/a.csv", "enter")
    await settled(app, pilot)
    assert service.asked == ["diagnose a.csv None"]
    await pilot.press("e", "escape", "q", "6", "enter", "escape")
    assert service.asked[1:] == ["export report", "export data"] and page.shown is not None


async def test_a_file_of_another_machine_asks_what_it_does_not_say(source, clock, shown):
    service = MadeUpDiagnosis(
        unsure=("/data/planter.xlsx: columns.opening_mm: what is 100 % in mm?",)
    )
    app = TopdressApp(
        source, clock, live=False, utc_offset_s=0.0, services=Services(diagnosis=service)
    )
    async with app.run_test(size=(120, 40)) as pilot:
        page = await opened(app, pilot)
        await pilot.press("q", "2", "enter")
        await pilot.press(*"planter.xlsx", "enter")
        await settled(app, pilot)
        text = "\n".join(shown(app))
        assert isinstance(app.screen, TextDialog) and "what is 100 % in mm?" in text
        assert "/data/planter.import.yaml" in text and page.shown is None
        await pilot.press("escape")
        await settled(app, pilot)
        assert page.said == "not brought in: the import file has open questions"
        assert page.sources == SOURCES  # read anew: the import file is there now
        service.unsure = ()
        await pilot.press("q", "2", "enter")
        await pilot.press(*"planter.xlsx", "enter")
        await settled(app, pilot)
        assert page.shown is not None and page.said == ""


async def test_another_machine_file_may_be_held_against(app, service, pilot, page):
    await pilot.press("q", "3", "enter", "2", "enter", "enter")
    await settled(app, pilot)
    assert service.asked == ["diagnose 20260318-061200.csv bench"]


class Slow(MadeUpDiagnosis):
    """Works until it is cancelled."""

    def __init__(self):
        super().__init__()
        self.ended = threading.Event()

    def _work(self, tell, stop):
        tell(0.25, "metering")
        until = time.monotonic() + 60.0
        while not stop.is_set() and time.monotonic() < until:
            time.sleep(0.005)
        self.ended.set()
        raise WorkStopped


async def test_work_shows_stage_share_and_time_left_and_escape_cancels_it(source, clock, shown):
    service = Slow()
    app = TopdressApp(
        source, clock, live=False, utc_offset_s=0.0, services=Services(diagnosis=service)
    )
    async with app.run_test(size=(80, 24)) as pilot:
        page = await opened(app, pilot)
        await pilot.press("enter")
        for _try in range(100):
            await pilot.pause(0.01)
            if page._share == 0.25:
                break
        clock.now_s += 10.0
        app.page.refresh_all_next_tick()
        app.show_newest()
        await pilot.pause()
        text = "\n".join(shown(app))
        assert "25 %" in text and "shaft, gate, flow, scale" in text and "00:30 left" in text
        await pilot.press("e", "space")  # all else waits, hold does not
        assert [order.do for order in source.orders] == [Do.HOLD]
        await pilot.press("escape")
        assert service.ended.wait(30.0) and not page.is_busy and page.shown is None
        assert "cancelled" in "\n".join(shown(app))


async def test_leaving_the_console_ends_the_work(source, clock):
    service = Slow()
    app = TopdressApp(source, clock, live=False, services=Services(diagnosis=service))
    async with app.run_test(size=(80, 24)) as pilot:
        page = await opened(app, pilot)
        await pilot.press("enter")
        assert page.is_busy
        app.exit()
    assert service.ended.wait(30.0)


async def test_an_error_is_said_in_one_line_and_stays(app, service, shown):
    service.refuse = "run.csv: no usable time column\nand a trace"
    async with app.run_test(size=(80, 24)) as pilot:
        page = await found_shown(app, pilot)
        assert page.shown is None and page.said == "run.csv: no usable time column"
        assert any("! run.csv: no usable time column" in row for row in shown(app))


@pytest.mark.usefixtures("drawn_at_once")
async def test_the_mouse_chooses_and_begins(app, service, pilot, page):
    await pilot.click("#dia-sources", offset=(10, 4))
    assert page.at == 2 and service.asked == []
    await pilot.click("#dia-sources", offset=(10, 4))
    await settled(app, pilot)
    assert service.asked == ["diagnose 20260317-070100.csv None"]
    causes = page.query_one("#dia-causes", CauseList)
    row = next(k for k, index in enumerate(causes._row_of) if index == 1)
    await pilot.click("#dia-causes", offset=(5, row))
    assert page.cause == 1
    await pilot.click("#dia-chips", offset=(20, 0))
    assert isinstance(app.screen, ChoiceDialog)


async def test_locked_nothing_begins(app, service, pilot, page):
    await pilot.press("f8", "enter", "down")
    await pilot.click("#dia-sources", offset=(10, 2))
    await settled(app, pilot)
    assert service.asked == []


async def test_without_a_service_the_page_says_so(source, clock):
    app = TopdressApp(source, clock, live=False)
    async with app.run_test(size=(80, 24)) as pilot:
        await opened(app, pilot)
        await pilot.press("enter")
        assert app.notice_text == "diagnosis is not available here"


async def test_every_action_is_in_the_palette(app):
    async with app.run_test(size=(80, 24)) as pilot:
        await opened(app, pilot)
        titles = {command.title for command in app.get_system_commands(app.screen)}
        wanted = {action.label for action in actions.ACTIONS if action.where == DIAGNOSIS}
        assert len(wanted) == 16 and wanted <= titles


# --- words and views
# -------------------------------------------------------------------------------------------------


def test_a_view_goes_through_json_and_comes_back():
    found = sample_found()._replace(left_curve=sample_found().drawn[0].over, refused=("x: y",))
    found = having(
        found, unexplained=(UnexplainedStructure("flow", "supply_v", 0.4),), findings=("a note",)
    )
    assert build_from_plain(DiagnosisView, convert_to_plain(found)) == found


def test_verdicts_in_one_line():
    assert "Everything is as the machine file says" in format_verdict_line(
        sample_found("none").found
    )
    assert diagnosis_words.describe_next_step(sample_found("none")) == "Nothing to do."
    named = sample_found("named")
    assert format_verdict_line(named.found) == "Flutes fill less at high shaft speed."
    assert (
        diagnosis_words.describe_next_step(named)
        == "Work at a larger opening and a lower shaft speed."
    )
    one = replace(named.found.causes[0], rivals=sample_found().found.causes[0].rivals[:1])
    two = replace(named.found, verdict="ambiguous", causes=(one,))
    assert format_verdict_line(two) == (
        "Flutes fill less at high shaft speed, or: Kilograms per revolution off by a factor. This "
        "data cannot tell."
    )
    left = replace(
        sample_found("none").found,
        verdict="unexplained",
        unexplained=(UnexplainedStructure("flow", "supply_v", 0.4),),
    )
    assert format_verdict_line(left) == (
        "flow changes with supply; none of the known causes fits: "
        "that is 40 % of the error not yet explained."
    )


def test_cost_in_both_units_and_where_nothing_is_known():
    for percent, place_m, units, said in (
        (-6.1, 0.5, METRIC, "-6.1 % = -20 kg/ha   +0.50 m"),
        (-6.1, 0.5, IMPERIAL, "-6.1 % = -18 lb/ac   +1.64 ft"),
        (None, None, METRIC, "not known"),
        (0.0, None, METRIC, "no effect on rate or place"),
    ):
        cause = replace(sample_found().found.causes[0], field_cost=FieldCost(percent, place_m))
        assert diagnosis_words.format_cost(cause, 324.6, units) == said


def test_the_steps_of_a_plan_are_a_field_and_its_words_are_not_cut():
    tests = ("stop the shaft in gear 2. weigh; then 3. go on (5 min)", "wait.")
    found = sample_found()
    found = having(
        found._replace(drives=""),
        next_run=replace(
            found.found.next_run, plan=f"1. {tests[0]}; then 2. {tests[1]}", tests=tests
        ),
    )
    assert diagnosis_shown.make_plan_view(found).steps == (
        "Stop the shaft in gear 2. weigh; then 3. go on (5 min)",
        "Wait",
    )


def test_a_channel_is_marked_only_where_the_error_is_beyond_noise():
    lines = {one.name: one for one in diagnosis_shown.make_channels_view(sample_found()).channels}
    assert (
        lines["shaft"].wrong
        and lines["shaft"].beyond == "98 %"
        and lines["scale"].beyond == ">99 %"
    )
    assert not lines["gate"].wrong and lines["gate"].beyond == "-" and lines["flow"].after == ""


def test_only_the_gain_of_the_causes_is_told():
    found = sample_found()
    gain = found.found.gain[0]
    found = having(
        found, gain=(gain, replace(gain, metric="rmse, r/min, x", of="placebo", after=9.0))
    )
    assert diagnosis_shown.make_channels_view(found).gains == (
        "checked on a part of the log kept aside: shaft off by 1.91 before, 0.288 with it "
        "(rmse, r/min)",
    )


def test_the_interval_bar_has_zero_in_its_middle():
    bar = draw_interval_bar((0.6, 0.8, 1.0))
    assert len(bar) == 24 and bar[12] == "|" and bar.count("#") == 1 and bar.index("#") > 12
    assert draw_interval_bar((-1.0, -0.8, -0.6)).index("#") < 12


def test_plot_ends_hold_zero_and_lines_have_no_gaps():
    low, high = round_plot_ends([-3.0, -1.0])
    assert low <= -3.0 and high >= 0.0
    dots = rasterise_line([(0, 0), (10, 3)])
    assert {x for x, _y in dots} == set(range(11))
    assert len(rasterise_line([(0, 0), (30, 0)], 3)) == 11


async def test_before_and_after_differ_by_shape_and_the_onset_is_marked(app, shown):
    curve = ResidualCurve(
        "shaft",
        "r/min",
        "time_s",
        (0.0, 5.0, 10.0),
        (0.0, -4.0, -4.0),
        (0.0, 0.1, 0.0),
        (),
        onset=5.0,
    )
    plot = ResidualPlot(PlotView("error", "time, min", curve, False, "en"))
    async with app.run_test(size=(80, 24)) as pilot:
        await app.screen.mount(plot)
        plot.styles.height = 10
        await pilot.pause()
        strips = [strip.text for strip in plot.draw_rows(plot.view, 60, 10)]
        # the first two marks share a cell
        assert sum(row.count("o") for row in strips[1:-2]) == 3 - 1
        assert sum(row.count("+") for row in strips[1:-2]) == 3
        assert any(":" in row for row in strips[1:-2]) and "begins here" in strips[-2]


def test_long_lists_keep_the_chosen_row_in_sight():
    many = tuple(SOURCES[0]._replace(name=f"{k}.csv") for k in range(50))
    rows = SourceList(SourcesView((), 0, False, "en")).draw_rows(
        SourcesView(many, 40, False, "en"), 80, 12
    )
    assert len(rows) == 12 and any(
        "40.csv" in row.plain and row.plain.startswith(">") for row in rows
    )


@pytest.mark.parametrize(("files", "rows"), [(0, 0), (3, 3), (10, 10), (11, 10), (50, 10)])
def test_letters_stand_at_files_that_are_shown(monkeypatch, files, rows):
    monkeypatch.setattr(SourceList, "content_size", Size(80, 12))
    view = SourcesView(
        tuple(SOURCES[0]._replace(name=f"{k}.csv") for k in range(files)), 0, False, "en"
    )
    places = SourceList(view).list_click_places()
    assert places == tuple((0, 2 + row) for row in range(rows))
    drawn = SourceList(view).draw_rows(view, 80, 12)
    assert all(".csv" in drawn[y].plain for _x, y in places)


def test_every_effect_of_the_catalogue_is_known_in_chinese():
    known = read_catalogue("zh").texts
    assert known.get(find_effect_title(UNKNOWN))
    for entry in CATALOGUE.values():
        for text in (
            entry.effect.title,
            entry.effect.advice,
            entry.effect.separate,
            *entry.effect.says,
        ):
            assert known.get(text), text
        for text in entry.effect.says:
            assert text.count("{size}") <= 1 and known[text].count("{size}") == text.count("{size}")


def test_the_plans_of_all_manoeuvres_are_known():
    from topdress.control.experiments.manoeuvres import list_manoeuvres
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    plans = {
        one.id: one.plan for one in list_manoeuvres(load_config("huanghai", MACHINE_KIND).model)
    }
    assert (
        all(map(read_catalogue("zh").texts.get, plans.values()))
        and sample_found().found.next_run.plan == plans["stairs"]
    )


@pytest.mark.exam
async def test_a_chinese_page_has_no_english_sentence(source, clock, service, shown):
    app = TopdressApp(
        source, clock, live=False, language="zh", services=Services(diagnosis=service)
    )
    async with app.run_test(size=(120, 40)) as pilot:
        await found_shown(app, pilot)
        text = "\n".join(shown(app))
        assert "无法区分" in text and "转速高时槽轮充满度下降" in text
        assert not [
            word
            for word in ("causes", "channel", "before", "advice", "Flutes", "noise")
            if word in text
        ]
    use_language("en")


def test_a_curve_with_names_is_drawn_by_places():
    curve = ResidualCurve(
        "heads", "NDVI", "head", (0.0, 1.0), (0.1, 0.2), (0.0, 0.0), (0.01, 0.01), ("1", "2")
    )
    found = sample_found()
    found = found._replace(drawn=(found.drawn[0]._replace(over=curve),))
    assert diagnosis_shown.make_variable_plot(found, 0).curve.names == ("1", "2")


async def test_what_was_adopted_is_compared_on_another_log(app, service, shown):
    """C after K: the logs offered are none that the file was made from; errors before and after
    stand in words."""
    service.found = sample_found("named")
    async with app.run_test(size=(120, 40)) as pilot:
        await found_shown(app, pilot)
        await pilot.press("q", "4", "enter")
        assert "adopt something first" in "\n".join(shown(app))
        await pilot.press("escape")
        await pilot.press("q", "1", "enter", "enter")
        assert "Q4 there says, on another log," in "\n".join(shown(app))
        await pilot.press("escape", "f9")
        await settled(app, pilot)
        assert "Q4 compare" in " ".join(" ".join(shown(app)).split())
        await pilot.press("q", "4", "enter")
        offered = [choice.value for choice in app.screen.choices]
        assert offered == [SOURCES[2].path, "typed"], (
            "not the run of now, not the log it was made from, no table"
        )
        await pilot.press("enter")
        await settled(app, pilot)
        assert (
            service.asked[-1]
            == f"compare /data/machines/huanghai-2026-03-18.yaml {SOURCES[2].name}"
        )
        text = app.screen.text
        assert "shaft: 1.92 -> 0.290 r/min   better: 85 % less error" in text
        assert "no difference beyond chance" in text and "worse: 25 % more error" in text
        assert "/data/reports/compared.html" in text


async def test_before_enter_it_says_that_the_diagnosis_is_not_installed_and_a_key_installs_it(
    app, service, shown, pilot
):
    service.installed, service.refuse = False, "pip: no network"
    page = await opened(app, pilot)
    assert "not installed here (210 MB): Q8 installs it" in "\n".join(shown(app))
    await pilot.press("enter")
    await settled(app, pilot)
    assert service.asked == [] and page.shown is None
    await pilot.press("q", "8", "enter")
    await settled(app, pilot)
    assert "pip: no network" in "\n".join(shown(app)) and not page.installed
    service.refuse = ""
    await pilot.press("q", "8", "enter")
    await settled(app, pilot)
    assert service.asked == ["install", "install"] and "(210 MB)" not in "\n".join(shown(app))
    await pilot.press("enter")
    await settled(app, pilot)
    assert page.shown is not None
