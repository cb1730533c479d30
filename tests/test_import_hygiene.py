"""What each program pulls in. import-linter does not see what an __init__ of ours imports; the
interpreter does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from topdress.drivers.files.optional_packages import EXTRAS

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
    "topdress.console.worker.__main__",
    "topdress.console.link",
    "topdress.console.frame",
    "topdress.control.loop",
    "topdress.drivers",
    "topdress.drivers.cab",
    "topdress.drivers.virtual",
    "topdress.drivers.files.run_log",
    "topdress.control.calibration",
    "topdress.console.cli.encoder",
)
OF_FILES = {"numpy", "pydantic", "yaml", "serial"}
DIAGNOSE = (
    "topdress.console.cli.diagnose, topdress.console.reports.diagnosis_text, "
    "topdress.control.diagnosis.runs.diagnose, "
    "topdress.control.diagnosis.runs.several, topdress.control.diagnosis.tables.diagnose, "
    "topdress.drivers.files.file_content"
)
FIRST_PICTURE = (
    "topdress.console.app.app, topdress.console.app.pages.run.page, "
    "topdress.console.services.running_limits, "
    "topdress.console.services.field, "
    "topdress.console.services.line_files, topdress.console.services.live_checker, "
    "topdress.console.services.settings"
)
FLEET = (
    "topdress.console.cli.fleet, topdress.console.services.fleet, "
    "topdress.console.services.fleet_tables, topdress.console.reports.html"
)


@pytest.mark.parametrize(
    ("start", "not_yet"),
    [
        (", ".join(LIGHT), HEAVY),
        ("topdress.console.link", OF_FILES),  # the first paint waits for it
        # the worker takes as long to come up as the console, and at the same time: what is
        # imported before it is started comes on top of both
        (
            "topdress.console.cli, topdress.console.cli.screens, "
            "topdress.console.services.launcher",
            {*HEAVY, *OF_FILES, "shapely", "shapefile"},
        ),
        ("topdress.console.worker.__main__", {"shapefile", "http"}),  # before a job names shapes
        # of the machine's model and files the first picture shows nothing: they are read once
        # it is seen
        pytest.param(
            FIRST_PICTURE,
            {
                "topdress.control.machine.machine",
                "topdress.control.field.job",
                "topdress.control.diagnosis.result",
                "shapely",
                "topdress.drivers.files.config_kinds",
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
from topdress import console, control, drivers
for root in (console, control, drivers):
    for found in pkgutil.walk_packages(
        root.__path__, root.__name__ + ".", onerror=lambda name: None,
    ):
        if not found.name.startswith("topdress.drivers.board."):
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
            (
                "topdress.control.diagnosis",
                "topdress.console.reports.",
                "topdress.console.serve.",
                "topdress.drivers.files.imports.",
            )
        )
    ]
    assert needs == [
        "topdress.console.services.diagnosis_view",
        "topdress.console.services.fleet_season",
        "topdress.control.field.compiled_cells",
        "topdress.control.machine.compiled",
        "topdress.control.machine.compiled_tick",
        "topdress.control.machine.jit_cache",
        "topdress.control.simulation.compiled_steps",
    ]


def test_another_package_named_control_changes_nothing(tmp_path: Path) -> None:
    """python-control on PyPI is imported as `control`; topdress is one package of its own name."""
    (tmp_path / "control").mkdir()
    (tmp_path / "control" / "__init__.py").write_text("StateSpace = object\n")
    code = (
        "import control; from topdress.console.cli import main; print(control.StateSpace); main()"
    )
    ended = subprocess.run(
        [sys.executable, "-P", "-c", code, "--version"],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))},
    )
    assert (ended.returncode, ended.stderr) == (0, ""), ended.stderr
    assert ended.stdout.splitlines()[-1].startswith("topdress ")


@pytest.mark.parametrize(
    "start",
    [
        "topdress.control.diagnosis.runs.diagnose",
        "topdress.control.calibration",
        "topdress.console.services.fleet_season",
    ],
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
        "topdress.control.simulation",
    }
