"""What the tests of imports share: the command as a user calls it, files of their own, the deals of dialects."""
from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import Result
from typer.testing import CliRunner

from console.cli import app

HERE = Path(__file__).parent


@pytest.fixture
def topdress() -> Callable[..., Result]:
    """Runs the command with these arguments."""
    def run(*arguments: object) -> Result:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])
    return run


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Writes a text or bytes to a file of this test and gives its path."""
    def write(content: str | bytes, name: str = "log.csv", encoding: str = "utf-8") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode(encoding) if isinstance(content, str) else content)
        return path
    return write


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
