"""Marks answers against the truth and counts: every figure with its Wilson 95 % interval.

An answer is a diagnosis by the published format "topdress-diagnosis/1", read from its JSON.
"""
from __future__ import annotations

import argparse
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

BANDS = ((2.0, 4.0), (4.0, 8.0), (8.0, 16.0), (16.0, 42.0), (42.0, float("inf")))
STRONG_Z = 8.0
_SAME_VARIABLE = {"speed_used_mps": "speed_mps", "wheel_speed_mps": "speed_mps"}


class Mark(NamedTuple):
    """One case, marked. None: the question does not arise."""

    truth: dict[str, Any]
    answer: str                       # what was said, in one word or ids
    seconds: float | None
    false_alarm: bool | None = None
    exact: bool | None = None         # every cause named, nothing else (an id equal on the data will do)
    honest: bool | None = None        # exact, or ambiguous with the truth in it and nothing that the data rule out
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


def wilson(right: int, count: int, sigmas: float = 1.96) -> tuple[float, float, float]:
    """Share and its Wilson interval, each 0 to 1 (Wilson 1927). (nan, 0, 1) of nothing."""
    if count == 0:
        return float("nan"), 0.0, 1.0
    p, s2 = right / count, sigmas**2
    middle = (p + s2 / (2 * count)) / (1 + s2 / count)
    half = sigmas * ((p * (1 - p) + s2 / (4 * count)) / count) ** 0.5 / (1 + s2 / count)
    return p, max(0.0, middle - half), min(1.0, middle + half)


def mark(truth: dict[str, Any], answer: dict[str, Any] | None, seconds: float | None = None,
         gain_share: float | None = None) -> Mark:
    """Marks one answer; `None` for an answer: the diagnosis broke, which is wrong whatever was hidden."""
    category = truth["category"]
    verdict = "broken" if answer is None else answer["verdict"]
    causes = [] if answer is None else answer["causes"]
    ids = [c["id"] for c in causes]
    sets = [{c["id"], *(r["id"] for r in c["rivals"])} for c in causes]
    union = set().union(*sets) if sets else set()
    m = Mark(truth, "+".join(sorted(ids)) or verdict, seconds, broken=answer is None, gain_share=gain_share)
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
    m = m._replace(exact=exact, honest=honest, covered=covered)
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


# -- counting --------------------------------------------------------------------------------------------------------

def _percent(right: int, count: int) -> str:
    p, low, high = wilson(right, count)
    return "-" if count == 0 else f"{100 * p:.1f} % ({100 * low:.1f}-{100 * high:.1f}), {right}/{count}"


def _share(marks: Iterable[Mark], ask: Callable[[Mark], bool | None]) -> str:
    got = [v for m in marks if (v := ask(m)) is not None]
    return _percent(sum(got), len(got))


def _mean(values: Sequence[float], digits: int = 2) -> str:
    return "-" if not values else f"{sum(values) / len(values):.{digits}f} (n = {len(values)})"


def _of(marks: Iterable[Mark], category: str) -> list[Mark]:
    return [m for m in marks if m.truth["category"] == category]


