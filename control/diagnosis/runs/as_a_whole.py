"""A drive fitted as a whole, where the judgement leaves more than noise: what predicts best, whatever it is called.

Where no model is right, the sizes that make the residual most probable are not those that predict best: quick moves are
weighed most, and what runs slowly passes for drift. The static curve, the lag and the dead time are then fitted to all
rows alike, by least squares (Tuo and Wu, Annals of Statistics 43, 2015, 2331: L2 calibration). How much of them: the
simplest of the sets whose error on rows that it was not fitted to is within one standard error of the least (Breiman,
Friedman, Olshen and Stone, Classification and Regression Trees, 1984, 3.4.3), of those whose every size the pieces of
the log agree on: what a log leaves open leads anywhere beyond it. Nothing of it is a named cause.

Where names are found but not told apart from others, or leave something, their sizes were fitted together, and one of
them without another is a curve that nobody fitted: the judged set then stands as a whole, where it predicts those
pieces better.
"""
from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import SHAFT_DEAD_ZONE, SHAFT_GAIN, SHAFT_SATURATION
from control.diagnosis.judgement.evidence import Z90
from control.diagnosis.result import Fitted, Size
from control.machine.machine import unit_of
from control.machine.terms import COMMANDED_RPM

from .hypothesis import Hypothesis, stages_of
from .search import Search
from .selection import GroupResult
from .together import BACKWARDS, FAMILY, MOVES, fitted_together
from .verdict import Remains

Array = npt.NDArray[np.float64]

FOLDS = 5                   # pieces of a log, each in turn not fitted to
OF_THE_DRIVE = frozenset({"shaft_rpm", COMMANDED_RPM})      # variables that its own curve is over
SPEEDS_EACH = 2             # asked for, for each size of a curve: through as many speeds as sizes any curve goes


class _Tried(NamedTuple):
    """A set of names, fitted to all rows, and its mean square error on each piece that it was not fitted to."""

    parts: Hypothesis
    errors: Array               # (FOLDS,)
    folds: tuple[Hypothesis, ...]    # as fitted without each piece


def as_a_whole(one: GroupResult, rest: Sequence[Remains]) -> Fitted | None:
    """The drive of a judged group fitted as a whole; None where the judgement's model leaves noise alone, or where rows
    that nothing was fitted to are not predicted better by it than by the machine file, and by its names and terms."""
    search = one.search
    if "shaft" not in search.model.names or search.model.machine.shaft.regulated > 0.0:
        return None
    clean = one.found.parts and not rest and not any(one.rivals) and not one.terms
    if clean or not (one.found.parts or rest or one.terms):
        return None
    if any(not set(term.tried.over) <= OF_THE_DRIVE for term in one.terms):
        return None                     # a curve over the command does not stand for what follows something else
    others = tuple(part for part in one.found.parts if part.id not in FAMILY and part.onset_s is None)
    tried = [each for each in (_fitted(search, others, names) for names in _sets(search)) if _known(each, len(others))]
    least = min(tried, key=lambda each: float(each.errors.mean()))
    chosen = next(each for each in tried if _within(each, least))
    before = tried[0]
    named = _errors(search, (one.found.parts,) * FOLDS)
    by_terms = float(np.prod([1.0 - max(0.0, term.held_out) for term in one.terms]))
    gained = _surely(before.errors - chosen.errors) and float(chosen.errors.mean()) < by_terms * float(named.mean())
    sds = {part.id: sd for part, sd in zip(one.found.parts, one.found.sd, strict=True)}
    if gained:
        return _result(search, chosen, before, [sds[part.id] for part in others])
    judged = None if one.terms else _judged(search, others, one.found.parts)
    if judged is None or not _surely(before.errors - judged.errors):
        return None
    return _result(search, judged, before, [sds[part.id] for part in judged.parts])


def _judged(search: Search, others: Hypothesis, parts: Hypothesis) -> _Tried | None:
    """The judged parts as they are; None where the curve is not of two or more of them. others : the rest of them."""
    curve = tuple(part for part in parts if part.id in FAMILY and part.onset_s is None)
    if len(curve) < 2 or any(part.onset_s is not None for part in parts):
        return None
    whole, names = (*others, *curve), tuple(part.id for part in curve)
    folds = tuple(fitted_together(search, others, names, ~piece, whole) for piece in _pieces(search))
    return _Tried(whole, _errors(search, folds), folds)


