"""The faults that count what the tests catch: one slip each, of four kinds, the same for the same seed."""
from __future__ import annotations

import ast

import pytest

SOURCE = '''
def rate(shaft_rpm, area, limit=3):
    """Text + text is no sum."""
    if area is None:
        return "none" + "at all"
    turns = shaft_rpm / 60.0 - area
    if turns > limit and len(str(turns)) < 9:
        turns = min(turns, limit)
    return -turns if turns < area else [1] + [2]
'''


@pytest.fixture
def kinds(benchmark_module):
    return benchmark_module("fault_kinds")


def test_each_slip_changes_one_place_and_is_still_a_program(kinds):
    found = kinds.possible("control/made.py", SOURCE)
    assert {(fault.kind, fault.old, fault.new) for fault in found} == {
        ("branch", "area is None", "False and (area is None)"), ("unit", "/", "*"), ("sign", "-", "+"),
        ("sign", "-", ""),
        ("branch", "turns > limit and len(str(turns)) < 9", "False and (turns > limit and len(str(turns)) < 9)"),
        ("bound", "limit", "2 * (limit)"), ("bound", "<", "<="), ("bound", "min", "max"),
        ("bound", "area", "2 * (area)")}
    for fault in found:
        changed = fault.put_into(SOURCE)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(SOURCE))
        assert fault.line == SOURCE.count("\n", 0, fault.start) + 1


def test_the_same_seed_deals_the_same_over_rooms_and_kinds(kinds, tmp_path):
    for room in kinds.ROOMS:
        (tmp_path / room).mkdir()
        (tmp_path / room / "made.py").write_text(SOURCE, encoding="utf-8")
    dealt = kinds.chosen(tmp_path, 12, 5)
    assert dealt == kinds.chosen(tmp_path, 12, 5) and len({fault.id for fault in dealt}) == 12
    assert {(fault.kind, fault.file.split("/")[0]) for fault in dealt} == {
        (kind, room) for kind in kinds.KINDS for room in kinds.ROOMS}
    assert [fault.id for fault in kinds.chosen(tmp_path, 12, 6)] != [fault.id for fault in dealt]


def test_tests_that_can_import_a_file_come_nearest_first(benchmark_module, tmp_path):
    faults = benchmark_module("faults")
    texts = {"control/near.py": "", "control/far.py": "from .near import x\n", "control/other.py": "",
             "tests/room/conftest.py": "from control import far\n",
             "tests/room/test_by_fixture.py": "def test_it(made): ...\n",
             "tests/hall/test_itself.py": "from control.near import x\n",
             "tests/hall/test_else.py": "import control.other\n",
             "tests/hall/test_program.py": "import subprocess\n"}
    for name, text in texts.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    (tmp_path / "control" / "__init__.py").write_text("", encoding="utf-8")
    for name in ("drivers", "console", "benchmarks"):
        (tmp_path / name).mkdir()
    found = faults.tests_of(tmp_path, "control/near.py", faults.imports_of(tmp_path))
    assert found == ["tests/hall/test_itself.py", "tests/room/test_by_fixture.py", "tests/hall/test_program.py"]
