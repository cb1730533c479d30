"""The Devices screen: what each line shows, what is picked, what is ordered of a device and
what is asked first."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.dialogs import Confirm
from topdress.console.app.pages.devices import device_view
from topdress.console.app.pages.devices.device_table import DeviceTable
from topdress.console.app.widgets.action_chips import Chips, place_chips
from topdress.console.frame import DeviceDo, DeviceTest
from topdress.control.orders import Answer
from topdress.control.readings import EffortFinding

from tests.app.harness import feed, looked, tell
from tests.app.made_up.calibrate import many_devices

SIZE = (120, 40)


@pytest.fixture
def source(source, frames):
    source.current_frame = many_devices(frames[-1])
    return source


async def opened(app, pilot):
    await pilot.pause()
    await pilot.press("f5")
    return app.page


def table(page):
    return page.query_one("#device-table", DeviceTable)


@pytest.fixture
async def page(app, pilot):
    return await opened(app, pilot)


async def test_every_line_says_in_symbol_and_word_how_it_is(app, shown, page):
    said = {line.name: (line.symbol, line.word, line.level) for line in table(page).view.lines}
    assert said["gnss"] == ("✔", "speaks", "")
    assert said["head_4"] == ("✖", "NO LINE", "red")
    assert said["head_5"] == ("▯", "DISCONNECTED", "amber")
    assert said["lag_rig"] == ("!", "SILENT", "amber")
    rows = shown(app)
    board = next(row for row in rows if "slave-board/1" in row and "19950" in row)
    assert (
        "50.0" in board
        and "/dev/ttyACM0" in board
        and board.split().index("19950") < board.split().index("4")
    )
    assert any("head_4" in row and "35.2 s" in row for row in rows)


@pytest.mark.parametrize(
    ("effort", "said", "level"),
    [
        (EffortFinding(), None, ""),
        (EffortFinding(unit="A"), "stands: not judged", "stale"),
        (
            EffortFinding(mean=50.0, should=60.0, low=40.0, high=80.0, unit="%"),
            "████████┃█░░│░░░┃░░░ 50 %, expected 60, alarm outside 40 to 80",
            "",
        ),
        (
            EffortFinding(harder_percent=25.0, mean=1.6, should=1.0, low=0.0, high=1.2, unit="N m"),
            "┃█████████│█┃███░░░░ 1.6 N m, expected 1, alarm outside 0 to 1.2",
            "amber",
        ),
    ],
    ids=["no numbers", "stands", "calm", "harder"],
)
async def test_a_bar_says_how_hard_the_metering_drive_works(
    app, shown, source, pilot, page, effort, said, level
):
    tell(source, effort=effort)
    await looked(app, pilot)
    rows = page.query_one("#device-effort").view.rows
    assert [(row.text, row.level) for row in rows] == ([] if said is None else [(said, level)])
    assert (
        any(said in row for row in shown(app))
        if said
        else not any("effort" in row for row in shown(app))
    )


async def test_arrows_and_clicks_pick_and_the_details_follow(app, shown, pilot, page):
    assert page.chosen_device.name == "gnss"
    await pilot.press("up", "up")
    assert page.chosen_device.name == "board"
    text = "\n".join(shown(app))
    assert "wrong check sum 3, line too long 1" in text and "$B1,20311" in text and "231804" in text
    await pilot.click("#device-table", offset=(5, 5))
    assert page.chosen_device.name == "head_4"
    assert "device reports readiness to read" in "\n".join(shown(app))


async def test_the_picked_line_is_in_sight_where_rows_are_few(app, shown):
    async with app.run_test(size=(80, 24)) as pilot:
        page = await opened(app, pilot)
        for name in ("lag_rig", "board", "head_6", "head_5"):
            await pilot.press("up")
            assert page.chosen_device.name == name
            assert any(row.startswith(f" > {name}") for row in shown(app))


async def test_test_and_capture_are_ordered_of_the_picked_device(app, source, pilot):
    await opened(app, pilot)
    await pilot.press("enter", "e", "down", "e")
    assert source.device_orders == [
        ("gnss", DeviceDo.TEST),
        ("gnss", DeviceDo.END_CAPTURE),
        ("head_1", DeviceDo.CAPTURE),
    ]
    assert source.orders == []


async def test_letting_go_of_a_line_is_asked_once_and_taking_it_is_not(app, source, pilot, page):
    await pilot.press("c")
    assert isinstance(app.screen, Confirm) and source.device_orders == []
    await pilot.press("escape", "c", "enter")
    assert source.device_orders == [("gnss", DeviceDo.DISCONNECT)]
    page.picked = "head_5"
    await pilot.press("c")
    assert source.device_orders[1:] == [("head_5", DeviceDo.CONNECT)]


async def test_everything_can_be_clicked(source, pilot, page):
    chips = page.query_one("#device-chips", Chips)
    for action in ("dev_down", "dev_test", "dev_capture", "dev_up"):
        _chip, row, start, _cells = next(
            one for one in place_chips(chips.view, chips.size.width) if one[0].action == action
        )
        await pilot.click("#device-chips", offset=(start + 1, row))
    assert source.device_orders == [("head_1", DeviceDo.TEST), ("head_1", DeviceDo.CAPTURE)]
    assert page.chosen_device.name == "gnss"


async def test_a_refusal_is_said_in_words(app, source):
    source.answer = Answer(False, "device_in_use;state=working")
    async with app.run_test(size=SIZE) as pilot:
        await opened(app, pilot)
        await pilot.press("c", "enter")
        assert "Not possible in state WORKING." in app.notice_text


async def test_what_is_old_is_grey(app, clock, page):
    assert not table(page).view.lines[0].stale and table(page).view.lines[4].stale
    clock.now_s += 2.0
    app.show_newest()
    assert all(line.stale for line in table(page).view.lines)


async def test_last_lines_are_kept_while_another_page_is_looked_at(
    app, source, clock, shown, pilot
):
    for number in range(3):
        first, *rest = source.current_frame.devices
        feed(app, [{}], step_s=0.2, devices=(replace(first, last_raw=f"$LINE,{number}"), *rest))
    await opened(app, pilot)
    text = "\n".join(shown(app))
    assert all(f"$LINE,{number}" in text for number in range(3))


def test_what_a_test_heard_in_words(frames):
    device = many_devices(frames[-1]).devices[0]
    heard = replace(device, test=DeviceTest(False, "nmea0183", 38400, 12, 1, "$GNGGA"))
    rows = {row.label: row.text for row in device_view.make_detail_rows(heard, 0.0).rows}
    assert rows["test"] == "nmea0183 is heard; at 38400 Bd; 12 understood, 1 rejected; $GNGGA"
    nothing = replace(device, test=DeviceTest(False, said="silent"))
    assert (
        device_view.make_detail_rows(nothing, 0.0)
        .rows[5]
        .text.startswith("no known device is heard here")
    )


async def test_without_a_machine_nothing_breaks(clock, shown):
    from topdress.console.app.app import TopdressApp

    app = TopdressApp(None, clock, live=False)
    async with app.run_test(size=SIZE) as pilot:
        await opened(app, pilot)
        await pilot.press("up", "enter", "e", "c")
        assert "no connection to the machine" in app.notice_text
        assert any("no device is known" in row for row in shown(app))