def report(marks: Sequence[Mark], title: str = "Diagnosis of hidden effects") -> str:
    """The whole table as Markdown."""
    none, single, pair = _of(marks, "none"), _of(marks, "single"), _of(marks, "pair")
    look, outside = _of(marks, "lookalike"), _of(marks, "outside")
    strong = [m for m in single if m.z >= STRONG_Z]
    covered = [c for m in (*single, *pair, *look) for c in m.covered]
    gains = [m.gain_share for m in (*single, *pair) if m.exact and m.gain_share is not None and m.z >= STRONG_Z]
    drift = [m for m in none if m.truth["noise"] == "drift"]
    calm = [m for m in none if m.truth["noise"] != "drift"]
    rows = [
        ("false alarms, nothing hidden, no slow drift", _share(calm, lambda m: m.false_alarm), "<= 1 %"),
        ("false alarms, nothing hidden, slow drift", _share(drift, lambda m: m.false_alarm), "<= 2 %"),
        ("one effect, z >= 8: exactly named", _share(strong, lambda m: m.exact), ">= 90 %"),
        ("one effect, z >= 8: exactly named or honestly ambiguous", _share(strong, lambda m: m.honest), ""),
        ("two effects, all z: both exactly named", _share(pair, lambda m: m.exact), ">= 80 %"),
        ("two effects, each z >= 8: both exactly named",
         _share([m for m in pair if m.z >= STRONG_Z], lambda m: m.exact), ">= 80 %"),
        ("look-alikes: the true effect is in the set", _share(look, lambda m: m.in_set), ">= 97 %"),
        ("look-alikes: mean set size, equals counting as one",
         _mean([m.set_size for m in look if m.set_size]), "<= 1.3"),
        ("look-alikes: mean set size, every id counting", _mean([m.raw_set_size for m in look if m.raw_set_size]), ""),
        ("outside the catalogue: right variable", _share(outside, lambda m: m.right_variable), ">= 85 %"),
        ("outside the catalogue: falsely named", _share(outside, lambda m: m.falsely_named), "<= 5 %"),
        ("90 % intervals of the size cover", _percent(sum(covered), len(covered)), "85-95 %"),
        ("named exactly, z >= 8: share of the removable error removed", _mean(gains, 3), ">= 0.97"),
        ("answers that broke", _percent(sum(m.broken for m in marks), len(marks)), "0"),
    ]
    out = [f"# {title}", "", f"{len(marks)} cases. In brackets: Wilson 95 % intervals.", "",
           "| figure | reached | to reach |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows), ""]
    out += _by("One effect by detectability z", "z", single, _band)
    out += _by("One effect by kind of noise", "noise", strong, lambda m: m.truth["noise"], " (z >= 8)")
    out += _by("One effect by kind of data", "data", strong, lambda m: m.truth["data_kind"], " (z >= 8)")
    out += _by("One effect by half of the programmes", "half", strong, lambda m: m.truth["split"], " (z >= 8)")
    out += ["## False alarms", "", "| data, noise | false alarms |", "|---|---|"]
    groups = defaultdict(list)
    for m in none:
        groups[f"{m.truth['data_kind']}, {m.truth['noise']}"].append(m)
    out += [f"| {k} | {_share(groups[k], lambda m: m.false_alarm)} |" for k in sorted(groups)]
    out += ["", "## One effect by id (all z, then z >= 8; what was said instead, most frequent first)", "",
            "| hidden | exact | exact, z >= 8 | said instead |", "|---|---|---|---|"]
    ids = defaultdict(list)
    for m in (*single, *look):
        ids[m.truth["causes"][0]["id"]].append(m)
    for name in sorted(ids):
        wrong = Counter(m.answer for m in ids[name] if not m.exact)
        instead = ", ".join(f"{a} {n}" for a, n in wrong.most_common(4))
        out.append(f"| {name} | {_share(ids[name], lambda m: m.exact)} | "
                   f"{_share([m for m in ids[name] if m.z >= STRONG_Z], lambda m: m.exact)} | {instead} |")
    out += ["", "## Outside the catalogue", "",
            "| hidden | right variable | falsely named | said |", "|---|---|---|---|"]
    ids = defaultdict(list)
    for m in outside:
        ids[m.truth["outside"]["name"]].append(m)
    for name in sorted(ids):
        said = ", ".join(f"{a} {n}" for a, n in Counter(m.answer for m in ids[name]).most_common(4))
        out.append(f"| {name} | {_share(ids[name], lambda m: m.right_variable)} | "
                   f"{_share(ids[name], lambda m: m.falsely_named)} | {said} |")
    seconds = sorted(m.seconds for m in marks if m.seconds is not None and m.truth["data_kind"] == "run")
    if seconds:
        per = [m.seconds / m.truth["rows"] * 24_000 for m in marks if m.seconds and m.truth["data_kind"] == "run"]
        out += ["", f"Time to the verdict on a run: median {seconds[len(seconds) // 2]:.2f} s, 95 % within "
                    f"{seconds[int(0.95 * (len(seconds) - 1))]:.2f} s; for 24,000 rows {sum(per) / len(per):.2f} s "
                    "on average."]
    return "\n".join(out) + "\n"


def _band(m: Mark) -> str:
    return next(f"{low:g}-{high:g}" if high < 1e9 else f"above {low:g}" for low, high in BANDS if m.z < high)


def _by(title: str, head: str, marks: Sequence[Mark], key: Callable[[Mark], str], note: str = "") -> list[str]:
    groups: dict[str, list[Mark]] = defaultdict(list)
    for m in marks:
        groups[key(m)].append(m)
    order = sorted(groups, key=lambda k: (groups[k][0].z if head == "z" else 0.0, k))
    return [f"## {title}{note}", "",
            f"| {head} | exactly named | or honestly ambiguous | nothing said |", "|---|---|---|---|",
            *(f"| {k} | {_share(groups[k], lambda m: m.exact)} | {_share(groups[k], lambda m: m.honest)} | "
              f"{_share(groups[k], lambda m: m.answer == 'none')} |" for k in order), ""]


def main() -> None:
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("--truth", type=Path, required=True, help="folder of truth files")
    a.add_argument("--answers", type=Path, required=True, help="folder of diagnoses, CASE.json each")
    args = a.parse_args()
    marks = []
    for path in sorted(args.truth.glob("*.json")):
        answer = args.answers / path.name
        marks.append(mark(json.loads(path.read_text(encoding="utf-8")),
                          json.loads(answer.read_text(encoding="utf-8")) if answer.exists() else None))
    if not marks:
        sys.exit(f"{args.truth}: no truth files (*.json)")
    print(report(marks))


if __name__ == "__main__":
    main()
