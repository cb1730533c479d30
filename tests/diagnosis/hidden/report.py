"""Counts marks into the examination's report: every share with its Wilson 95 % interval,
reached or short."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from .probability_report import list_reliability_rows, list_score_rows
from .score import Mark

BANDS = ((2.0, 4.0), (4.0, 8.0), (8.0, 16.0), (16.0, 42.0), (42.0, float("inf")))
BAND_WORDS = ("2-4", "4-8", "8-16", "16-40", "above")
STRONG_Z = 8.0
HIGH_Z = 16.0

Marks = Sequence[Mark]


def wilson(right: int, count: int, sigmas: float = 1.96) -> tuple[float, float, float]:
    """Share and its Wilson interval, each 0 to 1 (Wilson 1927). (nan, 0, 1) of nothing."""
    if count == 0:
        return float("nan"), 0.0, 1.0
    p, s2 = right / count, sigmas**2
    middle = (p + s2 / (2 * count)) / (1 + s2 / count)
    half = sigmas * ((p * (1 - p) + s2 / (4 * count)) / count) ** 0.5 / (1 + s2 / count)
    return p, max(0.0, middle - half), min(1.0, middle + half)


def percent(right: int, count: int) -> str:
    """Writes "91.7 % (62-98), 11/12"; of fewer than five cases the count alone, as "3/4"."""
    p, low, high = wilson(right, count)
    if count < 5:
        return f"{right}/{count}" if count else "-"
    return f"{100 * p:.1f} % ({100 * low:.0f}-{100 * high:.0f}), {right}/{count}"


class Figure(NamedTuple):
    """One line of the table to reach. `values`: marks -> numbers that are averaged; `good`:
    what the mean must be."""

    title: str
    goal: str
    values: Callable[[Marks], list[float]]
    good: Callable[[float], bool] | None
    is_share: bool = True

    def cell(self, marks: Marks) -> str:
        got = self.values(marks)
        if not got:
            return "-"
        mean = sum(got) / len(got)
        text = (
            percent(round(sum(got)), len(got)) if self.is_share else f"{mean:.3g} (n = {len(got)})"
        )
        return text if self.good is None else f"{text}: {'reached' if self.good(mean) else 'short'}"


def _of(marks: Iterable[Mark], *categories: str) -> list[Mark]:
    return [m for m in marks if m.truth["category"] in categories]


def asked(marks: Iterable[Mark], ask: Callable[[Mark], float | None]) -> list[float]:
    return [float(v) for m in marks if (v := ask(m)) is not None]


def _strong(marks: Iterable[Mark], least: float = STRONG_Z) -> list[Mark]:
    return [m for m in marks if m.z >= least]


FIGURES = (
    Figure(
        "false alarms, nothing hidden, no slow drift",
        "<= 1 %",
        lambda ms: asked(
            [m for m in _of(ms, "none") if m.truth["noise"] != "drift"], lambda m: m.false_alarm
        ),
        lambda x: x <= 0.01,
    ),
    Figure(
        "false alarms, nothing hidden, slow drift",
        "<= 2 %",
        lambda ms: asked(
            [m for m in _of(ms, "none") if m.truth["noise"] == "drift"], lambda m: m.false_alarm
        ),
        lambda x: x <= 0.02,
    ),
    Figure(
        "one effect, z >= 8: exactly named",
        ">= 90 %",
        lambda ms: asked(_strong(_of(ms, "single")), lambda m: m.exact),
        lambda x: x >= 0.9,
    ),
    Figure(
        "one effect, z >= 16: exactly named",
        "not below z 8-16",
        lambda ms: asked(_strong(_of(ms, "single"), HIGH_Z), lambda m: m.exact),
        None,
    ),
    Figure(
        "one effect, z >= 8: exact, or honestly ambiguous",
        "",
        lambda ms: asked(_strong(_of(ms, "single")), lambda m: m.honest),
        None,
    ),
    Figure(
        "one effect, z >= 8: the true one among the answers",
        "",
        lambda ms: asked(_strong(_of(ms, "single")), lambda m: m.said_truth),
        None,
    ),
    Figure(
        "two effects, any z: both exactly named, nothing else",
        ">= 80 %",
        lambda ms: asked(_of(ms, "pair"), lambda m: m.exact),
        lambda x: x >= 0.8,
    ),
    Figure(
        "two effects, each z >= 8: both exactly named, nothing else",
        ">= 80 %",
        lambda ms: asked(_strong(_of(ms, "pair")), lambda m: m.exact),
        lambda x: x >= 0.8,
    ),
    Figure(
        "look-alikes: the true effect is in the set",
        ">= 97 %",
        lambda ms: asked(_of(ms, "lookalike"), lambda m: m.in_set),
        lambda x: x >= 0.97,
    ),
    Figure(
        "look-alikes: mean set size, equals counting as one",
        "<= 1.3",
        lambda ms: asked(_of(ms, "lookalike"), lambda m: m.set_size),
        lambda x: x <= 1.3,
        is_share=False,
    ),
    Figure(
        "look-alikes: mean set size, every id counting",
        "",
        lambda ms: asked(_of(ms, "lookalike"), lambda m: m.raw_set_size),
        None,
        is_share=False,
    ),
    Figure(
        "outside the catalogue: right variable",
        ">= 85 %",
        lambda ms: asked(_of(ms, "outside"), lambda m: m.right_variable),
        lambda x: x >= 0.85,
    ),
    Figure(
        "outside the catalogue: an effect is named",
        "<= 5 %",
        lambda ms: asked(_of(ms, "outside"), lambda m: m.falsely_named),
        lambda x: x <= 0.05,
    ),
    Figure(
        "90 % intervals of the size cover",
        "85-95 %",
        lambda ms: [float(c) for m in _of(ms, "single", "pair", "lookalike") for c in m.covered],
        lambda x: 0.85 <= x <= 0.95,
    ),
    Figure(
        "exactly named, z >= 8: share of the removable error removed",
        ">= 0.97",
        lambda ms: asked(
            [m for m in _strong(_of(ms, "single", "pair")) if m.exact], lambda m: m.gain_share
        ),
        lambda x: x >= 0.97,
        is_share=False,
    ),
    Figure("answers that broke", "0", lambda ms: asked(ms, lambda m: m.broken), lambda x: x == 0.0),
)


def halves(marks: Marks) -> dict[str, list[Mark]]:
    """Splits the marks into runs and tables, each as a whole and by half of the programmes; an
    empty half, or one that is the whole, is left out."""
    out = {}
    for word, is_run in (("runs", True), ("tables", False)):
        here = [m for m in marks if (m.truth["data_kind"] == "run") == is_run]
        for split in ("", " tuning", " unseen"):
            some = [m for m in here if not split or m.truth["split"] == split.strip()]
            if some and some not in out.values():
                out[word + split] = some
    return out


def report(
    marks: Marks, title: str = "Diagnosis of hidden effects", sections: Sequence[str] = ()
) -> str:
    """The whole report as Markdown. `sections`: further ones, of marks of their own (see
    class_report.py)."""
    groups = halves(marks)
    kinds = {k: g for k, g in groups.items() if k in ("runs", "tables")}
    counted = ", ".join(
        f"{len(g)} {k}, {sum(m.healthy for m in g)} of them with nothing hidden"
        for k, g in kinds.items()
    )
    out = [
        f"# {title}",
        "",
        f"{len(marks)} cases: {counted}. In brackets: Wilson 95 % intervals.",
        "",
    ]
    # Sections of their own have the figures: these would repeat a part of them.
    if not sections:
        out += table(
            ["figure", "to reach", *groups],
            [[f.title, f.goal, *(f.cell(g) for g in groups.values())] for f in FIGURES],
        )
    for kind, some in () if sections else kinds.items():
        single = _of(some, "single")
        out += [
            "",
            f"## {kind.capitalize()}: false alarms by noise",
            "",
            *table(
                ["noise", "false alarms"],
                _shares(_of(some, "none"), lambda m: m.truth["noise"], lambda m: m.false_alarm),
            ),
        ]
        out += [
            "",
            f"## {kind.capitalize()}: one effect, by z",
            "",
            *table(
                ["z", "exactly named", "or honestly ambiguous", "no answer", "intervals cover"],
                _by_band(single),
            ),
        ]
        out += [
            "",
            f"## {kind.capitalize()}: exactly named by id and z (single effects and look-alikes)",
            "",
            *table(
                ["hidden", *BAND_WORDS, "size covered", "answers instead, most frequent first"],
                _by_id(_of(some, "single", "lookalike")),
            ),
        ]
        out += [
            "",
            f"## {kind.capitalize()}: outside the catalogue",
            "",
            *table(
                ["hidden", "right variable", "an effect is named", "answers"],
                _outsiders(_of(some, "outside")),
            ),
        ]
    for word, some in groups.items():
        out += ["", *list_probability_lines(some, word)]
    out += ["", *sections, *([""] if sections else []), *_seconds(marks)]
    return "\n".join(out) + "\n"


def list_probability_lines(marks: Marks, word: str) -> list[str]:
    """Returns Markdown lines: proper scores of the probabilities, and the reliability table."""
    return [
        f"## {word.capitalize()}: probabilities of the causes",
        "",
        *table(
            ["score", "causes", "here", "of a constant (share right)", "skill"],
            list_score_rows(marks),
        ),
        "",
        *table(["p", "causes", "mean p", "right"], list_reliability_rows(marks, percent)),
    ]


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [
        f"| {' | '.join(heads)} |",
        "|" + "---|" * len(heads),
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def grouped(marks: Marks, key: Callable[[Mark], str]) -> dict[str, list[Mark]]:
    groups: dict[str, list[Mark]] = defaultdict(list)
    for m in marks:
        groups[key(m)].append(m)
    return dict(sorted(groups.items()))


def share(marks: Marks, ask: Callable[[Mark], bool | None]) -> str:
    got = asked(marks, ask)
    return percent(round(sum(got)), len(got))


def _shares(
    marks: Marks, key: Callable[[Mark], str], ask: Callable[[Mark], bool | None]
) -> list[list[str]]:
    return [[k, share(g, ask)] for k, g in grouped(marks, key).items()]


def _banded(marks: Marks) -> list[list[Mark]]:
    return [
        [m for m in marks if low <= m.z < high or (m.z < low == BANDS[0][0])] for low, high in BANDS
    ]


def _by_band(marks: Marks) -> list[list[str]]:
    return [
        [
            word,
            share(g, lambda m: m.exact),
            share(g, lambda m: m.honest),
            share(g, lambda m: m.answer == "none"),
            percent(*_covered(g)),
        ]
        for word, g in zip(BAND_WORDS, _banded(marks), strict=True)
    ]


def _covered(marks: Marks) -> tuple[int, int]:
    covered = [c for m in marks for c in m.covered]
    return sum(covered), len(covered)


def _by_id(marks: Marks) -> list[list[str]]:
    rows = []
    for name, some in grouped(marks, lambda m: m.truth["causes"][0]["id"]).items():
        cells = [f"{sum(bool(m.exact) for m in g)}/{len(g)}" if g else "" for g in _banded(some)]
        right, count = _covered(some)
        wrong = Counter(
            f"{m.answer} ({m.verdict})" if m.answer == name else m.answer
            for m in some
            if not m.exact
        )
        rows.append(
            [
                name,
                *cells,
                f"{right}/{count}" if count else "",
                ", ".join(f"{a} {n}" for a, n in wrong.most_common(4)),
            ]
        )
    return rows


def _outsiders(marks: Marks) -> list[list[str]]:
    return [
        [
            name,
            share(g, lambda m: m.right_variable),
            share(g, lambda m: m.falsely_named),
            ", ".join(f"{a} {n}" for a, n in Counter(m.answer for m in g).most_common(4)),
        ]
        for name, g in grouped(marks, lambda m: m.truth["outside"]["name"]).items()
    ]


def _seconds(marks: Marks) -> list[str]:
    runs = [m for m in marks if m.seconds is not None and m.truth["data_kind"] == "run"]
    if not runs:
        return []
    seconds = sorted(m.seconds for m in runs if m.seconds is not None)
    per = [m.seconds / m.truth["rows"] * 24_000 for m in runs if m.seconds is not None]
    return [
        f"Time to the verdict on a run: median {seconds[len(seconds) // 2]:.2f} s, 95 % within "
        f"{seconds[int(0.95 * (len(seconds) - 1))]:.2f} s; {sum(per) / len(per):.2f} s for "
        "24,000 rows on average."
    ]
