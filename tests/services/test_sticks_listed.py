"""Only what may be a map is listed: by its ending and its first bytes."""
from __future__ import annotations

import json
import zipfile

import pytest

from console.services.job import implausible
from console.services.sticks import entries, maps_in, may_be_map


@pytest.fixture
def stick(tmp_path):
    square = [[[119.88, 34.28], [119.881, 34.28], [119.881, 34.281], [119.88, 34.28]]]
    feature = {"type": "Feature", "properties": {"rate": 150}, "geometry": {"type": "Polygon", "coordinates": square}}
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    (tmp_path / "worker.json").write_text('{"pid": 4711, "token": "x"}')
    (tmp_path / "run.csv").write_text("time_s,lat_deg,lon_deg,applied_rate_kg_ha\n0,34.28,119.88,100\n")
    (tmp_path / "cells.csv").write_text("latitude,longitude,rate\n34.28,119.88,100\n34.2801,119.88,120\n")
    with zipfile.ZipFile(tmp_path / "photos.zip", "w") as archive:
        archive.writestr("a.jpg", b"")
    with zipfile.ZipFile(tmp_path / "map.zip", "w") as archive:
        archive.writestr("field/map.shp", b"")
    (tmp_path / "deep").mkdir()
    return tmp_path


def test_only_maps_are_listed(stick):
    listed = {one.name for one in maps_in(((stick, "stick"),))}
    assert listed == {"a.geojson", "cells.csv", "map.zip"}
    assert not may_be_map(stick / "worker.json")


def test_folders_first_then_maps(stick):
    names = [one.name for one in entries(stick)]
    assert names[0] == ".." and names[1] == "deep/" and set(names[2:]) == {"a.geojson", "cells.csv", "map.zip"}


@pytest.mark.parametrize(("rates", "said"), [([120.0, 260.0], ""), ([40_000.0], "far above"), ([0.15], "less than"),
                                             ([0.0], "")])
def test_rates_that_no_field_gets_are_asked_about(rates, said):
    assert (said in implausible(rates, 500.0)) and bool(implausible(rates, 500.0)) == bool(said)
