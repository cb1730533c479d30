import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from topdress.drivers.files import process_lock as lock_module
from topdress.drivers.files.atomic_files import create_new_file, find_sidecar, write_atomically
from topdress.drivers.files.process_lock import is_same_file, take_lock


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    place = tmp_path / "a.yaml"
    write_atomically(place, "old")
    write_atomically(place, "new °")
    assert place.read_text(encoding="utf-8") == "new °"
    assert [p.name for p in tmp_path.iterdir()] == ["a.yaml"]


def test_the_old_file_stays_when_the_new_one_cannot_be_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "a.yaml"
    write_atomically(place, "old")

    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(place, "new")
    assert place.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.yaml"]


def test_writing_leaves_the_umask_of_the_other_threads_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = tmp_path / "usual"
    usual.touch()

    def touched(_mask: int) -> int:
        raise AssertionError("what another thread creates now is open to everybody")

    monkeypatch.setattr(os, "umask", touched)
    write_atomically(tmp_path / "a.yaml", "x")
    assert (tmp_path / "a.yaml").stat().st_mode == usual.stat().st_mode


def test_who_reads_while_a_file_is_replaced_finds_one_of_both_whole(tmp_path: Path) -> None:
    place, found = tmp_path / "a.resume.json", set()
    contents = ["a" * 200_000, "b" * 300_000]
    write_atomically(place, contents[0])
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit(lambda: [write_atomically(place, contents[k % 2]) for k in range(60)])
        while not writing.done():
            found.add(place.read_text())
        writing.result()
    assert found <= set(contents)


def test_a_taken_name_is_never_taken_again(tmp_path: Path) -> None:
    first = create_new_file(tmp_path / "run.csv")
    first.write(bytearray(b"precious"))
    second = create_new_file(tmp_path / "run.csv")
    assert (first.path.name, second.path.name) == ("run.csv", "run-2.csv")
    assert first.path.read_bytes() == b"precious"
    first.close()
    second.close()


def test_a_name_whose_sidecar_is_taken_is_taken(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("my own configuration")
    log = create_new_file(tmp_path / "run.csv")
    log.close()
    assert log.path.name == "run-2.csv"
    assert find_sidecar(log.path).name == "run-2.yaml"


def test_a_deleted_log_is_noticed(tmp_path: Path) -> None:
    log = create_new_file(tmp_path / "run.csv")
    try:
        log.path.unlink()
    except PermissionError:
        pytest.skip("this system does not delete open files")
    with pytest.raises(OSError, match="deleted"):
        log.sync()
    log.close()


HOLDER = """
import sys, pathlib
from topdress.drivers.files.process_lock import take_lock
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
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
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
    assert first is not None and is_same_file(first, path)
    path.unlink()
    assert not is_same_file(first, path)
    second = take_lock(path)
    assert second is not None and is_same_file(second, path) and not is_same_file(first, path)
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
    assert lock is not None and is_same_file(lock, path) and removed
    lock.close()
