"""Lists the components of a model of bench tables: effects of the catalogue, and dependences that
no effect has.
"""

from __future__ import annotations

from itertools import combinations
from math import log
from typing import NamedTuple

import numpy as np
from topdress.control.diagnosis.effects import EFFECT_ROWS, LAG_ASYMMETRY
from topdress.control.diagnosis.judgement.prior import (
    FAULT_PROB,
    LOCAL_PROB,
    MISREAD_PROB,
    UNKNOWN_PROB,
    WRONG_SETTING_PROB,
    calc_sign_log_prior,
)
from topdress.control.machine.machine import CATALOGUE, find_size_bounds

from .problem import TableProblem
from .table_series import Array, BoolArray, MeasuredSeries, TableCandidate

# Half-wave numbers of a dependence on a setting, from a slope to the finest shape.
HALF_WAVES = (1, 2, 4, 12)
# Minimum norm of a column in units of the noise: an effect with less does not change these rows.
MIN_COLUMN_NORM = 1e-9
# Maximum number of distinct values of a setting for each to have its own mean.
MAX_LEVELS = 12
# Correlation from which two columns are the same.
EQUAL_CORRELATION = 0.999


class TableEffect(NamedTuple):
    """One effect of the catalogue in these rows. `column`: (n,) per unit of its size; `usual`:
    prior s.d. of its size.

    `forms`: (n, k), differences of other shapes at a size of 1, each with a prior s.d. of 1.
    `worth`: (k,) contribution of a unit of each form to the size where the catalogue defines the
    size.
    """

    candidate: TableCandidate
    column: Array
    forms: Array
    worth: Array
    usual: float
    log_odds: float
    low: float
    high: float

    def calc_sign_log_prior(self, size: float) -> float:
        return calc_sign_log_prior(size, EFFECT_ROWS[self.candidate.id].only_adds)


class UnknownDependence(NamedTuple):
    """A dependence that no effect has. `columns`: (n, k), each with the prior s.d. `usual`, in
    units of the noise.

    `at`: rows of the dependence where that is a single row or setting. `misread`: whether one row
    was misread, which says nothing about the machine (mean-shift model of an outlier: Box and Tiao,
    Biometrika 55, 1968, 119).
    """

    channel: str
    # Name of the variable; empty for one setting alone, or for settings without order.
    variable: str
    columns: Array
    usual: float
    log_odds: float
    misread: bool = False
    at: tuple[int, ...] = ()


def find_effects(problem: TableProblem) -> list[TableEffect]:
    """Return the effects that change these rows."""
    _, slopes = problem.calc_slopes()
    columns = slopes / problem.sd[:, None]
    ids = len(dict.fromkeys(candidate.id for candidate in problem.candidates))
    found: list[TableEffect] = []
    for candidate, column in zip(problem.candidates, columns.T, strict=True):
        if np.linalg.norm(column) < MIN_COLUMN_NORM:
            continue
        alike = [one for one in problem.candidates if one.id == candidate.id]
        members = len({one.member for one in alike})
        places = len({one.scope for one in alike if one.scope is not None})
        if any(
            one.candidate.id == candidate.id and np.allclose(one.column, column) for one in found
        ):
            # The other rows do not show the effect.
            continue
        wide = 1.0 - LOCAL_PROB if any(one.scope is None for one in alike) else 0.0
        share = (1.0 - wide) / places if candidate.scope is not None else wide if places else 1.0
        forms, worth = _list_shape_columns(problem, candidate, column)
        low, high = _find_size_bounds(problem, candidate.id)
        found.append(
            TableEffect(
                candidate,
                column,
                forms,
                worth,
                EFFECT_ROWS[candidate.id].scale_to_machine(problem.machine).usual,
                log(FAULT_PROB * share / ids / members),
                low,
                high,
            )
        )
    return found


def _find_size_bounds(problem: TableProblem, effect_id: str) -> tuple[float, float]:
    """Return the bounds of a size on top of the machine's: a loss or an excess by definition is
    never negative."""
    entry = CATALOGUE[effect_id]
    low, high = find_size_bounds(effect_id, problem.machine)
    has = float(getattr(getattr(problem.machine, entry.stage), entry.field))
    return (entry.neutral - has if EFFECT_ROWS[effect_id].only_adds else low), high


def _list_shape_columns(
    problem: TableProblem, candidate: TableCandidate, column: Array
) -> tuple[Array, Array]:
    """Return the differences by which an effect's shape may deviate from the catalogue's, and their
    contributions to the size where it is defined (Brynjarsdottir and O'Hagan 2014).

    The full difference to each alternative shape, of the same root mean square, is 1 s.d. An effect
    that differs between two sides may be entirely on one side: half of it then looks like another
    effect.
    """
    shapes, worth = [], []
    for index, piece in enumerate(problem.pieces):
        own = piece.forms.get(candidate.id)
        if own is not None and np.any(column[problem.piece == index]):
            for k, shape in enumerate(own.T):
                whole = np.zeros(len(column))
                whole[problem.piece == index] = shape / problem.sd[problem.piece == index]
                whole = np.where(column != 0.0, whole, 0.0)
                scale = float(np.linalg.norm(column)) / max(float(np.linalg.norm(whole)), 1e-12)
                scale = -scale if whole @ column < 0.0 else scale
                shapes.append(scale * whole - column)
                defined = piece.at_definition.get(candidate.id)
                worth.append(0.0 if defined is None else scale * float(defined[k]) - 1.0)
    # If all of the asymmetry is on one side, half of it looks like an offset or a dead time.
    if candidate.id == LAG_ASYMMETRY.id:
        shapes, worth = [*shapes, np.where(column != 0.0, 0.5 / problem.sd, 0.0)], [*worth, 0.0]
    return np.column_stack([np.zeros((len(column), 0)), *shapes]), np.array(worth)


