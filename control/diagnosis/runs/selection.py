"""Which set of effects one group of channels shows: stepwise selection with refits, then the rivals of each member.

Forward steps add the best effect, lateral steps put another in a member's place, backward steps drop what the others
make superfluous (Miller 2002, Subset Selection in Regression, chapter 3); every hypothesis is refitted through the
machine model.
"""
from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS, FoundBy
from control.machine.machine import CATALOGUE, bounds

from .changes import changes
from .evidence import (
    MIN_DRIFT,
    chance,
    colour,
    null_of_maximum,
    scores,
    slow_share,
    spread_over,
    unevenness,
    while_there,
    without_best_block,
    without_best_stretch,
)
from .hypothesis import MAX_SWITCHES, Part, Parts, replaced, without
from .likelihood import Column, best_fitted
from .model import tolerance_of
from .names_or_terms import OrBox, beyond_names, boxes_as_good, told_of_what_holds
from .onset import as_begun, blocked, refined, stands_below, still_disobeys, stops, with_end, with_onset
from .quantised import encoder_steps
from .robust import draw_in
from .search import MAX_TANGLED, Candidate, Refit, Scanned, Search
from .settle import settle
from .terms import Found
from .unexplained import SLOW_ENERGY, Dependence, gain_elsewhere, unexplained

Array = npt.NDArray[np.float64]

# Gains are of twice the log-likelihood (likelihood ratio, chi-square where nothing is there). The floors were set on
# the tuning half of the benchmark (docs/diagnosis.md, "Verdicts"); above them each log has the null of its own noise.
THRESHOLD = 17.0            # for one effect, the largest over the whole catalogue
ONSET_THRESHOLD = 16.0      # for one onset, the largest over all times tried
BEGINS_PRICE = 10.0         # of a part that is found with its onset: every time was tried; as much of its end
BEGUN_REFITTED = 4          # best of these that are refitted in full, and as many that grow: unevenly, a scan misses it
MAY_LEAD = 0.7              # of the best gain: what begins and gains so much is refined before they are compared
MAX_CAUSES = 4              # of one group of channels
REFITTED = 4                # best of a scan that are refitted in full

# Whether one part's evidence holds (`_holds`).
FALSE_ALARMS = 0.002        # of one group in one log: share of bootstrap replicates in which noise gains as much
MIN_WITHOUT_BLOCK = 0.5     # share of THRESHOLD that must be left without the block with most evidence ...
MIN_SHARE_WITHOUT_BLOCK = 0.2       # ... and share of the part's own gain
DRIFT_FACTOR = 1.6          # times THRESHOLD for what is as slow as the drift that the log has
BEGUN_IN_DRIFT = 2.5        # times THRESHOLD for what begins at a time of its own in a log that drifts without it ...
BEGUN_FOR_DRIFT = 3.0       # ... or less, where nothing of the drift is left beside it ...
BEGUN_AGAIN = 4.0           # ... and so many times what a further beginning gains: a drift begins again and again ...
BEGUN_SURE = 7.5           # ... asked of what gains less than so many times THRESHOLD
MOVED_MARGIN = 1.5          # times what smooth shapes of its variable gain with that moved along the log ...
SURE = 4.0                  # ... asked of what gains less than so many times THRESHOLD

# What could stand in a part's place.
AHEAD = 1.0                 # a rival that explains more by so much takes the part's place
SWAPS = 3                   # at most
RIVAL_GAP = 6.0             # behind by at most this: 95 % of a chi-square with one degree of freedom is 3.8
RIVAL_SHARE = 0.03          # or by this share of what the cause explains: forms are never quite right ...
BEGUN_RIVAL_SHARE = 0.06    # ... and less so in time: nothing begins at once or grows evenly
MAX_RIVALS = 12             # of a scan that are looked at
SCAN_REACH = 3.0            # times the gap, plus SCAN_MARGIN: what is further behind in a scan is not refitted
SCAN_MARGIN = 10.0


class Doubt(Enum):
    """Why evidence for a part is not enough to name it."""

    TOLERANCE = "tolerance"     # its size is within what the nominal value may be off
    STRETCH = "stretch"         # one stretch of the log speaks for it, or its evidence is uneven
    DRIFT = "drift"             # as slow as the log's own drift, which gives as much
    CHANCE = "chance"           # the log's own noise gives as much


