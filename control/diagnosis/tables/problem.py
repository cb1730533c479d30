"""All pieces of a diagnosis side by side: rows, their noise, the effects that may be
hypothesised."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.machine.machine import CATALOGUE, Machine, calc_size_scale

from .clock import DITHERED, CoarseClock, find_clock_step, find_rounding_sd
from .noise import TableNoise, estimate_table_noise, find_quantum, resolution_of, smooth_by_settings
from .table_series import (
    Array,
    IntArray,
    SizedEffect,
    TableCandidate,
    TablePiece,
    add_effects,
    describe_scope,
)

# replicates beyond the first of each setting, from which on their common rounding is counted
MIN_SHARED = 4
# replicates whose median is taken for their true time
MIN_MEDIAN_ROWS = 3


class TableProblem(NamedTuple):
    """Rows (n,) of all pieces. `group`: label within a table; `setting`: rows set alike."""

    pieces: tuple[TablePiece, ...]
    machine: Machine
    observed: Array  # outliers among replicates winsorised
    nominal: Array
    sd: Array  # noise
    piece: IntArray
    group: IntArray
    group_names: tuple[tuple[str, str], ...]  # table, label
    # groups that an effect may hold in alone: each one, then some together
    scopes: tuple[frozenset[int], ...]
    setting: IntArray
    candidates: tuple[TableCandidate, ...]
    # (n, q) what a tolerance of the machine file, as large as it is, makes
    nuisances: Array
    # (n,) s.d. of what rounding does alike to all rows of their setting
    rounding: Array
    # noise as the machine file has it, in units of sd
    usual_noise: float
    noise: tuple[TableNoise, ...]
    # pieces, of several, whose noise no replicates tell
    unrepeated: tuple[int, ...]
    clocks: tuple[CoarseClock | None, ...]  # of each piece: steps in its times

    @property
    def min_variance(self) -> float:
        """In units of sd squared: the rows' variance is not believed to be less than that of
        their last digit."""
        return max(1e-9, min(noise.min_variance for noise in self.noise))

    def predicted(self, effects: Sequence[SizedEffect]) -> Array:
        """The model's rows with the effects in the machine, each in its own scope."""
        out = self.nominal.copy()
        for index, piece in enumerate(self.pieces):
            inside = self.piece == index
            done: dict[tuple[SizedEffect, ...], Array] = {}
            for group in np.unique(self.group[inside]).tolist():
                here = tuple(
                    effect for effect in effects if self._applies_to(effect.candidate, piece, group)
                )
                if not here:
                    continue
                if here not in done:
                    done[here] = piece.predict(add_effects(self.machine, here))
                rows = self.group == group
                out[rows & inside] = done[here][self.group[inside] == group]
        return out

    def _applies_to(self, candidate: TableCandidate, piece: TablePiece, group: int) -> bool:
        if candidate.scope is None:
            return candidate.id not in piece.named_only
        return group in self.scopes[candidate.scope]

    def scope_name(self, scope: int) -> str:
        return describe_scope(self.group_names[group] for group in sorted(self.scopes[scope]))

    def slopes(self, effects: Sequence[SizedEffect] = ()) -> tuple[Array, Array]:
        """Rows under the effects, (n,), and their change per unit of each candidate's size on
        top of them, (n, c).

        Of one of the effects itself it is the mean slope from neutral to its size.
        """
        base = self.predicted(effects)
        columns = []
        for candidate in self.candidates:
            own = next(
                (effect for effect in effects if effect.candidate == candidate and effect.size),
                None,
            )
            if own is not None:
                columns.append(
                    (base - self.predicted([effect for effect in effects if effect != own]))
                    / own.size
                )
                continue
            others = [effect for effect in effects if effect.candidate != candidate]
            step = (
                calc_size_scale(candidate.id, self.machine)
                * CATALOGUE[candidate.id].effect.probes[0]
            )
            columns.append((self.predicted([*others, SizedEffect(candidate, step)]) - base) / step)
        return base, np.column_stack([np.zeros((len(base), 0)), *columns])


class _JudgedPiece(NamedTuple):
    """One piece with its noise and its clock. Settings are numbered from 0 in each piece."""

    piece: TablePiece
    nominal: Array
    setting: IntArray
    noise: TableNoise
    clock: CoarseClock | None
    # s.d. of what the replicates of a setting share by rounding
    rounding: float


def make_problem(pieces: Sequence[TablePiece], machine: Machine, seed: int = 0) -> TableProblem:
    """Puts the pieces side by side; estimates each one's noise from its replicates, else about
    a smooth fit.

    Where times come in steps that the scatter does not even out, the rounding of each setting
    is a nuisance.
    """
    judged = [_judge_piece(piece, machine, seed + index) for index, piece in enumerate(pieces)]
    starts = np.cumsum([0, *(int(one.setting.max()) + 1 for one in judged)])
    setting = np.concatenate(
        [one.setting + start for one, start in zip(judged, starts[:-1], strict=True)]
    )
    index = np.concatenate([np.full(len(piece.observed), k) for k, piece in enumerate(pieces)])
    rounding = np.concatenate([np.full(len(one.setting), one.rounding) for one in judged])
    group, names = _number_groups(pieces)
    candidates = list(
        dict.fromkeys(candidate for piece in pieces for candidate in piece.candidates)
    )
    scopes = [frozenset({number}) for number in range(len(names))]
    if len(names) > 1:
        candidates += _list_scoped_candidates(pieces, group, index)
        together, shared = _merge_field_groups(pieces, candidates, scopes, group, index)
        scopes += together
        candidates += shared
    stated = judged[0].piece.noise_sd if len(judged) == 1 else None
    return TableProblem(
        tuple(pieces),
        machine,
        np.concatenate([one.noise.winsorised for one in judged]),
        np.concatenate([one.nominal for one in judged]),
        np.concatenate([one.noise.sd for one in judged]),
        index,
        group,
        names,
        tuple(scopes),
        setting,
        tuple(candidates),
        _stack_tolerances(pieces),
        rounding,
        1.0 if stated is None else float(stated / np.median(judged[0].noise.sd)),
        tuple(one.noise for one in judged),
        tuple(k for k, one in enumerate(judged) if len(judged) > 1 and not one.noise.by_replicates),
        tuple(one.clock for one in judged),
    )


