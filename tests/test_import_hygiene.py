"""What each program pulls in. import-linter does not see what an __init__ of ours imports; the
interpreter does."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.files.extras import EXTRAS

ROOT = Path(__file__).parents[1]
HEAVY = {"textual", "rich", "numba", "scipy", "polars"}


def loaded_by(start: str) -> set[str]:
    """Names of all modules that a fresh interpreter holds after importing `start`."""
    code = f"import {start}, sys; print(*sys.modules)"
    ended = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 0, ended.stderr
    return set(ended.stdout.split())


LIGHT = (
    "console.worker.__main__",
    "console.link",
    "console.frame",
    "control.loop",
    "drivers",
    "drivers.cab",
    "drivers.virtual",
    "drivers.files.run_log",
    "control.calibration",
    "console.cli.encoder",
)
OF_FILES = {"numpy", "pydantic", "yaml", "serial"}
DIAGNOSE = (
    "console.cli.diagnose, console.reports.diagnosis_text, control.diagnosis.runs.diagnose, "
    "control.diagnosis.runs.several, control.diagnosis.tables.diagnose, drivers.files.opened"
)
FIRST_PICTURE = (
    "console.app.app, console.app.pages.run.page, console.services.running_limits, "
    "console.services.field, "
    "console.services.line_files, console.services.live_checker, console.services.settings"
)
FLEET = (
    "console.cli.fleet, console.services.fleet, console.services.fleet_tables, console.reports.html"
)


@pytest.mark.parametrize(
    ("start", "not_yet"),
    [
        *((start, HEAVY) for start in LIGHT),
        ("console.link", OF_FILES),  # the first paint waits for it
        # the worker takes as long to come up as the console, and at the same time: what is
        # imported before it is started comes on top of both
        *(
            (start, {*HEAVY, *OF_FILES, "shapely", "shapefile"})
            for start in ("console.cli", "console.cli.screens", "console.services.launcher")
        ),
        ("console.worker.__main__", {"shapefile", "http"}),  # before a job names shapes
        # of the machine's model and files the first picture shows nothing: they are read once
        # it is seen
        pytest.param(
            FIRST_PICTURE,
            {
                "control.machine.machine",
                "control.field.job",
                "control.diagnosis.result",
                "shapely",
                "drivers.files.kinds",
            },
            id="first picture",
        ),
        # the workers begin a second earlier: this process reads the judgement while they are at
        # their logs
        pytest.param(FLEET, {"scipy", "numba", "polars"}, id="fleet"),
        pytest.param(DIAGNOSE, {"textual", "scipy.stats", "scipy.optimize"}, id="diagnose"),
    ],
)
def test_starts_light(start: str, not_yet: set[str]) -> None:
    assert not loaded_by(start) & not_yet


def test_nothing_that_a_cab_needs_loads_an_extra() -> None:
    """Every module without the extras' packages; those that cannot be loaded so are asked for
    by what needs one."""
    modules = sorted({module for _, of in EXTRAS.values() for module in of})
    code = f"""import pkgutil, sys
sys.modules.update(dict.fromkeys({modules}))
for root in (__import__(name) for name in ("console", "control", "drivers")):
    for found in pkgutil.walk_packages(
        root.__path__, root.__name__ + ".", onerror=lambda name: None,
    ):
        if not found.name.startswith("drivers.board."):
            try:
                __import__(found.name)
            except ModuleNotFoundError:
                print(found.name)"""
    ended = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 0, ended.stderr
    needs = [
        name
        for name in ended.stdout.split()
        if not name.startswith(
            ("control.diagnosis", "console.reports.", "console.serve.", "drivers.files.imports.")
        )
    ]
    assert needs == [
        "console.services.diagnosis_view",
        "console.services.fleet_season",
        "control.field.compiled_cells",
        "control.machine.compiled",
        "control.machine.compiled_tick",
        "control.machine.jit_cache",
        "control.simulation.compiled_steps",
    ]


def test_control_is_ours() -> None:
    """python-control on PyPI installs into the same folder `control/`."""
    import control

    assert not hasattr(control, "StateSpace")


@pytest.mark.parametrize(
    ("beside", "init", "said", "code"),
    [
        ("", "", "", 0),
        ("xferfcn.py", "", "note: python-control lies in the same folder `control` as topdress", 0),
        (
            "xferfcn.py",
            '"""The Python Control Systems Library."""',
            "topdress's folder `control` is not whole",
            1,
        ),
    ],
    ids=["alone", "under", "over"],
)
def test_a_package_of_the_same_name_is_said(
    tmp_path: Path, beside: str, init: str, said: str, code: int
) -> None:
    for name in ("console", "drivers", "configs"):
        (tmp_path / name).symlink_to(ROOT / name)
    shutil.copytree(
        ROOT / "control", tmp_path / "control", ignore=shutil.ignore_patterns("__pycache__")
    )
    if init:
        (tmp_path / "control" / "__init__.py").write_text(init)
    if beside:
        (tmp_path / "control" / beside).touch()
    ended = subprocess.run(
        [sys.executable, "-P", "-c", "from console.cli import main; main()", "--version"],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )
    assert ended.returncode == code and said in ended.stderr and bool(ended.stderr) == bool(said), (
        ended.stderr
    )
    assert ended.stdout.startswith("topdress") == (code == 0)


@pytest.mark.parametrize(
    "start",
    ["control.diagnosis.runs.diagnose", "control.calibration", "console.services.fleet_season"],
)
def test_an_answer_does_not_wait_for_all_of_scipy(start: str) -> None:
    """scipy.stats alone, which scipy.signal loads too, takes a second; scipy.special has the
    same quantiles. The closed loop and scipy.optimize, which scipy.interpolate loads too, take
    three tenths."""
    code = f"import {start}, sys; print(*sys.modules)"
    ended = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 0, ended.stderr
    assert not set(ended.stdout.split()) & {
        "scipy.stats",
        "scipy.signal",
        "scipy.optimize",
        "control.simulation",
    }
