"""The rival that learns: gradient boosting of scikit-learn on features of the residual.

One classifier sees pairs of a case and a label (an effect id, `none`, `unknown`), so that what it
learns of one fault serves the others; isotonic regression on folds that hold whole cases out makes
probabilities. `learn.py` trains it.
"""

from __future__ import annotations

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from peers import TRAINED, find_by_least_squares, find_by_ruptures, list_odds, measure_rest
from plain import Floats, Plain, count_rows, fit_channel, read_case

KINDS = ("run", "lag", "catch", "weigh", "heads", "place")
CHANNELS = ("shaft", "gate", "flow", "speed", "heads", "lag", "catch", "weigh", "place")


def list_features(case: Plain, labels: list[str]) -> Floats:
    """Returns a row of features for each label (len(labels), n)."""
    plain, onset = find_by_least_squares(case), find_by_ruptures(case)
    odds, later = list_odds(plain), list_odds(onset)
    fits = [fit_channel(channel, case.tolerances) for channel in case.channels]
    whole: list[float] = [float(KINDS.index(case.kind))]
    by_name = {channel.name: channel for channel in case.channels}
    for name in CHANNELS:
        channel = by_name.get(name)
        if channel is None:
            whole += [np.nan] * 7
            continue
        left, moved = channel.left, np.diff(channel.left)
        spread = left.std() + 1e-12
        whole += [
            np.log(spread),
            np.log(moved.std() + 1e-12),
            left.mean() / spread,
            np.log(np.mean(np.abs(left - left.mean()) ** 4) / spread**4 + 1e-3),
            np.log(count_rows(left)),
            measure_rest(left),
            # What the second half has more than the first.
            (left[len(left) // 2 :].mean() - left[: len(left) // 2].mean()) / spread,
        ]
    ranked = sorted((v for n, v in odds.items() if "." in n), reverse=True)
    best = [*ranked, -50.0, -50.0][:2]
    rows = []
    for k, label in enumerate(labels):
        own = odds.get(label, np.nan)
        group = [v for n, v in odds.items() if n.split(".")[0] == label.split(".")[0]]
        size, sd = plain.sizes.get(label, (np.nan, np.nan))
        gains = [one[label] for one in fits if label in one]
        rows.append(
            [
                float(k),
                own,
                later.get(label, np.nan),
                own - best[0],
                *best,
                max(group, default=np.nan),
                size,
                size / sd if sd else np.nan,
                max((one.gain for one in gains), default=np.nan),
                max((one.share for one in gains), default=np.nan),
                plain.left,
                *whole,
            ]
        )
    return np.nan_to_num(np.array(rows, float), nan=-99.0, posinf=1e6, neginf=-1e6)


@cache
def _load_model(name: str) -> Any:
    return pickle.loads((TRAINED / f"{name}.pickle").read_bytes())


def diagnose(name: str, data: Path, machine: Path) -> dict[str, Any]:
    """Returns the answer of a trained classifier."""
    labels, model = _load_model(name)
    case = read_case(data, machine)
    p = model.predict_proba(list_features(case, labels))[:, 1]
    said = dict(zip(labels, p.tolist(), strict=True))
    return {
        "causes": {n: x for n, x in said.items() if "." in n},
        "none": said["none"],
        "unknown": said["unknown"],
        "size": {
            n: [size - 1.645 * sd, size, size + 1.645 * sd]
            for n, (size, sd) in find_by_least_squares(case).sizes.items()
            if np.isfinite(sd)
        },
        "machine": None,
    }


def diagnose_learner(data: Path, machine: Path) -> dict[str, Any]:
    """The classifier of all training cases."""
    return diagnose("learner", data, machine)


def diagnose_learner_300(data: Path, machine: Path) -> dict[str, Any]:
    """That of 300 training cases."""
    return diagnose("learner_300", data, machine)


def diagnose_learner_100(data: Path, machine: Path) -> dict[str, Any]:
    """That of 100 training cases."""
    return diagnose("learner_100", data, machine)
