"""The peers: each picks effects by its own rule from the same linear problem, nuisances taken out by their priors."""
from __future__ import annotations

import functools
import os
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from evidence import Evidence, Linear
from hidden.nominal import IDS, Effect

Floats = npt.NDArray[np.float64]
MOST_CAUSES = 3
PETAB_ROUNDS = 20
PATIENCE = {"forward": 1, "famos": 2}       # rounds without a better model: FAMoS turns round and goes on
PETAB_CANDIDATES = 8              # ids that it may choose from, the best by themselves: each model costs it a file


class Small(NamedTuple):
    """Least squares of sizes alone: `x` (m, effects) and `y` (m,) with the nuisances taken out; `use`: columns of `x`
    that anything is left of, and whose size by itself is possible."""

    x: Floats
    y: Floats
    use: npt.NDArray[np.int64]


class Said(NamedTuple):
    """One pick: effect's index, size in units of the trace, and what dropping it would cost of the sum of squares."""

    index: int
    size: float
    gain: float


Method = Callable[[Evidence, Small], list[int]]


def small(e: Evidence, linear: Linear) -> Small:
    """The problem without its nuisances."""
    k = len(linear.nuisances)
    design = np.vstack([np.hstack([linear.traces.T, linear.nuisances.T]),
                        np.hstack([np.zeros((k, len(linear.traces))), np.eye(k)])])
    y = np.r_[linear.target, -e.moved]
    jq, _ = np.linalg.qr(design[:, len(linear.traces):])
    x = design[:, :len(linear.traces)]
    x, y = x - jq @ (jq.T @ x), y - jq @ (jq.T @ y)
    use = [k for k, e_k in enumerate(e.effects) if np.linalg.norm(x[:, k]) > 1e-6
           and _possible(e_k, float(x[:, k] @ y / (x[:, k] @ x[:, k])))]
    return Small(x, y, np.array(use, np.int64))


def _possible(effect: Effect, times: float) -> bool:
    """By itself, the effect would have a size that the catalogue allows: a gate that stands still shows no play."""
    kind, size = IDS[effect.id], effect.size * times
    return abs(size) <= kind.most and (kind.sign == 0 or size * kind.sign > 0.0)


def left(s: Small, picks: Sequence[int]) -> float:
    """Sum of squares that the picks leave."""
    x = s.x[:, list(picks)]
    rest = s.y - x @ np.linalg.lstsq(x, s.y, rcond=None)[0] if len(picks) else s.y
    return float(rest @ rest)


def path(s: Small, picks: Sequence[int]) -> list[list[Said]]:
    """The picks, and again without the one that would be missed least, down to one."""
    out = []
    now = list(dict.fromkeys(picks))
    while now:
        sizes = np.linalg.lstsq(s.x[:, now], s.y, rcond=None)[0]
        whole = left(s, now)
        out.append([Said(k, float(b), left(s, [j for j in now if j != k]) - whole)
                    for k, b in zip(now, sizes, strict=True)])
        now.remove(min(out[-1], key=lambda one: one.gain).index)
    return out


def highest(s: Small, picks: Sequence[int]) -> float:
    """The threshold above which nothing of these picks would be said."""
    return max((min(one.gain for one in some) for some in path(s, picks)), default=0.0)


def above(s: Small, picks: Sequence[int], least: float) -> list[Said]:
    """The largest set on the path of which each member is worth more than `least`."""
    return next((some for some in path(s, picks) if min(one.gain for one in some) > least), [])


# -- the rules -------------------------------------------------------------------------------------------------------

def lmfit_bic(e: Evidence, s: Small) -> list[int]:
    """One cause after another, each fitted by lmfit, as long as BIC falls."""
    import lmfit

    chosen: list[int] = []
    before = left(s, [])
    while len(chosen) < MOST_CAUSES:
        free = [int(k) for k in s.use if e.effects[k].id not in {e.effects[j].id for j in chosen}]
        if not free:
            break
        best = min(free, key=lambda k: left(s, [*chosen, k]))
        parameters = lmfit.Parameters()
        for k in (*chosen, best):
            parameters.add(f"s{k}", value=0.0)

        def rest(p: Any, picks: tuple[int, ...] = (*chosen, best)) -> Floats:
            return np.asarray(s.y - s.x[:, list(picks)] @ np.array([p[f"s{k}"].value for k in picks]))

        after = float(np.sum(lmfit.minimize(rest, parameters, method="leastsq").residual ** 2))
        if before - after <= np.log(e.rows):
            break
        chosen.append(best)
        before = after
    return chosen


