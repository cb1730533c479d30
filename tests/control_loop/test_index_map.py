"""A map of the canopy's index beneath the rule: where the heads fall silent the loop goes on by it."""
from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from control.agronomy.crop import Crop
from control.field.job import Job
from control.geodesy import TangentPlane
from control.loop import Tick
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import simulated_run
from control.targets.index_map import MOST_OFF, IndexMap
from control.targets.rate_map import GridMap, frame_m
from drivers.files.setup import Setup, load_setup

CELL_M = 3.0            # as a resampled drone's map has
SEEN_OFF = 0.06         # the drone's camera reads this much less than the heads do
SILENT_S = 50.0


class Run(NamedTuple):
    ticks: list[Tick]
    wanted_kg_ha: np.ndarray        # by the rule, of the canopy at the outlets' place
    target_kg_ha: np.ndarray        # that this place was meant to get
    setup: Setup


def of_canopy(at: Callable[..., np.ndarray], off: float) -> GridMap:
    """Means over cells of the simulated canopy, as a camera from above would have them."""
    easts, norths = np.arange(-30.0, 60.0, CELL_M), np.arange(-30.0, 330.0, CELL_M)
    inner = (np.arange(5) + 0.5) / 5.0 * CELL_M
    e, n, a, b = np.meshgrid(easts, norths, inner, inner, indexing="xy")
    return GridMap(frame_m((-30.0, -30.0), CELL_M, CELL_M), at(e + a, n + b).mean(axis=(2, 3)) - off)


def driven(with_map: bool, heads: str) -> Run:
    """heads: silent_later, never."""
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = with_simulated_field(setup.job, setup.machine)
    plant = simulated_machine(setup.machine, job, 1, 0.05)
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    field = plant._canopy._field
    off = SEEN_OFF if heads == "silent_later" else 0.0
    under = IndexMap(of_canopy(field.many_at, off), plane, setup.machine.geometry.working_width_m) if with_map else None
    loop = control_loop(setup.machine, setup.crop, setup.rule, job, index_map=under)
    inner: Any = loop.tick

    def deaf(m: Any, *rest: Any) -> Tick:
        silent = heads == "never" or m.time_s > SILENT_S
        return inner(m._replace(ndvi=(None,) * len(m.ndvi)) if silent else m, *rest)
    loop.tick = deaf                                                                        # type: ignore[method-assign]
    steps = list(simulated_run(plant, loop, 95.0))
    half = 0.5 * setup.machine.geometry.working_width_m
    aside = np.linspace(-half, half, 7)
    wanted = [setup.rule.decide(float(np.mean(field.many_at(s.truth.east_m + aside, s.truth.north_m + 0.0 * aside)))
                                ).rate_kg_ha for s in steps]
    return Run([s.tick for s in steps], np.array(wanted), np.array([s.target_rate_kg_ha for s in steps]), setup)


def off_kg_ha(run: Run, after_s: float, before_s: float = float("inf")) -> float:
    """Mean distance of the target at the outlets from what the rule says of the canopy there."""
    rows = [tick.row for tick in run.ticks]
    some = [k for k, row in enumerate(rows) if after_s < row.time_s < before_s and row.state == "working"
            and (row.applied_rate_kg_ha or 0.0) > 0.0]
    assert len(some) > 400
    return float(np.mean([abs(run.target_kg_ha[k] - run.wanted_kg_ha[k]) for k in some]))


@pytest.fixture(scope="module")
def by_map() -> Run:
    return driven(True, "silent_later")


def test_the_map_goes_on_where_the_heads_fall_silent(by_map: Run) -> None:
    after = [tick.row for tick in by_map.ticks if tick.row.time_s > SILENT_S + 5.0 and tick.row.state == "working"]
    before = [tick.row for tick in by_map.ticks if 25.0 < tick.row.time_s < SILENT_S]
    assert {row.target_source for row in before} == {"canopy"}
    assert {row.target_source for row in after} == {"index_map"} and all(row.ndvi is not None for row in after)
    assert all("heads_by_map" in (row.alarms or "") and "ndvi_silent" not in (row.alarms or "") for row in after)
    assert len({row.target_rate_kg_ha for row in after}) > 2, "it follows the canopy"


