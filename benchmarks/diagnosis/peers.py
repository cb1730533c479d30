"""What other methods make of the same runs: pysindy, lmfit + BIC, petab-select, a random forest, SysIdentPy, a spline.

    python -m benchmarks diagnosis/run ... --peers [--peer-cases 200] [--sysident PYTHON]

or, without our diagnosis beside them, `python -m benchmarks diagnosis/peers --test 200`. Needs the extra `benchmark`;
SysIdentPy runs in an environment of its own. Every peer gets evidence.py's linear problem, whitened with the noise
model of the diagnosis; some also without. Calibrated alike: each threshold is the highest value among sixty runs of
the tuning half with nothing hidden. The runs are the first of the timetable, of both halves.
"""
from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "diagnosis"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import peers_methods as peers
from evidence import Evidence
from hidden.report import FIGURES, Figure
from hidden.score import Mark, mark
from peers_cases import NULLS, Job, prepared, tasks
from peers_methods import Small, small
from verdict import exit_code

SHOWN = (0, 1, 2, 6, 7, 8, 11, 12)        # of the examination's figures, those that every method can be asked


# -- judged alike ----------------------------------------------------------------------------------------------------

STRICT, LENIENT = 0.99, 0.95      # share of the nulls that stays silent; of sixty, all, and all but three


class Peer(NamedTuple):
    """`answers`: one for each test job, in the shape of a diagnosis; `lenient`: the same at the lower threshold."""

    name: str
    answers: list[dict[str, Any]]
    lenient: list[dict[str, Any]]
    threshold: float
    seconds: float                # for all of them, evidence not counted


def threshold(highest: Sequence[float], level: float = STRICT) -> float:
    """Not exceeded by this share of the runs with nothing hidden, or a little more of them."""
    return float(np.quantile(highest, level, method="higher")) if highest else 0.0


def answer(names: Iterable[str], sizes: Iterable[float]) -> dict[str, Any]:
    """In the shape of a diagnosis."""
    causes = [{"id": i, "rivals": [], "member": None, "onset_s": None,
               "size": {"value": s, "low": None, "high": None, "unit": ""}} for i, s in zip(names, sizes, strict=True)]
    return {"verdict": "named" if causes else "none", "unexplained": [], "causes": causes}


def by_picks(name: str, picks: list[list[int]], test: Sequence[Job], nulls: Sequence[Job], whitened: bool,
             began: float) -> Peer:
    """`picks`: of every test job, then of every null."""
    problems = [small(j.evidence, j.evidence.white if whitened else j.evidence.plain) for j in (*test, *nulls)]
    highest = [peers.highest(s, p) for s, p in zip(problems[len(test):], picks[len(test):], strict=True)]

    def answers(least: float) -> list[dict[str, Any]]:
        out = []
        for job, s, p in zip(test, problems, picks, strict=False):
            said = peers.above(s, p, least)
            effects = [job.evidence.effects[one.index] for one in said]
            out.append(answer([e.id for e in effects],
                              [e.size * one.size for e, one in zip(effects, said, strict=True)]))
        return out

    least = threshold(highest)
    return Peer(name, answers(least), answers(threshold(highest, LENIENT)), least, time.perf_counter() - began)


def by_rule(name: str, rule: Callable[[Evidence, Small], list[int]], test: Sequence[Job], nulls: Sequence[Job],
            whitened: bool = True) -> Peer:
    """A peer of peers_methods."""
    began = time.perf_counter()
    picks = []
    for j in (*test, *nulls):
        picks.append(rule(j.evidence, small(j.evidence, j.evidence.white if whitened else j.evidence.plain)))
        print(f"\r{name}: {len(picks)} ", end="", file=sys.stderr, flush=True)
    return by_picks(name, picks, test, nulls, whitened, began)


def by_forest(test: Sequence[Job], nulls: Sequence[Job], seed: int) -> Peer:
    """Taught on half of the null drives, its threshold from the other half."""
    began = time.perf_counter()
    half = len(nulls) // 2
    forest = peers.Forest([j.evidence for j in nulls[:half]], seed)
    highest = [forest.odds(j.evidence)[1] for j in nulls[half:]]
    said = [forest.odds(j.evidence) for j in test]

    def answers(least: float) -> list[dict[str, Any]]:
        return [answer([i], [0.0]) if odds > least else answer([], []) for i, odds in said]

    return Peer("random forest on matched scores", answers(threshold(highest)), answers(threshold(highest, LENIENT)),
                threshold(highest), time.perf_counter() - began)


