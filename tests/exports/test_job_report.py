"""The report of a job: its figures are the log's, its pictures are inside, and `topdress map`
writes it."""

from __future__ import annotations

import csv
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from topdress.control.log_row import LogRow
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.exports.as_applied import AsApplied, SpreadProduct, build_as_applied
from topdress.drivers.files.read_log import RunLog, read_log
from topdress.drivers.files.run_log import write_whole_log
from topdress.drivers.files.run_meta import make_run_meta

from tests.command import topdress


def test_the_page_tells_the_logs_sums(applied: AsApplied) -> None:
    from topdress.console.reports.job_page import make_job_page

    page = make_job_page(applied, "topdress test")
    t = applied.totals
    assert f"{t.applied_kg:.2f} kg" in page and f"{t.area_ha:.4f} ha" in page
    assert (
        f"{t.covered_ha:.4f} ha, each place once; 0.0000 ha passed over again" in page
        and "doses" not in page
    )
    assert f"{t.applied_n_kg:.2f} kg (46.0 % of the product)" in page
    assert page.count("<svg") == 2 and "2026-03-07 23:59 UTC" in page
    assert "within 2 %" in page


def test_a_map_says_where_the_drives_effort_rose(known_log: RunLog, tmp_path: Path) -> None:
    """A machine file 20 % off all along says nothing; 3 m of clods at 20 s do."""
    from topdress.console.reports.job_page import calc_effort_rise, make_job_page

    machine = load_config("huanghai", MACHINE_KIND).model
    own = 8.0 + 0.6 * 70.0 + 0.06 * 5.5 * 20.0
    with (
        known_log.path.open(encoding="utf-8", newline="") as text,
        (tmp_path / "effort.csv").open("w", encoding="utf-8", newline="") as out,
    ):
        rows = csv.DictReader(text)
        written = csv.DictWriter(out, rows.fieldnames or ())
        written.writeheader()
        for one in rows:
            clods = 20.0 <= float(one["time_s"]) < 22.4
            written.writerow(one | {"shaft_effort": f"{own * (1.8 if clods else 1.2):.3f}"})
    applied = build_as_applied(
        read_log(tmp_path / "effort.csv"), machine, SpreadProduct("urea", 0.46)
    )
    rise, s = calc_effort_rise(applied), applied.stretches
    assert np.nanmax(rise) == pytest.approx(60.0, abs=2.0) and np.nanmedian(rise) == pytest.approx(
        0.0, abs=0.1
    )
    assert s.time_s[rise > 10.0].min() > 19.9 and s.time_s[rise > 10.0].max() < 22.6
    page = make_job_page(applied, "topdress test")
    assert (
        page.count("<svg") == 3
        and "How hard the metering drive worked" in page
        and "hardest</" in page
    )


def test_doses_have_a_line_of_their_own(applied: AsApplied) -> None:
    from topdress.console.reports.job_page import make_job_page

    point = dataclasses.replace(applied, totals=applied.totals._replace(doses=286, doses_missed=3))
    assert "286, plants missed: 3" in make_job_page(point, "topdress test")


def test_the_error_is_applied_against_target_by_area(applied: AsApplied) -> None:
    from topdress.console.reports.job_page import calc_error_percent

    error, area = calc_error_percent(applied)
    assert area.sum() == pytest.approx(10_000 * applied.totals.area_ha)
    assert float((error * area).sum() / area.sum()) == pytest.approx(0.0, abs=0.2)
    doubled = dataclasses.replace(
        applied,
        stretches=applied.stretches._replace(applied_kg_ha=2.0 * applied.stretches.target_kg_ha),
    )
    assert calc_error_percent(doubled)[0] == pytest.approx(np.full(len(error), 100.0))


