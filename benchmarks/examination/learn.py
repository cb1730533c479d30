"""Trains what learns in the examination, on cases of its own: drive programmes of the other half.

    python benchmarks/examination/learn.py --cases 1000 --seed 1

It writes the training cases with their truth, then the isotonic maps of the peers, the shares that
the constant says, and the classifiers of 100, 300 and all cases. A call that was cut goes on.
"""

from __future__ import annotations

import argparse
import json
import pickle
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [
    str(Path(__file__).resolve().parent),
    str(ROOT),
    str(ROOT / "tests" / "diagnosis"),
]

import numpy as np  # noqa: E402

FOLDER = ROOT / ".benchmarks" / "examination"
SIZES = (100, 300)


def describe_case(number: int, seed: int, folder: Path) -> dict[str, Any]:
    """Makes a training case and returns what learning needs: truth, odds of each peer, features."""
    from cases import write_case
    from learner import list_features
    from peers import FINDERS, list_odds
    from plain import read_case
    from topdress.control.machine.machine import CATALOGUE

    case = write_case(number, seed, folder, "tuning", is_scored=False)
    data = next(p for p in (case.folder / "log.csv", case.folder / "bench.csv") if p.exists())
    plain = read_case(data, case.folder / "machine.yaml")
    labels = [*CATALOGUE, "none", "unknown"]
    return {
        "number": number,
        "truth": json.loads((case.truth / "truth.json").read_text(encoding="utf-8")),
        "odds": {name: list_odds(find(plain)) for name, find in FINDERS.items()},
        "features": list_features(plain, labels).tolist(),
    }


def list_there(truth: dict[str, Any]) -> set[str]:
    """Returns the labels that are true of a case, with those that leave the same trace."""
    there = {*truth["ids"], *(word for word in ("none", "unknown") if truth[word])}
    return there | {other for name in truth["ids"] for other in truth["alike"].get(name, ())}


def fit_maps(name: str, known: list[dict[str, Any]], share: dict[str, float]) -> dict[str, Any]:
    """Returns the isotonic map of a peer, log odds to probability, for causes, none, unknown."""
    from sklearn.isotonic import IsotonicRegression

    maps: dict[str, Any] = {"share": share}
    for kind in ("cause", "none", "unknown"):
        pairs = [
            (odds, label in list_there(one["truth"]))
            for one in known
            for label, odds in one["odds"][name].items()
            if (label if label in ("none", "unknown") else "cause") == kind
        ]
        x, y = np.array(pairs, float).T
        fit = IsotonicRegression(y_min=1e-3, y_max=1.0 - 1e-3, out_of_bounds="clip").fit(x, y)
        maps[kind] = [fit.X_thresholds_.tolist(), fit.y_thresholds_.tolist()]
    return maps


def fit_classifier(known: list[dict[str, Any]], labels: list[str]) -> Any:
    """Returns gradient boosting with isotonic calibration on folds of whole cases."""
    from sklearn.calibration import CalibratedClassifierCV
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.model_selection import GroupKFold

    x = np.concatenate([one["features"] for one in known])
    y = np.array([label in list_there(one["truth"]) for one in known for label in labels])
    groups = np.repeat(np.arange(len(known)), len(labels))
    folds = list(GroupKFold(5).split(x, y, groups))
    boosted = HistGradientBoostingClassifier(
        max_iter=200, learning_rate=0.06, max_leaf_nodes=15, l2_regularization=1.0, random_state=1
    )
    return CalibratedClassifierCV(boosted, method="isotonic", cv=folds).fit(x, y)


def main() -> int:
    """Makes the cases and trains."""
    from cases import TURNS
    from peers import FINDERS
    from topdress.control.machine.machine import CATALOGUE

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--cases", type=int, default=1000)
    a.add_argument("--seed", type=int, default=1)
    a.add_argument("--minutes", type=float, default=240.0, help="then what is there is learnt from")
    a.add_argument("--folder", type=Path, default=FOLDER)
    args = a.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    lines, known, began = args.folder / f"training-{args.seed}.jsonl", [], time.monotonic()
    if lines.exists():
        known = [json.loads(line) for line in lines.read_text(encoding="utf-8").splitlines()]
    numbers = {one["number"] for one in known}
    for number in range(args.cases):
        if number in numbers or time.monotonic() - began > 60.0 * args.minutes:
            continue
        known.append(describe_case(number, args.seed, args.folder / "training"))
        with lines.open("a", encoding="utf-8", newline="\n") as out:
            out.write(json.dumps(known[-1]) + "\n")
        print(f"\r{len(known)}/{args.cases}", end="", file=sys.stderr, flush=True)
    trained = args.folder / "trained"
    trained.mkdir(exist_ok=True)
    labels = [*CATALOGUE, "none", "unknown"]
    truths = [{*one["truth"]["ids"]} for one in known]
    share = {n: (sum(n in ids for ids in truths) + 0.5) / (len(truths) + 1.0) for n in CATALOGUE}
    constant = {
        "causes": share,
        **{w: sum(one["truth"][w] for one in known) / len(known) for w in ("none", "unknown")},
    }
    (trained / "constant.json").write_text(json.dumps(constant, indent=1), encoding="utf-8")
    for name in FINDERS:
        maps = json.dumps(fit_maps(name, known, share))
        (trained / f"{name}.json").write_text(maps, encoding="utf-8")
    for count in (*SIZES, len(known)):
        if count <= len(known):
            # Whole turns of the kinds, so that a small share holds them as the whole does.
            some = known[: count - count % len(TURNS)]
            name = "learner" if count == len(known) else f"learner_{count}"
            model = (labels, fit_classifier(some, labels))
            (trained / f"{name}.pickle").write_bytes(pickle.dumps(model))
            print(f"\n{name}: {len(some)} cases", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
