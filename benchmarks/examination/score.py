"""Scores of the examination: proper scores, reliability, intervals, alarms, gain.

Labels are `none`, `unknown` and every effect id. An answer gives each label a probability, floored
at FLOOR; the log score of a case is the sum over the labels of -ln(probability of what is true),
nats. It is proper: its mean is least for who says what he knows (Gneiting and Raftery, JASA 102,
2007, 359). What an answer leaves out has probability 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

FLOOR = 1e-3
BINS = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99, 1.0001)
# Probability from which a cause counts as named, and the mass of the named set.
NAMED, SET_MASS = 0.9, 0.9
RESAMPLES, RESAMPLE_SEED = 1000, 1


class Scored(NamedTuple):
    """Scores of one answer."""

    # Who is resampled: recordings of one machine belong together.
    machine: str
    log_score: float
    brier: float
    # (probability said, whether it is there) of each label.
    said: tuple[tuple[float, bool], ...]
    # (inside, width over the size) of each interval of a cause that is there.
    intervals: tuple[tuple[bool, float], ...]
    # Of a machine without a fault, whether an id is said with NAMED.
    false_alarm: bool | None
    # Of a machine with a cause of the catalogue, whether each has NAMED.
    found: bool | None
    set_size: int
    # Error of the entry's machine on another run, over the machine file's; nan without one.
    gain: float
    seconds: float


class Bin(NamedTuple):
    """Labels that were said with a probability between two ends."""

    low: float
    high: float
    count: int
    said: float
    there: float


def merge_labels(
    answer: dict[str, Any], truth: dict[str, Any], ids: Iterable[str]
) -> dict[str, float]:
    """Returns the probability of each label. Effects that leave the same trace as a true one are
    one label with it: their probabilities are added."""
    alike = {other: name for name, more in truth["alike"].items() for other in more}
    alike = {other: name for other, name in alike.items() if other not in truth["ids"]}
    labels = {alike.get(name, name): 0.0 for name in (*ids, *truth["ids"])}
    for name, p in answer["causes"].items():
        labels[alike.get(name, name)] = labels.get(alike.get(name, name), 0.0) + float(p)
    labels |= {word: float(answer[word]) for word in ("none", "unknown")}
    return {name: min(max(p, 0.0), 1.0) for name, p in labels.items()}


def score_answer(
    answer: dict[str, Any],
    truth: dict[str, Any],
    ids: Iterable[str],
    gain: float = float("nan"),
    seconds: float = 0.0,
) -> Scored:
    """Scores an answer against the truth. ids : every effect id that may be said."""
    labels = merge_labels(answer, truth, ids)
    there = {*truth["ids"], *(word for word in ("none", "unknown") if truth[word])}
    said = tuple((min(max(p, FLOOR), 1.0 - FLOOR), name in there) for name, p in labels.items())
    ranked = sorted(labels.values(), reverse=True)
    mass = np.cumsum(ranked) / max(sum(ranked), 1e-12)
    intervals = [
        (low <= size <= high, (high - low) / max(abs(size), 1e-9))
        for name, size in truth["sizes"].items()
        if name in answer["size"]
        for low, _, high in (answer["size"][name],)
    ]
    effects = [p for name, p in labels.items() if name not in ("none", "unknown")]
    return Scored(
        truth.get("machine", ""),
        float(-sum(np.log(p if is_there else 1.0 - p) for p, is_there in said)),
        float(sum((p - is_there) ** 2 for p, is_there in said)),
        said,
        tuple(intervals),
        any(p >= NAMED for p in effects) if truth["none"] else None,
        all(labels[name] >= NAMED for name in truth["ids"]) if truth["ids"] else None,
        1 + int(np.searchsorted(mass, SET_MASS - 1e-9)),
        gain,
        seconds,
    )


def find_interval(values: Sequence[float], machines: Sequence[str]) -> tuple[float, float, float]:
    """Returns the mean and its 90 % interval by bootstrap over machines, all cases of a machine
    together; a case without a machine's name is a machine."""
    known = [
        (v, m or f" {k}")
        for k, (v, m) in enumerate(zip(values, machines, strict=True))
        if np.isfinite(v)
    ]
    if not known:
        return float("nan"), float("nan"), float("nan")
    groups: dict[str, list[float]] = {}
    for value, machine in known:
        groups.setdefault(machine, []).append(value)
    sums = np.array([sum(one) for one in groups.values()])
    counts = np.array([len(one) for one in groups.values()])
    rng = np.random.default_rng(RESAMPLE_SEED)
    drawn = rng.integers(0, len(sums), (RESAMPLES, len(sums)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, (0.05, 0.95))
    return float(sums.sum() / counts.sum()), float(low), float(high)


def list_bins(scored: Sequence[Scored]) -> list[Bin]:
    """Returns the reliability: labels by the probability that was said."""
    said = np.array([pair for one in scored for pair in one.said])
    found = []
    for low, high in pairwise(BINS):
        some = said[(said[:, 0] >= low) & (said[:, 0] < high)]
        if len(some):
            mean, there = some.mean(axis=0)
            found.append(Bin(low, min(high, 1.0), len(some), float(mean), float(there)))
    return found


def split_brier(scored: Sequence[Scored]) -> tuple[float, float, float]:
    """Returns reliability, resolution and uncertainty, a case: the Brier score is the first less
    the second plus the third, but for the spread inside of a bin (Murphy, J. Appl. Meteorol. 12,
    1973, 595)."""
    bins, cases = list_bins(scored), max(1, len(scored))
    base = sum(one.count * one.there for one in bins) / max(1, sum(one.count for one in bins))
    return (
        sum(one.count * (one.said - one.there) ** 2 for one in bins) / cases,
        sum(one.count * (one.there - base) ** 2 for one in bins) / cases,
        sum(one.count for one in bins) * base * (1.0 - base) / cases,
    )


def write_table(by_entry: dict[str, list[Scored]], baseline: str) -> str:
    """Returns the table of entries by score. All have answered the same cases."""
    lines = [
        "| entry | cases | log score, nats a case (90 %) | skill | Brier (rel. - res. + unc.) | "
        "skill | intervals cover | false alarms | named | set of 90 % | "
        "error on another run | s a case |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]

    def average(name: str, field: Callable[[Scored], float]) -> tuple[float, float, float]:
        some = by_entry[name]
        return find_interval([field(one) for one in some], [one.machine for one in some])

    base = average(baseline, lambda one: one.log_score)[0]
    base_brier = average(baseline, lambda one: one.brier)[0]
    for name in sorted(by_entry, key=lambda n: average(n, lambda one: one.log_score)[0]):
        scored = by_entry[name]
        mean, low, high = average(name, lambda one: one.log_score)
        brier = average(name, lambda one: one.brier)[0]
        parts = " ".join(
            f"{sign}{x:.3f}" for sign, x in zip(("", "- ", "+ "), split_brier(scored), strict=True)
        )
        covered = [inside for one in scored for inside, _ in one.intervals]
        alarms = [one.false_alarm for one in scored if one.false_alarm is not None]
        named = [one.found for one in scored if one.found is not None]
        gain, gain_low, gain_high = average(name, lambda one: one.gain)
        lines.append(
            f"| {name} | {len(scored)} | {mean:.2f} ({low:.2f} to {high:.2f}) | "
            f"{1.0 - mean / base:.2f} | {brier:.3f} ({parts}) | {1.0 - brier / base_brier:.2f} | "
            f"{sum(covered)} of {len(covered)} | {sum(alarms)} of {len(alarms)} | "
            f"{sum(named)} of {len(named)} | "
            f"{np.median([one.set_size for one in scored]):.0f} | "
            f"{gain:.2f} ({gain_low:.2f} to {gain_high:.2f}) | "
            f"{np.mean([one.seconds for one in scored]):.1f} |"
        )
    return "\n".join(lines) + "\n"


def write_differences(by_entry: dict[str, list[Scored]], ours: str) -> str:
    """Returns, for each other entry, its log score less that of `ours`, case by case."""
    lines = ["| entry | log score less that of " + f"`{ours}`, nats a case (90 %) |", "|---|---|"]
    for name, scored in by_entry.items():
        if name != ours:
            pairs = zip(scored, by_entry[ours], strict=True)
            mean, low, high = find_interval(
                [other.log_score - own.log_score for other, own in pairs],
                [one.machine for one in scored],
            )
            lines.append(f"| {name} | {mean:+.2f} ({low:+.2f} to {high:+.2f}) |")
    return "\n".join(lines) + "\n"


def write_bins(scored: Sequence[Scored]) -> str:
    """Returns the reliability as a table."""
    lines = ["| said | labels | mean | there |", "|---|---|---|---|"]
    lines += [
        f"| {one.low:g} to {one.high:g} | {one.count} | {one.said:.3f} | {one.there:.3f} |"
        for one in list_bins(scored)
    ]
    return "\n".join(lines) + "\n"
