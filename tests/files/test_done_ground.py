"""Ground that another program has covered: read from AgOpenGPS and from polygons, and not spread again."""
from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import Result

from control.field.coverage import Coverage
from control.field.done_ground import done_ground
from control.geodesy import TangentPlane
from control.orders import TargetSource
from drivers.files.config import load
from drivers.files.fields.agopengps import covered_triangles, read_agopengps, write_agopengps
from drivers.files.fields.done import read_done
from drivers.files.fields.field_data import FieldData, FieldError
from drivers.files.kinds import JOB
from drivers.files.read_log import read_log

HERE = TangentPlane(34.28, 119.88)      # as the shipped demo job has it


def degrees(*places: tuple[float, float]) -> np.ndarray:
    return np.array([HERE.to_deg(*place) for place in places])


def strip(begin: tuple[float, float], heading_deg: float, long_m: float, wide_m: float,
          bend_deg: float = 0.0) -> list[str]:
    """As AgOpenGPS keeps a section that was on: rows, colour, then left and right edge by turns every metre."""
    east, north, rows = *begin, ["27, 151, 160"]
    for k in range(round(long_m) + 1):
        angle = math.radians(heading_deg + bend_deg * k / long_m)
        right = math.cos(angle), -math.sin(angle)
        rows += [f"{east + side * wide_m * right[0]:.3f},{north + side * wide_m * right[1]:.3f},0"
                 for side in (-0.5, 0.5)]
        east, north = east + math.sin(angle), north + math.cos(angle)
    return [str(len(rows)), *rows]


def aog_field(folder: Path, strips: list[list[str]]) -> Path:
    """Its start fix is HERE."""
    square = FieldData("North", degrees((-200, -200), (-200, 200), (200, 200), (200, -200)))
    write_agopengps(square, folder)
    text = (folder / "Field.txt").read_text()
    fix = text.rindex("StartFix")
    (folder / "Field.txt").write_text(text[:fix] + "StartFix\n34.2800000,119.8800000\n")
    (folder / "Sections.txt").write_text("\r\n".join(line for one in strips for line in one) + "\r\n")
    return folder


PASSES = [strip((0.0, 0.0), 0.0, 120.0, 6.0), strip((5.0, 0.0), 0.0, 120.0, 6.0),       # 1 m over one another
          strip((20.0, -30.0), 30.0, 80.0, 12.0, bend_deg=70.0), ["3", "1, 2, 3", "5.0,5.0,0", "5.0,5.0,0"]]


def test_areas_are_those_of_a_geopandas_union(tmp_path: Path, topdress: Callable[..., Result]) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    folder = aog_field(tmp_path / "north", PASSES)
    triangles = covered_triangles(folder)
    frame = geopandas.GeoSeries([shapely.Polygon(one[:, ::-1]) for one in triangles], crs="EPSG:4326")
    whole = frame.to_crs("+proj=laea +lat_0=34.28 +lon_0=119.88").union_all()
    found = read_done(folder)
    assert found.area_ha == pytest.approx(whole.area / 10_000.0, rel=1e-4)
    cells = found.raster.done.sum() * found.raster.cell_m ** 2 / 10_000.0
    print(f"geopandas {whole.area / 10_000.0:.5f} ha, ours {found.area_ha:.5f} ha, by cells {cells:.5f} ha")
    assert cells == pytest.approx(whole.area / 10_000.0, rel=5e-3)
    assert sum(shapely.Polygon(one).area for one in HERE.many_to_m(
        triangles[..., 0].ravel(), triangles[..., 1].ravel()).reshape(-1, 3, 2)) / 10_000.0 > 1.02 * found.area_ha
    said = topdress("field", folder)
    assert f"{found.area_ha:.3f} ha are marked as worked in Sections.txt: --done takes them" in said.output
    told = topdress("field", folder / "Sections.txt", "--done")
    assert told.exit_code == 0 and f"done         {found.area_ha:.4f} ha, each place once" in told.output, told.output


