"""Write the list of files into each folder's `__init__` docstring: `python .ci/folders.py`.

A line for each module and sub-folder: its name and the first sentence of its own docstring, cut
to one line. Run it after a module was added, renamed or described anew;
tests/test_architecture_page.py fails where a module is missing.
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = ("control", "drivers", "console")
HEAD = "Files:"
WIDTH = 100
SHORT = 24  # letters of a sentence that says little


def find_folders() -> list[Path]:
    """Return the folders of the program that are packages, in order."""
    return sorted(path.parent for room in ROOMS for path in (ROOT / room).rglob("__init__.py"))


def list_modules(folder: Path) -> list[Path]:
    """Return modules and sub-folders of a folder, without its `__init__` and `__main__`."""
    return sorted(
        path
        for path in folder.iterdir()
        if (path.suffix == ".py" and not path.stem.startswith("__"))
        or (path / "__init__.py").exists()
    )


def read_sentence(path: Path, room: int) -> str:
    """Return the first sentence of a module's docstring, at most `room` characters of it."""
    file = path / "__init__.py" if path.is_dir() else path
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    text = " ".join(text.partition(f"\n\n{HEAD}\n")[0].split())
    first, *_ = re.split(r"(?<=[a-z`)])[.:]\s|(?<=\?)\s", text)
    if len(first) < SHORT:  # "Ports: ..." says too little alone
        first, *more = re.split(r"(?<=[a-z`)])\.\s", text)
        while more and len(first) < SHORT:
            first += ". " + more.pop(0)
    while len(first) > room:
        shorter = re.sub(r"[,;:(.]? ?[^,;:(]*$", "", first)
        first = shorter if 10 < len(shorter) < len(first) else first[:room].rsplit(" ", 1)[0]
    return first.rstrip(" ,;:.")


def describe_folder(folder: Path) -> str:
    """Return the lines that list a folder's files."""
    lines = []
    for path in list_modules(folder):
        name = f"- `{path.stem}`: "
        lines.append(name + read_sentence(path, WIDTH - len(name)))
    return "\n".join(lines)


def write_list(folder: Path) -> bool:
    """Write a folder's list into its `__init__`; return whether the file changed."""
    file = folder / "__init__.py"
    source = file.read_text(encoding="utf-8")
    listed = describe_folder(folder)
    if not listed:
        return False
    node = ast.parse(source).body[0]
    assert isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant), file
    lines = source.splitlines(keepends=True)
    old = "".join(lines[node.lineno - 1 : node.end_lineno])
    raw = "r" if "\\" in str(node.value.value) else ""
    body = str(node.value.value).partition(f"\n\n{HEAD}\n")[0].rstrip()
    new = f'{raw}"""{body}\n\n{HEAD}\n\n{listed}\n"""\n'
    if new == old:
        return False
    rest = "".join(lines[node.end_lineno :])
    file.write_text("".join(lines[: node.lineno - 1]) + new + rest, encoding="utf-8")
    return True


if __name__ == "__main__":
    changed = [folder for folder in find_folders() if write_list(folder)]
    sys.exit(print(f"{len(changed)} lists written"))
