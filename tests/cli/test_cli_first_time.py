"""The tour comes once."""
from __future__ import annotations

from console.cli.screens import first_time


def test_only_the_first_time_is_the_first(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert [first_time() for _ in range(3)] == [True, False, False]


def test_a_folder_that_cannot_be_written_is_no_reason_to_fail(tmp_path, monkeypatch):
    (tmp_path / "data").write_text("a file where a folder should be")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert not first_time()
