"""What other methods make of the same runs: lmfit + BIC, a random forest, pysindy, a spline.

    python benchmarks/diagnosis/peers.py --train 300 --test 300 --jobs 2 --out docs/benchmark-diagnosis-peers.md

Needs requirements-peers.txt. Trained and calibrated on the tuning half (each threshold is set so that at most 1 % of
its runs with nothing hidden raise an alarm), examined on the unseen half. Every peer gets evidence.py's linear problem.
"""
from __future__ import annotations

import argparse
import multiprocessing
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "diagnosis"))

from evidence import Evidence, drive_of, evidence, poured
from hidden.cases import one
from hidden.nominal import Effect, Physics
from hidden.plant import Plant
from hidden.report import report
from hidden.score import mark

Score = Callable[[Evidence], list[tuple[str, float, float]]]      # (id, size, what adding it gained), best first
MOST_CAUSES = 3


class Job(NamedTuple):
    truth: dict[str, Any]
    evidence: Evidence
    spline: float | None          # share of the removable error that a spline removed on held-out rows


def prepare(task: tuple[int, int, str]) -> Job:
    """Case -> evidence, in a process of its own."""
    number, seed, half = task
    case = one(number, seed, half, kinds=("run",))
    return Job(case.truth, evidence(case.columns), spline_gain(case.truth, case.columns))


# -- the methods -----------------------------------------------------------------------------------------------------

def _problem(e: Evidence) -> tuple[Any, Any]:
    """Design (coordinates + priors, effects + nuisances) and target of the penalised least squares."""
    k = len(e.nuisances)
    design = np.vstack([np.hstack([e.traces.T, e.nuisances.T]), np.hstack([np.zeros((k, len(e.traces))), np.eye(k)])])
    return design, np.r_[e.target, -e.moved]


def lmfit_bic(e: Evidence) -> list[tuple[str, float, float]]:
    """One cause after another, each fitted by lmfit with all nuisances; the drop in BIC is what it gained."""
    import lmfit

    design, y = _problem(e)
    count = len(e.effects)
    # nuisances are linear: taken out once, so that lmfit fits sizes only
    jq, _ = np.linalg.qr(design[:, count:])
    x = design[:, :count] - jq @ (jq.T @ design[:, :count])
    y = y - jq @ (jq.T @ y)
    chosen: list[int] = []
    said: list[tuple[str, float, float]] = []
    before = float(y @ y)
    for _ in range(MOST_CAUSES):
        best = None
        for k in range(count):
            if k in chosen or np.linalg.norm(x[:, k]) < 1e-6 or e.effects[k].id in [s[0] for s in said]:
                continue
            now = [*chosen, k]
            if (y - x[:, chosen] @ np.linalg.lstsq(x[:, chosen], y, rcond=None)[0] if chosen else y) @ x[:, k] == 0:
                continue
            left = _left(x[:, now], y)
            if best is None or left < best[1]:
                best = (k, left)
        if best is None:
            break
        chosen.append(best[0])
        parameters = lmfit.Parameters()
        for k in chosen:
            parameters.add(f"s{k}", value=0.0)
        fit = lmfit.minimize(lambda p, c=tuple(chosen): y - x[:, list(c)] @ np.array([p[f"s{k}"].value for k in c]),
                             parameters, method="leastsq")
        said.append((e.effects[best[0]].id, e.effects[best[0]].size * fit.params[f"s{best[0]}"].value,
                     before - best[1] - np.log(e.rows)))
        before = best[1]
    return said


def _left(x: Any, y: Any) -> float:
    r = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    return float(r @ r)


