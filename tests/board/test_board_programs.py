"""The boards' programs: what they do with a machine behind the pins, and that MicroPython does
exactly the same."""

from __future__ import annotations

import binascii
import random
import subprocess
from pathlib import Path

import pytest
from topdress.drivers.board import framing
from topdress.drivers.board.framing import calc_crc16, seal_frame
from topdress.drivers.board.motion import ShaftControl, Stepper

from tests.board import board_scenarios as scenarios

BOARD = Path(framing.__file__).parent


def test_the_crc_is_the_protocols(board_crc=binascii.crc_hqx):
    chance = random.Random(1)
    for length in range(60):
        data = chance.randbytes(length)
        assert calc_crc16(data) == board_crc(data, 0xFFFF)
    assert seal_frame("T1,41,70.000,25.000,1") == b"$T1,41,70.000,25.000,1*7B29\r\n", (
        "the example of the page"
    )


def test_a_silent_host_stops_the_drives_after_one_second():
    rpm, stopped_ms, flags, restarted, on_again, gate_mm = scenarios.safe_stop()
    assert rpm == 60
    assert stopped_ms == [1000]
    assert flags == 2, "heartbeat lost, not enabled"
    assert not restarted, "not by the same command again"
    assert on_again, "but after one with enable 0"
    assert gate_mm == 30.0


@pytest.mark.parametrize(
    ("scenario", "found"),
    [
        pytest.param(
            "power_on", [False, 0, 0], id="after power-on nothing moves until a disabled command"
        ),
        pytest.param(
            "stop_at_once",
            [False, 0.0, 40.0],
            id="enable 0 stops the shaft within two milliseconds, and the gate goes where "
            "it was sent",
        ),
        pytest.param("driver_fault", [False, 0.0, 4], id="a driver's fault stops and is told"),
        pytest.param(
            "valve_switches",
            [["$S1", 14, "0"], ["$S2", 15, "0,5"], ["$S2", 15, "0,0"], ["$S3", 17, "0,,41.500,"]],
            id="a board whose valves have switches tells how they stand, one that measures "
            "effort that too",
        ),
        pytest.param("limits", [100, 60.0], id="set-points are cut to what is screwed on"),
        pytest.param(
            "gate_moves",
            [[25.0, 1300], [40.0, 1500], [10.0, -3000], [10.1, 10]],
            id="the gate reaches its places by as many steps",
        ),
        pytest.param("lost_steps", [8, 40.0, 0], id="lost steps are seen, said and made good"),
        pytest.param(
            "metering_stepper",
            [400, 2000, "60.000", 0.0, [0, True], [0, False], [0, False], [0, False]],
            id="a stepper meters, up its ramp, and no way to stop leaves a step",
        ),
        pytest.param(
            "stepper_falls_out_of_step",
            [
                [195, 81],
                [267, 81],
                [267, 78],
                [266, 81],
                [267, 0],
                [195, 0],
                [196, 0],
                [195, 0],
                [267, 78],
                [266, 81],
            ],
            id="a stepper that is held begins its ramp anew until it turns",
        ),
        pytest.param(
            "turned",
            [
                ["0", "2400.000", "", "", False],
                ["4705", "2400.000", "", "", False],
                ["", "", "0", "400.000", False],
                ["", "", "760", "400.000", False],
                ["0", "2400.000", "0", "400.000", False],
                ["0", "2400.000", "639", "400.000", False],
            ],
            id="how far the shaft turned is answered at any time, and moves nothing",
        ),
        pytest.param(
            "own_settings",
            [
                [1198, "usb", "dc"],
                "counts_per_tern: no setting of this board",
                "link 'wifi': allowed is uart or usb",
                "counts_per_turn '1200': allowed is a value like 2400.0",
                "counts_per_turn 0: allowed only with shaft_drive 'stepper'",
                "words_only 1: allowed is a value like False",
                "take: no setting of this board",
                "stepper_steps_s2 1000000000.0: allowed is 100.0 to 20000.0",
                [0.0, "uart", "stepper"],
                "max_shaft_rpm 100.0: asks 10667 steps a second of the stepper: allowed is "
                "stepper_steps_s, 4000",
            ],
            id="a maker's own settings are taken, or refused in one line",
        ),
        pytest.param(
            "usb_line",
            [64, 36, 0, 1, 0, 10, 1010, True, "$S1,0,0*DEDA", 69, "", "after"],
            id="a host that does not read the USB line keeps nobody waiting and costs whole frames",
        ),
    ],
)
def test_the_board_does(scenario, found):
    assert scenarios.SCENARIOS[scenario]() == found


