"""Cheap tests that a farm can make, each as what it would read under a given machine: the next run is computed."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from control.machine.fall import start_drop_s
from control.machine.flow import grams_per_rev
from control.machine.heads import HeadInput, head_reads
from control.machine.machine import Machine
from control.machine.scale import ScaleInput, scale_reads
from control.machine.start import response_s

from .piece import Array, SizedEffect, with_effects
from .rows.weigh import USUAL_MPS, wheel_reads

MIN_APART_SD = 4.0      # between two hypotheses, from which on a test separates them
MAX_TESTS = 3


TWO_RATES = ("a step from 40 to 80 r/min at the rig, ten times: time from the shaft's change until the plate stands "
             "half-way between its two readings; as a table with before_rpm 40, shaft_rpm 80 and drop_s it is for "
             "topdress calibrate lag")


class Experiment(NamedTuple):
    """`reads`: what the test would measure, (k,), in units of its own noise."""

    id: str
    steps: str
    minutes: float
    reads: Callable[[Machine], Array]


def _lag(m: Machine, rpm: float, start: float = 0.0, change: float = 0.0) -> float:
    fall = m.fall
    return response_s(m, rpm) + start_drop_s(fall, rpm) + start * fall.first_fill_s - 0.5 * change * fall.asymmetry_s


def _place(m: Machine, rpm: float, speed_mps: float) -> float:
    return float(speed_mps * (1.0 + m.fall.speed_scale_percent / 100.0) * (_lag(m, rpm) + m.fall.latency_s)
                 + m.fall.lever_arm_m)


def _wheel(m: Machine) -> Array:
    return np.array([wheel_reads(m, USUAL_MPS, working) / USUAL_MPS for working in (0.0, 1.0)]) / 0.004


EXPERIMENTS = (
    Experiment("response_test",
               "response test: 5 starts each at 10, 40 and 70 r/min, encoder only, time from command to turning shaft",
               10.0, lambda m: np.array([response_s(m, n) for n in (10.0, 40.0, 70.0)]) / 0.003),
    Experiment("lag_rig",
               "lag test with the rig, machine standing: 5 starts each at 10, 40, 70 and 100 r/min, times written down",
               20.0, lambda m: np.array([_lag(m, n) for n in (10.0, 40.0, 70.0, 100.0)]) / 0.03),
    Experiment("measured_speed",
               "measure the ground speed of the lag test over 30 m with tape and watch, 3 times",
               10.0, lambda m: np.array([1.0 + m.fall.speed_scale_percent / 100.0]) / 0.006),
    Experiment("lag_two_speeds",
               "lag test by distance at two measured ground speeds, 0.8 and 1.8 m/s, 5 times each at 40 r/min",
               30.0, lambda m: np.array([_place(m, 40.0, v) for v in (0.8, 1.8)]) / 0.04),
    Experiment("lag_empty_running",
               "lag test at 40 r/min from an empty tube and as a change from 20 r/min while running, 5 times each",
               15.0, lambda m: np.array([_lag(m, 40.0, 1.0), _lag(m, 40.0)]) / 0.03),
    Experiment("lag_up_down",
               "lag test of equal steps up and down, 20 to 60 r/min, 5 times each",
               15.0, lambda m: np.array([_lag(m, 40.0, 0.0, 1.0), _lag(m, 40.0, 0.0, -1.0)]) / 0.03),
    Experiment("catch_openings",
               "catch test on a bench balance at 40 r/min with openings of 10 and 40 mm, 3 catches of 60 s each",
               20.0, lambda m: np.array([grams_per_rev(m.flow, 40.0, o) / (5.5 * o) for o in (10.0, 40.0)]) / 0.004),
    Experiment("catch_speeds",
               "catch test on a bench balance at 25 mm with 20, 60 and 100 r/min, 3 catches of 60 s each",
               20.0, lambda m: np.array([grams_per_rev(m.flow, n, 25.0) for n in (20.0, 60.0, 100.0)]) / 0.55),
    Experiment("catch_outlets",
               "catch test by outlet at 40 r/min and 25 mm, 3 catches of 60 s",
               25.0, lambda m: np.array([1.0 + (k == m.flow.uneven_outlet) * m.flow.uneven_percent / 100.0
                                         for k in range(1, m.geometry.outlets + 1)]) / 0.006),
    Experiment("static_weigh",
               "static weigh: put a known weight of 100 kg on the hopper, 3 times",
               10.0, lambda m: np.array([scale_reads(m.scale, ScaleInput(100.0, 0.0))]) / 0.15),
    Experiment("wheel_pulses",
               "drive a taped 100 m out of work, count the wheel's pulses, 3 times",
               10.0, lambda m: _wheel(m)[:1]),
    Experiment("wheel_in_work",
               "drive a taped 100 m out of work and again in work, count the wheel's pulses, 3 times each",
               20.0, _wheel),
    Experiment("heads_one_panel",
               "hold all heads over one reference panel at NDVI 0.5, a quarter of an hour after switching on",
               10.0, lambda m: np.array([head_reads(m.heads, HeadInput(0.5, float(k), 900.0))
                                         for k in range(1, m.geometry.heads + 1)]) / 0.005),
    Experiment("heads_warming_up",
               "read one panel 1, 5 and 20 minutes after switching on, all heads",
               25.0, lambda m: np.array([head_reads(m.heads, HeadInput(0.5, 0.0, 60.0 * t))
                                         for t in (1.0, 5.0, 20.0)]) / 0.002),
    Experiment("heads_three_panels",
               "warm heads over panels of NDVI 0.3, 0.6 and 0.8",
               15.0, lambda m: np.array([head_reads(m.heads, HeadInput(v, 0.0, 3600.0))
                                         for v in (0.3, 0.6, 0.8)]) / 0.003),
)


Pair = tuple[SizedEffect, SizedEffect]


class Plan(NamedTuple):
    """`pairs`: what this data cannot tell apart. `unsettled`: those of them that no test of the plan separates."""

    tests: tuple[Experiment, ...]
    pairs: tuple[Pair, ...]
    unsettled: tuple[Pair, ...]
    apart_sd: float | None          # the least that the tests set a settled pair apart; None: no test does


def separating(machine: Machine, rivals: Sequence[Sequence[SizedEffect]]) -> Plan | None:
    """The quickest tests that tell the rivals of each cause apart, chosen by what each would read under each of them.

    `rivals`: for each ambiguous cause, its members at their fitted sizes. None where there is nothing to separate.
    """
    pairs = tuple((a, b) for members in rivals for i, a in enumerate(members) for b in members[i + 1:])
    if not pairs:
        return None
    readings = {effect: [e.reads(with_effects(machine, (effect,))) for e in EXPERIMENTS]
                for pair in pairs for effect in pair}
    apart = np.array([[float(np.linalg.norm(readings[a][k] - readings[b][k])) for k in range(len(EXPERIMENTS))]
                      for a, b in pairs])
    picked: list[int] = []
    open_ = np.ones(len(pairs), bool)
    while open_.any() and len(picked) < MAX_TESTS:
        worth = [float(np.sum(apart[open_, k] >= MIN_APART_SD)) / EXPERIMENTS[k].minutes
                 for k in range(len(EXPERIMENTS))]
        if max(worth) <= 0.0:
            break
        picked.append(int(np.argmax(worth)))
        open_ &= apart[:, picked[-1]] < MIN_APART_SD
    clear = min((float(np.max(apart[k, picked])) for k in range(len(pairs)) if not open_[k]), default=None)
    return Plan(tuple(EXPERIMENTS[k] for k in picked), pairs,
                tuple(pair for pair, still in zip(pairs, open_, strict=True) if still), clear)
