"""What effects and tolerated errors of the nominal values do to each channel, by running the machine model."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS, FoundBy
from control.machine.machine import CATALOGUE, Machine

from .hypothesis import Part

Array = npt.NDArray[np.float64]


class Nuisance(NamedTuple):
    """A nominal value that may be off within its tolerance."""

    key: str
    stage: str
    field: str
    step: float
    sd: float


FORM_CHANNEL: dict[str, str] = {"shaft": "shaft", "gate": "gate", "flow": "scale", "scale": "scale", "speed": "speed"}

GROUPS: dict[str, tuple[str, ...]] = {       # channels that share an effect are judged together
    "shaft": ("shaft",), "metering": ("gate", "scale"), "speed": ("speed",), "heads": ("heads",),
}


GNSS_STAMP_SHARE = 0.25     # of a row: the speed in a row was read at some time within it


def stamp_sd_s(machine: Machine, step_s: float) -> float:
    """How well the time of a GNSS reading is known (1 s.d.), in a log with rows of `step_s`."""
    return float(np.hypot(machine.tolerance.dead_time_s, GNSS_STAMP_SHARE * step_s))


def nuisances(channel: str, machine: Machine) -> tuple[Nuisance, ...]:
    """Tolerances of the machine file that bear on a channel."""
    t = machine.tolerance
    if channel == "shaft":
        return (Nuisance("shaft ratio", "shaft", "gain_percent", 0.1, t.shaft_percent),
                Nuisance("shaft dead time", "shaft", "dead_time_s", 0.01, t.dead_time_s),
                Nuisance("shaft time constant", "shaft", "time_constant_s", 0.01, t.time_constant_s))
    if channel == "gate":
        return (Nuisance("gate dead time", "gate", "dead_time_s", 0.01, t.dead_time_s),
                Nuisance("gate slew", "gate", "slew_mm_s", 0.5, machine.gate.slew_mm_s * t.gate_slew_percent / 100.0),
                Nuisance("gate position", "gate", "home_error_mm", 0.05, t.opening_mm))
    if channel == "scale":
        return (Nuisance("flow factor", "flow", "gain_percent", 0.5, t.flow_percent),
                Nuisance("opening zero", "flow", "zero_offset_g_rev", 0.5,
                         t.opening_mm * machine.flow.grams_per_rev_mm))
    if channel == "speed":
        return (Nuisance("wheel factor", "speed", "radius_percent", 0.2, t.wheel_percent),)
    return ()


def tolerance_of(effect_id: str, machine: Machine) -> float:
    """Tolerance (1 s.d.) of the nominal value that an effect moves, in the unit of its size; 0 where it moves none."""
    row = ROWS[effect_id]
    return sum(n.sd for n in nuisances(row.stage, machine) if n.field == row.moves)


class Candidate(NamedTuple):
    """An effect as it is tried: what is added, and between which sizes its amplitude is believed."""

    part: Part
    low: float
    high: float

    @property
    def key(self) -> str:
        p = self.part
        return f"{p.id}={p.size:g}@{p.onset_s or 0:g}#{p.member or 0}"


def candidates(channel_names: tuple[str, ...], heads: int, refilled: bool) -> list[Candidate]:
    """Effects that a run log with these channels can show, onsets of their own left to `onset`."""
    found: list[Candidate] = []
    for effect_id, entry in CATALOGUE.items():
        if not any(kind.startswith("run") and kind != "run with revisited ground" for kind in entry.effect.seen_in):
            continue
        row = ROWS[effect_id]
        if row.found_by not in (FoundBy.SCAN, FoundBy.DIPS) or not row.channels or row.channels[0] not in channel_names:
            continue
        if row.needs_refill and not refilled:
            continue
        low, high = entry.low - entry.neutral, entry.high - entry.neutral
        probe = entry.effect.probes[0] if row.probe is None else row.probe
        if row.ladder:
            for size in row.ladder:
                near = (size * 0.5, size * 1.9) if size > 0 else (size * 1.9, size * 0.3)
                found.append(Candidate(Part(effect_id, size), max(low, near[0]), min(high, near[1])))
        elif entry.effect.member_field:
            found += [Candidate(Part(effect_id, probe, None, k + 1), low, high) for k in range(heads)]
        else:
            found.append(Candidate(Part(effect_id, probe), low, high))
    return found
