"""`topdress run` before its first picture: the worker comes up beside the console; wrong files are told as such."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from console.app.app import TopdressApp
from console.cli import screens
from console.cli.plain_errors import CommandError
from console.running import Where, WorkerFailed
from console.services.launcher import Launcher
from drivers.files import setup
from drivers.files.config_error import ConfigError


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """What is done, in its order; no screen is drawn and no worker runs."""
    done: list[str] = []
    setup_of = setup.setup_of

    def start(self: Launcher, resumed: Path | None = None) -> Where:
        done.append("worker")
        return Where(1, None, 1)

    def read(*args: Any) -> setup.Setup:
        done.append("files")
        return setup_of(*args)

    monkeypatch.setattr(screens, "has_terminal", lambda: True)
    monkeypatch.setattr(screens, "need_terminal", lambda *words: None)
    monkeypatch.setattr(screens, "trouble_path", lambda: tmp_path / "worker.log")
    monkeypatch.setattr(screens, "first_time", lambda: False)
    monkeypatch.setattr("console.running.find_running", lambda: None)
    monkeypatch.setattr(Launcher, "start", start)
    monkeypatch.setattr(setup, "setup_of", read)
    monkeypatch.setattr(TopdressApp, "run", lambda self: done.append("screen"))
    return done


def test_the_worker_comes_up_before_the_files_are_read(steps: list[str], tmp_path: Path) -> None:
    screens.show_run((), (), 1, 20.0, str(tmp_path / "run.csv"))
    assert sorted(steps) == ["files", "screen", "worker"] and steps[-1] == "screen"
    assert steps[0] == "worker"


def test_a_wrong_file_is_told_as_a_file(steps: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def start(self: Launcher, resumed: Path | None = None) -> Where:
        raise WorkerFailed("the control worker did not start: something else")

    monkeypatch.setattr(Launcher, "start", start)
    wrong = tmp_path / "job.yaml"
    wrong.write_text("format: topdress-job/1\ncolour: red\n")
    with pytest.raises(ConfigError, match="colour"):
        screens.show_run((str(wrong),), (), 1, 20.0, str(tmp_path / "run.csv"))
    assert "screen" not in steps


def test_a_worker_that_did_not_come_up_is_one_line(steps: list[str], tmp_path: Path,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    def run(self: TopdressApp) -> None:
        self.not_started = "the control worker did not start: no such port"

    monkeypatch.setattr(TopdressApp, "run", run)
    with pytest.raises(CommandError, match="no such port"):
        screens.show_run((), (), 1, 20.0, str(tmp_path / "run.csv"))


def test_a_job_that_was_cut_off_is_asked_about_first(steps: list[str], tmp_path: Path) -> None:
    (tmp_path / "cut.resume.json").write_text('{"format": "topdress-resume/1", "quit": false}')
    assert Launcher((), (), 1, 20.0, str(tmp_path / "run.csv"), tmp_path / "trouble").may_go_on()
    (tmp_path / "cut.resume.json").write_text('{"format": "topdress-resume/1", "quit": true}')
    assert not Launcher((), (), 1, 20.0, str(tmp_path / "run.csv"), tmp_path / "trouble").may_go_on()