def sindy(e: Evidence, optimizer: str) -> list[tuple[str, float, float]]:
    """Effects as a library of candidate functions; pysindy's optimiser picks a sparse combination."""
    import pysindy

    design, y = _problem(e)
    count = len(e.effects)
    jq, _ = np.linalg.qr(design[:, count:])
    x = design[:, :count] - jq @ (jq.T @ design[:, :count])
    y = y - jq @ (jq.T @ y)
    norms = np.linalg.norm(x, axis=0)
    use = np.flatnonzero(norms > 1e-6)
    x = x[:, use] / norms[use]
    made = pysindy.FROLS(max_iter=MOST_CAUSES) if optimizer == "FROLS" else pysindy.STLSQ(threshold=4.5, alpha=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        weights = np.ravel(made.fit(x, y[:, None]).coef_)
    picked = [k for k in np.argsort(-np.abs(weights)) if weights[k] != 0.0][:12]
    said = []
    for k in picked:
        others = [j for j in picked if j != k]
        gain = (_left(x[:, others], y) if others else float(y @ y)) - _left(x[:, picked], y)
        said.append((e.effects[use[k]].id, e.effects[use[k]].size * weights[k] / norms[use[k]], gain))
    return sorted(said, key=lambda s: -s[2])


class Forest:
    """A random forest on residual features and matched scores, taught with simulated faults of the tuning half."""

    def __init__(self, jobs: Sequence[Job], seed: int) -> None:
        from sklearn.ensemble import RandomForestClassifier

        self.ids = sorted({e.id for j in jobs for e in j.evidence.effects})
        self.model = RandomForestClassifier(400, random_state=seed, n_jobs=1, class_weight="balanced_subsample",
                                            oob_score=True)
        used = [j for j in jobs if j.truth["category"] != "pair"]
        self.model.fit([self._row(j.evidence) for j in used], [self._label(j.truth) for j in used])
        self.labels = [self._label(j.truth) for j in used]
        self.out_of_bag = self.model.oob_decision_function_

    def _label(self, truth: dict[str, Any]) -> str:
        return "outside" if truth["outside"] else truth["causes"][0]["id"] if truth["causes"] else "none"

    def _row(self, e: Evidence) -> Any:
        scores = dict.fromkeys(self.ids, 0.0)
        for effect, trace in zip(e.effects, e.traces, strict=True):
            size = np.linalg.norm(trace)
            s = float(trace @ e.target / size) if size > 1e-9 else 0.0
            if abs(s) > abs(scores.get(effect.id, 0.0)):
                scores[effect.id] = s
        return np.r_[e.features, [np.arcsinh(scores[i]) for i in self.ids]]

    def __call__(self, e: Evidence) -> list[tuple[str, float, float]]:
        p = self.model.predict_proba([self._row(e)])[0]
        return self.said(p)

    def said(self, p: Any) -> list[tuple[str, float, float]]:
        """The likeliest class other than none; its odds against none are what decides."""
        names = list(self.model.classes_)
        none = p[names.index("none")]
        k = max((i for i in range(len(names)) if names[i] != "none"), key=lambda i: p[i])
        return [(str(names[k]), 0.0, float(np.log((p[k] + 1e-3) / (none + 1e-3))))]


def spline_gain(truth: dict[str, Any], columns: dict[str, Any]) -> float | None:
    """Share of the removable error that an additive spline over all variables removes on two fifths held out.

    The spline knows no names: it is the ceiling of a smooth corrector. Only for one hidden effect, in its own channel.
    """
    from scipy.interpolate import BSpline

    if truth["category"] != "single":
        return None
    c = truth["causes"][0]
    channel = {"shaft": "shaft", "gate": "gate", "flow": "scale", "scale": "scale", "speed": "wheel"}.get(
        c["id"].split(".")[0])
    if channel is None:
        return None
    plant = Plant(drive_of(columns))
    effect = Effect(c["id"], c["size"], c["form"], c["knob"], c["onset_s"], c["member"], c["seed"])
    clean, planted = plant.run(Physics()), plant.run(Physics(), (effect,))
    seen = {"shaft": "shaft_rpm", "gate": "opening_mm", "scale": "hopper_kg", "wheel": "wheel_speed_mps"}[channel]
    step = round(10.0 / plant.drive.row_s) if channel == "scale" else 4
    measured = columns[seen] - clean[channel]
    truth_d = planted[channel] - clean[channel]
    if channel == "scale":
        measured, truth_d = np.diff(measured[::step]), np.diff(truth_d[::step])      # kg in ten seconds
    else:
        measured, truth_d = measured[::step], truth_d[::step]
    rows = np.arange(measured.size) * step
    knots = np.r_[[0.0] * 4, np.linspace(0, 1, 7)[1:-1], [1.0] * 4]
    parts = [np.ones((rows.size, 1))]
    for name in ("pitch_deg", "roll_deg", "supply_v", "speed_mps", "shaft_rpm_cmd", "opening_mm_cmd", "time_s"):
        v = np.nan_to_num(columns[name][rows])
        spread = np.ptp(v)
        if spread > 1e-9:
            parts.append(BSpline.design_matrix(np.clip((v - v.min()) / spread, 0, 1 - 1e-9), knots, 3).toarray())
    x = np.hstack(parts)
    good = np.isfinite(measured) & ~(poured(columns)[rows] & (channel == "scale"))
    good &= np.abs(measured - np.nanmedian(measured[good])) < 6 * np.nanstd(measured[good])
    block = (plant.drive.time_s[rows] // 60.0).astype(int) % 5
    fit = good & (block % 2 == 0)                            # three blocks of a minute in five, the others held out
    w = np.linalg.solve(x[fit].T @ x[fit] + 1.0 * np.eye(x.shape[1]), x[fit].T @ measured[fit])
    held = good & (block % 2 == 1)
    there = float(np.mean(truth_d[held] ** 2))
    return 1.0 - float(np.mean((truth_d[held] - x[held] @ w) ** 2)) / there if there > 0 else None


# -- judged alike ----------------------------------------------------------------------------------------------------

def threshold(gains: Sequence[float]) -> float:
    """Exceeded by 1 % of the runs with nothing hidden; with fewer than a hundred, by none."""
    return float(np.quantile(gains, 0.99, method="higher")) if gains else 0.0


def answer(said: list[tuple[str, float, float]], least: float) -> dict[str, Any]:
    """In the shape of a diagnosis."""
    named = [s for s in said if s[2] > least]
    if any(s[0] == "outside" for s in named):
        return {"verdict": "unexplained", "causes": [], "unexplained": []}
    return {"verdict": "named" if named else "none", "unexplained": [],
            "causes": [{"id": i, "rivals": [], "member": None, "onset_s": None,
                        "size": {"value": s, "low": None, "high": None, "unit": ""}} for i, s, _ in named]}


def main() -> None:
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--train", type=int, default=300)
    a.add_argument("--test", type=int, default=300)
    a.add_argument("--seed", type=int, default=1)
    a.add_argument("--jobs", type=int, default=2)
    a.add_argument("--out", type=Path)
    args = a.parse_args()
    tasks = [(k, args.seed, half) for half, count in (("tuning", args.train), ("unseen", args.test))
             for k in range(count)]
    with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
        jobs = []
        for job in pool.imap(prepare, tasks):
            jobs.append(job)
            print(f"\r{len(jobs)}/{len(tasks)} ", end="", file=sys.stderr, flush=True)
    train, test = jobs[:args.train], jobs[args.train:]
    forest = Forest(train, args.seed)
    methods: dict[str, Score] = {
        "lmfit + BIC, one cause after another": lmfit_bic,
        "pysindy STLSQ on whitened traces": lambda e: sindy(e, "STLSQ"),
        "pysindy FROLS on whitened traces": lambda e: sindy(e, "FROLS"),
        "random forest on residual features": forest}
    out = [f"# Peers on the same runs, seed {args.seed}\n\n{args.train} runs of the tuning half to train and "
           f"calibrate, {args.test} of the unseen half to examine.\n"]
    for name, method in methods.items():
        if method is forest:
            nulls = [forest.said(p)[0][2] for p, label in zip(forest.out_of_bag, forest.labels, strict=True)
                     if label == "none"]
        else:
            nulls = [max((s[2] for s in method(j.evidence)), default=0.0) for j in train if not j.truth["causes"]
                     and not j.truth["outside"]]
        least = threshold(nulls)
        marks = [mark(j.truth, answer(method(j.evidence), least)) for j in test]
        head = report(marks, name).split("## One effect by detectability")[0]
        out.append(head.replace("# ", "## ", 1))
    gains = [j.spline for j in test if j.spline is not None and j.truth["causes"][0]["z"] >= 8]
    if gains:
        low, middle, high = np.quantile(gains, (0.25, 0.5, 0.75))
        out.append("## Spline corrector, z >= 8\n\nShare of the removable error removed on held-out rows: median "
                   f"{middle:.2f}, quartiles {low:.2f} to {high:.2f} (n = {len(gains)}); it names nothing.\n")
    text = "\n".join(out)
    if args.out:
        args.out.write_text(text, encoding="utf-8", newline="\n")
    else:
        print(text)


if __name__ == "__main__":
    main()
