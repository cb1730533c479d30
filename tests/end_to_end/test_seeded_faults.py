"""The seeded faults that tests are tried with: each stands where it was chosen, compiles, and its line is found out."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = """def share(a, b, most):
    if b < 0:
        return 0.0
    text = f"{100.0 * (a - b):g}"
    return min(most, a - b) / 100.0 if text else most
"""


@pytest.fixture
def kinds(benchmark_module: Callable[[str], ModuleType]) -> ModuleType:
    return benchmark_module("fault_kinds")


@pytest.fixture
def reach(benchmark_module: Callable[[str], ModuleType]) -> ModuleType:
    return benchmark_module("fault_reach")


@pytest.mark.exam               # looks for every place in all sources, three times
def test_the_same_seed_gives_the_same_faults_of_every_kind_and_room(kinds: ModuleType, reach: ModuleType,
                                                                    tmp_path: Path) -> None:
    found = kinds.chosen(ROOT, 40, 7)
    assert found == kinds.chosen(ROOT, 40, 7) != kinds.chosen(ROOT, 40, 8)
    assert {(one.kind, one.file.partition("/")[0]) for one in found} == {
        (kind, room) for kind in kinds.KINDS for room in kinds.ROOMS}
    for one in found:
        text = (ROOT / one.file).read_text(encoding="utf-8")
        assert one.put_into(text) != text
        compile(one.put_into(text), one.file, "exec")
        compile(reach.probed(text, {0: one}, tmp_path / "out"), one.file, "exec")


def test_a_probed_source_does_the_same_and_says_which_test_ran_it(kinds: ModuleType, reach: ModuleType, tmp_path: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    faults = list(kinds.possible("a.py", SOURCE))
    assert {one.kind for one in faults} == set(kinds.KINDS)
    out = tmp_path / "out"
    out.touch()
    space: dict[str, Callable[..., float]] = {}
    exec(reach.probed(SOURCE, dict(enumerate(faults)), out), space)
    monkeypatch.setenv("PYTEST_CURRENT_TEST", "a.py::one (call)")
    assert space["share"](1.0, -2, 9.0) == 0.0
    monkeypatch.setenv("PYTEST_CURRENT_TEST", "a.py::other (setup)")
    assert space["share"](8.0, 3, 9.0) == space["share"](8.0, 3, 9.0) == 0.05
    ran = reach.reached_by(out.read_text(encoding="utf-8").splitlines(), faults)
    first = [one for one in faults if one.line == 2]
    assert all(ran[one.id] == ["a.py::one", "a.py::other"] for one in first) and first
    assert all(ran[one.id] == ["a.py::other"] for one in faults if one.line > 3)
