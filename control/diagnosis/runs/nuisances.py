"""What effects and tolerated errors of the nominal values do to each channel, by running the machine model."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

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


# Sizes tried for effects whose influence is not a straight line in their size.
LADDERS: dict[str, tuple[float, ...]] = {
    "shaft.slow": (0.03, 0.1, 0.3, 0.8),
    "shaft.dead_time": (0.03, 0.1, 0.25, 0.6),
    "shaft.dead_band": (11.0, 13.0, 16.0, 20.0, 25.0, 31.0, 40.0),
    "gate.backlash": (0.02, 0.06, 0.15, 0.4, 1.0, 2.5),
    "gate.slow": (1.5, 5.0, 10.0, 15.0),
    "speed.gnss_latency": (0.1, 0.3, 0.8),
}
THRESHOLDS = frozenset({"shaft.dead_band"})          # no slope at all: refined on a grid

# Straight-line effects: the size at which the slope is taken.
PROBES: dict[str, float] = {
    "shaft.gain": 0.5, "shaft.voltage_sag": 0.5, "shaft.load_droop": 1.0, "gate.offset": 0.1, "gate.home_error": 0.1,
    "gate.lost_steps": 0.02, "flow.gain": 1.0, "flow.zero_offset": 1.0, "flow.fill_falloff": 1.0,
    "flow.hopper_head": 1.0, "flow.moisture_drift": 1.0, "flow.batch": 1.0, "flow.leak": 1.0, "flow.slope": 0.2,
    "flow.blocked_outlet": 2.0, "scale.gain": 0.2, "scale.drift": 0.5, "scale.tilt": 0.05, "speed.wheel_slip": 0.5,
    "speed.wheel_radius": 0.5, "speed.missed_pulses": 0.5, "canopy.head_fouled": 1.0,
}

# The recorded variable in which an effect's form is a matter of taste.
FORM_OVER: dict[str, str] = {
    "shaft.voltage_sag": "supply_v", "shaft.load_droop": "opening_mm", "shaft.gain": "shaft_rpm",
    "gate.home_error": "opening_mm", "gate.offset": "opening_mm", "flow.fill_falloff": "shaft_rpm",
    "flow.hopper_head": "hopper_kg", "flow.moisture_drift": "time_s", "flow.slope": "pitch_deg",
    "flow.zero_offset": "opening_mm", "scale.drift": "time_s", "scale.tilt": "pitch_deg",
    "speed.wheel_slip": "pitch_deg",
}
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


# Effects that move a nominal value itself: what its tolerance leaves open, their sizes leave open too. Where a row is
# longer than the tolerance the two have kinks at different places, and no slope says so.
SAME_VALUE = {"shaft.dead_time": "shaft dead time", "shaft.slow": "shaft time constant", "gate.slow": "gate slew"}


def tolerance_of(effect_id: str, machine: Machine) -> float:
    """Tolerance (1 s.d.) of the nominal value that an effect moves, in the unit of its size; 0 where it moves none."""
    stage = effect_id.split(".")[0]
    return sum(n.sd for n in nuisances(stage, machine) if n.key == SAME_VALUE.get(effect_id))


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
        if entry.effect.onset_only or effect_id in ("flow.bridging", "shaft.coarse_encoder", "flow.blocked_outlet"):
            continue
        if _channel_of(effect_id) not in channel_names:
            continue
        if effect_id == "flow.batch" and not refilled:
            continue
        low, high = entry.low - entry.neutral, entry.high - entry.neutral
        if effect_id in LADDERS:
            for size in LADDERS[effect_id]:
                near = (size * 0.5, size * 1.9) if size > 0 else (size * 1.9, size * 0.3)
                found.append(Candidate(Part(effect_id, size), max(low, near[0]), min(high, near[1])))
        elif entry.effect.member_field:
            found += [Candidate(Part(effect_id, PROBES[effect_id], None, k + 1), low, high) for k in range(heads)]
        else:
            found.append(Candidate(Part(effect_id, PROBES.get(effect_id, entry.effect.probes[0])), low, high))
    return found


def _channel_of(effect_id: str) -> str:
    stage = effect_id.split(".")[0]
    return {"flow": "scale", "canopy": "heads"}.get(stage, stage)
