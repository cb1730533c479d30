"""The logs of a season as arrays: each a Gaussian likelihood of all sizes, its machine's tolerances kept apart.

A log's form (`evidence.QuadraticForm`) says of the sizes x: right' x - x' normal x / 2, with what the machine may be
off within its tolerances counted as noise of the log's own. Over many logs of one machine it is none: it is the same u,
one s.d. each, in all of them. `pulls` says how u moves `right`; with it the form is taken apart again into one of (x,
u), from which the season's model integrates u once for each machine instead of once for each log.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from control.diagnosis.judgement.gaussian import Array, Gaussian, Indices

from .evidence import QuadraticForm

NOTHING = 1e-9              # of a form's largest eigenvalue: less says nothing
LEAST_OWN = 1e-3            # of a log's variance, that is not the machine's tolerances


class OneLog(NamedTuple):
    """A log as the season sees it. time_d: days, any origin, the same for all."""

    key: str
    machine: str
    time_d: float
    forms: tuple[QuadraticForm, ...]
    shared: Mapping[str, str] = {}          # factor (product, operator, field) -> level; "" not known


class Logs(NamedTuple):
    """n logs, by machine and time; the last t of q + t columns are tolerances; zeros where a log tells nothing."""

    logs: tuple[OneLog, ...]
    times_d: Array              # (n,)
    machines: tuple[str, ...]
    machine: Indices               # (n,) into machines
    names: tuple[str, ...]      # (q,) effects
    every: Gaussian             # (n, q + t, q + t) and (n, q + t)

    def of(self, machine: int) -> Indices:
        return np.flatnonzero(self.machine == machine)


def stacked(logs: Sequence[OneLog]) -> Logs:
    every = sorted(logs, key=lambda one: (one.machine, one.time_d, one.key))
    names = sorted({name for log in every for form in log.forms for name in form.names})
    open_ = sorted({name for log in every for form in log.forms for name in form.open})
    place = {name: k for k, name in enumerate(names)}
    at_open = {name: len(names) + k for k, name in enumerate(open_)}
    machines = sorted({log.machine for log in every})
    width = len(names) + len(open_)
    normal, right = np.zeros((len(every), width, width)), np.zeros((len(every), width))
    for j, log in enumerate(every):
        for form in log.forms:
            here = [*(place[name] for name in form.names), *(at_open[name] for name in form.open)]
            part, score = _taken_apart(form)
            normal[np.ix_([j], here, here)] += part
            right[j, here] += score
    return Logs(tuple(every), np.array([log.time_d for log in every]), tuple(machines),
                np.array([machines.index(log.machine) for log in every], np.int64), tuple(names),
                Gaussian(normal, right))


def _taken_apart(form: QuadraticForm) -> tuple[Array, Array]:
    """Normal and right of (x, u): in the directions that the form knows, y = A x + W u + e, cov(W u + e) = 1."""
    values, vectors = np.linalg.eigh(np.array(form.normal, np.float64))
    known = values > NOTHING * max(float(values[-1]), 1e-300)
    root = np.sqrt(values[known])
    if not len(root):
        return np.zeros((len(form.names) + len(form.open),) * 2), np.zeros(len(form.names) + len(form.open))
    seen = vectors[:, known].T
    pulls = np.array(form.pulls, np.float64).reshape(len(form.names), len(form.open))
    both = np.concatenate([root[:, None] * seen, seen @ pulls / root[:, None]], axis=1)
    own = np.eye(len(root)) - both[:, len(form.names):] @ both[:, len(form.names):].T
    shares, axes = np.linalg.eigh(own)
    weighted = (axes / np.maximum(shares, LEAST_OWN)) @ axes.T @ both
    return both.T @ weighted, weighted.T @ (seen @ np.array(form.right) / root)


def with_scatter(every: Gaussian, variance: Array) -> tuple[Gaussian, float]:
    """The logs' products (n, w, w) and (n, w) where each size also scatters by `variance` (n, w) of its own from log to
    log, and what that is worth by itself (log marginal likelihood)."""
    here = np.flatnonzero(np.any(variance > 0.0, axis=0))
    own = every.of(here).fit(np.sqrt(variance[:, here]))
    return every.beyond(every.A[:, :, here], own), float(np.sum(own.gain))
