"""The generator of hidden machines, for several files of tests."""
from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def hidden() -> Iterator[SimpleNamespace]:
    """The modules of the generator of hidden machines by attribute: hidden.cases, hidden.plant ..."""
    sys.path.insert(0, str(HERE))
    try:
        yield SimpleNamespace(**{path.stem: importlib.import_module(f"hidden.{path.stem}")
                                 for path in sorted((HERE / "hidden").glob("[a-z]*.py"))})
    finally:
        sys.path.remove(str(HERE))
