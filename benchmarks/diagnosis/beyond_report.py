"""Figures of the benchmark beyond the catalogue."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from beyond_case import AGAIN
from beyond_forms import family
from hidden.report import list_probability_lines, percent, table
from hidden.score import SURE, Mark, mark
from hidden.terms import CLASSES

Z_BINS = (3.0, 8.0, 12.0, 25.0, np.inf)
STRONG_Z = 12.0
SAME = 1e-9
HEADS = (
    "cases",
    "right stage",
    "right variables",
    "name, p >= 0.9",
    "verdict none",
    *(f"{word}: {what}" for word in AGAIN for what in ("median", "worse")),
)


class Case(NamedTuple):
    """One case counted. `share`, `worse`: on each other run; None where that run, or its share,
    is not there.

    Worse: the whole error without noise, tolerances and all, is larger with the adopted file.
    Not asked of spans.
    """

    mark: Mark
    form: str  # said first; "" for none
    right_form: bool
    share: dict[str, float | None]
    worse: dict[str, bool | None]
    worse_as_measured: dict[str, bool]
    adopted: bool

    @property
    def kind(self) -> str:
        return str(self.mark.truth["outside"]["class"])


def counted(
    truth: dict[str, Any],
    answer: dict[str, Any] | None,
    seconds: float,
    others: dict[str, dict[str, Any] | None],
    adopted: bool,
) -> Case:
    """`others`: what the other runs gave, by word: share, removable, left."""
    terms = [] if answer is None else answer.get("terms") or []
    form = str(terms[0]["term"]["form"]) if terms else ""
    share = {word: None if one is None else one["share"] for word, one in others.items()}
    span = truth["outside"]["class"] == "span"
    worse = {
        word: None if one is None or span else bool(one["adopted"] > one["nominal"] * (1.0 + SAME))
        for word, one in others.items()
    }
    measured = {
        word: one["rms"]["adopted"] > one["rms"]["nominal"] * (1.0 + SAME)
        for word, one in others.items()
        if one is not None and "rms" in one and not span
    }
    return Case(
        mark(truth, answer, seconds),
        form,
        form in family(truth["outside"]["term"]),
        share,
        worse,
        measured,
        adopted,
    )


def of_kept(one: dict[str, Any]) -> Case:
    """A record of ours."""
    return counted(
        one["truth"],
        one["answer"],
        one["seconds"],
        {word: one[word] for word in AGAIN},
        one["adopted"],
    )


def _part(cases: Sequence[Case], ask: Callable[[Case], object]) -> str:
    return percent(sum(bool(ask(c)) for c in cases), len(cases))


def shares(cases: Sequence[Case], word: str) -> list[float]:
    """Shares of the removable error removed; a span is not adopted and has none."""
    return [s for c in cases if (s := c.share.get(word)) is not None]


def _sure(case: Case) -> bool:
    return any(p >= SURE for p, _ in case.mark.said)


def row(cases: Sequence[Case]) -> list[str]:
    """The figures of HEADS."""
    cells = [
        str(len(cases)),
        *(
            _part(cases, ask)
            for ask in (
                lambda c: c.mark.right_stage,
                lambda c: c.mark.all_variables,
                _sure,
                lambda c: c.mark.verdict == "none",
            )
        ),
    ]
    for word in AGAIN:
        some = shares(cases, word)
        worse = [w for c in cases if (w := c.worse.get(word)) is not None]
        cells += [
            f"{np.median(some):.2f}" if some else "-",
            f"{sum(map(bool, worse))} of {len(worse)}",
        ]
    return cells


def _goals(cases: Sequence[Case]) -> list[list[str]]:
    """The issue's figures with what is to be reached: of all, and where z is at least STRONG_Z."""

    def both(cell: Callable[[Sequence[Case]], str]) -> list[str]:
        return [cell(cases), cell([c for c in cases if c.mark.z >= STRONG_Z])]

    def quantile(word: str, at: float) -> Callable[[Sequence[Case]], str]:
        return lambda some: (
            f"{np.quantile(found, at):.2f} (n = {len(found)})"
            if (found := shares(some, word))
            else "-"
        )

    rows = [
        ["right stage", ">= 95 %", *both(lambda s: _part(s, lambda c: c.mark.right_stage))],
        [
            "right variable or variables",
            ">= 85 %",
            *both(lambda s: _part(s, lambda c: c.mark.all_variables)),
        ],
        ["a name of the catalogue with p >= 0.9", "<= 3 %", *both(lambda s: _part(s, _sure))],
    ]
    for word, where in (("again", "same programme"), ("elsewhere", "another programme")):
        rows += [
            [
                f"removable error removed, another run, {where}: median",
                ">= 0.9",
                *both(quantile(word, 0.5)),
            ],
            ["the same: lowest decile", ">= 0.6", *both(quantile(word, 0.1))],
            [
                f"adopted file worse than nominal, another run, {where}",
                "0",
                *both(lambda s, w=word: str(sum(bool(c.worse.get(w)) for c in s))),
            ],
            [
                "the same as measured, noise and all (r.m.s. of the hidden channel)",
                "",
                *both(lambda s, w=word: str(sum(bool(c.worse_as_measured.get(w)) for c in s))),
            ],
        ]
    adopted_spans = [c for c in cases if c.kind == "span" and c.adopted]
    return [
        *rows,
        [
            "spans (not to be adopted): something adopted",
            "0",
            str(len(adopted_spans)),
            str(sum(c.mark.z >= STRONG_Z for c in adopted_spans)),
        ],
    ]


def named(null: dict[str, Any]) -> bool:
    """A term was named."""
    return bool(null["answer"] and null["answer"].get("terms"))


def nulls_table(nulls: Sequence[dict[str, Any]]) -> list[str]:
    """Healthy logs: terms named, and alarms of any kind."""
    groups = {"all": list(nulls)}
    rows = [
        [
            word,
            str(len(some)),
            percent(sum(named(n) for n in some), len(some)),
            percent(
                sum(
                    n["answer"] is None or n["answer"]["verdict"] not in ("none", "not_judged")
                    for n in some
                ),
                len(some),
            ),
            ", ".join(
                f"{a} {k}"
                for a, k in Counter(
                    n["answer"]["verdict"] if n["answer"] else "broken" for n in some
                ).most_common(4)
            ),
        ]
        for word, some in groups.items()
    ]
    return table(["healthy logs", "n", "a term named (goal <= 1 %)", "an alarm", "verdicts"], rows)


def sections(cases: Sequence[Case]) -> list[str]:
    """Markdown lines: goals, by class, by z, and how far probabilities can be believed."""
    return [
        "## Goals",
        "",
        *table(["figure", "to reach", "all", f"z >= {STRONG_Z:g}"], _goals(cases)),
        "",
        "## By class",
        "",
        *table(["class", *HEADS], [[k, *row([c for c in cases if c.kind == k])] for k in CLASSES]),
        "",
        "## By z",
        "",
        *table(["z", *HEADS], _by_z(cases)),
        "",
        *list_probability_lines([c.mark for c in cases], "all"),
    ]


def _by_z(cases: Sequence[Case]) -> list[list[str]]:
    rows = []
    for low, high in pairwise(Z_BINS):
        some = [c for c in cases if low <= c.mark.z < high]
        rows.append(
            [f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more", *row(some)]
        )
    return rows
