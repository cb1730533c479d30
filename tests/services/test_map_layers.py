"""Files of other days on the Map page: what our own exports, a monitor and a combine wrote lies
where it was done."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from topdress.console.app.map_camera import PixelGrid
from topdress.console.app.map_image import GroundPixels
from topdress.console.app.map_layers import MapLayer, find_colour_scale
from topdress.console.app.units import METRIC
from topdress.console.frame import Frame
from topdress.console.services.overlay_files import StoredOverlayFiles, find_frame_plane
from topdress.console.services.replay_frames import make_frames
from topdress.control.geodesy import TangentPlane, offset_place
from topdress.control.log_row import LogRow
from topdress.drivers.files.read_log import RunLog, read_nonempty_log

from tests.command import topdress

SECONDS = 60


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunLog:
    folder = tmp_path_factory.mktemp("layers")
    log = folder / "run.csv"
    made = topdress(
        "simulate", "--job", "map_demo", "--seconds", SECONDS, "--seed", "3", "--out", log
    )
    assert made.exit_code == 0, made.output
    return read_nonempty_log(log)


@pytest.fixture(scope="module")
def frame(run) -> Frame:
    return list(make_frames(run.rows(), run))[-1]


def exported(run: RunLog, name: str) -> Path:
    path = run.path.with_name(name)
    if not path.exists():
        made = topdress("map", run.path, "--out", path)
        assert made.exit_code == 0, made.output
    return path


@pytest.mark.exam
@pytest.mark.parametrize(
    "name", ["run.csv", "applied.geojson", "applied.shp", "applied.zip", "applied.csv"]
)
def test_our_own_files_lie_where_it_was_done(run, frame, name):
    path = run.path if name == "run.csv" else exported(run, name)
    laid = StoredOverlayFiles().make_overlay(str(path), frame)
    own = StoredOverlayFiles().make_overlay(str(run.path), frame).worked
    assert laid.name == name and laid.harvest is None
    assert laid.has >= {MapLayer.APPLIED, MapLayer.TARGET, MapLayer.ERROR}
    assert laid.worked.box.east_m == pytest.approx(own.box.east_m, abs=1.0)
    assert laid.worked.box.north_m == pytest.approx(own.box.north_m, abs=3.0)
    for place in ((frame.place_m[0], frame.place_m[1] - back_m) for back_m in (20.0, 45.0)):
        pixel = PixelGrid(1, 1, 2.0, place[0] - 1.0, place[1] + 1.0)
        one, other = (
            float(GroundPixels(worked, pixel).calc_means(MapLayer.APPLIED)[0, 0])
            for worked in (laid.worked, own)
        )
        assert one == pytest.approx(other, rel=0.1)
    assert laid.worked.width_m == pytest.approx(2.4)
    assert laid.worked.rate_ends[1] == pytest.approx(own.rate_ends[1], rel=0.05)


def test_a_combine_s_yield_is_laid_by_its_own_scale(run, frame, tmp_path):
    lines = [
        "Longitude,Latitude,Crop Flow(M)(kg/s),GPS Time(UTC)(s),Swth "
        "Wdth(m),Moisture(%),Speed(km/h)"
    ]
    for k, row in enumerate(run.rows()):
        if row.lat_deg is not None and k % 20 == 0:
            lines.append(
                f"{row.lon_deg:.9f},{row.lat_deg:.9f},{2.5 + 0.0005 * k:.3f},"
                f"{1773900000 + k // 20},6.0,14.2,"
                f"{3.6 * (row.speed_mps or 0.0):.2f}"
            )
    path = tmp_path / "yield.csv"
    path.write_text("\n".join(lines) + "\n")
    laid = StoredOverlayFiles().make_overlay(str(path), frame)
    assert laid.harvest == ("crop flow m", "kg/s")
    assert laid.worked.width_m == 6.0
    scale = laid.find_scale(find_colour_scale(MapLayer.APPLIED, laid.worked, None, METRIC))
    assert scale.low <= 2.5 < 3.0 <= scale.high <= 3.5 and scale.unit == "kg/s"


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        (
            "zones.geojson",
            json.dumps(
                {
                    "type": "FeatureCollection",
                    "features": [
                        {
                            "type": "Feature",
                            "properties": {"rate": 100},
                            "geometry": {
                                "type": "Polygon",
                                "coordinates": [[[0, 0], [0, 1], [1, 1], [0, 0]]],
                            },
                        }
                    ],
                }
            ),
            "a map of areas is read by",
        ),
        ("notes.csv", "time_s,comment\n0,a\n1,b\n", "no places in it"),
        (
            "temp.csv",
            "time_s,lat_deg,lon_deg,oil_temp\n0,34.28,119.88,70\n1,34.28001,119.88,71\n",
            "no rate, no NDVI",
        ),
        ("broken.geojson", "{", "broken.geojson"),
        (
            "us.csv",
            "Longitude,Latitude,Date,Time,Applied Rate(lb/ac),Speed(mph)\n"
            + "".join(
                f"119.88,34.28{k:03d},03/07/2014,08:00:{k:02d},{180 + k},3.7\n" for k in range(20)
            ),
            "us.csv: Diagnosis asks about it first: time",
        ),
    ],
    ids=["areas", "no places", "no rate", "half a file", "which day"],
)
def test_what_is_no_such_file_is_one_line(frame, tmp_path, name, text, said):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=said) as trouble:
        StoredOverlayFiles().make_overlay(str(path), frame)
    assert "\n" not in str(trouble.value) and str(tmp_path) not in str(trouble.value)
    assert sorted(one.name for one in tmp_path.iterdir()) == [name], "nothing is written"


def test_files_are_listed_without_the_log_that_is_written(run, tmp_path):
    from topdress.console.services.diagnosis import DiagnosisFiles

    layers = StoredOverlayFiles(DiagnosisFiles([run.path.parent], own=tmp_path))
    exported(run, "applied.geojson"), exported(run, "applied.zip")
    (run.path.parent / "holiday.zip").write_bytes(b"PK")
    names = [one.name for one in layers.list_layer_files(str(run.path))]
    assert {"applied.geojson", "applied.zip"} <= set(names)
    assert not {"run.csv", "run.yaml", "holiday.zip"} & set(names)
    assert "run.csv" in [one.name for one in layers.list_layer_files("")]


def test_the_plane_is_had_from_fix_and_place_where_the_job_tells_none():
    plane = TangentPlane(34.8, 113.6)
    antenna = (412.0, -230.0)
    lat, lon = plane.convert_to_deg(*antenna)
    row = LogRow(time_s=0.0, lat_deg=lat, lon_deg=lon, heading_deg=70.0)
    found = find_frame_plane(
        Frame(seq=0, at_s=0.0, row=row, place_m=offset_place(antenna, 70.0, -2.0)), None
    )
    assert found.project_to_m(lat, lon) == pytest.approx(antenna, abs=1e-3)
    assert (found.lat_deg, found.lon_deg) == pytest.approx((34.8, 113.6), abs=1e-7)
    with pytest.raises(ValueError, match="no position yet"):
        find_frame_plane(replace(Frame(seq=0, at_s=0.0, row=row), place_m=None), None)
