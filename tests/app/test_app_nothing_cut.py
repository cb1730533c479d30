"""Nothing that carries meaning is cut, at any size of terminal that is allowed for, in any
language."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import combinations, product

import pytest
from rich.cells import cell_len
from rich.cells import set_cell_size as sized
from rich.style import Style
from textual.strip import Strip
from textual.widget import Widget
from textual.widgets import Button
from topdress.console.app import frame_words
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import Dialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.base_page import NoticeRows
from topdress.console.app.panel_views import (
    AgedText,
    AlarmsView,
    RatesView,
    StatusView,
    make_alarms_view,
)
from topdress.console.app.units import IMPERIAL, METRIC, UNITS
from topdress.console.app.widgets import base_panel
from topdress.console.app.widgets.alarm_bar import AlarmBar, count_rows_needed
from topdress.console.app.widgets.base_panel import Panel
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.app.widgets.rate_panels import RatesPanel
from topdress.console.app.widgets.status_line import StatusLine
from topdress.console.locale import list_languages, use_language
from topdress.control.orders import Alarm, Severity
from topdress.control.safety import ALARMS
from topdress.control.targets.map_check import MapCheck

from tests.app.gallery import PICTURES, Picture, settle, still_app
from tests.app.made_up.job import facts_of

SIZES = ((120, 40), (100, 30), (80, 24), (60, 20), (65, 43))
WIDTHS = tuple(width for width, _rows in SIZES)
VALUES = {
    "hopper_kg": 118.5,
    "metres_left": 12640.0,
    "device": "rate_module",
    "speed_mps": 1.81,
    "file": "run.csv",
}
SCREENS = sorted({one.screen for one in PICTURES})


@contextmanager
def watched() -> Iterator[list[str]]:
    """What is cut to fit while panels are drawn, each text as it was meant."""
    found: list[str] = []

    def noted(text: str, width: int) -> str:
        if cell_len(text.rstrip()) > max(0, width):
            found.append(f"{text.strip()!r} in {width}")
        return sized(text, width)

    def drawn(canvas: Canvas, width: int, *parts: tuple[str, Style]) -> Strip:
        text = "".join(part[0] for part in parts)
        if cell_len(text.rstrip()) > width:
            found.append(f"{text.strip()!r} in {width}")
        return before[1](canvas, width, *parts)

    before = base_panel.set_cell_size, Canvas.make_text_strip
    base_panel.set_cell_size, Canvas.make_text_strip = noted, drawn
    try:
        yield found
    finally:
        base_panel.set_cell_size, Canvas.make_text_strip = before


def cut_on(app: TopdressApp) -> list[str]:
    """Everything on the screen as it is now that is cut."""
    found = []
    for screen in dict.fromkeys((app.page, app.screen)):
        for one in (*screen.query(Panel), *screen.query(Canvas)):
            if (
                one.is_mounted
                and one.visible
                and one.display
                and all(a.display for a in one.ancestors if isinstance(a, Widget))
            ):
                found += [f"{type(one).__name__}: {what}" for what in _cut_in(one)]
                if one.region.right > app.size.width:
                    found.append(f"{type(one).__name__} runs out of the screen: {one.region}")
    if isinstance(app.screen, Dialog):
        found += _beyond(app.screen)
    return [*found, *_buttons_cut(app.screen)]


def _buttons_cut(screen) -> list[str]:
    """Words of a button, or of a row of them, that have no room: also where the row runs out to
    the right of what can be scrolled down only."""
    found = []
    for one in screen.query(Button):
        inside = one.parent.content_region
        label = max((cell_len(row) for row in one.label.plain.splitlines()), default=0)
        wraps = one.has_class("dialog-choice")
        if one.display and (one.region.x < inside.x or one.region.right > inside.right):
            found.append(f"button {one.label.plain!r} runs out of its row")
        elif one.display and not wraps and label > one.content_size.width:
            found.append(f"button {one.label.plain!r} in {one.content_size.width}")
    return found


def _cut_in(one: Panel | Canvas) -> list[str]:
    width, height = one.content_size
    if width <= 0 or height <= 0:
        return []
    with watched() as found:
        rows = one.draw_rows(one.view, width, height)
    if isinstance(one, Canvas):
        return found
    found += [
        f"{row.plain.rstrip()!r} in {width}" for row in rows if cell_len(row.plain.rstrip()) > width
    ]
    return [
        *found,
        *(f"no row for {row.plain.strip()!r}" for row in rows[height:] if row.plain.strip()),
    ]


def _beyond(dialog: Dialog) -> list[str]:
    """Parts of a dialog that lie outside of what is seen and cannot be scrolled to."""
    found = []
    for box in dialog.query(".dialog"):
        if box.allow_vertical_scroll and type(box).__name__ == "VerticalScroll":
            continue
        inside = box.content_region
        for child in box.query("*"):
            region = child.region
            if any(type(one).__name__ == "VerticalScroll" for one in child.ancestors):
                continue  # it is scrolled to
            if region.area and not inside.contains_region(region):
                found.append(
                    f"{type(dialog).__name__}: {type(child).__name__} "
                    f"{str(getattr(child, 'label', getattr(child, 'content', '')))[:40]!r} outside"
                )
    return found


def drawn_in(one, view, width, height):
    """The rows of a view on a panel of this size, and what of it is cut."""
    with watched() as found:
        rows = one.draw_rows(view, width, height)
    return [row.plain for row in rows], found + [
        row.plain for row in rows if cell_len(row.plain.rstrip()) > width
    ] + [row.plain for row in rows[height:] if row.plain.strip()]


def test_the_finder_finds():
    """A text that is too long, a row that is too long, a row too many."""
    view = AlarmsView((), "a calm line that is much too long for so few cells", "", True)
    assert drawn_in(AlarmBar(view), view, 20, 1)[1] == []
    note = RatesView(
        AgedText("1"),
        AgedText("1"),
        "kg/ha",
        "",
        AgedText("--"),
        None,
        "",
        ("a note of more cells than there are",),
    )
    assert drawn_in(RatesPanel(note), note, 24, 7)[1]


class Rowful(Dialog[None]):
    """More buttons in a row than there are cells for."""

    def compose_buttons(self):
        for number in range(6):
            yield Button(f"answer number {number}", classes="dialog-button")


@pytest.mark.parametrize(("columns", "finds"), [(120, True), (200, False)])
async def test_the_finder_finds_a_row_of_buttons_that_runs_out(picture, columns, finds):
    app = picture(size=(columns, 40))
    async with app.run_test(size=(columns, 40)) as pilot:
        app.push_screen(Rowful("A question"))
        await pilot.pause()
        app.screen.query_one(".dialog").styles.width = columns - 10
        await pilot.pause()
        assert any("answer number 5" in one for one in cut_on(app)) == finds


@pytest.mark.parametrize("language", list_languages())
@pytest.mark.parametrize(
    "width", [60, 120, *(pytest.param(width, marks=pytest.mark.exam) for width in (100, 80))]
)
def test_every_alarm_is_read_to_its_end(frames, language, width):
    use_language(language)
    frame = frames[-1]
    # most alarms tell nothing that has another unit: drawn once
    found, drawn = {}, set()
    for (name, kind), gone_s, seen, units in product(
        ALARMS.items(), (None, 12.0), (False, True), (METRIC, IMPERIAL)
    ):
        one = Alarm(name, kind.severity, 1.0, seen, tuple(VALUES.items()), gone_s)
        others = [
            Alarm(other, Severity.AMBER, 2.0, False, tuple(VALUES.items()))
            for other in list(ALARMS)[:3]
        ]
        for standing in ([one], [one, *others]):
            shown = make_alarms_view(replace(frame, alarms=tuple(standing)), 0.0, units)
            if shown in drawn:
                continue
            drawn.add(shown)
            rows = max(3, count_rows_needed(shown, width))
            assert rows <= 7, name
            lines, cut = drawn_in(AlarmBar(shown), shown, width, rows)
            if cut:
                found[name] = cut
            assert len(standing) == 1 or any(char.isdigit() for char in "".join(lines))
    assert found == {} and len(drawn) > 8 * len(ALARMS)


@pytest.mark.parametrize("language", list_languages())
@pytest.mark.parametrize(("width", "height"), [(76, 8), (62, 7), (80, 7)])
def test_every_reason_for_another_rate_is_read_to_its_end(language, width, height):
    use_language(language)
    for some in [
        *((one,) for one in frame_words.NOTE_NAMES),
        *combinations(frame_words.NOTE_NAMES, 2),
    ]:
        note = tuple(frame_words.name_note(one) for one in some)
        view = RatesView(
            AgedText("1234"),
            AgedText("1234"),
            "kg/ha",
            "+30 %",
            AgedText("-100 %"),
            -1.0,
            "red",
            note,
        )
        lines, cut = drawn_in(RatesPanel(view), view, width, height)
        assert cut == []
        assert frame_words.name_note(some[0]) in " ".join(lines), (
            "the first reason always; the others are counted"
        )


@pytest.mark.parametrize("language", list_languages())
@pytest.mark.parametrize("width", WIDTHS)
def test_every_refusal_is_read_to_its_end(language, width):
    use_language(language)
    for why in frame_words.ANSWER_TEXTS:
        text = f"refused: {frame_words.describe_refusal(why)}"
        bar = NoticeRows("")
        rows, cut = drawn_in(bar, text, width, 6)
        assert cut == [] and len(rows) <= 6
        assert "".join(rows).replace(" ", "") == text.replace(" ", "")


@pytest.mark.parametrize("language", list_languages())
@pytest.mark.parametrize("width", WIDTHS)
def test_state_and_marks_stand_whole_and_words_go_whole(language, width):
    use_language(language)
    bar = StatusLine(StatusView("", "", "", "", "", "", (), "", "", ""))
    for state, source, silent in product(
        frame_words.STATE_NAMES, frame_words.SOURCE_NAMES, ("", "NO DATA 12 s")
    ):
        view = StatusView(
            state,
            frame_words.STATE_SYMBOLS[state],
            frame_words.name_state(state),
            frame_words.name_strategy("balanced"),
            frame_words.name_source(source),
            "",
            ("SIMULATED", "LOCKED"),
            silent,
            "12:34:56",
            "1:23:45",
        )
        (text, *_), cut = drawn_in(bar, view, width, 1)
        assert cut == []
        assert frame_words.name_state(state) in text and "SIMULATED" in text and silent in text


async def on_every_size(picture, change=None, units="metric"):
    app, _clock = still_app(picture)
    found = []
    async with app.run_test(size=SIZES[0]) as pilot:
        await settle(app, picture, pilot.pause)
        app.units = UNITS[units]
        if change is not None:
            change(app)
        for size in SIZES:
            await pilot.resize_terminal(*size)
            for _again in range(2):
                await pilot.pause()
                app.page.refresh_all_next_tick()
                app.show_newest()
            await pilot.pause()
            found += [f"{size[0]}x{size[1]} {one}" for one in cut_on(app)]
    return found


@pytest.mark.parametrize("screen", ["run", "map", "job"])
async def test_nothing_is_cut_with_alarms(screen):
    assert await on_every_size(Picture("cut", SIZES[0], screen=screen, alarms=True)) == []


def late(app):
    """The end of a long day on a large field: every number has its most digits."""
    frame, picture = app.source.current_frame, app.fields.find_picture(app.source.current_frame)
    assert picture is not None
    row = frame.row._replace(
        time_s=frame.row.time_s + 40_000.0,
        hopper_kg=1234.5,
        target_rate_kg_ha=412.3,
        applied_rate_kg_ha=398.7,
    )
    totals = frame.totals._replace(
        area_ha=138.61,
        worked_s=38_000.0,
        applied_kg=45_678.9,
        covered_ha=137.2,
        overlap_ha=12.34,
        applied_n_kg=21_012.5,
    )
    app.source.current_frame = replace(
        frame,
        row=row,
        area_ha=138.61,
        applied_kg=45_678.9,
        totals=totals,
        metres_left_m=12_345.0,
        seq=frame.seq + 1,
    )
    app.fields.find_picture = lambda _frame: replace(picture, area_ha=412.75, planned=None)


def full_job(app):
    """A job with everything that a check list, totals and notes can hold."""
    frame = app.source.current_frame
    app.source.current_frame = replace(
        frame,
        totals=frame.totals._replace(stopped_kg=1.3),
        tally=frame.tally._replace(
            refills=frame.tally.refills * 9, log_before="run-0.csv", after_cut_kg=0.4
        ),
        seq=frame.seq + 1,
    )
    app.job_page.facts = facts_of(
        {"flag": "rates of the source are for durum, not for winter wheat; look at the limits"},
        {"client": "Li", "farm": "Huanghai", "operator": "Wang", "response_index": "field"},
        {"adopted": ()},
        shipped_machine=True,
        map_file="maps/north.geojson",
        map_check=MapCheck(1.2, 1.2, 0.1, 0.0, 0.0, 0.0, 300.0, 0.3, 6.0, 320.0),
    )
    app.job_page.said[:] = [
        "written: run-applied.geojson, run-report.html in /home/wang/topdress/logs",
        "taken: north",
    ]


async def test_nothing_is_cut_of_a_full_job():
    assert await on_every_size(Picture("cut", SIZES[0], screen="job"), full_job) == []


@pytest.mark.parametrize("units", ["metric", pytest.param("imperial", marks=pytest.mark.exam)])
@pytest.mark.parametrize("screen", ["run", "map", "job"])
async def test_nothing_is_cut_at_the_end_of_a_long_day(screen, units):
    assert await on_every_size(Picture("cut", SIZES[0], screen=screen), late, units) == []


@pytest.mark.exam
@pytest.mark.parametrize("language", list_languages())
@pytest.mark.parametrize("screen", SCREENS)
async def test_nothing_is_cut_on_any_picture(screen, language):
    assert await on_every_size(Picture("cut", SIZES[0], language=language, screen=screen)) == []


@pytest.mark.parametrize(
    "size",
    [
        (80, 24),
        (60, 20),
        *(pytest.param(size, marks=pytest.mark.exam) for size in ((120, 40), (100, 30))),
    ],
)
async def test_nothing_of_a_question_lies_outside(picture, size):
    app = picture(size=size)
    async with app.run_test(size=size) as pilot:
        for key in ("t", "o", "m", "plus", "l", "h", "tab", "f"):
            await pilot.press(key)
            assert app.screen is not app.page, key
            assert cut_on(app) == [], key
            if isinstance(app.screen, NumberDialog):
                await pilot.press("9", "9", "9", "9", "9", "enter")
                assert cut_on(app) == [], key
            await pilot.press("escape")
