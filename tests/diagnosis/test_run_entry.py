"""The entry of a notebook: `from control.diagnosis import diagnose_run, diagnose_tables, extend`."""
from __future__ import annotations

import doctest
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import control
import control.diagnosis as entry
from control.diagnosis.runs.report import by_chance


@pytest.mark.parametrize("module", ["control.diagnosis.runs.diagnose", "control.diagnosis.extend"])
def test_the_examples_in_the_docstrings_do_what_they_say(module: str) -> None:
    tried = doctest.testmod(import_module(module))
    assert tried.attempted >= 4 and tried.failed == 0


def test_the_entry_has_what_a_notebook_needs() -> None:
    for name in entry.__all__:
        assert callable(getattr(entry, name)), name
    from control.diagnosis.run import diagnose_run
    assert entry.diagnose_run is diagnose_run
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        _ = entry.nothing_of_the_kind


def test_a_page_that_only_shows_a_diagnosis_starts_without_the_search() -> None:
    asked = "import sys, control.diagnosis.result; print(sorted({'scipy', 'numba'} & set(sys.modules)))"
    told = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


def test_the_package_says_that_it_has_types() -> None:
    assert (Path(control.__file__).parent / "py.typed").exists()


def test_a_part_that_gains_less_than_nothing_has_a_probability_all_the_same():
    assert by_chance(-0.4) == 1.0 and by_chance(0.0) == 1.0
    assert by_chance(3.84) == pytest.approx(0.05, abs=0.001)
