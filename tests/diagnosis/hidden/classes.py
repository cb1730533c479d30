"""Runs of the classes beyond the first examination: effects that begin, grow or end, poor logs, foreign logs, further
columns, other noise, three at once, a loop that trims, and dependences that no catalogue holds."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from . import closed_loop, courses, extras, runlog, terms
from . import noise as run_noise
from .courses import GROWTH, ONSET, TEMPORARY, Course
from .detect import Eye
from .logged import CONVENTIONS, LACKS, Logged, coarse_rows, judged, patches, thinned, written
from .nominal import IDS, Effect, Physics
from .plant import Plant
from .programmes import Drive, chosen, drive
from .run_cases import (
    LEAST_KG,
    effect_of,
    fits,
    plain,
    rivals_of,
    sized,
    span_of,
    together,
    traits_of,
    within_tolerance,
)
from .truth import Columns, Made, Relations, share_of, told

RUN_IDS = tuple(i for i, k in IDS.items() if "run" in k.seen)
WITH_ONSET = tuple(i for i in RUN_IDS if i not in (
    "shaft.stall", "gate.stuck", "flow.batch", "flow.hopper_head", "flow.bridging"))
WITH_GROWTH = ("shaft.gain", "shaft.slow", "shaft.dead_time", "shaft.voltage_sag", "shaft.load_droop", "gate.offset",
               "gate.home_error", "gate.backlash", "gate.lost_steps", "gate.slow", "flow.gain", "flow.zero_offset",
               "flow.fill_falloff", "flow.blocked_outlet", "flow.leak", "speed.wheel_slip", "speed.wheel_radius",
               "speed.missed_pulses", "canopy.head_fouled", "scale.gain")
WITH_END = ("shaft.gain", "shaft.slow", "shaft.dead_time", "shaft.voltage_sag", "shaft.load_droop", "gate.offset",
            "gate.home_error", "gate.slow", "flow.gain", "flow.zero_offset", "flow.blocked_outlet", "flow.leak",
            "flow.slope", "speed.wheel_slip", "speed.missed_pulses", "speed.gnss_latency", "canopy.head_fouled",
            "scale.gain")
COARSE_HZ = (5.0, 2.0, 1.0, 0.5)
FASTEST_HZ = 50.0
LOUD = ("loud", "loud_drift", "pink", "hum", "uneven")
LOOPS = ("loop", "healthy_loop")
LIKE_CATALOGUE = 0.6              # from which likeness on a catalogued effect would be a fair answer to a term

# class -> ids it may hide (None: nothing; empty: not an effect of the catalogue)
CLASSES: dict[str, tuple[str, ...] | None] = {
    "healthy_fast": None, "healthy_coarse": None, "healthy_sparse": None, "healthy_loud": None,
    "healthy_foreign": None, "healthy_columns": None, "healthy_loop": None,
    "onset": WITH_ONSET, "growth": WITH_GROWTH, "temporary": WITH_END,
    "coarse": RUN_IDS, "sparse": RUN_IDS, "foreign": RUN_IDS, "loud": RUN_IDS, "triple": RUN_IDS, "loop": RUN_IDS,
    "column": (), "term": (),
}
# What an effect is told by: sensors, and columns of causes.
_STAGE_NEEDS = {"shaft": ("shaft",), "gate": ("gate",), "flow": ("shaft", "gate", "scale"), "speed": ("speed",),
                "scale": ("shaft", "gate", "scale"), "canopy": ("heads",)}
_OWN_NEEDS = {"shaft.voltage_sag": ("supply_v",), "shaft.load_droop": ("opening_mm",), "gate.offset": ("scale",),
              "flow.slope": ("pitch_deg",), "scale.tilt": ("pitch_deg",), "speed.wheel_slip": ("pitch_deg", "working"),
              "flow.gain": (), "gate.home_error": ()}
NEEDS = {i: (*_STAGE_NEEDS[i.split(".")[0]], *_OWN_NEEDS.get(i, ())) for i in RUN_IDS}


class _Recipe(NamedTuple):
    """How one log of a class comes about."""

    logged: Logged
    lacks: str = ""
    convention: str = ""
    told: dict[str, Any] = {}


def class_case(category: str, wanted: Sequence[str], split: str, rng: np.random.Generator) -> Made | None:
    """One draw of a class; None where it does not work out. `wanted`: of its ids (or term classes) only these."""
    allowed = CLASSES[category]
    if category in ("term", "column"):
        allowed = terms.CLASSES[:-1] if category == "term" else ("column",)
    ids = [i for i in allowed or () if not wanted or i in wanted]
    if allowed is not None and not ids:
        return None
    pool = list(chosen(split))
    chosen_ids: tuple[str, ...] = () if allowed is None else (str(rng.choice(ids)),)
    if category == "triple":
        others = [i for i in RUN_IDS if i not in chosen_ids and i not in ("shaft.stall", "gate.stuck")]
        chosen_ids = (*chosen_ids, *(str(i) for i in rng.choice(others, 2, replace=False)))
    pool = [p for p in pool if all(fits(i, p) for i in chosen_ids if i in IDS)]
    p = pool[int(rng.integers(len(pool)))]
    if category == "healthy_fast":
        p = p._replace(row_hz=FASTEST_HZ, minutes=(8.0, 14.0))
    d = drive(p, int(rng.integers(1 << 30)))
    is_column = category in ("column", "healthy_columns")
    more = extras.dealt(d, int(rng.integers(2, 6)), rng, category == "column") if is_column else []
    plant = Plant(d, {x.name: x.true for x in more})
    kind = str(rng.choice(LOUD)) if category.endswith("loud") else str(rng.choice(run_noise.KINDS))
    noises = run_noise.louder(kind, d.row_s, rng) if kind in LOUD else run_noise.noises(kind, d.row_s, rng)
    recipe = _recipe(category, d, rng, chosen_ids)
    if recipe is None:
        return None
    eye = Eye(plant, noises, Physics(), recipe.logged)
    physics = within_tolerance(rng, bool(d.refill_kg))
    outside, found = None, []
    if category in ("term", "column"):
        made = _term(eye, plant, chosen_ids[0], more, rng)
        if made is None:
            return None
        outside, planted = made[0], (made[1],)
    else:
        lowest = 5.0 if category == "triple" else 2.0
        for name in chosen_ids:
            one = _effect(category, eye, name, plant, rng, lowest)
            if one is None:
                return None
            found.append(one)
        planted = tuple(e for e, _ in found)
    if len(planted) > 1 and any(together(eye, (a, b)) for k, a in enumerate(planted) for b in planted[:k]):
        return None
    log_seed, trim = int(rng.integers(1 << 30)), None
    if category in LOOPS:
        plant, trim = _closed(plant, physics, planted, noises, log_seed, rng)
        d, eye = plant.drive, Eye(plant, noises, Physics(), recipe.logged)
        found = [(e, eye.z([e])) for e, _ in found]
        if any(z < 2.0 for _, z in found):
            return None
    relations = [_relation(eye, e, z, planted) for e, z in found]
    traits = tuple(t._replace(size=float(f"{t.size:.4g}")) for t in traits_of(eye, rng, plant))
    columns = runlog.columns(plant, physics, (*planted, *traits), noises, log_seed)
    if trim is not None:
        columns["flow_trim"] = trim
    if np.nanmin(columns["hopper_kg"]) < LEAST_KG:
        return None
    for x in more:
        columns[x.name] = x.told
    columns = written(columns, recipe.logged, recipe.lacks, recipe.convention)
    causes = []
    for (e, z), r in zip(found, relations, strict=True):
        cause = told(e, z, r, span_of(d))
        if e.course is not None:
            cause |= {"onset_s": e.course.from_s, "course": e.course._asdict()}
        causes.append(cause)
    truth = {"programme": p.name, "noise": kind, "rows": int(columns["time_s"].size), "outside": outside,
             "causes": causes, "traits": [plain(t) for t in traits], "physics": physics._asdict(),
             "log": {"row_s": d.row_s, **recipe.told, "columns": {x.name: x.like for x in more}}}
    return "run", columns, truth, share_of(planted, eye.trace, eye.inner), None


def _closed(plant: Plant, physics: Physics, planted: tuple[Effect, ...], noises: dict[str, Any], log_seed: int,
            rng: np.random.Generator) -> tuple[Plant, Any]:
    """The plant under a controller that corrects its flow by the scale, and the correction (rows,)."""
    def logged(driven: Drive) -> Columns:
        return runlog.columns(Plant(driven, plant.columns), physics, planted, noises, log_seed)

    driven, trim = closed_loop.trimmed(plant.drive, logged, rng)
    return Plant(driven, plant.columns), trim


def _recipe(category: str, d: Drive, rng: np.random.Generator, ids: Sequence[str]) -> _Recipe | None:
    count = d.time_s.size
    if category.endswith("coarse"):
        hz = float(rng.choice(COARSE_HZ))
        return _Recipe(Logged(coarse_rows(count, d.row_s, hz, rng)), told={"hz": hz})
    if category.endswith("sparse"):
        hz = float(rng.choice([1.0 / d.row_s, 5.0, 1.0]))
        rows = np.arange(count) if hz > 5.0 else coarse_rows(count, d.row_s, hz, rng)
        rows, how = thinned(rows, 1.0 / hz, rng)
        return _Recipe(Logged(rows), told={"hz": hz, "missing": how})
    if not category.endswith("foreign"):
        return _Recipe(Logged())
    what = str(rng.choice(["convention", "lacks", "patchy"], p=[0.4, 0.4, 0.2]))
    if what == "convention":
        convention = str(rng.choice(CONVENTIONS))
        hz = float(rng.choice([1.0, 2.0] if convention == "same_row" else [1.0 / d.row_s, 5.0, 1.0]))
        rows = None if hz > 5.0 else coarse_rows(count, d.row_s, hz, rng)
        return _Recipe(Logged(rows), "", convention, {"convention": convention, "hz": hz})
    if what == "patchy":
        empty, names = patches(count, rng)
        return _Recipe(Logged(None, (), empty), told={"patchy": names})
    able = [w for w in LACKS if len(judged(w, ids, NEEDS)) == len(ids)]
    if not able:
        return None
    lacks = str(rng.choice(able))
    return _Recipe(Logged(None, LACKS[lacks][1]), lacks, told={"lacks": lacks})


def _effect(category: str, eye: Eye, name: str, plant: Plant, rng: np.random.Generator,
            lowest_z: float) -> tuple[Effect, float] | None:
    """One effect of a class; z log-uniform from `lowest_z` to 100 where a size decides it."""
    kind = IDS[name]
    e = effect_of(name, (kind.sign or int(rng.choice([-1, 1]))) * kind.guess, rng, plant)
    if category in (ONSET, GROWTH, TEMPORARY):
        e = e._replace(course=courses.dealt(category, plant.drive.time_s, rng), onset_s=None)
    if kind.by_z:
        return sized(eye, e, _z(rng, lowest_z), kind.most)
    e = e._replace(size=float(rng.uniform(kind.guess, kind.most)))
    if name in ("shaft.stall", "gate.stuck"):
        e = e._replace(size=e.onset_s or 0.0)
    z = eye.z([e])
    return (e, z) if z > lowest_z else None


def _z(rng: np.random.Generator, lowest: float) -> float:
    return float(np.exp(rng.uniform(np.log(lowest), np.log(100.0))))


def _rivals(e: Effect, plant: Plant) -> Iterator[Effect]:
    """The catalogue's, as they are and on the course of `e`; what drifts, from the time at which `e` begins."""
    for r in rivals_of(e, plant):
        if e.course is None:
            yield r
            continue
        there = r.id in {ONSET: WITH_ONSET, GROWTH: WITH_GROWTH, TEMPORARY: WITH_END}[e.course.kind]
        yield r._replace(course=e.course, onset_s=None) if there else r
        if r.id in ("flow.moisture_drift", "scale.drift"):
            yield r._replace(course=Course(ONSET, e.course.from_s, 0.0))


