"""Diagnosis of a run log, from columns to verdict."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from control.diagnosis.effects import ROWS
from control.diagnosis.result import (
    STRUCTURE_P,
    Cause,
    Channel,
    Data,
    Detectable,
    Diagnosis,
    Gain,
    NotShown,
    Rival,
    Size,
    TableFit,
    Unexplained,
    Verdict,
)
from control.machine.machine import CATALOGUE, Machine

from .channels import Channel as ChannelSeries
from .channels import channels, step_error
from .cost import field_cost
from .detectable import not_shown
from .gain import measure_gain
from .hypothesis import schedule, stages_of
from .intermittent import Seen, without_spells
from .likelihood import Z90
from .log import Clean, gate
from .next_run import next_run
from .nuisances import GROUPS, tolerance_of
from .onset import stop_interval
from .quantised import without_steps
from .report import shown
from .search import Group
from .selection import Named, name
from .stages import RunData, run_data
from .whole import on_the_whole

Progress = Callable[[float, str], None]
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
STEP_SHARE = 0.1            # halving the model's step may change a prediction by this share of the noise
TICK_S = 0.05               # control's usual tick
LOST_SHARE = 0.01           # of the rows


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
    log = gate(columns)
    log, in_steps = without_steps(log, machine)
    data = run_data(log, machine)
    if in_steps is not None and data.shaft is not None:
        data = data._replace(shaft=data.shaft._replace(step=in_steps.part.size))
    data, in_spells = without_spells(data, machine)
    seen_off = in_spells if in_steps is None else (in_steps, *in_spells)
    seen = channels(data, machine)
    findings = [*log.findings, *_step_findings(seen, machine)]
    step(0.1, "model")
    named = _named({word: [seen[c] for c in names if c in seen] for word, names in GROUPS.items()}, machine, data, step,
                   each)
    findings += on_the_whole(log, named, machine)
    findings += _between_rows(log, {part.id for one in named for part in one.found.parts})
    step(0.9, "result")
    return _result(log, data, machine, named, seen_off, path, tuple(findings))


def _named(groups: Mapping[str, list[ChannelSeries]], machine: Machine, data: RunData,
           step: Callable[[float, str], None], each: Each) -> list[Named]:
    """Each group of channels judged: they share nothing but the log."""
    def judged(members: list[ChannelSeries]) -> Named:
        return name(Group(members, machine, data))

    words = [word for word, members in groups.items() if members]
    named = []
    for word, one in zip(words, each(judged, [groups[word] for word in words]), strict=True):
        named.append(one)
        step(0.1 + 0.8 * len(named) / len(words), word)
    return named


def _step_findings(seen: Mapping[str, Any], machine: Machine) -> list[str]:
    plan = schedule(stages_of(machine), ())
    found = []
    for word in ("shaft", "gate"):
        if word in seen and (error := step_error(seen[word], plan)) > STEP_SHARE:
            found.append(f"stage {word}: halving the model's step changes the prediction by {error:.2f} of the noise")
    return found


def _between_rows(log: Clean, ids: set[str]) -> list[str]:
    """Said of small faults of the drives where the log may not hold every command that was given."""
    steps = np.diff(log.time_s)
    lost = float(np.mean(steps > 1.5 * log.step_s)) if len(steps) else 0.0
    doubtful = sorted(one for one in ids if ROWS[one].move_shaped)
    if not doubtful or (log.step_s < TICK_S * 1.2 and lost < LOST_SHARE):
        return []
    why = f"{100.0 * lost:.0f} % of the rows are missing" if lost >= LOST_SHARE else \
        f"rows come every {log.step_s:.2g} s, and control may decide more often"
    return [f"{', '.join(doubtful)}: {why}: a command given between two rows is not in the log, and can look like "
            "this; a log of every tick would tell"]


def _result(log: Clean, data: RunData, machine: Machine, named: list[Named], seen_off: tuple[Seen, ...],
            path: str, findings: tuple[str, ...]) -> Diagnosis:
    causes: list[Cause] = []
    gains: list[Gain] = []
    tables: list[TableFit] = []
    unexplained: list[Unexplained] = []
    rows: list[Channel] = []
    absent: list[NotShown] = []
    for one in named:
        rows += shown(one, data, machine)
        if one.table is not None:
            tables.append(TableFit(one.table.stage, one.table.variable, one.table.nodes, one.table.values))
            unexplained.append(Unexplained(one.table.stage, one.table.variable, one.table.explained_share))
        for k in range(len(one.found.parts)):
            causes.append(_cause(one, k, machine, data))
        absent += not_shown(one)
        gains += measure_gain(one)
    for seen in seen_off:
        causes.append(_seen_cause(seen, machine, data))
        absent = [a for a in absent if a.id != seen.part.id]
    if not causes and not unexplained:
        unexplained = _not_noise(rows, named)
    there = {c.id for c in causes} | {a.id for a in absent}
    absent += [NotShown(effect_id, Detectable(None, entry.effect.unit))
               for effect_id, entry in CATALOGUE.items() if effect_id not in there]
    verdict: Verdict = "none" if rows else "not_judged"
    if unexplained:
        verdict = "unexplained"
    elif any(c.rivals for c in causes):
        verdict = "ambiguous"
    elif causes:
        verdict = "named"
    order = sorted(causes, key=lambda c: -(abs(c.field_cost.rate_error_percent or 0.0)
                                           + 10.0 * abs(c.field_cost.place_error_m or 0.0)))
    excited = {word: (float(np.percentile(series, 1.0)), float(np.percentile(series, 99.0)))
               for word, series in data.variables.items()}
    plan = next_run(causes, machine) if verdict == "ambiguous" else None
    return Diagnosis(Data(path, "run", data.rows, data.duration_s, machine.id), tuple(rows), verdict, tuple(order),
                     tuple(absent), tuple(unexplained), plan, tuple(gains), None, findings, tuple(tables), excited)


def _not_noise(rows: Sequence[Channel], named: Sequence[Named]) -> list[Unexplained]:
    """Channels whose structure is no chance, though every name for it was refused: one of each group."""
    found = []
    for one in named:
        inside = [c for c in rows if c.channel in one.group.names and c.structure_p < STRUCTURE_P]
        if inside:
            worst = max(inside, key=_structure_share)
            found.append(Unexplained(worst.channel, "", _structure_share(worst)))
    return found


def _structure_share(channel: Channel) -> float:
    """Of a channel's mean square error, what is above its noise."""
    return max(0.0, 1.0 - (channel.noise_floor / max(channel.rmse, 1e-300)) ** 2)


