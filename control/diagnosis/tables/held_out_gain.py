"""Measures the held-out gain of the named causes, the smallest detectable size of other effects,
and differences between labels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr, stdtrit
from topdress.control.diagnosis.effects import LAG_COARSE_CLOCK
from topdress.control.diagnosis.judgement.prior import calc_detectable_size
from topdress.control.diagnosis.result import DetectableSize, Gain, UnnamedEffect
from topdress.control.machine.machine import CATALOGUE, Machine, describe_unit

from .problem import TableProblem
from .search import CandidateModel, TableSearch, refine_table_model
from .table_series import Array, BoolArray, IntArray, MeasuredSeries, SizedEffect

# Number of bootstrap resamples of the settings, for the interval of the gain.
RESAMPLE_COUNT = 400
# Minimum number of rows: a single row has no scatter.
MIN_ROWS = 2
# Minimum number of common settings of two labels that are compared.
MIN_PAIRS = 3


def calc_held_out_gain(
    search: TableSearch, effects: Sequence[SizedEffect], seed: int
) -> tuple[Gain, ...]:
    """Return the gain of each channel by leave-one-setting-out prediction with refitted sizes; 90 %
    intervals by bootstrap of settings.

    The result is empty where nothing is named. Rows are left out instead of settings where a single
    setting could show an effect of a member (an outlet, a head), or where all rows have the same
    setting.
    """
    if not effects:
        return ()
    problem = search.problem
    before = problem.observed - problem.nominal
    split = _list_held_out_settings(problem, effects)
    after = _predict_held_out(search, effects, split)
    rng = np.random.default_rng(seed)
    found = []
    for channel in dict.fromkeys(piece.channel for piece in problem.pieces):
        rows = np.isin(
            problem.piece, [k for k, piece in enumerate(problem.pieces) if piece.channel == channel]
        )
        settings = np.unique(problem.setting[rows])
        drawn = [
            _calc_weighted_rms(after, problem.setting, rng.choice(settings, len(settings)), rows)
            for _ in range(RESAMPLE_COUNT)
        ]
        unit = next(piece.unit for piece in problem.pieces if piece.channel == channel)
        single = split & set(settings.tolist())
        whole, alone = (
            len(settings) - len(single),
            int(np.sum(np.isin(problem.setting, sorted(single)))),
        )
        said = [f"{whole} settings"] * (whole > 0) + [f"{alone} rows"] * (alone > 0)
        found.append(
            Gain(
                channel,
                f"rmse, {unit}",
                float(np.sqrt(np.mean(before[rows] ** 2))),
                float(np.sqrt(np.mean(after[rows] ** 2))),
                float(np.quantile(drawn, 0.05)),
                float(np.quantile(drawn, 0.95)),
                f"each of {' and '.join(said)} in turn",
            )
        )
    return tuple(found)


def _predict_held_out(
    search: TableSearch, effects: Sequence[SizedEffect], split: frozenset[int]
) -> Array:
    """Return the error of each row, (n,), predicted with sizes fitted without the rows of its
    fold."""
    problem = search.problem
    off = problem.observed - problem.nominal
    folds = [
        problem.setting == kind for kind in np.unique(problem.setting).tolist() if kind not in split
    ]
    folds += [
        np.arange(len(off)) == row
        for row in np.flatnonzero(np.isin(problem.setting, sorted(split))).tolist()
    ]
    named = {effect.candidate for effect in effects}
    model = CandidateModel(
        tuple(k for k, one in enumerate(search.effects) if one.candidate in named)
    )
    for out in folds if len(folds) > 1 else ():
        sized = refine_table_model(problem, search.effects, search.unknowns, model, ~out).sized
        off[out] = (problem.observed - problem.predict(sized))[out]
    return off


def _list_held_out_settings(
    problem: TableProblem, effects: Sequence[SizedEffect]
) -> frozenset[int]:
    """Return the settings whose rows are held out one by one: the only setting of all, or of a
    member's effect."""
    only_one = len(np.unique(problem.setting)) == 1
    chosen = [effect.candidate for effect in effects]
    slopes = problem._replace(candidates=tuple(chosen)).calc_slopes()[1]
    own = [np.unique(problem.setting[column != 0.0]) for column in slopes.T]
    return frozenset(
        int(seen[0])
        for candidate, seen in zip(chosen, own, strict=True)
        if len(seen) == 1 and (candidate.member is not None or only_one)
    )


