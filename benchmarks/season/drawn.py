"""A season on the level of results: 600 logs of 20 machines as forms, drawn from another model than reads them.

Each log's sizes are made by plain sums over its machine, operator, product and field, a repair, wear, and a Student's t
scatter from log to log. What the log measures of them is a regression of its own: some 200 random operating points, on
which look-alikes (flow gain and scale gain, fill loss, hopper head, scale drift) move nearly together, and in one log
of five so nearly that they are exchanged. Nothing is shared with the model but the format of a form.

    python benchmarks/season/drawn.py --seeds 3701 3702 [--tree OLD]

`--tree`: another tree whose season is asked of the same logs. Prints what was planted next to what is said, and how
often 90 % intervals hold the truth.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

MACHINES, LOGS = 20, 30
NAMES = ("flow.gain", "flow.fill_falloff", "flow.hopper_head", "scale.gain", "scale.drift", "gate.offset", "shaft.gain",
         "speed.wheel_radius", "speed.wheel_slip")
MISTAKEN = 0.2  # of logs, in which look-alikes are exchanged
# What one unit of each does to three readings (flow, drives, speed) at operating points of speed s, level, time t.
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
TOLERANCE = {"flow.gain": 0.6, "shaft.gain": 0.05, "speed.wheel_radius": 0.15}  # s.d. of a machine's own
SCATTER = {"flow.gain": 0.5}


class Truth(NamedTuple):
    """machines: effect, size at the first and at the last log before `until`, and what is left after."""

    machine: str
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
    Truth("m01", "flow.gain", -5.0, -5.0),
    Truth("m02", "scale.gain", 5.0, 5.0),
    Truth("m03", "flow.fill_falloff", 0.0, 12.0),
    Truth("m04", "gate.offset", 0.8, 0.8),
    Truth("m05", "speed.wheel_radius", 0.0, -2.5),
    Truth("m06", "shaft.gain", 1.2, 1.2),
    *(Truth(f"m{10 + k:02d}", "gate.offset", 0.6, 0.6, LOGS - after) for k, after in enumerate((1, 2, 3, 5, 10, 20))),
    Truth("m16", "flow.fill_falloff", 0.0, 10.0, 22),
    Truth("m17", "flow.hopper_head", 6.0, 6.0),
)
OPERATORS = {"Adams": -5.0, "Baker": 0.0, "Chen": 0.0, "Diaz": 2.0, "Evans": 0.0}  # % of flow; Adams drives most
SHARE = (0.5, 0.15, 0.15, 0.1, 0.1)
PRODUCTS = {"urea": 0.0, "compound": 4.0, "potash": 0.0}


class Made(NamedTuple):
    form: dict[str, Any]
    key: str
    machine: str
    time_d: float
    shared: dict[str, str]


def season_of(seed: int) -> list[Made]:
    rng = np.random.default_rng(seed)
    logs = []
    for number in range(MACHINES):
        machine = f"m{number:02d}"
        off = {name: rng.normal() for name in TOLERANCE}
        for k in range(LOGS):
            operator = "Solo" if number == 19 else str(rng.choice(list(OPERATORS), p=SHARE))
            product = str(rng.choice(list(PRODUCTS), p=(0.5, 0.3, 0.2)))
            size = {one.effect: one.at(k) for one in PLANTED if one.machine == machine}
            if number == 19:
                size["flow.gain"] = 4.0  # m19 and its only operator: nobody can part them
            size["flow.gain"] = size.get("flow.gain", 0.0) + OPERATORS.get(operator, 0.0) + PRODUCTS[product]
            for name, sd in SCATTER.items():
                size[name] = size.get(name, 0.0) + sd * rng.standard_t(5) / np.sqrt(5.0 / 3.0)
            logs.append(Made(_forms(rng, size, off, rng.random() < MISTAKEN), f"{machine}-{k}", machine,
                             k * 2.0 + rng.random(),
                             {"operator": operator, "product": product, "field": f"f{number // 4}-{k // 10}"}))
    return logs


def _forms(rng: np.random.Generator, size: dict[str, float], off: dict[str, float], mistaken: bool) -> dict[str, Any]:
    """Least squares of one log: what its readings say of every effect, the machine's tolerances as nuisance."""
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
    return {"names": NAMES, "normal": tuple(map(tuple, normal.tolist())), "right": tuple(right.tolist()),
            "open": tuple(TOLERANCE), "pulls": tuple(map(tuple, (across @ inner).tolist()))}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3701])
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[2])
    given = parser.parse_args()
    sys.path.insert(0, str(given.tree))
    held: list[bool] = []
    for seed in given.seeds:
        made = season_of(seed)
        begin = time.process_time()
        found = _asked(made)
        print(f"seed {seed}: {len(made)} logs of {MACHINES} machines, {time.process_time() - begin:.1f} s of processor")
        held += _as_drawn(found)
    print(f"90 % intervals that hold the truth: {sum(held)} of {len(held)} ({100.0 * np.mean(held):.0f} %)")
    return 0


