"""Diagnosis of a run log, from columns to verdict."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy.typing as npt

from control.diagnosis.result import Diagnosis
from control.machine.machine import Machine

from .channels import ChannelSeries, channels
from .findings import between_rows, on_the_whole, unsure_drives
from .hum import without_hum
from .intermittent import ReadOff, without_spells
from .log import Clean, gate
from .model import GROUPS
from .quantised import without_steps
from .rates import rates, sentence
from .report import report
from .row_order import in_order
from .search import Search
from .selection import Judged, judged
from .stages import RunData, run_data

Progress = Callable[[float, str], None]
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


class Cancelled(Exception):
    """The caller asked to stop."""


class JudgedRun(NamedTuple):
    """A diagnosis, the log as its stages see it, and its groups of channels with their searches."""

    found: Diagnosis
    data: RunData
    groups: tuple[Judged, ...]


def diagnose_run(columns: Mapping[str, npt.NDArray[Any]], machine: Machine, *, path: str = "",
                 progress: Progress | None = None, cancelled: Callable[[], bool] | None = None,
                 seed: int = 0, each: Each = map) -> Diagnosis:
    """What the machine model gets wrong in a run log, why, and what putting it right gains.

    Parameters
    ----------
    columns
        Arrays of shape (n,), one row a control tick or any other step, by the run log's column names and units
        (contract of the run log): float64 with NaN for not known, texts as objects. Only `time_s` is needed; a stage
        without its columns is left out and said in the findings.
    machine
        The machine as its file has it. Its tolerances are priors; sizes found are on top of its own effects.
    path
        Of the data, for the result.
    progress
        `progress(share, word)` is called between steps, share from 0 to 1.
    cancelled
        Asked between steps; True ends the diagnosis with `Cancelled`.
    seed
        Not used: the bootstrap has its own seed. It is here so that both entries have the same arguments.
    each
        `map`, or that of a pool: the groups of channels may be judged side by side.

    Returns
    -------
    Diagnosis
        By the contract "topdress-diagnosis/1". Sizes and their 90 % intervals are in the catalogue's units
        (`topdress effects`), residuals in r/min, mm, kg, kg/s, m/s and NDVI. Field costs are % and m.

    Raises
    ------
    ValueError
        One line, where there is no time column or fewer rows than a diagnosis needs.
    Cancelled
        Where `cancelled` said so.

    Notes
    -----
    Each channel is predicted through the machine model from the measured output of the stage before. The likelihood is
    Whittle's, in the cosine domain, with a fast and a slow noise refitted under every hypothesis [1]_; heavy tails are
    drawn in by pseudo-values [2]_. Effects enter by a score test of their simulated column, then by stepwise selection
    with refits through the model [3]_. What noise alone would give is a wild block bootstrap of the whitened residual
    [4]_. The gain is measured on blocks that no size was fitted to.

    References
    ----------
    .. [1] Whittle, Estimation and information in stationary time series, Arkiv for Matematik 2, 1953.
    .. [2] Huber and Ronchetti, Robust Statistics, 2nd ed., 2009, 7.8.
    .. [3] Miller, Subset Selection in Regression, 2nd ed., 2002, ch. 3.
    .. [4] Wu, Jackknife, bootstrap and other resampling methods, Annals of Statistics 14, 1986.

    Examples
    --------
    Four minutes in which the wheel reads 2 % more than the ground speed, ten rows a second:

    >>> import numpy as np
    >>> from control.machine.machine import Machine
    >>> rng, time_s = np.random.default_rng(1), np.arange(0.0, 240.0, 0.1)
    >>> speed_mps = 1.3 + 0.2 * np.sin(time_s / 7.0)
    >>> columns = {"time_s": time_s, "speed_mps": speed_mps + 0.03 * rng.standard_normal(2400),
    ...            "wheel_speed_mps": 1.02 * speed_mps + 0.02 * rng.standard_normal(2400)}
    >>> found = diagnose_run(columns, Machine())
    >>> found.verdict, [(cause.id, round(cause.size.value, 1), cause.size.unit) for cause in found.causes]
    ('named', [('speed.wheel_radius', 2.0, '%')])
    >>> found.gain[0].after < 0.9 * found.gain[0].before
    True
    """
    return judged_run(columns, machine, path=path, progress=progress, cancelled=cancelled, each=each).found


def judged_run(columns: Mapping[str, npt.NDArray[Any]], machine: Machine, *, path: str = "",
               progress: Progress | None = None, cancelled: Callable[[], bool] | None = None,
               each: Each = map) -> JudgedRun:
    """As `diagnose_run`, with what it was made of."""
    def step(share: float, word: str) -> None:
        if cancelled is not None and cancelled():
            raise Cancelled
        if progress is not None:
            progress(share, word)
    step(0.0, "data")
    log, data, read_off = series_of_log(columns, machine)
    seen, hums = without_hum(channels(data, machine), machine)
    findings = [*log.findings, *unsure_drives(log, data), *hums]
    step(0.1, "model")
    groups = _judged(seen, machine, data, step, each)
    findings += on_the_whole(log, groups, machine)
    findings += between_rows(log, {part.id for one in groups for part in one.found.parts})
    step(0.9, "result")
    told = report(data, machine, groups, read_off, path, tuple(findings))
    told = _with_rates(told, columns) if told.verdict == "not_judged" else told
    return JudgedRun(told, data, tuple(groups))


def _with_rates(found: Diagnosis, columns: Mapping[str, npt.NDArray[Any]]) -> Diagnosis:
    """What such data show all the same: the applied rate against the target."""
    fits, why = rates(columns)
    said = sentence(fits[0]) if fits else f"applied against target is not judged: {why}"
    return replace(found, rates=fits, findings=(*found.findings, said))


def series_of_log(columns: Mapping[str, npt.NDArray[Any]], machine: Machine,
                  ordered: Callable[[Clean, Machine], Clean] = in_order
                  ) -> tuple[Clean, RunData, tuple[ReadOff, ...]]:
    """The cleaned log, its channels with what comes in steps or spells taken out, and the effects that those were."""
    log = ordered(gate(columns), machine)
    in_steps = without_steps(log, machine)
    if in_steps is None:
        data, in_spells = without_spells(run_data(log, machine), machine)
        return log, data, in_spells
    log, part = in_steps.taken_back, in_steps.seen.part
    data = run_data(log, machine)
    if data.shaft is not None:
        data = data._replace(shaft=data.shaft._replace(step=part.size, steps_from_s=part.onset_s),
                             hopper=run_data(in_steps.turned, machine).hopper)
    data, in_spells = without_spells(data, machine)
    return log, data, (in_steps.seen, *in_spells)


def _judged(seen: Mapping[str, ChannelSeries], machine: Machine, data: RunData, step: Callable[[float, str], None],
            each: Each) -> list[Judged]:
    """Each group of channels judged: they share nothing but the log."""
    def judge(members: list[ChannelSeries]) -> Judged:
        return judged(Search(members, machine, data))

    groups = {word: [seen[c] for c in names if c in seen] for word, names in GROUPS.items()}
    words = [word for word, members in groups.items() if members]
    found: list[Judged] = []
    for word, one in zip(words, each(judge, [groups[word] for word in words]), strict=True):
        found.append(one)
        step(0.1 + 0.8 * len(found) / len(words), word)
    return found
