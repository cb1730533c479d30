"""`topdress calibrate encoder` on the virtual machine's board: real bytes on a pseudo-terminal, keys on another."""
from __future__ import annotations

import contextlib
import os
import re
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from console.cli import app
from control.calibration.encoder_fit import fit_counts
from drivers.virtual.board import TRUE_COUNTS_PER_TURN
from tests.command import TOPDRESS, serving
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on this system")


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """The standing virtual machine's board on a pseudo-terminal."""
    with contextlib.ExitStack() as started:
        yield lambda *options, before="": started.enter_context(serving(
            "--lag-rig", "--pty", str(tmp_path / "pty"), *options, before=before))["board"][1]


class Person:
    """Runs the command on a terminal: reads it, presses its keys."""

    def __init__(self, *words: str) -> None:
        self._terminal, slave = os.openpty()
        self._read = ""
        self.command = subprocess.Popen([*TOPDRESS, "calibrate", "encoder", *words], stdin=slave, stdout=slave,
                                        stderr=slave)
        os.close(slave)

    def screen(self) -> str:
        while select.select([self._terminal], [], [], 0.0)[0]:
            try:
                self._read += os.read(self._terminal, 4096).decode()
            except OSError:             # the command has ended
                break
        return self._read.replace("\r\n    ", " ")         # long lines are folded

    def sees(self, words: str) -> None:
        wait_for(lambda: words in self.screen())

    def press(self, key: str) -> None:
        os.write(self._terminal, key.encode())

    def counts(self) -> int:
        """Since the mark, as the newest line shows them."""
        shown = re.findall(r"([+-]\d+) counts", self.screen())
        return int(shown[-1]) if shown else 0

    def ends(self) -> int:
        wait_for(lambda: (self.screen(), self.command.poll())[1] is not None)
        return self.command.wait()


def test_turned_by_hand_the_counts_become_a_line_of_the_boards_settings(board, tmp_path):
    """Somebody turns the shaft by 7 turns: 6 s at 70 r/min, which no command asked for."""
    out, began_s = tmp_path / "board_settings.py", time.monotonic()
    served = board("--fault", "shaft_turns:board@20+6")
    person = Person("--board", served, "--turns", "7", "--repeats", "1", "--out", str(out))
    person.sees("set a mark on the shaft to a pointer, then Enter")
    time.sleep(0.5)
    person.press("\n")
    person.sees("run 1 of 1: 7 whole turns forwards, by hand")
    if time.monotonic() - began_s > 19.0:
        pytest.skip("too slow a computer for this time line: nothing is proven")
    wait_for(lambda: person.counts() > 6.9 * TRUE_COUNTS_PER_TURN, 60.0)
    time.sleep(1.5)
    person.press("\n")
    assert person.ends() == 0, person.screen()
    value, low, high = map(float, re.findall(r"[\d.]+", out.read_text().split("\n")[1].replace("90 %", ""))[:3])
    assert low < TRUE_COUNTS_PER_TURN < high and value == pytest.approx(TRUE_COUNTS_PER_TURN, rel=2e-3)
    assert f"counts_per_turn  {value:.2f} (90 %: {low:.2f} to {high:.2f}); the board takes 2400, +2" in person.screen()


def test_by_the_drive_it_turns_only_while_the_space_bar_is_held(board, tmp_path):
    out, turns = tmp_path / "board_settings.py", 3
    person = Person("--board", board(), "--turns", str(turns), "--repeats", "1", "--rpm", "20", "--out", str(out))
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
        time.sleep(0.03)
        return person.counts() > (turns - 0.25) * TRUE_COUNTS_PER_TURN
    wait_for(there, 60.0)
    person.press("\n")
    person.sees("the shaft still turns: Enter when it stands")
    time.sleep(1.5)
    stands = person.counts()
    time.sleep(0.5)
    assert person.counts() == stands, "released: it stands"
    for _ in range(2):
        person.press(" ")
        time.sleep(0.1)
    time.sleep(2.0)
    crept = person.counts() - stands
    assert 0 < crept < TRUE_COUNTS_PER_TURN / 10.0, "a short press creeps to the mark"
    person.press("\n")
    assert person.ends() == 0, person.screen()
    assert f"counts_per_turn = {(stands + crept) / turns:.2f}" in out.read_text()


OLDER = "from drivers.board import slave; slave.FIELDS.pop(b'A2')\n"
NO_ENCODER = """from drivers.board.slave import BoardSettings
BoardSettings.shaft_drive, BoardSettings.counts_per_turn = "stepper", 0.0
"""


@pytest.mark.parametrize(("before", "words", "said"), [
    pytest.param("", ["--board", "{board}", "--out", "x.yaml"], "x.yaml: allowed is a name that ends in .py",
                 id="an ending"),
    pytest.param("", ["--board", "{board}", "--turns", "0", "--out", "x.py"], "Invalid value for '--turns'", id="turn"),
    pytest.param(OLDER, ["--board", "{board}", "--out", "x.py"],
                 "does not say how far its shaft turned: its program is older than this", id="an older board"),
    pytest.param(NO_ENCODER, ["--board", "{board}", "--out", "x.py"], "this board has no encoder", id="no encoder"),
    pytest.param("", ["--board", "{board}", "--rpm", "3", "--out", "x.py"], "--rpm 3: allowed is 10 to", id="too slow"),
    pytest.param("", ["--board", "socket://127.0.0.1:9", "--out", "x.py"], "is silent", id="silent")])
def test_what_cannot_be_is_one_line_and_writes_nothing(board, tmp_path, before, words, said):
    served = board(before=before)
    person = Person(*(word.format(board=served) for word in words[:-1]), str(tmp_path / words[-1]))
    assert person.ends() == 2 and said in person.screen(), person.screen()
    assert not list(tmp_path.glob("x.*"))


def test_without_a_keyboard_nothing_is_counted(tmp_path):
    result = CliRunner().invoke(app, ["calibrate", "encoder", "--board", "x", "--out", str(tmp_path / "x.py")])
    assert result.exit_code == 2 and "there is no keyboard here" in result.output
    assert len(result.output.splitlines()) == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize(("counts", "turns", "value", "half"), [
    pytest.param([12000], 10, 1200.0, 1.41, id="one run: as well as a mark is set"),
    pytest.param([12000, 12000, 12000], 10, 1200.0, 0.07, id="no scatter: as well as whole counts are"),
    pytest.param([11990, 12000, 12010], 10, 1200.0, 1.69, id="by the scatter")])
def test_the_interval(counts, turns, value, half):
    fit = fit_counts(counts, turns)
    assert (fit.value, fit.high - fit.value, fit.value - fit.low) == pytest.approx((value, half, half), abs=0.01)


@pytest.mark.parametrize(("counts", "said"), [
    ([12000, 0], "run 2: not one count"), ([-12000], "run 1: -12000 counts: the shaft turned backwards, or A and B"),
    ([12000, 13200, 12003], "1.0 turns apart: one was miscounted")])
def test_runs_that_cannot_be(counts, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        fit_counts(counts, 10)
