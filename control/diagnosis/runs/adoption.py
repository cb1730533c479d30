"""What of a diagnosis a machine file may take up without making it predict worse.

Sizes of one group of channels are fitted together: what is wrong with one of them another one puts right. Where a part
is left out (it is undecided, and nobody picked it), the others are fitted anew without it, and are taken up only where
the log, and its blocks that they were not fitted to, are predicted better than by the machine file. What is whole is
held against the log itself: it may fit what the noise's memory weighs, and predict the rows worse. Causes with terms
stay as they are: what a term is worth on held-out rows was asked when it was found.
"""
from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS, FoundBy
from control.diagnosis.extend import extend, not_adoptable, taken_whole
from control.diagnosis.judgement.evidence import Z90, Role
from control.diagnosis.result import Cause, Diagnosis
from control.machine.machine import CATALOGUE

from .channels import ChannelSeries, channels
from .compared import compared
from .diagnose import series_of_log
from .held_out import HeldOut, amplitudes, errors_of, held_out
from .hypothesis import EffectInstance, Hypothesis
from .model import GROUPS
from .search import FittedHypothesis, Search
from .settle import settle

Array = npt.NDArray[np.float64]

ALONE = "without what is left out it predicts this log no better than before: they were fitted together"
WORSE = "the log itself is predicted no better with it"


class Adoptable(NamedTuple):
    """found : the diagnosis with the causes that go into a machine file, sizes as they are there. refused : (id, why)
    of those that were chosen and do not."""

    found: Diagnosis
    refused: tuple[tuple[str, str], ...]


def adoptable_of(found: Diagnosis, chosen: Collection[str]) -> Adoptable:
    """The chosen causes (by id) of a run log's diagnosis, those fitted together with what is left out fitted anew.

    Bench tables are returned as they are: their sizes are weighed over all models already.
    """
    kept = tuple(cause for cause in found.causes if cause.id in chosen and not not_adoptable(cause))
    if found.seen_with is None or found.data.kind != "run" or not kept:
        return Adoptable(replace(found, causes=kept), ())
    columns, machine = found.seen_with
    _, data, read_off = series_of_log(columns, machine)
    with np.errstate(all="ignore"):
        seen = channels(data, machine)
    off = {one.part.id for one in read_off}         # taken out before the search: by themselves
    causes: list[Cause] = []
    refused: list[tuple[str, str]] = []
    for cause in kept:
        if cause.id in off and _reads_better(found, cause):
            causes.append(cause)
        elif cause.id in off:
            refused.append((cause.id, WORSE))
    for names in GROUPS.values():
        own = [cause for cause in found.causes if ROWS[cause.id].channels[:1] and ROWS[cause.id].channels[0] in names]
        here = [cause for cause in own if cause in kept and cause.id not in off]
        termed = any(term.stage in names or (term.stage == "flow" and "scale" in names) for term in found.terms)
        if not here or termed or any(taken_whole(found, cause) for cause in here):
            causes += here
            continue
        left = [cause for cause in own if cause not in kept and not not_adoptable(cause)]
        search = Search([seen[name] for name in names if name in seen], machine, data)
        started_late = tuple(_part(cause) for cause in own if cause.id not in off and not_adoptable(cause)
                             and cause.size.value is not None)
        good, why = _without(search, here, started_late) if left else (_as_found(search, here, started_late), WORSE)
        causes += good
        refused += [] if good else [(cause.id, why) for cause in here]
    order = [cause.id for cause in found.causes]
    causes.sort(key=lambda cause: order.index(cause.id))
    return Adoptable(replace(found, causes=tuple(causes)), tuple(refused))


def _reads_better(found: Diagnosis, cause: Cause) -> bool:
    """Of what was read off the log before the search: whether its rows are predicted no worse with it. Steps of an
    encoder in a prediction help where it is within a step, and add their own rounding where it is not."""
    if ROWS[cause.id].found_by is not FoundBy.STEPS or found.seen_with is None:
        return True
    columns, machine = found.seen_with
    seen = compared(columns, machine, extend(machine, replace(found, causes=(cause,), terms=(), fitted=None)))
    return all(one.new <= one.old for one in seen.channels if one.channel == CATALOGUE[cause.id].stage)


def _part(cause: Cause) -> EffectInstance:
    return EffectInstance(cause.id, float(cause.size.value or 0.0), cause.onset_s, cause.member, cause.until_s,
                          cause.grows)


def _as_found(search: Search, here: list[Cause], started_late: Hypothesis) -> list[Cause]:
    """The causes as they are, where the log is predicted better with them than without."""
    model = search.model
    before, after = model.residual(started_late), model.residual((*started_late, *(_part(cause) for cause in here)))
    whole = [_over_all(channel) for channel in _moved(search, here)]
    return here if _better([(one, before[one.whole.name], after[one.whole.name]) for one in whole]) else []


def _without(search: Search, here: list[Cause], started_late: Hypothesis) -> tuple[list[Cause], str]:
    """The causes fitted anew without what is left out, where the log and its held-out blocks gain by them."""
    fit = _refitted(search, (*(_part(cause) for cause in here), *started_late))
    causes = [_resized(cause, fit, k) for k, cause in enumerate(here)]
    search.model.move({})               # a machine file has its nominal values as they are
    if not _as_found(search, causes, started_late):
        return [], ALONE
    slopes = search.columns.by_channel(fit.parts)
    before, at_fit = search.model.residual(started_late), search.model.residual(fit.parts)
    blocks = []
    for channel in _moved(search, here):
        name, cut = channel.name, held_out(channel)
        amplitude = amplitudes(cut, slopes[name], at_fit[name], fit.noise)
        change = sum((a * series for a, (column, series) in zip(amplitude, slopes[name], strict=True)
                      if column.label.role is Role.SLOPE), np.zeros(len(at_fit[name])))
        blocks.append((cut, before[name], at_fit[name] - change))
    return (causes, "") if _better(blocks) else ([], ALONE)


def _refitted(search: Search, parts: Hypothesis) -> FittedHypothesis:
    search.find_noise()
    fit = search.refit(parts)
    return search.refit(settle(search.columns, fit.parts), fit.noise)


def _resized(cause: Cause, fit: FittedHypothesis, k: int) -> Cause:
    size, sd = fit.parts[k].size, fit.sd[k]
    return replace(cause, size=replace(cause.size, value=size, low=size - Z90 * sd, high=size + Z90 * sd))


def _moved(search: Search, here: Sequence[Cause]) -> list[ChannelSeries]:
    """Channels that causes move, those that are read once."""
    names = {name for cause in here for name in ROWS[cause.id].channels}
    return [channel for channel in search.model.channels if channel.name in names and channel.copies == 1]


def _over_all(channel: ChannelSeries) -> HeldOut:
    return HeldOut(channel, channel, (slice(0, len(channel.measured)),))


def _better(series: Sequence[tuple[HeldOut, Array, Array]]) -> bool:
    """Whether errors after, (m,), are smaller than before, the channels taken together: the product of their ratios.
    A channel that is too short for blocks says nothing."""
    gained = []
    for blocks, before, after in series:
        _, _, old, new = errors_of(blocks, before, after)
        if len(old):
            gained.append(0.5 * float(np.log(np.mean(old ** 2) / max(1e-300, float(np.mean(new ** 2))))))
    return not gained or sum(gained) > 0.0
