"""ISO 11783-10 task files: the shared real ones, small ones made here, and broken ones."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from topdress.control.geodesy import TangentPlane
from topdress.control.targets.prescription import Fallbacks, MapData, Zone, calc_rate_shares
from topdress.drivers.files.imports.task_log import describe_task_file
from topdress.drivers.files.prescriptions.map_choices import (
    ImportedMap,
    PrescriptionError,
    RateChoice,
)
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.files.prescriptions.map_writer import write_prescription
from topdress.drivers.plain_text import RefusedInput

from tests.places import TASK_FILES

Make = Callable[..., Path]

ZONES = (
    '<TZN A="0"><PDV A="0006" B="9000"/></TZN><TZN A="1"><PDV A="0006" B="0"/></TZN>'
    '<TZN A="5" B="middle"><PLN A="2"><LSG A="1">'
    '<PNT A="2" C="40.0" D="116.0"/><PNT A="2" C="40.001" D="116.0"/><PNT A="2" C="40.001" '
    'D="116.001"/>'
    '<PNT A="2" C="40.0" D="116.001"/></LSG>'
    '<LSG A="2"><PNT A="2" C="40.0004" D="116.0004"/><PNT A="2" C="40.0006" D="116.0004"/>'
    '<PNT A="2" C="40.0006" D="116.0006"/></LSG></PLN><PDV A="0006" B="31500"/></TZN>'
)
GRID = (
    '<TZN A="0"><PDV A="0006" B="0"/></TZN><TZN A="7"><PDV A="0006" B="12000"/></TZN>'
    '<GRD A="40.0" B="116.0" C="0.0001" D="0.0002" E="3" F="2" G="GRD00001" H="6" I="1"/>'
)
GRID2 = (
    '<TZN A="0"><PDV A="0006" B="0"/><PDV A="0001" B="0"/></TZN>'
    '<GRD A="40.0" B="116.0" C="0.0001" D="0.0002" E="3" F="2" G="GRD00001" I="2" J="0"/>'
)


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def made(
        task: str,
        attributes: str = 'H="0" I="0" J="0"',
        cells: bytes | None = None,
        version: int = 3,
        around: str = "",
    ) -> Path:
        text = (
            '<?xml version="1.0" encoding="UTF-8"?><ISO11783_TaskData '
            f'VersionMajor="{version}" VersionMinor="0" '
            f'DataTransferOrigin="1">{around}<TSK A="TSK1" B="t" G="1" {attributes}>{task}</TSK>'
            "</ISO11783_TaskData>"
        )
        (tmp_path / "TaskData.xml").write_text(text, encoding="utf-8")
        if cells is not None:
            (tmp_path / "grd00001.BIN").write_bytes(cells)
        return tmp_path

    return made


WRITTEN_DEG = 0.51e-9  # the public schema has nine decimals


def same(one: MapData, other: MapData) -> bool:
    """Zones in any order: those of one rate are written together."""
    zones = len(one.zones) == len(other.zones) and all(
        a.rate_kg_ha == b.rate_kg_ha
        and len(a.rings_deg) == len(b.rings_deg)
        and all(near(r, s) for r, s in zip(a.rings_deg, b.rings_deg, strict=True))
        for a, b in zip(
            *(
                sorted(
                    data.zones, key=lambda z: (z.rate_kg_ha, *z.rings_deg[0][0].round(8).tolist())
                )
                for data in (one, other)
            ),
            strict=True,
        )
    )
    grids = (one.grid is None) == (other.grid is None)
    if one.grid is not None and other.grid is not None:
        grids = (
            near(one.grid[:2], other.grid[:2])
            and one.grid[2:4] == other.grid[2:4]
            and np.allclose(
                one.grid.rate_kg_ha, other.grid.rate_kg_ha, rtol=0, atol=1e-9, equal_nan=True
            )
        )
    fields = len(one.fields_deg) == len(other.fields_deg) and all(
        near(r, s)
        for a, b in zip(one.fields_deg, other.fields_deg, strict=True)
        for r, s in zip(a, b, strict=True)
    )
    return zones and grids and fields and one.fallbacks == other.fallbacks


def near(one: npt.ArrayLike, other: npt.ArrayLike) -> bool:
    return np.shape(one) == np.shape(other) and np.allclose(one, other, rtol=0.0, atol=WRITTEN_DEG)


def total(read: ImportedMap) -> tuple[float, float]:
    shares = calc_rate_shares(read.data)
    return sum(share.area_ha for share in shares), sum(share.mass_kg for share in shares)


# -- real files of other programs
# ---------------------------------------------------------------------------------

SHARED = [
    # folder, choice, cells or zones, unit, (ha, kg), fallbacks
    (
        "fertilizer_map_1",
        RateChoice(),
        32,
        "mg/m2",
        (1.7151, 254.09),
        Fallbacks(148.15, 0.0, 148.15),
    ),
    (
        "grid_type_1",
        RateChoice(rate_from="presentation"),
        38 * 33,
        "kg/ha",
        (12.6847, 298.81),
        Fallbacks(10.0, 0.0, 0.0),
    ),
    (
        "grid_type_1",
        RateChoice(rate_from="ddi"),
        38 * 33,
        "mg/m2",
        (12.6847, 2.9881),
        Fallbacks(0.1, 0.0, 0.0),
    ),
    (
        "grid_type_2",
        RateChoice(density_kg_l=1.32),
        178 * 236,
        "mm3/m2",
        (1.7470, 1.32 * 99.093),
        Fallbacks(0.0, 0.0, 0.0),
    ),
]


@pytest.mark.parametrize(("folder", "choice", "count", "unit", "ha_and_kg", "fallbacks"), SHARED)
def test_shared_files_have_these_zones_and_totals(
    folder: str,
    choice: RateChoice,
    count: int,
    unit: str,
    ha_and_kg: tuple[float, float],
    fallbacks: Fallbacks,
) -> None:
    read = read_prescription(TASK_FILES / folder, choice)
    found = len(read.data.zones) if read.data.grid is None else read.data.grid.rate_kg_ha.size
    assert (found, read.unit, read.data.fallbacks) == (count, unit, pytest.approx(fallbacks))
    assert total(read) == pytest.approx(ha_and_kg, rel=1e-4)


@pytest.mark.parametrize("folder", ["fertilizer_map_1", "grid_type_1", "grid_type_2"])
@pytest.mark.parametrize("out", ["again", "again.zip"])
def test_shared_files_written_again_read_equal(tmp_path: Path, folder: str, out: str) -> None:
    choice = RateChoice(rate_from="presentation", density_kg_l=1.0)
    read = read_prescription(TASK_FILES / folder, choice)
    write_prescription(read.data, tmp_path / out)
    assert same(read_prescription(tmp_path / out).data, read.data)


def test_the_field_of_the_shared_grid_is_as_large_as_it_says() -> None:
    read = read_prescription(TASK_FILES / "grid_type_2", RateChoice(density_kg_l=1.0))
    assert total(read)[0] * 10_000 == pytest.approx(17_470, abs=2)


def test_shared_zones_as_an_independent_reader_sees_them(tmp_path: Path) -> None:
    """Our export, opened by isoxml-py and turned into shapely polygons: areas and rates are
    ours."""
    pytest.importorskip("isoxml", reason="isoxml is not installed")
    from isoxml.converter.shapely_geom import ShapelyConverterV4
    from isoxml.util.isoxml_io import isoxml_from_path

    read = read_prescription(TASK_FILES / "fertilizer_map_1")
    write_prescription(read.data, tmp_path / "again")
    task_data, _ = isoxml_from_path(tmp_path / "again" / "TASKDATA.XML")
    zones = [zone for zone in task_data.tasks[0].treatment_zones if zone.polygons]
    assert len({zone.code for zone in zones}) == len(zones) == 5, "a code for each rate"
    converter = ShapelyConverterV4()
    theirs = sorted(
        (
            zone.process_data_variables[0].process_data_value,
            *converter.to_shapely_polygon(polygon).exterior.coords[0],
        )
        for zone in zones
        for polygon in zone.polygons
    )
    ours = sorted(
        (round(100 * zone.rate_kg_ha), *zone.rings_deg[0][0][::-1].round(9))
        for zone in read.data.zones
    )
    assert len(theirs) == 32
    assert np.allclose(theirs, ours, rtol=0.0, atol=WRITTEN_DEG)


# -- made here
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [3, 4])
def test_zones_with_holes_and_all_fallbacks(make: Make, version: int) -> None:
    read = read_prescription(make(ZONES, 'H="0" I="0" J="1"', version=version))
    assert read.data.fallbacks == Fallbacks(90.0, 0.0, 90.0)
    assert [(z.rate_kg_ha, z.title, len(z.rings_deg)) for z in read.data.zones] == [
        (315.0, "middle", 2)
    ]
    assert read.findings == ()


def test_a_grid_runs_north_from_its_south_western_corner(make: Make) -> None:
    read = read_prescription(make(GRID, cells=bytes([0, 7, 7, 0, 0, 9])))
    assert read.data.grid is not None
    rates = read.data.grid.rate_kg_ha
    assert np.array_equal(rates, [[0.0, 120.0, 120.0], [0.0, 0.0, np.nan]], equal_nan=True)
    assert read.data.box_deg == pytest.approx((40.0, 116.0, 40.0002, 116.0006))
    assert [(f.id, f.rows) for f in read.findings] == [("unknown_codes", 1)]


def test_fallback_zones_that_are_not_there_are_nothing_and_said(make: Make) -> None:
    read = read_prescription(make(ZONES, 'H="5"'))
    assert read.data.fallbacks == Fallbacks(315.0, 0.0, 0.0)
    assert [f.id for f in read.findings] == ["no_lost_zone", "no_outside_zone"]


def test_a_type_2_cell_holds_a_number_for_each_of_its_data(make: Make) -> None:
    cells = np.array([[100, 1], [200, 2], [300, 3], [400, 4], [500, 5], [600, 6]], "<i4").tobytes()
    folder = make(GRID2, cells=cells)
    with pytest.raises(
        RefusedInput, match=r"allowed TSK1/0006 \(mass per area\), TSK1/0001 \(volume"
    ):
        read_prescription(folder)
    mass = read_prescription(folder, RateChoice(layer="TSK1/0006")).data.grid
    volume = read_prescription(folder, RateChoice(layer="TSK1/0001", density_kg_l=2.0)).data.grid
    assert mass is not None and volume is not None
    assert mass.rate_kg_ha.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert volume.rate_kg_ha == pytest.approx(2.0 * 1e-4 * np.array([[1, 2, 3], [4, 5, 6]]))


def test_a_grid_of_many_rates_is_written_as_type_2(tmp_path: Path, make: Make) -> None:
    rng = np.random.default_rng(2)
    cells = rng.integers(0, 30_000, 2000).astype("<i4").tobytes()
    task = GRID2.replace('<PDV A="0001" B="0"/>', "").replace('E="3" F="2"', 'E="50" F="40"')
    read = read_prescription(make(task, cells=cells))
    write_prescription(read.data, tmp_path / "again.zip")
    with zipfile.ZipFile(tmp_path / "again.zip") as archive:
        assert b'I="2"' in archive.read("TASKDATA/TASKDATA.XML")
    assert same(read_prescription(tmp_path / "again.zip").data, read.data)


def test_a_field_is_written_with_its_area(tmp_path: Path) -> None:
    """Two outlines, the second with a hole: 100 m x 200 m and 50 m x 50 m less 10 m x 10 m, in
    whole square metres."""
    plane = TangentPlane(34.28, 119.88)

    def box(east_m: float, width_m: float, height_m: float) -> npt.NDArray[np.float64]:
        return np.array(
            [
                plane.convert_to_deg(east_m + x, y)
                for x, y in ((0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m))
            ]
        )

    data = MapData(
        (Zone(120.0, (box(0.0, 20.0, 20.0),)),),
        fields_deg=((box(0.0, 100.0, 200.0),), (box(200.0, 50.0, 50.0), box(220.0, 10.0, 10.0))),
    )
    write_prescription(data, tmp_path / "task")
    (text,) = (
        path.read_text(encoding="utf-8")
        for path in tmp_path.rglob("*")
        if path.name.upper() == "TASKDATA.XML"
    )
    (area,) = re.findall(r'<PFD [^>]*D="([0-9]+)"', text)
    assert int(area) == pytest.approx(20_000 + 2_400, rel=1e-3)
    said = describe_task_file(tmp_path / "task")
    assert said is not None and any(
        f"{int(area) / 10_000:.4f} ha as it says" in line for line in said
    ), "check says it"


def test_external_files_and_a_zip_with_a_folder(tmp_path: Path) -> None:
    text = (
        '<ISO11783_TaskData VersionMajor="4" VersionMinor="1" DataTransferOrigin="1"><XFR '
        'A="TSK00001" B="1"/>'
        "</ISO11783_TaskData>"
    )
    more = f'<XFC><TSK A="TSK1" B="t" G="1" H="0" I="0" J="1">{ZONES}</TSK></XFC>'
    with zipfile.ZipFile(tmp_path / "t.zip", "w") as archive:
        archive.writestr("export/TASKDATA/taskdata.XML", text)
        archive.writestr("export/TASKDATA/TSK00001.xml", more)
    assert len(read_prescription(tmp_path / "t.zip").data.zones) == 1


def test_a_presentation_that_disagrees_must_be_decided(make: Make) -> None:
    around = '<VPN A="VPN1" B="0" C="1" D="0" E="kg/ha"/>'
    folder = make(ZONES.replace('B="31500"', 'B="315" E="VPN1"'), around=around)
    with pytest.raises(RefusedInput, match="allowed ddi, presentation"):
        read_prescription(folder)
    assert read_prescription(folder, RateChoice(rate_from="ddi")).data.zones[
        0
    ].rate_kg_ha == pytest.approx(3.15)
    taken = read_prescription(folder, RateChoice(rate_from="presentation"))
    assert taken.data.zones[0].rate_kg_ha == 315.0
    assert taken.findings[0].id == "presentation"
    honest = make(
        ZONES.replace('B="31500"', 'B="31500" E="VPN1"'), around=around.replace('C="1"', 'C="0.01"')
    )
    assert read_prescription(honest).data.zones[0].rate_kg_ha == 315.0


def test_the_operators_fallbacks_and_scale_stand_above_the_files(make: Make) -> None:
    read = read_prescription(make(ZONES), RateChoice(scale=0.5, outside_kg_ha=12.0))
    assert read.data.fallbacks == Fallbacks(45.0, 12.0, 45.0)
    assert read.data.zones[0].rate_kg_ha == 157.5


BROKEN = [
    ("not xml", lambda t: t[:200], "not readable as XML"),
    (
        "another root",
        lambda t: t.replace("ISO11783_TaskData", "Other"),
        "root element Other: allowed ISO11783",
    ),
    (
        "no number",
        lambda t: t.replace('B="31500"', 'B="many"'),
        "zone 5: PDV B: 'many': allowed is a whole number",
    ),
    (
        "negative",
        lambda t: t.replace('B="31500"', 'B="-5"'),
        r"zone 5: rate -0.05 kg/ha: allowed 0 to 20000",
    ),
    ("absurd", lambda t: t.replace('B="31500"', 'B="2000000001"'), "is the unit right"),
    (
        "count per area",
        lambda t: t.replace('"0006"', '"000B"'),
        r"only DDI 000B \(count per area, wanted\): allowed",
    ),
    ("no zones", lambda t: t.replace("TZN", "XYZ"), "no treatment zones"),
    ("latitude", lambda t: t.replace('C="40.0"', 'C="140.0"'), "PNT C: 140: allowed -90 to 90"),
    (
        "no corners",
        lambda t: t.replace("PNT", "QQQ"),
        "a ring of less than 3 corners: allowed 3 or more",
    ),
    ("wrong fallback", lambda t: t.replace('H="0"', 'H="77"'), "default zone 77: allowed 0, 1, 5"),
    ("no polygon", lambda t: t.replace("PLN", "XXX"), "neither a grid nor zones"),
]


@pytest.mark.parametrize(("broken", "words"), [b[1:] for b in BROKEN], ids=[b[0] for b in BROKEN])
def test_broken_zones_are_said_in_one_line(
    make: Make, broken: Callable[[str], str], words: str
) -> None:
    folder = make(ZONES)
    file = folder / "TaskData.xml"
    file.write_text(broken(file.read_text()))
    with pytest.raises(RefusedInput, match=words) as caught:
        read_prescription(folder)
    assert "\n" not in str(caught.value) and "TaskData.xml" in str(caught.value)


@pytest.mark.parametrize(
    ("cells", "task", "words"),
    [
        (bytes(5), GRID, "GRD00001.bin: 5 bytes: allowed 6"),
        (None, GRID, "GRD00001.bin, which the grid names, is not there"),
        (bytes(6), GRID.replace('I="1"', 'I="3"'), "grid type 3: allowed 1 and 2"),
        (bytes(6), GRID.replace('E="3"', 'E="0"'), "allowed is above 0"),
        (bytes(24), GRID.replace('I="1"', 'I="2" J="44"'), "names zone 44"),
        (
            np.array([1, 2, 3, 4, -5, 6], "<i4").tobytes(),
            GRID.replace('I="1"', 'I="2" J="0"'),
            "row 1, column 1: rate",
        ),
    ],
)
def test_broken_grids_are_said_in_one_line(
    make: Make, cells: bytes | None, task: str, words: str
) -> None:
    with pytest.raises(RefusedInput, match=words):
        read_prescription(make(task, cells=cells))


def test_random_damage_never_ends_in_a_trace(make: Make) -> None:
    folder = make(GRID, cells=bytes([0, 7, 7, 0, 0, 7]))
    file = folder / "TaskData.xml"
    whole = file.read_bytes()
    rng = np.random.default_rng(7)
    for _ in range(400):
        damaged = bytearray(whole)
        for at in rng.integers(60, len(whole), 3):
            damaged[at] = rng.integers(32, 127)
        file.write_bytes(damaged)
        try:
            read_prescription(folder)
        except PrescriptionError as error:
            assert "\n" not in str(error)
