"""The manoeuvres that `control_quality.py` and `other_machines.py` drive, and how one is judged.

Each is driven on the demo field by the simulated machine and judged inside its own window of
time. Rate error is the area mean of |landed - target| over the mean target; place error the
distance between a step of the target and the half-way point of the landed step; outside: what
landed beyond the field, in metres of the working width at the mean target, for each crossing of
the edge.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from topdress.control.field.job import Simulated
from topdress.control.machine.model_elements import Array
from topdress.control.orders import Do, Order, Strategy
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.error_metrics import RATE_BIN_M, find_landing, find_place_errors
from topdress.drivers.files.run_setup import Setup, load_setup

DT_S = 0.05
GO = ((0.5, Order(Do.READY)), (1.0, Order(Do.START)))
# START held until the machine works
GO_HELD = (GO[0], *((1.0 + 0.2 * k, Order(Do.START, True)) for k in range(40)))
PASS_BEGINS_M = 15.0  # of a pass belong to its start


class Manoeuvre(NamedTuple):
    """`speeds`: (at s, km/h, m/s2). Judged from `begin_s` to `end_s`; `edges`: only the first
    metres of each pass."""

    name: str
    begin_s: float
    end_s: float
    speeds: tuple[tuple[float, float, float], ...]
    sim: dict[str, Any] = {}
    edges: bool = False


MANOEUVRES = (
    Manoeuvre("steady 4.5 km/h", 25, 85, ()),
    Manoeuvre("accelerating 3 to 7 km/h, 0.5 m/s2", 48, 56, ((0, 3, 0.5), (50, 7, 0.5))),
    Manoeuvre("accelerating 3 to 7 km/h, 1.0 m/s2", 48, 56, ((0, 3, 0.5), (50, 7, 1.0))),
    Manoeuvre("decelerating 7 to 3 km/h, 0.5 m/s2", 48, 56, ((0, 7, 0.5), (50, 3, 0.5))),
    Manoeuvre("stop and go, 6 s standing", 48, 70, ((50, 0, 0.5), (58.5, 4.5, 0.5))),
    Manoeuvre(
        "reversing 4 m, going on",
        48,
        85,
        ((50, 0, 0.5), (56, -2, 0.5), (63, 0, 0.5), (66, 4.5, 0.5)),
    ),
    Manoeuvre("turning: whole passes of 60 m", 20, 260, (), {"pass_length_m": 60.0}),
    Manoeuvre("start of a pass, rolling", 20, 260, (), {"pass_length_m": 60.0}, True),
    Manoeuvre(
        "start from standstill at the edge", 3, 18, ((0, 0, 0.5), (3, 4.5, 0.5)), {"run_in_m": 0.5}
    ),
    Manoeuvre(
        "start from standstill in the field",
        3,
        18,
        ((0, 0, 0.5), (3, 4.5, 0.5)),
        {"run_in_m": 0.5, "begin_m": 20.0},
    ),
)


class Judged(NamedTuple):
    """One run inside its window. Sums, so that runs can be added up."""

    missed_kg_ha: Array  # |landed - target| by bin
    target_kg_ha: Array
    signed_kg_ha: Array  # landed - target by bin
    places_m: Array
    lost: int
    outside_m: float
    crossings: int

    @property
    def rate_percent(self) -> float:
        return 100.0 * float(self.missed_kg_ha.sum() / max(1e-9, self.target_kg_ha.sum()))

    @property
    def bias_percent(self) -> float:
        return 100.0 * float(self.signed_kg_ha.sum() / max(1e-9, self.target_kg_ha.sum()))

    @property
    def place_m(self) -> float:
        return float(np.abs(self.places_m).mean()) if len(self.places_m) else float("nan")


def the_setup() -> Setup:
    return load_setup("huanghai", "demo", dt.date(2014, 3, 7))


def driven(
    setup: Setup,
    strategy: Strategy,
    seed: int,
    seconds: float,
    sim: dict[str, Any],
    orders: Sequence[tuple[float, Order]] | None,
    look_ahead: bool = True,
) -> RunRecord:
    """The record of one run."""
    values = setup.job.simulated.model_dump() | sim
    job = setup.job.model_copy(
        update={
            "strategy": strategy,
            "look_ahead": look_ahead,
            "simulated": Simulated.model_validate(values),
        }
    )
    job = add_simulated_field(job, setup.machine)
    plant = make_plant(setup.machine, job, seed, DT_S)
    record = RunRecord()
    for step in simulate_run(
        plant, make_control_loop(setup.machine, setup.crop, setup.rule, job), seconds, orders
    ):
        record.add_tick(step)
    return record


def judge(record: RunRecord, what: Manoeuvre, width_m: float) -> Judged:
    columns = record.make_columns()
    land = find_landing(columns, width_m)
    time, way = columns["time_s"], columns["driven_m"]
    rows = (time >= what.begin_s) & (time <= what.end_s)
    centres = land.ground.calc_centres_m()
    inside = (land.inside > 0.0) & (centres >= way[rows].min()) & (centres <= way[rows].max())
    begins = np.flatnonzero(
        np.diff(np.concatenate(([0.0], (land.target_kg_ha > 0.0).astype(float)))) > 0.0
    )
    ends = np.flatnonzero(np.diff((land.target_kg_ha > 0.0).astype(float)) < 0.0)
    if what.edges:
        near = np.zeros(len(centres), dtype=bool)
        for begin in begins:
            near |= (centres >= centres[begin]) & (centres < centres[begin] + PASS_BEGINS_M)
        inside &= near
    fired = [f for f in record.fired if what.begin_s <= f.time_s <= what.end_s]
    if what.edges:
        fired = [f for f in fired if f.before.rate_kg_ha <= 0.0]
    places, lost = find_place_errors(columns, fired, land, width_m)
    beyond = (
        land.landed_kg_ha[
            (land.target_kg_ha <= 0.0) & (centres >= way[rows].min()) & (centres <= way[rows].max())
        ].sum()
        * RATE_BIN_M
    )
    target = land.target_kg_ha[inside]
    crossings = int(
        ((centres[begins] >= way[rows].min()) & (centres[begins] <= way[rows].max())).sum()
        + ((centres[ends] >= way[rows].min()) & (centres[ends] <= way[rows].max())).sum()
    )
    return Judged(
        np.abs(land.landed_kg_ha[inside] - target),
        target,
        land.landed_kg_ha[inside] - target,
        places,
        lost,
        float(beyond / target.mean()) if len(target) else 0.0,
        crossings,
    )


def sim_of(what: Manoeuvre) -> dict[str, Any]:
    changes = [
        {"at_s": at, "speed_kmh": kmh, "acceleration_mps2": most} for at, kmh, most in what.speeds
    ]
    return {"speed_changes": changes, **what.sim}


def measured(what: Manoeuvre, strategy: Strategy, seed: int, setup: Setup) -> Judged:
    """One drive on the canopy of a seed."""
    orders = GO if what.speeds and what.speeds[0][1] == 0 else None
    record = driven(setup, strategy, seed, what.end_s + 4.0, sim_of(what), orders)
    return judge(record, what, setup.machine.geometry.working_width_m)