def _calc_weighted_rms(values: Array, setting: IntArray, drawn: IntArray, rows: BoolArray) -> float:
    sums = np.bincount(setting[rows], values[rows] ** 2, minlength=int(setting.max()) + 1)
    counts = np.bincount(setting[rows], minlength=int(setting.max()) + 1)
    return float(np.sqrt(sums[drawn].sum() / counts[drawn].sum()))


def list_effects_not_shown(
    smallest: Mapping[str, float], shown: frozenset[str], machine: Machine
) -> tuple[UnnamedEffect, ...]:
    """Return every effect of the catalogue that is neither named nor a rival (`shown`). None means
    that these rows cannot show the effect."""
    return tuple(
        UnnamedEffect(
            effect_id, DetectableSize(smallest.get(effect_id), describe_unit(effect_id, machine))
        )
        for effect_id in CATALOGUE
        if effect_id not in shown
    )


def list_detectable_sizes(search: TableSearch) -> dict[str, float]:
    """Return the smallest size, within its bounds, of each effect that these rows would show nine
    times in ten, by id."""
    problem, smallest = search.problem, dict[str, float]()
    for k, one in enumerate(search.effects if len(problem.observed) >= MIN_ROWS else ()):
        if one.candidate.scope is not None:
            continue
        model = CandidateModel(tuple(sorted({*search.best.model.effects, k})))
        fit = refine_table_model(problem, search.effects, search.unknowns, model)
        se = fit.se[model.effects.index(k)]
        information = max(
            0.0,
            1.0 / se**2 - 1.0 / max(one.usual, abs(fit.sized[model.effects.index(k)].size)) ** 2,
        )
        size = calc_detectable_size(one.usual, information, one.log_odds)
        if size < max(abs(one.low), abs(one.high)):
            smallest[one.candidate.id] = max(size, smallest.get(one.candidate.id, 0.0))
    steps = [
        clock.smallest_s
        for clock in problem.clocks
        if clock is not None and clock.smallest_s is not None
    ]
    if steps:
        smallest[LAG_COARSE_CLOCK.id] = min(steps)
    return smallest


class LabelContrast(NamedTuple):
    """Difference of two labels beyond the model, with half of its 90 % interval."""

    piece: MeasuredSeries
    one: str
    other: str
    difference: float
    half: float
    p: float


def list_label_contrasts(problem: TableProblem) -> list[LabelContrast]:
    """Return the contrast of each label of a piece with its first label, setting by setting (paired
    t test)."""
    found = []
    for index, piece in enumerate(problem.pieces):
        texts = list(dict.fromkeys(piece.group.tolist()))
        inside = problem.piece == index
        rest = ((problem.observed - problem.nominal) / problem.sd)[inside] * float(
            np.median(problem.sd[inside])
        )
        found += [
            contrast
            for text in texts[1:]
            if (contrast := _calc_label_contrast(piece, rest, texts[0], text)) is not None
        ]
    return found


def _calc_label_contrast(
    piece: MeasuredSeries, rest: Array, one: str, other: str
) -> LabelContrast | None:
    keys = list(
        zip(
            *[
                np.round(v, 9).tolist()
                for n, v in piece.variables.items()
                if n not in ("replicate", "corrected_lag_s")
            ],
            strict=True,
        )
    ) or [()] * len(rest)
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
    return LabelContrast(
        piece,
        one,
        other,
        float(d.mean()),
        float(stdtrit(len(d) - 1, 0.95)) * se,
        float(2.0 * stdtr(len(d) - 1, -abs(d.mean()) / se)),
    )