class Refused(NamedTuple):
    """A part whose gain passes the threshold and whose evidence does not hold."""

    part: Part
    gain: float                 # of twice the log-likelihood
    doubt: Doubt
    beyond: float               # of the gain, what is more than the log's drift, unevenness or tolerances give


class _Step(NamedTuple):
    """A forward step: the hypothesis with one more part (None: none holds), and what was refused.

    best_gain : of the best part that was tried, priced; less where its evidence may be drift or a tolerance.
    """

    better: Refit | None
    refused: list[Refused]
    best_gain: float = 0.0


class RivalOf(NamedTuple):
    """What could stand in a part's place."""

    part: Part
    behind: float               # by so much of twice the log-likelihood


class Judged(NamedTuple):
    """What one group of channels shows."""

    search: Search
    null: Refit
    found: Refit
    gains: tuple[float, ...]                    # of each part: twice the log-likelihood lost without it
    rivals: tuple[tuple[RivalOf, ...], ...]     # by part
    scan: tuple[Scanned, ...]                   # the whole catalogue on top of nothing
    left: Dependence | None                     # what no effect explains
    refused: tuple[Refused, ...] = ()           # at the end: evidence for more parts, that did not hold
    structure_gain: float = 0.0                 # of the best single part on top of nothing, refitted; drift's share off
    terms: tuple[Found, ...] = ()               # beyond the catalogue
    or_boxes: tuple[OrBox, ...] = ()            # parts for which a box in time does as well


def judged(search: Search) -> Judged:
    """Judge a group: forward selection with lateral and backward steps, then what is left, then rivals."""
    null = _nothing(search)
    first = search.scan((), null.noise)
    current, refused, structure_gain, null = _selected(search, null)
    if refused and not current.parts:       # what took the first place does not hold: others may
        again = _selected(search, null, [one.part for one in refused])
        if again[0].parts:
            current, null = again[0], again[3]
    explained = 2.0 * (current.log_likelihood - null.log_likelihood)
    current, terms, dictionary, or_boxes = beyond_names(search, current, null)
    left = None if terms else unexplained(search.columns, current, explained)
    if left is not None:
        beside = _beside(search, current, left)
        if beside is not current:
            current, left = beside, unexplained(search.columns, beside, explained)
    current, gains, rivals = _best_placed(search, current)
    or_boxes = (*or_boxes, *boxes_as_good(search, current))
    terms = told_of_what_holds(search, dictionary, current, gains, terms)
    return Judged(search, null, current, gains, rivals, tuple(first), left, tuple(refused), structure_gain, terms,
                  or_boxes)


def _selected(search: Search, null: Refit, barred: Sequence[Part] = ()) -> tuple[Refit, list[Refused], float, Refit]:
    """Forward selection, settled, with onsets and without what does not hold; what was refused, the best gain of its
    first step, and nothing, settled as well. barred : parts that are not tried."""
    current, refused, structure_gain = _forward(search, null, barred)
    if current.parts:
        current, null = _settled_at(search, current), search.refit(())
        current = _begun(search, current)
        current, dropped = _without_doubtful(search, current)
        refused = [*refused, *dropped]
        if not current.parts:
            structure_gain = max(one.beyond for one in dropped)
    return current, refused, structure_gain, null


def _nothing(search: Search) -> Refit:
    """The group with nothing wrong, once what is read off the drives is among the candidates."""
    search.candidates += [*stops(search.model), *stands_below(search.model), *encoder_steps(search.model)]
    if "scale" in search.model.names:
        search.candidates += blocked(search.model.data, search.model.machine)
    settle(search.columns, ())
    _draw_in(search, ())
    settle(search.columns, ())
    return search.refit(())


def _forward(search: Search, null: Refit, barred: Sequence[Part] = ()) -> tuple[Refit, list[Refused], float]:
    """Forward selection: the best part is added, nominal values are settled anew, members swapped and pruned.

    With it, what the last step refused, and the best gain of the first.
    """
    current, gains = null, []
    for _ in range(MAX_CAUSES):
        better, refused, best_gain = _forward_step(search, current, barred)
        gains.append(best_gain)
        if better is None:
            break
        better = search.walked(better)
        search.model.move({})       # what the nominal values took upon themselves may be the effect's
        better = search.refit(better.parts, better.noise)
        better = with_end(search, search.refit(settle(search.columns, better.parts), better.noise), ONSET_THRESHOLD)
        current = _backward(search, _lateral(search, better))
    return current, refused, gains[0]


