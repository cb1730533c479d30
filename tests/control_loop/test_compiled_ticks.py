"""Long simulated runs take compiled steps: what comes of them is the same to the last bit."""

from __future__ import annotations

import datetime as dt
import math
import subprocess
import sys

import numpy as np
import pytest
from topdress.console.cli.terms import parse_terms
from topdress.control.field.coverage import Coverage
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import SimulatedTick, simulate_run
from topdress.control.simulation.compiled_steps import COMPILED_STEPS
from topdress.control.targets.done_ground_ahead import DoneGroundAhead
from topdress.drivers.files.prescriptions.job_targets import read_loop_targets
from topdress.drivers.files.run_setup import load_setup

TODAY = dt.date(2026, 4, 1)
EFFECTS = (
    "flow.gain=8",
    "gate.backlash=1@15",
    "shaft.dead_time=0.1",
    "flow.pulsation=5",
    "shaft.coarse_encoder=1",
    "flow.bridging=5",
    "shaft.stall=1@30",
    "gate.stuck=1@38",
)
TERM = "flow_percent bend speed_mps bend=-4.4 at=1.2"


def steps(
    machine: str,
    job: str,
    seconds: float,
    compiled: bool,
    effects: tuple[str, ...] = (),
    terms: tuple[str, ...] = (),
    begin_m: float = 0.0,
) -> list[SimulatedTick]:
    setup = load_setup(machine, job, TODAY)
    simulated = setup.job.simulated.model_copy(update={"begin_m": begin_m})
    resolved = add_simulated_field(
        setup.job.model_copy(update={"simulated": simulated}), setup.machine
    )
    placed = read_loop_targets(resolved, setup.folder, setup.machine, setup.crop.index)
    plant = make_plant(
        setup.machine,
        resolved,
        7,
        0.05,
        [parse_planted(one) for one in effects],
        plants=placed["plants"],
        terms=parse_terms(terms),
        steps=COMPILED_STEPS if compiled else None,
    )
    loop = make_control_loop(
        setup.machine,
        setup.crop,
        setup.rule,
        resolved,
        **placed,
        steps=COMPILED_STEPS if compiled else None,
    )
    return [
        step._replace(truth=step.truth._replace(canopy=None))
        for step in simulate_run(plant, loop, seconds)
    ]


@pytest.mark.parametrize(
    ("machine", "job", "effects", "terms"),
    [
        pytest.param("huanghai", "demo", (), (), marks=pytest.mark.exam),
        ("huanghai", "demo", EFFECTS, (TERM,)),
        pytest.param("huanghai", "map_demo", (), (), marks=pytest.mark.exam),
        ("planter", "points_demo", (), ()),
        ("huanghai_sections", "sections_demo", (), ()),
        pytest.param("spreader", "spreader_demo", ("flow.gain=5",), (), marks=pytest.mark.exam),
    ],
)
def test_rows_and_truth_are_the_same(
    machine: str, job: str, effects: tuple[str, ...], terms: tuple[str, ...]
) -> None:
    plain, quick = (
        steps(machine, job, 50.0, compiled, effects, terms) for compiled in (False, True)
    )
    assert [one.tick.row for one in quick] == [one.tick.row for one in plain]
    assert [one.truth for one in quick] == [one.truth for one in plain]
    assert any(one.truth.flow_kg_s > 0.0 for one in plain)


def driven(
    compiled: bool, width_m: float, east_m: float
) -> tuple[Coverage, list[tuple[object, ...]]]:
    """Loops that cross their own ground, with noise in the course, over the edges of tiles;
    seen ahead at each step."""
    coverage = Coverage(width_m, 0.2, longest_m=5.0, steps=COMPILED_STEPS if compiled else None)
    overlap, rng, seen = DoneGroundAhead(coverage, 6), np.random.default_rng(1), []
    place = (east_m, -3.0)
    for k in range(3000):
        heading = 0.3 * k % 360.0 + float(rng.normal(0.0, 0.3))
        place = (
            place[0] + 0.0625 * math.sin(math.radians(heading)),
            place[1] + 0.0625 * math.cos(math.radians(heading)) + 0.01,
        )
        if k == 1500:
            overlap.record_start()
        overlap.record_release(0.05 * k, place, heading, k % 700 < 600, 0.6, 0.0625 * k)
        overlap.look_ahead(0.0625 * k, place, heading, 0.0625 * k - 1.0)
        seen.append(
            (coverage.covered_area, tuple(overlap.places_m), overlap.is_inside(0.0625 * k + 1.0))
        )
    return coverage, seen


@pytest.mark.parametrize(
    ("width_m", "east_m"), [(2.4, 0.0), (2.4, 50.9), (12.0, -51.3), (2.4, 99_999.0)]
)
def test_ground_is_the_same_cell_by_cell(width_m: float, east_m: float) -> None:
    (plain, seen), (quick, quickly) = (
        driven(compiled, width_m, east_m) for compiled in (False, True)
    )
    assert quickly == seen and any(places for _, places, _ in seen)
    one, other = plain.make_raster(), quick.make_raster()
    assert one[:3] == other[:3] and np.array_equal(one.done, other.done)


def test_what_is_to_start_at_once_loads_no_compiler() -> None:
    said = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys, topdress.control.simulation.assembly, topdress.control.field.coverage; "
            "print('numba' in sys.modules)",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout.strip() == "False"