@pytest.mark.parametrize(
    ("given", "most_rise_ms", "most_overshoot_rpm"),
    [
        pytest.param((), 300, 2.0, id="a step"),
        # 21 with an integrator that learns from a jam until the duty is at its limit
        pytest.param((0.0,), None, 4.0, id="after a jam"),
        # 27 without a limit to what is learnt
        pytest.param((50.0,), None, 15.0, id="after it was held at a part of its speed"),
        pytest.param(
            (None, 100.0),
            500,
            2.0,
            id="a motor that turns a fifth slower than the feed-forward believes",
        ),
    ],
)
def test_the_shaft_follows(given, most_rise_ms, most_overshoot_rpm):
    rise_ms, overshoot_rpm, steady_rpm = scenarios.shaft_step(*given)
    assert overshoot_rpm < most_overshoot_rpm and abs(steady_rpm) < 0.3
    assert most_rise_ms is None or rise_ms < most_rise_ms


def test_valves_open_only_while_the_drives_are_enabled():
    masks, unknown = scenarios.valves()
    assert masks == [0, 0, 0, 5, 5, 5, 0, 0, 7, 0]
    assert unknown == 1, "a board without valves obeys no frame that has them"


def test_wrong_frames_are_counted_by_kind_and_not_obeyed():
    counts, obeyed_rpm = scenarios.bad_frames()
    assert dict(counts) == {
        "bad_crc": 3,
        "missing_crc": 3,
        "wrong_length": 1,
        "out_of_range": 4,
        "not_a_number": 3,
        "unknown_frame": 1,
        "repeated_sequence": 1,
        "overlong": 1,
    }
    assert obeyed_rpm == 50


READY, TURNS, OLD, STOPPED, AGAIN = (
    [False, 0],
    [True, 0],
    [False, 64, "old_order"],
    [False, 64],
    [True, 64],
)
DOUBLED = [True, 0, "repeated_sequence"]


def test_a_board_with_a_word_takes_only_what_is_newer_and_stops_on_what_is_not():
    found, words = scenarios.orders_with_a_word()
    assert found[:2] == [[False, 32], [False, 32]] and words == [0xFEDCBA98, 7], (
        "it wants to be asked for its word"
    )
    assert found[2:10] == [READY, TURNS, DOUBLED, DOUBLED, OLD, STOPPED, STOPPED, AGAIN], (
        "16 behind is old"
    )
    assert found[10:13] == [OLD, STOPPED, AGAIN], "another session's word"
    assert found[13:16] == [*found[16:18], AGAIN] == [OLD, STOPPED, AGAIN], (
        "T1, then D1: no word at all"
    )
    assert found[18:20] == [[False, 64, "unknown_frame"]] * 2, (
        "valves that it has not; no place for them"
    )
    assert found[21:25] == [
        [False, 34],
        [False, 34, "old_order"],
        [False, 34, "old_order"],
        [False, 34],
    ], "after a silence it has another word: the session before, played on from there, is old"
    assert found[25:] == [READY, TURNS]


def test_without_a_word_what_is_older_by_less_than_half_the_circle_is_old():
    found, words = scenarios.orders_without_a_word()
    assert (
        found[:9] == [READY, TURNS, TURNS, DOUBLED, DOUBLED, OLD, STOPPED, STOPPED, AGAIN]
        and not words
    )
    assert found[9:] == [OLD, STOPPED, AGAIN, [True, 64, "unknown_frame"]]


def test_a_new_board_obeys_an_old_host_unless_it_is_set_to_words_only():
    found, words = scenarios.orders_without_a_word((5,))
    without, _ = scenarios.orders_without_a_word()
    assert [one[0] for one in found] == [one[0] for one in without] and words == [5]
    assert {one[1] for one in found} == {32}, "an old host never asks"
    assert scenarios.orders_without_a_word((5,), True)[0][:12] == [[False, 32, "old_order"]] * 12