def by_sysident(python: Path, test: Sequence[Job], nulls: Sequence[Job]) -> Peer:
    """SysIdentPy in its own environment, on files. Raises CalledProcessError where that fails."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        arrays: dict[str, Any] = {}
        for k, j in enumerate((*test, *nulls)):
            s = small(j.evidence, j.evidence.white)
            arrays |= {f"x{k}": s.x, f"y{k}": s.y}
        np.savez(f"{folder}/problems.npz", **arrays)
        subprocess.run([str(python), str(Path(__file__).parent / "peers_sysident.py"), f"{folder}/problems.npz",
                        f"{folder}/picks.json"], check=True)
        picks = json.loads(Path(f"{folder}/picks.json").read_text(encoding="utf-8"))
    return by_picks("SysIdentPy FROLS, whitened", picks, test, nulls, True, began)


Ask = Callable[[], Peer]


def all_peers(test: Sequence[Job], nulls: Sequence[Job], seed: int, sysident: Path | None) -> list[Peer]:
    """Every peer that is installed; one that is not is said on stderr."""
    def rule(name: str, of: Callable[[Evidence, Small], list[int]], whitened: bool = True) -> tuple[str, Ask]:
        return name, lambda: by_rule(name, of, test, nulls, whitened)

    rules: list[tuple[str, Ask]] = [
        rule("pysindy STLSQ, whitened", peers.stlsq), rule("pysindy STLSQ, not whitened", peers.stlsq, False),
        rule("pysindy FROLS, whitened", peers.frols), rule("pysindy FROLS, not whitened", peers.frols, False),
        rule("lmfit + BIC, cause by cause, whitened", peers.lmfit_bic),
        ("random forest on matched scores", lambda: by_forest(test, nulls, seed)),
        rule("petab-select forward, our likelihood", peers.PetabSelect("forward")),
        rule("petab-select FAMoS, our likelihood", peers.PetabSelect("famos"))]
    if sysident is not None:
        rules.append(("SysIdentPy", lambda: by_sysident(sysident, test, nulls)))
    found = []
    for name, ask in rules:
        try:
            found.append(ask())
        except (ImportError, subprocess.CalledProcessError) as error:
            print(f"\n{name}: left out: {error}", file=sys.stderr)
    return found


def report(found: Sequence[Peer], test: Sequence[Job], nulls: int, seed: int,
           ours: dict[int, dict[str, Any]] | None) -> str:
    """Markdown. `ours`: number -> what run.py kept of it; None or incomplete: no line of ours."""
    lines: list[tuple[str, list[Mark], str]] = []
    numbers = [int(j.truth["number"]) for j in test]
    if ours is not None and all(n in ours for n in numbers):
        marks = [mark(ours[n]["truth"], ours[n]["answer"], ours[n]["seconds"], ours[n]["gain_share"]) for n in numbers]
        lines.append(("**topdress**", marks, f"{sum(ours[n]['seconds'] for n in numbers) / len(numbers):.2f}"))
    lenient = list(lines)
    for peer in found:
        seconds = f"{peer.seconds / (len(test) + nulls):.2f}"
        for rows, answers in ((lines, peer.answers), (lenient, peer.lenient)):
            rows.append((peer.name, [mark(j.truth, a) for j, a in zip(test, answers, strict=True)], seconds))
    figures = [FIGURES[k] for k in SHOWN]
    out = ["# Peers on the same runs", "",
           f"The first {len(test)} runs of the timetable of seed {seed}, both halves. In brackets: Wilson 95 % "
           f"intervals. Each peer's threshold is the highest value among {nulls} runs of the tuning half with nothing "
           "hidden. Every peer is given the residuals and the trace of every effect by the very simulator that made "
           "the cases, which our diagnosis is not. A peer that names nothing but from the catalogue cannot be right "
           "outside of it.", "",
           *_table(lines, figures), "", "The same with a lower threshold, which three of the sixty exceed:", "",
           *_table(lenient, figures)]
    gains = [j.spline for j in test if j.spline is not None and j.truth["causes"][0]["z"] >= 8]
    if gains:
        low, middle, high = np.quantile(gains, (0.25, 0.5, 0.75))
        out += ["", "Spline corrector, one effect of z >= 8: it removes of the removable error on held-out rows, in "
                    f"the median, {middle:.2f} (quartiles {low:.2f} to {high:.2f}, n = {len(gains)}); it names none."]
    return "\n".join(out) + "\n"


def _table(lines: Sequence[tuple[str, list[Mark], str]], figures: Sequence[Figure]) -> list[str]:
    return ["| method | " + " | ".join(f"{f.title} ({f.goal})" if f.goal else f.title for f in figures)
            + " | s a run |", "|---|" + "---|" * (len(figures) + 1),
            *(f"| {name} | " + " | ".join(f.cell(marks) for f in figures) + f" | {seconds} |"
              for name, marks, seconds in lines)]


def compared(test: int, nulls: int, seed: int, jobs: int, sysident: Path | None,
             ours: dict[int, dict[str, Any]] | None) -> tuple[str, dict[str, object]]:
    """Prepares, asks all peers, reports; and what should be so of it."""
    everything = prepared(tasks(test, nulls, seed), jobs)
    found = all_peers(everything[:test], everything[test:], seed, sysident)
    return report(found, everything[:test], nulls, seed, ours), {
        f"{len(everything)} runs prepared: {test + nulls}": len(everything) == test + nulls > 0,
        "at least one peer is installed and answered": found,
        "at least one peer named something": any(a["causes"] for peer in found for a in peer.answers)}


def main() -> int:
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--test", type=int, default=200)
    a.add_argument("--nulls", type=int, default=NULLS)
    a.add_argument("--seed", type=int, default=1)
    a.add_argument("--jobs", type=int, default=2)
    a.add_argument("--sysident", type=Path, help="python of SysIdentPy's environment")
    a.add_argument("--prepare", action="store_true", help="make the evidence and stop")
    a.add_argument("--out", type=Path)
    args = a.parse_args()
    if args.prepare:
        return exit_code({"at least one run is prepared": prepared(tasks(args.test, args.nulls, args.seed), args.jobs)})
    text, promises = compared(args.test, args.nulls, args.seed, args.jobs, args.sysident, None)
    if args.out:
        args.out.write_text(text, encoding="utf-8", newline="\n")
    else:
        print(text)
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())
