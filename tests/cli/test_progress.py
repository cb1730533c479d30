"""One line of progress that rewrites itself on a terminal, and nothing elsewhere."""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from topdress.console.cli.plain_output import LINE_START, RED_CODE, PlainOutput
from topdress.console.cli.progress import iterate_with_progress


class Terminal(io.BytesIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[[], Terminal]:
    """Called in the test: stderr as a command has it on a terminal of 40 columns."""
    raw = Terminal()
    shown = PlainOutput(raw, encoding="utf-8", write_through=True)
    shown.complains = True

    def taken() -> Terminal:
        monkeypatch.setattr(sys, "stderr", shown)
        monkeypatch.setenv("COLUMNS", "40")
        monkeypatch.delenv("NO_COLOR", raising=False)
        monkeypatch.setenv("TERM", "xterm")
        return raw

    return taken


def steps(count: int, label: str = "simulating a long and winding field") -> None:
    times = iter(0.3 * k for k in range(10 * count))
    for _ in iterate_with_progress(range(count), count, label, lambda: next(times)):
        pass


def test_the_line_rewrites_itself_and_stays_one_row(terminal: Callable[[], Terminal]) -> None:
    raw = terminal()
    steps(20)
    said = raw.getvalue().decode()
    assert "\n" not in said and RED_CODE not in said
    pieces = said.split(LINE_START)
    assert pieces[0] == "" and pieces[-1] == "" and len(pieces) == 23
    assert all(len(piece) < 40 for piece in pieces), "a row that is too long would stay behind"


def test_it_tells_how_far_it_is_and_what_is_left(terminal: Callable[[], Terminal]) -> None:
    raw = terminal()
    steps(4, "papers")
    told = [piece.partition(" (")[0] for piece in raw.getvalue().decode().split(LINE_START)[1:-1]]
    assert told == [
        "papers 0 %",
        "papers 25 %, 1 s left",
        "papers 50 %, 1 s left",
        "papers 75 %, 0 s left",
        "papers 100 %, 0 s left",
    ]


def test_a_complaint_takes_the_place_of_the_line(terminal: Callable[[], Terminal]) -> None:
    raw = terminal()
    with pytest.raises(ValueError):
        for number in iterate_with_progress(range(10), 10, "simulating"):
            if number == 3:
                raise ValueError
    print("run.csv: no such file", file=sys.stderr)
    said = raw.getvalue().decode()
    assert said.endswith(f"{RED_CODE}run.csv: no such file\x1b[0m\n")
    last = said.rpartition("(Ctrl-C cancels)")[2]
    assert last.startswith(LINE_START), "the words do not stand behind what was there"


def test_nothing_is_told_where_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = io.StringIO()
    monkeypatch.setattr(sys, "stderr", pipe)
    steps(5)
    assert pipe.getvalue() == ""


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_real_commands_on_a_real_terminal(tmp_path: Path) -> None:
    for command in (
        "simulate --seconds 30 --out {0}/run.csv",
        "replay {0}/run.csv --headless --out {0}/new.csv",
    ):
        said = on_a_terminal(command.format(tmp_path).split())
        assert LINE_START in said and "Ctrl-C cancels" in said and RED_CODE not in said
        assert not re.search(r"Ctrl-C cancels\)[^\r]*\n", said), (
            "no line of progress ends in a new one"
        )


def on_a_terminal(arguments: list[str]) -> str:
    import pty

    child, terminal = pty.fork()
    if child == 0:
        os.environ["TERM"] = "xterm"
        os.environ.pop("NO_COLOR", None)
        os.execv(
            sys.executable,
            [sys.executable, "-c", "from topdress.console.cli import main; main()", *arguments],
        )
    said = b""
    while True:
        try:
            got = os.read(terminal, 65_536)
        except OSError:  # Linux: the other end is closed
            break
        if not got:
            break
        said += got
    _pid, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0, said.decode(errors="replace")
    return said.decode(errors="replace")
