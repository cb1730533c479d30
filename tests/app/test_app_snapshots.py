"""The look of every page, held still: sizes, themes, languages. After looking: `-m ""
--snapshot-update`."""

from __future__ import annotations

import pytest

from tests.app.gallery import PICTURES, pictures, settle, still_app

EXTRA = pictures("run-100x30-night run-80x24-zh-night! replay-100x30-day replay-80x24-zh-day")


# Of the quick set: every page once, both sizes, both languages, night, alarms. The others are
# of the exam.
QUICK = {
    "run-120x40-alarms",
    "run-80x24-day",
    "run-120x40-zh",
    "run-check-120x40-day",
    "map-120x40-day",
    "map-laid-80x24-night",
    "trends-120x40-night",
    "replay-120x40-day",
    "diagnosis-120x40-day",
    "devices-80x24-day",
    "calibrate-running-120x40",
    "job-120x40-day",
    "job-120x40-zh",
    "settings-80x24-day",
    "alarm-list-100x30",
    # The worst state of the run page: old numbers, and a dose error with an alarm in little room.
    "gone-100x30",
    "run-80x24-alarms",
}


@pytest.mark.parametrize(
    "picture",
    [
        pytest.param(
            picture, id=picture.name, marks=() if picture.name in QUICK else pytest.mark.exam
        )
        for picture in (*PICTURES, *EXTRA)
    ],
)
def test_screen(snap_compare, picture):
    app, _clock = still_app(picture)

    async def prepare(pilot):
        await settle(app, picture, pilot.pause)

    assert snap_compare(app, terminal_size=picture.size, run_before=prepare)