def _seen_cause(seen: Seen, machine: Machine, data: RunData) -> Cause:
    effect = CATALOGUE[seen.part.id].effect
    size = Size(seen.part.size, max(0.0, seen.part.size - Z90 * seen.sd), seen.part.size + Z90 * seen.sd, effect.unit)
    return Cause(seen.part.id, size, None, float(1.0 - chi2.sf(seen.gain, 1.0)), (), None, effect.advice,
                 field_cost(seen.part, machine, data))


def _cause(one: Named, k: int, machine: Machine, data: RunData) -> Cause:
    part, sd = one.found.parts[k], one.found.sd[k]
    entry = CATALOGUE[part.id]
    unit = entry.effect.unit
    weights = np.exp(-0.5 * np.array([0.0, *(max(0.0, r.behind) for r in one.rivals[k])]))
    nothing = float(chi2.sf(one.gains[k], 1.0))
    shares = weights / (weights.sum() + nothing)
    if entry.effect.onset_only:
        size = Size(part.onset_s, *stop_interval(one.group, part), unit)
    else:
        sd = float(np.hypot(sd, tolerance_of(part.id, machine)))
        low, high = part.size - Z90 * sd, part.size + Z90 * sd
        size = Size(part.size, low, high, unit)
    rivals = tuple(Rival(r.part.id, float(p)) for r, p in zip(one.rivals[k], shares[1:], strict=True))
    return Cause(part.id, size, part.onset_s, float(shares[0]), rivals, part.member, entry.effect.advice,
                 field_cost(part, machine, data))
