"""What the tests of imports share: the command as a user calls it, files of their own, the deals of dialects."""
from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

HERE = Path(__file__).parent


def _beside(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"topdress_{name}", HERE / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[f"topdress_{name}"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def dialects() -> ModuleType:
    return _beside("dialects")


@pytest.fixture(scope="session")
def dresses(dialects: ModuleType) -> ModuleType:
    return _beside("dresses")


@pytest.fixture(scope="session")
def task_sets() -> ModuleType:
    return _beside("task_sets")