def _settled_at(search: Search, current: Refit) -> Refit:
    """A hypothesis once more, its own outliers drawn in and the nominal values settled beside it."""
    _draw_in(search, current.parts)
    return search.refit(settle(search.columns, current.parts), current.noise)


def _begun(search: Search, current: Refit) -> Refit:
    """Onsets refined, and tried for the parts that have none; then what they make superfluous is dropped."""
    if any(part.onset_s is not None for part in current.parts):
        current = refined(search, current, search.model.data)
    current = with_end(search, with_onset(search, current, search.model.data, ONSET_THRESHOLD), ONSET_THRESHOLD)
    return _backward(search, current)


def _draw_in(search: Search, parts: Parts) -> None:
    """Tails drawn in beside the richest fit: a hypothesis with every other candidate."""
    more = [search.columns.of_candidate(parts, c.part)._replace(sd=max(abs(c.low), abs(c.high)))
            for c in search.candidates if not any(p.id == c.part.id and p.member == c.part.member for p in parts)]
    draw_in(search.columns, parts, more)


def _forward_step(search: Search, now: Refit, barred: Sequence[Part] = ()) -> _Step:
    """The hypothesis with one more part, where that gains more than the threshold and holds.

    A part that begins within the log pays for the time that was chosen.
    """
    found = _one_of_each(search.scan(now.parts, now.noise))
    ranked = [f for f in found if f.gain > 0.5 * THRESHOLD][:REFITTED]
    # How a drive runs down is nobody's effect: a column has it, a refit leaves it out.
    ranked = [f for f in ranked if not CATALOGUE[f.part.id].effect.onset_only]
    ranked += [f for f in found if CATALOGUE[f.part.id].effect.onset_only
               and still_disobeys(search.model, now.parts, f.part)]
    told = {(part.id, part.member, part.onset_s is None) for part in barred}
    tried: list[tuple[float, Refit]] = []
    begun = _begin(search, now, boxes=True)
    for part, price in (*((f.part, 0.0) for f in ranked), *((part, _price(part)) for part in begun)):
        if (part.id, part.member, part.onset_s is None) in told:
            continue
        refit = search.refit((*now.parts, part), now.noise)
        if refit.tangled < MAX_TANGLED:
            tried.append((2.0 * (refit.log_likelihood - now.log_likelihood) - price, refit))
    tried = _best_begun_refined(search, now, sorted(tried, key=lambda one: -one[0]))
    best_gain = max((f.gain for f in found[:1]), default=0.0) if not tried else 0.0
    refused: list[Refused] = []
    for gain, best in tried:
        if gain <= THRESHOLD:
            best_gain = max(best_gain, gain)
            break
        better, doubt = _held(search, now, best, refused)
        if doubt is None:
            return _Step(better, [], gain)
        if not _odd_stretch(doubt):
            refused.append(doubt)
    if refused:
        best_gain = max(one.beyond for one in refused)
    return _Step(None, refused, best_gain)


def _held(search: Search, now: Refit, found: Refit, refused: Sequence[Refused]) -> tuple[Refit, Refused | None]:
    """A hypothesis with one more part, with an end where it holds only so; and why it does not hold."""
    doubt = _all_along(found.parts[-1], refused) or _doubt(search, found, len(now.parts), now)
    if doubt is not None and doubt.doubt is Doubt.DRIFT:
        ended = with_end(search, found, ONSET_THRESHOLD)        # what ends is the like beginning again
        if ended is not found and _doubt(search, ended, len(now.parts), now) is None:
            return ended, None
    return found, doubt


def _odd_stretch(doubt: Refused) -> bool:
    """Whether one moment alone speaks for what comes and goes: some moment of a log is always the oddest."""
    return doubt.part.until_s is not None and doubt.doubt is Doubt.STRETCH


def _best_begun_refined(search: Search, now: Refit, tried: list[tuple[float, Refit]]) -> list[tuple[float, Refit]]:
    """The same, best first, with the best of those that begin moved to where it fits best: a scan finds its time under
    a noise that is not its own."""
    begun = next((one for one in tried[1:] if _price(one[1].parts[-1])), None)
    if begun is None or _price(tried[0][1].parts[-1]) or begun[0] < MAY_LEAD * tried[0][0]:
        return tried
    moved = refined(search, begun[1], search.model.data)
    gain = 2.0 * (moved.log_likelihood - now.log_likelihood) - _price(moved.parts[-1])
    return sorted([(gain, moved), *(one for one in tried if one is not begun)], key=lambda one: -one[0])


