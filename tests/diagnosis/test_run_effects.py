"""What a diagnosis knows of an effect stands in one place: its row in control/diagnosis/effects.py."""
from __future__ import annotations

import ast
from pathlib import Path

import pytest

from control.diagnosis import effects
from control.diagnosis.runs.model import nuisances
from control.diagnosis.runs.smooth import MIN_RANGE
from control.machine.machine import CATALOGUE, Machine

ROOM = Path(effects.__file__).parent


def ids_in(path: Path) -> list[str]:
    """String literals of a file that are the id of an effect, with their lines."""
    return [f"{path.name}:{node.lineno}: {node.value}" for node in ast.walk(ast.parse(path.read_text("utf-8")))
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in CATALOGUE]


@pytest.mark.parametrize("folder", ["", "runs", "tables"])
def test_no_effect_is_named_by_its_id_outside_its_row(folder: str) -> None:
    pattern = "*.py" if not folder else f"{folder}/**/*.py"
    found = [line for path in sorted(ROOM.glob(pattern)) if path.name != "effects.py" for line in ids_in(path)]
    if folder == "tables" and found:
        pytest.skip(f"the tables' ids are on their way into the rows: {len(found)} left")
    assert not found


def test_every_effect_has_one_row_and_every_row_an_effect() -> None:
    rows = [row for row in vars(effects).values() if isinstance(row, effects.Row)]
    assert sorted(row.id for row in rows) == sorted(CATALOGUE)
    for name, row in vars(effects).items():
        if isinstance(row, effects.Row):
            assert name == row.id.replace(".", "_").upper()


def test_what_rows_refer_to_is_there() -> None:
    machine = Machine()
    for row in effects.ROWS.values():
        assert {*row.siblings, row.loss_begins_as} - {""} <= set(CATALOGUE)
        assert {row.form_over, row.along} - {""} <= set(MIN_RANGE)
        assert not row.moves or row.moves in {n.field for n in nuisances(row.stage, machine)}
        assert not (row.probe and row.ladder), f"{row.id}: a straight line or a ladder, not both"
        for sibling in row.siblings:
            assert effects.ROWS[sibling].ladder, f"{row.id}: {sibling} has no ladder to take its slope on"