def _judge_piece(piece: TablePiece, machine: Machine, seed: int) -> _JudgedPiece:
    setting, nominal = number_settings(piece), piece.predict(machine)
    noise = estimate_table_noise(piece, setting, nominal)
    clock = _find_clock_step(piece, setting, noise.outliers, seed) if piece.clocked else None
    typical = float(np.median(noise.sd))
    return _JudgedPiece(
        piece,
        nominal,
        setting,
        noise,
        clock,
        max(find_rounding_sd(clock, typical), _calc_digit_sd(piece, setting, typical)),
    )


def _find_clock_step(
    piece: TablePiece, setting: IntArray, outliers: IntArray, seed: int
) -> CoarseClock | None:
    """Steps in the times about the medians of settings with replicates, else about a smooth fit."""
    counts = np.bincount(setting)
    medians = np.array([np.median(piece.observed[setting == k]) for k in range(len(counts))])
    centres = np.where(
        counts[setting] >= MIN_MEDIAN_ROWS,
        medians[setting],
        smooth_by_settings(piece, piece.observed)[0],
    )
    near = np.delete(np.arange(len(setting)), outliers)
    return find_clock_step(piece.observed[near], centres[near], resolution_of(piece.observed), seed)


def _calc_digit_sd(piece: TablePiece, setting: IntArray, scatter: float) -> float:
    """S.d. of the rounding that replicates share because they scatter less than the last digit;
    0: they do not."""
    quantum = find_quantum(piece.observed)
    repeated = len(setting) - len(np.unique(setting)) >= MIN_SHARED
    return quantum / float(np.sqrt(12.0)) if repeated and scatter < DITHERED * quantum else 0.0


def number_settings(piece: TablePiece) -> IntArray:
    """Index of the setting of each row, (n,): rows with the same label and variables but for
    the replicate."""
    keys = [
        piece.group.tolist(),
        *(
            np.round(values, 9).tolist()
            for name, values in piece.variables.items()
            if name != "replicate"
        ),
    ]
    rows = list(zip(*keys, strict=True))
    order = {row: k for k, row in enumerate(dict.fromkeys(rows))}
    return np.array([order[row] for row in rows], dtype=np.int64)


def _number_groups(pieces: Sequence[TablePiece]) -> tuple[IntArray, tuple[tuple[str, str], ...]]:
    """Group of each row and (table, label) of each group: columns of one table share theirs."""
    names: dict[tuple[str, str], int] = {}
    rows = []
    for piece in pieces:
        rows += [names.setdefault((piece.table, text), len(names)) for text in piece.group.tolist()]
    return np.array(rows), tuple(names)


def _list_scoped_candidates(
    pieces: Sequence[TablePiece], group: IntArray, index: IntArray
) -> list[TableCandidate]:
    """Effects that may hold in one group only, group by group."""
    found = []
    for number in np.unique(group).tolist():
        ids = dict.fromkeys(
            effect_id
            for k in np.unique(index[group == number]).tolist()
            for effect_id in pieces[k].scoped_ids
        )
        found += [TableCandidate(effect_id, None, number) for effect_id in ids]
    return found


def _merge_field_groups(
    pieces: Sequence[TablePiece],
    candidates: Sequence[TableCandidate],
    scopes: Sequence[frozenset[int]],
    group: IntArray,
    index: IntArray,
) -> tuple[list[frozenset[int]], list[TableCandidate]]:
    """Times of one label and what was measured on the ground, as one scope: one cause in the
    field is one quantity.

    Times may have been read off distances in the same field in which other tables measured
    places.
    """
    ground = frozenset(
        number
        for k, piece in enumerate(pieces)
        if piece.on_ground
        for number in np.unique(group[index == k]).tolist()
    )
    found, shared = [], []
    for candidate in candidates:
        if candidate.scope is None or candidate.scope in ground or not ground:
            continue
        scope = scopes[candidate.scope] | ground
        if scope not in found:
            found.append(scope)
        shared.append(candidate._replace(scope=len(scopes) + found.index(scope)))
    return found, shared


def _stack_tolerances(pieces: Sequence[TablePiece]) -> Array:
    names = list(dict.fromkeys(name for piece in pieces for name in piece.nuisances))
    parts = [
        np.column_stack(
            [piece.nuisances.get(name, np.zeros(len(piece.observed))) for name in names]
        )
        if names
        else np.zeros((len(piece.observed), 0))
        for piece in pieces
    ]
    return np.concatenate(parts)
