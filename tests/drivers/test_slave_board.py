"""The slave board's line protocol, both directions, and what is never sent."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from topdress.control.readings import DoseOrder, DriveCommand
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.board.framing import seal_frame
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.board_frames import (
    WORD_REQUEST,
    CommandFrame,
    calc_crc16,
    decode_status,
    encode_command,
)
from topdress.drivers.devices.point_dose import DoseState
from topdress.drivers.devices.slave_board import MAX_WORD_REQUESTS, SetPointLimits, SlaveBoard
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.board import VirtualBoard

STATUS = "S1,{seq},41,1000000,8,990000,69.900,24.980,250.050,13.480,1.500,-0.250,1,1"


def status(seq: int, /, **changes: str) -> str:
    names = (
        "name",
        "seq",
        "echo",
        "micros",
        "pulses",
        "pulse_micros",
        "shaft",
        "opening",
        "hopper",
        "supply",
        "pitch",
        "roll",
        "switch",
        "flags",
    )
    fields = dict(zip(names, STATUS.format(seq=seq).split(","), strict=True)) | changes
    return ",".join(fields.values())


def test_crc_is_the_published_one():
    assert calc_crc16(b"123456789") == 0x29B1


def test_frames_are_written_as_the_protocol_page_shows_them(board_line):
    assert encode_command(CommandFrame(41, 70.0, 25.0, True)) == board_line("T1,41,70.000,25.000,1")
    sensed = SensorReadings(
        1.0, None, 0.0, 8, None, 69.9, 24.98, 250.05, 13.48, 1.5, -0.25, True, 0.99
    )
    assert VirtualBoard(25.0, lambda: None).make_status(sensed, 0.0) == board_line(
        status(0, echo="0", flags="0")
    )
    bare = sensed._replace(
        hopper_kg=math.nan, work_switch=None, valves_open=(True, False, True), shaft_effort=41.5
    )
    assert VirtualBoard(25.0, lambda: None).make_status(bare, 0.0) == board_line(
        status(0, name="S3", echo="0", hopper="", switch="", flags="0") + ",5,41.500,"
    )


def test_a_status_line_becomes_readings(board_line):
    (readings,) = SlaveBoard().feed(board_line(status(7)), 5.0)
    assert (readings.shaft_rpm, readings.opening_mm, readings.hopper_kg) == (
        (69.9, 5.0),
        (24.98, 5.0),
        (250.05, 5.0),
    )
    assert (readings.supply_v, readings.pitch_deg, readings.roll_deg) == (
        (13.48, 5.0),
        (1.5, 5.0),
        (-0.25, 5.0),
    )
    assert (readings.work_switch, readings.echo, readings.enabled) == (True, 41, True)
    assert not readings.heartbeat_lost and not readings.driver_fault


def test_what_is_not_fitted_is_none(board_line):
    (readings,) = SlaveBoard().feed(
        board_line(status(7, hopper="", supply="", pitch="", roll="", switch="")), 5.0
    )
    optional = ("hopper_kg", "supply_v", "pitch_deg", "roll_deg", "work_switch")
    assert [getattr(readings, name) for name in optional] == [None] * 5


@pytest.mark.parametrize(
    ("fields", "found"),
    [
        (",,41.500,", (None, 41.5, None)),
        (",5,41.500,0.750", (5, 41.5, 0.75)),
        (",0,,0.750", (0, None, 0.75)),
    ],
)
def test_how_hard_the_drives_work_is_told_by_a_board_that_measures_it(board_line, fields, found):
    names = ("valves_open", "shaft_effort", "gate_effort")
    line = board_line(status(7, name="S3") + fields)
    frame = decode_status(line[1:].strip())
    assert tuple(getattr(frame, name) for name in names) == found
    (readings,) = SlaveBoard().feed(line, 5.0)
    assert (readings.shaft_effort, readings.gate_effort) == tuple(
        None if value is None else (value, 5.0) for value in found[1:]
    )
    assert SlaveBoard().feed(board_line(status(8, name="S3") + ",,1000.5,"), 5.0) == []


def test_how_the_valves_stand_is_told_by_a_board_that_knows(board_line):
    board = SlaveBoard()
    (readings,) = board.feed(board_line(status(7, name="S2") + ",5"), 5.0)
    assert readings.valves.time_s == 5.0 and readings.valves.open[:4] == (True, False, True, False)
    assert board.feed(board_line(status(8, name="S2") + ",65536"), 5.05) == []
    assert board.feed(board_line(status(8, name="S2")), 5.05) == []
    assert dict(board.counts.rejected) == {"out_of_range": 1, "wrong_length": 1}
    (readings,) = board.feed(board_line(status(9)), 5.1)
    assert readings.valves is None


def test_flags(board_line):
    (readings,) = SlaveBoard().feed(board_line(status(7, flags="6")), 5.0)
    assert (readings.enabled, readings.heartbeat_lost, readings.driver_fault) == (False, True, True)


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (status(8, shaft="401"), "out_of_range"),
        (status(8, opening="-11"), "out_of_range"),
        (status(8, hopper="6000"), "out_of_range"),
        (status(8, supply="61"), "out_of_range"),
        (status(8, switch="2"), "out_of_range"),
        (status(8, flags="256"), "out_of_range"),
        (status(8, micros="4294967296"), "out_of_range"),
        (status(8, shaft=""), "not_a_number"),
        (status(8, shaft="nan"), "not_a_number"),
        (status(8, shaft="1e1"), "not_a_number"),
        (status(8, seq="-1"), "not_a_number"),
        (status(8, flags="1,1"), "wrong_length"),
        ("S1,8", "wrong_length"),
        (status(8, name="S4"), "unknown_frame"),
        (status(7), "repeated_sequence"),
        (status(3), "repeated_sequence"),
    ],
)
def test_wrong_frames_are_rejected_and_named(board_line, payload, kind):
    board = SlaveBoard()
    board.feed(board_line(status(7)), 5.0)
    assert board.feed(board_line(payload), 5.1) == []
    assert dict(board.counts.rejected) == {kind: 1}


def test_crc_missing_wrong_and_cut_lines(board_line):
    board = SlaveBoard()
    line = board_line(status(7))
    board.feed(
        line.replace(b"69.9", b"59.9")
        + line.partition(b"*")[0]
        + b"\r\n"
        + b"noise"
        + line[:30]
        + line,
        5.0,
    )
    assert board.counts.rejected == {"bad_crc": 1, "missing_crc": 2, "garbage": 1}
    assert board.counts.accepted == 1


@pytest.mark.parametrize(("numbers", "missed"), [((65533, 65535, 2), 3), ((500, 0, 1), 0)])
def test_missed_status_lines_are_counted_over_the_wrap_and_a_restarted_board_is_heard_at_once(
    board_line, numbers, missed
):
    board = SlaveBoard()
    for seq in numbers:
        board.feed(board_line(status(seq)), 5.0)
    assert (board.counts.accepted, board.missed) == (3, missed)


def test_commands_count_up_and_stop_when_not_enabled(board_line):
    board = SlaveBoard()
    assert board.make_command_line(DriveCommand(70.0, 25.0), True) == board_line(
        "T1,0,70.000,25.000,1"
    )
    assert board.make_command_line(DriveCommand(70.0, 25.0), False) == board_line(
        "T1,1,0.000,25.000,0"
    )
    assert board.make_command_line(None, True) == board_line("T1,2,0.000,25.000,0")


def test_commands_are_cut_to_the_limits(board_line):
    board = SlaveBoard(SetPointLimits(max_shaft_rpm=80.0, max_opening_mm=50.0))
    assert board.make_command_line(DriveCommand(1e9, 1e9), True) == board_line(
        "T1,0,80.000,50.000,1"
    )
    assert board.make_command_line(DriveCommand(-5.0, -5.0), True) == board_line(
        "T1,1,0.000,0.000,1"
    )


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("enabled", [True, False])
def test_no_command_that_is_not_finite(bad, enabled):
    for command in (DriveCommand(bad, 25.0), DriveCommand(70.0, bad)):
        with pytest.raises(ValueError, match="finite"):
            SlaveBoard().make_command_line(command, enabled)
    with pytest.raises(ValueError, match="allowed is 0 to 300"):
        encode_command(CommandFrame(0, bad, 25.0, True))


def test_the_examples_on_the_protocol_page_are_real_frames(board_line):
    page = (Path(__file__).parents[2] / "docs" / "protocol-slave-board.md").read_text()
    examples = re.findall(r"\$((?:T1|S1),[^*`]+)\*([0-9A-F]{4})`", page)
    assert len(examples) == 2
    for payload, crc in examples:
        assert board_line(payload).endswith(f"*{crc}\r\n".encode())
    assert len(SlaveBoard().feed(board_line(examples[1][0]), 0.0)) == 1


def test_valves_of_sections_go_in_a_frame_of_their_own_and_close_with_the_drives() -> None:
    host, board = SlaveBoard(), VirtualBoard(25.0)
    board.feed_commands(host.make_command_line(None, False), 0.0)
    line = host.make_command_line(DriveCommand(70.0, 25.0, valves=(True, False, True)), True)
    assert line.startswith(b"$T2,1,70.000,25.000,1,5*")
    board.feed_commands(line, 0.1)
    command, enabled = board.find_set_points(0.1)
    assert enabled and command.valves[:4] == (True, False, True, False)
    assert not any(board.find_set_points(1.2)[0].valves), "the host is silent"
    assert host.make_command_line(None, False).startswith(b"$T2,2,0.000,25.000,0,0*")
    assert SlaveBoard().make_command_line(DriveCommand(70.0, 25.0), True).startswith(b"$T1,")
    open_valves = DriveCommand(70.0, 25.0, valves=(True, True))
    assert SlaveBoard().make_command_line(open_valves, False).startswith(b"$T2,0,0.000,25.000,0,0*")


def test_a_board_that_does_not_answer_is_no_longer_asked_for_its_word(board_line) -> None:
    host = SlaveBoard()
    host.feed(board_line("W1,1,12345"), 0.0)
    host.forget_board()
    lines = [
        host.make_command_line(DriveCommand(70.0, 25.0), True) for _ in range(MAX_WORD_REQUESTS + 5)
    ]
    assert [line.startswith(WORD_REQUEST) for line in lines] == [True] * MAX_WORD_REQUESTS + [
        False
    ] * 5
    assert b",12345*" in lines[0] and b"12345" not in lines[-1]


def test_a_machine_that_is_recorded_only_gets_no_byte(clock) -> None:
    host, end = make_memory_pair("board", clock)
    config = CabConfig.model_validate({"board": {"port": "b"}, "record_only": True})
    cab = Cab(config, clock, lambda *_: host)
    cab.read_measurements(0.0)
    cab.send_command(0.0, DriveCommand(70.0, 25.0), True)
    assert cab.give_dose(0.0, 120.0, 60.0) is None
    cab.request_turned()
    assert end.read() == b""


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        ("T2,5,70.0,25.0,1", "wrong_length"),
        ("T2,5,70.0,25.0,1,65536", "out_of_range"),
        ("T2,5,70.0,25.0,1,x", "not_a_number"),
        ("T1,5,70.0,25.0,1,3", "wrong_length"),
    ],
)
def test_a_wrong_command_with_valves_changes_nothing(payload: str, kind: str) -> None:
    board = VirtualBoard(25.0)
    board.feed_commands(seal_frame(payload), 0.0)
    assert board.counts.rejected == {kind: 1} and board.find_set_points(0.0)[0].valves == ()


# --- Doses from the loop's command over the cab's bytes to the virtual board, and its reports
# back -------------------

DOSE = DoseOrder(120.0, 99.8)
STANDING = DriveCommand(0.0, 25.0)


class Bench:
    """A cab and a virtual board on one line, stepped together every 50 ms."""

    def __init__(self, clock) -> None:
        host, self.end = make_memory_pair("board", clock)
        self.cab = Cab(CabConfig.model_validate({"board": {"port": "b"}}), clock, lambda *_: host)
        self.board = VirtualBoard(25.0)
        self.clock = clock
        self.begun: list[DoseOrder] = []
        self.orders: dict[int, DriveCommand] = {}

    def run(
        self, ticks: int, enabled: bool = True, doses: dict[int, DoseOrder] | None = None
    ) -> None:
        for tick in range(ticks):
            now_s = self.clock.now_s
            self.cab.read_measurements(now_s)
            self.cab.send_command(now_s, STANDING._replace(dose=(doses or {}).get(tick)), enabled)
            self.board.feed_commands(self.end.read(), now_s)
            begins = self.board.take_dose(now_s)
            self.begun += [] if begins is None else [begins]
            self.end.write(self.board.make_status(sensed(now_s), now_s))
            self.clock.now_s += 0.05


def sensed(now_s: float):
    return SensorReadings(now_s, None, 0.0, 0, None, 0.0, 25.0, 100.0, 13.5, 0.0, 0.0, None)


@pytest.fixture
def bench(clock) -> Bench:
    made = Bench(clock)
    made.run(2, enabled=False)
    made.run(2)
    return made


def test_a_commanded_dose_reaches_the_board_once_and_is_reported_done(bench):
    bench.run(10, doses={0: DOSE})
    assert bench.begun == [DOSE]
    dose = bench.cab.find_newest_dose
    assert dose is not None and dose.state is DoseState.DONE and dose.turned_deg == 120.0
    assert dose.took_s == pytest.approx(0.2004, abs=1e-3)
    assert not bench.board.counts.rejected


def test_a_dose_that_comes_too_soon_waits_for_the_one_before_or_is_dropped_and_counted(bench):
    bench.run(12, doses={0: DOSE, 4: DOSE})
    assert len(bench.begun) == 2 and bench.cab.dropped_doses == 0
    bench.run(12, doses={0: DOSE, 1: DOSE})
    assert len(bench.begun) == 3 and bench.cab.dropped_doses == 1


def test_a_stop_ends_the_dose_and_one_that_waits(bench):
    bench.run(5, doses={0: DoseOrder(720.0, 99.8), 4: DOSE})
    bench.run(3, enabled=False)
    dose = bench.cab.find_newest_dose
    assert dose is not None and dose.state is DoseState.ABORTED and 60.0 < dose.turned_deg < 250.0
    bench.run(10)
    assert len(bench.begun) == 1, "nothing is given by itself afterwards"
    bench.run(1, enabled=False, doses={0: DOSE})
    assert len(bench.begun) == 1


def test_a_board_asked_too_much_refuses(bench):
    word = bench.board.word
    bench.board.feed_commands(seal_frame(f"D3,900,1,720.000,99.800,{word}"), bench.clock.now_s)
    bench.board.feed_commands(seal_frame(f"D3,901,2,120.000,99.800,{word}"), bench.clock.now_s)
    assert b"E1," in bench.board.make_status(sensed(bench.clock.now_s), bench.clock.now_s)
    assert b",2,3,0.000," in bench.board.make_status(sensed(bench.clock.now_s), bench.clock.now_s)
    bench.board.feed_commands(seal_frame(f"D3,901,2,120.000,99.800,{word}"), bench.clock.now_s)
    assert bench.board.counts.rejected["repeated_sequence"] == 1


def test_a_dose_of_another_session_is_not_given_and_stops_the_board(bench):
    bench.board.feed_commands(seal_frame("D1,900,1,720.000,99.800"), bench.clock.now_s)
    assert (
        bench.board.counts.rejected["old_order"] == 1
        and not bench.board.find_set_points(bench.clock.now_s)[1]
    )
    bench.run(3)
    assert bench.begun == [] and bench.cab.read_measurements(bench.clock.now_s).old_orders
