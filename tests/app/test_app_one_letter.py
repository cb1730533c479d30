"""One letter, one meaning: what works the machine on the Run page or holds everywhere does nothing else elsewhere."""
from __future__ import annotations

import re

from console.app import actions
from console.app.action import ANYWHERE, RUN

SAME = {"job_ready": "ready", "job_start": "start", "job_refill": "refill"}      # on another page, and the same

STATES = (("off", ">R make ready"), ("ready", ">S start to work"), ("working", "(S start to work)"))


def letters(action):
    return {key for key in actions.keys_of(action, {}) if re.fullmatch("[a-z]", key)}


def test_a_letter_of_the_run_page_means_the_same_or_nothing_elsewhere():
    owner = {key: one.id for one in actions.ACTIONS if one.where in (RUN, ANYWHERE) for key in letters(one)}
    other = {(one.where, key): f"{one.id}, on Run {owner[key]}" for one in actions.ACTIONS for key in letters(one)
             if key in owner and owner[key] != SAME.get(one.id, one.id)}
    assert other == {}


def test_no_letter_has_two_meanings_on_one_page():
    for where in {one.where for one in actions.ACTIONS} - {ANYWHERE}:
        keys = [key for one in actions.at(where) for key in letters(one)]
        assert len(keys) == len(set(keys)), where


def test_what_a_chip_shows_is_the_key_that_does_it():
    """The rows of keys on the pages repeat the keys of the table."""
    from pathlib import Path

    import console.app
    for path in Path(console.app.__file__).parent.rglob("*.py"):
        for name, shown in re.findall(r'Chip\("(\w+)", "([^"]+)"', path.read_text(encoding="utf-8")):
            assert actions.BY_ID[name].shown == shown, (path.name, name)


async def test_ready_and_start_stand_on_the_job_page_where_the_list_ends(picture, shown):
    from dataclasses import replace

    from console.app.dialogs import Confirm
    from control.orders import Do
    for size in ((120, 40), (80, 24)):
        app = picture(size=size, screen="job")
        async with app.run_test(size=size) as pilot:
            app.turn_to("job")
            await pilot.pause()
            for state, row in STATES:
                frame = app.source.newest
                app.source.newest = replace(frame, seq=frame.seq + 1, row=frame.row._replace(state=state))
                app.page.hurry()
                app.tick()
                await pilot.pause()
                assert any(row in one for one in shown(app)), (size, state)
            frame = app.source.newest
            app.source.newest = replace(frame, seq=frame.seq + 1, row=frame.row._replace(state="off"))
            app.tick()
            await pilot.press("r")
            assert [one.do for one in app.source.orders] == [Do.READY]
            app.source.newest = replace(app.source.newest, seq=frame.seq + 2, row=frame.row._replace(state="ready"))
            app.tick()
            await pilot.press("s")
            assert isinstance(app.screen, Confirm)
