"""Fields of AgOpenGPS, KML, KMZ, GeoPackage and GeoJSON: in as a job's field, out, and back with nothing moved."""
from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import Result

from control.field.job import Job
from drivers.files.config import load
from drivers.files.fields.agopengps import read_agopengps, write_agopengps
from drivers.files.fields.field_data import FieldData, FieldError, Line, data_of, ground_of
from drivers.files.fields.shapes import read_shapes, write_shapes
from drivers.files.kinds import JOB

HERE = np.array([52.1234567, 9.7654321])


def around(*places: tuple[float, float]) -> np.ndarray:
    """Metres north and east as degrees about HERE, roughly."""
    return HERE + np.array(places) / (111_300.0, 68_500.0)


FIELD = FieldData("Nordfeld 李", around((0, 0), (0, 400), (260, 420), (300, 10)),
                  (around((100, 100), (100, 130), (130, 120)),),
                  (Line("AB 1", around((0, 5), (300, 12))),
                   Line("Curve", around((0, 9), (80, 11), (190, 9), (290, 17)))),
                  12.0)


def farthest_m(one: FieldData, other: FieldData) -> float:
    plane = one.plane()
    pairs = [(one.outline_deg, other.outline_deg), *zip(one.holes_deg, other.holes_deg, strict=True),
             *((a.places_deg, b.places_deg) for a, b in zip(one.lines, other.lines, strict=True))]
    return max(float(np.hypot(*(plane.many_to_m(*a.T) - plane.many_to_m(*b.T)).T).max())
               for a, b in pairs if a is not None and b is not None)


@pytest.mark.parametrize(("name", "most_m"), [("a.kml", 1e-6), ("a.kmz", 1e-6), ("a.gpkg", 1e-6), ("a.geojson", 1e-6),
                                              ("field", 0.002)])
def test_there_and_back(name: str, most_m: float, tmp_path: Path) -> None:
    if "." in name and not name.endswith("json"):
        pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    path = tmp_path / name
    (write_shapes if path.suffix else write_agopengps)(FIELD, path)
    back = read_shapes(path) if path.suffix else read_agopengps(path)
    assert farthest_m(FIELD, back) < most_m
    assert [line.title for line in back.lines] == ["AB 1", "Curve"]
    if path.suffix:
        assert back.title == FIELD.title
    else:
        assert back.headland_m == pytest.approx(12.0, abs=0.01)