def _all_along(begun: Part, refused: Sequence[Refused]) -> Refused | None:
    """The refusal of the same effect all along, which gained more: what is not there all along did not begin either."""
    if begun.onset_s is None:
        return None
    return next((one for one in refused if one.part.onset_s is None and one.doubt is not Doubt.STRETCH
                 and (one.part.id, one.part.member) == (begun.id, begun.member)), None)


def _begin(search: Search, now: Refit, boxes: bool = False) -> list[Part]:
    """The best parts that begin within the log, at once or growing. boxes : with those that end in it too."""
    rounded = any(ROWS[part.id].found_by is FoundBy.STEPS for part in now.parts)    # rounding changes with the speed
    switches = len({time_s for part in now.parts for time_s in part.switches})
    if rounded or switches + 1 > MAX_SWITCHES:
        return []
    taken = {(p.id, p.member) for p in now.parts}
    tried = [c for c in search.candidates if (c.part.id, c.part.member) not in taken]
    found = [f for f in changes(search.columns, now.parts, now.noise, tried, boxes and switches + 2 <= MAX_SWITCHES)
             if f.gain > THRESHOLD]
    ended = [f for f in found if f.part.until_s is not None]
    at_once, growing = ([f for f in found if f.part.until_s is None and f.part.grows is grows]
                        for grows in (False, True))
    least = max((f.gain for f in (*at_once, *growing)), default=0.0) + BEGINS_PRICE     # what an end must be worth
    ended = [f for f in ended if f.gain > least]
    return [as_begun(f.part) for f in (*at_once[:BEGUN_REFITTED], *growing[:BEGUN_REFITTED], *ended[:BEGUN_REFITTED])]


def _doubt(search: Search, found: Refit, k: int, alone: Refit) -> Refused | None:
    """Why a part's evidence is no more than this log's own noise gives, in size, over time, or beside its drift.

    None: it holds. A part that only one stretch of the log speaks for is no finding; what begins once (a stall) must
    show once only.
    """
    part, row = found.parts[k], ROWS[found.parts[k].id]
    gain = 2.0 * (found.log_likelihood - alone.log_likelihood)
    if CATALOGUE[part.id].effect.onset_only or row.found_by is FoundBy.STEPS:
        return None
    tolerance = tolerance_of(part.id, search.model.machine)
    if part.onset_s is None and abs(part.size) < THRESHOLD ** 0.5 * tolerance:
        return Refused(part, gain, Doubt.TOLERANCE, min(gain, (part.size / tolerance) ** 2))
    trace = search.columns.trace(found.parts, k)
    if _as_drift(search, found, k, alone, trace):
        return Refused(part, gain, Doubt.DRIFT, THRESHOLD)
    others = without(found.parts, k)
    seen = scores(search.columns, others, found.noise, [trace])
    spread, tone = spread_over(seen, 0), colour(search.columns, found.parts, found.noise, trace)
    share = 0.0 if row.threshold else MIN_SHARE_WITHOUT_BLOCK     # a threshold is passed now and then
    least = max(MIN_WITHOUT_BLOCK * THRESHOLD, share * gain)
    if part.onset_s is None:
        kept = without_best_block(seen, 0)
    elif part.until_s is None:
        kept = without_best_stretch(seen, 0)
    else:
        there = while_there(search.columns, others, found.noise, trace, part.onset_s, part.until_s)
        kept = without_best_stretch(there, 0, scaled=False)
    if kept < least or gain < THRESHOLD * spread ** 0.5:
        return Refused(part, gain, Doubt.STRETCH, gain / (spread * tone))
    if gain < THRESHOLD * tone * spread:
        return Refused(part, gain, Doubt.CHANCE, gain / (spread * tone))
    tried = [c for c in search.candidates if (c.part.id, c.part.member) != (part.id, part.member)]
    traces = [search.columns.of_candidate(others, c.part) for c in tried]
    every = scores(search.columns, found.parts, found.noise, traces)
    sure = chance(null_of_maximum(every), gain / unevenness(seen, 0)) < FALSE_ALARMS
    return None if sure else Refused(part, gain, Doubt.CHANCE, gain / (spread * tone))


