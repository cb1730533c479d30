"""Bounds before memory: no number and no list of a file without a range, and none that asks for
all there is."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from topdress.control.field.job import Canopy, Job, Simulated, make_rule
from topdress.control.machine.machine import Machine
from topdress.control.metering.inverse_model import find_opening_mm
from topdress.control.orders import Do, Order
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import simulate_run
from topdress.control.simulation.simulated_canopy import (
    CANOPY_CELL_M,
    MAX_CANOPY_CELLS,
    CanopyField,
)
from topdress.drivers.files.config import ConfigError, validate_config
from topdress.drivers.files.config_kinds import (
    CAB_KIND,
    CROP_KIND,
    JOB_KIND,
    MACHINE_KIND,
    PRODUCT_KIND,
)
from topdress.drivers.files.run_setup import load_setup

from tests.command import topdress

KINDS = {kind.format: kind for kind in (MACHINE_KIND, JOB_KIND, CROP_KIND, CAB_KIND, PRODUCT_KIND)}
ENDS = (("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum"))


def without_range(node: dict[str, Any], defs: dict[str, Any], at: str) -> Iterator[str]:
    """Where a number has no lowest or highest value, or a list no longest length."""
    if "$ref" in node:
        node = defs[node["$ref"].rsplit("/", 1)[-1]]
    for other in node.get("anyOf", []):
        yield from without_range(other, defs, at)
    if node.get("type") in ("number", "integer") and not all(
        any(key in node for key in end) for end in ENDS
    ):
        yield at
    if node.get("type") == "array" and "maxItems" not in node:
        yield at + "[]"
    children = [(f"{at}.{name}", child) for name, child in node.get("properties", {}).items()]
    children += [(f"{at}[{k}]", child) for k, child in enumerate(node.get("prefixItems", []))]
    for name, child in (("[]", node.get("items")), (".*", node.get("additionalProperties"))):
        children += [(at + name, child)] if isinstance(child, dict) else []
    for name, child in children:
        yield from without_range(child, defs, name)


@pytest.mark.parametrize("name", KINDS)
def test_every_number_has_a_range_and_every_list_a_longest_length(name):
    schema = KINDS[name].model.model_json_schema()
    assert sorted(set(without_range(schema, schema.get("$defs", {}), name))) == []


def test_the_walk_finds_what_it_looks_for():
    number = {"type": "number", "minimum": 0}
    schema = {"properties": {"a": number, "b": {"type": "array", "items": number}}}
    assert sorted(without_range(schema, {}, "x")) == ["x.a", "x.b[]", "x.b[]"]


def wide(tmp_path: Path, width: str) -> Path:
    shipped = Path(__file__).parents[2] / "configs" / "machines" / "huanghai.yaml"
    path = tmp_path / "wide.yaml"
    text = shipped.read_text(encoding="utf-8")
    path.write_text(
        text.replace("working_width_m: 2.4", f"working_width_m: {width}"), encoding="utf-8"
    )
    return path


@pytest.mark.parametrize("command", ["check", "simulate"])
def test_a_width_that_no_machine_has_is_refused_in_one_line(tmp_path, command):
    path, log = wide(tmp_path, "100000"), tmp_path / "run.csv"
    arguments = (
        [str(path)]
        if command == "check"
        else ["--machine", str(path), "--seconds", "5", "--out", str(log)]
    )
    result = topdress(command, *arguments)
    assert result.exit_code != 0 and not log.exists()
    assert result.output.strip().splitlines() == [
        f"{path}: key geometry.working_width_m: value 100000: allowed 0.1 to 60 (line 8)"
    ]


@pytest.mark.parametrize(
    ("east_m", "north_m"),
    [(24.0, 600.0), (60_000.0, 20_000.0), (2.4, 20_000.0 * 2000), (20_000.0 * 2000, 2.4)],
)
def test_the_simulated_canopy_has_a_most(east_m, north_m):
    field = CanopyField(Canopy(), (0.0, east_m), (0.0, north_m), 1)
    assert field.ndvi.size <= MAX_CANOPY_CELLS
    if east_m * north_m < 0.5 * MAX_CANOPY_CELLS * CANOPY_CELL_M**2:
        assert field.ndvi.shape == (round(north_m / CANOPY_CELL_M), round(east_m / CANOPY_CELL_M))
    assert 0.0 < field.find_ndvi(0.9 * east_m, 0.9 * north_m) < 1.0


def test_plants_beyond_what_a_list_may_hold_are_refused():
    sim = {"passes": 1000, "pass_length_m": 20_000.0, "plants": {"spacing_m": 0.02}}
    with pytest.raises(ConfigError) as refused:
        validate_config({"format": "topdress-job/1", "simulated": sim}, JOB_KIND, "job.yaml")
    assert "more than 1000000 plants" in str(refused.value) and "\n" not in str(refused.value)


def test_the_largest_field_of_the_widest_machine_can_be_simulated():
    """All that sizes an array at its highest at once."""
    setup = load_setup("huanghai", "demo", dt.date(2026, 4, 1))
    widest = setup.machine.model_copy(
        update={
            "geometry": setup.machine.geometry.model_copy(
                update={"working_width_m": 60.0, "outlets": 100}
            )
        }
    )
    machine = Machine.model_validate(widest.model_dump(exclude_defaults=True))
    sim = Simulated(passes=1000, pass_length_m=20_000.0, run_in_m=1000.0)
    job = add_simulated_field(
        Job(**setup.job.model_dump(exclude={"simulated"}), simulated=sim), machine
    )
    loop = make_control_loop(machine, setup.crop, make_rule(setup.crop, job, 110), job)
    orders = [(0.5, Order(Do.READY)), (1.0, Order(Do.START))]
    rows = [
        step.tick.row for step in simulate_run(make_plant(machine, job, 1, 0.05), loop, 2.0, orders)
    ]
    assert rows[-1].state == "working"


def test_a_machine_all_of_whose_outlets_are_blocked_is_metered_to_its_limits():
    machine = Machine.model_validate({"flow": {"blocked_percent": 100.0}})
    assert find_opening_mm(machine, 0.1, 70.0) > machine.limits.opening_high_mm