@pytest.mark.parametrize("name", ["a.kml", "a.gpkg"])
def test_others_read_the_same(name: str, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    write_shapes(FIELD, tmp_path / name)
    frame = geopandas.read_file(tmp_path / name).to_crs("EPSG:32632")
    area = float(frame[frame.geom_type == "Polygon"].area.sum()) / 10_000.0
    boundary = FIELD.boundary(FIELD.plane())
    assert boundary is not None and area == pytest.approx(boundary.area_ha, rel=1e-3)       # UTM's scale


def test_into_a_job_and_out_again(topdress: Callable[..., Result], tmp_path: Path) -> None:
    write_agopengps(FIELD, tmp_path / "north")
    done = topdress("field", tmp_path / "north", "--job", "demo", "--line", "AB 1", "--out", tmp_path / "job.yaml")
    assert done.exit_code == 0 and "1 obstacles taken out" in done.output, done.output
    job = load(tmp_path / "job.yaml", JOB).model
    assert isinstance(job, Job) and len(job.field.holes_m) == 1 and len(job.field.lines) == 2
    boundary = job.field.boundary()
    assert boundary is not None
    hole = shapely.Polygon(job.field.holes_m[0]).centroid
    assert not boundary.contains(hole.x, hole.y)
    assert job.field.pass_heading_deg == pytest.approx(1.337, abs=0.02) and job.field.headland_m == pytest.approx(12.0)
    again = topdress("field", tmp_path / "job.yaml", "--out", tmp_path / "again.geojson")
    assert again.exit_code == 0
    assert farthest_m(FIELD, read_shapes(tmp_path / "again.geojson")) < 0.002
    assert topdress("check", tmp_path / "job.yaml").exit_code == 0


@pytest.mark.parametrize("shapes", [
    (shapely.box(9.0, 52.0, 9.01, 52.01), shapely.box(9.02, 52.0, 9.03, 52.01)),
    (shapely.Polygon([(9.0, 52.0), (9.024, 52.02), (9.0244, 52.0), (9.0, 52.02)]),      # crosses itself
     shapely.box(9.01, 52.0, 9.012, 52.005))], ids=["apart", "crossed"])
def test_what_is_not_one_field_is_asked(topdress: Callable[..., Result], tmp_path: Path,
                                        shapes: tuple[shapely.Polygon, shapely.Polygon]) -> None:
    path = tmp_path / "two.geojson"
    path.write_text('{"type": "FeatureCollection", "features": [' + ", ".join(
        f'{{"type": "Feature", "properties": {{"name": "{name}"}}, "geometry": {shapely.to_geojson(shape)}}}'
        for name, shape in zip(("West", "East"), shapes, strict=True)) + "]}")
    asked = topdress("field", path)
    assert asked.exit_code == 2 and "2 fields: allowed with --name is one of West (" in asked.output
    assert topdress("field", path, "--name", "East").exit_code == 0
    write_shapes(FIELD, tmp_path / "lines.geojson")
    lines = topdress("field", tmp_path / "lines.geojson", "--out", tmp_path / "job.yaml")
    assert lines.exit_code == 2 and "run different ways" in lines.output and not (tmp_path / "job.yaml").exists()


def test_an_outline_that_crosses_itself_says_where_and_offers_its_largest_part(topdress: Callable[..., Result],
                                                                               tmp_path: Path) -> None:
    knot = np.array([(52.0, 9.0), (52.01, 9.0), (52.01, 9.01), (51.999, 9.009), (51.999, 9.01)])
    write_agopengps(FieldData("FieldNew", knot), tmp_path / "Long acre")
    refused = topdress("field", tmp_path / "Long acre", "--out", tmp_path / "job.yaml")
    assert refused.exit_code == 2 and not (tmp_path / "job.yaml").exists() and len(refused.output.splitlines()) == 1
    assert "crosses itself at 51.999099, 9.0" in refused.output
    assert "--largest takes its largest part, " in refused.output
    taken = topdress("field", tmp_path / "Long acre", "--largest", "--out", tmp_path / "job.yaml")
    assert taken.exit_code == 0, taken.output
    field = load(tmp_path / "job.yaml", JOB).model.field
    expected = max(shapely.get_parts(shapely.make_valid(shapely.Polygon(knot))), key=shapely.area)
    assert field.title == "Long acre", "by its folder: AgOpenGPS writes FieldNew in each"
    assert len(field.boundary_m) == len(expected.exterior.coords) - 1


def test_polygons_of_one_name_are_chosen_by_their_number(topdress: Callable[..., Result], tmp_path: Path) -> None:
    path = tmp_path / "strips.geojson"
    path.write_text('{"type": "FeatureCollection", "features": [' + ", ".join(
        f'{{"type": "Feature", "properties": {{"name": "{name}"}}, '
        f'"geometry": {shapely.to_geojson(shapely.box(9.0 + 0.1 * k, 52.0, 9.01 + 0.1 * k, 52.01))}}}'
        for k, name in enumerate(("strip", "strip", ""))) + "]}")
    asked = topdress("field", path)
    assert asked.exit_code == 2
    assert "one of strip 1 (76.41 ha), strip 2 (76.41 ha), polygon 3 (76.41 ha)" in asked.output
    assert "field        strip 2:" in topdress("field", path, "--name", "Strip 2").output


def test_damaged_fields_are_one_line(tmp_path: Path) -> None:
    write_agopengps(FIELD, tmp_path / "north")
    boundary = tmp_path / "north" / "Boundary.txt"
    text = boundary.read_text()
    for wrong in (text[:60], text.replace("4\n", "999999999\n", 1), text.replace("4\n", "x\n", 1)):
        boundary.write_text(wrong)
        with pytest.raises(FieldError, match=r"Boundary.txt: .*allowed is"):
            read_agopengps(tmp_path / "north")
    (tmp_path / "north" / "Field.txt").write_text("nothing")
    with pytest.raises(FieldError, match="no StartFix"):
        read_agopengps(tmp_path / "north")


def test_a_line_alone_keeps_the_jobs_field() -> None:
    before = ground_of(FIELD, Job().field, "AB 1")
    plane_before = (before.origin_lat_deg, before.origin_lon_deg)
    after = ground_of(FieldData("x", lines=(FIELD.lines[0],)), before)
    assert (after.origin_lat_deg, after.origin_lon_deg) == plane_before and after.boundary_m == before.boundary_m
    assert farthest_m(data_of(after, "x"), FieldData("x", FIELD.outline_deg, FIELD.holes_deg, FIELD.lines[:1])) < 1e-3


def write_shp(path: Path, shapes: list[shapely.Geometry], names: list[str], crs: str = "EPSG:4326",
              encoding: str = "utf-8", column: str = "Name") -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    path.parent.mkdir(parents=True, exist_ok=True)
    frame = geopandas.GeoDataFrame({column: names}, geometry=shapes, crs="EPSG:4326")
    frame.to_crs(crs).to_file(path, encoding=encoding)


OUTLINE = shapely.Polygon(FIELD.outline_deg[:, ::-1], [hole[:, ::-1] for hole in FIELD.holes_deg])
TRACKS = [shapely.LineString(line.places_deg[:, ::-1]) for line in FIELD.lines]


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32632"])
@pytest.mark.parametrize("packed", ["shp", "folder", "zip"])
def test_shapefiles_of_an_outline_and_of_lines(topdress: Callable[..., Result], tmp_path: Path, packed: str,
                                               crs: str) -> None:
    """As geopandas writes them: polygons in one, lines in another; a folder or a zip has both."""
    folder = tmp_path / "north"
    write_shp(folder / "outline.shp", [OUTLINE], ["Nordfeld 李"], crs, column="FIELD_NAME")
    write_shp(folder / "lines.shp", TRACKS, ["AB 1", "Curve"], crs)
    if packed == "shp":
        alone = read_shapes(folder / "outline.shp")
        lines = read_shapes(folder / "lines.shp")
        assert lines.outline_deg is None and not alone.lines
        back = FieldData(alone.title, alone.outline_deg, alone.holes_deg, lines.lines)
        source = folder / "outline.shp"
    else:
        source = folder if packed == "folder" else Path(shutil.make_archive(str(tmp_path / "both"), "zip", folder))
        back = read_shapes(source)
    assert back.title == "Nordfeld 李" and {line.title for line in back.lines} == {"AB 1", "Curve"}
    assert back.outline_deg is not None and back.outline_deg.shape == (4, 2) and len(back.holes_deg) == 1
    told = topdress("field", source)
    assert told.exit_code == 0 and "1 obstacles taken out" in told.output, told.output
    plane = FIELD.plane()
    for one, other in ((shapely.Polygon(plane.many_to_m(*back.outline_deg.T)),
                        shapely.Polygon(plane.many_to_m(*FIELD.outline_deg.T))),
                       *((shapely.LineString(plane.many_to_m(*line.places_deg.T)),
                          shapely.LineString(plane.many_to_m(*next(
                              same.places_deg for same in FIELD.lines if same.title == line.title).T)))
                         for line in back.lines)):
        assert shapely.hausdorff_distance(one, other) < (1e-6 if crs == "EPSG:4326" else 2e-3)


def test_shapefiles_that_are_none_are_one_line(topdress: Callable[..., Result], tmp_path: Path) -> None:
    write_shp(tmp_path / "a.shp", [OUTLINE], ["North"], "ESRI:102003")      # Albers: in no register of PROJ's as EPSG
    said = topdress("field", tmp_path / "a.shp")
    assert said.exit_code == 2 and "Albers" in said.output and "allowed are degrees on WGS84, or UTM" in said.output
    write_shp(tmp_path / "points.shp", [shapely.Point(9.0, 52.0)], ["tree"])
    said = topdress("field", tmp_path / "points.shp")
    assert said.exit_code == 2 and "shapes of type POINT: allowed are polygons" in said.output
    write_shp(tmp_path / "utm.shp", [OUTLINE], ["North"], "EPSG:32632")
    (tmp_path / "utm.prj").unlink()
    said = topdress("field", tmp_path / "utm.shp")
    assert said.exit_code == 2 and "no .prj that says in what" in said.output
    (tmp_path / "none").mkdir()
    said = topdress("field", tmp_path / "none")
    assert said.exit_code == 2 and "no shapefile and no field of AgOpenGPS" in said.output
    for cut in (0, 60, 120, 170):
        data = (tmp_path / "points.shp").read_bytes() if cut == 0 else b""
        write_shp(tmp_path / "b.shp", [OUTLINE], ["North"])
        whole = (tmp_path / "b.shp").read_bytes()
        (tmp_path / "b.shp").write_bytes(data or whole[:cut])
        said = topdress("field", tmp_path / "b.shp")
        assert said.exit_code == 2 and len(said.output.splitlines()) == 1 and "b.shp" in said.output, (cut, said.output)
