"""All pieces of a diagnosis side by side: rows, their noise, the effects that may be hypothesised."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from control.machine.machine import CATALOGUE, Machine

from .clock import DITHERED, Clock, coarse_clock, rounding_s
from .noise import Scatter, quantum_of, resolution_of, scatter_of, smoothed
from .piece import Array, Choice, Piece, Sized, Whole, with_more

LEAST_SHARED = 4        # replicates beyond the first of each setting
PRIOR_DOF = 1.0         # weight of the machine file's sensor noise, where it states one, in rows


class Problem(NamedTuple):
    """Rows (n,) of all pieces. `sd`: absolute noise; `group`: label within a table; `setting`: rows set alike."""

    pieces: tuple[Piece, ...]
    machine: Machine
    observed: Array                         # outliers among replicates drawn in
    nominal: Array
    sd: Array
    piece: Whole
    group: Whole
    group_names: tuple[str, ...]
    setting: Whole
    choices: tuple[Choice, ...]
    nuisances: Array                        # (n, q)
    prior_rss: float                        # one row of noise as the machine file has it, in units of sd
    prior_dof: float
    scatter: tuple[Scatter, ...]
    clocks: tuple[Clock | None, ...]        # of each piece: steps in its times

    @property
    def least_variance(self) -> float:
        """In units of sd squared: rows that scatter less than their replicates or digits do not narrow tolerances."""
        return max(1e-9, min(scatter.least for scatter in self.scatter))

    def predicted(self, parts: Sequence[Sized]) -> Array:
        """The model's rows with the parts in the machine, each in its own scope."""
        out = self.nominal.copy()
        for index, piece in enumerate(self.pieces):
            inside = self.piece == index
            done: dict[tuple[Sized, ...], Array] = {}
            for group in np.unique(self.group[inside]).tolist():
                here = tuple(part for part in parts if part.choice.scope in (None, group))
                if not here:
                    continue
                if here not in done:
                    done[here] = piece.predict(with_more(self.machine, here))
                rows = self.group == group
                out[rows & inside] = done[here][self.group[inside] == group]
        return out

    def slopes(self, parts: Sequence[Sized] = ()) -> tuple[Array, Array]:
        """Rows under the parts, (n,), and their change per unit of each choice's size on top of the parts, (n, c).

        Of a part itself it is the mean slope from neutral to its size.
        """
        base = self.predicted(parts)
        columns = []
        for choice in self.choices:
            own = next((part for part in parts if part.choice == choice and part.size), None)
            if own is not None:
                columns.append((base - self.predicted([part for part in parts if part != own])) / own.size)
                continue
            others = [part for part in parts if part.choice != choice]
            step = CATALOGUE[choice.id].effect.probes[0]
            columns.append((self.predicted([*others, Sized(choice, step)]) - base) / step)
        return base, np.column_stack([np.zeros((len(base), 0)), *columns])


