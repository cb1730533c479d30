"""`python -m benchmarks`: what there is, a line each. `python -m benchmarks NAME ...`: one of
them, with its options.

A benchmark is a file that runs; the others are what several share. `python benchmarks/NAME.py`
does the same.
"""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def index() -> dict[str, str]:
    """Name -> the first sentence of what it says of itself."""
    found = {}
    for path in sorted(HERE.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        runs = any(
            isinstance(node, ast.If) and "__name__" in ast.unparse(node.test) for node in tree.body
        )
        # A folder with a program of its own has its name.
        place = path.parent if path.stem == "__main__" else path
        if runs and place != HERE:
            name = place.relative_to(HERE).with_suffix("").as_posix()
            found[name] = (ast.get_docstring(tree) or "").split("\n")[0].split(": `")[0].rstrip(".")
    return found


def main(words: list[str]) -> int:
    known = index()
    if not words or words[0] in ("-h", "--help"):
        wide = max(map(len, known))
        print("\n".join(f"{name:{wide}}  {said}" for name, said in known.items()))
        return 0
    if words[0] not in known:
        print(f"{words[0]}: no such benchmark; allowed: {', '.join(known)}", file=sys.stderr)
        return 2
    folder = HERE / words[0] / "__main__.py"
    path = folder if folder.exists() else HERE / f"{words[0]}.py"
    sys.argv = [str(path), *words[1:]]
    # as `python benchmarks/NAME.py` has it: for what they share
    sys.path.insert(0, str(HERE if path == folder else path.parent))
    runpy.run_path(str(path), run_name="__main__")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
