"""The table of hazards in docs/safety.md: ids and tests that are there, and nothing that stops
flow left out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from topdress.control.orders import Severity
from topdress.control.safety import ALARMS, INTERLOCKS, drive_gate

ROOT = Path(__file__).parents[2]
ROW = re.compile(
    r"^\| (?P<hazard>[^|]+) \| (?P<held>[^|]+) \| (?P<after>[^|]+) \| (?P<tests>[^|]+) \|$",
    re.MULTILINE,
)
SECTION = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8").partition("\n## Hazards\n")[2]
ROWS = [row.groupdict() for row in ROW.finditer(SECTION)][1:]
TESTS = {
    name
    for path in (ROOT / "tests").rglob("test_*.py")
    for name in re.findall(
        r"^\s*(?:async )?def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE
    )
}


def test_every_alarm_is_in_the_table_of_losses():
    page = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    table = page.partition("## Losses and alarms")[2].partition("\n## ")[0]
    assert set(ALARMS) <= set(re.findall(r"\w+", table))


def test_every_interlock_and_every_red_alarm_is_in_the_table():
    named = {word for row in ROWS for word in re.findall(r"`(\w+)`", row["held"])}
    red = {kind.id for kind in ALARMS.values() if kind.severity is Severity.RED}
    assert red | set(INTERLOCKS) <= named, red | set(INTERLOCKS) - named
    unknown = named - set(ALARMS) - set(INTERLOCKS)
    assert all(hasattr(drive_gate, word) for word in unknown), unknown


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["hazard"][:40])
def test_each_hazard_has_a_time_and_tests_that_exist(row):
    assert re.search(r"\d m?s\b", row["after"]), row
    named = [name.strip() for name in row["tests"].split(",")]
    assert named and set(named) <= TESTS, set(named) - TESTS
