"""Which cheap run would tell rivals apart: each manoeuvre is played through the model with each rival, and compared."""
from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.diagnosis.judgement.evidence import projected
from control.diagnosis.levels import opening_levels, shaft_levels
from control.diagnosis.result import Cause, NextRun
from control.machine.effect import HOPPER
from control.machine.machine import CATALOGUE, Machine, of_nominal

from .channels import channels
from .hypothesis import EffectInstance
from .log import gate
from .model import GROUPS
from .search import Search
from .stages import run_data

Array = npt.NDArray[np.float64]

STEP_S = 0.5                # of the logs that manoeuvres are played into
IDLING_SHARE = 1.2 / 13.5    # of the supply, lost while the engine idles
BEGIN_KG, FILL_KG = 260.0, 150.0     # in the hopper, and filled up, on the nominal machine
MIN_SEPARATION_SD = 3.0     # of an effect, once its rival is fitted: from there on a run tells them apart


class Manoeuvre(NamedTuple):
    """A short run that costs little. plan : for people; id, minutes and steps : for programs."""

    id: str
    plan: str
    minutes: float
    steps: tuple[str, ...]
    columns: dict[str, npt.NDArray[Any]]


def manoeuvres(machine: Machine) -> list[Manoeuvre]:
    """What an operator can do in ten to twenty minutes, as the columns of a run log without noise."""
    ten = np.arange(0.0, 600.0, STEP_S)
    twenty = np.arange(0.0, 1200.0, STEP_S)
    rpm, opening = machine.set_points.shaft_rpm, machine.set_points.opening_mm
    speeds, widths = shaft_levels(machine), opening_levels(machine)
    level = (np.floor(ten / 60.0) % 4).astype(int)
    stairs, openings = np.array(speeds)[level], np.array(widths)[level]
    halves = np.where(np.floor(ten / 60.0) % 2 < 1, 1.0, 0.0)
    slope = np.where(np.floor(ten / 120.0) % 2 < 1, 4.0, -4.0)
    filled = np.where(twenty >= 600.0, 1.0, 0.0)
    _log = partial(_run, machine)
    return [
        Manoeuvre("stairs", f"Shaft staircase: {_listed(speeds)} r/min for a minute each at one opening, twice.", 10.0,
                  _held_for("r/min", speeds, 60) * 2, _log(ten, stairs, opening)),
        Manoeuvre("openings", f"Opening staircase: {_listed(widths)} mm for a minute each at one shaft speed, twice.",
                  10.0, _held_for("mm", widths, 60) * 2, _log(ten, rpm, openings)),
        Manoeuvre("slope", "Out and back on a slope, two minutes each way, twice.", 10.0,
                  ("uphill for 120 s", "downhill for 120 s") * 2, _log(ten, rpm, opening, pitch=slope)),
        Manoeuvre("two_speeds", "Two ground speeds: 3 and 6 km/h in turn, two minutes each.", 10.0,
                  _held_for("km/h", (3, 6, 3, 6, 3), 120),
                  _log(ten, rpm, opening, speed=np.where(np.floor(ten / 120.0) % 2 < 1, 0.83, 1.67))),
        Manoeuvre("out_of_work", "Drive on with the shaft stopped every second minute.", 10.0,
                  ("work for 60 s", "shaft stopped for 60 s") * 5, _log(ten, rpm * halves, opening)),
        Manoeuvre("standing", "Stand still with the shaft stopped for ten minutes and watch the scale.", 10.0,
                  ("stand with the shaft stopped for 600 s",), _log(ten, 0.0, opening, speed=0.0 * ten)),
        Manoeuvre("refill", "Work for ten minutes, fill up with weighed bags and write the kg down, work for ten more.",
                  20.0, ("work for 600 s", "fill up, kg written down", "work for 600 s"),
                  _log(twenty, rpm, opening, refill=of_nominal(machine, HOPPER) * FILL_KG * filled)),
    ]


