"""What the tests catch: `python benchmarks/faults.py [--count 40] [--seed 31] [--out faults.jsonl]`.

Puts seeded faults (fault_kinds.py) into a copy of the sources, one at a time, and runs the tests that can import the
file, nearest first, until one fails: first the quick set (`make test`), then the rest (`make exam`) on what it lets
through. A test that fails without the fault too catches nothing. Answers are kept in --out as they come: what stands
there is not asked again.
"""
from __future__ import annotations

import argparse
import ast
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from fault_kinds import KINDS, ROOMS, Fault, by_kind, chosen
from verdict import exit_code

SETS = {"quick": "not exam", "exam": "exam"}
COPIED = (*ROOMS, "tests", "benchmarks", "configs", "docs", "schemas", "requirements")
FILES = ("pyproject.toml", "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "Makefile", "LICENSE")
STARTS_PROGRAMS = ("subprocess", "start_worker", "benchmark_module", "pexpect")
NEAR = 12                       # test files that are asked first, without a second process
LEAST_BY_QUICK = 0.85           # of what is caught at all
DOTTED = re.compile(r"\b(?:control|drivers|console|benchmarks)(?:\.\w+)+")
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+?\.py(?:::.*?)?)(?: - .*)?$", re.M)


class Caught(NamedTuple):
    """`by`: the set that caught it, "" none; `test`: which; `cpu_s`: processor's time; `files`: test files asked."""

    by: str
    test: str
    cpu_s: float
    files: int


def imports_of(tree: Path) -> dict[str, set[str]]:
    """File of the tree -> files of the tree that it can import, wherever in it, by name, also as text."""
    files = {path.relative_to(tree).as_posix() for top in (*ROOMS, "benchmarks", "tests")
             for path in (tree / top).rglob("*.py")}
    return {file: {found for name in _names(tree / file, file) for found in _file_of(name, files)} for file in files}


