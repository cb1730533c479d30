"""A season on the level of results: logs as forms, drawn from another model than reads them.

Each log's sizes are made by plain sums over its machine, operator, product and field, a repair,
wear, and a Student's t scatter from log to log. What the log measures of them is a regression
of its own: some 200 random operating points, on which look-alikes (flow gain and scale gain,
fill loss, hopper head, scale drift) move nearly together, and in one log of five so nearly that
they are exchanged. Nothing is shared with the model but the format of a form. 600 logs are 20
machines with five operators of their own; more logs are more such depots, which spread the same
products.

    python benchmarks/season/drawn.py --seeds 3701 3702 --logs 600 1200 [--tree OLD] [--said]

`--tree`: another tree whose season is asked of the same logs. Prints seconds, memory and what
was found of what was planted, and how often probabilities and 90 % intervals hold. `--said`:
all that is reported, too.
"""

from __future__ import annotations

import argparse
import itertools
import os
import resource
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

MACHINES, LOGS = 20, 30  # of a depot; of a machine
NAMES = (
    "flow.gain",
    "flow.fill_falloff",
    "flow.hopper_head",
    "scale.gain",
    "scale.drift",
    "gate.offset",
    "shaft.gain",
    "speed.wheel_radius",
    "speed.wheel_slip",
)
MISTAKEN = 0.2  # of logs, in which look-alikes are exchanged
# What one unit of each does to three readings (flow, drives, speed) at operating points of
# speed s, level, time t.
SIGHT = {
    "flow.gain": lambda s, level, t: (1.0 + 0 * s, 0 * s, 0 * s),
    "flow.fill_falloff": lambda s, level, t: (-s, 0 * s, 0 * s),
    "flow.hopper_head": lambda s, level, t: (level - 0.5, 0 * s, 0 * s),
    "scale.gain": lambda s, level, t: (0.95 + 0.1 * level, 0 * s, 0 * s),
    "scale.drift": lambda s, level, t: (t - 0.5, 0 * s, 0 * s),
    "gate.offset": lambda s, level, t: (3.0 - s, 5.0 + 0 * s, 0 * s),
    "shaft.gain": lambda s, level, t: (0.6 + 0 * s, 2.0 * s, 0 * s),
    "speed.wheel_radius": lambda s, level, t: (0 * s, 0 * s, 1.0 + 0 * s),
    "speed.wheel_slip": lambda s, level, t: (0 * s, 0 * s, 2.0 * (s - 0.5)),
}
NOISE = (6.0, 1.5, 1.0)  # of one point, % of flow, shaft, speed
# s.d. of a machine's own
TOLERANCE = {"flow.gain": 0.6, "shaft.gain": 0.05, "speed.wheel_radius": 0.15}
SCATTER = {"flow.gain": 0.5}
BINS = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
LATE = 2  # logs by which a repair's gap may be off


class Truth(NamedTuple):
    """number: of the machine in its depot. Size at the first and at the last log before
    `until`, and what is left."""

    number: int
    effect: str
    begin: float
    end: float
    until: int = LOGS
    after: float = 0.0

    def at(self, k: int) -> float:
        if k >= self.until:
            return self.after
        return self.begin + (self.end - self.begin) * k / max(1, self.until - 1)


PLANTED = (
    Truth(1, "flow.gain", -5.0, -5.0),
    Truth(2, "scale.gain", 5.0, 5.0),
    Truth(3, "flow.fill_falloff", 0.0, 12.0),
    Truth(4, "gate.offset", 0.8, 0.8),
    Truth(5, "speed.wheel_radius", 0.0, -2.5),
    Truth(6, "shaft.gain", 1.2, 1.2),
    *(
        Truth(10 + k, "gate.offset", 0.6, 0.6, LOGS - after)
        for k, after in enumerate((1, 2, 3, 5, 10, 20))
    ),
    Truth(16, "flow.fill_falloff", 0.0, 10.0, 22),
    Truth(17, "flow.hopper_head", 6.0, 6.0),
)
SOLE = Truth(19, "flow.gain", 4.0, 4.0)  # and its only operator: nobody can part them
# % of flow; Adams drives most
OPERATORS = {"Adams": -5.0, "Baker": 0.0, "Chen": 0.0, "Diaz": 2.0, "Evans": 0.0}
SHARE = (0.5, 0.15, 0.15, 0.1, 0.1)
PRODUCTS = {"urea": 0.0, "compound": 4.0, "potash": 0.0}


class Made(NamedTuple):
    form: dict[str, Any]
    key: str
    machine: str
    time_d: float
    shared: dict[str, str]


