"""Doses from the host's driver to the board's program and back: angle, steps, time, and what is lost on the way."""
from __future__ import annotations

import math

import pytest

from control.readings import DriveCommand
from drivers.board.slave import BoardSettings, Slave
from drivers.devices.point_dose import DoseState, PointDose, decode_report, encode_dose
from drivers.devices.slave_board import SetPointLimits, SlaveBoard


class Bench:
    """Host and board joined by two lists of bytes; ticks of a millisecond, a heartbeat every 50."""

    def __init__(self, scenarios) -> None:
        self.pins = scenarios.Machine()
        self.settings = BoardSettings()
        self.board = Slave(self.pins, self.settings)
        self.host = SlaveBoard(SetPointLimits(max_shaft_rpm=201.0))
        self.ms = 0
        self.deaf = False               # the host hears nothing
        self.enable = False

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.ms += 1
            if self.ms % 50 == 0:
                self.pins.inbox += self.host.command(DriveCommand(0.0, 25.0), self.enable)
            self.pins.pass_time(1000)
            self.board.tick(self.pins.now_us)
            said, self.pins.sent = b"".join(self.pins.sent), []
            if not self.deaf:
                self.host.feed(said, self.ms / 1000.0)
            self.host.dose.look(self.ms / 1000.0)

    def give(self, angle_deg: float, shaft_rpm: float) -> None:
        self.pins.inbox += self.host.give_dose(angle_deg, shaft_rpm, self.ms / 1000.0)


@pytest.fixture
def bench(scenarios) -> Bench:
    made = Bench(scenarios)
    made.run(100)
    made.enable = True
    made.run(100)
    return made


def test_the_papers_dose_takes_a_fifth_of_a_second(bench):
    """120 degrees at 99.8 r/min: theta / (6 n) = 0.2 s (eq 3 with its factor 6), and two short ramps."""
    bench.give(120.0, 99.8)
    assert bench.host.dose.newest.state is DoseState.SENT and not bench.host.dose.ready
    bench.run(400)
    dose = bench.host.dose.newest
    assert dose.state is DoseState.DONE and bench.host.dose.ready
    assert dose.turned_deg == pytest.approx(120.0, abs=0.9), "to a step of 0.9 degrees"
    assert dose.took_s == pytest.approx(120.0 / (6.0 * 99.8), abs=0.06)
    assert not bench.host.counts.rejected and bench.host.missed == 0


def test_pulses_are_the_angle_over_a_row_of_plants(bench):
    for _ in range(30):
        bench.give(120.0, 99.8)
        bench.run(300)
        assert bench.host.dose.newest.state is DoseState.DONE
    assert bench.pins.dose_count == 30 * 120 * 400 // 360 == 4000


@pytest.mark.parametrize("rpm", [50.0, 99.8, 201.0])
def test_the_papers_range_of_speeds(bench, rpm):
    bench.settings.max_shaft_rpm = 201.0
    bench.give(360.0, rpm)
    bench.run(int(360.0 / (6.0 * rpm) * 1000.0) + 400)
    dose = bench.host.dose.newest
    assert dose.state is DoseState.DONE and bench.pins.dose_count == 400
    assert dose.took_s == pytest.approx(360.0 / (6.0 * rpm), abs=0.12)


def test_a_second_dose_waits_for_the_first(bench):
    bench.give(120.0, 99.8)
    with pytest.raises(ValueError, match="still under way"):
        bench.give(120.0, 99.8)


def test_a_stop_ends_the_dose_and_tells_how_far_it_came(bench):
    bench.give(360.0, 60.0)
    bench.run(300)
    bench.enable = False
    bench.run(200)
    dose = bench.host.dose.newest
    assert dose.state is DoseState.ABORTED
    assert 20.0 < dose.turned_deg < 150.0
    count = bench.pins.dose_count
    bench.run(500)
    assert bench.pins.dose_count == count
    bench.give(120.0, 99.8)
    bench.run(200)
    assert bench.host.dose.newest.state is DoseState.REFUSED and bench.pins.dose_count == count


def test_a_dose_whose_answer_is_lost_is_told_and_never_repeated(bench):
    bench.give(120.0, 99.8)
    bench.deaf = True
    bench.run(600)
    assert bench.host.dose.newest.state is DoseState.LOST
    bench.deaf = False
    bench.run(200)
    assert bench.pins.dose_count == 133


def test_one_lost_line_loses_no_report(bench):
    """What became of a dose is said again for 0.3 s."""
    bench.give(120.0, 99.8)
    bench.run(20)
    bench.deaf = True
    bench.run(260)
    bench.deaf = False
    bench.run(100)
    assert bench.host.dose.newest.state is DoseState.DONE


def test_the_same_line_twice_is_one_dose(bench):
    line = bench.host.give_dose(120.0, 99.8, bench.ms / 1000.0)
    bench.pins.inbox += line + line
    bench.run(400)
    bench.pins.inbox += line
    bench.run(400)
    assert bench.pins.dose_count == 133
    assert bench.board.receiver.rejected == {"repeated_sequence": 2}


@pytest.mark.parametrize(("angle_deg", "rpm"), [(math.nan, 60.0), (120.0, math.inf), (-1.0, 60.0), (4000.0, 60.0),
                                                (120.0, 0.5)])
def test_what_is_not_allowed_is_not_sent(angle_deg, rpm):
    with pytest.raises(ValueError, match="allowed is"):
        PointDose().give(angle_deg, rpm, 0, 0.0)


def test_the_frames_of_the_page():
    assert encode_dose(42, 7, 120.0, 99.8).startswith(b"$D1,42,7,120.000,99.800*")
    report = decode_report(encode_report("E1,8,7,2,120.600,1000000,1237000"))
    assert (report.dose, report.state, report.turned_deg) == (7, DoseState.DONE, 120.6)


def encode_report(payload: str) -> bytes:
    from drivers.board.framing import seal
    return seal(payload).strip()[1:]
