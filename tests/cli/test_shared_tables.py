"""Every table beside the checkout goes through diagnose and calibrate: an answer or one plain line."""
from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from console.cli import app

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
TABLES = sorted(DATA.glob("*.csv"))
pytestmark = pytest.mark.skipif(not TABLES, reason="the shared tables are not beside this checkout")
ANSWERED = {
    "diagnose": {"decision_table2_applied", "lag_table1_distance", "lag_table2_response", "lag_table3_drop_time",
                 "lag_table4_total", "lag_table5_corrected", "lag_table6_gain"},
    "lag": {"lag_table1_distance", "lag_table3_drop_time"},
    "catch": set(), "wheel": set(), "heads": set(),
}


@pytest.mark.parametrize("command", ANSWERED)
@pytest.mark.parametrize("table", TABLES, ids=lambda path: path.stem)
def test_an_answer_or_one_plain_line(table: Path, command: str, tmp_path: Path) -> None:
    out = tmp_path / "new.yaml"
    arguments = ["diagnose", str(table)] if command == "diagnose" else ["calibrate", command, str(table), "--out",
                                                                       str(out)]
    told = CliRunner().invoke(app, arguments)
    assert told.exception is None or isinstance(told.exception, SystemExit)
    if table.stem in ANSWERED[command]:
        assert told.exit_code == 0 and told.stdout
        return
    assert told.exit_code == 2 and not out.exists()
    assert len(told.stderr.splitlines()) == 1 and table.name in told.stderr


def test_a_table_that_holds_no_drop_time_is_told_so_before_its_labels(tmp_path: Path) -> None:
    told = CliRunner().invoke(app, ["calibrate", "lag", str(DATA / "lag_table2_response.csv"), "--out",
                                    str(tmp_path / "new.yaml")])
    assert "response_s holds no drop time" in told.stderr
