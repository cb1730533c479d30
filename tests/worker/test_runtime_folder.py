"""Where a console looks for the machine that runs: in this user's own folder, and in no other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from topdress.console import running
from topdress.console.running import WorkerFailed, find_default_run_file, find_running_worker

pytestmark = pytest.mark.skipif(os.name != "posix", reason="owners and modes of folders")


@pytest.fixture(autouse=True)
def computer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """One on which nobody has a session, with a home for this user."""
    for name in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(running, "SESSION_FOLDERS", tmp_path / "sessions")
    monkeypatch.setattr("sys.platform", "linux")
    yield tmp_path


def folder_of(path: Path, mode: int = 0o700) -> Path:
    path.mkdir(parents=True)
    path.chmod(mode)
    return path


def test_the_folder_that_is_named_is_taken(computer: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = folder_of(computer / "own")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own))
    assert find_default_run_file() == own / "topdress" / "worker.json"


def test_else_that_of_the_users_session(computer: Path) -> None:
    session = folder_of(computer / "sessions" / str(os.getuid()))
    assert find_default_run_file() == session / "topdress" / "worker.json"


def test_else_one_in_the_users_home(computer: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not one that goes by the user's number alone: a console of another account found it."""
    first = find_default_run_file()
    assert first == computer / "home/.local/state/topdress/run/worker.json"
    monkeypatch.setenv("HOME", str(computer / "other"))
    assert find_default_run_file() != first
    assert find_running_worker() is None


def test_a_folder_of_a_session_that_is_over_is_none(
    computer: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(computer / "gone"))
    assert find_default_run_file().is_relative_to(computer / "home")


@pytest.mark.parametrize("mode", [0o770, 0o777, 0o1777])
def test_one_that_others_may_write_to_is_refused(
    computer: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder_of(computer / "open", mode)))
    with pytest.raises(WorkerFailed, match="allowed is one of your own"):
        find_running_worker()


def test_the_folder_of_another_user_is_refused(
    computer: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`su` and `sudo -E` keep XDG_RUNTIME_DIR."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder_of(computer / "theirs")))
    monkeypatch.setattr(os, "getuid", lambda: 1 + (computer / "theirs").stat().st_uid)
    with pytest.raises(WorkerFailed, match="another user owns"):
        find_running_worker()


def test_topdress_s_own_folder_is_looked_at_too(
    computer: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = folder_of(computer / "own")
    folder_of(own / "topdress", 0o777)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own))
    with pytest.raises(WorkerFailed, match="allowed is one of your own"):
        find_default_run_file()
