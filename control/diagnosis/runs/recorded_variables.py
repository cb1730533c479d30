"""Which of a log's further columns something may depend on: those that say something of their own, and not too many.

A bus log has thousands of signals. Products of any two are tried, so that time and memory grow with the square of their
number, and so does the chance that one of them fits by accident. Of too many, those are kept that go best with what the
readings leave over their commands, a channel at a time (sure independence screening: Fan and Lv, J. R. Statist. Soc. B
70, 2008).
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

MOST = 24                   # besides the ten published variables: 560 products of two
PIECES = 400                # means of so many pieces of the log are held against each other: transients are over in one
LEAST_PIECES = 20
COPY = 0.99999              # correlation of rows: the same reading, in another unit or rounded
ROWS_COMPARED = 4_000
LONGEST_NAME = 200          # letters; as `control.machine.terms` takes them
LEAST_SPREAD = 1e-3         # of a column in its own unit: coefficients over less are beyond what a machine file takes
SHOWN = 3


class Kept(NamedTuple):
    columns: dict[str, Array]           # (n,) each
    said: tuple[str, ...]               # what was left out, a sentence each


def worth_asking(further: Mapping[str, Array], known: Mapping[str, Array]) -> Kept:
    """Of further columns (n,) those that are asked about.

    known : the published columns (n,), NaN where not known.
    """
    said: list[str] = []
    named = {name: values for name, values in further.items() if 0 < len(name.strip()) <= LONGEST_NAME}
    _say(said, [name for name in further if name not in named],
         f"without a name, or with one of more than {LONGEST_NAME} letters")
    wide = {name: values for name, values in named.items() if _spread(values) >= LEAST_SPREAD}
    _say(said, [name for name in named if name not in wide],
         f"changing by less than {LEAST_SPREAD:g}: in a smaller unit they could be judged")
    single = _without_copies(wide, known)
    _say(said, [name for name in wide if name not in single], "the same readings as another column")
    kept = single if len(single) <= MOST else _closest(single, known)
    _say(said, [name for name in single if name not in kept],
         f"too many to be asked about: the {MOST} that go best with the readings are kept (an import file that names "
         "the columns wanted, with extra: drop, says which)")
    return Kept(kept, tuple(said))


def _say(said: list[str], names: list[str], why: str) -> None:
    if names:
        shown = ", ".join(name if len(name) <= 40 else f"{name[:37]}..." for name in names[:SHOWN])
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        said.append(f"further column{'s' if len(names) > 1 else ''} {shown}{more} left out: {why}")


def _spread(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(np.percentile(known, (1.0, 99.0)))) if len(known) else 0.0


def _standard(columns: Mapping[str, Array], rows: npt.NDArray[np.int64]) -> Array:
    """Columns at some rows less their mean, of length 1, what is not known at the mean: (k, rows)."""
    picked = np.array([values[rows] for values in columns.values()])
    known = np.isfinite(picked)
    filled = np.where(known, picked, 0.0)
    middle = filled.sum(axis=1, keepdims=True) / np.maximum(1, known.sum(axis=1, keepdims=True))
    centred = np.where(known, filled - middle, 0.0)
    length = np.sqrt((centred ** 2).sum(axis=1, keepdims=True))
    return np.asarray(centred / np.where(length > 0.0, length, 1.0))


def _without_copies(columns: dict[str, Array], known: Mapping[str, Array]) -> dict[str, Array]:
    if not columns:
        return columns
    count = len(next(iter(columns.values())))
    rows = np.unique(np.linspace(0, count - 1, min(count, ROWS_COMPARED)).astype(np.int64))
    ours, theirs = _standard(columns, rows), _standard(known, rows) if known else np.zeros((0, len(rows)))
    copied = np.asarray((np.abs(ours @ theirs.T) > COPY).any(axis=1))
    same = np.asarray(np.abs(ours @ ours.T) > COPY)
    kept: list[int] = []
    for k in range(len(ours)):
        if not copied[k] and not same[k][kept].any():
            kept.append(k)
    names = list(columns)
    return {names[k]: columns[names[k]] for k in kept}


def _closest(columns: dict[str, Array], known: Mapping[str, Array]) -> dict[str, Array]:
    """Those that go best with any channel: its reading, less what the published columns tell of it, piece by piece."""
    count = len(next(iter(columns.values())))
    pieces = max(LEAST_PIECES, min(PIECES, count // 10))
    edges = np.linspace(0, count, pieces + 1).astype(np.int64)
    theirs = {name: _means(values, edges) for name, values in known.items() if np.isfinite(values).any()}
    ours = {name: _means(values, edges) for name, values in columns.items()}
    every = np.arange(pieces)
    ours_there = _standard(ours, every)
    best = np.zeros(len(ours))
    for target, by in _targets(theirs):
        plain = _standard({"target": target}, every)[0]
        against = np.vstack((np.ones(pieces), _standard(by, every))) if by else np.ones((1, pieces))
        left = _less(plain[None], against)[0]
        rest = _less(ours_there, against)
        length = np.sqrt((rest ** 2).sum(axis=1) * float(left @ left))
        best = np.maximum(best, np.abs(rest @ left) / np.where(length > 0.0, length, 1.0))
    chosen = sorted(np.argsort(-best, kind="stable")[:MOST].tolist())
    names = list(columns)
    return {names[k]: columns[names[k]] for k in chosen}


def _targets(means: Mapping[str, Array]) -> list[tuple[Array, dict[str, Array]]]:
    """What each channel reads, and what it is known to follow."""
    found = []
    for reading, command in (("shaft_rpm", "shaft_rpm_cmd"), ("opening_mm", "opening_mm_cmd"),
                             ("wheel_speed_mps", "speed_mps")):
        if reading in means and command in means:
            found.append((means[reading], {command: means[command]}))
    if "hopper_kg" in means:
        drives = {name: means[name] for name in ("shaft_rpm", "opening_mm") if name in means}
        if len(drives) == 2:
            drives["both"] = drives["shaft_rpm"] * drives["opening_mm"]
        found.append((np.gradient(means["hopper_kg"]), drives))
    return found


def _less(rows: Array, against: Array) -> Array:
    """Rows (k, m) less their least-squares fit to others (j, m)."""
    basis = np.linalg.svd(against, full_matrices=False)
    span = basis[2][basis[1] > 1e-9 * basis[1].max()]
    return np.asarray(rows - (rows @ span.T) @ span)


def _means(values: Array, edges: npt.NDArray[np.int64]) -> Array:
    """Mean of what is known in each piece; the mean of all where nothing is."""
    known = np.isfinite(values)
    sums = np.add.reduceat(np.where(known, values, 0.0), edges[:-1])
    counts = np.add.reduceat(known.astype(np.float64), edges[:-1])
    usual = float(values[known].mean()) if known.any() else 0.0
    return np.where(counts > 0.0, sums / np.maximum(counts, 1.0), usual)