def season_of(seed: int, count: int) -> list[Made]:
    rng = np.random.default_rng(seed)
    logs = []
    for one in range(count // LOGS):
        depot, number = divmod(one, MACHINES)
        machine = f"m{one:02d}"
        off = {name: rng.normal() for name in TOLERANCE}
        for k in range(LOGS):
            operator = (
                "Solo" if number == SOLE.number else str(rng.choice(list(OPERATORS), p=SHARE))
            )
            product = str(rng.choice(list(PRODUCTS), p=(0.5, 0.3, 0.2)))
            size = {each.effect: each.at(k) for each in (*PLANTED, SOLE) if each.number == number}
            size["flow.gain"] = (
                size.get("flow.gain", 0.0) + OPERATORS.get(operator, 0.0) + PRODUCTS[product]
            )
            for name, sd in SCATTER.items():
                size[name] = size.get(name, 0.0) + sd * rng.standard_t(5) / np.sqrt(5.0 / 3.0)
            logs.append(
                Made(
                    _forms(rng, size, off, rng.random() < MISTAKEN),
                    f"{machine}-{k}",
                    machine,
                    k * 2.0 + rng.random(),
                    {
                        "operator": operator + (f" {depot}" if depot else ""),
                        "product": product,
                        "field": f"f{one // 4}-{k // 10}",
                    },
                )
            )
    return logs


def _forms(
    rng: np.random.Generator, size: dict[str, float], off: dict[str, float], mistaken: bool
) -> dict[str, Any]:
    """Least squares of one log: what its readings say of every effect, the machine's tolerances
    as nuisance."""
    points = 200
    speed = rng.uniform(0.2, 1.0) + (0.02 if mistaken else 0.3) * rng.normal(size=points)
    load, when = np.linspace(1.0, rng.uniform(0.2, 0.9), points), np.linspace(0.0, 1.0, points)
    seen = np.stack([np.concatenate(SIGHT[name](speed, load, when)) for name in NAMES], axis=1)
    weight = np.repeat([one**-2.0 for one in NOISE], points)
    open_ = np.stack([seen[:, NAMES.index(name)] * sd for name, sd in TOLERANCE.items()], axis=1)
    read = seen @ np.array([size.get(name, 0.0) for name in NAMES])
    read = read + open_ @ np.array([off[name] for name in TOLERANCE])
    read = read + rng.normal(size=len(read)) / np.sqrt(weight)
    inner = np.linalg.inv(open_.T @ (weight[:, None] * open_) + np.eye(len(TOLERANCE)))
    across = seen.T @ (weight[:, None] * open_)
    normal = seen.T @ (weight[:, None] * seen) - across @ inner @ across.T
    right = seen.T @ (weight * read) - across @ inner @ (open_.T @ (weight * read))
    return {
        "names": NAMES,
        "normal": normal,
        "right": right,
        "open": tuple(TOLERANCE),
        "pulls": across @ inner,
    }


class Score(NamedTuple):
    """found, of: by what was planted. strange: reported and not planted. p: probability and
    whether it is so. held: whether the truth lies in a 90 % interval."""

    found: Counter[str]
    of: Counter[str]
    strange: list[str]
    p: list[tuple[float, bool]]
    held: dict[str, list[bool]]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[3701])
    parser.add_argument("--logs", type=int, nargs="+", default=[MACHINES * LOGS])
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--said", action="store_true")
    given = parser.parse_args()
    sys.path.insert(0, str(given.tree))
    scores = list[Score]()
    for seed in given.seeds:
        for count in given.logs:
            logs = _as_logs(season_of(seed, count))
            before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            from topdress.control.diagnosis.season.effect_timelines import fit_season

            begin = time.process_time()
            found = fit_season(logs)
            took_s, most_mb = (
                time.process_time() - begin,
                resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
            )
            scores.append(score(found, count))
            print(
                f"seed {seed}: {len(logs)} logs of {count // LOGS} machines, {took_s:.1f} s "
                "of processor, "
                f"{most_mb - before_mb:.0f} MB over {before_mb:.0f} MB; found "
                + ", ".join(
                    f"{scores[-1].found[what]} of {of} {what}" for what, of in scores[-1].of.items()
                )
                + f"; not planted: {len(scores[-1].strange)} {scores[-1].strange[:6]}",
                flush=True,
            )
            if given.said:
                print(_said(found), flush=True)
    _calibration(scores)
    return 0


def _as_logs(made: list[Made]) -> list[Any]:
    from topdress.control.diagnosis.season.log_evidence import QuadraticForm, SeasonLog

    return [
        SeasonLog(one.key, one.machine, one.time_d, (QuadraticForm(**one.form),), one.shared)
        for one in made
    ]


Key = tuple[str, str, str]  # factor, level, effect


