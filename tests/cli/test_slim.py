"""Without any extra: what a cab needs works, and all else is refused in one line with what
installs it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.files import extras
from drivers.files.table import read_table
from tests.places import TASK_FILES

ROOT = Path(__file__).parents[2]
MODULES = sorted(
    {module for _, modules in extras.EXTRAS.values() for module in modules}
    | {"pyproj", "pandas", "dask"}
)
Ran = subprocess.CompletedProcess[str]
KML = """<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><ExtendedData>
<Data name="rate"><value>120</value></Data></ExtendedData>
<Polygon><outerBoundaryIs><LinearRing><coordinates>
117,40 117.001,40 117.001,40.001 117,40.001 117,40
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"""
ZONES = 'rate,wkt\n120,"POLYGON((117 40,117.001 40,117.001 40.001,117 40.001,117 40))"\n'
PROGRAM = "from console.cli import main, simulate; simulate.LONG_S = 20.0; main()"


@pytest.fixture(scope="module")
def slim(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Ran]:
    """`topdress` in a process that has none of the extras' packages, in a folder of its own. A
    simulation is long, so that its steps would be compiled, from 20 s on."""
    folder = tmp_path_factory.mktemp("slim")
    (folder / "without").mkdir()
    (folder / "without" / "sitecustomize.py").write_text(
        f"import sys\nsys.modules.update(dict.fromkeys({MODULES}))\n"
    )
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join((str(folder / "without"), str(ROOT))),
        "XDG_DATA_HOME": str(folder),
    }
    (folder / "field.kml").write_text(KML)
    (folder / "zones.csv").write_text(ZONES)
    (folder / "bare.tif").write_bytes(b"II*\0")

    def run(*words: object) -> Ran:
        return subprocess.run(
            [sys.executable, "-P", "-c", PROGRAM, *map(str, words)],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
        )

    ended = run("simulate", "--seconds", "30", "--seed", "1", "--out", "run.csv")
    assert ended.returncode == 0, ended.stderr
    return run


@pytest.mark.parametrize(
    "words",
    [
        "simulate --seconds 21 --effect flow.gain=8 --summary --job spreader_demo",
        "replay run.csv --headless --out again.csv",
        f"check {ROOT}/configs/jobs/demo.yaml",
        "effects --json",
        "info",
        "record run.csv",
        f"map {TASK_FILES}/fertilizer_map_1 --out task.zip",
        f"map {TASK_FILES}/fertilizer_map_1 --out shapes.shp",
        f"map {ROOT}/configs/jobs/map_demo.geojson --out map.geojson",
        "map field.kml --out of-kml.geojson",
        "map zones.csv --out of-csv.zip",
        "map run.csv --out applied.shp",
        "field field.kml --out field.yaml --job demo",
        "map run.csv --out sheet.html",
        "reproduce --out papers",
    ],
    ids=lambda words: words.replace(str(ROOT), "").replace("/", "_")[:40],
)
def test_what_a_cab_needs_works(slim: Callable[..., Ran], words: str) -> None:
    ended = slim(*words.split())
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(
    ("words", "packages"),
    [
        ("diagnose run.csv", "numba polars"),
        ("watch run.csv --to-end", "numba polars"),
        ("compare huanghai huanghai run.csv", "numba polars"),
        ("import run.csv --guess", "numba polars"),
        ("fleet . --out season", "distributed fsspec cryptography numba polars"),
        ("map zones.csv --out zones.gpkg", "pyogrio"),
        ("map bare.tif", "rasterio"),
        ("serve", "textual-serve"),
    ],
)
def test_all_else_is_refused_with_what_installs_it(
    slim: Callable[..., Ran], words: str, packages: str
) -> None:
    ended = slim(*words.split())
    assert ended.returncode == 2 and ended.stderr.count("\n") == 1, ended.stderr
    line = ended.stderr.rstrip()
    assert re.findall(r"'([\w-]+)>=", line.partition(" install ")[2]) == packages.split(), line


def test_extras_says_what_is_there_and_what_installs_the_rest(slim: Callable[..., Ran]) -> None:
    said = slim("extras").stdout.splitlines()
    for name, line in zip(extras.EXTRAS, said, strict=True):
        assert f"not installed: {extras.extra_line(name)}" in line


@pytest.fixture
def without_polars(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    yield lambda: monkeypatch.setitem(sys.modules, "polars", None)


@pytest.mark.parametrize(
    "text",
    [
        "time_s,shaft_rpm,state,note\n0,1.5,ready,\n1,,working,a\n2,x,working,b\n",
        "time_s;rpm;name\n0,5;1.234,5;a\n1,5;n/a;b\n2,5;1'000;\n",
        "time_s,a,b\n0,1e3,inf\n1, 2 ,nan\n2,1_000,-\n",
        'time_s,a\n0,"1,5"\n1,"two\nlines"\n2,3\n',
        "time_s,a\n0,1,\n1,2,\n",
        "time_s,a\n0,1\n1,2,3\n2\n",
        "time_s,a\n0,1\n1,2",
        "time_s,a\n",
        "# of a tool\ntime_s,a,c\ns,mm,\n0,1,x\n1,2,y\n",
    ],
    ids=["words", "commas", "odd", "quotes", "past", "widths", "cut", "empty", "units"],
)
def test_a_table_reads_the_same_without_polars(
    tmp_path: Path, without_polars: Callable[[], None], text: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    quick = read_table(path, ("time_s", "shaft_rpm", "a"), ("state",))
    without_polars()
    slow = read_table(path, ("time_s", "shaft_rpm", "a"), ("state",))
    assert (slow.names, slow.findings, list(slow.columns)) == (
        quick.names,
        quick.findings,
        list(quick.columns),
    )
    for name, column in quick.columns.items():
        np.testing.assert_array_equal(slow.columns[name], column)
        assert slow.columns[name].dtype == column.dtype
