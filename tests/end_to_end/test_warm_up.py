"""What is compiled after installing is all that a first diagnosis would compile."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from topdress.console import warm_up

ROOT = Path(__file__).resolve().parents[2]


def test_the_tests_compile_the_model_first_and_the_console_needs_it_not() -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    needs = {
        goal: words.split() for goal, words in re.findall(r"^(run|test): (.*)$", text, re.MULTILINE)
    }
    assert "$(VENV)/.compiled" in needs["test"] and needs["run"] == ["$(VENV)/.program"]
    assert "-m topdress.console.warm_up" in text
    [behind, console] = re.search(r"^run: .*\n\t(.*)\n\t(.*)", text, re.MULTILINE).groups()  # type: ignore[union-attr]
    assert "$(VENV)/.compiled" in behind and behind.startswith("@nohup nice") and behind[-1] == "&"
    assert console == "$(BIN)/topdress"


def test_without_room_it_says_so_and_the_first_diagnosis_compiles(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(warm_up, "compile_packages", full)
    assert warm_up.run_warm_up() == 1
    said = capsys.readouterr()
    assert "once" in said.out and "No space left on device; the first diagnosis does it" in said.err
    assert said.err.count("\n") == 1


@pytest.mark.exam
def test_a_first_diagnosis_then_compiles_nothing(tmp_path: Path) -> None:
    env = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA")}
    env |= {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def kept() -> set[str]:
        return {path.name for path in (tmp_path / "cache").rglob("*.code")}

    log = str(tmp_path / "log.csv")
    for words in (
        ("-m", "topdress.console.warm_up"),
        (*warm_up.CONSOLE_COMMAND[1:], "simulate", "--seconds", "300", "--out", log),
    ):
        subprocess.run([sys.executable, *words], env=env, check=True, timeout=600)
    before = kept()
    subprocess.run([*warm_up.CONSOLE_COMMAND, "diagnose", log], env=env, check=True, timeout=600)
    assert before and kept() == before
