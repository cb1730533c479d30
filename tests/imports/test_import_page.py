"""Every command on docs/import.md is run, and says what the page says; its files are those of their script."""
from __future__ import annotations

import re
import runpy
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from drivers.files.imports.units import UNITS
from drivers.files.read_log import read_log

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "docs" / "examples" / "import"


def shown() -> list[tuple[str, str]]:
    """Commands on the page, in order, with what they say there."""
    blocks = re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL)
    pieces = [piece for block in blocks for piece in block.split("$ ") if piece]
    return [(command, said) for command, _, said in (piece.partition("\n") for piece in pieces)]


def test_every_command_says_what_the_page_shows(topdress: Callable[..., Result], tmp_path: Path,
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(EXAMPLES, tmp_path / "docs" / "examples" / "import")
    monkeypatch.chdir(tmp_path)
    commands = shown()
    assert len(commands) == 8
    for command, said in commands:
        result = topdress(*shlex.split(command)[1:])
        if said != "...\n":
            assert result.output == said, command
        assert result.exit_code in (0, 2) and (result.exit_code == 0 or "not imported" in said or said == "...\n")
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
        if unit.quantity not in ("other", "time"):
            assert re.search(rf"(?<![\w/]){re.escape(unit.name)}(?![\w/])", listed), unit.name
