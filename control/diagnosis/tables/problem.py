"""Joins all pieces of a diagnosis: rows, their noise, and the candidate effects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.machine.machine import CATALOGUE, Machine, calc_size_scale

from .coarse_clock import MIN_SCATTER_IN_STEPS, CoarseClock, find_clock_step, find_rounding_sd
from .table_noise import (
    TableNoise,
    estimate_table_noise,
    find_quantum,
    find_resolution,
    smooth_by_settings,
)
from .table_series import (
    Array,
    IntArray,
    MeasuredSeries,
    SizedEffect,
    TableCandidate,
    add_effects,
    describe_scope,
)

# Minimum number of replicates beyond the first of each setting for their common rounding to be
# modelled.
MIN_EXTRA_REPLICATES = 4
# Minimum number of replicates whose median represents their true time.
MIN_MEDIAN_ROWS = 3


class TableProblem(NamedTuple):
    """Rows (n,) of all pieces. `group`: label within a table; `setting`: rows with the same
    setting."""

    pieces: tuple[MeasuredSeries, ...]
    machine: Machine
    # Measured values with winsorised outliers among replicates.
    observed: Array
    nominal: Array
    # Standard deviation of the noise.
    sd: Array
    piece: IntArray
    group: IntArray
    # Table and label of each group.
    group_names: tuple[tuple[str, str], ...]
    # Sets of groups in which an effect may hold alone: each group, then some together.
    scopes: tuple[frozenset[int], ...]
    setting: IntArray
    candidates: tuple[TableCandidate, ...]
    # Change of the rows by each tolerance of the machine file at its full size, (n, q).
    nuisances: Array
    # Standard deviation of the rounding error common to all rows of a setting, (n,).
    rounding: Array
    # Noise by the machine file, in units of sd.
    usual_noise: float
    noise: tuple[TableNoise, ...]
    # Indices of pieces, among several, without replicates.
    unrepeated: tuple[int, ...]
    # Clock step of each piece's times.
    clocks: tuple[CoarseClock | None, ...]

    @property
    def min_variance(self) -> float:
        """Lower bound of the rows' variance from their last digit, in units of sd squared."""
        return max(1e-9, min(noise.min_variance for noise in self.noise))

    def predict(self, effects: Sequence[SizedEffect]) -> Array:
        """Return the model's rows with the effects in the machine, each in its own scope."""
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

    def _applies_to(self, candidate: TableCandidate, piece: MeasuredSeries, group: int) -> bool:
        if candidate.scope is None:
            return candidate.id not in piece.named_only
        return group in self.scopes[candidate.scope]

    def scope_name(self, scope: int) -> str:
        return describe_scope(self.group_names[group] for group in sorted(self.scopes[scope]))

    def calc_slopes(self, effects: Sequence[SizedEffect] = ()) -> tuple[Array, Array]:
        """Return the rows under the effects, (n,), and their change per unit of each candidate's
        size, (n, c).

        For one of the effects itself the change is the mean slope from neutral to its size.
        """
        base = self.predict(effects)
        columns = []
        for candidate in self.candidates:
            own = next(
                (effect for effect in effects if effect.candidate == candidate and effect.size),
                None,
            )
            if own is not None:
                columns.append(
                    (base - self.predict([effect for effect in effects if effect != own]))
                    / own.size
                )
                continue
            others = [effect for effect in effects if effect.candidate != candidate]
            step = (
                calc_size_scale(candidate.id, self.machine)
                * CATALOGUE[candidate.id].effect.probes[0]
            )
            columns.append((self.predict([*others, SizedEffect(candidate, step)]) - base) / step)
        return base, np.column_stack([np.zeros((len(base), 0)), *columns])


class _JudgedPiece(NamedTuple):
    """One piece with its noise and its clock. Settings are numbered from 0 in each piece."""

    piece: MeasuredSeries
    nominal: Array
    setting: IntArray
    noise: TableNoise
    clock: CoarseClock | None
    # Standard deviation of the rounding error that the replicates of a setting share.
    rounding: float


def make_problem(pieces: Sequence[MeasuredSeries], machine: Machine, seed: int = 0) -> TableProblem:
    """Join the pieces, and estimate the noise of each from its replicates, or else from a smooth
    fit.

    Where times have steps that the scatter does not average out, the rounding of each setting is a
    nuisance.
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


def _judge_piece(piece: MeasuredSeries, machine: Machine, seed: int) -> _JudgedPiece:
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
    piece: MeasuredSeries, setting: IntArray, outliers: IntArray, seed: int
) -> CoarseClock | None:
    """Return the clock step in the times around the medians of settings with replicates, or else
    around a smooth fit."""
    counts = np.bincount(setting)
    medians = np.array([np.median(piece.observed[setting == k]) for k in range(len(counts))])
    centres = np.where(
        counts[setting] >= MIN_MEDIAN_ROWS,
        medians[setting],
        smooth_by_settings(piece, piece.observed)[0],
    )
    near = np.delete(np.arange(len(setting)), outliers)
    return find_clock_step(
        piece.observed[near], centres[near], find_resolution(piece.observed), seed
    )


def _calc_digit_sd(piece: MeasuredSeries, setting: IntArray, scatter: float) -> float:
    """Return the s.d. of the rounding error that replicates share because they scatter less than
    the last digit; 0 where they do not."""
    quantum = find_quantum(piece.observed)
    repeated = len(setting) - len(np.unique(setting)) >= MIN_EXTRA_REPLICATES
    return (
        quantum / float(np.sqrt(12.0))
        if repeated and scatter < MIN_SCATTER_IN_STEPS * quantum
        else 0.0
    )


def number_settings(piece: MeasuredSeries) -> IntArray:
    """Return the index of the setting of each row, (n,): rows with the same label and variables
    except the replicate."""
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


def _number_groups(
    pieces: Sequence[MeasuredSeries],
) -> tuple[IntArray, tuple[tuple[str, str], ...]]:
    """Return the group of each row, and table and label of each group; columns of one table share
    their groups."""
    names: dict[tuple[str, str], int] = {}
    rows = []
    for piece in pieces:
        rows += [
            names.setdefault((piece.table_name, text), len(names)) for text in piece.group.tolist()
        ]
    return np.array(rows), tuple(names)


def _list_scoped_candidates(
    pieces: Sequence[MeasuredSeries], group: IntArray, index: IntArray
) -> list[TableCandidate]:
    """Return the effects that may hold in one group only, group by group."""
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
    pieces: Sequence[MeasuredSeries],
    candidates: Sequence[TableCandidate],
    scopes: Sequence[frozenset[int]],
    group: IntArray,
    index: IntArray,
) -> tuple[list[frozenset[int]], list[TableCandidate]]:
    """Join times of one label and measurements on the ground in one scope, because one cause in the
    field is one quantity.

    Times may have been calculated from distances in the same field in which other tables measured
    positions.
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


def _stack_tolerances(pieces: Sequence[MeasuredSeries]) -> Array:
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
