"""Diagnoses made by hand, a small run log, and one bench table of each kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.diagnosis.result import (
    RUN_CHANNELS,
    Cause,
    Channel,
    DetectableSize,
    Diagnosis,
    FieldCost,
    Gain,
    NextRun,
    Rival,
    Size,
    SourceSummary,
    UnnamedEffect,
)
from topdress.control.machine.machine import CATALOGUE, Machine

SECONDS, STEP_S = 240.0, 0.1
SAG_PERCENT_PER_V = 5.0


@pytest.fixture(scope="session")
def machine() -> Machine:
    return Machine()


@pytest.fixture(scope="session")
def run_columns() -> dict[str, Any]:
    """Four minutes: a shaft that loses SAG_PERCENT_PER_V below 13.5 V, all else as nominal,
    white noise."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, SECONDS, STEP_S)
    n = len(time)
    rpm = rng.permutation(np.tile([40.0, 60.0, 50.0, 0.0, 12.0], 4))[
        np.floor(time / 12.0).astype(int)
    ]
    supply = 13.0 + 0.7 * np.cos(2.0 * np.pi * time / 31.0)
    late = np.concatenate((np.full(4, rpm[0]), rpm[:-4]))
    turns = late * (1.0 - SAG_PERCENT_PER_V / 100.0 * np.maximum(0.0, 13.5 - supply))
    opening = np.where(np.floor(time / 7.0) % 2 < 1, 20.0, 30.0)
    kg = 250.0 - np.concatenate(([0.0], np.cumsum(5.5e-3 * turns * opening / 60.0)[:-1])) * STEP_S
    speed = 1.25 + 0.1 * np.sin(time / 15.0)
    ndvi = 0.5 + 0.1 * np.sin(time / 30.0)
    columns: dict[str, Any] = {
        "time_s": time,
        "shaft_rpm_cmd": rpm,
        "shaft_rpm": turns + 0.3 * rng.standard_normal(n),
        "opening_mm_cmd": opening,
        "opening_mm": opening + 0.1 * rng.standard_normal(n),
        "supply_v": supply,
        "pitch_deg": 2.0 * np.sin(time / 11.0),
        "hopper_kg": kg + 0.15 * rng.standard_normal(n),
        "speed_mps": speed + 0.03 * rng.standard_normal(n),
        "wheel_speed_mps": speed + 0.02 * rng.standard_normal(n),
    }
    return {**columns, **{f"ndvi_{k}": ndvi + 0.01 * rng.standard_normal(n) for k in range(1, 7)}}


@pytest.fixture(scope="session")
def bench_tables() -> dict[str, BenchTable]:
    """One of each kind, a little off the nominal machine."""
    rng = np.random.default_rng(2)
    rpm = np.repeat([10.0, 40.0, 70.0, 100.0], 3)
    label = np.array(["before", "after", "after"] * 4)
    mass = 5.5e-3 * 25.0 * rpm / 60.0 * 30.0 * 1.1
    head = np.tile(np.arange(1.0, 7.0), 4)
    reference = np.repeat([0.2, 0.4, 0.6, 0.8], 6)
    target = np.array([10.0, 12.0, 14.0, 16.0])

    def table(kind: str, texts: Any = None, **columns: Any) -> BenchTable:
        return BenchTable(kind, columns, "label" if texts is not None else "", f"{kind}.csv", texts)

    return {
        "lag": table(
            "lag", shaft_rpm=rpm, lag_s=2.2 - 0.0083 * rpm + 0.3 + 0.01 * rng.standard_normal(12)
        ),
        "catch": table(
            "catch",
            shaft_rpm=rpm,
            opening_mm=np.full(12, 25.0),
            duration_s=np.full(12, 30.0),
            mass_kg=mass + 0.01 * rng.standard_normal(12),
        ),
        "weigh": table(
            "weigh", area_m2=np.full(4, 300.0), target_kg=target, applied_kg=1.1 * target
        ),
        "heads": table(
            "heads",
            head=head,
            ndvi_reference=reference,
            ndvi=reference * np.where(head == 3, 0.9, 1.0) + 0.002 * rng.standard_normal(24),
        ),
        "place": table(
            "place",
            label,
            shaft_rpm=rpm,
            speed_mps=np.tile([0.8, 1.2, 1.6], 4),
            miss_m=0.4 + 0.05 * rng.standard_normal(12),
        ),
    }


@pytest.fixture(scope="session")
def cause_of() -> Callable[..., Cause]:
    """A cause by id with a size; the rest is filled in."""

    def made(effect_id: str, value: float | None = None, **changes: Any) -> Cause:
        effect = CATALOGUE[effect_id].effect
        value = effect.probes[-1] if value is None else value
        given: dict[str, Any] = {
            "id": effect_id,
            "size": Size(value, value - 0.2 * abs(value), value + 0.2 * abs(value), effect.unit),
            "onset_s": 120.0 if effect.onset_only else None,
            "probability": 0.97,
            "rivals": (),
            "member": 3 if effect.member_field else None,
            "advice": effect.advice,
            "field_cost": FieldCost(-5.9, 0.25),
        }
        return Cause(**{**given, **changes})

    return made


@pytest.fixture(scope="session")
def found_of(cause_of: Callable[..., Cause]) -> Callable[..., Diagnosis]:
    """A diagnosis with these causes; the rest is filled in."""

    def made(*causes: Cause, kind: str = "run", **changes: Any) -> Diagnosis:
        given: dict[str, Any] = {
            "data": SourceSummary(
                f"{kind}.csv", kind, 2400, 240.0 if kind == "run" else None, "huanghai"
            ),
            "channels": tuple(
                Channel(name, "r/min", 2370, -0.14, 0.37, 0.285, 0.999, 0.0004)
                for name in (RUN_CHANNELS if kind == "run" else ("shaft",))
            ),
            "verdict": "named" if causes else "none",
            "causes": causes,
            "not_shown": (
                UnnamedEffect("shaft.gain", DetectableSize(0.27, "%")),
                UnnamedEffect("gate.stuck", DetectableSize(None, "s")),
            ),
            "unexplained": (),
            "next_run": None,
            "gain": (),
            "extended_machine": None,
        }
        return Diagnosis(**{**given, **changes})

    return made


@pytest.fixture(scope="session")
def full(cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis]) -> Diagnosis:
    """Everything that a diagnosis of a run may hold at once."""
    return found_of(
        cause_of(
            "shaft.voltage_sag",
            SAG_PERCENT_PER_V,
            rivals=(Rival("shaft.load_droop", 0.21), Rival("shaft.dead_band", 0.07)),
        ),
        cause_of("canopy.head_fouled", -8.0),
        cause_of("flow.blocked_outlet", 10.0, onset_s=130.0, member=None),
        verdict="ambiguous",
        findings=("column supply_v: 3 values -9999 emptied: not known",),
        next_run=NextRun(
            "this data cannot tell them apart",
            "1. stairs, twice (10 min); then 2. refill by bags (20 min)",
            "stairs+refill",
            tests=("stairs, twice (10 min)", "refill by bags (20 min)"),
        ),
        gain=(Gain("shaft", "rmse, r/min", 0.354, 0.2868, 0.283, 0.291, "blocks 2, 5, 7 of 8"),),
    )