def list_unknowns(problem: TableProblem, effects: list[TableEffect]) -> list[UnknownDependence]:
    """Return the unknown dependences: on every recorded setting of every piece, its labels, a
    constant, settings without order, and one setting alone."""
    known, found = _list_effect_bases(effects), []
    for index, piece in enumerate(problem.pieces):
        inside = problem.piece == index
        usual = max(
            [
                1.0,
                *(one.usual * float(np.sqrt(np.mean(one.column[inside] ** 2))) for one in effects),
            ]
        )
        shapes = _list_dependence_shapes(problem, piece, inside, known)
        for name, several in shapes.items():
            odds = log(UNKNOWN_PROB / len(problem.pieces) / len(shapes) / len(several))
            found += [
                UnknownDependence(
                    piece.channel, name, shape, usual / float(np.sqrt(shape.shape[1])), odds
                )
                for shape in several
            ]
        settings = np.unique(problem.setting[inside])
        odds = log(WRONG_SETTING_PROB / len(problem.pieces) / max(1, len(settings)))
        for k in settings.tolist() if len(settings) > 1 else ():
            one = problem.setting == k
            found.append(
                UnknownDependence(
                    piece.channel,
                    _find_single_variable(piece),
                    one.astype(float)[:, None],
                    usual,
                    odds,
                    at=tuple(np.flatnonzero(one).tolist()),
                )
            )
        for row in np.flatnonzero(inside).tolist() if inside.sum() > 1 else ():
            found.append(
                UnknownDependence(
                    piece.channel,
                    "",
                    (np.arange(len(inside)) == row).astype(float)[:, None],
                    usual,
                    log(MISREAD_PROB / len(inside)),
                    misread=True,
                    at=(row,),
                )
            )
    return found


def _find_single_variable(piece: MeasuredSeries) -> str:
    """Return the variable by which a piece's settings differ; "" for more than one."""
    names = [name for name in piece.variables if name != "replicate"]
    return names[0] if len(names) == 1 and len(set(piece.group.tolist())) == 1 else ""


def _list_dependence_shapes(
    problem: TableProblem, piece: MeasuredSeries, inside: BoolArray, known: list[Array]
) -> dict[str, list[Array]]:
    """Return columns (n, k) of every kind of dependence, by variable, without those within the
    `known` spaces."""
    rows = int(inside.sum())
    found: dict[str, list[Array]] = {}
    for name, values in piece.variables.items():
        kinds = np.unique(values)
        place = (values - kinds[0]) / (kinds[-1] - kinds[0])
        counts = [k for k in HALF_WAVES if k < len(kinds)]
        found[name] = [
            _expand_to_all_rows(inside, np.cos(np.pi * np.outer(place, np.arange(k + 1))))
            for k in counts
        ]
        if 2 < len(kinds) <= MAX_LEVELS and 2 * len(kinds) <= rows:
            found[name].append(
                _expand_to_all_rows(inside, (values[:, None] == kinds).astype(float))
            )
    texts = list(dict.fromkeys(piece.group.tolist()))
    if len(texts) > 1:
        found["label"] = [
            _expand_to_all_rows(
                inside, np.column_stack([piece.group == text for text in texts]).astype(float)
            )
        ]
    found["constant"] = [_expand_to_all_rows(inside, np.ones((rows, 1)))]
    settings = np.unique(problem.setting[inside])
    name = _find_single_variable(piece)
    if 2 < len(settings) < rows and not (name and len(settings) <= MAX_LEVELS):
        each = np.column_stack([problem.setting == k for k in settings.tolist()]).astype(float)
        found[name] = [*found.get(name, []), each]
    return {
        name: kept
        for name, several in found.items()
        if (
            kept := [
                one for one in several if not any(_is_within_space(one, basis) for basis in known)
            ]
        )
    }


def _expand_to_all_rows(inside: BoolArray, columns: Array) -> Array:
    whole = np.zeros((len(inside), columns.shape[1]))
    whole[inside] = columns
    return whole


def _list_effect_bases(effects: list[TableEffect]) -> list[Array]:
    """Return orthonormal bases of the columns of one or two effects: (n, 1) or (n, 2)."""
    wide = [one for one in effects if one.candidate.scope is None]
    pairs = [
        (one, two) for one, two in combinations(wide, 2) if one.candidate.id != two.candidate.id
    ]
    alone = [(one,) for one in wide]
    return [
        np.linalg.qr(np.column_stack([one.column for one in some]))[0] for some in (*alone, *pairs)
    ]


def _is_within_space(columns: Array, basis: Array) -> bool:
    """Tell whether all columns (n, k) lie in a space; the dependence then equals those effects."""
    inside = np.linalg.norm(basis.T @ columns, axis=0)
    return bool(np.all(inside >= EQUAL_CORRELATION * np.linalg.norm(columns, axis=0)))
