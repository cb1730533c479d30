"""docs/architecture.md and the tree name the same things."""

from __future__ import annotations

import ast
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
    """Returns the first cells of the table of rooms."""
    rows = text[text.index("| room |") : text.index("## Walk 1")].splitlines()
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


def read_walks(text: str) -> list[tuple[str, str]]:
    """Returns file and function of each step of the walks, `Class.method` for a method."""
    steps, walks = [], text[text.index("## Walk 1") : text.index("## Filters")]
    for row in re.findall(r"^\| [^|]+ \| `([\w/.]+\.py)` \| ([^|]+) \|$", walks, re.MULTILINE):
        steps += [(row[0], name) for name in re.findall(r"`([\w.]+)`", row[1])]
    return steps


def list_functions(file: Path) -> set[str]:
    """Returns a file's functions, and its classes' methods as `Class.method`."""
    found = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}.{inner.name}"
                for inner in node.body
                if isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef)
            }
    return found


FOLDERS = sorted(
    path.parent
    for room in ("control", "drivers", "console")
    for path in (ROOT / room).rglob("__init__.py")
)
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


@pytest.mark.parametrize(("file", "function"), read_walks(PAGE.read_text(encoding="utf-8")))
def test_every_step_of_a_walk_is_a_function_that_is_there(file: str, function: str) -> None:
    assert function in list_functions(ROOT / file)


def test_there_are_three_walks() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text.count("\n## Walk ") == 3 and len(read_walks(text)) >= 30


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_folder_says_its_files_in_a_line_each(folder: Path) -> None:
    """`python .ci/folders.py` writes the lines."""
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    listed = re.findall(r"^- `(\w+)`: \S.{3,}$", text.partition("Files:\n")[2], re.MULTILINE)
    there = [
        path.stem
        for path in sorted(folder.iterdir())
        if (path.suffix == ".py" and not path.stem.startswith("__"))
        or (path / "__init__.py").exists()
    ]
    assert listed == there


def test_every_file_of_the_diagnosis_of_run_logs_is_a_step_on_its_page() -> None:
    page = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    steps = page[page.index("| step |") : page.index("### What is read")]
    there = {path.name for path in (ROOT / "control" / "diagnosis" / "runs").glob("*.py")}
    assert set(re.findall(r"`(\w+\.py)`", steps)) == there - {"__init__.py"}
