"""Runs of the classes beyond the first examination: effects that begin, grow or end, poor logs,
foreign logs, further columns, other noise, three at once, a loop that trims, and dependences
that no catalogue holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
    Planted,
    changed_by,
    effect_of,
    fits,
    plain,
    relation,
    rivals_of,
    sized,
    span_of,
    together,
    traits_of,
    within_tolerance,
)
from .truth import Columns, Made, Redrive, Redriven, share_of, told

RUN_IDS = tuple(i for i, k in IDS.items() if "run" in k.seen)
WITH_ONSET = tuple(
    i
    for i in RUN_IDS
    if i not in ("shaft.stall", "gate.stuck", "flow.batch", "flow.hopper_head", "flow.bridging")
)
WITH_GROWTH = (
    "shaft.gain",
    "shaft.slow",
    "shaft.dead_time",
    "shaft.voltage_sag",
    "shaft.load_droop",
    "gate.offset",
    "gate.home_error",
    "gate.backlash",
    "gate.lost_steps",
    "gate.slow",
    "flow.gain",
    "flow.zero_offset",
    "flow.fill_falloff",
    "flow.blocked_outlet",
    "flow.leak",
    "speed.wheel_slip",
    "speed.wheel_radius",
    "speed.missed_pulses",
    "canopy.head_fouled",
    "scale.gain",
)
WITH_END = (
    "shaft.gain",
    "shaft.slow",
    "shaft.dead_time",
    "shaft.voltage_sag",
    "shaft.load_droop",
    "gate.offset",
    "gate.home_error",
    "gate.slow",
    "flow.gain",
    "flow.zero_offset",
    "flow.blocked_outlet",
    "flow.leak",
    "flow.slope",
    "speed.wheel_slip",
    "speed.missed_pulses",
    "speed.gnss_latency",
    "canopy.head_fouled",
    "scale.gain",
)
COARSE_HZ = (5.0, 2.0, 1.0, 0.5)
FASTEST_HZ = 50.0
LOUD = ("loud", "loud_drift", "pink", "hum", "uneven")
LOOPS = ("loop", "healthy_loop")
LEAST_Z, LEAST_Z_OF_TERM, LEAST_Z_OF_THREE, MOST_Z = 2.0, 4.0, 5.0, 100.0
# from which likeness on a catalogued effect would be a fair answer to a term
LIKE_CATALOGUE = 0.6

# class -> ids it may hide (None: nothing; empty: not an effect of the catalogue)
CLASSES: dict[str, tuple[str, ...] | None] = {
    "healthy_fast": None,
    "healthy_coarse": None,
    "healthy_sparse": None,
    "healthy_loud": None,
    "healthy_foreign": None,
    "healthy_columns": None,
    "healthy_loop": None,
    "onset": WITH_ONSET,
    "growth": WITH_GROWTH,
    "temporary": WITH_END,
    "coarse": RUN_IDS,
    "sparse": RUN_IDS,
    "foreign": RUN_IDS,
    "loud": RUN_IDS,
    "triple": RUN_IDS,
    "loop": RUN_IDS,
    "column": (),
    "term": (),
}
# What an effect is told by: sensors, and columns of causes.
_STAGE_NEEDS = {
    "shaft": ("shaft",),
    "gate": ("gate",),
    "flow": ("shaft", "gate", "scale"),
    "speed": ("speed",),
    "scale": ("shaft", "gate", "scale"),
    "canopy": ("heads",),
}
_OWN_NEEDS = {
    "shaft.voltage_sag": ("supply_v",),
    "shaft.load_droop": ("opening_mm",),
    "gate.offset": ("scale",),
    "flow.slope": ("pitch_deg",),
    "scale.tilt": ("pitch_deg",),
    "speed.wheel_slip": ("pitch_deg", "working"),
    "flow.gain": (),
    "gate.home_error": (),
}
NEEDS = {i: (*_STAGE_NEEDS[i.split(".")[0]], *_OWN_NEEDS.get(i, ())) for i in RUN_IDS}


class _Recipe(NamedTuple):
    """How one log of a class comes about."""

    logged: Logged
    lacks: str = ""
    convention: str = ""
    told: dict[str, Any] = {}


def class_case(
    category: str,
    wanted: Sequence[str],
    split: str,
    rng: np.random.Generator,
    minutes: tuple[float, float] | None = None,
) -> Made | None:
    """One draw of a class; None where it does not work out. `wanted`: of its ids (or term
    classes) only these."""
    ids = _ids(category, wanted, rng)
    pool = [
        p for p in chosen(split) if ids is not None and all(fits(i, p) for i in ids if i in IDS)
    ]
    if ids is None or not pool:
        return None
    p = pool[int(rng.integers(len(pool)))]
    if category == "healthy_fast":
        p = p._replace(row_hz=FASTEST_HZ, minutes=(8.0, 14.0))
    d = drive(p._replace(minutes=minutes or p.minutes), int(rng.integers(1 << 30)))
    more: list[extras.Extra] = []
    if category in ("column", "healthy_columns"):
        more = extras.dealt(d, int(rng.integers(2, 6)), rng, category == "column")
    plant = Plant(d, {x.name: x.true for x in more})
    kind = str(rng.choice(LOUD)) if category.endswith("loud") else str(rng.choice(run_noise.KINDS))
    noises = (
        run_noise.louder(kind, d.row_s, rng)
        if kind in LOUD
        else run_noise.noises(kind, d.row_s, rng)
    )
    recipe = _recipe(category, d, rng, ids)
    if recipe is None:
        return None
    eye = Eye(plant, noises, Physics(), recipe.logged)
    physics = within_tolerance(rng, bool(d.refill_kg))
    hidden = _planted(category, eye, ids, more, plant, rng)
    if hidden is None:
        return None
    outside, planted, found = hidden
    log_seed, trim = int(rng.integers(1 << 30)), None
    if category in LOOPS:
        plant, trim = _closed(plant, physics, planted, noises, log_seed, rng)
        d, eye = plant.drive, Eye(plant, noises, Physics(), recipe.logged)
        found = [(e, eye.z([e])) for e in planted]
        if any(z < LEAST_Z for _, z in found):
            return None
    causes = [_told(eye, e, z, planted, d) for e, z in found]
    traits = tuple(t._replace(size=float(f"{t.size:.4g}")) for t in traits_of(eye, rng, plant))
    columns = runlog.columns(plant, physics, (*planted, *traits), noises, log_seed)
    if np.nanmin(columns["hopper_kg"]) < LEAST_KG:
        return None
    columns |= {x.name: x.told for x in more}
    if trim is not None:
        columns["flow_trim"] = trim
    columns = written(columns, recipe.logged, recipe.lacks, recipe.convention)
    truth = {
        "programme": p.name,
        "noise": kind,
        "rows": int(columns["time_s"].size),
        "outside": outside,
        "causes": causes,
        "traits": [plain(t) for t in traits],
        "physics": physics._asdict(),
        "log": {"row_s": d.row_s, **recipe.told, "columns": {x.name: x.like for x in more}},
    }
    again = (
        _redriven(d, physics, planted, traits, more, noises, log_seed, truth)
        if category in ("term", "column")
        else None
    )
    return "run", columns, truth, share_of(planted, eye.trace, eye.inner), again


def _redriven(
    d: Drive,
    physics: Physics,
    planted: tuple[Effect, ...],
    traits: tuple[Effect, ...],
    more: Sequence[extras.Extra],
    noises: dict[str, run_noise.Noise],
    log_seed: int,
    truth: dict[str, Any],
) -> Redriven:
    def redriven(change: Callable[[Drive], Drive], other_seed: int | None) -> Redrive:
        """A span belongs to the run that it was in: the other has none."""
        there = tuple(e for e in planted if e.term is None or e.term.kind != "span")
        seed, other_drive = log_seed if other_seed is None else other_seed, change(d)
        again = [
            extras.again(x, other_drive, np.random.default_rng([seed, k, 23]))
            for k, x in enumerate(more)
        ]
        other = Plant(other_drive, {x.name: x.true for x in again})
        sensors = {
            name: run_noise.at_rate(n, d.row_s, other_drive.row_s) for name, n in noises.items()
        }
        seen = runlog.columns(other, physics, (*there, *traits), sensors, seed) | {
            x.name: x.told for x in again
        }
        return Redrive(
            seen,
            {
                **truth,
                "programme": other_drive.programme.name,
                "rows": int(other_drive.time_s.size),
            },
            lambda: changed_by(other, physics, there, traits),
        )

    return redriven


def _ids(category: str, wanted: Sequence[str], rng: np.random.Generator) -> tuple[str, ...] | None:
    """What is to be hidden: ids, or one class of terms; nothing of a healthy class. None:
    nothing of what is wanted."""
    allowed = {"term": terms.CLASSES[:-1], "column": ("column",)}.get(category, CLASSES[category])
    if allowed is None:
        return ()
    able = [i for i in allowed if not wanted or i in wanted]
    if not able:
        return None
    first = str(rng.choice(able))
    if category != "triple":
        return (first,)
    others = [i for i in RUN_IDS if i not in (first, "shaft.stall", "gate.stuck")]
    return (first, *(str(i) for i in rng.choice(others, 2, replace=False)))


def _planted(
    category: str,
    eye: Eye,
    ids: Sequence[str],
    more: list[extras.Extra],
    plant: Plant,
    rng: np.random.Generator,
) -> Planted | None:
    """None where one does not work out or hides another."""
    if category in ("term", "column"):
        made = _term(eye, plant, ids[0], more, rng)
        return None if made is None else Planted(made[0], (made[1],), [])
    several = _effects(category, eye, ids, plant, rng)
    return None if several is None else Planted(None, tuple(e for e, _ in several), several)


def _effects(
    category: str, eye: Eye, ids: Sequence[str], plant: Plant, rng: np.random.Generator
) -> list[tuple[Effect, float]] | None:
    """Each effect with its z; None where one does not work out or hides another."""
    found = []
    for name in ids:
        one = _effect(
            category, eye, name, plant, rng, LEAST_Z_OF_THREE if category == "triple" else LEAST_Z
        )
        if one is None:
            return None
        found.append(one)
    if any(together(eye, (a, b)) for k, (a, _) in enumerate(found) for b, _ in found[:k]):
        return None
    return found


def _told(eye: Eye, e: Effect, z: float, planted: tuple[Effect, ...], d: Drive) -> dict[str, Any]:
    cause = told(e, z, relation(eye, e, z, planted, _rivals(e, eye.plant)), span_of(d))
    if e.course is None:
        return cause
    return {
        **cause,
        "onset_s": e.course.from_s,
        "onset_sd_s": round(onset_sd(eye, e), 2),
        "course": e.course._asdict(),
    }


def _closed(
    plant: Plant,
    physics: Physics,
    planted: tuple[Effect, ...],
    noises: dict[str, Any],
    log_seed: int,
    rng: np.random.Generator,
) -> tuple[Plant, Any]:
    """The plant under a controller that corrects its flow by the scale, and the correction
    (rows,)."""

    def logged(driven: Drive) -> Columns:
        return runlog.columns(Plant(driven, plant.columns), physics, planted, noises, log_seed)

    driven, trim = closed_loop.trimmed(plant.drive, logged, rng)
    return Plant(driven, plant.columns), trim


def _recipe(
    category: str, d: Drive, rng: np.random.Generator, ids: Sequence[str]
) -> _Recipe | None:
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
        hz = float(
            rng.choice([1.0, 2.0] if convention == "same_row" else [1.0 / d.row_s, 5.0, 1.0])
        )
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


def _effect(
    category: str, eye: Eye, name: str, plant: Plant, rng: np.random.Generator, lowest_z: float
) -> tuple[Effect, float] | None:
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
    return float(np.exp(rng.uniform(np.log(lowest), np.log(MOST_Z))))


def _rivals(e: Effect, plant: Plant) -> Iterator[Effect]:
    """The catalogue's on the course of `e`, or as they are; what drifts, from the time at which
    `e` begins.

    A drift that begins is like other effects that grow from then on.
    """
    drifts = ("flow.moisture_drift", "scale.drift")
    for r in rivals_of(e, plant):
        if e.course is None:
            yield r
            continue
        there = r.id in {ONSET: WITH_ONSET, GROWTH: WITH_GROWTH, TEMPORARY: WITH_END}[e.course.kind]
        yield r._replace(course=e.course, onset_s=None) if there else r
        if r.id in drifts:
            yield r._replace(course=Course(ONSET, e.course.from_s, 0.0))
        if e.id in drifts and r.id in WITH_GROWTH:
            over_s = float(plant.drive.time_s[-1]) - e.course.from_s
            yield r._replace(course=Course(GROWTH, e.course.from_s, over_s), onset_s=None)


def begun_at(e: Effect, from_s: float) -> Effect:
    """The same effect with another begin; a growth ends where it did."""
    assert e.course is not None
    over_s = e.course.over_s + (e.course.from_s - from_s if e.course.kind == GROWTH else 0.0)
    return e._replace(course=e.course._replace(from_s=from_s, over_s=over_s))


def onset_sd(eye: Eye, e: Effect, step_s: float = 5.0) -> float:
    """How sharply the data hold the begin, 1 s.d. in s: the bound of Cramer and Rao, size and
    begin both unknown."""
    assert e.course is not None
    by_size = eye.trace([e]) / e.size
    later, earlier = (eye.trace([begun_at(e, e.course.from_s + d)]) for d in (step_s, -step_s))
    by_begin = (later - earlier) / (2.0 * step_s)
    a, b, c = (
        eye.inner(by_size, by_size),
        eye.inner(by_size, by_begin),
        eye.inner(by_begin, by_begin),
    )
    left = c - b * b / a if a > 0 else 0.0
    return float(min(1e4, left**-0.5)) if left > 0 else 1e4


def _term(
    eye: Eye, plant: Plant, kind: str, more: Sequence[extras.Extra], rng: np.random.Generator
) -> tuple[dict[str, Any], Effect] | None:
    """A dependence of one class that no catalogued effect comes near; z log-uniform from 4 to
    100."""
    d = plant.drive
    values = {
        **{
            v: np.asarray(getattr(d, v), dtype=float)
            for v in (
                "time_s",
                "roll_deg",
                "pitch_deg",
                "supply_v",
                "speed_mps",
                "heading_deg",
                "shaft_rpm_cmd",
                "opening_mm_cmd",
            )
        },
        **plant.columns,
    }
    if kind == "column":
        name = more[0].name
        stage = str(rng.choice(extras.KNOWN[name].drives))
        term = terms.term_over(
            "column", (name,), values, int(rng.integers(12)), float(rng.random())
        )
    else:
        stage, term = terms.dealt(kind, values, rng)
    channel, _, guess, unit = terms.STAGES[stage]
    if any(
        np.ptp(np.percentile(values[v], (2.0, 98.0))) == 0.0 for v in term.variables if v in values
    ):
        return None  # what never moves shows no dependence
    if terms.ANGLE in term.variables and plant.drive.row_s > 0.05:
        return None  # too slow a log to see a turn of the shaft
    guess *= (
        1.0 if kind in ("dead_zone", "saturation") and term.form % 2 else float(rng.choice([-1, 1]))
    )
    made = sized(eye, Effect(stage, guess, term=term), _z(rng, LEAST_Z_OF_TERM), 300 * abs(guess))
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
    right = [
        [v, *(w for w in terms.also_right(v) if w != v), *_alike(v, values)] for v in term.variables
    ]
    return {
        "name": f"{kind}.{stage[2:]}",
        "class": kind,
        "channel": channel,
        "stage": stage,
        "z": round(z, 3),
        "variables": sorted({w for one in right for w in one}),
        "each": right,
        "size": e.size,
        "unit": unit,
        "term": term._asdict(),
        "likest": best,
        "likest_catalogued": round(float(likest), 3),
    }, e


def _alike(variable: str, values: dict[str, Any]) -> list[str]:
    """Other variables that on this drive say the same."""
    mine = values.get(variable)
    if mine is None:
        return []
    return [
        n
        for n, v in values.items()
        if n != variable and v.std() > 0 and abs(np.corrcoef(mine, v)[0, 1]) > 0.9
    ]
