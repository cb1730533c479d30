"""Figures of the examination by classes (classes.py), each on all cases and on each half of the
programmes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from .report import Figure, Marks, asked, grouped, share, table
from .score import SURE, Mark

STRONG_Z = 12.0
ONSET_S = 60.0
BEGINS = ("onset", "growth")


def _in(marks: Marks, *categories: str, z: float = 0.0) -> list[Mark]:
    return [m for m in marks if m.truth["category"] in categories and m.strongest_z >= z]


def _share(
    ask: Callable[[Mark], float | None], *categories: str, z: float = 0.0
) -> Callable[[Marks], list[float]]:
    return lambda marks: asked(_in(marks, *categories, z=z), ask)


def _weak(ask: Callable[[Mark], float | None], *categories: str) -> Callable[[Marks], list[float]]:
    """Where the weakest of what is hidden is strong enough."""
    return lambda marks: asked([m for m in _in(marks, *categories) if m.z >= STRONG_Z], ask)


def _alarms(*categories: str, drift: bool | None = None) -> Callable[[Marks], list[float]]:
    return lambda marks: asked(
        [
            m
            for m in _in(marks, *categories)
            if m.truth["data_kind"] == "run"
            and (drift is None or drift == (m.truth["noise"] == "drift"))
        ],
        lambda m: m.false_alarm,
    )


def _nothing(marks: Marks) -> list[float]:
    return [float(m.verdict == "none") for m in marks if m.strongest_z >= STRONG_Z]


def _sure(marks: Marks) -> list[float]:
    return [float(right) for m in marks for p, right in m.said if p >= SURE]


def _near(m: Mark) -> float | None:
    return None if m.onset_error_s is None else float(m.onset_error_s <= ONSET_S)


def _sharp(m: Mark) -> float | None:
    return _near(m) if m.truth["causes"][0].get("onset_sd_s", 0.0) <= ONSET_S / 2 else None


def _sure_and_wrong(m: Mark) -> float:
    return float(any(p >= SURE and not right for p, right in m.said))


FIGURES = (
    Figure('"none" where something of z >= 12 is hidden', "<= 1 %", _nothing, lambda x: x <= 0.01),
    Figure("causes with p >= 0.9: right", ">= 90 %", _sure, lambda x: x >= 0.9),
    Figure(
        "false alarms, healthy, 10 to 50 Hz, no slow drift",
        "<= 1 %",
        _alarms("none", "healthy_fast", drift=False),
        lambda x: x <= 0.01,
    ),
    Figure(
        "false alarms, healthy, 10 to 50 Hz, slow drift",
        "<= 2 %",
        _alarms("none", "healthy_fast", drift=True),
        lambda x: x <= 0.02,
    ),
    Figure(
        "false alarms, healthy, 5 to 0.5 Hz",
        "<= 2 %",
        _alarms("healthy_coarse"),
        lambda x: x <= 0.02,
    ),
    *(
        Figure(f"{word}, z >= 12: name right", goal, _share(lambda m: m.exact, c, z=STRONG_Z), good)
        for word, c, goal, good in (
            ("begins", "onset", ">= 85 %", lambda x: x >= 0.85),
            ("grows", "growth", ">= 85 %", lambda x: x >= 0.85),
        )
    ),
    Figure(
        "begins or grows, z >= 12, named: begin within 60 s",
        "",
        _share(_near, *BEGINS, z=STRONG_Z),
        None,
    ),
    Figure(
        "the same, where the data hold the begin to 30 s (1 s.d.)",
        "",
        _share(_sharp, *BEGINS, z=STRONG_Z),
        None,
    ),
    Figure(
        "extra column as cause, z >= 12: right column",
        ">= 85 %",
        _share(lambda m: m.right_variable, "column", z=STRONG_Z),
        lambda x: x >= 0.85,
    ),
    Figure(
        "three at once, each z >= 12: all named, nothing else",
        "",
        _weak(lambda m: m.exact, "triple"),
        None,
    ),
    Figure(
        "terms, z >= 12: right stage", "", _share(lambda m: m.right_stage, "term", z=STRONG_Z), None
    ),
    Figure(
        "terms, z >= 12: right variable first",
        "",
        _share(lambda m: m.right_variable, "term", z=STRONG_Z),
        None,
    ),
    Figure(
        "terms, z >= 12: every variable right",
        "",
        _share(lambda m: m.all_variables, "term", z=STRONG_Z),
        None,
    ),
    Figure(
        "terms and extra columns: a name with p >= 0.9",
        "",
        _share(_sure_and_wrong, "term", "column", "outside"),
        None,
    ),
    Figure("answers that broke", "0", lambda ms: asked(ms, lambda m: m.broken), lambda x: x == 0.0),
)


def sections(marks: Marks) -> list[str]:
    """Markdown lines: the figures, every class, terms by class."""
    groups = {"all": list(marks)}
    groups |= {
        s: some
        for s in ("tuning", "unseen")
        if 0 < len(some := [m for m in marks if m.truth["split"] == s]) < len(marks)
    }
    out = [
        "## Classes",
        "",
        *table(
            ["figure", "to reach", *groups],
            [[f.title, f.goal, *(f.cell(g) for g in groups.values())] for f in FIGURES],
        ),
    ]
    out += [
        "",
        "## Classes: each",
        "",
        *table(
            [
                "class",
                "cases",
                "alarm",
                "name right, z >= 12",
                "truth among the answers, z >= 12",
                '"none", z >= 12',
                "wrong name, p >= 0.9",
                "begin within 60 s",
            ],
            [_row(c, g) for c, g in grouped(marks, lambda m: m.truth["category"]).items()],
        ),
    ]
    terms = [m for m in marks if m.truth["outside"] and "class" in m.truth["outside"]]
    out += [
        "",
        "## Classes: terms, z >= 12",
        "",
        *table(
            [
                "class",
                "cases",
                "right stage",
                "right variable",
                "every variable",
                "name, p >= 0.9",
                "answers",
            ],
            [
                _term_row(c, [m for m in g if m.z >= STRONG_Z])
                for c, g in grouped(terms, lambda m: m.truth["outside"]["class"]).items()
            ],
        ),
    ]
    return out


def _row(category: str, marks: Marks) -> list[str]:
    strong = [m for m in marks if m.strongest_z >= STRONG_Z]
    return [
        category,
        str(len(marks)),
        share(marks, lambda m: m.false_alarm),
        share(strong, lambda m: m.exact),
        share(strong, lambda m: m.said_truth),
        share(strong, lambda m: m.verdict == "none"),
        share(marks, _sure_and_wrong),
        share(strong, _near),
    ]


def _term_row(kind: str, marks: Marks) -> list[str]:
    return [
        kind,
        str(len(marks)),
        share(marks, lambda m: m.right_stage),
        share(marks, lambda m: m.right_variable),
        share(marks, lambda m: m.all_variables),
        share(marks, _sure_and_wrong),
        ", ".join(f"{a} {n}" for a, n in Counter(m.answer for m in marks).most_common(3)),
    ]
