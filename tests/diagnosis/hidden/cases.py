"""The examination: cases with something hidden in them, or nothing, and the truth about each for the scorer alone."""
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import noise as run_noise
from . import nominal as nom
from . import runlog, tables
from .detect import Eye
from .nominal import IDS, OUTSIDE, Effect, Physics
from .plant import Plant
from .programmes import SPLITS, Programme, chosen, drive

Floats = npt.NDArray[np.float64]
CATEGORIES = ("none", "single", "pair", "lookalike", "outside")
SHARES = (0.32, 0.36, 0.12, 0.09, 0.11)
EQUAL = 0.99                      # likeness of two traces from which on the data cannot tell them apart
SEPARABLE_Z = 3.0                 # what must be left of an effect after its rival to be told from it
_GROUPS = {"shaft": ("shaft.",), "gate": ("gate.", "flow.", "scale."), "flow": ("gate.", "flow.", "scale."),
           "scale": ("gate.", "flow.", "scale."), "speed": ("speed.",), "canopy": ("canopy.",)}
_ONSETS = ("shaft.stall", "gate.stuck", "flow.blocked_outlet")
_TRAITS = ("t.gate_bow", "t.shaft_tau", "t.shaft_ripple", "t.shaft_sensor", "t.flow_wave", "t.wheel_wobble")
_LOOKALIKES = (
    (("flow.hopper_head", "flow.moisture_drift", "scale.drift"), ("run",), lambda p: not p.refill),
    (("flow.gain", "scale.gain"), ("run",), lambda p: not p.refill),
    (("speed.wheel_slip", "speed.wheel_radius"), ("run",), lambda p: not p.headlands and p.ground == "flat"),
    (("speed.missed_pulses", "speed.wheel_radius"), ("run",), lambda p: True),
    (("flow.batch", "flow.blocked_outlet"), ("run",), lambda p: p.refill),
    (("flow.gain", "flow.zero_offset", "speed.wheel_slip", "speed.wheel_radius", "scale.gain"), ("weigh",), None),
    (("place.lever_arm", "place.latency"), ("place",), None),
    (("lag.offset", "shaft.dead_time"), ("lag",), None),
)


Columns = dict[str, npt.NDArray[Any]]
Share = Callable[[Sequence[dict[str, Any]]], float | None]
Made = tuple[str, Columns, dict[str, Any], Share]


class Case(NamedTuple):
    """`columns`: what the diagnosis gets. `truth`: what only the scorer may know (plain words and numbers).

    `gain_share`: given an answer's causes, the share of the error removable by the truth that they remove (1 = all).
    """

    name: str
    kind: str                     # run, lag, catch, weigh, heads, place
    columns: Columns
    truth: dict[str, Any]
    gain_share: Share


def cases(count: int, seed: int = 1, programmes: str = "all", start: int = 0,
          categories: Sequence[str] = CATEGORIES, kinds: Sequence[str] | None = None,
          ids: Sequence[str] | None = None) -> Iterator[Case]:
    """Yields `count` cases from number `start` on. Case k is the same whatever is asked for beside it.

    programmes: tuning, unseen or all. categories, kinds (run, lag, ...), ids: only such cases are made.
    Raises ValueError on an unknown word.
    """
    chosen(programmes)
    for given, known in ((categories, CATEGORIES), (ids or (), tuple(IDS))):
        for word in given:
            if word not in known:
                raise ValueError(f"{word!r} is not one of {', '.join(known)}")
    for k in range(start, start + count):
        yield one(k, seed, programmes, tuple(categories), tuple(kinds or ()), tuple(ids or ()))


def one(number: int, seed: int, programmes: str = "all", categories: tuple[str, ...] = CATEGORIES,
        kinds: tuple[str, ...] = (), ids: tuple[str, ...] = ()) -> Case:
    """Case `number`; tries again with other draws until one fits what is asked for."""
    for attempt in range(200):
        rng = np.random.default_rng([seed, number, attempt])
        shares = np.array([s for c, s in zip(CATEGORIES, SHARES, strict=True) if c in categories])
        category = str(rng.choice(list(categories), p=shares / shares.sum())) if attempt == 0 else category
        split = programmes if programmes != "all" else SPLITS[number % 2]
        made = _make(category, split, rng, kinds, ids, number)
        if made is not None:
            kind, columns, truth, share = made
            name = f"case-{seed}-{number:05d}"
            return Case(name, kind, columns, {"case": name, "number": number, "seed": seed, "category": category,
                                              "split": split, "data_kind": kind, **truth}, share)
    raise ValueError(f"case {number}: nothing fits categories {categories}, kinds {kinds}, ids {ids}")