def _as_drift(search: Search, found: Refit, k: int, alone: Refit, trace: Column) -> bool:
    """Whether the log's own drift gives as much as a part gains. trace : what the part does."""
    part, row = found.parts[k], ROWS[found.parts[k].id]
    gain = 2.0 * (found.log_likelihood - alone.log_likelihood)
    if gain < DRIFT_FACTOR * THRESHOLD and _slow(search, trace, found):
        return True
    if part.onset_s is not None and _begins_as_drift(search, found, k, alone, trace):
        return True
    return bool(row.along) and gain < SURE * THRESHOLD and \
        gain < MOVED_MARGIN * gain_elsewhere(search.columns, alone, row.stage, row.along)


def _begins_as_drift(search: Search, found: Refit, k: int, alone: Refit, trace: Column) -> bool:
    """Whether what begins within the log is no more than its drift gives: too little, or the like begins again."""
    part, gain = found.parts[k], 2.0 * (found.log_likelihood - alone.log_likelihood)
    drifts = part.grows or _slow(search, trace, alone) or _drifts(search, trace, found)     # a drift grows
    if gain > BEGUN_SURE * THRESHOLD or not drifts:
        return False
    if _drifts(search, trace, alone) and not _drifts(search, trace, found):
        return gain < BEGUN_FOR_DRIFT * THRESHOLD       # a drift would go on beside it
    if gain < BEGUN_IN_DRIFT * THRESHOLD:
        return True
    low, high = bounds(part.id, search.model.machine)
    same = Candidate(part._replace(onset_s=None, until_s=None, grows=False), low - part.size, high - part.size)
    again = changes(search.columns, found.parts, found.noise, [same], boxes=part.until_s is not None)
    return bool(again) and gain < BEGUN_AGAIN * again[0].gain


def _drifts(search: Search, trace: Column, under: Refit) -> bool:
    """Whether a channel that a trace touches drifts under a hypothesis."""
    return any(under.noise[name].slow_sd > MIN_DRIFT * under.noise[name].fast_sd for name in trace.coefficients)


def _slow(search: Search, trace: Column, under: Refit) -> bool:
    """Whether a trace is as slow as the drift that a hypothesis leaves."""
    return any(slow_share(trace.coefficients[c.name], c, under.noise[c.name]) > SLOW_ENERGY
               for c in search.model.channels if c.name in trace.coefficients)


def _one_of_each(found: list[Scanned]) -> list[Scanned]:
    best: dict[tuple[str, int | None], Scanned] = {}
    for f in found:
        best.setdefault((f.part.id, f.part.member), f)
    return list(best.values())


def _lateral(search: Search, now: Refit) -> Refit:
    """Lateral steps: each member in turn against the best that could stand in its place."""
    if len(now.parts) < 2:
        return now
    best = now
    for k in range(len(now.parts)):
        others = without(best.parts, k)
        for f in search.scan(others, best.noise)[:2]:
            if f.part.id == best.parts[k].id:
                continue
            tried = search.refit((*others, f.part), best.noise)
            if tried.tangled < MAX_TANGLED and tried.log_likelihood > best.log_likelihood + 1.0:
                best = tried
    return best


def _backward(search: Search, now: Refit) -> Refit:
    """Backward steps: members that the others make superfluous are dropped."""
    while len(now.parts) > 1:
        fewer = [search.refit(without(now.parts, k), now.noise) for k in range(len(now.parts))]
        best = max(fewer, key=lambda r: r.log_likelihood)
        if 2.0 * (now.log_likelihood - best.log_likelihood) > THRESHOLD:
            break
        now = best
    return now


def _without_doubtful(search: Search, now: Refit) -> tuple[Refit, list[Refused]]:
    """Parts whose evidence does not hold beside the others are dropped; with it, which."""
    dropped: list[Refused] = []
    for k in reversed(range(len(now.parts))):
        alone = search.refit(without(now.parts, k), now.noise)
        doubt = _doubt(search, now, k, alone)
        if doubt is not None:
            dropped.append(doubt)
            now = alone
    return now, dropped


def _beside(search: Search, now: Refit, left: Dependence) -> Refit:
    """Members that a smooth dependence on one variable makes superfluous are dropped."""
    parts = now.parts
    while parts:
        with_all = _with_dependence(search, parts, now, left)
        best, k = max((_with_dependence(search, without(parts, k), now, left), k) for k in range(len(parts)))
        if 2.0 * (with_all - best) > THRESHOLD:
            break
        parts = without(parts, k)
    return now if parts == now.parts else search.refit(parts, now.noise)


