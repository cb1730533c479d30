"""The look of Run and Replay, held still: sizes, themes, languages. Update with --snapshot-update after looking."""
from __future__ import annotations

import pytest

from console.app.gallery import PICTURES, Picture, settle, still_app

EXTRA = (
    Picture("run-100x30-night", (100, 30), "night"),
    Picture("run-80x24-zh-night", (80, 24), "night", "zh", alarms=True),
    Picture("replay-100x30-day", (100, 30), screen="replay"),
    Picture("replay-80x24-zh-day", (80, 24), language="zh", screen="replay"),
)


@pytest.mark.parametrize("picture", [*PICTURES, *EXTRA], ids=lambda picture: picture.name)
def test_screen(snap_compare, picture):
    app, _clock = still_app(picture)

    async def prepare(pilot):
        await settle(app, picture, pilot.pause)

    assert snap_compare(app, terminal_size=picture.size, run_before=prepare)