def test_the_feed_forward_alone_is_nearly_right():
    control = ShaftControl(
        0.008, 0.04, 0.1, kp=0.0, ki=0.0, acceleration_rpm_s=1e9, held_share=0.25, held_rpm=5.0
    )
    assert control.update_duty(70.0, 0.0, 0.01) == pytest.approx(0.6)
    assert control.update_duty(0.0, 70.0, 0.01) == 0.0
    assert control.update_duty(1000.0, 0.0, 0.01) == 1.0


def test_without_a_displacement_sensor_it_homes_first_and_the_shaft_waits():
    (homing, duty), (homed, place_mm), *moves = scenarios.gate_moves(False)
    assert (homing, duty, homed) == (16, 0.0, 0)
    assert place_mm == pytest.approx(0.5, abs=0.02)
    assert [place for place, _ in moves] == pytest.approx([25.0, 40.0, 10.0, 10.1], abs=0.02)


def test_a_step_of_the_gate():
    rise_ms, overshoot_mm, error_mm = scenarios.gate_step()
    assert rise_ms == pytest.approx(400, abs=20), "8 mm at 20 mm/s"
    assert overshoot_mm <= 0.02 and abs(error_mm) <= 0.005


def test_no_step_is_lost_or_doubled_whatever_the_target_does():
    chance = random.Random(4)
    stepper, put_out = Stepper(2000.0, 20000.0), 0
    wanted = 0
    for tick in range(20000):
        if tick % 400 == 0 and tick < 19000:
            wanted = chance.randrange(-3000, 3000)
        steps = stepper.step_to_place(wanted, 0.001)
        put_out += steps
        assert abs(steps) <= 3
    assert put_out == stepper.place == wanted


def test_a_hundred_doses_turn_as_many_steps_as_their_angles():
    total, least, most, state, took_ms, cut, cut_state, refused, after_refusal = scenarios.doses()
    assert total == round(100 * 120.0 * 400.0 / 360.0)
    assert (least, most) == (133, 134)
    assert state == 2 and took_ms == pytest.approx(250, abs=50), "0.2 s at 99.8 r/min and two ramps"
    assert cut < 60 and cut_state == 4, "a stop ends a dose, and it is told how far it came"
    assert (refused, after_refusal) == (3, 0)


def test_the_lag_rig_times_start_and_landing():
    run, state, start_ms, land_ms, flags = scenarios.lag_rig()
    assert (run, state, land_ms, flags) == (42, 3, 1900, 0)
    assert start_ms == pytest.approx(403, abs=3), (
        "1 r/min does not start the clock, 20 r/min does at once"
    )


def test_a_granule_before_the_start_is_told():
    assert scenarios.lag_rig(True)[-1] == 2


def test_the_scales_conversions_become_kg_and_a_broken_cell_is_not_known():
    before, *found, kept_kg, silent, again_kg = scenarios.scale()
    assert before is None
    assert found == [[5.0, 25], [105.0, 25], [0.0, 25], [8393.606, 25], [None, 25], [25.0, 25]]
    assert (kept_kg, silent, again_kg) == (25.0, None, 6.0), "silent for a second: not known"


def test_the_inclination_is_nose_up_and_right_side_down_positive():
    flat, written, nose_up, right_down, jolted, slowly, gone, back, other = scenarios.tilt()
    assert (flat, written) == ([0.0, 0.0], [[0x20, 0x47], [0x23, 0x88]])
    assert nose_up == [10.0, 0.0] and right_down == [0.0, 10.0]
    assert jolted == right_down, "a jolt says nothing of the slope"
    assert 1.0 < slowly < 10.0, "a tenth of the way in a twentieth of a second"
    assert (gone, back, other) == (None, [0.0, 0.0], None)


@pytest.mark.exam
@pytest.mark.parametrize("part", sorted(scenarios.SCENARIOS))
def test_micropython_does_the_same(part, under_micropython):
    assert under_micropython[part] == scenarios.SCENARIOS[part]()


@pytest.mark.parametrize("name", sorted(path.name for path in BOARD.glob("*.py")))
def test_every_file_compiles_for_the_board(name, tmp_path, mpy_cross):
    out = tmp_path / "out.mpy"
    ended = subprocess.run(
        [*mpy_cross, "-march=armv6m", "-o", str(out), str(BOARD / name)],
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert ended.returncode == 0, ended.stderr
    assert out.read_bytes()[:1] == b"M"
