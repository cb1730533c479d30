from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from drivers.files import lock as lock_module
from drivers.files.lock import stands, take_lock

HOLDER = """
import sys, pathlib
from drivers.files.lock import take_lock
lock = take_lock(pathlib.Path(sys.argv[1]))
print("held" if lock else "refused", flush=True)
sys.stdin.read()
"""


def test_one_at_a_time_until_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    first = take_lock(path)
    assert first is not None and take_lock(path) is None
    first.close()
    second = take_lock(path)
    assert second is not None
    second.close()


def test_the_system_gives_it_back_when_its_process_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
    assert take_lock(path) is None
    holder.kill()
    holder.communicate()
    lock = take_lock(path)
    assert lock is not None and path.exists()
    lock.close()


def test_where_no_file_can_be_made_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        take_lock(tmp_path / "nowhere" / "a.lock")


def test_a_lock_whose_file_was_removed_does_not_stand(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    first = take_lock(path)
    assert first is not None and stands(first, path)
    path.unlink()
    assert not stands(first, path)
    second = take_lock(path)
    assert second is not None and stands(second, path) and not stands(first, path)
    first.close()
    second.close()


def test_what_is_locked_is_the_file_of_that_name(tmp_path: Path) -> None:
    """Removed between its opening and its locking: locked anew, or two would hold it."""
    path, removed = tmp_path / "a.lock", []

    def later(handle: int) -> None:
        if not removed:
            removed.append(path.unlink())
        lock_module._take(handle)

    lock = take_lock(path, later)
    assert lock is not None and stands(lock, path) and removed
    lock.close()
