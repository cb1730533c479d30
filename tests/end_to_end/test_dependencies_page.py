"""Every dependency is on the page, with a reason."""
from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_dependency_has_its_line():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(name for extra in extras for name in extra)]
    lines = [line.split("|") for line in (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").split("\n")]
    named = {name for line in lines if len(line) > 3 and len(line[-2].strip()) > 20
             for name in re.findall(r"[A-Za-z][A-Za-z0-9-]+", line[1])}
    assert {re.split(r"[^A-Za-z0-9-]", name)[0] for name in wanted} - {"topdress"} <= named
