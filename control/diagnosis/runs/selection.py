"""Which set of effects one group of channels shows: forward with refits, swaps and pruning, then its rivals."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS, FoundBy
from control.machine.machine import CATALOGUE

from .encoder import encoder_steps
from .evidence import chance, null_of_maximum, scores, slow_share, spread_over, unevenness, without_best_block
from .hypothesis import Part, Parts
from .likelihood import Column, best_fitted
from .nuisances import tolerance_of
from .onset import blocked, refined, still_disobeys, stops, with_onset
from .search import Found, Group, Refit
from .unexplained import SLOW_ENERGY, Table, gain_elsewhere, unexplained

Array = npt.NDArray[np.float64]

MAX_CAUSES = 4
THRESHOLD = 17.0            # of twice the log-likelihood; see docs/diagnosis.md for its calibration
ONSET_THRESHOLD = 16.0
RIVAL_GAP = 6.0             # rivals within this much of twice the log-likelihood: 95 % for one degree of freedom,
RIVAL_SHARE = 0.03          # ... and within this share of what the cause explains: forms are never quite right
TANGLED = 0.97              # two effects whose sizes hang together like this are not two findings
FALSE_ALARMS = 0.002        # of one group of channels in one log
MIN_WITHOUT_BLOCK = 0.5   # of the threshold, once the best block is left out
MIN_SHARE_WITHOUT_BLOCK = 0.2     # of the gain
DRIFT_FACTOR = 1.6          # of the threshold, for what is as slow as the drift that the log has
BEGUN_IN_DRIFT = 2.4        # of the threshold, for what begins at a time of its own in a log that drifts without it
MOVED_MARGIN = 1.5          # times what four smooth shapes of the same variable gain with it moved along the log ...
SURE = 4.0                  # ... asked of what gains less than so many thresholds
MAX_RIVALS = 12            # of a scan that are refitted
REFITTED = 4                # best of a scan that are refitted in full


class RivalOf(NamedTuple):
    part: Part                  # what could stand in its place
    behind: float               # by so much of twice the log-likelihood


class Named(NamedTuple):
    """What one group shows."""

    group: Group
    null: Refit
    found: Refit
    gains: tuple[float, ...]                    # of each part: twice the log-likelihood lost without it
    rivals: tuple[tuple[RivalOf, ...], ...]     # by part
    scan: tuple[Found, ...]                     # the whole catalogue on top of nothing
    table: Table | None                         # what no effect explains


def name(group: Group, threshold: float = THRESHOLD) -> Named:
    """Judge a group of channels."""
    group.candidates += [*stops(group, group.data), *encoder_steps(group)]
    if "scale" in group.names:
        group.candidates += blocked(group.data)
    group.settle(())
    group.tame(())
    group.settle(())
    null = group.refit(())
    first = group.scan((), null.noise)
    current = null
    for _ in range(MAX_CAUSES):
        better = _extended(group, current, threshold)
        if better is None:
            break
        group.unsettle()
        better = group.refit(better.parts, better.noise)
        better = group.refit(group.settle(better.parts), better.noise)
        current = _pruned(group, _swapped(group, better), threshold)
    if current.parts:
        group.tame(current.parts)
        current, null = group.refit(group.settle(current.parts), current.noise), group.refit(())
        if any(part.onset_s is not None for part in current.parts):
            current = refined(group, current, group.data)
        current = _pruned(group, with_onset(group, current, group.data, ONSET_THRESHOLD), threshold)
        current = _without_chance(group, current, threshold)
    explained = 2.0 * (current.log_likelihood - null.log_likelihood)
    table = unexplained(group, current, explained)
    if table is not None:
        beside = _beside_table(group, current, table, threshold)
        if beside is not current:
            current, table = beside, unexplained(group, beside, explained)
    gains, rivals = _rivals(group, current)
    return Named(group, null, current, gains, rivals, tuple(first), table)


def _extended(group: Group, now: Refit, threshold: float) -> Refit | None:
    """The hypothesis with one more part, where that gains more than the threshold."""
    found = _one_of_each(group.scan(now.parts, now.noise))
    ranked = [f for f in found if f.gain > 0.5 * threshold][:REFITTED]
    # How a drive runs down is nobody's effect: a column has it, a refit leaves it out.
    ranked = [f for f in ranked if not CATALOGUE[f.part.id].effect.onset_only]
    ranked += [f for f in found if CATALOGUE[f.part.id].effect.onset_only and still_disobeys(group, now.parts, f.part)]
    tried = [r for r in (group.refit((*now.parts, f.part), now.noise) for f in ranked) if r.tangled < TANGLED]
    if not tried:
        return None
    for best in sorted(tried, key=lambda r: -r.log_likelihood):
        gain = 2.0 * (best.log_likelihood - now.log_likelihood)
        if gain > threshold and _holds(group, best, len(now.parts), now, threshold):
            return best
    return None


def _holds(group: Group, found: Refit, k: int, without: Refit, threshold: float) -> bool:
    """Whether a part's evidence is more than this log's own noise gives: in size, over time, and beside its drift.

    A part that only one stretch of the log speaks for is no finding; what begins once (a stall) must show once only.
    """
    part, row = found.parts[k], ROWS[found.parts[k].id]
    gain = 2.0 * (found.log_likelihood - without.log_likelihood)
    if CATALOGUE[part.id].effect.onset_only or row.found_by is FoundBy.STEPS:
        return True
    others = (*found.parts[:k], *found.parts[k + 1:])
    if abs(part.size) < threshold ** 0.5 * tolerance_of(part.id, group.machine):
        return False
    trace = group.trace(found.parts, k)
    seen = scores(group, others, found.noise, [trace])
    share = 0.0 if row.threshold else MIN_SHARE_WITHOUT_BLOCK     # a threshold is passed now and then
    least = max(MIN_WITHOUT_BLOCK * threshold, share * gain)
    if without_best_block(seen, 0) < least or gain < threshold * spread_over(seen, 0) ** 0.5:
        return False
    if gain < DRIFT_FACTOR * threshold and _slow(group, trace, found):
        return False
    if part.onset_s is not None and gain < BEGUN_IN_DRIFT * threshold and _slow(group, trace, without):
        return False
    if row.along and gain < SURE * threshold and \
            gain < MOVED_MARGIN * gain_elsewhere(group, without, row.stage, row.along):
        return False
    tried = [c for c in group.candidates if (c.part.id, c.part.member) != (part.id, part.member)]
    every = scores(group, found.parts, found.noise, [group.candidate_column(others, c) for c in tried])
    return chance(null_of_maximum(every), gain / unevenness(seen, 0)) < FALSE_ALARMS


def _slow(group: Group, trace: Column, under: Refit) -> bool:
    """Whether a trace is as slow as the drift that a hypothesis leaves."""
    return any(slow_share(trace.coefficients[c.name], c, under.noise[c.name]) > SLOW_ENERGY
               for c in group.channels if c.name in trace.coefficients)


def _one_of_each(found: list[Found]) -> list[Found]:
    best: dict[tuple[str, int | None], Found] = {}
    for f in found:
        best.setdefault((f.part.id, f.part.member), f)
    return list(best.values())


def _swapped(group: Group, now: Refit) -> Refit:
    """Each member in turn against the best that could stand in its place."""
    if len(now.parts) < 2:
        return now
    best = now
    for k in range(len(now.parts)):
        others = (*best.parts[:k], *best.parts[k + 1:])
        for f in group.scan(others, best.noise)[:2]:
            if f.part.id == best.parts[k].id:
                continue
            tried = group.refit((*others, f.part), best.noise)
            if tried.tangled < TANGLED and tried.log_likelihood > best.log_likelihood + 1.0:
                best = tried
    return best


def _pruned(group: Group, now: Refit, threshold: float) -> Refit:
    """Members that the others make superfluous are dropped."""
    while len(now.parts) > 1:
        without = [group.refit((*now.parts[:k], *now.parts[k + 1:]), now.noise) for k in range(len(now.parts))]
        best = max(without, key=lambda r: r.log_likelihood)
        if 2.0 * (now.log_likelihood - best.log_likelihood) > threshold:
            break
        now = best
    return now


def _without_chance(group: Group, now: Refit, threshold: float) -> Refit:
    """Parts whose evidence does not hold beside the others are dropped."""
    for k in reversed(range(len(now.parts))):
        without = group.refit((*now.parts[:k], *now.parts[k + 1:]), now.noise)
        if not _holds(group, now, k, without, threshold):
            now = without
    return now


def _beside_table(group: Group, now: Refit, table: Table, threshold: float) -> Refit:
    """Members that a smooth dependence on one variable makes superfluous are dropped."""
    parts = now.parts
    while parts:
        with_all = _with_table(group, parts, now, table)
        without = [(_with_table(group, (*parts[:k], *parts[k + 1:]), now, table), k) for k in range(len(parts))]
        best, k = max(without)
        if 2.0 * (with_all - best) > threshold:
            break
        parts = (*parts[:k], *parts[k + 1:])
    return now if parts == now.parts else group.refit(parts, now.noise)


def _with_table(group: Group, parts: Parts, now: Refit, table: Table) -> float:
    columns: list[Column] = group.forms(table.stage, table.variable)
    p, before = group.compressed(parts, columns)
    return best_fitted(p, np.arange(before + len(columns)), now.noise, group.channels).log_likelihood


def _rivals(group: Group, now: Refit) -> tuple[tuple[float, ...], tuple[tuple[RivalOf, ...], ...]]:
    """Gain of each part, and what could stand in its place.

    Rivals are held against the noise that the best hypothesis leaves: a noise of its own, grown by what a rival does
    not explain, would excuse it.
    """
    gains: list[float] = []
    rivals: list[tuple[RivalOf, ...]] = []
    own_value = group.under(now.parts, now.noise) if now.parts else 0.0
    for k, part in enumerate(now.parts):
        others = (*now.parts[:k], *now.parts[k + 1:])
        alone = group.refit(others, now.noise)
        gain = 2.0 * (now.log_likelihood - alone.log_likelihood)
        reach = max(RIVAL_GAP, RIVAL_SHARE * gain)
        found = []
        scanned = _one_of_each(group.scan(others, alone.noise))[:MAX_RIVALS]
        own = max((f.gain for f in scanned if f.part.id == part.id), default=gain)
        for f in scanned:
            if f.part.id == part.id or f.gain < min(gain, own) - 3.0 * reach - 10.0:
                continue
            tried = group.refit((*others, f.part), now.noise)
            behind = 2.0 * (own_value - group.under(tried.parts, now.noise))
            if behind < reach:
                found.append(RivalOf(tried.parts[-1], behind))
        gains.append(gain)
        rivals.append(tuple(sorted(found, key=lambda r: r.behind)))
    return tuple(gains), tuple(rivals)


