"""A prescription given as points of an even lattice, in tables and files of shapes: cells, area
and kilograms by shapely; what is no lattice is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import openpyxl
import polars as pl
import pytest
import shapefile
import shapely
from topdress.control.geodesy import TangentPlane
from topdress.control.targets.prescription import calc_rate_shares
from topdress.drivers.files.file_content import FileContent
from topdress.drivers.files.prescriptions.grid_from_points import NoGridError, fit_point_grid
from topdress.drivers.files.prescriptions.map_choices import RateChoice, RateQuestion
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.plain_text import RefusedInput

from tests.command import topdress
from tests.geojson import feature, geojson

PLANE = TangentPlane(34.8, 113.6)
RATES = (120.0, 180.5, 240.0, 300.0)


def lattice(
    columns: int = 12,
    rows: int = 9,
    wide: float = 10.0,
    high: float = 10.0,
    heading: float = 0.0,
    seed: int = 1,
    gaps: float = 0.15,
) -> tuple[np.ndarray, np.ndarray]:
    """Middles (n, 2), m, and rates (n,), as a field's outline leaves them."""
    rng = np.random.default_rng(seed)
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(columns), np.arange(rows)))
    turn = np.radians(heading)
    along, aside = (
        np.array([np.cos(turn), -np.sin(turn)]) * wide,
        np.array([np.sin(turn), np.cos(turn)]) * high,
    )
    places = i[:, None] * along + j[:, None] * aside
    kept = rng.permutation(len(places))[: round((1.0 - gaps) * len(places))]
    return places[kept], rng.choice(RATES, len(kept))


def degrees(places: np.ndarray) -> np.ndarray:
    return np.array([PLANE.convert_to_deg(*place) for place in places.tolist()])


def sums(path: Path, choice: RateChoice | None = None) -> tuple[float, float]:
    """Area, ha, and kilograms."""
    shares = calc_rate_shares(read_prescription(path, choice).data)
    return sum(one.area_ha for one in shares), sum(one.mass_kg for one in shares)


def by_shapely(
    places: np.ndarray, rates: np.ndarray, wide: float, high: float, heading: float
) -> tuple[float, float]:
    turn = np.radians(heading)
    along, aside = (
        np.array([np.cos(turn), -np.sin(turn)]) * wide,
        np.array([np.sin(turn), np.cos(turn)]) * high,
    )
    cells = [
        shapely.Polygon(
            [
                at - (along + aside) / 2,
                at + (along - aside) / 2,
                at + (along + aside) / 2,
                at - (along - aside) / 2,
            ]
        )
        for at in places
    ]
    area = np.array([cell.area for cell in cells]) / 1e4
    return float(shapely.union_all(cells, grid_size=1e-6).area / 1e4), float(area @ rates)


def csv_of(
    path: Path,
    lat_lon: np.ndarray,
    rates: np.ndarray,
    header: str = "lat,lon,rate",
    digits: int = 9,
    encoding: str = "utf-8",
) -> Path:
    sign = ";" if ";" in header else "\t" if "\t" in header else ","
    lines = [header]
    for (lat, lon), rate in zip(lat_lon.tolist(), rates.tolist(), strict=True):
        cells = [f"{lat:.{digits}f}", f"{lon:.{digits}f}", f"{rate:g}"]
        lines.append(sign.join(cell.replace(".", ",") if sign == ";" else cell for cell in cells))
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


@pytest.mark.parametrize(
    ("wide", "high", "heading"),
    [(10.0, 10.0, 0.0), (10.0, 30.0, 0.0), (24.0, 6.0, 33.0), (5.0, 5.0, 45.0), (15.0, 15.0, 88.0)],
)
@pytest.mark.parametrize("digits", [9, 7])
def test_area_and_kilograms_of_any_lattice(tmp_path, wide, high, heading, digits):
    places, rates = lattice(wide=wide, high=high, heading=heading)
    area, mass = sums(csv_of(tmp_path / "points.csv", degrees(places), rates, digits=digits))
    true_area, true_mass = by_shapely(places, rates, wide, high, heading)
    assert area == pytest.approx(true_area, rel=2e-4) and mass == pytest.approx(true_mass, rel=2e-4)


