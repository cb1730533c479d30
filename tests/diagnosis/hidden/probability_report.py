"""How far can the probabilities of an answer be believed? Proper scores and a reliability table.

A proper score is best, on average, for who says what he knows (Gneiting and Raftery, JASA 102,
2007, 359). Each is compared with that of a constant: the share of causes that are right, said
of every cause.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import log

from .score import Mark

BINS = (0.0, 0.5, 0.7, 0.9, 0.95, 0.99, 1.0001)
# The log score of a wrong answer of probability 1 is infinite: probabilities count as printed, to
# three digits.
PRINTED = 0.001

Answers = Sequence[tuple[float, bool]]


def calc_brier_score(answers: Answers) -> float:
    """Returns the mean squared difference of probability and truth (Brier 1950); 0 is best."""
    return sum((p - right) ** 2 for p, right in answers) / len(answers)


def calc_log_score(answers: Answers) -> float:
    """Returns the mean of -ln(probability of what is true), nats; 0 is best."""
    return sum(-log(max(PRINTED, p if right else 1.0 - p)) for p, right in answers) / len(answers)


def calc_skill(score: Callable[[Answers], float], answers: Answers) -> float:
    """Returns 1 - score / score of the constant; 0 where a constant is as good, 1 at best, nan
    where the constant is perfect."""
    share = sum(right for _, right in answers) / len(answers)
    constant = score([(share, right) for _, right in answers])
    return 1.0 - score(answers) / constant if constant else float("nan")


def list_score_rows(marks: Sequence[Mark]) -> list[list[str]]:
    """Returns table rows: both scores, the constant's and the skills; none where no cause was
    said."""
    answers = [one for m in marks for one in m.said]
    if not answers:
        return []
    share = sum(right for _, right in answers) / len(answers)
    constant = [(share, right) for _, right in answers]
    return [
        [
            name,
            str(len(answers)),
            f"{score(answers):.3f}",
            f"{score(constant):.3f} ({share:.2f})",
            f"{calc_skill(score, answers):.2f}",
        ]
        for name, score in (("Brier score", calc_brier_score), ("log score", calc_log_score))
    ]


def list_reliability_rows(
    marks: Sequence[Mark], write_share: Callable[[int, int], str]
) -> list[list[str]]:
    """Returns table rows by range of probability: causes, mean probability, share that is right."""
    answers = [one for m in marks for one in m.said]
    rows = []
    for low, high in pairwise(BINS):
        some = [(p, right) for p, right in answers if low <= p < high]
        mean = f"{sum(p for p, _ in some) / len(some):.3f}" if some else "-"
        rows.append(
            [
                f"{low:g} to {min(high, 1.0):g}",
                str(len(some)),
                mean,
                write_share(sum(right for _, right in some), len(some)),
            ]
        )
    return rows
