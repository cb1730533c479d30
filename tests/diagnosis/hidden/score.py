"""Marks answers against the truth, one by one; report.py counts the marks.

An answer is a diagnosis by the published format "topdress-diagnosis/1", read from its JSON.
"""
from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

_SAME_VARIABLE = {"speed_used_mps": "speed_mps", "wheel_speed_mps": "speed_mps"}


class Mark(NamedTuple):
    """One case, marked. None: the question does not arise."""

    truth: dict[str, Any]
    answer: str                       # what was said, in one word or ids
    seconds: float | None
    verdict: str = ""
    false_alarm: bool | None = None
    exact: bool | None = None         # every cause named, nothing else (an id equal on the data will do)
    honest: bool | None = None        # exact, or ambiguous with the truth in it and nothing that the data rule out
    said_truth: bool | None = None    # every hidden effect is named or a rival, whatever is named beside it
    in_set: bool | None = None
    set_size: int | None = None       # members of the set, those that the data cannot tell apart counting as one
    raw_set_size: int | None = None
    right_variable: bool | None = None
    falsely_named: bool | None = None
    covered: tuple[bool, ...] = ()
    gain_share: float | None = None
    broken: bool = False

    @property
    def z(self) -> float:
        """Of the weakest thing hidden; 0 for none."""
        if self.truth["outside"]:
            return float(self.truth["outside"]["z"])
        return min((float(c["z"]) for c in self.truth["causes"]), default=0.0)


def mark(truth: dict[str, Any], answer: dict[str, Any] | None, seconds: float | None = None,
         gain_share: float | None = None) -> Mark:
    """Marks one answer; `None` for an answer: the diagnosis broke, which is wrong whatever was hidden."""
    category = truth["category"]
    verdict = "broken" if answer is None else answer["verdict"]
    causes = [] if answer is None else answer["causes"]
    ids = [c["id"] for c in causes]
    sets = [{c["id"], *(r["id"] for r in c["rivals"])} for c in causes]
    union = set().union(*sets) if sets else set()
    m = Mark(truth, "+".join(sorted(ids)) or verdict, seconds, verdict, broken=answer is None,
             gain_share=gain_share)
    if category == "none":
        return m._replace(false_alarm=verdict != "none")
    if category == "outside":
        unexplained = [] if answer is None else [u["variable"] for u in answer["unexplained"]]
        said = [_SAME_VARIABLE.get(v, v) for v in unexplained]
        wanted = {_SAME_VARIABLE.get(v, v) for v in truth["outside"]["variables"]}
        return m._replace(right_variable=bool(said) and said[0] in wanted, falsely_named=bool(ids) or answer is None)
    equals = [{c["id"], *c["equal"]} for c in truth["causes"]]
    allowed = [e | set(c["near"]) for e, c in zip(equals, truth["causes"], strict=True)]
    pairing = _pairing(ids, equals)
    speaks = verdict in ("named", "ambiguous")
    exact = speaks and pairing is not None and all(
        verdict == "named" or sets[k] <= allowed[j] for k, j in enumerate(pairing))
    honest = exact or (verdict == "ambiguous" and len(sets) == len(equals) and
                       all(any(c["id"] in s and s <= a for s in sets)
                           for c, a in zip(truth["causes"], allowed, strict=True)))
    covered = tuple(bool(s["size"]["low"] <= c["size"] <= s["size"]["high"])
                    for c in truth["causes"] if c["size_defined"] for s in causes
                    if s["id"] == c["id"] and s["size"]["low"] is not None and s["size"]["high"] is not None)
    m = m._replace(exact=exact, honest=honest, covered=covered, said_truth=all(e & union for e in equals))
    if category == "lookalike":
        outside = len(union - allowed[0])
        return m._replace(in_set=truth["causes"][0]["id"] in union, set_size=1 + outside if union else None,
                          raw_set_size=len(union) if union else None)
    if category == "single":
        outside = len(union - allowed[0])
        return m._replace(set_size=1 + outside if union else None)
    return m


def _pairing(ids: Sequence[str], equals: Sequence[set[str]]) -> tuple[int, ...] | None:
    """Which hidden effect each named id answers to, one to one; None where that cannot be done."""
    if len(ids) != len(equals):
        return None
    if len(ids) == 1:
        return (0,) if ids[0] in equals[0] else None
    if ids[0] in equals[0] and ids[1] in equals[1]:
        return (0, 1)
    return (1, 0) if ids[0] in equals[1] and ids[1] in equals[0] else None


def main() -> None:
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("--truth", type=Path, required=True, help="folder of truth files")
    a.add_argument("--answers", type=Path, required=True, help="folder of diagnoses, CASE.json each")
    args = a.parse_args()
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    marks = []
    for path in sorted(args.truth.glob("*.json")):
        answer = args.answers / path.name
        marks.append(mark(json.loads(path.read_text(encoding="utf-8")),
                          json.loads(answer.read_text(encoding="utf-8")) if answer.exists() else None))
    if not marks:
        sys.exit(f"{args.truth}: no truth files (*.json)")
    from hidden.report import report

    print(report(marks))


if __name__ == "__main__":
    main()
