"""Which short runs cost little, and which log would each leave of a given machine, without
noise?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.control.experiments.experiment import Experiment
from topdress.control.experiments.setting_levels import (
    USUAL_SPEED_MPS,
    list_opening_levels,
    list_shaft_levels,
)
from topdress.control.machine.effect import HOPPER_CAPACITY
from topdress.control.machine.machine import Machine, scale_nominal

Array = npt.NDArray[np.float64]
Columns = dict[str, npt.NDArray[Any]]

# Sample time of the predicted logs, s.
LOG_STEP_S = 0.5
# Share of the supply voltage that is lost while the engine idles.
IDLING_SUPPLY_LOSS_SHARE = 1.2 / 13.5
# Mass in the hopper at first, and mass of a refill, on the nominal machine, kg.
INITIAL_KG, REFILL_KG = 260.0, 150.0


def list_manoeuvres(machine: Machine) -> tuple[Experiment[Columns], ...]:
    """Returns the manoeuvres that an operator can do in ten to twenty minutes, each with the
    columns of its log without noise."""
    ten = np.arange(0.0, 600.0, LOG_STEP_S)
    twenty = np.arange(0.0, 1200.0, LOG_STEP_S)
    rpm, opening = machine.set_points.shaft_rpm, machine.set_points.opening_mm
    speeds, widths = list_shaft_levels(machine), list_opening_levels(machine)
    # A minute on each level is long against every time constant of the drives.
    level = (np.floor(ten / 60.0) % 4).astype(int)
    stairs, openings = np.array(speeds)[level], np.array(widths)[level]
    halves = np.where(np.floor(ten / 60.0) % 2 < 1, 1.0, 0.0)
    slope = np.where(np.floor(ten / 120.0) % 2 < 1, 4.0, -4.0)
    filled = np.where(twenty >= 600.0, 1.0, 0.0)
    return (
        Experiment(
            "stairs",
            f"Shaft staircase: {_listed(speeds)} r/min for a minute each at one opening, twice.",
            10.0,
            _list_holds("r/min", speeds, 60) * 2,
            _make_log_reader(ten, stairs, opening),
        ),
        Experiment(
            "openings",
            f"Opening staircase: {_listed(widths)} mm for a minute each at one shaft speed, twice.",
            10.0,
            _list_holds("mm", widths, 60) * 2,
            _make_log_reader(ten, rpm, openings),
        ),
        Experiment(
            "slope",
            "Out and back on a slope, two minutes each way, twice.",
            10.0,
            ("uphill for 120 s", "downhill for 120 s") * 2,
            _make_log_reader(ten, rpm, opening, pitch=slope),
        ),
        Experiment(
            "two_speeds",
            "Two ground speeds: 3 and 6 km/h in turn, two minutes each.",
            10.0,
            _list_holds("km/h", (3, 6, 3, 6, 3), 120),
            _make_log_reader(
                # 0.83 and 1.67 m/s are 3 and 6 km/h.
                ten,
                rpm,
                opening,
                speed=np.where(np.floor(ten / 120.0) % 2 < 1, 0.83, 1.67),
            ),
        ),
        Experiment(
            "out_of_work",
            "Drive on with the shaft stopped every second minute.",
            10.0,
            ("work for 60 s", "shaft stopped for 60 s") * 5,
            _make_log_reader(ten, rpm * halves, opening),
        ),
        Experiment(
            "standing",
            "Stand still with the shaft stopped for ten minutes and watch the scale.",
            10.0,
            ("stand with the shaft stopped for 600 s",),
            _make_log_reader(ten, 0.0, opening, speed=0.0 * ten),
        ),
        Experiment(
            "refill",
            "Work for ten minutes, fill up with weighed bags and write the kg down, work "
            "for ten more.",
            20.0,
            ("work for 600 s", "fill up, kg written down", "work for 600 s"),
            _make_log_reader(
                twenty,
                rpm,
                opening,
                refill=scale_nominal(machine, HOPPER_CAPACITY) * REFILL_KG * filled,
            ),
        ),
    )


def _list_holds(unit: str, values: Sequence[float], seconds: int) -> tuple[str, ...]:
    return tuple(f"{value:g} {unit} for {seconds} s" for value in values)


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _make_log_reader(
    time: Array,
    rpm: Array | float,
    opening: Array | float,
    pitch: Array | float = 0.0,
    speed: Array | float = USUAL_SPEED_MPS,
    refill: Array | float = 0.0,
) -> Callable[[Machine], Columns]:
    return partial(
        _predict_log, time=time, rpm=rpm, opening=opening, pitch=pitch, speed=speed, refill=refill
    )


def _predict_log(
    machine: Machine,
    time: Array,
    rpm: Array | float,
    opening: Array | float,
    pitch: Array | float,
    speed: Array | float,
    refill: Array | float,
) -> Columns:
    n = np.ones(len(time))
    turns, wide, kg_rev_mm = rpm * n, opening * n, machine.flow.grams_per_rev_mm / 1000.0
    events = np.full(len(time), "", object)
    # The refill stands in the row after the mass rises.
    events[np.flatnonzero(np.diff(refill * n) > 0.0) + 1] = f"refill {np.max(refill * n):g}"
    # The hopper loses what the shaft delivered until the row began.
    used = np.concatenate(([0.0], np.cumsum(kg_rev_mm * turns * wide / 60.0)[:-1])) * LOG_STEP_S
    return {
        "time_s": time,
        "shaft_rpm_cmd": turns,
        "shaft_rpm": turns + 1e-4 * np.sin(time),
        "opening_mm_cmd": wide,
        "opening_mm": wide + 1e-4 * np.sin(time),
        "hopper_kg": scale_nominal(machine, HOPPER_CAPACITY) * INITIAL_KG
        - used
        + refill * n
        + 1e-3 * np.sin(7.0 * time),
        "pitch_deg": pitch * n,
        "speed_mps": speed * n + 1e-4 * np.sin(5.0 * time),
        "wheel_speed_mps": speed * n + 1e-4 * np.sin(3.0 * time),
        "supply_v": _alternate_supply_v(time, machine.shaft.nominal_supply_v),
        "events": events,
    }


def _alternate_supply_v(time: Array, nominal_v: float) -> Array:
    """Alternates between the supply voltage at rated engine speed and when idling."""
    return np.where(
        np.floor(time / 90.0) % 2 < 1, nominal_v, nominal_v - IDLING_SUPPLY_LOSS_SHARE * nominal_v
    )