def test_a_lattice_that_is_even_in_degrees(tmp_path):
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(60), np.arange(80)))
    lat_lon = np.column_stack((60.1 + 0.0001 * j, 24.9 + 0.0002 * i))
    read = read_prescription(csv_of(tmp_path / "p.csv", lat_lon, np.full(len(i), 200.0), digits=6))
    box = read.data.box_deg
    assert box == pytest.approx((60.09995, 24.8999, 60.10795, 24.9119), abs=1e-9)
    assert sum(one.area_ha for one in calc_rate_shares(read.data)) == pytest.approx(59.4, rel=5e-3)


def test_every_point_keeps_its_rate_at_its_place(tmp_path):
    places, rates = lattice(heading=20.0)
    read = read_prescription(csv_of(tmp_path / "points.csv", degrees(places), rates))
    zones = {
        tuple(np.round(shapely.Polygon(zone.rings_deg[0]).centroid.coords[0], 7)): zone.rate_kg_ha
        for zone in read.data.zones
    }
    assert len(zones) == len(places)
    for (lat, lon), rate in zip(degrees(places).tolist(), rates.tolist(), strict=True):
        inside = [
            value for (y, x), value in zones.items() if abs(y - lat) < 1e-6 and abs(x - lon) < 1e-6
        ]
        assert inside == [rate]


@pytest.mark.parametrize(
    "header",
    [
        "Latitude;Longitude;Rate (kg/ha)",
        "lat\tlon\tTgt_Rate",
        "Breite;Länge;Sollmenge",
        "纬度,经度,施肥量",
        "LATITUDE,LONGITUDE,rate_lb_ac",
    ],
)
def test_tables_in_other_words_and_dress(tmp_path, header):
    places, rates = lattice()
    path = csv_of(
        tmp_path / "p.csv",
        degrees(places),
        rates,
        header,
        encoding="gb18030" if "纬" in header else "utf-8",
    )
    factor = 0.45359237 / 0.40468564224 if "lb" in header else 1.0
    assert sums(path)[1] == pytest.approx(
        factor * by_shapely(places, rates, 10.0, 10.0, 0.0)[1], rel=2e-4
    )


def test_a_sheet_with_a_title_is_read_too(tmp_path):
    places, rates = lattice()
    lat_lon = degrees(places)
    path = tmp_path / "points.xlsx"
    book = openpyxl.Workbook()
    for row in [
        ["North field"],
        [],
        ["lat", "lon", "rate"],
        *(
            [lat, lon, rate]
            for (lat, lon), rate in zip(lat_lon.tolist(), rates.tolist(), strict=True)
        ),
    ]:
        book.active.append(row)
    book.save(path)
    assert sums(path)[1] == pytest.approx(by_shapely(places, rates, 10.0, 10.0, 0.0)[1], rel=2e-4)


@pytest.mark.parametrize("ending", [".geojson", ".shp"])
def test_points_of_geojson_and_shapefile(tmp_path, ending):
    places, rates = lattice(heading=12.0)
    path = tmp_path / f"points{ending}"
    lat_lon = degrees(places)
    if ending == ".shp":
        with shapefile.Writer(str(path), shapeType=shapefile.POINT) as out:
            out.field("ZONE", "N", 6)
            out.field("TGT_RATE", "N", 12, 3)
            for k, ((lat, lon), rate) in enumerate(
                zip(lat_lon.tolist(), rates.tolist(), strict=True)
            ):
                out.point(lon, lat)
                out.record(k, rate)
    else:
        geojson(
            path,
            *(
                feature([lon, lat], "Point", zone=k, Tgt_Rate=rate)
                for k, ((lat, lon), rate) in enumerate(
                    zip(lat_lon.tolist(), rates.tolist(), strict=True)
                )
            ),
        )
    area, mass = sums(path)
    true_area, true_mass = by_shapely(places, rates, 10.0, 10.0, 12.0)
    assert area == pytest.approx(true_area, rel=2e-4) and mass == pytest.approx(true_mass, rel=2e-4)
    told = topdress("map", path)
    assert told.exit_code == 0, told.output
    assert "taken for the middles of cells of 10 x 10 m" in told.output
    assert "rates        " in told.output and "(by its name)" in told.output


def test_which_column_is_the_rate_is_asked_as_ever(tmp_path):
    places, rates = lattice()
    path = csv_of(tmp_path / "p.csv", degrees(places), rates, "lat,lon,ec")
    with pytest.raises(RateQuestion, match="none is named as a rate"):
        read_prescription(path)
    assert sums(path, RateChoice(column="ec"))[1] > 0.0


