"""Every dependency is on the page, with a reason; what is installed when, and the sets of tests."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_every_dependency_has_its_line():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(name for extra in extras for name in extra)]
    lines = [
        line.split("|")
        for page in ("docs/dependencies.md", "CONTRIBUTING.md")
        for line in (ROOT / page).read_text(encoding="utf-8").split("\n")
    ]
    named = {
        name
        for line in lines
        if len(line) > 3 and len(line[-2].strip()) > 20
        for name in re.findall(r"[A-Za-z][A-Za-z0-9-]+", line[1])
    }
    assert {re.split(r"[^A-Za-z0-9-]", name)[0] for name in wanted} - {"topdress"} <= named


def _locked(name: str) -> dict[str, set[str]]:
    """Package -> its versions (one for each range of Python), of a lock file."""
    text = (ROOT / "requirements" / name).read_text(encoding="utf-8")
    found: dict[str, set[str]] = {}
    for package, version in re.findall(r"^([a-z0-9][a-z0-9._-]*)==([^ ]+)", text, re.M):
        found.setdefault(package, set()).add(version)
    return found


def test_what_the_program_needs_is_a_part_of_what_its_tests_need():
    """Else `make test` would change what `make run` has installed."""
    every = _locked("dev.txt")
    for name in ("run.txt", "build.txt", "extras.txt"):
        assert _locked(name).items() <= every.items(), name
    assert set(_locked("run.txt")) < set(_locked("extras.txt")) < set(every)


@pytest.mark.skipif(shutil.which("make") is None, reason="no make here")
def test_make_run_installs_what_the_program_needs_and_says_so(tmp_path):
    told = subprocess.run(
        ["make", "--dry-run", "run", f"VENV={tmp_path / 'venv'}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "requirements/run.txt" in told and "dev.txt" not in told
    assert "once:" in told and "--quiet" not in told, (
        "a first start of minutes without a word looks broken"
    )


def test_both_sets_are_named_where_people_look():
    texts = {
        name: (ROOT / name).read_text(encoding="utf-8")
        for name in ("Makefile", "README.md", "CONTRIBUTING.md", ".ci/run")
    }
    assert all("exam" in text for text in texts.values())
    assert "make check\nmake exam\n" in texts[".ci/run"]
    options = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "pytest"
    ]["ini_options"]
    assert options["addopts"][-2:] == ["-m", "not exam"]
    assert "-m exam" in texts["Makefile"] and "pytest -n 3 --dist loadfile " in texts["Makefile"]
