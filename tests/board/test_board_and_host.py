"""The board's own program against the host's own driver: on a pseudo-terminal, and beside the
virtual board."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time

import pytest
from topdress.control.readings import DriveCommand
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.board.framing import seal_frame
from topdress.drivers.board.slave import BoardSettings, SlaveProgram
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.point_dose import (
    DoseState,
    PointDose,
    decode_dose_report,
    encode_dose,
)
from topdress.drivers.devices.slave_board import SetPointLimits, SlaveBoard
from topdress.drivers.virtual.board import VirtualBoard

from tests.board import board_scenarios as scenarios
from tests.board.conftest import ENABLE, SHAFT_STEP
from tests.command import topdress
from tests.waiting import wait_for

HOST = """
import sys, time
from topdress.control.readings import DriveCommand
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
cab = Cab(CabConfig.model_validate({"board": {"port": sys.argv[1]}}), time.monotonic)
begun_s = time.monotonic()
while True:
    now_s = time.monotonic()
    m = cab.read_measurements(now_s)
    cab.send_command(now_s, DriveCommand(60.0, 30.0), now_s - begun_s > 0.5)
    time.sleep(0.05)
"""


STEPPER = "shaft_drive = 'stepper'\ncounts_per_turn = 0.0\n"


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param("", id="a DC motor, UART"),
        pytest.param("link = 'usb'\n", id="a DC motor, USB"),
        pytest.param("link = 'usb'\n" + STEPPER, id="a stepper, USB"),
    ],
)
def test_the_real_driver_drives_the_real_program(plugged, settings):
    pico = plugged(settings)
    cab = Cab(CabConfig.model_validate({"board": {"port": pico.name}}), time.monotonic)
    begun_s = time.monotonic()

    def turned() -> bool:
        now_s = time.monotonic()
        m = cab.read_measurements(now_s)
        cab.send_command(now_s, DriveCommand(60.0, 30.0), now_s - begun_s > 0.5)
        time.sleep(0.03)
        return bool(
            m.shaft_rpm
            and abs(m.shaft_rpm.value - 60.0) < 3.0
            and abs(m.opening_mm.value - 30.0) < 0.1
        )

    try:
        wait_for(turned)
        assert cab.read_measurements(time.monotonic()).supply_v.value == pytest.approx(
            13.5, abs=0.01
        )
        wait_for(
            lambda: turned() and cab.read_measurements(time.monotonic()).wheel_speed_mps.value > 1.0
        )
        status = cab.list_device_status(time.monotonic())[0]
        assert status.rejected == 0 and status.rate_hz > 20.0
        assert cab.board.enabled and not cab.board.heartbeat_lost and pico.enabled
        assert bool(pico.levels(SHAFT_STEP)) == ("stepper" in settings)
        cab.send_command(time.monotonic(), None, False)
        wait_for(lambda: not pico.enabled, 0.5)
        time.sleep(0.2)
        assert not pico.moves_after(pico.levels(ENABLE)[-1][0]), "a stop: no step more"
    finally:
        cab.close_devices()


@pytest.mark.parametrize("settings", ["", STEPPER], ids=["dc", "stepper"])
def test_a_killed_host_means_a_stopped_machine_one_second_later(plugged, settings):
    pico = plugged(settings)
    host = subprocess.Popen([sys.executable, "-c", HOST, pico.name])
    try:
        wait_for(lambda: pico.enabled and pico.moves >= (100 if settings else 1))
        os.kill(host.pid, signal.SIGKILL)
        killed_s = time.monotonic()
        wait_for(lambda: not pico.enabled, 3.0)
        off_s = pico.levels(ENABLE)[-1][0]
        assert 0.9 < off_s - killed_s < 1.2, (
            "one second after the last frame, which was 50 ms old at most"
        )
        time.sleep(0.3)
        assert not pico.moves_after(off_s)
    finally:
        host.kill()
        host.wait()


def test_a_program_that_hangs_puts_out_no_step_more_and_is_reset_after_half_a_second(plugged):
    pico = plugged(STEPPER)
    host = subprocess.Popen([sys.executable, "-c", HOST, pico.name])
    try:
        wait_for(lambda: pico.enabled and pico.moves > 100)
        pico.process.send_signal(signal.SIGUSR1)
        assert pico.process.wait(5.0) == 3
        hung_s = pico.when("hangs")
        assert pico.when("reset") - hung_s < 0.6
        assert not pico.moves_after(hung_s)
    finally:
        host.kill()
        host.wait()


@pytest.mark.parametrize("settings", ["", "link = 'usb'\n"], ids=["uart", "usb"])
def test_topdress_devices_finds_the_board(plugged, settings):
    said = topdress("devices", plugged(settings).name, "--baud", "115200")
    assert said.exit_code == 0 and "slave-board/1 at 115200 Bd: " in said.output
    assert ", 0 rejected; last: $S1," in said.output


def test_settings_that_cannot_be_keep_the_board_off_and_are_named(plugged):
    pico = plugged("counts_per_tern = 1198.0\n")
    assert pico.process.wait(5.0) == 1
    assert "ValueError: counts_per_tern: no setting of this board" in pico.process.stderr.read()
    assert not pico.levels(*range(30))


def test_the_host_reads_of_lost_steps_and_of_homing():
    bench, host = scenarios.Bench(sensor=False, start_mm=12.0), SlaveBoard()
    bench.run(0.2, 0, 12, 0)
    bench.run(0.1, 50, 25, 1)
    assert host.feed(b"".join(bench.machine.sent), 0.0)[-1].homing
    bench = scenarios.Bench()
    bench.run(0.2, 0, 25, 0)
    bench.machine.loses_steps = True
    bench.run(1.5, 0, 40, 1)
    last = SlaveBoard().feed(b"".join(bench.machine.sent), 0.0)[-1]
    assert last.steps_lost and not last.homing


class Line:
    """The host's driver, with its worker's 20 ticks a second, on a line with a board that knows
    words or does not."""

    def __init__(self, words) -> None:
        self.words, self.host, self.now_s = list(words), SlaveBoard(), 0.0
        self.sent: list[bytes] = []
        self.switch_on()

    def switch_on(self) -> None:
        self.board = VirtualBoard(25.0, lambda: self.words.pop(0) if self.words else None)

    def run(self, ticks: int, enabled: bool, deaf: bool = False):
        for _ in range(ticks):
            self.now_s += 0.05
            line = self.host.make_command_line(DriveCommand(60.0, 25.0), enabled)
            self.sent.append(line)
            self.board.feed_commands(b"" if deaf else line, self.now_s)
            sensed = SensorReadings(
                self.now_s, None, 0.0, 0, None, 0.0, 25.0, 100.0, 13.5, 0.0, 0.0, None
            )
            readings = self.host.feed(self.board.make_status(sensed, self.now_s), self.now_s)
        return readings[-1]

    def again(self, lines) -> bool:
        """Whether the drives were enabled at any time while `lines` come again, two a tick."""
        turned = False
        for k in range(0, len(lines), 2):
            self.now_s += 0.05
            self.board.feed_commands(b"".join(lines[k : k + 2]), self.now_s)
            turned = turned or self.board.find_set_points(self.now_s)[1]
        return turned


@pytest.mark.parametrize("words", [[], [3, 4, 5, 6]])
def test_host_and_board_of_either_age_work_and_go_on_after_a_silence_and_a_restart(words):
    line = Line(words)
    line.run(5, False)
    assert line.run(5, True).enabled and not line.board.counts.rejected
    assert line.sent[-1].startswith(b"$T3" if words else b"$T1")
    line.run(25, True, deaf=True)
    assert not line.run(5, True).enabled, "not without an enable 0"
    line.run(5, False)
    assert line.run(5, True).enabled
    line.switch_on()
    line.host.forget_board()
    assert not line.run(5, True).enabled
    line.run(5, False)
    readings = line.run(5, True)
    assert readings.enabled and not readings.old_order
    line.host = SlaveBoard()
    assert not line.run(3, False).enabled
    line.run(25, False)
    assert line.run(5, True).enabled, "a console that was started again within a second"
    if words:
        assert not line.again(line.sent), "all that was ever said on this line"


def test_a_session_that_is_played_to_a_board_that_was_switched_on_again_turns_nothing():
    line = Line([3, 4])
    line.run(5, False)
    line.run(40, True)
    taped = [sent for sent in line.sent if sent.startswith(b"$T3")]
    line.switch_on()
    assert not line.again(taped)
    old = Line([])
    old.run(5, False)
    old.run(40, True)
    taped = list(old.sent)
    old.switch_on()
    assert old.again(taped), "a board without words cannot know: why there are words"


def test_an_older_board_in_place_of_a_newer_one_is_spoken_to_as_it_understands():
    line = Line([3])
    line.run(5, False)
    line.board = VirtualBoard(25.0, lambda: None)
    line.host.forget_board()
    line.run(25, False)
    assert line.run(5, True).enabled and line.sent[-1].startswith(b"$T1")


# --- Doses from the host's driver to the board's program and back: angle, steps, time, and what
# is lost on the way.


class Bench:
    """Host and board joined by two lists of bytes; ticks of a millisecond, a heartbeat every 50."""

    def __init__(self) -> None:
        self.pins = scenarios.Machine()
        self.settings = BoardSettings()
        self.board = SlaveProgram(self.pins, self.settings)
        self.host = SlaveBoard(SetPointLimits(max_shaft_rpm=201.0))
        self.ms = 0
        self.deaf = False  # the host hears nothing
        self.enable = False

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.ms += 1
            if self.ms % 50 == 0:
                self.pins.inbox += self.host.make_command_line(DriveCommand(0.0, 25.0), self.enable)
            self.pins.pass_time(1000)
            self.board.run_round(self.pins.now_us)
            said, self.pins.sent = b"".join(self.pins.sent), []
            if not self.deaf:
                self.host.feed(said, self.ms / 1000.0)
            self.host.dose.check_overdue(self.ms / 1000.0)

    def give(self, angle_deg: float, shaft_rpm: float) -> None:
        self.pins.inbox += self.host.give_dose(angle_deg, shaft_rpm, self.ms / 1000.0)


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.run(100)
    made.enable = True
    made.run(100)
    return made


def test_the_papers_dose_takes_a_fifth_of_a_second(bench):
    """120 degrees at 99.8 r/min: theta / (6 n) = 0.2 s (eq 3 with its factor 6), and two short
    ramps."""
    bench.give(120.0, 99.8)
    assert bench.host.dose.newest.state is DoseState.SENT and not bench.host.dose.is_ready
    bench.run(400)
    dose = bench.host.dose.newest
    assert dose.state is DoseState.DONE and bench.host.dose.is_ready
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


@pytest.mark.parametrize(
    ("angle_deg", "rpm"),
    [(math.nan, 60.0), (120.0, math.inf), (-1.0, 60.0), (4000.0, 60.0), (120.0, 0.5)],
)
def test_what_is_not_allowed_is_not_sent(angle_deg, rpm):
    with pytest.raises(ValueError, match="allowed is"):
        PointDose().give_dose(angle_deg, rpm, 0, 0.0)


def test_the_frames_of_the_page():
    assert encode_dose(42, 7, 120.0, 99.8).startswith(b"$D1,42,7,120.000,99.800*")
    report = decode_dose_report(seal_frame("E1,8,7,2,120.600,1000000,1237000").strip()[1:])
    assert (report.dose, report.state, report.turned_deg) == (7, DoseState.DONE, 120.6)
