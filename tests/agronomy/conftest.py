from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from topdress.control.agronomy.crop import Crop

from tests.places import PAPERS

CROPS = Path(__file__).parents[2] / "configs" / "crops"


@pytest.fixture
def crop_data() -> Callable[[str], dict[str, Any]]:
    """The content of a shipped crop file, free to be changed."""
    return lambda name: yaml.safe_load((CROPS / f"{name}.yaml").read_text(encoding="utf-8"))


@pytest.fixture
def huanghai(crop_data) -> Crop:
    return Crop.model_validate(crop_data("huanghai_wheat"))


@pytest.fixture
def oklahoma(crop_data) -> Crop:
    return Crop.model_validate(crop_data("osu_winter_wheat_2004"))


@pytest.fixture
def paper_table() -> Callable[[str], list[dict[str, str]]]:
    """Rows of one of the papers' tables."""
    import csv

    def rows(name: str) -> list[dict[str, str]]:
        with (PAPERS / name).open(encoding="utf-8", newline="") as lines:
            return list(csv.DictReader(lines))

    return rows
