"""The live check beside the console: it says what it finds, and its death, slowness or noise
touches nobody."""

import errno
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.console.services import live_check
from topdress.console.services.live_check import follow_log
from topdress.console.services.live_checker import LiveChecker
from topdress.control.diagnosis.live import growing_log_check
from topdress.control.diagnosis.result import ModelDeviation
from topdress.drivers.files.growing_log import GrowingLog
from topdress.drivers.files.imports import text_table
from topdress.drivers.files.log_store import write_log_store

FOUND = ModelDeviation("flow", "flow.gain", -4.0, 600.0)


def program(tmp_path: Path, body: str) -> tuple[str, ...]:
    """A check that says what stands in `body`, in place of the real one."""
    file = tmp_path / "check.py"
    file.write_text("import json, os, sys, time\n" + body)
    return sys.executable, str(file)


def waited(ask: Any, want: Any, timeout_s: float = 30.0) -> Any:
    end = time.monotonic() + timeout_s
    while time.monotonic() < end and ask() != want:
        time.sleep(0.02)
    return ask()


def test_what_the_check_says_is_at_hand(tmp_path: Path) -> None:
    said = json.dumps({"departure": FOUND._asdict(), "at_s": 700.0})
    checker = LiveChecker(
        program(tmp_path, f"print('no json'); print({said!r}, flush=True); sys.stdin.read()\n")
    )
    assert waited(lambda: checker.find_departure("a.csv"), FOUND) == FOUND
    assert checker.find_departure("") is None  # no log any more: the process is ended
    checker.stop_check()


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no signals of this kind here")
def test_a_check_that_is_frozen_keeps_nobody_waiting_and_one_that_dies_is_started_again(
    tmp_path: Path,
) -> None:
    said = json.dumps({"departure": FOUND._asdict(), "at_s": 700.0})
    pid_file = tmp_path / "pid"
    checker = LiveChecker(
        program(
            tmp_path,
            f"open({str(pid_file)!r}, 'w').write(str(os.getpid()))\n"
            f"print({said!r}, flush=True); sys.stdin.read()\n",
        ),
        again_s=0.05,
    )
    assert waited(lambda: checker.find_departure("a.csv"), FOUND) == FOUND
    first = int(pid_file.read_text())
    os.kill(first, signal.SIGSTOP)
    begin = time.monotonic()
    for _ in range(1000):
        assert checker.find_departure("a.csv") == FOUND
    assert time.monotonic() - begin < 5.0
    os.kill(first, signal.SIGKILL)
    assert waited(lambda: pid_file.read_text() not in ("", str(first)), True)
    checker.stop_check()


def test_a_program_that_is_not_there_says_nothing() -> None:
    checker = LiveChecker(("/nowhere/at-all",), again_s=0.01)
    assert checker.find_departure("a.csv") is None
    checker.stop_check()


def test_the_real_one_ends_with_its_stdin(tmp_path: Path) -> None:
    child = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "topdress.console.services.live_check",
            str(tmp_path / "not-there.csv"),
        ],
        stdin=subprocess.PIPE,
        cwd=Path(__file__).parents[2],
    )
    assert child.stdin is not None
    child.stdin.close()
    assert child.wait(60) == 0


