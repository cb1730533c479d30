"""What the rows can show: the held-out gain of what is named, the smallest size of the rest, labels side by side."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from control.diagnosis.effects import LAG_COARSE_CLOCK
from control.diagnosis.result import Detectable, Gain, NotShown
from control.machine.machine import CATALOGUE, bounds, unit_of

from .algebra import estimated, orthonormal, projected_out
from .piece import Array, BoolArray, Candidate, IntArray, Piece, SizedEffect
from .problem import Problem
from .selection import LEVEL, Selection

RESAMPLES = 400             # of the settings, for the interval of the gain
POWER = 0.9                 # of showing an effect of the smallest detectable size
MIN_LENGTH = 1e-9           # of a column beyond the others: shorter, its effect cannot be shown at all
MIN_PAIRS = 3               # settings that two labels must share to be compared


def held_out_gain(problem: Problem, effects: Sequence[SizedEffect], seed: int) -> tuple[Gain, ...]:
    """Leave one setting out at a time, refit the sizes, predict it; 90 % intervals by resampling settings (bootstrap).

    A gain of each channel; none where nothing is named. Where one setting is all that could show an effect of a member
    (an outlet, a head), or all rows are set alike, rows are left out instead.
    """
    if not effects:
        return ()
    chosen = [effect.candidate for effect in effects]
    before = problem.observed - problem.nominal
    after = _held_out(problem, chosen, _folds(problem, chosen))
    rng = np.random.default_rng(seed)
    found = []
    for channel in dict.fromkeys(piece.channel for piece in problem.pieces):
        rows = np.isin(problem.piece, [k for k, piece in enumerate(problem.pieces) if piece.channel == channel])
        settings = np.unique(problem.setting[rows])
        drawn = [_rms(after, problem.setting, rng.choice(settings, len(settings)), rows) for _ in range(RESAMPLES)]
        unit = next(piece.unit for piece in problem.pieces if piece.channel == channel)
        found.append(Gain(channel, f"rmse, {unit}", float(np.sqrt(np.mean(before[rows] ** 2))),
                          float(np.sqrt(np.mean(after[rows] ** 2))), float(np.quantile(drawn, 0.05)),
                          float(np.quantile(drawn, 0.95)), _in_turn(problem, chosen, settings)))
    return tuple(found)


def held_out_shares(problem: Problem, effects: Sequence[SizedEffect]) -> tuple[float, ...]:
    """Share of the held-out sum of squares (whitened) that each effect removes beside the others; negative: it adds.

    Settings are held out one at a time. Where one setting is all that could show an effect of a member (an outlet, a
    head), or all rows are set alike, rows are held out instead.
    """
    chosen = [effect.candidate for effect in effects]
    if not chosen:
        return ()
    folds = _folds(problem, chosen)
    whole = _held_out_rss(problem, chosen, folds)
    shares = []
    for k in range(len(chosen)):
        without = _held_out_rss(problem, chosen[:k] + chosen[k + 1:], folds)
        shares.append(1.0 - whole / without if without > 0.0 else 0.0)
    return tuple(shares)


def _held_out_rss(problem: Problem, chosen: Sequence[Candidate], folds: Sequence[BoolArray]) -> float:
    return float(np.sum((_held_out(problem, chosen, folds) / problem.sd) ** 2))


def _held_out(problem: Problem, chosen: Sequence[Candidate], folds: Sequence[BoolArray]) -> Array:
    """Error of each row, (n,), predicted without the rows of its fold."""
    off = problem.observed - problem.nominal
    for out in folds if chosen else ():
        fit, sized = estimated(problem._replace(sd=np.where(out, np.inf, problem.sd)), chosen, rounds=2)
        if fit is not None:             # else an effect has no size without these rows, and gains nothing there
            off[out] = (problem.observed - problem.predicted(sized))[out]
    return off


def _folds(problem: Problem, chosen: Sequence[Candidate]) -> list[BoolArray]:
    """Rows that are held out together, (n,) each: settings, or the single rows of some settings."""
    split = _split(problem, chosen)
    folds = [problem.setting == kind for kind in np.unique(problem.setting).tolist() if kind not in split]
    return folds + [np.arange(len(problem.setting)) == row
                    for row in np.flatnonzero(np.isin(problem.setting, sorted(split))).tolist()]


def _split(problem: Problem, chosen: Sequence[Candidate]) -> frozenset[int]:
    """Settings whose rows are held out one by one: the only one of all, or of a member's effect."""
    only_one = len(np.unique(problem.setting)) == 1
    slopes = problem._replace(candidates=tuple(chosen)).slopes()[1]
    own = [np.unique(problem.setting[column != 0.0]) for column in slopes.T]
    return frozenset(int(seen[0]) for candidate, seen in zip(chosen, own, strict=True)
                     if len(seen) == 1 and (candidate.member is not None or only_one))


