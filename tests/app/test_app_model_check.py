"""The model check's line on the Run page: there when something departs, empty in a turn, with
an offer at hold."""

from __future__ import annotations

from dataclasses import replace

from topdress.console.app.app import TopdressApp
from topdress.console.app.pages.run.page import ModelCheck, list_model_check_texts
from topdress.console.app.services import Services
from topdress.console.locale import use_language
from topdress.console.reports.live_words import format_departure
from topdress.control.diagnosis.result import ModelDeviation

from tests.app.gallery import StillSource

FOUND = ModelDeviation("flow", "flow.gain", -4.0, 600.0, adoptable=True)


def with_row(frame, **changes):
    return replace(frame, row=frame.row._replace(**changes))


def test_the_line_says_what_since_when_and_why(frames):
    frame = with_row(
        frames[-1],
        state="working",
        time_s=900.0,
        utc="2026-03-20T08:15:00.000Z",
        work_switch=1,
        target_rate_kg_ha=300.0,
    )
    said = list_model_check_texts(FOUND, frame, 0.0)[0]
    assert said.startswith("check: 4 % too little flows since 08:10. Probably: ") and said.endswith(
        "; F9"
    )
    unsure = list_model_check_texts(
        FOUND._replace(certain=False, since_s=None, percent=None), frame, 0.0
    )[0]
    assert "flow is not as it should be. Perhaps: " in unsure
    assert (
        format_departure(ModelDeviation("gate", "", 3.0, None), "")
        == "3 % too much spread, by the gate"
    )


def test_nothing_while_turning_and_an_offer_at_hold(frames):
    frame = with_row(
        frames[-1], state="working", time_s=900.0, work_switch=1, target_rate_kg_ha=0.0
    )
    assert list_model_check_texts(FOUND, frame, 0.0) == ()
    assert (
        list_model_check_texts(FOUND, with_row(frame, target_rate_kg_ha=300.0, work_switch=0), 0.0)
        == ()
    )
    held = with_row(frame, state="held")
    assert "adopt" in list_model_check_texts(FOUND, held, 0.0)[0]
    tell = FOUND._replace(adoptable=False, next_run="two speeds")
    assert list_model_check_texts(tell, held, 0.0)[0].endswith("two speeds")


def seen(texts: tuple[str, ...], width: int) -> str:
    return ModelCheck(()).draw_rows(texts, width, 1)[0].plain.rstrip()


def test_on_a_narrow_screen_the_offer_stays(frames):
    unsure = FOUND._replace(
        cause="flow.hopper_head",
        certain=False,
        adoptable=False,
        next_run="A refill half-way: the head jumps back, time does not.",
    )
    held = with_row(frames[-1], state="held", time_s=900.0, utc="2026-03-20T08:15:00.000Z")
    adopt, tell = (seen(list_model_check_texts(one, held, 0.0), 80) for one in (FOUND, unsure))
    assert adopt == "check: 4 % too little flows since 08:10; F9: adopt it into the machine file"
    assert tell == "check: 4 % too little flows since 08:10; F9: the run that tells which"
    works = with_row(held, state="working", work_switch=1, target_rate_kg_ha=300.0)
    assert seen(list_model_check_texts(unsure, works, 0.0), 80).endswith(
        "Perhaps: Flows less as the hopper empties; F9"
    )


def test_the_plan_of_a_run_is_said_in_chinese_too(frames):
    unsure = FOUND._replace(
        cause="flow.hopper_head",
        certain=False,
        adoptable=False,
        next_run="Two ground speeds: 3 and 6 km/h in turn, two minutes each.",
    )
    use_language("zh")
    try:
        assert (
            "ground speeds"
            not in list_model_check_texts(unsure, with_row(frames[-1], state="held"), 0.0)[0]
        )
    finally:
        use_language("en")


def test_in_chinese(frames):
    use_language("zh")
    try:
        frame = with_row(frames[-1], state="held")
        assert "流量少 4 %" in list_model_check_texts(FOUND, frame, 0.0)[0]
    finally:
        use_language("en")


async def test_the_row_is_there_only_while_something_departs(clock, frames, shown):
    said: list[ModelDeviation | None] = [None]
    asked: list[str] = []

    def latest(log: str) -> ModelDeviation | None:
        asked.append(log)
        return said[0]

    app = TopdressApp(
        StillSource(with_row(frames[-1], state="working", work_switch=1, target_rate_kg_ha=300.0)),
        clock,
        live=False,
        services=Services(model_check=latest),
    )
    async with app.run_test(size=(120, 40)) as pilot:
        assert asked and not app.page.query_one("#model-check").display
        said[0] = FOUND
        clock.now_s += 1.0
        app.show_newest()
        await pilot.pause()
        assert app.page.query_one("#model-check").display
        assert any("check: 4 % too little flows" in line for line in shown(app))