def _sindy(s: Small, optimizer: Any) -> list[int]:
    norms = np.linalg.norm(s.x[:, s.use], axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        weights = np.ravel(optimizer.fit(s.x[:, s.use] / norms, s.y[:, None]).coef_)
    order = [int(k) for k in np.argsort(-np.abs(weights)) if weights[k] != 0.0]
    return [int(s.use[k]) for k in order[:12]]


def stlsq(e: Evidence, s: Small) -> list[int]:
    """pysindy's sequentially thresholded least squares; threshold 4.5 standard deviations."""
    import pysindy

    return _sindy(s, pysindy.STLSQ(threshold=4.5, alpha=1e-6))


def frols(e: Evidence, s: Small) -> list[int]:
    """pysindy's forward orthogonal least squares, three terms at most."""
    import pysindy

    return _sindy(s, pysindy.FROLS(max_iter=MOST_CAUSES))


class PetabSelect:
    """petab-select drives the search, by `method`; calibration is our likelihood (whitened), the criterion BIC."""

    def __init__(self, method: str) -> None:
        import petab.v1

        petab.v1.Problem.from_yaml = functools.cache(petab.v1.Problem.from_yaml)    # it reads it again for each model
        self.method = method
        self.folder = Path(tempfile.mkdtemp(prefix="petab-"))
        names = [f"s{k}" for k in range(PETAB_CANDIDATES)]
        (self.folder / "parameters.tsv").write_text(
            "parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate\n"
            + "".join(f"{n}\tlin\t-1e6\t1e6\t0\t1\n" for n in names), encoding="utf-8")
        (self.folder / "problem.yaml").write_text(
            "format_version: 1\nparameter_file: parameters.tsv\nproblems:\n- sbml_files: []\n  measurement_files: []\n"
            "  condition_files: []\n  observable_files: []\n", encoding="utf-8")
        (self.folder / "space.tsv").write_text(
            "model_subspace_id\tmodel_subspace_petab_yaml\t" + "\t".join(names) + "\nM1\tproblem.yaml\t"
            + "\t".join(["0;estimate"] * len(names)) + "\n", encoding="utf-8")
        swaps = f"candidate_space_arguments:\n  swap_parameter_sets: [[{', '.join(names)}]]\n"
        more = swaps if method == "famos" else ""
        (self.folder / "select.yaml").write_text(
            f"format_version: 1.0.0\ncriterion: BIC\nmethod: {method}\nmodel_space_files: [space.tsv]\n{more}",
            encoding="utf-8")

    def __call__(self, e: Evidence, s: Small) -> list[int]:
        import petab_select
        from petab_select.constants import CANDIDATE_SPACE, TERMINATE, UNCALIBRATED_MODELS, Criterion

        candidates = self._candidates(e, s)

        def picks_of(model: Any) -> list[int]:
            return [candidates[int(name[1:])] for name in model.get_estimated_parameter_ids()
                    if int(name[1:]) < len(candidates)]

        here = Path.cwd()
        os.chdir(self.folder)             # it writes a summary where it stands
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                problem = petab_select.Problem.from_yaml(self.folder / "select.yaml")
                space, best, idle = None, None, 0
                for _ in range(PETAB_ROUNDS):
                    before = best
                    iteration = petab_select.ui.start_iteration(problem=problem, candidate_space=space)
                    space = iteration[CANDIDATE_SPACE]
                    calibrated = petab_select.Models()
                    for model in iteration[UNCALIBRATED_MODELS]:
                        picks = picks_of(model)
                        value = left(s, picks) + len(model.get_estimated_parameter_ids()) * float(np.log(e.rows))
                        model.set_criterion(Criterion.BIC, value)
                        model.set_criterion(Criterion.NLLH, 0.5 * left(s, picks))
                        calibrated.append(model)
                        if best is None or value < best[0]:
                            best = (value, picks)
                    if petab_select.ui.end_iteration(problem=problem, candidate_space=space,
                                                     calibrated_models=calibrated)[TERMINATE]:
                        break
                    idle = idle + 1 if best == before else 0
                    if idle == PATIENCE[self.method]:
                        break             # it would go on with pairs, triples ... of what did not help
        finally:
            os.chdir(here)
        return best[1] if best is not None else []

    def _candidates(self, e: Evidence, s: Small) -> list[int]:
        """The best trace of each id, the best ids first."""
        scores = {int(k): abs(float(s.x[:, k] @ s.y)) / float(np.linalg.norm(s.x[:, k])) for k in s.use}
        found: dict[str, int] = {}
        for k in sorted(scores, key=lambda k: -scores[k]):
            found.setdefault(e.effects[k].id, k)
        return list(found.values())[:PETAB_CANDIDATES]


class Forest:
    """A random forest on every effect's matched score, taught with faults simulated on tuning drives."""

    FAULTS_A_DRIVE = 60

    def __init__(self, evidences: Sequence[Evidence], seed: int) -> None:
        from sklearn.ensemble import RandomForestClassifier

        self.ids = sorted({e.id for one in evidences for e in one.effects})
        rng = np.random.default_rng(seed)
        rows, labels = [], []
        for e in evidences:
            s = small(e, e.white)
            for _ in range(self.FAULTS_A_DRIVE):
                y = rng.normal(size=len(s.y))
                k = int(rng.choice(s.use)) if rng.random() < 0.8 else -1
                if k >= 0:
                    z = float(np.exp(rng.uniform(np.log(2.0), np.log(40.0))))
                    y = y + s.x[:, k] * z / np.linalg.norm(s.x[:, k])
                rows.append(self._row(e, s._replace(y=y)))
                labels.append(e.effects[k].id if k >= 0 else "none")
        self.model = RandomForestClassifier(300, random_state=seed, n_jobs=1, class_weight="balanced_subsample")
        self.model.fit(rows, labels)

    def _row(self, e: Evidence, s: Small) -> Floats:
        scores = dict.fromkeys(self.ids, 0.0)
        for k in s.use:
            score = float(s.x[:, k] @ s.y) / float(np.linalg.norm(s.x[:, k]))
            if abs(score) > abs(scores.get(e.effects[k].id, 0.0)):
                scores[e.effects[k].id] = score
        return np.arcsinh([scores[i] for i in self.ids])

    def odds(self, e: Evidence) -> tuple[str, float]:
        """The likeliest effect and the logarithm of its odds against none."""
        p = self.model.predict_proba([self._row(e, small(e, e.white))])[0]
        names = [str(n) for n in self.model.classes_]
        none = p[names.index("none")]
        k = max((i for i in range(len(names)) if names[i] != "none"), key=lambda i: p[i])
        return names[k], float(np.log((p[k] + 1e-3) / (none + 1e-3)))
