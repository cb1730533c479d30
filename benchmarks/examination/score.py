"""Scores of the examination: proper scores, reliability, intervals, alarms, gain.

Labels are `none`, `unknown` and every effect id. An answer gives each label a probability, floored
at FLOOR; the log score of a case is the sum over the labels of -ln(probability of what is true),
nats. It is proper: its mean is least for who says what he knows (Gneiting and Raftery, JASA 102,
2007, 359).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

FLOOR = 1e-3
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99, 1.0001)
# Probability from which a cause counts as named, and the mass of the named set.
NAMED, SET_MASS = 0.9, 0.9
RESAMPLES, RESAMPLE_SEED = 1000, 1


class Scored(NamedTuple):
    """Scores of one answer."""

    log_score: float
    brier: float
    # (probability said, whether it is there) of each id that was said with at least FLOOR.
    said: tuple[tuple[float, bool], ...]
    # (inside, width over the size) of each interval of a cause that is there.
    intervals: tuple[tuple[bool, float], ...]
    false_alarm: bool | None
    set_size: int
    # Error of the entry's machine on another run, over the machine file's; nan without one.
    gain: float
    seconds: float


def score_answer(
    answer: dict[str, Any], truth: dict[str, Any], gain: float, seconds: float
) -> Scored:
    """Scores an answer against the truth. Effects that leave the same trace count as one."""
    alike = {other: name for name, more in truth["alike"].items() for other in more}
    probability: dict[str, float] = {}
    for name, p in answer["causes"].items():
        true = alike.get(name, name)
        probability[true] = max(probability.get(true, 0.0), float(p))
    labels = {**probability, "none": float(answer["none"]), "unknown": float(answer["unknown"])}
    there = {*truth["ids"], *(word for word in ("none", "unknown") if truth[word])}
    for name in there:
        labels.setdefault(name, 0.0)
    log_score = brier = 0.0
    for name, p in labels.items():
        p = min(max(p, FLOOR), 1.0 - FLOOR)
        log_score -= float(np.log(p if name in there else 1.0 - p))
        brier += (p - (name in there)) ** 2
    ranked = sorted(labels.values(), reverse=True)
    mass = np.cumsum(ranked) / max(sum(ranked), 1e-12)
    intervals = [
        (low <= size <= high, (high - low) / max(abs(size), 1e-9))
        for name, size in truth["sizes"].items()
        if name in answer["size"]
        for low, _, high in (answer["size"][name],)
    ]
    return Scored(
        log_score,
        brier,
        tuple((p, name in there) for name, p in probability.items() if p > 10.0 * FLOOR),
        tuple(intervals),
        any(p >= NAMED for p in probability.values()) if truth["none"] else None,
        1 + int(np.searchsorted(mass, SET_MASS)),
        gain,
        seconds,
    )


def find_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Returns the mean and its 90 % interval by bootstrap over machines: a case is a machine."""
    found = np.array([v for v in values if np.isfinite(v)])
    if not len(found):
        return float("nan"), float("nan"), float("nan")
    rng = np.random.default_rng(RESAMPLE_SEED)
    means = found[rng.integers(0, len(found), (RESAMPLES, len(found)))].mean(axis=1)
    return float(found.mean()), *(float(q) for q in np.quantile(means, (0.05, 0.95)))


def write_table(by_entry: dict[str, list[Scored]], baseline: str) -> str:
    """Returns the page: entries by score, and the reliability of each."""
    lines = [
        "| entry | cases | log score, nats a case (90 %) | skill | Brier | intervals cover | "
        "false alarms | set of 90 % | error on another run | s a case |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    base = np.mean([one.log_score for one in by_entry[baseline]])
    for name, scored in sorted(
        by_entry.items(), key=lambda item: np.mean([one.log_score for one in item[1]])
    ):
        mean, low, high = find_interval([one.log_score for one in scored])
        covered = [inside for one in scored for inside, _ in one.intervals]
        alarms = [one.false_alarm for one in scored if one.false_alarm is not None]
        gain, gain_low, gain_high = find_interval([one.gain for one in scored])
        lines.append(
            f"| {name} | {len(scored)} | {mean:.2f} ({low:.2f} to {high:.2f}) | "
            f"{1.0 - mean / base:.2f} | {np.mean([one.brier for one in scored]):.3f} | "
            f"{sum(covered)} of {len(covered)} | {sum(alarms)} of {len(alarms)} | "
            f"{np.median([one.set_size for one in scored]):.0f} | "
            f"{gain:.2f} ({gain_low:.2f} to {gain_high:.2f}) | "
            f"{np.mean([one.seconds for one in scored]):.1f} |"
        )
    for name, scored in by_entry.items():
        said = [pair for one in scored for pair in one.said]
        lines += ["", f"Reliability of `{name}`:", "", "| said | causes | mean | there |"]
        lines.append("|---|---|---|---|")
        for low, high in pairwise(BINS):
            some = [(p, there) for p, there in said if low <= p < high]
            if some:
                mean = np.mean([p for p, _ in some])
                share = np.mean([there for _, there in some])
                lines.append(
                    f"| {low:g} to {min(high, 1.0):g} | {len(some)} | {mean:.3f} | {share:.3f} |"
                )
    return "\n".join(lines) + "\n"
