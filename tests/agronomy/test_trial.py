"""Table 2 of paper A: which of its columns the abstract's 28 kg N/ha comes from."""
from __future__ import annotations

import pytest

from control.agronomy.trial import extra_nitrogen_kg_ha, rate_from_weighing_kg_ha


def test_28_kg_more_nitrogen_is_of_the_applied_amounts(paper_table):
    rows = paper_table("decision_table2_applied.csv")
    extra = {column: extra_nitrogen_kg_ha(
        [rate_from_weighing_kg_ha(float(row[column]), float(row["area_m2"])) for row in rows], 300.0)
        for column in ("applied_kg", "target_kg")}
    assert extra["applied_kg"] == pytest.approx(28.75)
    assert extra["target_kg"] == pytest.approx(17.75)


def test_by_hand_and_refused():
    assert rate_from_weighing_kg_ha(22.0, 600.0) == pytest.approx(366.7, abs=0.05)
    assert extra_nitrogen_kg_ha([100.0, 200.0], 100.0, 0.5) == 25.0
    with pytest.raises(ValueError, match="area 0"):
        rate_from_weighing_kg_ha(1.0, 0.0)
    with pytest.raises(ValueError, match="no plots"):
        extra_nitrogen_kg_ha([], 300.0)
