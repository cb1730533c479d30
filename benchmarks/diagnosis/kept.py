"""Cases worked on in processes of their own, each kept as a line as soon as it is done, and not
done again."""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))

from topdress.console.thread_limits import limit_matrix_threads  # noqa: E402

limit_matrix_threads()  # here and in the processes that it starts

# They neither make a case nor answer it.
AFTERWARDS = (
    "score.py",
    "report.py",
    "class_report.py",
    "probability_report.py",
    "make.py",
    "write.py",
)


def code_hash(more: Iterable[Path] = ()) -> str:
    """Of everything that decides an answer or a case: answers of other code are not mixed in.
    more: further files."""
    found = [
        path
        for folder in ("control/diagnosis", "control/machine", "tests/diagnosis/hidden")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if not (folder.endswith("hidden") and path.name in AFTERWARDS)
    ]
    digest = hashlib.sha256()
    for path in (*found, *more):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def arguments(parser: argparse.ArgumentParser, folder: str, programmes: str) -> None:
    """What every examination can be asked: which cases, how long, what is kept and written
    where."""
    parser.add_argument("--start", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--programmes", choices=("tuning", "unseen", "all"), default=programmes)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--minutes", type=float, default=240.0, help="stop after so long; what is done counts"
    )
    parser.add_argument("--keep", type=Path, default=ROOT / ".benchmarks" / folder)
    parser.add_argument("--out", type=Path, help="Markdown; else to the screen")


def written(text: str, out: Path | None) -> None:
    if out is None:
        print(text)
    else:
        out.write_text(text, encoding="utf-8", newline="\n")


def done_in(path: Path) -> dict[int, dict[str, Any]]:
    """Case number -> what was kept. A last line cut off by an interruption is left out."""
    kept: dict[int, dict[str, Any]] = {}
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                one = json.loads(line)
            except json.JSONDecodeError:
                continue
            kept[one["number"]] = one
    return kept


def worked(
    asked: Sequence[Any],
    examine: Callable[[Any], dict[str, Any]],
    path: Path,
    jobs: int,
    minutes: float,
) -> tuple[dict[int, dict[str, Any]], int]:
    """What is kept of the asked tasks once those not done before are done, and how many were
    done in this call.

    asked : tasks with a `number`. examine : one task to a record with `number` and `trouble`
    (text or None). path : a line for each record. minutes : after so long no further task is
    waited for.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    numbers = {task.number for task in asked}
    kept = {k: one for k, one in done_in(path).items() if k in numbers}
    tasks = [task for task in asked if task.number not in kept]
    began, before = time.monotonic(), len(kept)
    with path.open("a", encoding="utf-8", newline="\n") as out:
        for one in _results(tasks, examine, jobs):
            kept[one["number"]] = one
            out.write(json.dumps(one) + "\n")
            out.flush()
            if one["trouble"]:
                print(f"\ncase {one['number']}:\n{one['trouble']}", file=sys.stderr)
            spent = time.monotonic() - began
            left = spent / (len(kept) - before) * (len(asked) - len(kept))
            print(
                f"\r{len(kept)}/{len(asked)}, {left / 60:.0f} min left ",
                end="",
                file=sys.stderr,
                flush=True,
            )
            if spent > 60.0 * minutes:
                break
    return kept, len(kept) - before


def _results(
    tasks: Sequence[Any], examine: Callable[[Any], dict[str, Any]], jobs: int
) -> Iterator[dict[str, Any]]:
    if jobs <= 1 or not tasks:
        yield from map(examine, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(examine, tasks)
