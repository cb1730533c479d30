"""`topdress calibrate encoder` on the virtual machine's board: real bytes on a pseudo-terminal,
keys on another."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from topdress.control.calibration.encoder_fit import fit_counts
from topdress.control.readings import DriveCommand
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.virtual.board import TRUE_COUNTS_PER_TURN
from topdress.drivers.virtual.served_machine import ServedMachine, ServeOptions

from tests.command import TOPDRESS, serving, topdress
from tests.drivers.conftest import FakePlant
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="no pseudo-terminals on this system"
)


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """The standing virtual machine's board on a pseudo-terminal."""
    with contextlib.ExitStack() as started:
        yield lambda *options, before="": started.enter_context(
            serving("--lag-rig", "--pty", str(tmp_path / "pty"), *options, before=before)
        )["board"][1]


class Person:
    """Runs the command on a terminal: reads it, presses its keys."""

    def __init__(self, *words: str) -> None:
        self._terminal, slave = os.openpty()
        self._read = ""
        self.command = subprocess.Popen(
            [*TOPDRESS, "calibrate", "encoder", *words], stdin=slave, stdout=slave, stderr=slave
        )
        os.close(slave)

    def screen(self) -> str:
        while select.select([self._terminal], [], [], 0.0)[0]:
            try:
                self._read += os.read(self._terminal, 4096).decode()
            except OSError:  # the command has ended
                break
        return self._read.replace("\r\n    ", " ")  # long lines are folded

    def sees(self, words: str) -> None:
        wait_for(lambda: words in self.screen())

    def press(self, key: str) -> None:
        os.write(self._terminal, key.encode())

    def counts(self) -> int:
        """Since the mark, as the newest line shows them."""
        time.sleep(0.03)  # whoever asks leaves the processor to who counts
        shown = re.findall(r"([+-]\d+) counts", self.screen()[-100:])
        return int(shown[-1]) if shown else 0

    def stands(self) -> int:
        """How far it is once it turns no more."""
        self.stood = -1
        while self.counts() != self.stood:
            self.stood = self.counts()
            time.sleep(1.0)
        return self.stood

    def closes(self) -> None:
        """The window, under a shell that does not pass the signal on."""
        os.close(self._terminal)

    def ends(self) -> int:
        wait_for(lambda: (self.screen(), self.command.poll())[1] is not None)
        return self.command.wait()


class Hand(FakePlant):
    """Somebody turns the shaft, a turn a second, for as long as `left` says."""

    left = 0

    def advance_plant(self, command: DriveCommand, enabled: bool) -> SensorReadings:
        sensed = super().advance_plant(command, enabled)
        if not self.left:
            return sensed._replace(shaft_rpm=0.0)
        self.left -= 1
        return sensed._replace(shaft_rpm=60.0)


@pytest.fixture
def standing(tmp_path: Path) -> Iterator[tuple[FakePlant, str]]:
    """A machine that stands, its shaft as commanded, and its board on a pseudo-terminal."""
    plant = FakePlant()
    plant.speed_mps = 0.0
    with served_board(plant, tmp_path) as board:
        yield plant, board


@contextlib.contextmanager
def served_board(plant: FakePlant, folder: Path) -> Iterator[str]:
    stop = threading.Event()
    served = ServedMachine(
        plant, ServeOptions(first_port=0, terminals=folder / "pty"), time.monotonic
    )

    def serve() -> None:
        while not stop.wait(0.01):
            served.advance_plant()

    thread = threading.Thread(target=serve)
    thread.start()
    yield str(folder / "pty" / "board")
    stop.set()
    thread.join()
    served.close()


@pytest.fixture
def by_hand(tmp_path: Path) -> Iterator[tuple[Hand, str]]:
    """And the board on a pseudo-terminal that sees it."""
    hand = Hand()
    with served_board(hand, tmp_path) as board:
        yield hand, board


def test_turned_by_hand_the_counts_become_a_line_of_the_boards_settings(by_hand, tmp_path):
    out, (hand, board) = tmp_path / "board_settings.py", by_hand
    person = Person("--board", board, "--turns", "7", "--repeats", "1", "--out", str(out))
    person.sees("set a mark on the shaft to a pointer, then Enter")
    time.sleep(0.5)
    person.press("\n")
    person.sees("run 1 of 1: 7 whole turns forwards, by hand")
    hand.left = round(7.0 / hand.dt_s)
    wait_for(lambda: person.counts() == 7 * TRUE_COUNTS_PER_TURN, 60.0)
    time.sleep(0.5)
    person.press("\n")
    assert person.ends() == 0, person.screen()
    assert not any(enabled for _, enabled in hand.commands), "nothing that turns was sent"
    assert out.read_text().endswith("\ncounts_per_turn = 2000.00     # 90 %: 1996.63 to 2003.37\n")
    said = "counts_per_turn  2000.00 (90 %: 1996.63 to 2003.37); the board takes 2400, +20.00 %"
    assert said in person.screen()


