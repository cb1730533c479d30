"""The generator of hidden machines, for several files of tests."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import SimpleNamespace

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def hidden() -> SimpleNamespace:
    """The modules of the generator of hidden machines by attribute: hidden.cases, hidden.plant
    ..."""
    return SimpleNamespace(
        **{
            path.stem: importlib.import_module(f"tests.diagnosis.hidden.{path.stem}")
            for path in sorted((HERE / "hidden").glob("[a-z]*.py"))
            if path.stem != "make"
        }
    )
