"""When the bell rings, and the list of alarms."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace

import pytest
from topdress.console.app.alarms import MIN_BELL_GAP_S, RED_REPEAT_S, AlarmBell, make_alarm_entries
from topdress.console.app.screens.alarm_list import AlarmList
from topdress.console.app.units import METRIC
from topdress.console.services.sound_player import SoundPlayer
from topdress.console.worker.resume_alarms import AlarmHistory
from topdress.control.orders import Alarm, Do, Severity

from tests.app.harness import feed

RED = Alarm("shaft_silent", Severity.RED, 0.0)
OTHER = Alarm("speed_silent", Severity.RED, 0.0)
AMBER = Alarm("heads_few", Severity.AMBER, 0.0)
SIZE = (120, 40)


RINGS = {
    "red at once and again until it is acknowledged": (
        100.0,
        lambda t: (RED._replace(acknowledged=t >= 70.0),),
        [0.0, RED_REPEAT_S, 2 * RED_REPEAT_S],
    ),
    "amber once": (200.0, lambda t: (AMBER,), [0.0]),
    "one ring for what comes within five seconds": (
        20.0,
        lambda t: (AMBER,) if t < 1.0 else (AMBER, RED) if t < 2.0 else (AMBER, RED, OTHER),
        [0.0, MIN_BELL_GAP_S],
    ),
    "one that flutters is not heard each time": (
        30.0,
        lambda t: (AMBER,) if int(t) % 2 == 0 else (),
        [0.0],
    ),
    "one that was away for long is": (
        30.0,
        lambda t: (AMBER,) if t < 1.0 or t > 15.0 else (),
        [0.0, 15.2],
    ),
    "nothing is owed for what is gone": (
        20.0,
        lambda t: (AMBER,) if t < 1.0 else (RED,) if t < 2.0 else (),
        [0.0],
    ),
}


@pytest.mark.parametrize("until_s, alarms, heard", RINGS.values(), ids=RINGS)
def test_when_the_bell_rings(until_s, alarms, heard):
    bell = AlarmBell()
    assert [
        k / 5 for k in range(round(until_s * 5)) if bell.count_strokes_due(k / 5, alarms(k / 5))
    ] == heard


async def test_the_bell_is_heard_unless_it_is_off(app, source, clock):
    heard = []
    app.bell = lambda: heard.append(clock.now_s)
    async with app.run_test(size=SIZE):
        for sound, count in ((False, 0), (True, 1)):
            app.sound = sound
            clock.now_s += 60.0
            feed(app, [{}], alarms=(RED if not sound else OTHER,))
            assert len(heard) == count


def test_an_entry_says_when_how_often_and_what_to_do():
    book = AlarmHistory()
    book.add_row_alarms(1.0, "2026-03-18T06:12:01Z", (RED,))
    book.add_row_alarms(2.0, "2026-03-18T06:12:02Z", ())
    book.add_row_alarms(9.0, "2026-03-18T06:12:09Z", (RED._replace(acknowledged=True),))
    (entry,) = make_alarm_entries(book.records, METRIC, 8 * 3600.0)
    assert (
        entry.when == "first 14:12:01  last 14:12:09  2 times  acknowledged 14:12:09"
        and entry.stands
    )
    assert entry.todo == "Stop. Check power and cable of the drive board."
    book = AlarmHistory()
    book.add_row_alarms(3.0, None, (RED, AMBER))
    red, amber = make_alarm_entries(book.records, METRIC, 0.0)
    assert (
        red.when == "first 3 s  last 3 s  once  not acknowledged"
        and amber.when == "first 3 s  last 3 s  once"
    )


async def test_the_list_shows_what_was(app, source, shown, pilot):
    feed(app, [{}], alarms=(RED,))
    feed(app, [{}], alarms=())
    await pilot.press("exclamation_mark")
    assert isinstance(app.screen, AlarmList)
    text = "\n".join(shown(app))
    assert (
        "The metering shaft does not answer." in text
        and "not acknowledged" in text
        and "Stop. Check" in text
    )
    await pilot.press("escape")
    assert not isinstance(app.screen, AlarmList)


async def test_on_replay_it_is_the_logs(replay_app, replay_source, frames, shown):
    marked = [
        replace(frame, alarms=(RED,)) if 50 <= k < 60 else frame for k, frame in enumerate(frames)
    ]
    replay_source.replace_frames(marked)
    app = replay_app
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("exclamation_mark")
        assert any("no alarm so far" in row for row in shown(app)), "the log stands at its start"
        await pilot.press("escape", "end", "exclamation_mark")
        assert any("does not answer" in row for row in shown(app))


def test_an_alarm_strikes_three_times_and_a_caution_once():
    bell = AlarmBell()
    assert bell.count_strokes_due(0.0, (AMBER,)) == 1
    assert bell.count_strokes_due(6.0, (AMBER, RED)) == 3
    assert bell.count_strokes_due(6.0 + RED_REPEAT_S, (AMBER, RED)) == 3, (
        "again while nobody acknowledged it"
    )
    both = AlarmBell()
    assert both.count_strokes_due(0.0, (AMBER, RED)) == 3, "the worst of what is new"


async def test_a_sound_of_ones_own_takes_the_bells_place_and_never_holds_the_console(
    app, source, clock
):
    heard, played, waited = [], [], threading.Event()

    def play(command):
        waited.wait(20.0)  # a sound server that does not answer
        played.append(command)
        return "no such player" if len(played) > 1 else ""

    app.bell = lambda: heard.append(clock.now_s)
    app.services = replace(app.services, play=play)
    async with app.run_test() as pilot:
        app.sound, app.sounds = True, {3: "play siren", 1: ""}
        feed(app, [{}], alarms=(RED,))
        await pilot.press("space")
        await pilot.pause(0.05)
        assert [order.do for order in source.orders] == [Do.HOLD] and not heard and not played
        waited.set()
        await pilot.pause(0.1)
        assert played == ["play siren"] and not heard
        clock.now_s += 40.0
        feed(app, [{}], alarms=(RED,))
        await pilot.pause(0.1)
        assert heard and "no sound: no such player" in app.notice_text, (
            "the bell rings where nothing can be played"
        )


def test_a_player_begins_a_command_and_does_not_wait(tmp_path):
    player = SoundPlayer()
    assert "no-such-player" in player("no-such-player siren.oga")
    assert player('"unclosed') != ""
    slow = f"{sys.executable} -c 'import time; time.sleep(30)'"
    begun_s = time.monotonic()
    assert player(slow) == "" and time.monotonic() - begun_s < 15.0
    first = player._playing
    assert player(slow) == "" and player._playing is first, "one at a time"
    first.kill()
    first.wait()


async def test_what_is_shown_is_copied_by_the_terminals_clipboard(app, source, pilot):
    """The alarms, a dialog's text, what the mouse has selected in one, and elsewhere the path
    of the log."""
    feed(app, [{}], alarms=(RED,))
    await pilot.press("ctrl+y")
    assert app.clipboard == app.arrival.frame.log_path != ""
    await pilot.press("exclamation_mark", "ctrl+y")
    assert "Stop. Check power and cable of the drive board." in app.clipboard
    await pilot.press("escape", "ctrl+q", "ctrl+y")
    assert app.clipboard == app.screen.text
    app.screen.query_one(".dialog-text").text_select_all()
    await pilot.press("ctrl+c")
    assert app.is_running and app.clipboard == app.screen.get_selected_text()