def test_shares_of_the_area_by_how_far_it_is_off(applied: AsApplied) -> None:
    """A quarter of the area 1 % off, a quarter 4 %, a quarter 15 % too little, the rest twice
    what was wanted."""
    from topdress.console.reports.job_page import describe_errors

    s = applied.stretches
    known = np.flatnonzero(np.isfinite(s.target_kg_ha) & (s.target_kg_ha > 0.0))
    off = np.full(s.time_s.size, 1.0)
    for factor, some in zip((1.01, 0.96, 0.85, 2.0), np.array_split(known, 4), strict=True):
        off[some] = factor
    area = np.zeros_like(off)
    for some in np.array_split(known, 4):
        area[some] = 100.0 / len(some)
    words = describe_errors(
        dataclasses.replace(
            applied, stretches=s._replace(applied_kg_ha=off * s.target_kg_ha, area_m2=area)
        )
    )
    said = re.findall(r"within ([0-9]+) %.*?([0-9.]+) % of the area", words, re.S)
    assert said == [("2", "25.0"), ("5", "50.0"), ("10", "50.0"), ("20", "75.0")]


def test_it_is_a_sheet_to_hand_over(applied: AsApplied, tmp_path: Path) -> None:
    from topdress.console.reports.job_metadata import find_job_events, read_job_metadata
    from topdress.console.reports.job_page import make_job_page

    states = {0: "off", 2: "working", 6: "held", 8: "working"}
    rows, state = [], "off"
    for k in range(10):
        state = states.get(k, state)
        rows.append(
            LogRow(
                time_s=60.0 * k,
                state=state,
                alarms="hopper_low;shaft_silent" if 4 <= k < 6 else "hopper_low" if k == 3 else "",
                events="refill 250.0" if k == 7 else "",
            )
        )
    job = {
        "client": "Li <Ming>",
        "farm": "East",
        "operator": "",
        "product": "urea 46-0-0",
        "field": {"title": "division 2"},
        "target": {"source": "map", "map": "C:\\maps\\north.geojson"},
    }
    path = tmp_path / "log.csv"
    write_whole_log(path, make_run_meta(None, {"name": "winter wheat"}, job, seed=7), rows)
    told = find_job_events(read_log(path))
    assert told.working == ((120.0, 360.0), (480.0, 540.0)) and told.refills == ((420.0, 250.0),)
    assert sorted(told.alarms) == [("hopper_low", 180.0, 360.0), ("shaft_silent", 240.0, 360.0)]
    about = read_job_metadata(read_log(path))
    page = make_job_page(applied, "topdress test", about)
    for said in (
        "Li &lt;Ming&gt;",
        "East",
        "division 2",
        "winter wheat",
        "urea 46-0-0",
        "north.geojson",
        "SIMULATED",
        "250 kg",
        "shaft silent",
        "against the plan",
        "received by",
        "<h2>Wanted and applied",
    ):
        assert said in page, said
    assert page.count("<svg") == 3 and page.count('class="blank"') == 1, (
        "the operator signs by hand"
    )
    assert "SIMULATED" not in make_job_page(applied, "topdress test")


def test_costs_where_the_job_has_a_price(known_log: RunLog, tmp_path: Path) -> None:
    """The page as the command writes it, the same kilograms and money as in the farm record."""
    meta = known_log.meta
    assert meta is not None and meta.job is not None
    priced = {**meta.job, "price_per_kg": 0.62, "currency": "U<D", "product": "urea"}
    path = tmp_path / "log.csv"
    write_whole_log(path, dataclasses.replace(meta, job=priced), list(known_log.rows()))
    done = topdress("map", path, "--out", tmp_path / "r.html")
    assert done.exit_code == 0, done.output
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    found = re.search(
        r"<dt>cost</dt>\s*<dd>([0-9.]+) U&lt;D, ([0-9.]+) U&lt;D/ha, at 0.62 U&lt;D a kilogram; "
        r"against the target ([-+\N{MINUS SIGN}]?[0-9.]+) U&lt;D</dd>",
        page,
    )
    assert found is not None, re.findall(r"<dt>cost.*", page)
    said = topdress("record", path, "--out", tmp_path / "farm.csv")
    assert said.exit_code == 0 and f"{found[1]} U<D" in said.output, said.output
    row = next(csv.DictReader((tmp_path / "farm.csv").open(encoding="utf-8")))
    assert (row["cost"], row["currency"], row["price_per_kg"]) == (found[1], "U<D", "0.62")
    assert float(found[1]) == pytest.approx(0.62 * float(row["applied_kg"]), abs=0.01)
    assert float(found[2]) == pytest.approx(0.62 * float(row["applied_kg_ha"]), abs=0.02)
    free = write_whole_log(
        tmp_path / "free.csv",
        dataclasses.replace(meta, job={**priced, "price_per_kg": "dear"}),
        list(known_log.rows()),
    )
    assert topdress("map", free, "--out", tmp_path / "f.html").exit_code == 0
    assert "<dt>cost" not in (tmp_path / "f.html").read_text(encoding="utf-8")


