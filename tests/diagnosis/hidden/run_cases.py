"""Run logs with something hidden in them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from . import noise as run_noise
from . import nominal as nom
from . import runlog
from .detect import READINGS, Eye
from .nominal import IDS, OUTSIDE, Effect, Physics
from .plant import Plant
from .programmes import Drive, Programme, chosen, drive
from .truth import Changed, Made, Redrive, Relations, share_of, told

_GROUPS = {
    "shaft": ("shaft.",),
    "gate": ("gate.", "flow.", "scale."),
    "flow": ("gate.", "flow.", "scale."),
    "scale": ("gate.", "flow.", "scale."),
    "speed": ("speed.",),
    "canopy": ("canopy.",),
}
_ONSETS = ("shaft.stall", "gate.stuck", "flow.blocked_outlet")
LEAST_KG = 2.0
_TRAITS = (
    "t.gate_bow",
    "t.shaft_tau",
    "t.shaft_ripple",
    "t.shaft_sensor",
    "t.flow_wave",
    "t.wheel_wobble",
)


def within_tolerance(rng: np.random.Generator, refill: bool) -> Physics:
    """A machine within its tolerances."""
    p = Physics()
    p = p._replace(**{k: getattr(p, k) + sd * rng.normal() for k, sd in nom.TOLERANCE.items()})
    return p._replace(
        shaft_tau_s=max(0.015, p.shaft_tau_s),
        heads_ratio=tuple(1 + nom.HEAD_TOLERANCE * rng.normal(size=nom.HEADS)),
        level_kg=(float(rng.normal()), float(nom.LEVEL_TOLERANCE_KG[1] * rng.normal() * refill)),
    )


def effect_of(name: str, size: float, rng: np.random.Generator, plant: Plant) -> Effect:
    t = plant.drive.time_s
    onset = float(t[0] + rng.uniform(0.25, 0.75) * (t[-1] - t[0])) if name in _ONSETS else None
    member = (
        int(rng.integers(1, 7)) if name in ("canopy.head_fouled", "flow.outlet_uneven") else None
    )
    return Effect(
        name,
        size,
        int(rng.integers(0, 12)),
        float(rng.random()),
        onset,
        member,
        int(rng.integers(1 << 30)),
    )


def sized(
    eye: Eye, e: Effect, wanted_z: float, most: float, beside: tuple[Effect, ...] = ()
) -> tuple[Effect, float] | None:
    """`e` with the size whose detectability is `wanted_z`; None where no allowed size reaches
    it."""
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


class Planted(NamedTuple):
    """What a case hides: `outside` as its truth tells it, or effects of the catalogue, `found`
    with their z."""

    outside: dict[str, Any] | None
    effects: tuple[Effect, ...]
    found: list[tuple[Effect, float]]


def _hidden(
    eye: Eye, name: str, rng: np.random.Generator, plant: Plant, lowest_z: float = 2.0
) -> tuple[Effect, float] | None:
    """An effect of detectability log-uniform from `lowest_z` to 40 (natural sizes where a
    threshold decides)."""
    kind = IDS[name]
    sign = kind.sign or int(rng.choice([-1, 1]))
    if kind.by_z:
        wanted = float(np.exp(rng.uniform(np.log(lowest_z), np.log(40.0))))
        return sized(eye, effect_of(name, sign * kind.guess, rng, plant), wanted, kind.most)
    e = effect_of(name, float(rng.uniform(kind.guess, kind.most)), rng, plant)
    if name in ("shaft.stall", "gate.stuck"):  # the size is the onset
        e = e._replace(size=e.onset_s or 0.0)
    z = eye.z([e])
    return (e, z) if z > 2.0 else None


def fits(name: str, p: Programme) -> bool:
    if name == "flow.batch":
        return p.refill
    if name in ("flow.fill_falloff", "shaft.dead_band"):
        return p.strategy != "opening_first"
    if name == "shaft.load_droop":
        return p.pattern in ("grid", "scatter")
    return True


def run_case(
    category: str,
    wanted: tuple[str, ...],
    split: str,
    rng: np.random.Generator,
    suits: Callable[[Programme], bool],
    outsiders: tuple[str, ...] = (),
    minutes: tuple[float, float] | None = None,
) -> Made | None:
    """`outsiders`: of the category outside, only these (empty: any). None where the draw does
    not work out."""
    pool = [p for p in chosen(split) if all(fits(w, p) for w in wanted) and suits(p)]
    if not pool:
        return None
    p = pool[int(rng.integers(len(pool)))]
    d = drive(p._replace(minutes=minutes or p.minutes), int(rng.integers(1 << 30)))
    plant, noise = Plant(d), str(rng.choice(run_noise.KINDS))
    noises = run_noise.noises(noise, d.row_s, rng)
    eye = Eye(plant, noises, Physics())
    physics = within_tolerance(rng, bool(d.refill_kg))
    hidden = _planted(category, eye, wanted, outsiders, rng, plant)
    if hidden is None:
        return None
    outside, planted, found = hidden
    relations = [relation(eye, e, z, planted) for e, z in found]
    if category == "pair" and together(eye, planted):
        return None
    if category == "lookalike" and len(relations[0]["equal"]) + len(relations[0]["near"]) == 0:
        return None
    traits = traits_of(eye, rng, plant)
    log_seed = int(rng.integers(1 << 30))
    columns = runlog.columns(plant, physics, (*planted, *traits), noises, log_seed)
    if np.nanmin(columns["hopper_kg"]) < LEAST_KG:
        return None  # stuck wide open it would have run empty
    truth = {
        "programme": p.name,
        "noise": noise,
        "rows": int(d.time_s.size),
        "outside": outside,
        "causes": [told(e, z, r, span_of(d)) for (e, z), r in zip(found, relations, strict=True)],
        "traits": [plain(e) for e in traits],
        "physics": physics._asdict(),
    }

    def redriven(change: Callable[[Drive], Drive], other_seed: int | None) -> Redrive:
        other = Plant(change(d))
        seen = Eye(other, noises, Physics())
        causes = []
        for e, _ in found:
            z = seen.z([e], [q for q in planted if q != e])
            causes.append(told(e, z, relation(seen, e, z, planted), span_of(other.drive)))
        return Redrive(
            runlog.columns(
                other,
                physics,
                (*planted, *traits),
                noises,
                log_seed if other_seed is None else other_seed,
            ),
            {**truth, "rows": int(other.drive.time_s.size), "causes": causes},
            lambda: changed_by(other, physics, planted, traits),
        )

    return "run", columns, truth, share_of(planted, eye.trace, eye.inner), redriven


def changed_by(
    plant: Plant, physics: Physics, hidden: tuple[Effect, ...], traits: tuple[Effect, ...]
) -> Changed:
    """What `hidden`, and what its tolerances and traits, change in the readings of a machine."""
    with_it, without = plant.run(physics, (*hidden, *traits)), plant.run(physics, traits)
    nominal = plant.run(Physics())
    # shaft and gate as they are
    metered = plant.run(physics._replace(flow_ratio=1.0, level_kg=Physics().level_kg))
    base = {**nominal, "scale": metered["scale"]}
    return Changed(
        {name: with_it[name] - without[name] for name in READINGS},
        {name: without[name] - base[name] for name in READINGS},
    )


def _planted(
    category: str,
    eye: Eye,
    wanted: tuple[str, ...],
    outsiders: tuple[str, ...],
    rng: np.random.Generator,
    plant: Plant,
) -> Planted | None:
    """None where one does not work out."""
    if category == "outside":
        made = _outside(eye, rng, plant, [n for n in OUTSIDE if n in outsiders] or list(OUTSIDE))
        return None if made is None else Planted(made[0], (made[1],), [])
    found = []
    for name in wanted:
        one = _hidden(eye, name, rng, plant, 5.0 if category == "lookalike" else 2.0)
        if one is None:
            return None
        found.append(one)
    return Planted(None, tuple(e for e, _ in found), found)


def plain(e: Effect) -> dict[str, Any]:
    return {k: v for k, v in e._asdict().items() if k not in ("course", "term")}


def span_of(d: Drive) -> dict[str, float]:
    return {
        "shaft_high_rpm": float(d.shaft_rpm_cmd.max()),
        "opening_high_mm": float(d.opening_mm_cmd.max()),
    }


def traits_of(eye: Eye, rng: np.random.Generator, plant: Plant) -> tuple[Effect, ...]:
    """Two small peculiarities that no effect describes, each below what could be seen (z under
    0.7)."""
    out = []
    for name in rng.choice(_TRAITS, 2, replace=False):
        e = Effect(str(name), 0.003, knob=float(rng.random()))
        z = eye.z([e])
        if z > 1e-6:
            out.append(e._replace(size=min(0.02, 0.003 * rng.uniform(0.2, 0.7) / z)))
    return tuple(out)


def rivals_of(e: Effect, plant: Plant) -> Iterator[Effect]:
    """Other effects of the same part of the machine, in every form and sign that the catalogue
    allows."""
    refill_s = plant.refill_s
    for name, kind in IDS.items():
        if (
            "run" not in kind.seen
            or name == e.id
            or name in ("shaft.stall", "gate.stuck", "flow.bridging")
            or not name.startswith(_GROUPS[e.id.split(".")[0]])
            or not kind.by_z
        ):
            continue
        onsets: tuple[float | None, ...] = (None,)
        if name == "flow.blocked_outlet":
            onsets = tuple(t for t in (e.onset_s, refill_s) if t is not None and t < 1e9)
        if name == "flow.batch" and refill_s > 1e9:
            continue
        forms = {
            "flow.fill_falloff": (0, 1, 2, 3),
            "flow.hopper_head": (0, 2),
            "speed.wheel_slip": (0,),
            "shaft.load_droop": (0, 2),
        }.get(name, (0,))
        for onset in onsets:
            for form in forms:
                yield Effect(name, kind.guess, form, 0.5, onset, 1, 1)


def relation(
    eye: Eye,
    e: Effect,
    z: float,
    planted: tuple[Effect, ...],
    rivals: Iterable[Effect] | None = None,
) -> dict[str, Any]:
    """Which other ids leave the same trace on this data (`equal`), which are too alike to be
    told apart (`near`)."""
    mine = eye.trace([e], [p for p in planted if p != e])
    found = Relations(z)
    for r in rivals_of(e, eye.plant) if rivals is None else rivals:
        like = eye.likeness(mine, eye.trace([r]))
        found.add(r.id, abs(like) if IDS[r.id].sign == 0 else like)
    return found.told()


def together(eye: Eye, planted: tuple[Effect, ...]) -> bool:
    """Two effects of which one hides the other are no honest pair."""
    a, b = eye.trace([planted[0]]), eye.trace([planted[1]])
    together = eye.trace(planted)
    left = abs(eye.likeness(a, b))
    rest = eye.inner(together, together)
    return left > 0.9 or rest < 0.2 * max(eye.inner(a, a), eye.inner(b, b))


def _outside(
    eye: Eye, rng: np.random.Generator, plant: Plant, names: list[str]
) -> tuple[dict[str, Any], Effect] | None:
    name = str(rng.choice(names))
    channel, guess, variables = OUTSIDE[name]
    d = plant.drive
    e = Effect(name, guess * float(rng.choice([-1, 1])), int(rng.integers(12)), float(rng.random()))
    made = sized(eye, e, float(np.exp(rng.uniform(np.log(6.0), np.log(40.0)))), 500 * guess)
    if made is None:
        return None
    e, z = made
    mine = eye.trace([e])
    stage = {"x.wheel": "speed", "x.gate": "gate", "x.shaft": "shaft"}.get(
        name.split("_")[0], "flow"
    )
    rivals = rivals_of(Effect(f"{stage}.none", 0.0), plant)
    likest = max((abs(eye.likeness(mine, eye.trace([r]))) for r in rivals), default=0.0)
    if likest > 0.6:
        return None  # a catalogued effect would be a fair answer
    main = getattr(d, variables[0])
    alike = [
        n
        for n in ("pitch_deg", "roll_deg", "heading_deg", "supply_v", "time_s", "speed_mps")
        if n not in variables and abs(np.corrcoef(main, getattr(d, n))[0, 1]) > 0.9
    ]
    return {
        "name": name,
        "channel": channel,
        "variables": [*variables, *alike],
        "z": round(z, 3),
        "size": e.size,
        "likest_catalogued": round(float(likest), 3),
    }, e
