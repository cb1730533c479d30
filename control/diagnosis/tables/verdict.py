"""The verdict on bench tables: none, named, unexplained or not judged, and which names are only suspected.

- not judged: no effect within its bounds could have shown in these rows.
- none: nothing is named, and what is left is noise by the tests of `unexplained` and `residual`.
- named: predicts settings that its size was not fitted to; else the name is suspected ("something else" is a rival).
- unexplained: what is left is not noise. Refused names land here, never in none.
"""
from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from control.diagnosis.effects import ROWS
from control.diagnosis.result import STRUCTURE_P, Unexplained, Verdict

from .algebra import least_squares
from .evidence import held_out_shares, smallest_shown
from .problem import Problem
from .residual import Residual, worst_residual
from .selection import Selection, as_good, nothing_selected
from .unexplained import Structure, explained_by, remaining_structure

# Of the structure found (sum of squares beyond noise), by the catalogue or beside it.
MIN_BY_CATALOGUE = 0.6      # below it the catalogue does not explain it, and nothing is named
MAX_BESIDE = 0.15           # above it, what is left beside named effects makes the verdict unexplained


Suspicion = Literal["", "held_out", "bounds"]


class Judgement(NamedTuple):
    """`suspected`: why each selected effect may be something else, "" if not. `structure_p`: of all that was asked."""

    selection: Selection
    verdict: Verdict
    unexplained: tuple[Unexplained, ...]
    suspected: tuple[Suspicion, ...]
    structure: Structure | None
    structure_p: float


def judged(problem: Problem, selection: Selection, seed: int) -> Judgement:
    """The verdict, before it is asked whether causes have rivals."""
    structure = remaining_structure(problem, selection.effects, seed + 10)
    residual = worst_residual(problem, selection.effects,
                              explained_by(problem, selection.effects, selection.design), seed + 30)
    kept, verdict, unexplained = _beside_structure(problem, selection, structure, seed)
    if verdict == "none":
        verdict, unexplained = _with_nothing_named(problem, kept, structure, residual)
    suspected = tuple(_suspicion(problem, kept, k, share)
                      for k, share in enumerate(held_out_shares(problem, kept.effects)))
    asked = [kept.structure_p, *([structure.p] if structure is not None else []),
             *([residual.p] if residual is not None else [])]
    return Judgement(kept, verdict, unexplained, suspected, structure,
                     min(asked) if verdict == "unexplained" else kept.structure_p)


def _suspicion(problem: Problem, selection: Selection, k: int, held_out_share: float) -> Suspicion:
    """Why the k-th effect may be something else: it does not predict, or a name out of its bounds fits as well."""
    if held_out_share <= 0.0:
        return "held_out"
    index = [problem.candidates.index(candidate) for candidate in selection.candidates]
    for candidate in selection.refused:
        other = least_squares(selection.design, [*index[:k], problem.candidates.index(candidate), *index[k + 1:]])
        if other is None or (ROWS[candidate.id].only_adds and other.sizes[k] < 0.0):
            continue                    # less than nothing of what only adds is no size at all
        if as_good(other, selection.estimate):
            return "bounds"
    return ""


def _with_nothing_named(problem: Problem, selection: Selection, structure: Structure | None,
                        residual: Residual | None) -> tuple[Verdict, tuple[Unexplained, ...]]:
    if any(clock is not None and clock.shown for clock in problem.clocks):
        return "named", ()
    if selection.structure_p < STRUCTURE_P:
        return "unexplained", (_not_noise(problem, structure),)
    if residual is not None and not residual.is_noise:
        return "unexplained", (Unexplained(residual.channel, residual.variable, residual.share),)
    return ("none" if smallest_shown(problem, selection) else "not_judged"), ()


def _beside_structure(problem: Problem, selection: Selection, structure: Structure | None,
                      seed: int) -> tuple[Selection, Verdict, tuple[Unexplained, ...]]:
    """What is named, against what no effect explains."""
    said: Verdict = "named" if selection.selected else "none"
    if structure is None or not structure.shown:
        return selection, said, ()
    none = nothing_selected(problem, selection)
    by_catalogue = max(0.0, none.estimate.rss - selection.estimate.rss)
    whole = by_catalogue + structure.sum_of_squares
    if not selection.selected or by_catalogue < MIN_BY_CATALOGUE * whole:
        alone = remaining_structure(problem, (), seed + 11) or structure
        if selection.selected and alone.shown:
            structure = alone
        return none, "unexplained", (_unexplained(structure),)
    if structure.sum_of_squares > MAX_BESIDE * whole:
        return selection, "unexplained", (_unexplained(structure),)
    return selection, said, ()


def _unexplained(structure: Structure) -> Unexplained:
    return Unexplained(structure.channel, structure.variable, structure.share)


def _not_noise(problem: Problem, structure: Structure | None) -> Unexplained:
    """Structure that is no chance, though every name for it was refused."""
    if structure is not None:
        return _unexplained(structure)
    off = (problem.observed - problem.nominal) / problem.sd
    return Unexplained(problem.pieces[0].channel, "", max(0.0, 1.0 - 1.0 / max(1.0, float(np.mean(off ** 2)))))
