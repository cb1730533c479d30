"""docs/architecture.md and the tree name the same things."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
BASES = (
    ROOT,
    ROOT / "control",
    ROOT / "drivers",
    ROOT / "console",
    ROOT / "console" / "app",
    ROOT / "console" / "cli",
    ROOT / "docs",
)


def first_cells(text: str) -> list[str]:
    """The first cells of the table of rooms."""
    rows = text[text.index("| room |") : text.index("Time enters")].splitlines()
    return [row.split("|")[1] for row in rows[2:] if row.startswith("|")]


def names(text: str) -> list[str]:
    """What is written as code: `control/log_row.py, readings.py` are two names in one folder."""
    found = []
    for code in re.findall(r"`([^`]+)`", text):
        folder = ""
        for part in code.split(", "):
            found.append(folder + part)
            folder = folder or (part.rpartition("/")[0] + "/" if "/" in part else "")
    return found


def is_there(name: str) -> bool:
    return any(
        list(base.glob(name.rstrip("/") + ending)) for base in BASES for ending in ("", ".py")
    )


def insides(text: str) -> dict[str, set[str]]:
    """Folder -> what the table of the larger rooms says to be in it."""
    rows = [
        row
        for row in text[text.index("| folder |") : text.index("## One tick")].splitlines()[2:]
        if row
    ]
    return {
        names(row.split("|")[1])[0]: set(re.findall(r"`(\w+)`", row.split("|", 2)[2]))
        for row in rows
    }


PATHS = sorted(
    {
        name
        for name in names(PAGE.read_text(encoding="utf-8"))
        if "/" in name or name.endswith(".py")
    }
)


@pytest.mark.parametrize("name", PATHS)
def test_what_the_page_names_is_there(name: str) -> None:
    assert is_there(name)


@pytest.mark.parametrize("room", ["control", "drivers", "console"])
def test_what_is_there_is_named_on_the_page(room: str) -> None:
    told = {
        name.removeprefix(f"{room}/").split("/")[0].removesuffix(".py")
        for cell in first_cells(PAGE.read_text(encoding="utf-8"))
        for name in names(cell)
    }
    there = {
        path.stem
        for path in (ROOT / room).iterdir()
        if path.suffix == ".py" or any(path.glob("*.py"))
    }
    assert there - {"__init__"} - told == set()


@pytest.mark.parametrize(("folder", "told"), insides(PAGE.read_text(encoding="utf-8")).items())
def test_the_larger_rooms_hold_what_the_page_says(folder: str, told: set[str]) -> None:
    there = {
        path.stem
        for path in (ROOT / folder).iterdir()
        if path.suffix == ".py" or any(path.glob("*.py"))
    }
    assert told == there - {"__init__"}


def test_every_file_of_the_diagnosis_of_run_logs_is_a_step_on_its_page() -> None:
    page = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    steps = page[page.index("| step |") : page.index("### What is read")]
    there = {path.name for path in (ROOT / "control" / "diagnosis" / "runs").glob("*.py")}
    assert set(re.findall(r"`(\w+\.py)`", steps)) == there - {"__init__.py"}
