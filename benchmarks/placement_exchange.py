"""What goes in and out as files: `python -m benchmarks placement_exchange TASK_FOLDER... [--seconds S]`.

Each task file: zones or cells, rates with units, totals; written again as a task and read back equal. Then one
simulated run on the shipped map job, exported as shapefile, GeoJSON and ISO 11783-10 task, and read back by pyshp,
shapely, geopandas and isoxml (the last two where they are installed): totals next to those of the log.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import shapefile
from shapely.geometry import shape
from typer.testing import CliRunner
from verdict import exit_code

from console.cli import app
from control.targets.prescription import MapData, statistics
from drivers.files.exports.as_applied import as_applied
from drivers.files.exports.write import write_as_applied
from drivers.files.prescriptions.read import read_prescription
from drivers.files.prescriptions.words import Choice, PrescriptionError
from drivers.files.prescriptions.write import write_prescription
from drivers.files.read_log import read_log

DENSITY_KG_L = 1.32             # of a liquid fertiliser (UAN), for a task in volumes
CHOICES = (Choice(), Choice(rate_from="presentation"), Choice(density_kg_l=DENSITY_KG_L))


def task(folder: Path) -> bool:
    """Tell one task file and whether what was written again reads back equal."""
    read = None
    for choice in CHOICES:
        try:
            read = read_prescription(folder, choice)
            break
        except PrescriptionError as error:
            print(f"{folder.name}: {str(error).split(': ', 1)[1]}")
    if read is None:
        return False
    shares = statistics(read.data)
    grid = read.data.grid
    size = f"{len(read.data.zones)} zones" if grid is None else "{} x {} cells".format(*grid.rate_kg_ha.shape)
    print(f"{folder.name}: {size}, {len(shares)} rates from {shares[0].rate_kg_ha:.2f} to {shares[-1].rate_kg_ha:.2f} "
          f"kg/ha (numbers in {read.unit}, {read.factor:g} kg/ha each), {sum(s.area_ha for s in shares):.4f} ha, "
          f"{sum(s.mass_kg for s in shares):.2f} kg; elsewhere {read.data.fallbacks.default_kg_ha:g}, outside "
          f"{read.data.fallbacks.outside_kg_ha:g}, position lost {read.data.fallbacks.lost_kg_ha:g} kg/ha")
    with tempfile.TemporaryDirectory() as place:
        write_prescription(read.data, Path(place) / "again.zip")
        again = read_prescription(Path(place) / "again.zip")
    equal = same(read.data, again.data)
    print(f"{folder.name}: written again and read back: {'equal' if equal else 'DIFFERENT'}")
    return equal


def same(one: MapData, other: MapData) -> bool:
    """Zones, grid, fields and fallbacks; rates to the task file's hundredth of a kg/ha."""
    if len(one.zones) != len(other.zones) or (one.grid is None) != (other.grid is None):
        return False
    rings = [(a, b) for x, y in zip(one.zones, other.zones, strict=True)
             for a, b in zip(x.rings_deg, y.rings_deg, strict=True)]
    rings += [(a, b) for x, y in zip(one.fields_deg, other.fields_deg, strict=True)
              for a, b in zip(x, y, strict=True)]
    rates = [(x.rate_kg_ha, y.rate_kg_ha) for x, y in zip(one.zones, other.zones, strict=True)]
    if one.grid is not None and other.grid is not None:
        if one.grid[:4] != other.grid[:4]:
            return False
        rates += list(zip(one.grid.rate_kg_ha.ravel(), other.grid.rate_kg_ha.ravel(), strict=True))
    close = np.allclose(*np.array(rates).T, rtol=0.0, atol=0.005 + 1e-9, equal_nan=True)
    return bool(close and all(np.array_equal(a, b) for a, b in rings) and one.fallbacks == other.fallbacks)


def exports(seconds: float) -> bool:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        done = CliRunner().invoke(app, ["simulate", "--job", "map_demo", "--seconds", str(seconds), "--out",
                                        str(folder / "run.csv")])
        assert done.exit_code == 0, done.output
        applied = as_applied(read_log(folder / "run.csv"))
        totals = applied.totals
        wanted = (totals.applied_kg, totals.target_kg, 10_000.0 * totals.area_ha)
        print(f"log: {wanted[0]:.6f} kg applied, {wanted[1]:.6f} kg target, {wanted[2]:.4f} m2, "
              f"{len(applied.stretches.time_s)} stretches")
        for ending in (".shp", ".geojson", ""):
            write_as_applied(applied, folder / f"a{ending}", polygons=True)
        found = [("shapefile by pyshp", *_pyshp(folder / "a.shp")),
                 ("GeoJSON by shapely", *_shapely(folder / "a.geojson"))]
        found += _geopandas(folder) + _isoxml(folder / "a" / "TASKDATA.XML")
        good = totals.applied_kg > 0.0 and totals.area_ha > 0.0
        for name, *got in found:
            off = [None if value is None else value - true for value, true in zip(got, wanted, strict=True)]
            good &= all(gap is None or abs(gap) <= 0.0006 for gap in off[:2]) and abs(off[2] or 0.0) <= 0.6
            read_back = ", ".join(f"{label} {'not in the format' if value is None else f'{value:.6f} ({gap:+.1e})'}"
                             for label, value, gap in zip(("applied kg", "target kg", "m2"), got, off, strict=True))
            print(f"{name}: {read_back}")
    return good


def _pyshp(path: Path) -> tuple[float, float, float]:
    with shapefile.Reader(str(path)) as reader:
        records = reader.records()
    return tuple(float(sum(r[name] for r in records)) for name in ("APPLIED_KG", "TARGET_KG", "AREA_M2"))  # type: ignore[return-value]


def _shapely(path: Path) -> tuple[float, float, float]:
    features = json.loads(path.read_text())["features"]
    assert all(shape(f["geometry"]).is_valid for f in features)
    return tuple(sum(f["properties"][name] for f in features) for name in ("applied_kg", "target_kg", "area_m2"))  # type: ignore[return-value]


def _geopandas(folder: Path) -> list[tuple[Any, ...]]:
    try:
        import geopandas
    except ImportError:
        print("geopandas: not installed")
        return []
    frames = [("GeoJSON by geopandas", geopandas.read_file(folder / "a.geojson"), str.lower),
              ("shapefile by geopandas", geopandas.read_file(folder / "a.shp"), str.upper)]
    return [(name, *(float(frame[case(column)].sum()) for column in ("applied_kg", "target_kg", "area_m2")))
            for name, frame, case in frames]


def _isoxml(path: Path) -> list[tuple[Any, ...]]:
    try:
        from isoxml.models.ddi_entities import DDEntity
        from isoxml.util.isoxml_io import isoxml_from_path
    except ImportError:
        print("isoxml: not installed")
        return []
    task_data, _ = isoxml_from_path(path, "ignore", read_bin_files=False)
    totals = {}
    for value in task_data.tasks[0].times[0].data_log_values:
        entity = DDEntity.from_bytes(value.process_data_ddi)
        totals[entity.name] = value.process_data_value * entity.bit_resolution
    return [("task by isoxml (whole g and m2)", totals["Application Total Mass in gram [g]"] / 1000.0, None,
             totals["Total Area"])]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--seconds", type=float, default=300.0)
    given = parser.parse_args()
    results: dict[str, object] = {f"{folder}: written again and read back equal": task(folder)
                                  for folder in given.folders}
    sys.exit(exit_code(results | {"something was applied, and every export says as much": exports(given.seconds)}))
