"""Benchmarks are programs beside the code; here they are loaded as modules and asked for their
figures."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def benchmark_module() -> Callable[[str], ModuleType]:
    def load(name: str) -> ModuleType:
        known = f"benchmark_{name}"
        if known not in sys.modules:
            spec = importlib.util.spec_from_file_location(known, ROOT / "benchmarks" / f"{name}.py")
            assert spec is not None and spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            sys.modules[known] = module
            # where the program itself finds what they share
            sys.path.insert(0, str(ROOT / "benchmarks"))
            try:
                spec.loader.exec_module(module)
            finally:
                sys.path.remove(str(ROOT / "benchmarks"))
        return sys.modules[known]

    return load
