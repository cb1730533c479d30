"""A docstring or comment names in backticks only what exists: a name that was changed in the code
and left behind in a sentence sends its reader to nothing.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("control", "console", "drivers")
# Folders that show names of other programs' files as examples.
EXAMPLES = ("drivers/files/imports", "drivers/files/prescriptions")
# Commands, tags and filters that are no names of the code.
OTHER_NAMES = {"su", "sudo", "mpremote", "hh", "attrunit", "rate_unit", "UnitType", "speed_used"}
NAME = re.compile(r"`([A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)*)(?:\([^`]*\))?`")

# A string is read as one, so that no quotation mark or # within it begins another.
PROSE_OR_STRING = re.compile(
    r'''[A-Za-z]*"""[\s\S]*?"""|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|#[^\n]*'''
)


def list_modules() -> list[Path]:
    return [
        path
        for room in ROOMS
        for path in sorted((ROOT / room).rglob("*.py"))
        if not path.relative_to(ROOT).as_posix().startswith(EXAMPLES)
    ]


@cache
def read_parts(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Docstrings and comments of a module with the line where each begins; all else."""
    text, prose, code, end = path.read_text(encoding="utf-8"), [], [], 0
    for part in PROSE_OR_STRING.finditer(text):
        if part[0].startswith(('"""', "#")):
            prose.append((text.count("\n", 0, part.start()) + 1, part[0]))
            code.append(text[end : part.start()])
            end = part.end()
    return prose, "".join((*code, text[end:]))


@cache
def collect_words(path: Path) -> frozenset[str]:
    """The identifiers of a module, and the words of its texts, but for docstrings and comments."""
    return frozenset(re.findall(r"\w+", read_parts(path)[1]))


@cache
def collect_all_words() -> frozenset[str]:
    paths = [path for room in ROOMS for path in (ROOT / room).rglob("*.py")]
    words: frozenset[str] = frozenset().union(*map(collect_words, paths))
    return words | {path.stem for path in paths} | {path.parent.name for path in paths}


def list_missing(path: Path, known: frozenset[str]) -> list[str]:
    """The names in a module's prose that are not in `known`, each with its line."""
    missing = []
    for line, text in read_parts(path)[0]:
        for name in NAME.findall(text):
            if not OTHER_NAMES.issuperset(lost := set(name.split(".")) - known):
                missing.append(f"{path.relative_to(ROOT)}:{line} `{name}`: {lost}")
    return missing


def test_names_in_prose_exist() -> None:
    missing = [line for path in list_modules() for line in list_missing(path, collect_all_words())]
    assert not missing, "\n".join(missing)


def list_called_methods(path: Path) -> list[str]:
    """The methods that a class's docstring tells its caller to call, and which the class lacks."""
    missing: list[str] = []
    if not any("is called" in " ".join(text.split()) for _, text in read_parts(path)[0]):
        return missing
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        text = ast.get_docstring(node) if isinstance(node, ast.ClassDef) else None
        plain = " ".join((text or "").split())
        called = re.findall(r"`(\w+)`(?:, `\w+`| or `\w+`)* is called", plain)
        words = collect_words(path)
        missing += [f"{path.relative_to(ROOT)}: `{name}`" for name in called if name not in words]
    return missing


def test_methods_that_a_class_tells_to_call_exist() -> None:
    missing = [line for path in list_modules() for line in list_called_methods(path)]
    assert not missing, "\n".join(missing)


@pytest.mark.parametrize("text", ['"""Calls `find_nothing_here`."""', "# As `find_nothing_here`."])
def test_a_name_left_behind_is_found(text: str) -> None:
    lost = [name for name in NAME.findall(text) if name not in collect_all_words()]
    assert lost == ["find_nothing_here"]