def test_it_is_levelled_to_the_heads_and_nearer_than_the_fallback(by_map: Run) -> None:
    """A map that reads 0.06 too little: learned while the heads speak."""
    alone = driven(False, "silent_later")
    assert {tick.row.target_source for tick in alone.ticks[-40:]} == {"fallback"}
    near, far = (off_kg_ha(run, SILENT_S + 5.0) for run in (by_map, alone))
    heads = off_kg_ha(by_map, 25.0, SILENT_S)
    print(f"from the rule's rate: index map {near:.1f} kg/ha, fallback {far:.1f} kg/ha, heads before {heads:.1f}")
    assert near < 0.6 * far


def test_a_machine_without_heads_goes_by_the_map_alone() -> None:
    run = driven(True, "never")
    print(f"no heads at all: {off_kg_ha(run, 30.0):.1f} kg/ha from the rule's rate")
    worked = [tick.row for tick in run.ticks if tick.row.time_s > 30.0 and tick.row.state == "working"]
    assert {row.target_source for row in worked} == {"index_map"}


def test_where_the_map_has_nothing_the_fallback_holds_and_wild_differences_are_not_taken() -> None:
    plane = TangentPlane(52.0, 9.0)
    under = IndexMap(GridMap(frame_m((0.0, 0.0), 10.0, 10.0), [[0.5, np.nan], [0.7, 0.6]]), plane, 4.0)
    assert under.at((5.0, 5.0), 0.0) == pytest.approx(0.5) and under.at((15.0, 5.0), 0.0) is None
    assert under.at((500.0, 5.0), 0.0) is None and under.at((10.0, 5.0), 0.0) == pytest.approx(0.5), "half of it"
    for _ in range(50):
        under.learn(0.9, 0.2)
    assert under.off == MOST_OFF
    fresh = IndexMap(GridMap(frame_m((0.0, 0.0), 10.0, 10.0), [[0.5]]), plane, 4.0)
    for k in range(400):
        fresh.learn(0.55 + 0.02 * (-1) ** k, 0.5)
    assert fresh.off == pytest.approx(0.05, abs=0.002) and fresh.levelled(0.4) == pytest.approx(0.45, abs=0.002)


def write_tif(path: Path, values: np.ndarray, lat: float, lon: float, size_deg: float, name: str | None = None) -> Path:
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    with rasterio.open(path, "w", driver="GTiff", width=values.shape[1], height=values.shape[0], count=1,
                       dtype="float32", crs="EPSG:4326", nodata=-9999.0,
                       transform=rasterio.transform.from_origin(lon, lat, size_deg, size_deg)) as file:
        file.write(values.astype(np.float32), 1)
        if name:
            file.set_band_description(1, name)
    return path


@pytest.mark.parametrize("name", [None, "NDVI"])
def test_a_job_names_a_geotiff(tmp_path: Path, name: str | None) -> None:
    """As a satellite gives it: water below 0, a band with or without a name; what is scaled is refused."""
    from drivers.files.prescriptions.for_job import placed_of_job
    from drivers.files.prescriptions.words import PrescriptionError
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job: Job = setup.job.model_copy(update={"target": setup.job.target.model_copy(update={"index_map": "a.tif"})})
    crop: Crop = setup.crop
    values = np.array([[0.3, 0.4], [-0.1, -9999.0]])
    write_tif(tmp_path / "a.tif", values, 34.282, 119.880, 0.001, name)
    under = placed_of_job(job, tmp_path, setup.machine, crop.index)["index_map"]
    assert under is not None
    read = [under.at(under.plane.to_m(34.282 - 0.0005 - 0.001 * row, 119.8805 + 0.001 * column), 0.0)
            for row in (0, 1) for column in (0, 1)]
    assert read[:3] == pytest.approx([0.3, 0.4, 0.0]) and read[3] is None
    write_tif(tmp_path / "a.tif", 10_000.0 * values.clip(0.0), 34.282, 119.880, 0.001, name)
    with pytest.raises(PrescriptionError, match="allowed as NDVI is -1 to 1"):
        placed_of_job(job, tmp_path, setup.machine, crop.index)