@pytest.mark.exam
def test_by_the_drive_it_turns_only_while_the_space_bar_is_held(board, tmp_path):
    out, turns = tmp_path / "board_settings.py", 3
    person = Person(
        "--board",
        board(),
        "--turns",
        str(turns),
        "--repeats",
        "1",
        "--rpm",
        "20",
        "--out",
        str(out),
    )
    person.sees("then Enter")
    time.sleep(1.5)
    person.press("\n")
    person.sees("run 1 of 1: 3 whole turns forwards, the space bar held down")
    time.sleep(1.0)
    assert person.counts() == 0, "not without the operator's key"
    person.press(" ")
    time.sleep(1.5)
    assert person.counts() == 0, "a stray press turns nothing"

    def there() -> bool:
        person.press(" ")
        return person.counts() > (turns - 0.25) * TRUE_COUNTS_PER_TURN

    wait_for(there, 60.0)
    person.press("\n")
    person.sees("the shaft still turns: Enter when it stands")
    stood = person.stands()

    def creeps() -> bool:
        for _ in range(2):
            person.press(" ")
            time.sleep(0.1)
        return person.stands() > stood

    wait_for(creeps)
    assert person.counts() - stood < TRUE_COUNTS_PER_TURN / 8.0, "a short press creeps to the mark"
    person.press("\n")
    assert person.ends() == 0, person.screen()
    assert f"counts_per_turn = {person.stood / turns:.2f}" in out.read_text()


@pytest.mark.parametrize("way", ["SIGTERM", "SIGHUP", "SIGINT", "its window is closed"])
def test_however_it_ends_the_shaft_is_stopped_by_a_command(standing, tmp_path, way):
    """The board's own second ended it: the shaft crept on meanwhile."""
    plant, board = standing
    person = Person("--board", board, "--rpm", "20", "--out", str(tmp_path / "x.py"))
    person.sees("then Enter")

    def turns() -> bool:
        person.press(" ")
        return plant.commands[-1][1] and plant.commands[-1][0].shaft_rpm > 0.0

    wait_for(turns)
    if way.startswith("SIG"):
        person.command.send_signal(getattr(signal, way))
    else:
        person.closes()
    began_s = time.monotonic()
    wait_for(lambda: not plant.commands[-1][1] or plant.commands[-1][0].shaft_rpm == 0.0)
    assert time.monotonic() - began_s < 0.5, "not by the board's own second"
    assert person.command.wait(10.0) == 130
    assert not list(tmp_path.glob("x.*"))


OLDER = "from topdress.drivers.board import slave; slave.FRAME_FIELDS.pop(b'A2')\n"
NO_ENCODER = """from topdress.drivers.board.slave import BoardSettings
BoardSettings.shaft_drive, BoardSettings.counts_per_turn = "stepper", 0.0
"""


@pytest.mark.parametrize(
    ("before", "words", "said"),
    [
        pytest.param(
            "",
            ["--board", "x", "--out", "x.yaml"],
            "x.yaml: allowed is a name that ends in .py",
            id="an ending",
        ),
        pytest.param(
            "",
            ["--board", "x", "--turns", "0", "--out", "x.py"],
            "Invalid value for '--turns'",
            id="turn",
        ),
        pytest.param(
            OLDER,
            ["--board", "{board}", "--out", "x.py"],
            "does not say how far its shaft turned: its program is older than this",
            id="an older board",
        ),
        pytest.param(
            NO_ENCODER,
            ["--board", "{board}", "--out", "x.py"],
            "this board has no encoder",
            id="no encoder",
        ),
        pytest.param(
            "",
            ["--board", "{board}", "--rpm", "3", "--out", "x.py"],
            "--rpm 3: allowed is 10 to",
            id="too slow",
        ),
        pytest.param(
            "", ["--board", "socket://127.0.0.1:9", "--out", "x.py"], "is silent", id="silent"
        ),
    ],
)
def test_what_cannot_be_is_one_line_and_writes_nothing(board, tmp_path, before, words, said):
    served = board(before=before) if "{board}" in words else ""
    person = Person(*(word.format(board=served) for word in words[:-1]), str(tmp_path / words[-1]))
    assert person.ends() == 2 and said in person.screen(), person.screen()
    assert not list(tmp_path.glob("x.*"))


def test_without_a_keyboard_nothing_is_counted(tmp_path):
    result = topdress("calibrate", "encoder", "--board", "x", "--out", tmp_path / "x.py")
    assert result.exit_code == 2 and "there is no keyboard here" in result.output
    assert len(result.output.splitlines()) == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("counts", "turns", "value", "half"),
    [
        pytest.param([12000], 10, 1200.0, 1.41, id="one run: as well as a mark is set"),
        pytest.param(
            [12000, 12000, 12000], 10, 1200.0, 0.07, id="no scatter: as well as whole counts are"
        ),
        pytest.param([11990, 12000, 12010], 10, 1200.0, 1.69, id="by the scatter"),
    ],
)
def test_the_interval(counts, turns, value, half):
    fit = fit_counts(counts, turns)
    assert (fit.value, fit.high - fit.value, fit.value - fit.low) == pytest.approx(
        (value, half, half), abs=0.01
    )


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        ([12000, 0], "run 2: not one count"),
        ([-12000], "run 1: -12000 counts: the shaft turned backwards, or A and B"),
        ([12000, 13200, 12003], "1.0 turns apart: one was miscounted"),
    ],
)
def test_runs_that_cannot_be(counts, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        fit_counts(counts, 10)
