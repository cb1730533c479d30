"""`python -m benchmarks`: its index, and that every benchmark that a page names is in it."""
from __future__ import annotations

import re
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"python -m benchmarks ([a-z_]+(?:/[a-z_]+)?)|benchmarks/([a-z_/]+)\.py")


@pytest.fixture(scope="module")
def program() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "benchmarks" / "__main__.py"), run_name="index")


def test_every_benchmark_says_in_a_line_what_it_asks(program: dict[str, Any]) -> None:
    found = program["index"]()
    assert {"loss_table", "diagnosis/run"} <= found.keys() and "verdict" not in found
    assert all(10 < len(said) <= 130 for said in found.values()), found


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))],
                         ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_is_there(page: Path, program: dict[str, Any]) -> None:
    names = [first or second for first, second in NAMED.findall(page.read_text(encoding="utf-8"))]
    assert [name for name in names if not (ROOT / "benchmarks" / f"{name}.py").exists()] == []


def test_an_unknown_name_is_refused_in_a_line(program: dict[str, Any],
                                              capsys: pytest.CaptureFixture[str]) -> None:
    main: Callable[[list[str]], int] = program["main"]
    assert main(["nothing"]) == 2
    assert capsys.readouterr().err.startswith("nothing: no such benchmark; allowed: ")
    assert main([]) == 0 and "loss_table" in capsys.readouterr().out
