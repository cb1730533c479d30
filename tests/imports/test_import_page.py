"""What the commands on docs/import.md make of its files; these are those of their script."""
from __future__ import annotations

import re
import runpy
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from drivers.files.imports.units import UNITS
from drivers.files.read_log import read_log

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "docs" / "examples" / "import"


def test_what_its_commands_make(topdress: Callable[..., Result], tmp_path: Path,
                                monkeypatch: pytest.MonkeyPatch) -> None:
    """That they say what the page shows is seen with those of the other pages (tests/docs)."""
    monkeypatch.chdir(tmp_path)
    for name, more in (("planter.csv", ["--mapping", EXAMPLES / "planter.yaml"]), ("tractor.csv", []),
                       ("applied.geojson", [])):
        assert topdress("import", EXAMPLES / name, *more, "--out", f"{Path(name).stem}-log.csv").exit_code == 0
    planter = read_log(tmp_path / "planter-log.csv")
    assert planter.texts("utc")[0] == "2026-04-14T07:30:00.000Z"
    assert set(planter.texts("state")) == {"ready", "working"}
    assert planter.numbers("opening_mm").max() <= 60.0
    assert "x_发动机扭矩_nm" in read_log(tmp_path / "tractor-log.csv").columns
    wanted = read_log(tmp_path / "applied-log.csv").numbers("target_rate_kg_ha")
    assert set(wanted.round(1)) <= {134.5, 168.1, 201.8, 235.4}


def test_the_example_files_are_those_of_their_script(tmp_path: Path) -> None:
    made = runpy.run_path(str(EXAMPLES / "make.py"))["FILES"]
    for name, write in made.items():
        assert (EXAMPLES / name).read_bytes() == write(), f"{name}: run docs/examples/import/make.py"


def test_the_shipped_import_file_is_the_guess_with_two_lines_by_hand(topdress: Callable[..., Result],
                                                                     tmp_path: Path) -> None:
    topdress("import", EXAMPLES / "planter.csv", "--guess", "--mapping", tmp_path / "planter.yaml")
    guessed = (tmp_path / "planter.yaml").read_text(encoding="utf-8").splitlines()
    shipped = (EXAMPLES / "planter.yaml").read_text(encoding="utf-8").splitlines()
    by_hand = [line for line in shipped if line not in guessed and not line.startswith("#")]
    assert [line.strip() for line in by_hand] == ["zone: Europe/Berlin", "opening_mm:", "from: Schieberöffnung",
                                                  'unit: "%"', "full: 60"]


def test_the_page_names_every_unit_that_a_column_can_be_in() -> None:
    listed = PAGE[PAGE.index("Units: "):PAGE.index("Usual other spellings")]
    for unit in UNITS:
        if unit.quantity not in ("other", "time", "nitrogen", "count"):         # no column of a log is in those
            assert re.search(rf"(?<![\w/]){re.escape(unit.name)}(?![\w/])", listed), unit.name
