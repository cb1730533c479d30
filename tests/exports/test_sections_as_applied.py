"""As-applied of a machine whose sections have valves: polygons by section, areas of what was open."""
from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest
from shapely.geometry import Polygon

from control.field.job import Wanted
from control.geodesy import TangentPlane
from control.orders import Do, Order, TargetSource
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import simulated_run
from drivers.files.exports.as_applied import as_applied
from drivers.files.exports.columns import COLUMNS
from drivers.files.read_log import read_log
from drivers.files.run_log import write_log
from drivers.files.run_meta import run_meta
from drivers.files.setup import load_setup

WIDTH_M = 2.4


@pytest.fixture(scope="module")
def applied(tmp_path_factory: pytest.TempPathFactory):
    """40 s on a pass; from 25 s on the middle section is closed by hand."""
    setup = load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))
    target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0)
    job = with_simulated_field(setup.job.model_copy(update={"target": target}), setup.machine)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    orders = [(1.0, Order(Do.READY)), (5.0, Order(Do.START)), (25.0, Order(Do.SECTION, "2 off"))]
    steps = list(simulated_run(simulated_machine(setup.machine, job, 1, 0.05), loop, 40.0, orders))
    path = tmp_path_factory.mktemp("log") / "run.csv"
    log = read_log(write_log(path, run_meta(setup.machine, setup.crop, job), [step.tick.row for step in steps]))
    return as_applied(log), loop.totals, steps


def test_totals_of_the_log_are_the_loops(applied):
    found, totals, steps = applied
    assert found.totals.area_ha == pytest.approx(totals.area_ha, rel=0.01)
    assert found.totals.applied_kg == pytest.approx(totals.applied_kg, rel=0.01)
    assert found.totals.applied_kg == pytest.approx(sum(sum(s.truth.section_kg) for s in steps), rel=0.02)
    way_m = sum(s.truth.speed_mps * 0.05 for s in steps if s.tick.row.state == "working" and s.truth.open_share > 0.0)
    assert 10_000.0 * found.totals.area_ha < 0.9 * way_m * WIDTH_M, "what was closed is not counted"
    assert found.totals.covered_ha == pytest.approx(found.totals.area_ha, rel=0.03)


def test_every_section_has_stretches_of_its_own(applied):
    found, _totals, _steps = applied
    s = found.stretches
    assert s.width_m.tolist() == pytest.approx([WIDTH_M / 3.0] * len(s.width_m))
    assert s.area_m2.sum() / 10_000.0 == pytest.approx(found.totals.area_ha, rel=1e-3)
    assert s.applied_kg.sum() == pytest.approx(found.totals.applied_kg, rel=1e-3)
    late = s.time_s > 27.0
    plane = TangentPlane(float(s.lat_deg[0]), float(s.lon_deg[0]))
    east_m = [plane.to_m(lat, lon)[0] for lat, lon in zip(s.lat_deg[late], s.lon_deg[late], strict=True)]
    apart_m = [right - left for left, right in zip(east_m[::2], east_m[1::2], strict=True)]
    assert apart_m == pytest.approx([1.6] * len(apart_m), abs=0.02), "left and right alone"
    places = [Polygon(plane.many_to_m(corners[:, 0], corners[:, 1])) for corners in s.corners_deg[late][:6]]
    left, right = places[::2], places[1::2]
    assert all(one.intersection(other).area < 1e-6 for one in left for other in right)
    assert [one.area for one in places] == pytest.approx(s.area_m2[late][:6].tolist(), rel=0.1)
    widths = {column.name: column for column in COLUMNS}["swath_width_m"].of(found)
    assert widths.tolist() == s.width_m.tolist()


def test_it_goes_out_by_section(applied, tmp_path: Path):
    from drivers.files.exports.write import write_as_applied
    found, _totals, _steps = applied
    for name in ("out.geojson", "out.shp", "task"):
        write_as_applied(found, tmp_path / name, polygons=True)
    assert (tmp_path / "out.geojson").read_text(encoding="utf-8").count("Polygon") == len(found.stretches.time_s)