@pytest.fixture
def looks(
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[[Callable[[float], ModelDeviation | None]], None]:
    """Looks that find nothing, or at a time what a function says of it; they cost nothing."""

    def find(found: Callable[[float], ModelDeviation | None]) -> None:
        def look(self: growing_log_check.LiveCheck) -> ModelDeviation | None:
            self._looked_s = self.now_s
            return found(self.now_s)

        monkeypatch.setattr(growing_log_check.LiveCheck, "check_rows", look)

    find(lambda now_s: None)
    return find


HEADER = "time_s,speed_mps,wheel_speed_mps\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.csv"


def grow(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text)


def times(growing: GrowingLog) -> list[float]:
    """Of the new rows; none: []."""
    more = growing.read_new_rows()
    return [] if more is None else more["time_s"].tolist()


def rows(begin: int, end: int) -> str:
    return "".join(f"{0.1 * k:.1f},{1.3:.4f},{1.31:.4f}\n" for k in range(begin, end))


def test_a_growing_log_gives_whole_new_rows_only(path: Path) -> None:
    growing = GrowingLog(path)
    assert growing.read_new_rows() is None
    path.write_text(HEADER + rows(0, 5) + "0.5,1.2")
    assert times(growing) == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert growing.read_new_rows() is None
    grow(path, "00,1.25\n" + rows(6, 8))
    more = growing.read_new_rows()
    assert (
        more is not None
        and more["time_s"].tolist() == [0.5, 0.6, 0.7]
        and more["speed_mps"][0] == 1.2
    )
    path.write_text(HEADER + "0.0,1.0,1.0\n")  # another log in its place
    assert times(growing) == [0.0]


def test_another_log_in_its_place_is_read_from_its_beginning_however_long_it_is(
    path: Path, tmp_path: Path
) -> None:
    path.write_text(HEADER + rows(100, 110))
    growing, other = GrowingLog(path), tmp_path / "other.csv"
    growing.read_new_rows()
    other.write_text(HEADER + rows(0, 40))
    other.replace(path)  # rotated: longer than what was read
    assert times(growing) == pytest.approx([0.1 * k for k in range(40)])


def test_times_that_go_back_are_not_passed_over(path: Path) -> None:
    path.write_text(HEADER + rows(100, 110))
    growing = GrowingLog(path)
    growing.read_new_rows()
    grow(path, rows(0, 5))
    assert len(times(growing)) == 5


def test_a_full_disk_is_nothing_to_it(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path.write_text(HEADER + rows(0, 10))

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(tempfile, "TemporaryDirectory", full)
        assert len(times(GrowingLog(path))) == 10


@pytest.mark.usefixtures("looks")
def test_a_new_log_is_checked_from_its_beginning(path: Path, tmp_path: Path) -> None:
    other, replaced = tmp_path / "other.csv", list[bool]()
    path.write_text(HEADER + rows(0, 6000))
    other.write_text(HEADER + rows(0, 4000))

    def wait() -> bool:
        if not replaced:
            other.replace(path)
        replaced.append(True)
        return len(replaced) < 3

    looked = [look.at_s for look in follow_log(path, "huanghai", wait)]
    assert len([at_s for at_s in looked if at_s < 400.0]) == 6  # three of each log
    assert looked[-1] < 400.0


def test_a_clock_that_jumps_far_ahead_costs_nothing() -> None:
    time_s = np.concatenate((np.arange(0.0, 100.0, 0.1), [1e6, 1e6 + 0.1]))
    pieces = list(live_check._split_rows({"time_s": time_s}))
    assert len(pieces) == 5 and sum(len(piece["time_s"]) for piece in pieces) == len(time_s)


def test_logs_of_other_programs_and_stores_are_followed_too(path: Path, tmp_path: Path) -> None:
    head = (
        (Path(__file__).parents[2] / "docs/examples/import/tractor.csv")
        .read_bytes()
        .splitlines(keepends=True)
    )
    path.write_bytes(b"".join(head[:101]))
    growing = GrowingLog(path)
    first = times(growing)
    path.write_bytes(b"".join(head[:201]))
    more = times(growing)
    assert first and more and len(first) + len(more) == 200
    write_log_store(tmp_path / "run.parquet", {"time_s": np.arange(3.0)}, None)
    assert times(GrowingLog(tmp_path / "run.parquet")) == [0.0, 1.0, 2.0]


@pytest.mark.usefixtures("looks")
def test_rows_at_once_are_gone_through_as_they_would_have_come(path: Path) -> None:
    path.write_text(HEADER + rows(0, 6000))
    looked = [look.at_s for look in follow_log(path, "huanghai", lambda: False)]
    assert len(looked) == 10 and looked[0] == pytest.approx(300.0, abs=30.1)
    assert live_check.load_log_machine(path, None).id == "huanghai"


def test_what_departed_before_it_was_started_is_not_said_as_if_it_did_now(
    path: Path, looks: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """A console that is started again goes through the rows of the morning: only what stands
    now is said."""
    looks(lambda now_s: FOUND if now_s < 500.0 else None)

    def end(_: float) -> None:
        raise OSError("enough")

    path.write_text(HEADER + rows(0, 6300))
    live_check.run_live_check([str(path), "huanghai"], end)
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line.get("departure", "ended") for line in lines] == [None, "ended"]


def test_a_log_that_is_read_in_parts_is_behind_until_the_last(path: Path) -> None:
    path.write_text(HEADER + rows(0, 200))
    growing, behind, count = GrowingLog(path, most_bytes=2000), [], 0
    while more := times(growing):
        behind.append(growing.behind)
        count += len(more)
    assert count == 200 and behind[0] and not behind[-1]


def foreign(count: int, begin: int = 0) -> str:
    return "".join(
        "2026-05-01 "
        f"08:{k // 1200:02d}:{k // 20 % 60:02d}.{k % 20 * 50:03d};{5.0 + 0.1 * (k % 9):.2f};"
        f"{60 + k // 40 % 7};{60 + (k - 6) // 40 % 7 + 0.2 * (k % 3):.1f}\n"
        for k in range(begin, begin + count)
    )


FOREIGN_HEAD = "Time;Ground speed [km/h];Shaft speed set [1/min];Shaft speed actual [1/min]\n"


def test_of_a_foreign_log_only_the_new_lines_are_brought_in(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 20 Hz in steps of 5 s: rows as of the whole, each line read a few times and not at
    each look."""
    read_bytes, before = [0], text_table.read_text_table

    def counted(where: Path, said: Any) -> Any:
        read_bytes[0] += where.stat().st_size
        return before(where, said)

    monkeypatch.setattr(text_table, "read_text_table", counted)
    path.write_text(FOREIGN_HEAD)
    growing, found = GrowingLog(path), list[float]()
    assert growing.read_new_rows() is None  # a header alone: it is waited for rows
    for step in range(24):
        grow(path, foreign(100, 100 * step))
        found += times(growing)
    assert found == pytest.approx([0.05 * k for k in range(2400)])
    assert read_bytes[0] < 6.0 * path.stat().st_size


@pytest.mark.parametrize("kind", ["own", "foreign"])
@pytest.mark.parametrize("bad", ['\0\0\x01\xff;,;"\n', "0.45,abc,,,\n", ";;;;;;;;;;;;;\n"])
def test_a_damaged_line_is_left_out_and_counted(path: Path, kind: str, bad: str) -> None:
    def some(begin: int, end: int) -> str:
        return rows(begin, end) if kind == "own" else foreign(end - begin, begin)

    path.write_text((HEADER if kind == "own" else FOREIGN_HEAD) + some(0, 200))
    growing = GrowingLog(path)
    seen = len(times(growing))
    with path.open("ab") as file:
        file.write(some(200, 240).encode() + bad.encode("latin-1") + some(240, 300).encode())
    seen += len(times(growing))
    assert seen >= 299 and growing.damaged <= 1  # the reader itself may pass over one
    grow(path, some(300, 320))
    assert len(times(growing)) == 20


@pytest.mark.usefixtures("looks")
def test_a_log_that_no_longer_grows_is_said_once(path: Path) -> None:
    said, waits = list[str](), [0]
    path.write_text(HEADER + rows(0, 100))

    def wait() -> bool:
        waits[0] += 1
        if waits[0] == 30:
            grow(path, rows(100, 110))
        return waits[0] < 40

    list(follow_log(path, "huanghai", wait, said.append))
    assert [one.split(": ", 1)[1] for one in said] == [
        "no new row for 60 s: it no longer grows; still watched",
        "it grows again",
    ]


def test_a_foreign_log_is_followed_by_its_import_file(path: Path) -> None:
    path.with_name("import.yaml").write_text(
        "format: topdress-import/1\ntime: {column: t, counts: s}\ncolumns:\n"
        "  shaft_rpm_cmd: {from: S, unit: 1/min}\n"
        "  shaft_rpm: {from: I, unit: 1/min}\n"
    )
    lines = [f"{0.5 * k};{60 + k % 7};{60 + k % 5}\n" for k in range(120)]
    path.write_text("t;S;I\n" + "".join(lines[:100]))
    growing = GrowingLog(path)
    assert len(growing.read_new_rows()["shaft_rpm"]) == 100  # type: ignore[index, arg-type]
    grow(path, "".join(lines[100:]))
    assert times(growing) == [0.5 * k for k in range(100, 120)]
