"""Task files that we write are valid against the public schema of ISO 11783-10, version 4.3, by
xmlschema."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from topdress.control.targets.prescription import (
    Fallbacks,
    GridDeg,
    MapData,
    Zone,
    calc_rate_shares,
)
from topdress.drivers.files.exports.as_applied import AsApplied, SpreadProduct
from topdress.drivers.files.exports.isoxml import write_isoxml_task
from topdress.drivers.files.prescriptions.map_choices import PrescriptionError, RateChoice
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.files.prescriptions.map_writer import (
    MAX_RATE_LEVELS,
    list_map_zones,
    write_prescription,
)

from tests.places import TASK_FILES

xmlschema = pytest.importorskip("xmlschema", reason="xmlschema is not installed")
carrier = pytest.importorskip(
    "isoxml_writer", reason="the package that carries the public schema is not installed"
)
FOLDER = Path(carrier.__file__).parent / "ISOXML_schema"


@pytest.fixture(scope="module")
def schema() -> Any:
    return xmlschema.XMLSchema(str(FOLDER / "ISO11783_TaskFile_V4-3.xsd"))


def wrong(schema: Any, folder: Path) -> list[str]:
    return [
        f"{error.path}: {error.reason}"
        for error in schema.iter_errors(str(folder / "TASKDATA.XML"))
    ]


def zones(
    rates: list[float], step_deg: float = 5.1234567890123e-5, wide: float = 1.0
) -> tuple[Zone, ...]:
    """Squares side by side, of `wide` times their distance: above 1 they overlap."""
    west = 119.881234567890123 + step_deg * np.arange(len(rates))
    side = wide * step_deg
    return tuple(
        Zone(
            rate,
            (
                np.array(
                    [(34.28, w), (34.28, w + side), (34.28 + side, w + side), (34.28 + side, w)]
                ),
            ),
        )
        for rate, w in zip(rates, west.tolist(), strict=True)
    )


def test_the_schema_itself_refuses_what_it_should(schema: Any, tmp_path: Path) -> None:
    """Ten decimals, code 255, a name of 33 letters: what is held against it is really held."""
    head = (
        '<ISO11783_TaskData VersionMajor="4" VersionMinor="3" ManagementSoftwareManufacturer="t" '
        'ManagementSoftwareVersion="1" DataTransferOrigin="1">'
    )
    line = '<LSG A="1"><PNT A="2" C="{lat}" D="1"/></LSG>'
    for code, name, lat in (
        ("255", "n", "1.0"),
        ("1", "n" * 33, "1.0"),
        ("1", "n", "1.0123456789"),
    ):
        (tmp_path / "TASKDATA.XML").write_text(
            f'{head}<TSK A="TSK1" G="1"><TZN A="{code}" B="{name}"><PLN A="2">'
            f"{line.format(lat=lat)}</PLN></TZN></TSK></ISO11783_TaskData>"
        )
        assert len(wrong(schema, tmp_path)) == 1, (code, name, lat)


def ground(data: MapData) -> dict[int, float]:
    """ha by whole mg/m2; nothing wanted counts as ground without a rate, which a grid of
    numbers cannot tell apart."""
    found: dict[int, float] = {}
    for share in calc_rate_shares(data):
        steps = round(100.0 * share.rate_kg_ha)
        if steps > 0 and share.area_ha > 1e-6:
            found[steps] = found.get(steps, 0.0) + share.area_ha
    return found


MAPS = {
    "400 zones of three rates": MapData(
        zones([100.0, 150.0, 200.25] * 133), title="x" * 60, product="y" * 60
    ),
    "as many rates as there are codes": MapData(zones([100.0 + k for k in range(MAX_RATE_LEVELS)])),
    "overlapping zones": MapData(zones([100.0, 200.0, 100.0, 300.0], wide=1.7)),
    "a name that XML has no place for": MapData(
        zones([100.0]), title="a\x00b\x0bc\ufffe", product="\t<&\"'>"
    ),
    "a grid with gaps": MapData(
        grid=GridDeg(
            -34.28123456789012,
            -119.880000000012,
            5e-5,
            4.9e-5,
            np.where(np.eye(16) > 0, np.nan, np.arange(256.0).reshape(16, 16) % 251),
        )
    ),
    "a grid of 253 rates and gaps": MapData(
        grid=GridDeg(
            34.28, 119.88, 5e-5, 5e-5, np.append(np.arange(252.0), [np.nan, 7.0]).reshape(2, 127)
        )
    ),
    "a grid of many rates": MapData(
        grid=GridDeg(34.28, 119.88, 5e-5, 5e-5, np.linspace(0, 500, 400).reshape(20, 20)),
        fallbacks=Fallbacks(100.0, 0.0, 50.0),
    ),
    "a field": MapData(
        zones([120.0]),
        fields_deg=((np.array([(34.27, 119.87), (34.301234567890, 119.87), (34.27, 119.92)]),),),
    ),
}


@pytest.mark.parametrize("name", list(MAPS))
def test_prescriptions_are_valid_and_hold_the_same_ground(
    schema: Any, tmp_path: Path, name: str
) -> None:
    data = MAPS[name]
    write_prescription(data, tmp_path / "task")
    assert wrong(schema, tmp_path / "task") == []
    assert ground(read_prescription(tmp_path / "task").data) == pytest.approx(
        ground(data), rel=1e-4
    )


def test_where_zones_overlap_the_first_holds_after_merging_too(tmp_path: Path) -> None:
    """100, 200, 100: put together under one code, the second 100 must not come before the 200."""
    data = MAPS["overlapping zones"]
    write_prescription(data, tmp_path / "task")
    again = read_prescription(tmp_path / "task").data
    for place in shapely.MultiPoint(
        [(119.88123456 + 1.3e-5 * k, 34.28003) for k in range(20)]
    ).geoms:
        first, there = (
            next(
                (
                    zone.rate_kg_ha
                    for zone in one.zones
                    if shapely.Polygon(zone.rings_deg[0][:, ::-1]).contains(place)
                ),
                None,
            )
            for one in (data, again)
        )
        assert first == there


def test_more_rates_than_codes_are_refused(tmp_path: Path) -> None:
    data = MapData(zones([100.0 + k for k in range(MAX_RATE_LEVELS + 1)]))
    with pytest.raises(
        PrescriptionError, match=r"task: 253 different rates: allowed 252 in a task file of zones"
    ):
        write_prescription(data, tmp_path / "task")
    assert not (tmp_path / "task").exists()
    write_prescription(data, tmp_path / "m.geojson")


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    rates=st.lists(st.floats(0.0, 2000.0), min_size=1, max_size=40),
    wide=st.floats(0.2, 2.5),
    title=st.text(max_size=50),
    product=st.text(max_size=50),
    fallback=st.floats(0.0, 500.0),
)
def test_any_map_is_valid(
    schema: Any,
    tmp_path: Path,
    rates: list[float],
    wide: float,
    title: str,
    product: str,
    fallback: float,
) -> None:
    data = MapData(
        zones(rates, wide=wide),
        fallbacks=Fallbacks(fallback, 0.0, fallback),
        title=title,
        product=product,
    )
    write_prescription(data, tmp_path / "task")
    assert wrong(schema, tmp_path / "task") == []
    write_prescription(
        MapData(grid=GridDeg(34.28, 119.88, 5.123456789e-5, 5e-5, np.array([rates])), title=title),
        tmp_path / "grid",
    )
    assert wrong(schema, tmp_path / "grid") == []


@pytest.mark.parametrize("folder", ["fertilizer_map_1", "grid_type_1", "grid_type_2"])
def test_real_task_files_written_again_are_valid(schema: Any, tmp_path: Path, folder: str) -> None:
    data = read_prescription(
        TASK_FILES / folder, RateChoice(rate_from="presentation", density_kg_l=1.3)
    ).data
    write_prescription(data, tmp_path / "task")
    assert wrong(schema, tmp_path / "task") == []
    assert len(list_map_zones(read_prescription(tmp_path / "task").data)) == len(
        list_map_zones(data)
    )


def test_as_applied_is_valid_with_its_time_log(
    schema: Any, tmp_path: Path, applied: AsApplied
) -> None:
    odd = replace(applied, title="t" * 50, product=SpreadProduct("p\x01" + "q" * 60, 0.46))
    for number, one in enumerate((applied, odd)):
        write_isoxml_task(one, tmp_path / str(number))
        assert wrong(schema, tmp_path / str(number)) == []
        log = xmlschema.XMLSchema(str(FOLDER / "ISO11783_TimeLog_V4-3.xsd"))
        # The element that the log names stands in the task file: one schema for each of two
        # files cannot know it.
        assert [
            error.reason
            for error in log.iter_errors(str(tmp_path / str(number) / "TLG00001.xml"))
            if "IDREF" not in (error.reason or "")
        ] == []