def _in_turn(problem: Problem, chosen: Sequence[Candidate], settings: IntArray) -> str:
    split = _split(problem, chosen) & set(settings.tolist())
    rows = int(np.sum(np.isin(problem.setting, sorted(split))))
    whole = len(settings) - len(split)
    said = [f"{whole} settings"] * (whole > 0) + [f"{rows} rows"] * (rows > 0)
    return f"each of {' and '.join(said)} in turn"


def _rms(values: Array, setting: IntArray, drawn: IntArray, rows: np.ndarray) -> float:
    sums = np.bincount(setting[rows], values[rows] ** 2, minlength=int(setting.max()) + 1)
    counts = np.bincount(setting[rows], minlength=int(setting.max()) + 1)
    return float(np.sqrt(sums[drawn].sum() / counts[drawn].sum()))


def not_shown(problem: Problem, selection: Selection, told: frozenset[str]) -> tuple[NotShown, ...]:
    """Every catalogued effect that is neither named nor a rival (`told`). None: these rows cannot show it at all."""
    smallest = smallest_shown(problem, selection)
    return tuple(NotShown(effect_id, Detectable(smallest.get(effect_id), unit_of(effect_id, problem.machine)))
                 for effect_id in CATALOGUE if effect_id not in told)


def smallest_shown(problem: Problem, selection: Selection) -> dict[str, float]:
    """The smallest size, within its bounds, of each effect that these rows would show with POWER, by id."""
    design = selection.design
    index = [problem.candidates.index(candidate) for candidate in selection.candidates]
    basis = orthonormal(np.column_stack([design.nuisances, design.x[:, index]]))
    dof = max(1.0, selection.dof)
    wanted = float(student.ppf(1.0 - LEVEL / 2.0 / max(1, len(problem.candidates)), dof) + student.ppf(POWER, dof))
    sd = np.sqrt(selection.estimate.variance) * selection.inflation
    smallest: dict[str, float] = {}
    for k, candidate in enumerate(problem.candidates):
        if candidate.scope is not None:
            continue
        left = float(np.linalg.norm(projected_out(basis, design.x[:, [k]])))
        size = float(wanted * sd / left) if left > MIN_LENGTH else np.inf
        if size < max(map(abs, bounds(candidate.id, problem.machine))):
            smallest[candidate.id] = max(size, smallest.get(candidate.id, 0.0))
    steps = [clock.smallest_s for clock in problem.clocks if clock is not None and clock.smallest_s is not None]
    if steps:
        smallest[LAG_COARSE_CLOCK.id] = min(steps)
    return smallest


class Contrast(NamedTuple):
    """One label less another, beyond the model, with half of the 90 % interval."""

    piece: Piece
    one: str
    other: str
    difference: float
    half: float
    p: float


def label_contrasts(problem: Problem) -> list[Contrast]:
    """Labels of each piece against its first one, setting by setting (paired t test)."""
    found = []
    for index, piece in enumerate(problem.pieces):
        texts = list(dict.fromkeys(piece.group.tolist()))
        inside = problem.piece == index
        rest = ((problem.observed - problem.nominal) / problem.sd)[inside] * float(np.median(problem.sd[inside]))
        found += [contrast for text in texts[1:] if (contrast := _contrast(piece, rest, texts[0], text)) is not None]
    return found


def _contrast(piece: Piece, rest: Array, one: str, other: str) -> Contrast | None:
    keys = list(zip(*[np.round(v, 9).tolist() for n, v in piece.variables.items()
                      if n not in ("replicate", "corrected_lag_s")], strict=True)) or [()] * len(rest)
    differences = []
    for key in dict.fromkeys(keys):
        at = np.array([k == key for k in keys])
        a, b = rest[at & (piece.group == one)], rest[at & (piece.group == other)]
        if len(a) and len(b):
            differences.append(float(b.mean() - a.mean()))
    if len(differences) < MIN_PAIRS:
        return None
    d = np.array(differences)
    se = max(float(d.std(ddof=1) / np.sqrt(len(d))), 1e-12)
    return Contrast(piece, one, other, float(d.mean()), float(student.ppf(0.95, len(d) - 1)) * se,
                    float(2.0 * student.sf(abs(d.mean()) / se, len(d) - 1)))
