"""What is printed as a key is pressed as it stands there; a letter that means nothing here says
where it does; a refusal names the key that comes first."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app import actions
from topdress.console.app.action import ANYWHERE
from topdress.console.app.key_normaliser import normalise_key
from topdress.control.orders import Answer, Do, Order

from tests.app.harness import in_state

SIZE = (120, 40)


def test_the_arrows_signs_are_pressed_as_characters_too():
    """`<` and `>` stand on the screen; on the keyboard they did nothing."""
    for where in {one.where for one in actions.ACTIONS} - {ANYWHERE}:
        for one in actions.list_page_actions(where):
            sign = {"<": "less_than_sign", ">": "greater_than_sign"}.get(one.shown)
            if sign is not None:
                bound = actions.find_bound_keys(where, {})
                assert normalise_key(sign, bound, frozenset({"space", "x"})) in one.keys.split(
                    ","
                ), one.id


async def test_the_map_is_moved_by_the_signs_as_by_the_arrows(full, turned, pilot):
    await turned(full, pilot, "map")
    seen = []
    for key in ("greater_than_sign", "less_than_sign", "right", "left"):
        before = full.page._find_camera().east_m
        await pilot.press(key)
        seen.append(round(full.page._find_camera().east_m - before, 3))
    assert seen[0] == seen[2] > 0.0 > seen[1] == seen[3]


async def test_every_letter_of_the_run_page_does_on_every_page_what_it_does_there_or_says_where(
    full, source, turned
):
    run = [
        one
        for one in actions.ACTIONS
        if one.where == "run" and len(one.keys) == 1 and one.keys.isalpha()
    ]
    assert {"start", "ready", "strategy", "manual_rate", "refill"} <= {one.id for one in run}
    full.use_keymap({})
    async with full.run_test(size=SIZE) as pilot:
        for where in full.pages:
            await turned(full, pilot, where)
            for one in run:
                if one.keys in full.bound_keys[where]:
                    continue
                full.notice_text = ""
                await pilot.press(one.keys)
                assert f"{one.shown}: {one.label} on run (F2)" in full.notice_text, (where, one.id)
                assert full.screen is full.page and source.orders == []
        assert full.page.where != "run"
        await pilot.press("f3", "s")
        assert "^S starts from here" in full.notice_text


async def test_letters_of_other_pages_say_where_on_the_run_page(full):
    full.use_keymap({})
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("b")
        assert (
            "B: begin / end on calibrate (F6), boundary on map (F3), N strip on job (F10)"
            in full.notice_text
        )


@pytest.mark.parametrize("state", ["off", "fault"])
async def test_a_refused_start_says_which_key_comes_first(full, source, turned, state):
    in_state(source, state)
    source.answer = Answer(False, f"not_from_state;state={state}")
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("s")
        assert source.orders == [Order(Do.START)] and "Press R first." in full.notice_text
        await turned(full, pilot, "map")
        await pilot.press("ctrl+s")
        assert full.screen is full.page and "press R first" in full.notice_text


async def test_ready_at_work_says_what_holds(full, source, turned, pilot):
    await turned(full, pilot, "job")
    source.answer = Answer(False, "not_from_state;state=working")
    await pilot.press("r")
    assert "Press Space first." in full.notice_text


async def test_a_source_that_the_job_has_not_is_marked_as_a_map_is(full, source):
    """Plant by plant was taken, and then refused."""
    source.current_frame = replace(source.current_frame, sources=("canopy", "manual", "fallback"))
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("o")
        why = {one.value: one.why for one in full.screen.choices}
        assert (
            why["point"] == "this job has no plants"
            and "no map" in why["map"] == why["map_and_canopy"]
        )
        assert not why["canopy"] and not why["manual"] and not why["fallback"]


@pytest.mark.parametrize("size", [(120, 40), (80, 24)])
async def test_the_key_that_starts_stands_on_every_page(full, shown, turned, size, pilot):
    """`^S` stood in no key bar."""
    for where in full.pages:
        await turned(full, pilot, where)
        said = shown(full)[-1]
        assert where != "map" or "Q menu" in said, "and what stood there stands there still"
        assert ("S start" if where in ("run", "job") else "^S start") in said, (where, said)
