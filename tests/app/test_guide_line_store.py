"""The A-B line and a boundary that is being driven outlive the console on which they were begun."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.boundary_drive import BoundaryDrive, Corner
from topdress.console.app.guide_line import GuideLine
from topdress.console.app.guide_line_store import (
    make_corner_record,
    make_drive_record,
    make_line_record,
    read_kept_lines,
)
from topdress.console.services.line_files import StoredGuideLineFiles, find_lines_path
from topdress.control.log_row import LogRow
from topdress.drivers.files.run_log import PlainLogWriter
from topdress.drivers.files.run_meta import format_meta_yaml, make_run_meta

from tests.app.gallery import StillClock, StillSource
from tests.app.harness import settled, turned
from tests.app.made_up.run import sample_services

SIZE = (120, 40)
CORNERS = [Corner(34.8 + 0.0001 * k, 113.6, 0.0) for k in range(4)]


def test_what_was_said_last_holds_and_half_a_line_counts_for_nothing():
    guide, drive = GuideLine((0.0, 0.0), (3.0, 100.0), 2.4), BoundaryDrive(-1.2)
    said = [
        make_line_record(GuideLine((9.0, 9.0), None, 2.4)),
        make_line_record(guide),
        make_drive_record(drive, 5.0),
        *(make_corner_record(one, (0.0, 10.0 * k), 5.0 + k) for k, one in enumerate(CORNERS)),
    ]
    kept = read_kept_lines([*said, '{"corner": [34.9, 113'])
    assert kept.guide == guide and kept.drive.right_m == -1.2 and kept.until_s == 8.0
    assert kept.drive.corners == CORNERS and kept.way[-1] == (0.0, 30.0)
    ended = read_kept_lines([*said, make_drive_record(None, 9.0), make_line_record(GuideLine())])
    assert ended.drive is None and ended.way == () and ended.guide.a is None
    assert read_kept_lines(["[]", "7", '{"guide": {"a": 1}}', ""]).guide.a is None


def _app(frame, files):
    services = replace(sample_services(), lines=files)
    return TopdressApp(
        StillSource(frame), StillClock(), live=False, utc_offset_s=0.0, services=services
    )


async def test_the_next_console_goes_on_with_both(frames, tmp_path):
    log, files = tmp_path / "run.csv", StoredGuideLineFiles()
    frame = replace(frames[-1], log_path=str(log))
    first = _app(frame, files)
    async with first.run_test(size=SIZE) as pilot:
        await settled(first, pilot)
        first.guide.set_begin((0.0, 0.0), 2.4)
        first.guide.set_end((0.0, 50.0))
        first.keep_line_record(make_line_record(first.guide))
        await turned(first, pilot, "map")
        await pilot.press("b", "1", "enter")
        for k in range(4):
            row = frame.row._replace(
                lat_deg=34.8 + 0.0001 * k, time_s=100.0 + k, fix_quality=4, heading_deg=0.0
            )
            first.map_page.gather_frame(replace(frame, row=row))
        way_m = first.map_page.drive.way_m
        assert way_m > 30.0
    files.close_files()
    second = _app(frame, StoredGuideLineFiles())
    async with second.run_test(size=SIZE) as pilot:
        await settled(second, pilot)
        assert second.guide.is_set and second.guide.b == (0.0, 50.0)
        drive = second.map_page.drive
        assert (
            drive is not None
            and drive.way_m == pytest.approx(way_m)
            and "boundary goes on" in second.notice_text
        )
        await turned(second, pilot, "map")
        await pilot.press("delete")
        assert not second.guide.is_set
        second.services.lines.close_files()
    assert not StoredGuideLineFiles().read_lines(str(log)).guide.is_set


def test_the_way_driven_while_no_console_looked_comes_from_the_log(tmp_path):
    log, files = tmp_path / "run.csv", StoredGuideLineFiles()
    writer = PlainLogWriter(log, make_run_meta())
    for k in range(9):
        writer.append(
            LogRow(
                time_s=float(k),
                utc=f"2026-03-18T08:00:0{k}.000Z",
                lat_deg=34.8 + 0.0001 * k,
                lon_deg=113.6,
                heading_deg=0.0,
                fix_quality=4,
            )
        )
    writer.close()
    files.append_record(str(log), make_drive_record(BoundaryDrive(1.2), 0.0))
    for k, one in enumerate(CORNERS):
        files.append_record(str(log), make_corner_record(one, (0.0, 10.0 * k), float(k)))
    files.close_files()
    kept = files.read_lines(str(log))
    assert [corner.lat_deg for corner in kept.drive.corners] == pytest.approx(
        [34.8 + 0.0001 * k for k in range(9)]
    )


FIELD = {
    "origin_lat_deg": 34.8,
    "origin_lon_deg": 113.6,
    "boundary_m": [[0, 0], [90, 0], [90, 90], [0, 90]],
}


def _worked(folder, name, field, *records):
    """A job's log by its sidecar, and what was kept beside it."""
    log = folder / f"{name}.csv"
    meta = make_run_meta(
        job={"title": name, "field": field},
        started_utc=f"{name[:4]}-{name[4:6]}-{name[6:8]}T08:00:00Z",
    )
    log.with_suffix(".yaml").write_text(format_meta_yaml(meta), encoding="utf-8")
    files = StoredGuideLineFiles()
    for record in records:
        files.append_record(str(log), record)
    files.close_files()
    return log


