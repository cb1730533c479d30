"""The right to be the worker of a run file: what a start waits for."""
from __future__ import annotations

import time

import pytest

from console.worker import run_file
from drivers.files.lock import take_lock


@pytest.fixture
def waited(monkeypatch):
    """Seconds that a start waited."""
    slept: list[float] = []
    monkeypatch.setattr(run_file.time, "sleep", slept.append)
    return slept


def confirmed(path):
    with run_file.held(path) as right:
        right.confirm()


def test_the_first_start_waits_for_a_worker_whose_lock_was_removed(tmp_path, waited):
    confirmed(tmp_path / "run" / "worker.json")
    assert waited == [pytest.approx(run_file.SETTLED_S, abs=0.2)]


def test_a_clean_start_waits_for_nobody(tmp_path, waited, monkeypatch):
    """No run file is there, as after every clean end, and the lock's file is an old one."""
    path = tmp_path / "worker.json"
    take_lock(path.with_suffix(".lock")).close()
    now = time.time()
    monkeypatch.setattr(run_file.time, "time", lambda: now + run_file.YOUNG_S + 0.1)
    confirmed(path)
    assert waited == []


@pytest.mark.parametrize("later_s", [0.0, 1.5, -3600.0], ids=["at once", "a busy computer", "its clock was put back"])
def test_a_lock_that_somebody_just_made_anew_is_not_believed(tmp_path, waited, monkeypatch, later_s):
    """By a console that looked: the worker under which the lock was removed has not locked this one yet."""
    path = tmp_path / "worker.json"
    take_lock(path.with_suffix(".lock")).close()
    now = time.time()
    monkeypatch.setattr(run_file.time, "time", lambda: now + later_s)
    confirmed(path)
    assert waited == [pytest.approx(run_file.SETTLED_S, abs=0.2)]
