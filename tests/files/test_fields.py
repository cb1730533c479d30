"""Fields of AgOpenGPS, KML, KMZ, GeoPackage and GeoJSON: in as a job's field, out, and back
with nothing moved."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import Result
from topdress.control.field.coverage import Coverage
from topdress.control.field.done_ground import rasterise_ground
from topdress.control.field.job import Job
from topdress.control.geodesy import TangentPlane
from topdress.control.orders import TargetSource
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import JOB_KIND
from topdress.drivers.files.fields.agopengps import (
    read_agopengps,
    read_worked_triangles,
    write_agopengps,
)
from topdress.drivers.files.fields.field_data import (
    FieldData,
    FieldError,
    FieldLine,
    build_field_data,
    build_job_ground,
)
from topdress.drivers.files.fields.shapes import read_field_shapes
from topdress.drivers.files.fields.worked_area import read_worked_area
from topdress.drivers.files.formats.registry import find_writer
from topdress.drivers.files.read_log import read_log

from tests.geojson import feature, geojson

HERE = np.array([52.1234567, 9.7654321])


def around(*places: tuple[float, float]) -> np.ndarray:
    """Metres north and east as degrees about HERE, roughly."""
    return HERE + np.array(places) / (111_300.0, 68_500.0)


FIELD = FieldData(
    "Nordfeld 李",
    around((0, 0), (0, 400), (260, 420), (300, 10)),
    (around((100, 100), (100, 130), (130, 120)),),
    (
        FieldLine("AB 1", around((0, 5), (300, 12))),
        FieldLine("Curve", around((0, 9), (80, 11), (190, 9), (290, 17))),
    ),
    12.0,
)


def farthest_m(one: FieldData, other: FieldData) -> float:
    plane = one.plane()
    pairs = [
        (one.outline_deg, other.outline_deg),
        *zip(one.holes_deg, other.holes_deg, strict=True),
        *((a.places_deg, b.places_deg) for a, b in zip(one.lines, other.lines, strict=True)),
    ]
    return max(
        float(np.hypot(*(plane.project_many_to_m(*a.T) - plane.project_many_to_m(*b.T)).T).max())
        for a, b in pairs
        if a is not None and b is not None
    )


@pytest.mark.parametrize(
    ("name", "most_m"),
    [("a.kml", 1e-6), ("a.kmz", 1e-6), ("a.gpkg", 1e-6), ("a.geojson", 1e-6), ("field", 0.002)],
)
def test_there_and_back(name: str, most_m: float, tmp_path: Path) -> None:
    if "." in name and not name.endswith("json"):
        pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    path = tmp_path / name
    find_writer(path, "write_field").write_field(FIELD, path)
    back = read_field_shapes(path) if path.suffix else read_agopengps(path)
    assert farthest_m(FIELD, back) < most_m
    assert [line.title for line in back.lines] == ["AB 1", "Curve"]
    if path.suffix:
        assert back.title == FIELD.title
    else:
        assert back.headland_m == pytest.approx(12.0, abs=0.01)


@pytest.mark.parametrize("name", ["a.kml", "a.gpkg"])
def test_others_read_the_same(name: str, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    find_writer(tmp_path / name, "write_field").write_field(FIELD, tmp_path / name)
    frame = geopandas.read_file(tmp_path / name).to_crs("EPSG:32632")
    area = float(frame[frame.geom_type == "Polygon"].area.sum()) / 10_000.0
    boundary = FIELD.boundary(FIELD.plane())
    # UTM's scale
    assert boundary is not None and area == pytest.approx(boundary.area_ha, rel=1e-3)


def test_into_a_job_and_out_again(topdress: Callable[..., Result], tmp_path: Path) -> None:
    write_agopengps(FIELD, tmp_path / "north")
    done = topdress(
        "field",
        tmp_path / "north",
        "--job",
        "demo",
        "--line",
        "AB 1",
        "--out",
        tmp_path / "job.yaml",
    )
    assert done.exit_code == 0 and "1 obstacles taken out" in done.output, done.output
    job = load_config(tmp_path / "job.yaml", JOB_KIND).model
    assert isinstance(job, Job) and len(job.field.holes_m) == 1 and len(job.field.lines) == 2
    boundary = job.field.make_boundary()
    assert boundary is not None
    hole = shapely.Polygon(job.field.holes_m[0]).centroid
    assert not boundary.contains_place(hole.x, hole.y)
    assert job.field.pass_heading_deg == pytest.approx(
        1.337, abs=0.02
    ) and job.field.headland_m == pytest.approx(12.0)
    again = topdress("field", tmp_path / "job.yaml", "--out", tmp_path / "again.geojson")
    assert again.exit_code == 0
    assert farthest_m(FIELD, read_field_shapes(tmp_path / "again.geojson")) < 0.002
    assert topdress("check", tmp_path / "job.yaml").exit_code == 0


@pytest.mark.parametrize(
    "shapes",
    [
        (shapely.box(9.0, 52.0, 9.01, 52.01), shapely.box(9.02, 52.0, 9.03, 52.01)),
        # crosses itself
        (
            shapely.Polygon([(9.0, 52.0), (9.024, 52.02), (9.0244, 52.0), (9.0, 52.02)]),
            shapely.box(9.01, 52.0, 9.012, 52.005),
        ),
    ],
    ids=["apart", "crossed"],
)
def test_what_is_not_one_field_is_asked(
    topdress: Callable[..., Result], tmp_path: Path, shapes: tuple[shapely.Polygon, shapely.Polygon]
) -> None:
    path = geojson(
        tmp_path / "two.geojson",
        *(
            feature([list(shape.exterior.coords)], name=name)
            for name, shape in zip(("West", "East"), shapes, strict=True)
        ),
    )
    asked = topdress("field", path)
    assert asked.exit_code == 2 and "2 fields: allowed with --name is one of West (" in asked.output
    assert topdress("field", path, "--name", "East").exit_code == 0
    find_writer(Path("a.json"), "write_field").write_field(FIELD, tmp_path / "lines.geojson")
    lines = topdress("field", tmp_path / "lines.geojson", "--out", tmp_path / "job.yaml")
    assert (
        lines.exit_code == 2
        and "run different ways" in lines.output
        and not (tmp_path / "job.yaml").exists()
    )


def test_an_outline_that_crosses_itself_says_where_and_offers_its_largest_part(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    knot = np.array([(52.0, 9.0), (52.01, 9.0), (52.01, 9.01), (51.999, 9.009), (51.999, 9.01)])
    write_agopengps(FieldData("FieldNew", knot), tmp_path / "Long acre")
    refused = topdress("field", tmp_path / "Long acre", "--out", tmp_path / "job.yaml")
    assert (
        refused.exit_code == 2
        and not (tmp_path / "job.yaml").exists()
        and len(refused.output.splitlines()) == 1
    )
    assert "crosses itself at 51.999099, 9.0" in refused.output
    assert "--largest takes its largest part, " in refused.output
    taken = topdress("field", tmp_path / "Long acre", "--largest", "--out", tmp_path / "job.yaml")
    assert taken.exit_code == 0, taken.output
    field = load_config(tmp_path / "job.yaml", JOB_KIND).model.field
    expected = max(shapely.get_parts(shapely.make_valid(shapely.Polygon(knot))), key=shapely.area)
    assert field.title == "Long acre", "by its folder: AgOpenGPS writes FieldNew in each"
    assert len(field.boundary_m) == len(expected.exterior.coords) - 1


def test_polygons_of_one_name_are_chosen_by_their_number(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    path = geojson(
        tmp_path / "strips.geojson",
        *(
            feature(
                [list(shapely.box(9.0 + 0.1 * k, 52.0, 9.01 + 0.1 * k, 52.01).exterior.coords)],
                name=name,
            )
            for k, name in enumerate(("strip", "strip", ""))
        ),
    )
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
    before = build_job_ground(FIELD, Job().field, "AB 1")
    plane_before = (before.origin_lat_deg, before.origin_lon_deg)
    after = build_job_ground(FieldData("x", lines=(FIELD.lines[0],)), before)
    assert (
        after.origin_lat_deg,
        after.origin_lon_deg,
    ) == plane_before and after.boundary_m == before.boundary_m
    assert (
        farthest_m(
            build_field_data(after, "x"),
            FieldData("x", FIELD.outline_deg, FIELD.holes_deg, FIELD.lines[:1]),
        )
        < 1e-3
    )


def write_shp(
    path: Path,
    shapes: list[shapely.Geometry],
    names: list[str],
    crs: str = "EPSG:4326",
    encoding: str = "utf-8",
    column: str = "Name",
) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    path.parent.mkdir(parents=True, exist_ok=True)
    frame = geopandas.GeoDataFrame({column: names}, geometry=shapes, crs="EPSG:4326")
    frame.to_crs(crs).to_file(path, encoding=encoding)


OUTLINE = shapely.Polygon(FIELD.outline_deg[:, ::-1], [hole[:, ::-1] for hole in FIELD.holes_deg])
TRACKS = [shapely.LineString(line.places_deg[:, ::-1]) for line in FIELD.lines]


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32632"])
@pytest.mark.parametrize("packed", ["shp", "folder", "zip"])
def test_shapefiles_of_an_outline_and_of_lines(
    topdress: Callable[..., Result], tmp_path: Path, packed: str, crs: str
) -> None:
    """As geopandas writes them: polygons in one, lines in another; a folder or a zip has both."""
    folder = tmp_path / "north"
    write_shp(folder / "outline.shp", [OUTLINE], ["Nordfeld 李"], crs, column="FIELD_NAME")
    write_shp(folder / "lines.shp", TRACKS, ["AB 1", "Curve"], crs)
    if packed == "shp":
        alone = read_field_shapes(folder / "outline.shp")
        lines = read_field_shapes(folder / "lines.shp")
        assert lines.outline_deg is None and not alone.lines
        back = FieldData(alone.title, alone.outline_deg, alone.holes_deg, lines.lines)
        source = folder / "outline.shp"
    else:
        source = (
            folder
            if packed == "folder"
            else Path(shutil.make_archive(str(tmp_path / "both"), "zip", folder))
        )
        back = read_field_shapes(source)
    assert back.title == "Nordfeld 李" and {line.title for line in back.lines} == {"AB 1", "Curve"}
    assert (
        back.outline_deg is not None
        and back.outline_deg.shape == (4, 2)
        and len(back.holes_deg) == 1
    )
    told = topdress("field", source)
    assert told.exit_code == 0 and "1 obstacles taken out" in told.output, told.output
    plane = FIELD.plane()
    for one, other in (
        (
            shapely.Polygon(plane.project_many_to_m(*back.outline_deg.T)),
            shapely.Polygon(plane.project_many_to_m(*FIELD.outline_deg.T)),
        ),
        *(
            (
                shapely.LineString(plane.project_many_to_m(*line.places_deg.T)),
                shapely.LineString(
                    plane.project_many_to_m(
                        *next(same.places_deg for same in FIELD.lines if same.title == line.title).T
                    )
                ),
            )
            for line in back.lines
        ),
    ):
        assert shapely.hausdorff_distance(one, other) < (1e-6 if crs == "EPSG:4326" else 2e-3)


def test_shapefiles_that_are_none_are_one_line(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    # Albers: in no register of PROJ's as EPSG
    write_shp(tmp_path / "a.shp", [OUTLINE], ["North"], "ESRI:102003")
    said = topdress("field", tmp_path / "a.shp")
    assert (
        said.exit_code == 2
        and "Albers" in said.output
        and "allowed are degrees on WGS84, or UTM" in said.output
    )
    write_shp(tmp_path / "points.shp", [shapely.Point(9.0, 52.0)], ["tree"])
    said = topdress("field", tmp_path / "points.shp")
    assert said.exit_code == 2 and "shapes of type POINT: allowed are polygons" in said.output
    write_shp(tmp_path / "utm.shp", [OUTLINE], ["North"], "EPSG:32632")
    (tmp_path / "utm.prj").unlink()
    said = topdress("field", tmp_path / "utm.shp")
    assert said.exit_code == 2 and "no .prj that says in what" in said.output
    (tmp_path / "none").mkdir()
    said = topdress("field", tmp_path / "none")
    assert said.exit_code == 2 and "no shapefile, task set or field of AgOpenGPS" in said.output
    for cut in (0, 60, 120, 170):
        data = (tmp_path / "points.shp").read_bytes() if cut == 0 else b""
        write_shp(tmp_path / "b.shp", [OUTLINE], ["North"])
        whole = (tmp_path / "b.shp").read_bytes()
        (tmp_path / "b.shp").write_bytes(data or whole[:cut])
        said = topdress("field", tmp_path / "b.shp")
        assert (
            said.exit_code == 2 and len(said.output.splitlines()) == 1 and "b.shp" in said.output
        ), (cut, said.output)


# --- Ground that another program has covered: read from AgOpenGPS and from polygons, and not
# spread again ------------

OF_DEMO = TangentPlane(34.28, 119.88)  # as the shipped demo job has it


def degrees(*places: tuple[float, float]) -> np.ndarray:
    return np.array([OF_DEMO.convert_to_deg(*place) for place in places])


def strip(
    begin: tuple[float, float],
    heading_deg: float,
    long_m: float,
    wide_m: float,
    bend_deg: float = 0.0,
) -> list[str]:
    """As AgOpenGPS keeps a section that was on: rows, colour, then left and right edge by turns
    every metre."""
    east, north, rows = *begin, ["27, 151, 160"]
    for k in range(round(long_m) + 1):
        angle = math.radians(heading_deg + bend_deg * k / long_m)
        right = math.cos(angle), -math.sin(angle)
        rows += [
            f"{east + side * wide_m * right[0]:.3f},{north + side * wide_m * right[1]:.3f},0"
            for side in (-0.5, 0.5)
        ]
        east, north = east + math.sin(angle), north + math.cos(angle)
    return [str(len(rows)), *rows]


def aog_field(folder: Path, strips: list[list[str]]) -> Path:
    """Its start fix is OF_DEMO."""
    square = FieldData("North", degrees((-200, -200), (-200, 200), (200, 200), (200, -200)))
    write_agopengps(square, folder)
    text = (folder / "Field.txt").read_text()
    fix = text.rindex("StartFix")
    (folder / "Field.txt").write_text(text[:fix] + "StartFix\n34.2800000,119.8800000\n")
    (folder / "Sections.txt").write_text(
        "\r\n".join(line for one in strips for line in one) + "\r\n"
    )
    return folder


# 1 m over one another
PASSES = [
    strip((0.0, 0.0), 0.0, 120.0, 6.0),
    strip((5.0, 0.0), 0.0, 120.0, 6.0),
    strip((20.0, -30.0), 30.0, 80.0, 12.0, bend_deg=70.0),
    ["3", "1, 2, 3", "5.0,5.0,0", "5.0,5.0,0"],
]


def test_areas_are_those_of_a_geopandas_union(
    tmp_path: Path, topdress: Callable[..., Result]
) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    folder = aog_field(tmp_path / "north", PASSES)
    triangles = read_worked_triangles(folder)
    frame = geopandas.GeoSeries(
        [shapely.Polygon(one[:, ::-1]) for one in triangles], crs="EPSG:4326"
    )
    whole = frame.to_crs("+proj=laea +lat_0=34.28 +lon_0=119.88").union_all()
    found = read_worked_area(folder)
    assert found.area_ha == pytest.approx(whole.area / 10_000.0, rel=1e-4)
    cells = found.raster.done.sum() * found.raster.cell_m**2 / 10_000.0
    print(
        f"geopandas {whole.area / 10_000.0:.5f} ha, ours {found.area_ha:.5f} ha, by cells "
        f"{cells:.5f} ha"
    )
    assert cells == pytest.approx(whole.area / 10_000.0, rel=5e-3)
    assert (
        sum(
            shapely.Polygon(one).area
            for one in OF_DEMO.project_many_to_m(
                triangles[..., 0].ravel(), triangles[..., 1].ravel()
            ).reshape(-1, 3, 2)
        )
        / 10_000.0
        > 1.02 * found.area_ha
    )
    said = topdress("field", folder)
    assert (
        f"{found.area_ha:.3f} ha are marked as worked in Sections.txt: --done takes them"
        in said.output
    )
    told = topdress("field", folder / "Sections.txt", "--done")
    assert (
        told.exit_code == 0
        and f"done         {found.area_ha:.4f} ha, each place once" in told.output
    ), told.output


@pytest.mark.parametrize("name", ["a.geojson", "a.kml", "a.gpkg", "a.shp"])
def test_polygons_of_any_format(name: str, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    ring = degrees((0, 0), (0, 50), (40, 50), (40, 0))
    hole = degrees((10, 10), (10, 20), (20, 20), (20, 10))
    over = degrees((30, 0), (30, 50), (60, 50), (60, 0))
    shapes = [shapely.Polygon(ring[:, ::-1], [hole[:, ::-1]]), shapely.Polygon(over[:, ::-1])]
    geopandas.GeoDataFrame({"Name": ["a", "b"]}, geometry=shapes, crs="EPSG:4326").to_file(
        tmp_path / name
    )
    found = read_worked_area(tmp_path / name, OF_DEMO)
    assert found.area_ha == pytest.approx((60 * 50 - 100) / 10_000.0, rel=1e-6)
    coverage = Coverage(2.4)
    coverage.add_earlier_ground(found.raster, ours=False)
    assert coverage.covered_area.area_ha == 0.0, "another machine's ground is no area of ours"
    inside = coverage.find_covered_earlier(
        [(5.0, 5.0), (15.0, 15.0), (55.0, 25.0), (61.0, 25.0), (-1.0, 5.0)]
    )
    assert inside.tolist() == [True, False, True, False, False]


def test_cells_are_those_whose_middle_lies_in_it() -> None:
    rng = np.random.default_rng(3)
    shapes = np.array(
        [shapely.Polygon(rng.uniform(-20.0, 20.0, (5, 2))).buffer(0.0) for _ in range(12)]
        + [shapely.Point(3.0, 4.0).buffer(6.0).difference(shapely.Point(3.0, 4.0).buffer(3.0))],
        dtype=object,
    )
    found = rasterise_ground(shapes, OF_DEMO, 0.25)
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
    job = load_config(tmp_path / "job.yaml", JOB_KIND).model
    assert job.field.done == str(folder.resolve())
    assert topdress("check", tmp_path / "job.yaml").exit_code == 0
    ran = topdress(
        "simulate",
        "--job",
        tmp_path / "job.yaml",
        "--seconds",
        "70",
        "--seed",
        "1",
        "--out",
        tmp_path / "run.csv",
    )
    assert ran.exit_code == 0, ran.output
    log = read_log(tmp_path / "run.csv")
    # about, of the outlets behind the antenna
    north = (log.numbers("lat_deg") - 34.28) * 110_900.0 - 1.0
    rate, flows = (
        log.numbers("target_rate_kg_ha"),
        np.nan_to_num(log.numbers("applied_rate_kg_ha")) > 20.0,
    )
    working = log.texts("state") == "working"
    there = working & (north > 27.0) & (north < 45.0)
    assert there.sum() > 150 and not flows[there].any() and (rate[there] == 0.0).all()
    beyond = working & (north > 56.0)
    assert beyond.sum() > 100 and flows[beyond].mean() > 0.95
    assert flows[working & (north < 14.0) & (north > 5.0)].all()
    assert TargetSource.CANOPY.value in set(log.texts("target_source")[beyond])


def test_what_is_no_done_ground_is_one_line(
    tmp_path: Path, topdress: Callable[..., Result]
) -> None:
    folder = aog_field(tmp_path / "north", [])
    with pytest.raises(FieldError, match=r"no ground is marked as worked in Sections.txt"):
        read_worked_area(folder)
    (folder / "Sections.txt").write_text("9\r\n1, 2, 3\r\n1.0,2.0,0\r\n")
    with pytest.raises(FieldError, match=r"Sections.txt: '': allowed is a place"):
        read_worked_area(folder)
    with pytest.raises(FieldError, match=r"Sections.txt: '': allowed is a place"):
        read_agopengps(folder)
    boundary = folder / "Boundary.txt"
    boundary.write_bytes(boundary.read_text().encode("utf-16"))
    (folder / "Sections.txt").unlink()
    assert read_agopengps(folder).outline_deg is not None, "saved by an editor as UTF-16"
    with pytest.raises(FieldError, match=r"north: no Sections.txt: allowed is"):
        read_worked_area(folder)
    with pytest.raises(FieldError, match="no such file: allowed is a field of AgOpenGPS"):
        read_worked_area(tmp_path / "gone")
    aog_field(tmp_path / "other", [strip((0.0, 20.0), 0.0, 30.0, 8.0)])
    wrong = topdress("field", tmp_path / "other", "--done", "--out", tmp_path / "a.kml")
    assert wrong.exit_code == 2 and "allowed with --done is a job" in wrong.output
    with pytest.raises(ValueError, match="no ground"):
        rasterise_ground(np.array([shapely.Polygon()], dtype=object), OF_DEMO)
    with pytest.raises(ValueError, match="allowed are 16 km2 for one field"):
        rasterise_ground(np.array([shapely.box(0, 0, 5000, 5000)], dtype=object), OF_DEMO)


def _task_ring(kind: str, places: list[tuple[float, float]]) -> str:
    points = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lat, lon in places)
    return f'<LSG A="{kind}">{points}</LSG>'


def _square(south: float, west: float, side: float) -> list[tuple[float, float]]:
    return [(south + a * side, west + b * side) for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))]


def test_a_task_set_of_fields_alone_is_a_field(tmp_path: Path) -> None:
    """Areas by geopandas, on the sphere's equal area of EPSG:6933 (WGS84)."""
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    outline, pond = _square(40.0, 117.0, 0.004), _square(40.001, 117.001, 0.001)
    path = tmp_path / "TASKDATA.XML"
    path.write_text(
        '<ISO11783_TaskData VersionMajor="4" ManagementSoftwareManufacturer="Farm">'
        f'<PFD A="PFD1" C="North"><PLN A="1">{_task_ring("1", outline)}</PLN>'
        f'<PLN A="3" B="pond">{_task_ring("1", pond)}</PLN>'
        f'<GGP A="GGP1"><GPN A="GPN1" B="AB east" C="1">{_task_ring("5", outline[:2])}</GPN></GGP>'
        '</PFD><PDT A="PDT1" B="Urea"/><TSK A="TSK1" G="1"><TLG A="TLG00001"/>'
        '<TZN A="1"><PDV A="000B" B="3"/></TZN></TSK></ISO11783_TaskData>'
    )
    data = read_field_shapes(path)
    boundary = data.boundary(data.plane())
    shape = shapely.Polygon([place[::-1] for place in outline], [[place[::-1] for place in pond]])
    expected = geopandas.GeoSeries([shape], crs=4326).to_crs(6933).area[0] / 1e4
    assert boundary is not None and boundary.area_ha == pytest.approx(expected, rel=1e-4)
    assert data.title == "North" and [line.title for line in data.lines] == ["AB east"]
    assert str(data.findings[0]) == (
        "task set of Farm: 1 field, 1 task, 1 product, maps of DDI 000B (count per area, wanted) "
        "(topdress map), 1 log of work (topdress import)"
    )
    assert [str(one) for one in read_field_shapes(tmp_path).findings] == [
        str(one) for one in data.findings
    ]


def test_a_task_set_without_an_outline_says_what_it_holds(tmp_path: Path) -> None:
    (tmp_path / "TASKDATA.XML").write_text(
        '<ISO11783_TaskData><PFD A="PFD1" C="North"/></ISO11783_TaskData>'
    )
    with pytest.raises(FieldError, match=r"no outline .*: task set of a maker .*: 1 field$"):
        read_field_shapes(tmp_path)