def test_a_log_without_a_target_has_a_page_too(applied: AsApplied) -> None:
    from topdress.console.reports.job_page import make_job_page

    unknown = applied.stretches._replace(
        target_kg_ha=np.full_like(applied.stretches.time_s, np.nan)
    )
    assert "No target was logged" in make_job_page(
        dataclasses.replace(applied, stretches=unknown), "topdress test"
    )


def test_topdress_map_writes_it_and_every_export(known_log: RunLog, tmp_path: Path) -> None:
    for name in ("r.html", "r.csv", "r.geojson", "r.shp", "r.zip", "task"):
        told = topdress("map", known_log.path, "--out", tmp_path / "new" / name)
        assert told.exit_code == 0, told.stderr
        assert " in 60 s of work" in told.stdout
        assert (tmp_path / "new" / name).exists()
    assert "<svg" in (tmp_path / "new" / "r.html").read_text()


def test_a_name_from_a_file_cannot_write_html(applied: AsApplied) -> None:
    from topdress.console.reports.job_page import make_job_page

    page = make_job_page(dataclasses.replace(applied, title="<script>x</script>"), "topdress test")
    assert "<script>" not in page


def test_the_time_line_is_in_minutes_and_the_longest_alarms_come_first() -> None:
    """What a reader measures on the picture: when work, refills and alarms were, and for how
    long."""
    from topdress.console.reports.job_metadata import (
        MAX_ALARM_KINDS,
        AlarmSpan,
        JobEvents,
        JobMetadata,
        draw_time_line,
    )

    alarms = [AlarmSpan(f"alarm_{k}", 600.0, 660.0 + 60.0 * k) for k in range(MAX_ALARM_KINDS + 2)]
    alarms.append(AlarmSpan("shaft_silent", 1200.0, 2400.0))
    about = JobMetadata(
        happened=JobEvents(tuple(alarms), ((1800.0, 250.0),), ((60.0, 3000.0),), "")
    )
    picture = draw_time_line(about)
    assert picture is not None
    words = re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)"[^>]*>([^<]*)</text>', picture.svg)
    at_min = {word: float(x) for x, _, word in words if word.isdigit()}
    names = [
        word for _, _, word in words if not word.isdigit() and word not in ("250 kg", "time, min")
    ]
    down = {word: float(y) for _, y, word in words}
    assert names[:4] == ["at work", "refills", "shaft silent", f"alarm {MAX_ALARM_KINDS + 1}"]
    assert len(names) == 2 + MAX_ALARM_KINDS
    assert [down[name] for name in names] == sorted(down[name] for name in names)
    scale = (at_min["40"] - at_min["10"]) / 30.0
    ends = re.findall(r"M([\d.]+) [\d.]+H([\d.]+)V", picture.svg)
    spans = [tuple(10.0 + (float(end) - at_min["10"]) / scale for end in span) for span in ends]
    assert spans[0] == pytest.approx((1.0, 50.0), abs=0.1)
    assert spans[1] == pytest.approx((20.0, 40.0), abs=0.1)
    assert spans[2] == pytest.approx((10.0, 12.0 + MAX_ALARM_KINDS), abs=0.1)
    assert "250 kg" in picture.svg
