"""Without any extra: what a cab needs works, and all else is refused in one line with what
installs it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from topdress.drivers.files import optional_packages

from tests.places import TASK_FILES

ROOT = Path(__file__).parents[2]
MODULES = sorted(
    {module for _, modules in optional_packages.EXTRAS.values() for module in modules}
    | {"pyproj", "pandas", "dask"}
)
Ran = subprocess.CompletedProcess[str]
KML = """<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><ExtendedData>
<Data name="rate"><value>120</value></Data></ExtendedData>
<Polygon><outerBoundaryIs><LinearRing><coordinates>
117,40 117.001,40 117.001,40.001 117,40.001 117,40
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"""
ZONES = 'rate,wkt\n120,"POLYGON((117 40,117.001 40,117.001 40.001,117 40.001,117 40))"\n'
# Runs the command of each line that it reads, one after the other, and answers with how it ended.
PROGRAM = """
import contextlib, io, json, sys
from topdress.console.cli import main, simulate
simulate.LONG_RUN_S = 20.0
for line in sys.stdin:
    sys.argv = ["topdress", *json.loads(line)]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as ended:
            code = ended.code or 0
    print(json.dumps([code, out.getvalue(), err.getvalue()]), flush=True)
"""


@pytest.fixture(scope="module")
def slim(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Ran]]:
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

    program = subprocess.Popen(
        [sys.executable, "-P", "-c", PROGRAM],
        cwd=folder,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )

    def run(*words: object) -> Ran:
        assert program.stdin is not None and program.stdout is not None
        program.stdin.write(json.dumps([str(word) for word in words]) + "\n")
        program.stdin.flush()
        code, out, err = json.loads(program.stdout.readline())
        return Ran(words, code, out, err)

    ended = run("simulate", "--seconds", "30", "--seed", "1", "--out", "run.csv")
    assert ended.returncode == 0, ended.stderr
    yield run
    program.communicate(timeout=60)


@pytest.mark.parametrize(
    "words",
    [
        "simulate --seconds 21 --effect flow.gain=8 --summary --job spreader_demo",
        "replay run.csv --headless --out again.csv",
        f"check {ROOT}/configs/jobs/demo.yaml",
        "effects --json",
        "info",
        "record run.csv",
        f"import {ROOT}/docs/examples/import/tractor.csv --guess --out tractor.yaml",
        f"import {ROOT}/docs/examples/import/tractor.csv --out tractor-log.csv",
        f"import {ROOT}/docs/examples/import/applied.geojson --out points.csv",
        f"map {TASK_FILES}/fertilizer_map_1 --out task.zip",
        f"map {TASK_FILES}/fertilizer_map_1 --out shapes.shp",
        f"map {ROOT}/configs/jobs/map_demo.geojson --out map.geojson",
        "map field.kml --out of-kml.geojson",
        "map zones.csv --out of-csv.zip",
        "map run.csv --out applied.shp",
        "field field.kml --out field.yaml --job demo",
        "map run.csv --out sheet.html",
        pytest.param("reproduce --out papers", marks=pytest.mark.exam),
    ],
    ids=lambda words: words.replace(str(ROOT), "").replace("/", "_")[:40],
)
def test_what_a_cab_needs_works(slim: Callable[..., Ran], words: str) -> None:
    ended = slim(*words.split())
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(
    ("words", "packages"),
    [
        ("diagnose run.csv", "numba"),
        ("watch run.csv --to-end", "numba"),
        ("compare huanghai huanghai run.csv", "numba"),
        ("import run.csv --out run.parquet", "polars"),
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
    for name, line in zip(optional_packages.EXTRAS, said, strict=True):
        assert f"not installed: {optional_packages.format_extra_line(name)}" in line