def problem_of(pieces: Sequence[Piece], machine: Machine, seed: int = 0) -> Problem:
    """Puts the pieces side by side; estimates each one's noise from its replicates, else about a smooth fit.

    Where times come in steps that the scatter does not even out, the rounding of each setting is a nuisance.
    """
    names: list[str] = []
    groups, settings, indices, observed, nominal, sds, scatters = [], [], [], [], [], [], []
    clocks: list[Clock | None] = []
    rounded: list[Array] = []
    at = 0
    for index, piece in enumerate(pieces):
        table = piece.name.rsplit(" ", 1)[0]
        own = [f"{table}|{text}" for text in piece.group.tolist()]
        names += [name for name in dict.fromkeys(own) if name not in names]
        groups.append(np.array([names.index(name) for name in own]))
        setting = settings_of(piece)
        settings.append(setting + at)
        at += int(setting.max()) + 1
        nominal.append(piece.predict(machine))
        scatter = scatter_of(piece, setting, nominal[-1])
        scatters.append(scatter)
        clock = _clock(piece, setting, scatter.far, seed + index) if piece.clocked else None
        clocks.append(clock)
        typical = float(np.median(scatter.sd))
        step = max(rounding_s(clock, typical), _rounding_sd(piece, setting, typical))
        rounded.append(np.full(len(setting), step))
        observed.append(scatter.tamed)
        sds.append(scatter.sd)
        indices.append(np.full(len(piece.observed), index))
    group = np.concatenate(groups)
    choices = list(dict.fromkeys(choice for piece in pieces for choice in piece.choices))
    if len(names) > 1:
        choices += _scoped(pieces, group, np.concatenate(indices))
    prior = [piece.noise_sd for piece in pieces]
    known = len(pieces) == 1 and prior[0] is not None
    ratio = float(prior[0] / np.median(sds[0])) ** 2 if known and prior[0] is not None else 0.0
    return Problem(tuple(pieces), machine, np.concatenate(observed), np.concatenate(nominal), np.concatenate(sds),
                   np.concatenate(indices), group, tuple(names), np.concatenate(settings), tuple(choices),
                   np.column_stack([_nuisances(pieces), _rounding(np.concatenate(rounded), np.concatenate(settings))]),
                   PRIOR_DOF * ratio, PRIOR_DOF if known else 0.0, tuple(scatters), tuple(clocks))


def _clock(piece: Piece, setting: Whole, far: Whole, seed: int) -> Clock | None:
    """Steps in the times about the medians of settings with replicates, else about a smooth fit."""
    counts = np.bincount(setting)
    means = np.array([np.median(piece.observed[setting == k]) for k in range(len(counts))])
    centres = np.where(counts[setting] >= 3, means[setting], smoothed(piece, piece.observed)[0])
    near = np.delete(np.arange(len(setting)), far)
    return coarse_clock(piece.observed[near], centres[near], resolution_of(piece.observed), seed)


def _rounding_sd(piece: Piece, setting: Whole, scatter: float) -> float:
    """S.d. of the rounding that replicates share because they scatter less than the last digit; 0: they do not."""
    quantum = quantum_of(piece.observed)
    repeated = len(setting) - len(np.unique(setting)) >= LEAST_SHARED
    return quantum / float(np.sqrt(12.0)) if repeated and scatter < DITHERED * quantum else 0.0


def _rounding(sizes: Array, setting: Whole) -> Array:
    """One column for each setting whose times are rounded alike, (n, k)."""
    kinds = np.unique(setting[sizes > 0.0])
    return np.column_stack([np.zeros((len(setting), 0)), *(np.where(setting == k, sizes, 0.0) for k in kinds)])


def settings_of(piece: Piece) -> Whole:
    """Index of the setting of each row, (n,): rows with the same label and variables but for the replicate."""
    keys = [piece.group.tolist(), *(np.round(values, 9).tolist() for name, values in piece.variables.items()
                                    if name != "replicate")]
    rows = list(zip(*keys, strict=True))
    order = {row: k for k, row in enumerate(dict.fromkeys(rows))}
    return np.array([order[row] for row in rows], dtype=np.int64)


def _scoped(pieces: Sequence[Piece], group: Whole, index: Whole) -> list[Choice]:
    found = []
    for number in np.unique(group).tolist():
        ids = dict.fromkeys(effect_id for k in np.unique(index[group == number]).tolist()
                            for effect_id in pieces[k].scoped_ids)
        found += [Choice(effect_id, None, number) for effect_id in ids]
    return found


def _nuisances(pieces: Sequence[Piece]) -> Array:
    names = list(dict.fromkeys(name for piece in pieces for name in piece.nuisances))
    parts = [np.column_stack([piece.nuisances.get(name, np.zeros(len(piece.observed))) for name in names])
             if names else np.zeros((len(piece.observed), 0)) for piece in pieces]
    return np.concatenate(parts)
