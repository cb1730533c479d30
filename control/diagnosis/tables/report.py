"""Plain sentences about the rows themselves: scatter, far rows, labels against each other, steps in the times."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from .clock import Clock
from .noise import FAR, UNEQUAL_P
from .piece import Array, Piece, Sized
from .problem import Problem
from .selection import Named

DIFFERENT_P = 0.01
IN_PART = " holds in the rows of "
ONLY = " only"
OUTSTANDING = 2.0       # times the common scatter, from which on a setting is pointed out


def scatter_sentences(problem: Problem) -> list[str]:
    """Far rows and settings that scatter more than others."""
    out = []
    for index, (piece, scatter) in enumerate(zip(problem.pieces, problem.scatter, strict=True)):
        if len(scatter.far):
            shown = ", ".join(f"{piece.observed[k]:g}" for k in scatter.far[:5])
            out.append(f"{piece.name}: {len(scatter.far)} of {len(piece.observed)} rows lie far from their replicates "
                       f"({shown} {piece.unit}) and count only as far as {FAR:g} robust s.d.")
        if scatter.unequal_p is None or scatter.unequal_p >= UNEQUAL_P:
            continue
        own = problem.setting[problem.piece == index]
        first = int(own.min())
        sizes = [s for _, _, s in scatter.setting_sd]
        usual = float(np.median(sizes))
        loud = [(k, s) for k, rows, s in scatter.setting_sd if s > OUTSTANDING * usual and rows > 2]
        loud.sort(key=lambda one: -one[1])
        told = "; ".join(f"{_setting(piece, own == k + first)}: {s:.3g}" for k, s in loud[:3])
        out.append(f"{piece.name}: the scatter is not the same everywhere (p {scatter.unequal_p:.2g}): usually "
                   f"{usual:.3g} {piece.unit}" + (f", at {told}" if told else "") + "; rows are weighted accordingly")
    return out


def _setting(piece: Piece, rows: np.ndarray) -> str:
    at = int(np.flatnonzero(rows)[0])
    parts = [f"{name} {values[at]:g}" for name, values in piece.variables.items() if name != "replicate"]
    return " ".join([*parts, str(piece.group[at])]).strip()


def label_sentences(problem: Problem, columns: Sequence[str]) -> list[str]:
    """Labels of one table against each other, setting by setting. `columns`: label column of each piece."""
    out = []
    for index, piece in enumerate(problem.pieces):
        texts = list(dict.fromkeys(piece.group.tolist()))
        if len(texts) < 2:
            continue
        rest = ((problem.observed - problem.nominal) / problem.sd)[problem.piece == index]
        unit = float(np.median(problem.sd[problem.piece == index]))
        for text in texts[1:]:
            found = _contrast(piece, rest * unit, texts[0], text)
            if found is None:
                continue
            value, half, p = found
            word = "differs from" if p < 0.01 else "does not differ from"
            out.append(f"{piece.name}: {columns[index]} {text} {word} {texts[0]} beyond the model: {value:+.3g} "
                       f"{piece.unit} ({value - half:+.3g} to {value + half:+.3g}), p {p:.2g}")
    return out


def _contrast(piece: Piece, rest: Array, one: str, other: str) -> tuple[float, float, float] | None:
    """Other less one, half of its 90 % interval, p: differences of means at equal settings."""
    keys = list(zip(*[np.round(v, 9).tolist() for n, v in piece.variables.items()
                      if n not in ("replicate", "corrected_lag_s")], strict=True)) or [()] * len(rest)
    differences = []
    for key in dict.fromkeys(keys):
        at = np.array([k == key for k in keys])
        a, b = rest[at & (piece.group == one)], rest[at & (piece.group == other)]
        if len(a) and len(b):
            differences.append(float(b.mean() - a.mean()))
    if len(differences) < 3:
        return None
    d = np.array(differences)
    se = max(float(d.std(ddof=1) / np.sqrt(len(d))), 1e-12)
    return (float(d.mean()), float(student.ppf(0.95, len(d) - 1)) * se,
            float(2.0 * student.sf(abs(d.mean()) / se, len(d) - 1)))


def clock_sentence(name: str, clock: Clock) -> str:
    """What a coarse clock means for the readings."""
    return (f"{name}: the times heap on multiples of {clock.step_s:.4f} s (mean cosine {clock.heaping:.2f}): one time "
            f"may be off by {clock.step_s / 2.0:.3f} s, the mean of many at a setting is not")


def scope_sentences(problem: Problem, named: Named) -> list[str]:
    """Where an effect holds in one group of rows only."""
    out = []
    for one in named.found:
        scope = one.part.choice.scope
        if scope is not None:
            where = group_name(problem, scope)
            out.append(f"{one.part.choice.id} {one.part.size:+.3g}{IN_PART}{where}{ONLY}")
    return out


def held_in_part(findings: Sequence[str]) -> dict[str, str]:
    """Effects that hold in one label or one table only: id -> which, read off the findings of a diagnosis.

    Such an effect belongs to what that label names (a tractor, a rig), not to the machine.
    """
    found = {}
    for text in findings:
        head, part, where = text.partition(IN_PART)
        if part and where.endswith(ONLY):
            found[head.split(" ")[0]] = where.removesuffix(ONLY)
    return found


def group_name(problem: Problem, scope: int) -> str:
    table, text = problem.group_names[scope].rsplit("|", 1)
    short = table.replace("\\", "/").rsplit("/", 1)[-1] or "the table"
    return f"{short} {text}".strip()


def _differ(rest: Array, setting: np.ndarray) -> bool:
    """F test of setting means against replicates."""
    kinds, index, counts = np.unique(setting, return_inverse=True, return_counts=True)
    means = np.bincount(index, rest) / counts
    within = float(np.sum((rest - means[index]) ** 2))
    dof = len(rest) - len(kinds)
    if dof < 3 or len(kinds) < 2 or within <= 0.0:
        return False
    between = float(np.sum(counts * means ** 2)) / len(kinds)
    return bool(fisher.sf(between / (within / dof), len(kinds), dof) < DIFFERENT_P)


def level_sentence(problem: Problem, parts: Sequence[Sized], widened_by: float) -> list[str]:
    """Replicates at one setting share something that the model does not have."""
    if widened_by <= 1.05:
        return []
    rest = problem.observed - problem.predicted(parts)
    out = []
    for index, piece in enumerate(problem.pieces):
        inside = problem.piece == index
        setting = problem.setting[inside]
        if not _differ((rest / problem.sd)[inside], setting):
            continue
        means = sorted((float(rest[inside][setting == k].mean()), _setting(piece, setting == k))
                       for k in np.unique(setting))
        (low, at_low), (high, at_high) = means[0], means[-1]
        out.append(f"{piece.name}: settings differ by more than their replicates do (intervals are {widened_by:.1f} "
                   f"times wider for it): from {low:+.3g} {piece.unit} at {at_low} to {high:+.3g} at {at_high}")
    return out