@pytest.mark.parametrize("name", ["a.geojson", "a.kml", "a.gpkg", "a.shp"])
def test_polygons_of_any_format(name: str, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    ring = degrees((0, 0), (0, 50), (40, 50), (40, 0))
    hole = degrees((10, 10), (10, 20), (20, 20), (20, 10))
    over = degrees((30, 0), (30, 50), (60, 50), (60, 0))
    shapes = [shapely.Polygon(ring[:, ::-1], [hole[:, ::-1]]), shapely.Polygon(over[:, ::-1])]
    geopandas.GeoDataFrame({"Name": ["a", "b"]}, geometry=shapes, crs="EPSG:4326").to_file(tmp_path / name)
    found = read_done(tmp_path / name, HERE)
    assert found.area_ha == pytest.approx((60 * 50 - 100) / 10_000.0, rel=1e-6)
    coverage = Coverage(2.4)
    coverage.seed(found.raster, ours=False)
    assert coverage.covered.area_ha == 0.0, "another machine's ground is no area of ours"
    inside = coverage.applied_earlier([(5.0, 5.0), (15.0, 15.0), (55.0, 25.0), (61.0, 25.0), (-1.0, 5.0)])
    assert inside.tolist() == [True, False, True, False, False]


def test_cells_are_those_whose_middle_lies_in_it() -> None:
    rng = np.random.default_rng(3)
    shapes = np.array([shapely.Polygon(rng.uniform(-20.0, 20.0, (5, 2))).buffer(0.0) for _ in range(12)] + [
        shapely.Point(3.0, 4.0).buffer(6.0).difference(shapely.Point(3.0, 4.0).buffer(3.0))], dtype=object)
    found = done_ground(shapes, HERE, 0.25)
    rows, columns = found.raster.done.shape
    east = found.raster.west_m + (np.arange(columns) + 0.5) * 0.25
    north = found.raster.south_m + (np.arange(rows) + 0.5) * 0.25
    e, n = np.meshgrid(east, north)
    assert (found.raster.done == shapely.contains_xy(shapely.union_all(shapes), e, n)).all()


def test_the_job_does_not_spread_there(tmp_path: Path, topdress: Callable[..., Result]) -> None:
    """Half of the first pass is done by another: nothing on it, all as usual beyond."""
    folder = aog_field(tmp_path / "north", [strip((0.0, 20.0), 0.0, 30.0, 8.0)])
    made = topdress("field", folder, "--done", "--out", tmp_path / "job.yaml")
    assert made.exit_code == 0 and "written" in made.output, made.output
    job = load(tmp_path / "job.yaml", JOB).model
    assert job.field.done == str(folder.resolve())
    assert topdress("check", tmp_path / "job.yaml").exit_code == 0
    ran = topdress("simulate", "--job", tmp_path / "job.yaml", "--seconds", "70", "--seed", "1", "--out",
                   tmp_path / "run.csv")
    assert ran.exit_code == 0, ran.output
    log = read_log(tmp_path / "run.csv")
    north = (log.numbers("lat_deg") - 34.28) * 110_900.0 - 1.0              # about, of the outlets behind the antenna
    rate, flows = log.numbers("target_rate_kg_ha"), np.nan_to_num(log.numbers("applied_rate_kg_ha")) > 20.0
    working = log.texts("state") == "working"
    there = working & (north > 27.0) & (north < 45.0)
    assert there.sum() > 150 and not flows[there].any() and (rate[there] == 0.0).all()
    beyond = working & (north > 56.0)
    assert beyond.sum() > 100 and flows[beyond].mean() > 0.95
    assert flows[working & (north < 14.0) & (north > 5.0)].all()
    assert TargetSource.CANOPY.value in set(log.texts("target_source")[beyond])


def test_what_is_no_done_ground_is_one_line(tmp_path: Path, topdress: Callable[..., Result]) -> None:
    folder = aog_field(tmp_path / "north", [])
    with pytest.raises(FieldError, match=r"no ground is marked as worked in Sections.txt"):
        read_done(folder)
    (folder / "Sections.txt").write_text("9\r\n1, 2, 3\r\n1.0,2.0,0\r\n")
    with pytest.raises(FieldError, match=r"Sections.txt: '': allowed is a place"):
        read_done(folder)
    with pytest.raises(FieldError, match=r"Sections.txt: '': allowed is a place"):
        read_agopengps(folder)
    boundary = folder / "Boundary.txt"
    boundary.write_bytes(boundary.read_text().encode("utf-16"))
    (folder / "Sections.txt").unlink()
    assert read_agopengps(folder).outline_deg is not None, "saved by an editor as UTF-16"
    with pytest.raises(FieldError, match=r"north: no Sections.txt: allowed is"):
        read_done(folder)
    with pytest.raises(FieldError, match="no such file: allowed is a field of AgOpenGPS"):
        read_done(tmp_path / "gone")
    aog_field(tmp_path / "other", [strip((0.0, 20.0), 0.0, 30.0, 8.0)])
    wrong = topdress("field", tmp_path / "other", "--done", "--out", tmp_path / "a.kml")
    assert wrong.exit_code == 2 and "allowed with --done is a job" in wrong.output
    with pytest.raises(ValueError, match="no ground"):
        done_ground(np.array([shapely.Polygon()], dtype=object), HERE)
    with pytest.raises(ValueError, match="allowed are 16 km2 for one field"):
        done_ground(np.array([shapely.box(0, 0, 5000, 5000)], dtype=object), HERE)
