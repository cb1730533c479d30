"""Strips that were measured on the way are still known after a power cut."""
from __future__ import annotations

import datetime as dt
from typing import Any, NamedTuple

from console.worker import resume
from console.worker.resume import Snapshot
from console.worker.resume_assemble import job_to_go_on
from console.worker.resume_keeper import Keeper
from control.agronomy.strips import Strips
from control.field.job import rule_of
from control.field.totals import NOTHING
from control.log_row import LogRow
from drivers.files.setup import load_setup


class Ticked(NamedTuple):
    row: LogRow
    alarms: tuple[Any, ...] = ()
    place_m: tuple[float, float] | None = None
    look_ahead: bool = True
    flow_trim_on: bool = True


class Loop:
    sums, flow_trim, plane = NOTHING, 1.0, None


def test_the_job_goes_on_with_its_strips(tmp_path):
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    path = tmp_path / "a.resume.json"
    keeper = Keeper(path, setup.machine, Snapshot(str(tmp_path / "a.csv")), Loop(), lambda: "2026-03-18T06:00:00+00:00")
    keeper.take(Ticked(LogRow(0.0, state="working", shaft_rpm_cmd=50.0)))
    keeper.take(Ticked(LogRow(1.0, state="working", events="mark;strip nrich 0.66 0.0041 38")))
    keeper.take(Ticked(LogRow(2.0, state="working", events="strip check 0.55;strip check x")))
    keeper.work(False)
    assert not keeper.trouble
    before = resume.read(path)
    assert (before.ndvi_nrich, before.ndvi_check) == (0.66, 0.55)
    job = job_to_go_on(setup.job, setup.machine, before)
    assert rule_of(setup.crop, job).strips == Strips(0.66, 0.55)


def test_a_snapshot_of_before_has_none(tmp_path):
    path = tmp_path / "a.resume.json"
    resume.write(path, Snapshot("a.csv"))
    text = path.read_text().replace('"ndvi_nrich":null,', "").replace('"ndvi_check":null,', "")
    assert "ndvi" not in text
    path.write_text(text)
    assert resume.read(path).ndvi_nrich is None