def _make(category: str, split: str, rng: np.random.Generator, kinds: tuple[str, ...], ids: tuple[str, ...],
          number: int) -> Made | None:
    on_table = {"none": 0.25, "pair": 0.2, "outside": 0.0}.get(category, 0.3)
    wanted: tuple[str, ...] = ()
    group: Any = None
    if category == "lookalike":
        group = _LOOKALIKES[int(rng.integers(len(_LOOKALIKES)))]
        wanted = (str(rng.choice(group[0])),)
        kind = group[1][0]
    elif category in ("single", "pair"):
        kind = "table" if rng.random() < on_table else "run"
        pool = [i for i, k in IDS.items() if (not ids or i in ids) and
                ("run" in k.seen if kind == "run" else any(s != "run" for s in k.seen))]
        if not pool:
            return None
        wanted = tuple(str(w) for w in rng.choice(pool, 1))
        if category == "pair":
            rest = [i for i, k in IDS.items() if i not in wanted and
                    ("run" in k.seen if kind == "run" else any(s != "run" for s in k.seen))]
            wanted = (*wanted, str(rng.choice(rest)))
        if kind == "table":
            kind = str(rng.choice([s for s in IDS[wanted[0]].seen if s != "run"]))
    else:
        kind = "table" if rng.random() < on_table else "run"
        if kind == "table":
            kind = str(rng.choice(["lag", "catch", "heads", "place", "weigh"]))
    if kinds and kind not in kinds:
        return None
    if any(i not in IDS for i in wanted) or (ids and wanted and not set(ids) & set(wanted)):
        return None
    if kind == "run":
        return _run_case(category, wanted, split, rng, group)
    return _table_case(category, wanted, kind, split, rng)


# -- runs ------------------------------------------------------------------------------------------------------------

def _physics(rng: np.random.Generator, refill: bool) -> Physics:
    """A machine within its tolerances."""
    p = Physics()
    p = p._replace(**{k: getattr(p, k) + sd * rng.normal() for k, sd in nom.TOLERANCE.items()})
    return p._replace(shaft_tau_s=max(0.015, p.shaft_tau_s),
                      heads_ratio=tuple(1 + nom.HEAD_TOLERANCE * rng.normal(size=nom.HEADS)),
                      level_kg=(float(rng.normal()), float(nom.LEVEL_TOLERANCE_KG[1] * rng.normal() * refill)))


def _effect(name: str, size: float, rng: np.random.Generator, plant: Plant) -> Effect:
    t = plant.drive.time_s
    onset = float(t[0] + rng.uniform(0.25, 0.75) * (t[-1] - t[0])) if name in _ONSETS else None
    member = int(rng.integers(1, 7)) if name in ("canopy.head_fouled", "flow.outlet_uneven") else None
    return Effect(name, size, int(rng.integers(0, 12)), float(rng.random()), onset, member, int(rng.integers(1 << 30)))


def _sized(eye: Eye, e: Effect, wanted_z: float, most: float, beside: tuple[Effect, ...] = ()) -> tuple[Effect, float] | None:
    """`e` with the size whose detectability is `wanted_z`; None where no allowed size reaches it."""
    sign = np.sign(e.size)
    size, z = abs(e.size), 0.0
    for _ in range(9):
        z = eye.z([e._replace(size=float(sign * size))], beside)
        if z > 0 and abs(np.log(z / wanted_z)) < 0.04:
            break
        factor = np.clip(wanted_z / z, 0.02, 50.0) if z > 1e-9 else 50.0
        size = min(size * factor, most)
    else:
        if abs(np.log(max(z, 1e-9) / wanted_z)) > 0.25:
            return None
    digits = 4 - int(np.floor(np.log10(size)))
    return e._replace(size=float(sign * round(size, digits))), z