def _held_for(unit: str, values: Sequence[float], seconds: int) -> tuple[str, ...]:
    return tuple(f"{value:g} {unit} for {seconds} s" for value in values)


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _run(machine: Machine, time: Array, rpm: Array | float, opening: Array | float, pitch: Array | float = 0.0,
         speed: Array | float = 1.25, refill: Array | float = 0.0) -> dict[str, npt.NDArray[Any]]:
    n = np.ones(len(time))
    turns, wide, kg_rev_mm = rpm * n, opening * n, machine.flow.grams_per_rev_mm / 1000.0
    events = np.full(len(time), "", object)
    events[np.flatnonzero(np.diff(refill * n) > 0.0) + 1] = f"refill {np.max(refill * n):g}"
    used = np.concatenate(([0.0], np.cumsum(kg_rev_mm * turns * wide / 60.0)[:-1])) * STEP_S
    return {"time_s": time, "shaft_rpm_cmd": turns, "shaft_rpm": turns + 1e-4 * np.sin(time), "opening_mm_cmd": wide,
            "opening_mm": wide + 1e-4 * np.sin(time),
            "hopper_kg": of_nominal(machine, HOPPER) * BEGIN_KG - used + refill * n + 1e-3 * np.sin(7.0 * time),
            "pitch_deg": pitch * n, "speed_mps": speed * n + 1e-4 * np.sin(5.0 * time),
            "wheel_speed_mps": speed * n + 1e-4 * np.sin(3.0 * time),
            "supply_v": _volts(time, machine.shaft.nominal_supply_v), "events": events}


def _volts(time: Array, nominal_v: float) -> Array:
    """Engine at rated speed and idling in turn."""
    return np.where(np.floor(time / 90.0) % 2 < 1, nominal_v, nominal_v - IDLING_SHARE * nominal_v)


def next_run(causes: Sequence[Cause], machine: Machine) -> NextRun | None:
    """The shortest manoeuvre that separates the worst pair of rivals; the effect's own experiment where none does."""
    doubtful = [c for c in causes if c.rivals]
    if not doubtful:
        return None
    cause = max(doubtful, key=lambda c: c.rivals[0].probability)
    rival = cause.rivals[0].id
    value = cause.size.value or ROWS[cause.id].probe or 1.0
    best: tuple[float, Manoeuvre] | None = None
    for manoeuvre in manoeuvres(machine):
        z = separation(manoeuvre, machine, EffectInstance(cause.id, value, None, cause.member), rival)
        score = z / manoeuvre.minutes ** 0.5
        if z >= MIN_SEPARATION_SD and (best is None or score > best[0]):
            best = (score, manoeuvre)
    why = f"this data cannot tell {cause.id} from {', '.join(r.id for r in cause.rivals)}"
    if best is None:
        return NextRun(why, CATALOGUE[cause.id].effect.separate)
    run = best[1]
    return NextRun(why, run.plan, run.id, run.minutes, run.steps)


def separation(manoeuvre: Manoeuvre, machine: Machine, part: EffectInstance, rival_id: str) -> float:
    """What is left of an effect's trace, in standard deviations, once its rival is fitted to the manoeuvre's log."""
    log = gate(manoeuvre.columns)
    data = run_data(log, machine)
    seen = channels(data, machine)
    names = next(names for names in GROUPS.values() if ROWS[part.id].channels[0] in names)
    members = [seen[n] for n in names if n in seen]
    if not members:
        return 0.0
    search = Search(members, machine, data)
    wanted = [c for c in search.candidates if c.part.id in (part.id, rival_id)]
    if {c.part.id for c in wanted} != {part.id, rival_id}:
        return 0.0
    own = min((c for c in wanted if c.part.id == part.id), key=lambda c: abs(c.part.size - part.size))
    other = next(c for c in wanted if c.part.id == rival_id)
    p, before = search.columns.compressed((), [search.columns.of_candidate((), c.part) for c in (other, own)])
    normal, _ = projected(p, np.arange(before + 1), search.model.noise)
    return float(abs(part.size) * np.sqrt(max(0.0, normal[-1, -1])))
