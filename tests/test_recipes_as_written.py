"""Recipes of docs/recipes.md, carried out in a copy of the tree: green when complete, and red
without their last step."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
RECIPES = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
COPIED = (
    ".ci",
    "configs",
    "console",
    "control",
    "docs",
    "drivers",
    "schemas",
    "tests",
    "topdress",
    "pyproject.toml",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "README.md",
    "SECURITY.md",
    "Makefile",
    "mkdocs.yml",
    "benchmarks",
    "requirements",
)


class Step(NamedTuple):
    """One step: text for a file, or a command."""

    file: str
    text: str
    command: str


class Recipe(NamedTuple):
    steps: tuple[Step, ...]
    checks: tuple[str, ...]


def read_recipe(title: str) -> Recipe:
    """Read the steps and checks of a recipe from the page."""
    section = RECIPES.partition(f"## {title}\n")[2].partition("\n## ")[0]
    body, _, checks = section.partition("\n`python -m pytest ")
    steps = []
    for part in re.split(r"^\d\. ", body, flags=re.MULTILINE)[1:]:
        first = part.split("`")[1]
        block = textwrap.dedent("\n".join(re.findall(r"^(?: {8}.*|)$", part, re.MULTILINE)))
        example = re.search(r"\[Its text\]\((examples/\S+)\)", part)
        if example is not None:
            block = (ROOT / "docs" / example[1]).read_text(encoding="utf-8")
        is_command = part.startswith("Run ")
        steps.append(
            Step("", "", first) if is_command else Step(first, block.strip("\n") + "\n", "")
        )
    return Recipe(tuple(steps), tuple(checks.partition("`")[0].split()))


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree, with its compiled files."""
    folder = tmp_path_factory.mktemp("recipes") / "tree"
    folder.mkdir()
    for name in COPIED:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, folder / name)
    return folder


def run(tree: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a module of Python in the copy."""
    environment = os.environ | {"PYTHONPATH": str(tree)}
    return subprocess.run(
        [sys.executable, *words], cwd=tree, env=environment, capture_output=True, text=True
    )


def carry_out(tree: Path, step: Step) -> None:
    """Write or extend a file, or run a command."""
    if step.command.startswith("topdress "):
        start = "from topdress.console.cli import main; main()"
        done = run(tree, "-c", start, *step.command.split()[1:])
    elif step.command:
        done = run(tree, *step.command.split()[1:])
    else:
        path = tree / step.file
        before = path.read_text(encoding="utf-8") + "\n" if path.exists() else ""
        path.write_text(before + step.text, encoding="utf-8")
        return
    assert done.returncode == 0, done.stdout + done.stderr


def check_recipe(tree: Path, recipe: Recipe, left_out: int | None) -> str:
    """Carry out a recipe without one step, run its checks, undo it; return what failed."""
    kept = {
        path: path.read_bytes()
        for folder in (".ci", "console/locale", "docs", "drivers", "schemas")
        for path in (tree / folder).rglob("*.*")
        if path.suffix in (".py", ".po", ".md", ".json")
    }
    try:
        for number, step in enumerate(recipe.steps):
            if number != left_out:
                carry_out(tree, step)
        done = run(tree, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *recipe.checks)
        assert done.returncode in (0, 1), done.stdout + done.stderr
        return done.stdout if done.returncode else ""
    finally:
        for step in recipe.steps:
            path = tree / step.file
            if step.file and path not in kept:
                path.unlink(missing_ok=True)
        for path, data in kept.items():
            if path.read_bytes() != data:
                path.write_bytes(data)


TITLES = ("A device with a line of its own", "A format of files")


@pytest.mark.exam
@pytest.mark.parametrize("title", TITLES)
def test_a_recipe_works(title: str, tree: Path) -> None:
    recipe = read_recipe(title)
    assert len(recipe.steps) >= 3 and len(recipe.checks) >= 2
    failed = check_recipe(tree, recipe, None)
    assert not failed, failed


# Of each recipe the last step, which is forgotten most easily: a case takes twenty seconds.
@pytest.mark.exam
@pytest.mark.parametrize(
    ("title", "number"),
    [
        pytest.param(title, number, id=f"{title}, step {number + 1}")
        for title in TITLES
        for number in [len(read_recipe(title).steps) - 1]
    ],
)
def test_no_step_can_be_left_out(title: str, number: int, tree: Path) -> None:
    failed = check_recipe(tree, read_recipe(title), number)
    assert "failed" in failed, f"step {number + 1} can be left out"