def _truth(count: int) -> tuple[dict[Key, float], dict[Key, Truth], set[Key]]:
    """What operators and products do, what machines have, and what nobody can know."""
    shared: dict[Key, float] = {
        ("product", level, "flow.gain"): size for level, size in PRODUCTS.items() if size
    }
    machines, unsure = dict[Key, Truth](), set[Key]()
    for one in range(count // LOGS):
        depot, number = divmod(one, MACHINES)
        suffix = f" {depot}" if depot else ""
        if number == 0:
            shared |= {
                ("operator", name + suffix, "flow.gain"): size
                for name, size in OPERATORS.items()
                if size
            }
        if number == SOLE.number:
            unsure |= {
                ("machine", f"m{one:02d}", SOLE.effect),
                ("operator", f"Solo{suffix}", SOLE.effect),
            }
        machines |= {
            ("machine", f"m{one:02d}", each.effect): each
            for each in PLANTED
            if each.number == number
        }
    return shared, machines, unsure


def score(found: Any, count: int) -> Score:
    """What is said against what was planted. A planted one is found where it, or a set with it,
    is reported."""
    result = Score(Counter(), Counter(), [], [], {"courses": [], "levels": []})
    shared, machines, unsure = _truth(count)
    truly = {*shared, *machines, *unsure}
    said: list[tuple[Key, Any]] = [
        ((one.factor, one.level, one.effect), one) for one in (*found.courses, *found.shared)
    ]
    sets = {
        key: {key, *((a.factor, a.level, a.effect) for a in one.alternatives)} for key, one in said
    }
    result.strange.extend(" ".join(key) for key, _ in said if not sets[key] & truly)
    named = set[Key]().union(*sets.values())
    for key in shared:
        result.of[f"{key[0]}s"] += 1
        result.found[f"{key[0]}s"] += key in named
    for key, truth in machines.items():
        result.of["machines"] += 1
        result.found["machines"] += key in named
        _course_scored(
            result,
            key,
            truth,
            [one for own, one in said if key in sets[own] and hasattr(one, "pieces")],
        )
    for row in found.levels:
        key = row.factor, row.level, row.effect
        if key not in unsure:
            result.p.append((row.probability, key in truly))
        if (
            row.effect == "flow.gain"
            and row.factor in ("operator", "product")
            and key not in unsure
        ):
            result.held["levels"].append(abs(row.size - shared.get(key, 0.0)) <= row.half)
    return result


def _course_scored(result: Score, key: Key, truth: Truth, courses: list[Any]) -> None:
    if truth.until < LOGS:
        result.of["repairs"] += 1
        result.found["repairs"] += any(
            each.repair > 0.5 and abs(each.logs_after - (LOGS - truth.until)) <= LATE
            for one in courses
            for each in one.changes
        )
    result.held["courses"].extend(
        abs(one.pieces[-1].end - truth.at(LOGS - 1)) <= one.pieces[-1].end_half
        for one in courses
        if one.effect == key[2]
    )


def _calibration(scores: list[Score]) -> None:
    p, true = np.array([pair for one in scores for pair in one.p]).reshape(-1, 2).T
    print("probability said: rows, their mean, and how many are so")
    for low, high in itertools.pairwise(BINS):
        here = (p >= low) & ((p < high) | (high == 1.0))
        if here.any():
            print(
                f"  {low:.2f} to {high:.2f}: {int(here.sum()):7d}   "
                f"{100.0 * p[here].mean():6.2f} %   "
                f"{100.0 * true[here].mean():6.2f} % ({int(true[here].sum())})"
            )
    inside = np.clip(p, 1e-6, 1.0 - 1e-6)
    print(
        "  log score "
        f"{-np.mean(true * np.log(inside) + (1.0 - true) * np.log1p(-inside)):.4f} a row"
    )
    for what in ("courses", "levels"):
        held = [one for each in scores for one in each.held[what]]
        print(
            f"90 % intervals that hold the truth, {what}: {sum(held)} of {len(held)} "
            f"({100.0 * np.mean(held) if held else 0.0:.0f} %)"
        )


def _said(found: Any) -> str:
    lines = [f"  {one.level} {_course_words(one)}" for one in found.courses]
    lines += [
        f"  {one.factor} {one.level} {one.effect} {one.size:+.2f} +- {one.half:.2f}"
        + _set_words(one)
        for one in found.shared
    ]
    return "\n".join([*lines, f"  the same logs: {[tuple(each) for each in found.same]}"])


def _course_words(one: Any) -> str:
    last = one.pieces[-1]
    return (
        f"{one.effect} now {last.end:+.2f} +- {last.end_half:.2f}"
        + "".join(
            f", change before the last {each.logs_after} logs {each.probability:.2f} "
            f"(repair {each.repair:.2f})"
            for each in one.changes
        )
        + _set_words(one)
    )


def _set_words(one: Any) -> str:
    return (
        "".join(
            f", or {each.factor} {each.level} {each.effect} {each.size:+.1f} "
            f"({each.probability:.2f})"
            for each in one.alternatives
        )
        if len(one.alternatives) > 1
        else ""
    )


if __name__ == "__main__":
    sys.exit(main())