def _with_dependence(search: Search, parts: Parts, now: Refit, left: Dependence) -> float:
    shapes = search.columns.forms.over(left.stage, left.variable)
    p, before = search.columns.compressed(parts, shapes)
    return best_fitted(p, np.arange(before + len(shapes)), now.noise, search.model.channels).log_likelihood


def _best_placed(search: Search, now: Refit) -> tuple[Refit, tuple[float, ...], tuple[tuple[RivalOf, ...], ...]]:
    """The hypothesis with each part's best rival in its place where that explains more; gains and rivals of its parts.

    Each is held against the others under the noise that it leaves itself; that with the least lead over it stays.
    """
    def lead(several: Sequence[tuple[RivalOf, ...]]) -> float:
        return max((-one[0].behind for one in several if one), default=0.0)

    best = (now, *_rivals(search, now))
    tried = best
    for _ in range(SWAPS):
        if lead(tried[2]) <= AHEAD:
            break
        parts = tried[0].parts
        for k, several in enumerate(tried[2]):
            if several and several[0].behind < -AHEAD:
                parts = replaced(parts, k, several[0].part)
        other = search.refit(parts, tried[0].noise)
        tried = (other, *_rivals(search, other))
        if lead(tried[2]) < lead(best[2]):
            best = tried
    return best


def _rivals(search: Search, now: Refit) -> tuple[tuple[float, ...], tuple[tuple[RivalOf, ...], ...]]:
    """Gain of each part, and what could stand in its place.

    Rivals are held against the noise that the best hypothesis leaves: a noise of its own, grown by what a rival does
    not explain, would excuse it.
    """
    gains: list[float] = []
    rivals: list[tuple[RivalOf, ...]] = []
    own_value = search.under(now.parts, now.noise) if now.parts else 0.0
    for k, part in enumerate(now.parts):
        others = without(now.parts, k)
        alone = search.refit(others, now.noise)
        gain = 2.0 * (now.log_likelihood - alone.log_likelihood)
        reach = max(RIVAL_GAP, (RIVAL_SHARE if part.onset_s is None else BEGUN_RIVAL_SHARE) * gain)
        found = []
        scanned = _one_of_each(search.scan(others, alone.noise, _in_its_place(search, part)))[:MAX_RIVALS]
        own = max((f.gain for f in scanned if f.part.id == part.id), default=gain)
        near = [f.part for f in scanned if f.part.id != part.id
                and f.gain >= min(gain, own) - SCAN_REACH * reach - SCAN_MARGIN]
        for rival in (*near, *_begun_rivals(search, others, part, alone)):
            tried = search.refit((*others, rival), now.noise)
            behind = 2.0 * (own_value - search.under(tried.parts, now.noise)) + _price(rival) - _price(part)
            if behind < reach:
                found.append(RivalOf(tried.parts[-1], behind))
        gains.append(gain)
        best = {one.part.id: one for one in sorted(found, key=lambda r: -r.behind)}
        rivals.append(tuple(sorted(best.values(), key=lambda r: r.behind)))
    return tuple(gains), tuple(rivals)


def _price(part: Part) -> float:
    """Of a part that begins within the log, and of its end: every time was tried. A stop shows when it was."""
    if part.onset_s is None or CATALOGUE[part.id].effect.onset_only:
        return 0.0
    return BEGINS_PRICE * (1 + (part.until_s is not None))


def _begun_rivals(search: Search, others: Parts, part: Part, alone: Refit) -> list[Part]:
    """What begins at a time of its own and could stand in a part's place."""
    if CATALOGUE[part.id].effect.onset_only:
        return []
    return [one for one in _begin(search, alone._replace(parts=others)) if one.id != part.id]


def _in_its_place(search: Search, part: Part) -> list[Candidate]:
    """What could stand in a part's place: all candidates, and those that may begin also when and as it does."""
    if part.onset_s is None or CATALOGUE[part.id].effect.onset_only:
        return search.candidates
    at_once = {c.part.id: c for c in search.candidates if ROWS[c.part.id].found_by is FoundBy.ONSET and not part.grows}
    able = [*at_once.values(), *(c for c in search.candidates if c.part.onset_s is None and ROWS[c.part.id].may_begin)]
    same = [c._replace(part=part._replace(id=c.part.id, size=c.part.size, member=c.part.member)) for c in able
            if ROWS[c.part.id].has_slope and ROWS[c.part.id].loss_begins_as != part.id]    # not by another name
    return [*(c for c in search.candidates if c.part.id not in at_once), *same]