def _hidden(eye: Eye, name: str, rng: np.random.Generator, plant: Plant, lowest_z: float = 2.0) -> tuple[Effect, float] | None:
    """An effect of detectability log-uniform from `lowest_z` to 40 (natural sizes where a threshold decides)."""
    kind = IDS[name]
    sign = kind.sign or int(rng.choice([-1, 1]))
    if kind.by_z:
        wanted = float(np.exp(rng.uniform(np.log(lowest_z), np.log(40.0))))
        return _sized(eye, _effect(name, sign * kind.guess, rng, plant), wanted, kind.most)
    e = _effect(name, float(rng.uniform(kind.guess, kind.most)), rng, plant)
    if name in ("shaft.stall", "gate.stuck"):                # the size is the onset
        e = e._replace(size=e.onset_s or 0.0)
    z = eye.z([e])
    return (e, z) if z > 2.0 else None


def _fits(name: str, p: Programme) -> bool:
    if name == "flow.batch":
        return p.refill
    if name in ("flow.fill_falloff", "shaft.dead_band"):
        return p.strategy != "opening_first"
    if name == "shaft.load_droop":
        return p.pattern in ("grid", "scatter")
    return True


def _run_case(category: str, wanted: tuple[str, ...], split: str, rng: np.random.Generator,
              group: Any) -> Made | None:
    pool = [p for p in chosen(split) if all(_fits(w, p) for w in wanted) and (group is None or group[2](p))]
    if not pool:
        return None
    p = pool[int(rng.integers(len(pool)))]
    d = drive(p, int(rng.integers(1 << 30)))
    plant, noise = Plant(d), str(rng.choice(run_noise.KINDS))
    noises = run_noise.noises(noise, d.row_s, rng)
    eye = Eye(plant, noises, Physics())
    physics = _physics(rng, bool(d.refill_kg))
    found: list[tuple[Effect, float]] = []
    outside = None
    if category == "outside":
        made = _outside(eye, rng, plant)
        if made is None:
            return None
        outside, planted = made[0], (made[1],)
    else:
        for name in wanted:
            made_one = _hidden(eye, name, rng, plant, 5.0 if category == "lookalike" else 2.0)
            if made_one is None:
                return None
            found.append(made_one)
        planted = tuple(e for e, _ in found)
    relations = [relation(eye, e, z, planted) for e, z in found]
    if category == "pair" and _pair_is_one(eye, planted):
        return None
    if category == "lookalike" and len(relations[0]["equal"]) + len(relations[0]["near"]) == 0:
        return None
    traits = _traits(eye, rng, plant)
    columns = runlog.columns(plant, physics, (*planted, *traits), noises, int(rng.integers(1 << 30)))
    span = {"shaft_high_rpm": float(d.shaft_rpm_cmd.max()), "opening_high_mm": float(d.opening_mm_cmd.max())}
    truth = {"programme": p.name, "noise": noise, "rows": int(d.time_s.size), "outside": outside,
             "causes": [_cause(e, z, r, span) for (e, z), r in zip(found, relations, strict=True)],
             "traits": [e._asdict() for e in traits], "physics": physics._asdict()}
    return "run", columns, truth, _share_of(planted, eye.trace, eye.inner)


def _cause(e: Effect, z: float, r: dict[str, Any], span: dict[str, float]) -> dict[str, Any]:
    """`size_defined`: the data reach the place where the catalogue defines the size, so its interval can be judged."""
    defined = {"flow.fill_falloff": span["shaft_high_rpm"] >= 85.0, "shaft.load_droop": span["opening_high_mm"] >= 50.0,
               "flow.hopper_head": e.form % 3 == 0, "shaft.stall": False, "gate.stuck": False}.get(e.id, True)
    return {"id": e.id, "size": e.size, "unit": IDS[e.id].unit, "onset_s": e.onset_s, "member": e.member,
            "form": e.form, "z": round(z, 3), "size_defined": bool(defined), **r}


def _traits(eye: Eye, rng: np.random.Generator, plant: Plant) -> tuple[Effect, ...]:
    """Two small peculiarities that no effect describes, each below what could be seen (z under 0.7)."""
    out = []
    for name in rng.choice(_TRAITS, 2, replace=False):
        e = Effect(str(name), 0.003, knob=float(rng.random()))
        z = eye.z([e])
        if z > 1e-6:
            out.append(e._replace(size=min(0.02, 0.003 * rng.uniform(0.2, 0.7) / z)))
    return tuple(out)