def _relation(eye: Eye, e: Effect, z: float, planted: tuple[Effect, ...]) -> dict[str, Any]:
    mine = eye.trace([e], [p for p in planted if p != e])
    found = Relations(z)
    for r in _rivals(e, eye.plant):
        like = eye.likeness(mine, eye.trace([r]))
        found.add(r.id, abs(like) if IDS[r.id].sign == 0 else like)
    return found.told()


def _term(eye: Eye, plant: Plant, kind: str, more: Sequence[extras.Extra],
          rng: np.random.Generator) -> tuple[dict[str, Any], Effect] | None:
    """A dependence of one class that no catalogued effect comes near; z log-uniform from 4 to 100."""
    d = plant.drive
    values = {**{v: np.asarray(getattr(d, v), dtype=float) for v in (
        "time_s", "roll_deg", "pitch_deg", "supply_v", "speed_mps", "heading_deg", "shaft_rpm_cmd", "opening_mm_cmd")},
        **plant.columns}
    if kind == "column":
        name = more[0].name
        stage = str(rng.choice(extras.KNOWN[name].drives))
        term = terms.term_over("column", (name,), values, int(rng.integers(12)), float(rng.random()))
    else:
        stage, term = terms.dealt(kind, values, rng)
    channel, _, guess, unit = terms.STAGES[stage]
    if terms.ANGLE in term.variables and plant.drive.row_s > 0.05:
        return None                                          # too slow a log to see a turn of the shaft
    guess *= 1.0 if kind in ("dead_zone", "saturation") and term.form % 2 else float(rng.choice([-1, 1]))
    made = sized(eye, Effect(stage, guess, term=term), _z(rng, 4.0), 300 * abs(guess))
    if made is None:
        return None
    e, z = made
    mine = eye.trace([e])
    stage_of = {"speed": "speed", "gate": "gate", "shaft": "shaft"}.get(channel, "flow")
    best, likest = "", 0.0
    for r in rivals_of(Effect(f"{stage_of}.none", 0.0), plant):
        like = abs(eye.likeness(mine, eye.trace([r])))
        if like > likest:
            best, likest = r.id, like
    if likest > LIKE_CATALOGUE:
        return None
    right = [[v, *(w for w in terms.also_right(v) if w != v), *_alike(v, values)] for v in term.variables]
    return {"name": f"{kind}.{stage[2:]}", "class": kind, "channel": channel, "stage": stage, "z": round(z, 3),
            "variables": sorted({w for one in right for w in one}), "each": right, "size": e.size, "unit": unit,
            "term": term._asdict(), "likest": best, "likest_catalogued": round(float(likest), 3)}, e


def _alike(variable: str, values: dict[str, Any]) -> list[str]:
    """Other variables that on this drive say the same."""
    mine = values.get(variable)
    if mine is None:
        return []
    return [n for n, v in values.items() if n != variable and v.std() > 0 and abs(np.corrcoef(mine, v)[0, 1]) > 0.9]