def _asked(made: list[Made]) -> Any:
    from control.diagnosis.season.courses import fitted
    from control.diagnosis.season.evidence import OneLog, QuadraticForm
    return fitted([OneLog(one.key, one.machine, one.time_d, (QuadraticForm(**one.form),), one.shared) for one in made])


def _as_drawn(found: Any) -> list[bool]:
    held, named = list[bool](), set()
    print("  machine  planted                              said")
    for one in (*PLANTED, Truth("m19", "flow.gain", 4.0, 4.0)):
        own = [each for each in found.courses if each.machine == one.machine
               and (each.effect == one.effect or one.effect in each.alike)]
        named |= {(each.machine, each.effect) for each in own}
        said = "; ".join(map(_course_words, own)) or "nothing"
        if one.machine == "m19":
            said += " | " + "; ".join(f"{each.factor} {each.level} {each.effect} {each.size:+.2f}"
                                      for each in found.shared if each.level == "Solo")
        elif own and own[0].effect == one.effect:
            held.append(abs(own[0].pieces[-1].end - one.at(LOGS - 1)) <= own[0].pieces[-1].end_half)
        until = f", {one.after:g} in the last {LOGS - one.until} logs" if one.until < LOGS else ""
        print(f"  {one.machine}  {one.effect} {one.begin:g} to {one.end:g}{until}: {said}")
    for each in found.courses:
        if (each.machine, each.effect) not in named:
            print(f"  not planted: {each.machine} {_course_words(each)}")
    for factor, sizes in (("operator", OPERATORS), ("product", PRODUCTS)):
        for level, size in sizes.items():
            shared = [each for each in found.shared if (each.factor, each.level) == (factor, level)]
            reported = [each for each in shared if each.effect == "flow.gain"]
            row = [each for each in found.levels
                   if (each.factor, each.level, each.effect) == (factor, level, "flow.gain")]
            held += [abs(each.size - size) <= each.half for each in (reported or row)]
            print(f"  {factor} {level}: planted {size:+.1f} %; said "
                  + (", ".join(f"{each.size:+.2f} +- {each.half:.2f}" for each in reported) or "nothing")
                  + (f"; its interval {row[0].size:+.2f} +- {row[0].half:.2f}" if row and not reported else "")
                  + "".join(f"; also {each.effect} {each.size:+.2f}" for each in shared if each not in reported))
    for each in found.shared:
        if each.factor not in ("operator", "product"):
            print(f"  also said: {each.factor} {each.level} {each.effect} {each.size:+.2f} +- {each.half:.2f}")
    print("  the same logs:", [tuple(each) for each in found.same])
    return held


def _course_words(one: Any) -> str:
    last = one.pieces[-1]
    said = f"{one.effect} now {last.end:+.2f} +- {last.end_half:.2f}" + "".join(
        f", change before the last {each.logs_after} logs {each.probability:.2f} (repair {each.repair:.2f})"
        for each in one.changes)
    if len(one.alternatives) > 1:
        others = (f"{each.factor} {each.level} {each.effect} {each.size:+.1f} ({each.probability:.2f})"
                  for each in one.alternatives)
        return ", or ".join([said, *others])
    return said + (f"; alike {one.alike}" if one.alike else "")


if __name__ == "__main__":
    sys.exit(main())
