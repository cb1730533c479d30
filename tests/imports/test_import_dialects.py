"""Dialects dealt at random over a known log: what comes in is the log. `dialects.py` deals more."""
from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

DEALS = 22


@pytest.mark.parametrize("number", range(DEALS))
@pytest.mark.filterwarnings("ignore::shapefile.PossibleDataLoss")
def test_a_dialect_comes_in_as_the_truth(number: int, dialects: ModuleType, tmp_path: Path) -> None:
    assert dialects.problems(dialects.deal(number, seed=13), dialects.true_log(), tmp_path) == []


def test_the_deals_of_the_suite_meet_every_kind(dialects: ModuleType) -> None:
    deals = [dialects.deal(number, seed=13) for number in range(DEALS)]
    assert {of.kind for of in deals} == {"text", "excel", "parquet", "geojson", "shapefile"}
    assert {of.language for of in deals} == {"en", "de", "zh"}
    assert {of.told for of in deals} == {True, False}
    texts = [of for of in deals if of.kind == "text"]
    assert len({of.encoding for of in texts}) >= 4 and any(of.comma for of in texts)
