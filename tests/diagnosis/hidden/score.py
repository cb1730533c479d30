"""Marks answers against the truth, one by one; report.py counts the marks.

An answer is a diagnosis by the published format "topdress-diagnosis/1", read from its JSON.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

SURE = 0.9  # a probability that says: this is it
_SAME_VARIABLE = {"speed_used_mps": "speed_mps", "wheel_speed_mps": "speed_mps"}


class Mark(NamedTuple):
    """One case, marked. None: the question does not arise."""

    truth: dict[str, Any]
    answer: str  # what was said, in one word or ids
    seconds: float | None
    verdict: str = ""
    false_alarm: bool | None = None
    # every cause named, nothing else (an id equal on the data will do)
    exact: bool | None = None
    # exact, or ambiguous with the truth in it and nothing that the data rule out
    honest: bool | None = None
    # every hidden effect is named or a rival, whatever is named beside it
    said_truth: bool | None = None
    in_set: bool | None = None
    # members of the set, those that the data cannot tell apart counting as one
    set_size: int | None = None
    raw_set_size: int | None = None
    right_variable: bool | None = None
    falsely_named: bool | None = None
    covered: tuple[bool, ...] = ()
    gain_share: float | None = None
    broken: bool = False
    # of each cause said: its probability, and whether it is there
    said: tuple[tuple[float, bool], ...] = ()
    # of a cause that begins and is named; inf: no time was told
    onset_error_s: float | None = None
    right_stage: bool | None = None
    all_variables: bool | None = None  # every variable of a term, nothing else

    @property
    def healthy(self) -> bool:
        """Nothing is hidden."""
        return not self.truth["causes"] and not self.truth["outside"]

    @property
    def strongest_z(self) -> float:
        """Of the strongest thing hidden; 0 for none."""
        if self.truth["outside"]:
            return float(self.truth["outside"]["z"])
        return max((float(c["z"]) for c in self.truth["causes"]), default=0.0)

    @property
    def z(self) -> float:
        """Of the weakest thing hidden; 0 for none."""
        if self.truth["outside"]:
            return float(self.truth["outside"]["z"])
        return min((float(c["z"]) for c in self.truth["causes"]), default=0.0)


def mark(
    truth: dict[str, Any],
    answer: dict[str, Any] | None,
    seconds: float | None = None,
    gain_share: float | None = None,
) -> Mark:
    """Marks one answer; `None` for an answer: the diagnosis broke, which is wrong whatever was
    hidden."""
    category = truth["category"]
    verdict = "broken" if answer is None else answer["verdict"]
    causes = [] if answer is None else answer["causes"]
    ids = [c["id"] for c in causes]
    sets = [{c["id"], *(r["id"] for r in c["rivals"])} for c in causes]
    union = set().union(*sets) if sets else set()
    m = Mark(
        truth,
        "+".join(sorted(ids)) or verdict,
        seconds,
        verdict,
        broken=answer is None,
        gain_share=gain_share,
        said=_said(causes, truth["causes"]),
    )
    if category == "none":
        return m._replace(false_alarm=verdict != "none")
    if m.healthy:  # a poor log may be refused, and is no alarm then
        return m._replace(false_alarm=verdict not in ("none", "not_judged"))
    if truth["outside"] and "each" in truth["outside"]:
        return _of_term(m, truth["outside"], [] if answer is None else answer["unexplained"])
    if category == "outside":
        unexplained = [] if answer is None else [u["variable"] for u in answer["unexplained"]]
        said = [_SAME_VARIABLE.get(v, v) for v in unexplained]
        wanted = {_SAME_VARIABLE.get(v, v) for v in truth["outside"]["variables"]}
        return m._replace(
            right_variable=bool(said) and said[0] in wanted,
            falsely_named=bool(ids) or answer is None,
        )
    equals = [{c["id"], *c["equal"]} for c in truth["causes"]]
    allowed = [e | set(c["near"]) for e, c in zip(equals, truth["causes"], strict=True)]
    pairing = _pairing(ids, equals)
    speaks = verdict in ("named", "ambiguous")
    exact = (
        speaks
        and pairing is not None
        and all(verdict == "named" or sets[k] <= allowed[j] for k, j in enumerate(pairing))
    )
    honest = exact or (
        verdict == "ambiguous"
        and len(sets) == len(equals)
        and all(
            any(c["id"] in s and s <= a for s in sets)
            for c, a in zip(truth["causes"], allowed, strict=True)
        )
    )
    covered = tuple(
        bool(s["size"]["low"] <= c["size"] <= s["size"]["high"])
        for c in truth["causes"]
        if c["size_defined"]
        for s in causes
        if s["id"] == c["id"] and s["size"]["low"] is not None and s["size"]["high"] is not None
    )
    m = m._replace(
        exact=exact, honest=honest, covered=covered, said_truth=all(e & union for e in equals)
    )
    if truth["causes"][0].get("course"):
        m = m._replace(onset_error_s=_onset_error(causes, equals[0], truth["causes"][0]["onset_s"]))
    if category == "lookalike":
        outside = len(union - allowed[0])
        return m._replace(
            in_set=truth["causes"][0]["id"] in union,
            set_size=1 + outside if union else None,
            raw_set_size=len(union) if union else None,
        )
    if category == "single":
        outside = len(union - allowed[0])
        return m._replace(set_size=1 + outside if union else None)
    return m


def _pairing(ids: Sequence[str], equals: Sequence[set[str]]) -> tuple[int, ...] | None:
    """Which hidden effect each named id answers to, one to one; None where that cannot be done."""
    if len(ids) != len(equals):
        return None
    return next(
        (
            order
            for order in permutations(range(len(equals)))
            if all(i in equals[j] for i, j in zip(ids, order, strict=True))
        ),
        None,
    )


def _said(
    causes: Sequence[dict[str, Any]], hidden: Sequence[dict[str, Any]]
) -> tuple[tuple[float, bool], ...]:
    """Probability and truth of each cause said; a hidden effect makes one of them true, the
    likeliest first."""
    free = [{c["id"], *c["equal"]} for c in hidden]
    out = []
    for c in sorted(causes, key=_likeliness, reverse=True):
        hit = next((e for e in free if c["id"] in e), None)
        if hit is not None:
            free.remove(hit)
        out.append((_likeliness(c), hit is not None))
    return tuple(out)


def _likeliness(cause: dict[str, Any]) -> float:
    return float(cause.get("probability") or 0.0)


def _onset_error(causes: Sequence[dict[str, Any]], equal: set[str], true_s: float) -> float | None:
    """Seconds between the begin told and the true one; None where the cause is not named at all."""
    for c in causes:
        if c["id"] in equal:
            growth = c.get("growth") or {}
            told = next(
                (
                    t
                    for t in (c["onset_s"], growth.get("onset_s"), growth.get("from_s"))
                    if t is not None
                ),
                None,
            )
            return float("inf") if told is None else abs(float(told) - true_s)
    return None


def _of_term(m: Mark, hidden: dict[str, Any], unexplained: Sequence[dict[str, Any]]) -> Mark:
    """A dependence that no catalogue holds. The first entry of `unexplained` counts, and of a
    product the others of its channel too, where an answer tells one variable an entry."""
    wrongly = m.broken or any(p >= SURE for p, _ in m.said)
    m = m._replace(
        falsely_named=wrongly, right_stage=False, right_variable=False, all_variables=False
    )
    if not unexplained:
        return m
    first = unexplained[0]
    entries = (
        [first]
        if first.get("variables")
        else [u for u in unexplained if u["channel"] == first["channel"]]
    )
    entries = entries[: len(hidden["each"])]
    told = {v for u in entries for v in (u.get("variables") or [u["variable"]])}
    right = set(hidden["variables"])
    return m._replace(
        right_stage=first["channel"] == hidden["channel"],
        right_variable=bool(right & {*(first.get("variables") or []), first["variable"]}),
        all_variables=told <= right and all(told & set(one) for one in hidden["each"]),
    )


def main() -> None:
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("--truth", type=Path, required=True, help="folder of truth files")
    a.add_argument(
        "--answers", type=Path, required=True, help="folder of diagnoses, CASE.json each"
    )
    args = a.parse_args()
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    marks = []
    for path in sorted(args.truth.glob("*.json")):
        answer = args.answers / path.name
        marks.append(
            mark(
                json.loads(path.read_text(encoding="utf-8")),
                json.loads(answer.read_text(encoding="utf-8")) if answer.exists() else None,
            )
        )
    if not marks:
        sys.exit(f"{args.truth}: no truth files (*.json)")
    from hidden.class_report import sections
    from hidden.report import report

    print(report(marks, sections=sections(marks) if any("log" in m.truth for m in marks) else ()))


if __name__ == "__main__":
    main()