LINE = GuideLine((0.0, 0.0), (3.0, 100.0), 2.4)


def test_the_line_of_a_field_is_there_the_next_day(tmp_path):
    _worked(tmp_path, "20260318-080000", FIELD, make_line_record(LINE))
    other = GuideLine((1.0, 1.0), (9.0, 90.0), 3.0)
    _worked(tmp_path, "20260319-080000", FIELD | {"origin_lat_deg": 35.0}, make_line_record(other))
    today = _worked(tmp_path, "20260320-080000", FIELD | {"title": "another name"})
    kept = StoredGuideLineFiles().read_lines(str(today))
    assert kept.guide == LINE and kept.of_day.startswith("2026-03-18") and kept.drive is None
    elsewhere = _worked(
        tmp_path, "20260321-080000", FIELD | {"boundary_m": [[0, 0], [50, 0], [50, 50]]}
    )
    assert StoredGuideLineFiles().read_lines(str(elsewhere)).guide.a is None
    nowhere = _worked(tmp_path, "20260322-080000", FIELD | {"boundary_m": []})
    assert StoredGuideLineFiles().read_lines(str(nowhere)).guide.a is None


def test_a_line_that_was_taken_away_stays_away(tmp_path):
    _worked(tmp_path, "20260318-080000", FIELD, make_line_record(LINE))
    _worked(
        tmp_path, "20260319-080000", FIELD, make_line_record(LINE), make_line_record(GuideLine())
    )
    assert (
        StoredGuideLineFiles().read_lines(str(_worked(tmp_path, "20260320-080000", FIELD))).guide.a
        is None
    )
    away = _worked(tmp_path, "20260318-120000", FIELD, make_line_record(GuideLine()))
    assert StoredGuideLineFiles().read_lines(str(away)).guide.a is None


async def test_the_console_says_whose_line_it_is_and_keeps_it_for_this_job(frames, tmp_path):
    _worked(tmp_path, "20260318-080000", FIELD, make_line_record(LINE))
    today = _worked(tmp_path, "20260320-080000", FIELD)
    app = _app(replace(frames[-1], log_path=str(today)), StoredGuideLineFiles())
    async with app.run_test(size=SIZE) as pilot:
        await settled(app, pilot)
        assert (
            app.guide == LINE
            and "of 2026-03-18 is here again; Del on the Map page" in app.notice_text
        )
        app.services.lines.close_files()
    kept = StoredGuideLineFiles().read_lines(str(today))
    assert kept.guide == LINE and kept.of_day == ""


def test_without_such_a_file_there_is_nothing(tmp_path):
    kept = StoredGuideLineFiles().read_lines(str(tmp_path / "run.csv"))
    assert (
        kept.guide.a is None
        and kept.drive is None
        and not Path(find_lines_path(tmp_path / "run.csv")).exists()
    )
