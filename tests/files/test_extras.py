"""By what an extra is installed beside topdress, in each kind of environment."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from topdress.drivers.files import optional_packages


@pytest.mark.parametrize(
    ("made_by", "has_pip", "begins"),
    [
        ("pipx_metadata.json", True, ["pipx", "inject"]),
        # pipx with uv as its back end
        ("pipx_metadata.json", False, ["pipx", "inject"]),
        # of `uv tool install`, whether uv is on the path of this shell or not
        ("uv-receipt.toml", False, ["uv", "pip", "install", "--python", sys.executable]),
        ("pyvenv.cfg", True, [sys.executable, "-m", "pip", "install"]),
    ],
)
def test_each_environment_has_its_installer(
    made_by: str,
    has_pip: bool,
    begins: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / made_by).touch()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(optional_packages, "find_spec", lambda _: object() if has_pip else None)
    assert list(optional_packages.find_installer())[: len(begins)] == begins