def test_thousands_beside_a_decimal_comma(tmp_path):
    places, _rates = lattice()
    lat_lon = degrees(places)
    lines = ["lat;lon;rate"] + [
        f"{lat:.7f};{lon:.7f};1.250".replace(".", ",", 2).replace("1,250", "1.250")
        for lat, lon in lat_lon.tolist()
    ]
    path = tmp_path / "p.csv"
    path.write_text("\n".join(lines) + "\n")
    assert {zone.rate_kg_ha for zone in read_prescription(path).data.zones} == {1250.0}


def scattered(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 200.0, (150, 2))


def staggered() -> np.ndarray:
    places, _rates = lattice(gaps=0.0)
    return places + np.column_stack(
        (5.0 * (np.round(places[:, 1] / 10.0) % 2), np.zeros(len(places)))
    )


def driven() -> np.ndarray:
    along = np.arange(0.0, 150.0, 1.4)
    rng = np.random.default_rng(3)
    return np.concatenate(
        [
            np.column_stack((np.full(len(along), 12.0 * k), along + rng.uniform(0.0, 1.4)))
            for k in range(8)
        ]
    ) + rng.normal(0.0, 0.05, (8 * len(along), 2))


@pytest.mark.parametrize(
    ("places", "said"),
    [
        (scattered(1), "no even lattice"),
        (staggered(), "no even lattice"),
        (driven(), "no even lattice"),
        (np.column_stack((np.arange(20) * 10.0, np.zeros(20))), "one row"),
        (np.zeros((9, 2)), "share their place"),
        (np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]]), "3 points: 4 are the least"),
    ],
    ids=["scattered", "staggered", "driven", "one row", "one place", "three"],
)
def test_what_is_no_lattice_is_one_line(tmp_path, places, said):
    path = csv_of(tmp_path / "p.csv", degrees(places), np.full(len(places), 200.0))
    with pytest.raises(RefusedInput, match=said) as trouble:
        read_prescription(path)
    assert "\n" not in str(trouble.value) and str(path) in str(trouble.value)
    told = topdress("map", path)
    assert told.exit_code == 2 and "Traceback" not in told.output


@pytest.mark.parametrize("seed", range(8))
def test_scattered_points_are_never_a_lattice(seed):
    with pytest.raises(NoGridError):
        fit_point_grid(scattered(seed + 10))


def test_a_log_is_still_a_log(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("time_s,lat_deg,lon_deg,applied_rate_kg_ha\n0,34.8,113.6,200\n")
    with pytest.raises(RefusedInput, match="a log is read by topdress import"):
        read_prescription(log)


@pytest.mark.exam
def test_a_lattice_of_many_points(tmp_path):
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(200), np.arange(150)))
    frame = pl.DataFrame(
        {"lat": 34.8 + 0.0001 * j, "lon": 113.6 + 0.0001 * i, "rate": 100.0 + (i + j) % 5}
    )
    path = tmp_path / "large.csv"
    frame.write_csv(path)
    assert len(read_prescription(path).data.zones) == 30_000


def test_a_table_in_metres_is_asked_for_its_zone(tmp_path: Path) -> None:
    """As kriging programs write it: columns parted by spaces, no degrees."""
    path = tmp_path / "krig.txt"
    places = [(500_000.0 + 5.0 * k, 5_800_000.0 + 5.0 * j) for j in range(4) for k in range(5)]
    rows = [f"{east} {north} {80.0 + k}" for k, (east, north) in enumerate(places)]
    path.write_text("\n".join(["x y value", *rows]))
    assert FileContent(path).content_kind == "map"
    with pytest.raises(RateQuestion, match=r"columns x, y.*--zone 32N.*--column .*: value"):
        read_prescription(path)
    with pytest.raises(RefusedInput, match="zone 99N: allowed are 1N to 60N"):
        read_prescription(path, RateChoice(zone="99N"))
    read = read_prescription(path, RateChoice(zone="32N", column="value", unit="kg/ha"))
    ha = sum(share.area_ha for share in calc_rate_shares(read.data))
    # a UTM metre on the central meridian is 1 / 0.9996 m
    assert ha == pytest.approx(20 * 25e-4 / 0.9996**2, rel=1e-4)
    assert read.data.box_deg[1] == pytest.approx(9.0, abs=1e-4)
