"""Ambiguous answers about runs, asked again after the manoeuvre that the answer itself proposed has been driven.

    python -m benchmarks diagnosis/after_separating --seed 1 --most 60 --out docs/benchmark-diagnosis-separated.md

Takes the answers that run.py kept for the present code. For each ambiguous one, the same machine with the same hidden
effect and noise is driven again with the manoeuvre at its end, and diagnosed anew.
"""
from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "diagnosis"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from kept import ROOT, code_hash, done_in
from verdict import exit_code


def again(kept: dict[str, Any]) -> dict[str, Any] | None:
    """The new truth and answer of one ambiguous case; None where the plan cannot be driven."""
    import ask
    from hidden.cases import one
    from hidden.manoeuvres import asked_for, driven_too
    from hidden.plan import wanted

    from drivers.files.config import load
    from drivers.files.kinds import MACHINE

    number, seed = kept["number"], kept["truth"]["seed"]
    name = asked_for(kept["answer"]["next_run"]["plan"])
    if name is None:
        return None
    w = wanted(number, seed)
    case = one(number, seed, "all", (w.category,), w.kinds, w.ids)
    assert case.redriven is not None
    driven = case.redriven(driven_too(name), None)
    answer = ask.diagnosis("run", driven.columns, load("huanghai", MACHINE).model, case.name, seed)
    return {"number": number, "manoeuvre": name, "truth": {**case.truth, **driven.truth}, "answer": answer}


def ambiguous(kept: dict[int, dict[str, Any]]) -> list[dict[str, Any]]:
    """Runs whose answer is ambiguous and proposes a run, in order."""
    return [o for _, o in sorted(kept.items()) if o["truth"]["data_kind"] == "run" and o["answer"] is not None
            and o["answer"]["verdict"] == "ambiguous" and o["answer"]["next_run"] is not None
            and o["truth"]["category"] in ("single", "lookalike")]


def report(first: list[dict[str, Any]], second: list[dict[str, Any] | None], minutes: float) -> str:
    """Markdown: by what the answer could not tell apart, then by manoeuvre."""
    from hidden.report import percent
    from hidden.score import mark

    by_pair: dict[str, list[tuple[Any, Any, str]]] = defaultdict(list)
    by_way: dict[str, list[Any]] = defaultdict(list)
    plans = Counter(o["answer"]["next_run"]["plan"] for o, new in zip(first, second, strict=True) if new is None)
    for old, new in zip(first, second, strict=True):
        if new is None:
            continue
        before, after = mark(old["truth"], old["answer"]), mark(new["truth"], new["answer"])
        unsure = max(old["answer"]["causes"], key=lambda c: len(c["rivals"]))
        by_pair[" / ".join(sorted({unsure["id"], *(r["id"] for r in unsure["rivals"])}))].append(
            (before, after, new["manoeuvre"]))
        by_way[new["manoeuvre"]].append((before, after))

    def named(marks: list[Any]) -> str:
        """Named, alone, and truly: by its own id, not by one that the log could not tell from it."""
        return percent(sum(m.verdict == "named" and m.answer == m.truth["causes"][0]["id"] for m in marks), len(marks))

    def held(marks: list[Any]) -> str:
        return percent(sum(bool(m.said_truth) for m in marks), len(marks))

    every = [pair for some in by_way.values() for pair in some]
    out = ["# Ambiguous runs after the run that the program proposed", "",
           f"{len(first)} ambiguous answers (one hidden effect), {len(every)} of them with a manoeuvre that can be "
           "driven at the end of the log. Named: by its own id, alone. In brackets: Wilson 95 % intervals. "
           f"{minutes:.0f} min.",
           "", "| manoeuvre | named before | named after | true effect among what is said, before | after |",
           "|---|---|---|---|---|"]
    for word, some in [*sorted(by_way.items()), ("all", every)]:
        old, new = [p[0] for p in some], [p[1] for p in some]
        out.append(f"| {word} | {named(old)} | {named(new)} | {held(old)} | {held(new)} |")
    out += ["", "| not told apart | manoeuvre | n | named after | said after |", "|---|---|---|---|---|"]
    for pair, cases in sorted(by_pair.items(), key=lambda item: -len(item[1])):
        ways = ", ".join(f"{w} {n}" for w, n in Counter(c[2] for c in cases).most_common())
        words = Counter(c[1].answer if c[1].verdict in ("named", c[1].answer) else f"{c[1].answer} ({c[1].verdict})"
                        for c in cases)
        said = ", ".join(f"{a} {n}" for a, n in words.most_common(4))
        out.append(f"| {pair} | {ways} | {len(cases)} | {named([c[1] for c in cases])} | {said} |")
    if plans:
        out += ["", "Proposed, but not to be driven at the end of a log:", "",
                *(f"- {plan} ({n})" for plan, n in plans.most_common())]
    return "\n".join(out) + "\n"


def main() -> int:
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--seed", type=int, default=1)
    a.add_argument("--most", type=int, default=60, help="ambiguous answers asked again")
    a.add_argument("--jobs", type=int, default=2)
    a.add_argument("--keep", type=Path, default=ROOT / ".benchmarks" / "diagnosis")
    a.add_argument("--out", type=Path)
    args = a.parse_args()
    path = args.keep / f"{args.seed}-all-plan-{code_hash()}.jsonl"
    if not path.exists():
        sys.exit(f"{path}: not there: run benchmarks/diagnosis/run.py --seed {args.seed} first")
    began = time.monotonic()
    first = ambiguous(done_in(path))[:args.most]
    with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
        second: list[dict[str, Any] | None] = []
        for new in pool.imap(again, first):
            second.append(new)
            print(f"\r{len(second)}/{len(first)} ", end="", file=sys.stderr, flush=True)
    text = report(first, second, (time.monotonic() - began) / 60.0)
    if args.out is None:
        print(text)
    else:
        args.out.write_text(text, encoding="utf-8", newline="\n")
    return exit_code({"at least one answer is ambiguous": first, "at least one manoeuvre was driven": any(second)})


if __name__ == "__main__":
    sys.exit(main())