def _names(path: Path, file: str) -> set[str]:
    package = file.removesuffix(".py").removesuffix("/__init__").split("/")
    package = package if file.endswith("__init__.py") else package[:-1]
    text = path.read_text(encoding="utf-8")
    found = set(DOTTED.findall(text))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[:len(package) - node.level + 1] if node.level else []
            start = ".".join([*base, *([node.module] if node.module else [])])
            found |= {start, *(f"{start}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            found |= {f"benchmarks.{node.value}", ".".join([*package, node.value])}     # loaded by name
    return found


def _file_of(name: str, files: set[str]) -> list[str]:
    """The module of a dotted name and the packages that it lies in."""
    parts = name.split(".")
    tries = ["/".join(parts[:k]) for k in range(1, len(parts) + 1)]
    return [file for one in tries for file in (f"{one}.py", f"{one}/__init__.py") if file in files]


def tests_of(tree: Path, file: str, imports: dict[str, set[str]]) -> list[str]:
    """Test files that can import a file, nearest first; those that start the program can import everything."""
    tests = sorted(name for name in imports if name.startswith("tests/") and "/test_" in name)
    far = {test: _distance(test, file, imports) for test in tests}
    return [test for test in sorted(tests, key=lambda one: (far[one] or 99, one))
            if far[test] is not None or any(word in (tree / test).read_text() for word in STARTS_PROGRAMS)]


def _distance(test: str, file: str, imports: dict[str, set[str]]) -> int | None:
    folders = [parent.as_posix() for parent in Path(test).parents]
    seen = {test, *(f"{folder}/conftest.py" for folder in folders if f"{folder}/conftest.py" in imports)}
    edge, steps = set(seen), 0
    while edge:
        if file in edge:
            return steps
        edge = {found for one in edge for found in imports.get(one, ())} - seen
        seen |= edge
        steps += 1
    return None


class Copy:
    """A copy of the sources in which a fault can stand."""

    def __init__(self, tree: Path, folder: Path, jobs: int, limit_s: float) -> None:
        self.tree, self.jobs, self.limit_s = folder / "here" / "copy", jobs, limit_s
        for name in COPIED:
            shutil.copytree(tree / name, self.tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in FILES:
            shutil.copy(tree / name, self.tree / name)
        shared = tree.parent / "shared"
        if shared.exists():
            (self.tree.parent / "shared").symlink_to(shared.resolve())
        self._written = time.time()

    def write(self, file: str, text: str) -> None:
        """With a time of its own: a compiled module is known by the second in which its source was written."""
        self._written += 2.0
        (self.tree / file).write_text(text, encoding="utf-8")
        os.utime(self.tree / file, (self._written, self._written))

    def failing(self, tests: Sequence[str], which: str, jobs: int = 1) -> str | None:
        """The first test that fails. None: all pass, or none of them is of this set."""
        many = ["-n", str(jobs)] if jobs > 1 else []
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", SETS[which], *many]
        env = {**os.environ, "PYTHONPATH": str(self.tree), "COLUMNS": "500"}
        try:
            done = subprocess.run([*command, *tests], cwd=self.tree, env=env, capture_output=True, text=True,
                                  timeout=self.limit_s)
        except subprocess.TimeoutExpired:
            return "no end"
        if done.returncode in (0, 5):
            return None
        found = FAILED.search(done.stdout)
        return found.group(1) if found else (done.stdout + done.stderr).strip()[-200:]

    def catches(self, fault: Fault, tests: Sequence[str], which: str) -> str:
        """The test that fails with the fault and not without it; "" where none does."""
        text = (self.tree / fault.file).read_text(encoding="utf-8")
        left = list(tests)
        for some, jobs in ((left[:NEAR], 1), (left[NEAR:], self.jobs)):
            while some:
                self.write(fault.file, fault.put_into(text))
                failed = self.failing(some, which, jobs)
                self.write(fault.file, text)
                if failed is None:
                    break
                file = failed.partition("::")[0]
                if file not in some or self.failing([failed], which) is None:
                    return failed
                some = [one for one in some if one != file]         # fails without the fault too
        return ""


def asked(copy: Copy, fault: Fault, imports: dict[str, set[str]], sets: Iterable[str], nearest: int) -> Caught:
    tests = tests_of(copy.tree, fault.file, imports)[:nearest]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    by, test = "", ""
    for which in sets:
        test = copy.catches(fault, tests, which)
        if test:
            by = which
            break
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Caught(by, test, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, len(tests))


def table(faults: Sequence[Fault], said: dict[str, Caught]) -> str:
    rows = ["| fault | kind | change | caught by | test |", "|---|---|---|---|---|"]
    for fault in faults:
        one = said[fault.id]
        change = " -> ".join(f"`{' '.join(text.split())[:48]}`".replace("|", "\\|") for text in (fault.old, fault.new))
        rows.append(f"| `{fault.file}:{fault.line}` | {fault.kind} | {change} | {one.by or '-'} | {one.test} |")
    return "\n".join(rows)


def main() -> int:
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--count", type=int, default=40)
    a.add_argument("--seed", type=int, default=31)
    a.add_argument("--sets", nargs="+", choices=list(SETS), default=list(SETS))
    a.add_argument("--jobs", type=int, default=2, help="processes of pytest for what is not near")
    a.add_argument("--part", type=int, nargs=2, default=(1, 1), metavar=("K", "N"), help="every N-th, from the K-th on")
    a.add_argument("--nearest", type=int, default=1000, help="test files that are asked, at most")
    a.add_argument("--limit-s", type=float, default=1500.0, help="for a set on one fault; beyond it counts as caught")
    a.add_argument("--out", type=Path, default=Path("faults.jsonl"), help="answers, kept as they come")
    args = a.parse_args()
    tree = Path(__file__).resolve().parents[1]
    faults = chosen(tree, args.count, args.seed)[args.part[0] - 1::args.part[1]]
    said = {}
    if args.out.exists():
        for line in args.out.read_text().splitlines():
            name, *rest = json.loads(line)
            said[name] = Caught(*rest)
    imports = imports_of(tree)
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        copy = Copy(tree, Path(folder), args.jobs, args.limit_s)
        for number, fault in enumerate(faults, 1):
            if fault.id not in said:
                said[fault.id] = asked(copy, fault, imports, args.sets, args.nearest)
                with args.out.open("a") as out:
                    out.write(json.dumps([fault.id, *said[fault.id]]) + "\n")
            one = said[fault.id]
            print(f"{number:3d} {fault.kind:6s} {fault.file}:{fault.line}: {one.by or 'let through'} {one.test} "
                  f"({one.cpu_s:.0f} s of processor)", file=sys.stderr, flush=True)
    print(table(faults, said))
    caught = [fault for fault in faults if said[fault.id].by]
    quick = [fault for fault in caught if said[fault.id].by == "quick"]
    kinds = ", ".join(f"{kind} {by_kind(caught)[kind]} of {by_kind(faults)[kind]}" for kind in KINDS)
    print(f"\n{len(faults)} faults: {len(caught)} caught ({kinds}), {len(quick)} of them by `make test`, "
          f"{sum(one.cpu_s for one in said.values()):.0f} s of processor")
    return exit_code({f"{LEAST_BY_QUICK:.0%} of what is caught is caught by `make test`":
                      caught and len(quick) >= LEAST_BY_QUICK * len(caught)})


if __name__ == "__main__":
    sys.exit(main())
