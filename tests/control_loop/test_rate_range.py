"""Rates beyond the range of the machine: what is spread, what is said, what `check` foresees."""

from __future__ import annotations

from pathlib import Path

import pytest
from topdress.console.cli import app
from topdress.control.field.job import Wanted
from topdress.control.metering.rate_range import find_rate_range, find_speed_range
from topdress.control.orders import TargetSource
from typer.testing import CliRunner

from tests.control_loop.closed import SETUP, Closed

MACHINE = SETUP.machine
WIDTH_M = MACHINE.geometry.working_width_m
SPEEDS_AND_RATES = {
    "more than the machine can give": (20.0, 480.0, "rate_above_range", ()),
    "less than it can give": (3.0, 12.0, "rate_below_range", ()),
    "less than half of the least": (4.5, 5.0, "rate_below_range", ("below_range",)),
    "within its range": (4.5, 300.0, "", ()),
}


@pytest.mark.parametrize("name", SPEEDS_AND_RATES)
def test_a_rate_beyond_the_range_is_an_alarm_with_the_speed_that_helps(name):
    speed_kmh, rate_kg_ha, alarm_id, why_no_flow = SPEEDS_AND_RATES[name]
    target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=rate_kg_ha)
    closed = Closed(sim={"speed_kmh": speed_kmh}, target=target)
    verdict = closed.through(25.0)[-1].tick.verdict
    of_range = [alarm for alarm in verdict.alarms if "range" in alarm.id]
    assert [alarm.id for alarm in of_range] == ([alarm_id] if alarm_id else [])
    assert verdict.why_no_flow == why_no_flow
    for alarm in of_range:
        details = dict(alarm.details)
        assert details["wanted_kg_ha"] == rate_kg_ha
        low, high = find_rate_range(MACHINE, details["usable_kmh"] / 3.6, WIDTH_M)
        limit = high if alarm_id == "rate_above_range" else low
        assert limit == pytest.approx(rate_kg_ha, rel=0.02)


def test_the_range_of_speeds_is_the_inverse_of_the_range_of_rates():
    slowest, fastest = find_speed_range(MACHINE, 200.0, WIDTH_M)
    assert find_rate_range(MACHINE, slowest, WIDTH_M).low_kg_ha == pytest.approx(200.0)
    assert find_rate_range(MACHINE, fastest, WIDTH_M).high_kg_ha == pytest.approx(200.0)


def test_check_notes_a_rate_that_the_machine_cannot_give(tmp_path: Path):
    job = tmp_path / "job.yaml"
    for speed_kmh, rate_kg_ha, noted in ((20, 480, "at most 413"), (3, 12, "at least 23")):
        job.write_text(
            "format: topdress-job/1\nid: job\ntitle: job\ncrop: huanghai_wheat\n"
            f"planned_speed_kmh: {speed_kmh}\n"
            f"target: {{source: manual, manual_rate_kg_ha: {rate_kg_ha}}}\n",
            encoding="utf-8",
        )
        said = CliRunner().invoke(app, ["check", str(job)]).stdout
        assert f"manual rate {rate_kg_ha} kg/ha: machine huanghai gives {noted} kg/ha" in said