def _rivals(e: Effect, plant: Plant) -> Iterator[Effect]:
    """Other effects of the same part of the machine, in every form and sign that the catalogue allows."""
    refill_s = plant.refill_s or 0.0
    for name, kind in IDS.items():
        if "run" not in kind.seen or name == e.id or name in ("shaft.stall", "gate.stuck", "flow.bridging") or \
                not name.startswith(_GROUPS[e.id.split(".")[0]]) or not kind.by_z:
            continue
        onsets: tuple[float | None, ...] = (None,)
        if name == "flow.blocked_outlet":
            onsets = tuple(t for t in (e.onset_s, refill_s) if t is not None and t < 1e9)
        if name == "flow.batch" and refill_s > 1e9:
            continue
        forms = {"flow.fill_falloff": (0, 1, 2, 3), "flow.hopper_head": (0, 2), "speed.wheel_slip": (0,),
                 "shaft.load_droop": (0, 2)}.get(name, (0,))
        for onset in onsets:
            for form in forms:
                yield Effect(name, kind.guess, form, 0.5, onset, 1, 1)


def relation(eye: Eye, e: Effect, z: float, planted: tuple[Effect, ...]) -> dict[str, Any]:
    """Which other ids leave the same trace on this data (`equal`), which are too alike to be told apart (`near`)."""
    mine = eye.trace([e], [p for p in planted if p != e])
    equal: dict[str, float] = {}
    near: dict[str, float] = {}
    for r in _rivals(e, eye.plant):
        like = eye.likeness(mine, eye.trace([r]))
        if IDS[r.id].sign == 0:
            like = abs(like)
        if like > EQUAL:
            equal[r.id] = max(equal.get(r.id, 0.0), float(round(like, 4)))
        elif like > 0 and z * np.sqrt(1 - like * like) < SEPARABLE_Z and like > 0.5:
            near[r.id] = max(near.get(r.id, 0.0), float(round(like, 4)))
    return {"equal": equal, "near": {k: v for k, v in near.items() if k not in equal}}


def _pair_is_one(eye: Eye, planted: tuple[Effect, ...]) -> bool:
    """Two effects of which one hides the other are no honest pair."""
    a, b = eye.trace([planted[0]]), eye.trace([planted[1]])
    together = eye.trace(planted)
    left = abs(eye.likeness(a, b))
    rest = eye.inner(together, together)
    return left > 0.9 or rest < 0.2 * max(eye.inner(a, a), eye.inner(b, b))


def _outside(eye: Eye, rng: np.random.Generator, plant: Plant) -> tuple[dict[str, Any], Effect] | None:
    name = str(rng.choice(list(OUTSIDE)))
    channel, guess, variables = OUTSIDE[name]
    d = plant.drive
    e = Effect(name, guess * float(rng.choice([-1, 1])), int(rng.integers(12)), float(rng.random()))
    made = _sized(eye, e, float(np.exp(rng.uniform(np.log(6.0), np.log(40.0)))), 500 * guess)
    if made is None:
        return None
    e, z = made
    mine = eye.trace([e])
    stage = {"x.wheel": "speed", "x.gate": "gate", "x.shaft": "shaft"}.get(name.split("_")[0], "flow")
    likest = max((abs(eye.likeness(mine, eye.trace([r]))) for r in _rivals(Effect(f"{stage}.none", 0.0), plant)), default=0.0)
    if likest > 0.6:
        return None                                          # a catalogued effect would be a fair answer
    main = getattr(d, variables[0])
    alike = [n for n in ("pitch_deg", "roll_deg", "heading_deg", "supply_v", "time_s", "speed_mps")
             if n not in variables and abs(np.corrcoef(main, getattr(d, n))[0, 1]) > 0.9]
    return {"name": name, "channel": channel, "variables": [*variables, *alike], "z": round(z, 3), "size": e.size,
            "likest_catalogued": round(float(likest), 3)}, e


