"""Compiled code on disk: variants have files and symbols of their own, and a damaged folder never ends the program."""
from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from control.machine import compiled
from control.machine.gate import gate_step
from control.machine.kept_code import KeptCode, named_apart
from control.machine.over_log import filling
from control.machine.shaft import shaft_step

ROOT = Path(__file__).resolve().parents[2]
# Two variants of one source over the same types, each called; prints what both give.
PROGRAM = """
import json
import sys
import numpy as np
from control.machine import compiled
def made(factor):
    def run(values):
        out = np.empty(len(values))
        for k in range(len(values)):
            out[k] = factor * values[k]
        return out
    return compiled.compiled(run)
print([float(made(factor)(np.ones(2))[1]) for factor in json.loads(sys.argv[1])])
"""


def times(factor: float) -> Callable[..., Any]:
    def run(values):  # type: ignore[no-untyped-def]
        return factor * values[0]
    return run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    import numba
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    return tmp_path / "kept"


def kept(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def called(factor: float) -> tuple[float, bool]:
    """What it gives, and whether it came from the disk."""
    made = compiled.compiled(times(factor))
    answer = made(np.ones(1))
    return float(answer), bool(sum(made.stats.cache_hits.values()))


def test_variants_have_names_of_their_own() -> None:
    names = [named_apart(times(factor)).__qualname__ for factor in (2.0, 3.0)]
    assert len(set(names)) == 2 and all(name.isascii() and " " not in name for name in names)
    gate, shaft = (named_apart(filling(step, exact=True)).__qualname__ for step in (gate_step, shaft_step))
    assert gate != shaft and "gate_step" in gate


def test_what_is_damaged_is_compiled_anew(folder: Path) -> None:
    assert called(2.0) == (2.0, False) and called(3.0) == (3.0, False)
    assert called(2.0) == (2.0, True) and called(3.0) == (3.0, True)
    files = kept(folder)
    assert len(files) == 2
    whole = {path: path.read_bytes() for path in files}
    for spoilt in (lambda data: b"", lambda data: data[:len(data) // 2], lambda data: bytes(len(data)),
                   lambda data: b"garbage\n" * 99, lambda data: data[:-100] + bytes([data[-100] ^ 4]) + data[-99:],
                   lambda data: next(other for other in whole.values() if other != data)):
        for path, data in whole.items():
            path.write_bytes(spoilt(data))
        assert called(2.0) == (2.0, False) and called(3.0) == (3.0, False)
        assert called(2.0) == (2.0, True), "kept again"
        assert kept(folder) == files, "nothing else is left in the folder"


def test_without_a_folder_or_room_it_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")
    monkeypatch.setattr(Path, "write_bytes", full)
    assert called(5.0) == (5.0, False) and not kept(folder)

    def nowhere(*_: Any) -> None:
        raise RuntimeError("cannot cache function: no locator available")
    monkeypatch.setattr(KeptCode, "__init__", nowhere)
    assert called(6.0) == (6.0, False)


@pytest.mark.exam
def test_variants_that_two_processes_kept_live_together_in_a_third(tmp_path: Path) -> None:
    """Each is the first of its process: by numba's own cache both had one symbol."""
    env = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA")}
    env |= {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    for wanted in ("[2.0]", "[3.0]", "[2.0, 3.0]"):
        done = subprocess.run([sys.executable, str(program), wanted], env=env, capture_output=True, text=True,
                              timeout=300)
        assert done.returncode == 0 and done.stdout.strip() == wanted, done.stderr[-2000:]
    assert len(kept(tmp_path / "cache")) == 2


def test_a_number_that_changed_in_its_own_file_is_compiled_anew(tmp_path: Path, folder: Path) -> None:
    """A constant of a module stands in no bytecode: the kept code of before would go on with the old one."""
    file = tmp_path / "scaled.py"

    def answer(factor: float) -> float:
        file.write_text(f"FACTOR = {factor}\n\ndef run(values):\n    return FACTOR * values[0]\n")
        space: dict[str, Any] = {}
        exec(compile(file.read_text(), str(file), "exec"), space)
        return float(compiled.compiled(space["run"])(np.ones(1)))
    assert answer(2.0) == 2.0 and answer(3.0) == 3.0
