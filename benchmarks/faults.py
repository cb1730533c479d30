"""What the tests catch: `python -m benchmarks faults [--count 40] [--seed 31] [--out faults.jsonl]`.

Puts seeded faults (fault_kinds.py) into a copy of the sources, one at a time, and runs tests until one fails: first of
the quick set (`make test`), then of the rest (`make exam`) on what it lets through. Asked are the tests that run the
fault's line (with --reach: one run of each set sees which they are, fault_reach.py), and then their files; else those
that can import the file, nearest first. A test that fails without the fault too catches nothing. Answers are kept in
--out as they come: what stands there is not asked again.
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
from fault_reach import can_be_probed, probed, reached_by
from verdict import exit_code

SETS = {"quick": "not exam", "exam": "exam"}
COPIED = (*ROOMS, "tests", "benchmarks", "configs", "docs", "schemas", "requirements")
FILES = ("pyproject.toml", "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "Makefile", "LICENSE")
STARTS_PROGRAMS = ("subprocess", "start_worker", "benchmark_module", "pexpect")
NEAR = 12                       # test files that are asked first, without a second process
FEW = 200                       # tests that run a line are asked by name up to here, else by their files
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
    """Test files that can import a file, nearest first, and of those as near the ones named as its room or itself;
    those that start the program can import everything."""
    named = set(re.split(r"[/_.]", file)) - {"py", "control", "drivers", "console"}
    tests = sorted(name for name in imports if name.startswith("tests/") and "/test_" in name)
    far = {test: _distance(test, file, imports) for test in tests}
    return [test for test in sorted(tests, key=lambda one: (far[one] or 99, _unlike(one, named), one))
            if far[test] is not None or any(word in (tree / test).read_text() for word in STARTS_PROGRAMS)]


def _unlike(test: str, named: set[str]) -> int:
    return -len(named & set(re.split(r"[/_.]", test)))


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


Reach = dict[str, dict[str, list[str]]]         # set -> fault's id -> tests


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

    def run(self, tests: Sequence[str], which: str, jobs: int, *options: str) -> subprocess.CompletedProcess[str]:
        many = ["-n", str(jobs)] if jobs > 1 else []
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", SETS[which], *many, *options]
        env = {**os.environ, "PYTHONPATH": str(self.tree), "COLUMNS": "500"}
        return subprocess.run([*command, *tests], cwd=self.tree, env=env, capture_output=True, text=True,
                              timeout=self.limit_s)

    def failing(self, tests: Sequence[str], which: str, jobs: int = 1) -> str | None:
        """The first test that fails. None: all pass, or none of them is of this set."""
        try:
            done = self.run(tests, which, jobs, "-x")
        except subprocess.TimeoutExpired:
            return "no end"
        if done.returncode in (0, 5):
            return None
        found = FAILED.search(done.stdout)
        return found.group(1) if found else (done.stdout + done.stderr).strip()[-200:]

    def catches(self, fault: Fault, groups: Iterable[tuple[Sequence[str], int]], which: str) -> str:
        """The test of these groups (with processes for each) that fails with the fault and not without it, or ""."""
        text = (self.tree / fault.file).read_text(encoding="utf-8")
        for tests, jobs in groups:
            some = list(tests)
            while some:
                self.write(fault.file, fault.put_into(text))
                failed = self.failing(some, which, jobs)
                self.write(fault.file, text)
                if failed is None:
                    break
                file = failed.partition("::")[0]
                if not any(one.partition("::")[0] == file for one in some) or self.failing([failed], which) is None:
                    return failed
                some = [one for one in some if one.partition("::")[0] != file]      # fails without the fault too
        return ""

    def reach(self, faults: Sequence[Fault], which: str) -> dict[str, list[str]]:
        """Fault's id -> tests of a set that run its line; no entry: no test does, or no probe can stand there."""
        path = self.tree.parent / f"{which}.reached"
        path.touch()
        files = {fault.file for fault in faults if can_be_probed(fault)}
        before = {file: (self.tree / file).read_text(encoding="utf-8") for file in files}
        for file, text in before.items():
            here = {number: fault for number, fault in enumerate(faults) if fault.file == file}
            self.write(file, probed(text, here, path))
        self.run([], which, self.jobs, "--dist", "loadfile")
        for file, text in before.items():
            self.write(file, text)
        return reached_by(path.read_text(encoding="utf-8").splitlines(), faults)


def groups_of(reached: Sequence[str] | None, near: Sequence[str], jobs: int, most: int) -> list[tuple[list[str], int]]:
    """What is asked, in this order: tests that run the line, their files; where none are known, the nearest files."""
    if reached is None or "" in reached:
        return [(list(near[:min(NEAR, most)]), 1), (list(near[NEAR:most]), jobs)]
    files = list(dict.fromkeys(test.partition("::")[0] for test in reached))
    return [(list(reached), 1)] * (len(reached) <= FEW) + [(files[:most], jobs)]


def asked(copy: Copy, fault: Fault, near: Sequence[str], reach: Reach | None, sets: Iterable[str],
          most: int) -> Caught:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    by, test, files = "", "", set[str]()
    for which in sets:
        known = None if reach is None or not can_be_probed(fault) else reach[which].get(fault.id, [])
        groups = groups_of(known, near, copy.jobs, most)
        files |= {one.partition("::")[0] for tests, _ in groups for one in tests}
        test = copy.catches(fault, groups, which)
        if test:
            by = which
            break
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Caught(by, test, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, len(files))


def reach_kept(copy: Copy, faults: Sequence[Fault], sets: Iterable[str], kept: Path) -> Reach:
    """Tests that run each fault's line, by set; sets that stand in the file `kept` are not run again."""
    found: Reach = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    for which in sets:
        if which not in found:
            found[which] = copy.reach(faults, which)
            kept.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return found


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
    a.add_argument("--reach", type=Path, help="file of the tests that run each line: made by one run of each set")
    a.add_argument("--limit-s", type=float, default=1500.0, help="for a set on one fault; beyond it counts as caught")
    a.add_argument("--out", type=Path, default=Path("faults.jsonl"), help="answers, kept as they come")
    args = a.parse_args()
    tree = Path(__file__).resolve().parents[1]
    every = chosen(tree, args.count, args.seed)
    faults = every[args.part[0] - 1::args.part[1]]
    said = {}
    if args.out.exists():
        for line in args.out.read_text().splitlines():
            name, *rest = json.loads(line)
            said[name] = Caught(*rest)
    imports = imports_of(tree)
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        copy = Copy(tree, Path(folder), args.jobs, args.limit_s)
        reach = reach_kept(copy, every, args.sets, args.reach) if args.reach else None
        for number, fault in enumerate(faults, 1):
            if fault.id not in said:
                near = tests_of(tree, fault.file, imports)
                said[fault.id] = asked(copy, fault, near, reach, args.sets, args.nearest)
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
