"""Diagnosis of a run log, from columns to verdict."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy.typing as npt

from control.diagnosis.result import Diagnosis
from control.machine.machine import Machine

from .channels import ChannelSeries, channels
from .findings import between_rows, on_the_whole, step_findings
from .intermittent import ReadOff, without_spells
from .log import Clean, gate
from .model import GROUPS
from .quantised import without_steps
from .report import report
from .search import Search
from .selection import Judged, judged
from .stages import RunData, run_data

Progress = Callable[[float, str], None]
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


class Cancelled(Exception):
    """The caller asked to stop."""


def diagnose_run(columns: Mapping[str, npt.NDArray[Any]], machine: Machine, *, path: str = "",
                 progress: Progress | None = None, cancelled: Callable[[], bool] | None = None,
                 seed: int = 0, each: Each = map) -> Diagnosis:
    """What the machine model gets wrong in a run log, and why.

    columns : arrays (n,) by the run log's column names and units; float with NaN for not known, texts as objects.
    progress : called with a share 0 to 1 and a word; cancelled : asked between steps, True raises `Cancelled`.
    each : `map`, or a pool's: the groups of channels may be judged side by side.
    Raises ValueError with one plain line where the log cannot be used at all.
    """
    def step(share: float, word: str) -> None:
        if cancelled is not None and cancelled():
            raise Cancelled
        if progress is not None:
            progress(share, word)
    step(0.0, "data")
    log, data, read_off = _series(columns, machine)
    seen = channels(data, machine)
    findings = [*log.findings, *step_findings(seen, machine)]
    step(0.1, "model")
    found = _judged(seen, machine, data, step, each)
    findings += on_the_whole(log, found, machine)
    findings += between_rows(log, {part.id for one in found for part in one.found.parts})
    step(0.9, "result")
    return report(data, machine, found, read_off, path, tuple(findings))


def _series(columns: Mapping[str, npt.NDArray[Any]], machine: Machine) -> tuple[Clean, RunData, tuple[ReadOff, ...]]:
    """The cleaned log, its channels with what comes in steps or spells taken out, and the effects that those were."""
    log, in_steps = without_steps(gate(columns), machine)
    data = run_data(log, machine)
    if in_steps is not None and data.shaft is not None:
        data = data._replace(shaft=data.shaft._replace(step=in_steps.part.size))
    data, in_spells = without_spells(data, machine)
    return log, data, in_spells if in_steps is None else (in_steps, *in_spells)


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