def _share_of(planted: tuple[Effect, ...], trace: Callable[[Sequence[Effect]], Floats],
              inner: Callable[[Floats, Floats], float]) -> Share:
    """Takes the named causes, as sized, off the data again: 1 - left / removable, in whitened squares."""

    def share(causes: Sequence[dict[str, Any]]) -> float | None:
        if not planted:
            return None
        named = []
        for c in causes:
            if c["id"] not in IDS or c["size"]["value"] is None:
                return None
            like = next((e for e in planted if e.id == c["id"]), Effect(c["id"], 0.0))
            onset = c["onset_s"] if c["onset_s"] is not None else c["size"]["value"] \
                if c["id"] in ("shaft.stall", "gate.stuck") else like.onset_s
            named.append(like._replace(size=float(c["size"]["value"]), onset_s=onset, member=c["member"] or like.member))
        there = trace(planted)
        left = there - trace(named)
        return 1.0 - inner(left, left) / inner(there, there)

    return share


# -- tables ----------------------------------------------------------------------------------------------------------

def _table_case(category: str, wanted: tuple[str, ...], kind: str, split: str,
                rng: np.random.Generator) -> Made | None:
    pool = [lay for lay in tables.LAYOUTS if lay.split in (split, "all") and lay.kind == kind and
            all(w in tables.shown(lay) for w in wanted)]
    if category == "lookalike" and kind == "place":
        pool = [lay for lay in pool if len(lay.others) == 1]
    if not pool:
        return None
    layout = pool[int(rng.integers(len(pool)))]
    table, noise = tables.Table(layout, rng), str(rng.choice(tables.KINDS))
    found: list[tuple[Effect, float]] = []
    for name in wanted:
        k = IDS[name]
        e = Effect(name, (k.sign or float(rng.choice([-1, 1]))) * k.guess, int(rng.integers(12)), float(rng.random()), None,
                   int(rng.integers(1, 7)) if name in ("canopy.head_fouled", "flow.outlet_uneven") else None)
        if not k.by_z:
            found.append((e._replace(size=float(np.round(rng.uniform(k.guess, k.most), 2))), 99.0))
            continue
        target = float(np.exp(rng.uniform(np.log(5.0 if category == "lookalike" else 2.0), np.log(40.0))))
        z = 0.0
        for _ in range(4):
            z = float(np.linalg.norm(table.trace([e])))
            if z < 1e-6:
                return None
            e = e._replace(size=float(np.clip(e.size * target / z, -k.most, k.most)))
        z = float(np.linalg.norm(table.trace([e])))
        if abs(np.log(z / target)) > 0.25:
            return None
        found.append((e._replace(size=float(f"{e.size:.4g}")), z))
    planted = [e for e, _ in found]
    if len(planted) == 2 and abs(_cosine(table.trace(planted[:1]), table.trace(planted[1:]))) > 0.9:
        return None
    causes = []
    for e, z in found:
        mine, equal, near = table.trace([e]), {}, {}
        for name in tables.shown(layout):
            if name == e.id or not IDS[name].by_z:
                continue
            sign = IDS[name].sign
            for size in ((1,) if sign else (1, -1)):
                for form in (0, 1, 2, 3):
                    r = Effect(name, size * IDS[name].guess, form, 0.5, None, e.member)
                    like = _cosine(mine, table.trace([r]))
                    if like > EQUAL:
                        equal[name] = max(equal.get(name, 0.0), round(like, 4))
                    elif like > 0.5 and z * np.sqrt(1 - like * like) < SEPARABLE_Z:
                        near[name] = max(near.get(name, 0.0), round(like, 4))
        if kind == "weigh" and e.size < 0:
            equal["speed.missed_pulses"] = 1.0
        span = {"shaft_high_rpm": max(layout.values, default=0.0), "opening_high_mm": 60.0}
        causes.append(_cause(e, z, {"equal": equal, "near": {k: v for k, v in near.items() if k not in equal}}, span))
    if category == "lookalike" and not causes[0]["equal"] and not causes[0]["near"]:
        return None
    columns = table.observed(planted, noise, rng)
    return kind, columns, {"programme": layout.name, "noise": noise, "rows": int(table.sd.shape[1]), "outside": None,
                           "causes": causes, "traits": [], "physics": {}}, \
        _share_of(tuple(planted), table.trace, lambda a, b: float(a @ b))


def _cosine(a: Floats, b: Floats) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 1e-9 else 0.0