def _sets(search: Search) -> list[tuple[str, ...]]:
    """Names that are fitted together, from nothing to all of them."""
    tried = {c.part.id for c in search.candidates if c.part.onset_s is None}
    drive = search.model.data.shaft
    if drive is not None and drive.moves_seen:
        tried |= set(MOVES)         # steps of an encoder hide what a slope says of a move, not what all rows say
    moves, back = (tuple(name for name in names if name in tried) for names in (MOVES, BACKWARDS))
    curves = [(), (SHAFT_GAIN.id,), (SHAFT_GAIN.id, SHAFT_DEAD_ZONE.id),
              (SHAFT_GAIN.id, SHAFT_DEAD_ZONE.id, SHAFT_SATURATION.id)]
    found = [(*curve, *more) for curve in curves for more in dict.fromkeys([(), moves])]
    found += [(*curve, *back, *moves) for curve in curves[2:]]
    most = _speeds(search) // SPEEDS_EACH
    held = [one for one in found if set(one) <= tried and len(set(one) - set(MOVES)) <= most]
    return sorted(dict.fromkeys(held), key=len)


def _fitted(search: Search, others: Hypothesis, names: tuple[str, ...]) -> _Tried:
    if not names:
        return _Tried(others, _errors(search, (others,) * FOLDS), (others,) * FOLDS)
    whole = fitted_together(search, others, names)
    folds = tuple(fitted_together(search, others, names, ~piece, whole) for piece in _pieces(search))
    return _Tried(whole, _errors(search, folds), folds)


def _pieces(search: Search) -> list[npt.NDArray[np.bool_]]:
    count = len(search.model.channel("shaft").measured)
    edges, rows = np.linspace(0, count, FOLDS + 1).astype(int), np.arange(count)
    return [(rows >= begin) & (rows < end) for begin, end in pairwise(edges)]


def _speeds(search: Search) -> int:
    """Speeds that a log asks for, by as many even shares of its rows as it has pieces."""
    drive = search.model.data.shaft
    return 0 if drive is None else len(np.unique(np.quantile(drive.command, np.linspace(0.0, 1.0, FOLDS + 1))))


def _errors(search: Search, folds: Sequence[Hypothesis]) -> Array:
    """Mean square error on each piece, of the machine file with the parts fitted without it."""
    channel, base = search.model.channel("shaft"), stages_of(search.model.machine)
    left = [channel.measured - search.model.run(parts, base, ("shaft",))["shaft"] for parts in folds]
    return np.array([float(np.mean(one[piece] ** 2)) for one, piece in zip(left, _pieces(search), strict=True)])


def _sd(one: _Tried, k: int) -> float:
    """Of the size of part k: jackknife by pieces."""
    without = np.array([parts[k].size for parts in one.folds])
    return float(np.sqrt((FOLDS - 1.0) / FOLDS * np.sum((without - without.mean()) ** 2)))


def _known(one: _Tried, others: int) -> bool:
    """Whether every size is away from nothing."""
    return all(abs(part.size) > Z90 * _sd(one, k) for k, part in enumerate(one.parts) if k >= others)


def _within(one: _Tried, least: _Tried) -> bool:
    """Whether an error is within one standard error of the least."""
    more = one.errors - least.errors
    return bool(more.mean() <= np.std(more, ddof=1) / np.sqrt(FOLDS))


def _surely(gained: Array) -> bool:
    """Whether a gain by pieces is above nothing by more than one standard error."""
    return bool(gained.mean() > np.std(gained, ddof=1) / np.sqrt(FOLDS))


def _result(search: Search, chosen: _Tried, before: _Tried, others: Sequence[float]) -> Fitted:
    """others : s.d. of the sizes that stood, the first ones."""
    machine, sizes = search.model.machine, []
    for k, part in enumerate(chosen.parts):
        sd = others[k] if k < len(others) else _sd(chosen, k)
        sizes.append((part.id, Size(part.size, part.size - Z90 * sd, part.size + Z90 * sd, unit_of(part.id, machine))))
    return Fitted("shaft", tuple(sizes), float(np.sqrt(before.errors.mean())), float(np.sqrt(chosen.errors.mean())),
                  search.model.channel("shaft").unit)
