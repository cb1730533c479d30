"""Bench tables with something hidden in them."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import tables
from .nominal import IDS, OUTSIDE_TABLES, Effect
from .truth import Floats, Made, Relations, share_of, told

# share of an outside trace's length that the whole catalogue must leave
OUTSIDE_LEFT = 0.5
SIDED = ("lag.offset", "shaft.dead_time")
MEMBERED = ("canopy.head_fouled", "flow.outlet_uneven")


def table_case(
    category: str,
    wanted: tuple[str, ...],
    kind: str,
    split: str,
    rng: np.random.Generator,
    outsiders: tuple[str, ...] = (),
) -> Made | None:
    """`outsiders`: of the category outside, only these (empty: any). None where the draw does
    not work out."""
    pool = [
        lay
        for lay in tables.LAYOUTS
        if lay.split in (split, "all")
        and lay.kind == kind
        and all(w in tables.shown(lay) for w in wanted)
    ]
    if category == "outside":
        return _outside(
            pool, rng, [n for n in OUTSIDE_TABLES if n in outsiders] or list(OUTSIDE_TABLES)
        )
    if category == "lookalike" and kind == "place":
        pool = [lay for lay in pool if len(lay.others) == 1]
    if not pool:
        return None
    layout = pool[int(rng.integers(len(pool)))]
    table, noise = tables.Table(layout, rng), str(rng.choice(tables.KINDS))
    found: list[tuple[Effect, float]] = []
    # a clock first: the others show less beside it
    for name in sorted(wanted, key=lambda i: IDS[i].by_z):
        hidden = _hidden(table, name, 5.0 if category == "lookalike" else 2.0, rng)
        if hidden is None:
            return None
        found.append(hidden)
    planted = [e for e, _ in found]
    if len(planted) == 2 and abs(_cosine(table.trace(planted[:1]), table.trace(planted[1:]))) > 0.9:
        return None
    causes = []
    for e, z in found:
        span = {"shaft_high_rpm": max(layout.values, default=0.0), "opening_high_mm": 60.0}
        cause = told(e, z, _relations(table, e, z), span)
        if kind == "weigh" or (
            len(planted) == 2 and e.id in SIDED and any(p.id == "lag.asymmetry" for p in planted)
        ):
            # depends on an opening, or on which side is called nominal
            cause["size_defined"] = False
        causes.append(cause)
    if category == "lookalike" and not causes[0]["equal"] and not causes[0]["near"]:
        return None
    columns = table.observed(planted, noise, rng)
    return (
        kind,
        columns,
        {
            "programme": layout.name,
            "noise": noise,
            "rows": int(table.sd.shape[1]),
            "outside": None,
            "causes": causes,
            "traits": [],
            "physics": {},
        },
        share_of(tuple(planted), table.trace, lambda a, b: float(a @ b)),
        None,
    )


def _hidden(
    table: tables.Table, name: str, least_z: float, rng: np.random.Generator
) -> tuple[Effect, float] | None:
    """The effect with a size that makes its z log-uniform from `least_z` to 40; None where no
    size does.

    A coarse clock is set in the table, with a natural size.
    """
    k = IDS[name]
    sign = k.sign or float(rng.choice([-1, 1]))
    member = int(rng.integers(1, 7)) if name in MEMBERED else None
    e = Effect(name, sign * k.guess, int(rng.integers(12)), float(rng.random()), None, member)
    if not k.by_z:
        table.clock_s = float(np.round(rng.uniform(k.guess, k.most), 2))
        return e._replace(size=table.clock_s), 99.0
    target = float(np.exp(rng.uniform(np.log(least_z), np.log(40.0))))
    for _ in range(4):
        z = float(np.linalg.norm(table.trace([e])))
        if z < 1e-6:
            return None
        e = e._replace(size=float(np.clip(e.size * target / z, -k.most, k.most)))
    z = float(np.linalg.norm(table.trace([e])))
    if abs(np.log(z / target)) > 0.25:
        return None
    return e._replace(size=float(f"{e.size:.4g}")), z


def _outside(pool: list[tables.Layout], rng: np.random.Generator, names: list[str]) -> Made | None:
    """A table with something that no effect of the catalogue describes, alone or with others.

    Its z, of what the whole catalogue leaves, is log-uniform from 6 to 40."""
    name = str(rng.choice(names))
    kind, variants, guess, variables = OUTSIDE_TABLES[name]
    pool = [
        lay for lay in pool if lay.kind == kind and lay.variant in variants and _varies(name, lay)
    ]
    if not pool:
        return None
    layout = pool[int(rng.integers(len(pool)))]
    table, noise = tables.Table(layout, rng), str(rng.choice(tables.KINDS))
    e = Effect(name, guess * float(rng.choice([-1, 1])), int(rng.integers(12)), float(rng.random()))
    mine = table.trace([e])
    known = np.array([table.trace([r]) for r in _catalogued(table)]).T
    left = float(np.linalg.norm(mine - known @ np.linalg.lstsq(known, mine, rcond=1e-8)[0]))
    share = left / max(1e-9, float(np.linalg.norm(mine)))
    if share < OUTSIDE_LEFT:
        return None  # effects of the catalogue would be a fair answer
    z = float(np.exp(rng.uniform(np.log(6.0), np.log(40.0))))
    e = e._replace(size=float(f"{e.size * z / left:.4g}"))
    return (
        kind,
        table.observed([e], noise, rng),
        {
            "programme": layout.name,
            "noise": noise,
            "rows": int(table.sd.shape[1]),
            "causes": [],
            "traits": [],
            "physics": {},
            "outside": {
                "name": name,
                "channel": {"catch": "flow"}.get(kind, kind),
                "variables": list(variables),
                "z": round(z, 3),
                "size": e.size,
                "likest_catalogued": round(float(np.sqrt(max(0.0, 1 - share**2))), 3),
            },
        },
        share_of((), table.trace, lambda a, b: float(a @ b)),
        None,
    )


def _varies(name: str, layout: tables.Layout) -> bool:
    """The layout varies what the effect depends on, often enough to show its shape."""
    if name.endswith(("tiring", "packing")):
        return layout.replicates > 1
    return {"x.heads_swing": len(layout.others) > 1, "x.lag_hump": len(layout.values) > 4}.get(
        name, True
    )


def _catalogued(table: tables.Table) -> list[Effect]:
    """Every effect that the table can show, once (two forms of one effect together can imitate
    anything)."""
    return [
        Effect(i, IDS[i].guess, 0, 0.5, None, member)
        for i in tables.shown(table.layout)
        if IDS[i].by_z
        for member in (range(1, 7) if i in MEMBERED else (None,))
    ]


def _relations(table: tables.Table, e: Effect, z: float) -> dict[str, Any]:
    """As for runs: which ids the table cannot, or hardly, tell from `e`."""
    mine, found = table.trace([e]), Relations(z)
    for name in tables.shown(table.layout):
        if name == e.id or not IDS[name].by_z:
            continue
        for sign in (1, -1) if IDS[name].sign == 0 else (1,):
            for form in (0, 1, 2, 3):
                rival = Effect(name, sign * IDS[name].guess, form, 0.5, None, e.member)
                found.add(name, _cosine(mine, table.trace([rival])))
    if table.layout.kind == "weigh" and e.size < 0:
        found.add("speed.missed_pulses", 1.0)
    return found.told()


def _cosine(a: Floats, b: Floats) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 1e-9 else 0.0
