"""A change of the dose by more than 30 % is asked with before and after, whichever key makes
it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.dialogs import ChoiceDialog, Confirm
from topdress.console.app.dose_change_check import DoseChange, predict_dose_change
from topdress.control.orders import Do, Order, TargetSource

from tests.app.gallery import StillSource
from tests.app.harness import later, text_of

MANUAL, CANOPY = TargetSource.MANUAL.value, TargetSource.CANOPY.value
SOURCES = (CANOPY, MANUAL, TargetSource.FALLBACK.value)


def at_rate(frame, rate_kg_ha=100.0, source=MANUAL, nudge_percent=0.0):
    return replace(
        frame,
        seq=frame.seq + 1,
        row=frame.row._replace(target_rate_kg_ha=rate_kg_ha, nudge_percent=nudge_percent),
        sources=SOURCES,
        source_rates=(441.0, rate_kg_ha, 150.0),
        ordered_source=source,
        manual_rate_kg_ha=rate_kg_ha,
    )


@pytest.fixture
def source(frames):
    return StillSource(at_rate(frames[-1]))


@pytest.mark.parametrize(
    ("before", "after", "large"),
    [
        (100.0, 130.0, False),
        (100.0, 131.0, True),
        (100.0, 70.0, False),
        (100.0, 69.0, True),
        (20.0, 200.0, True),
        (0.0, 1.0, True),
        (0.0, 0.0, False),
        (None, 100.0, True),
        (100.0, None, True),
    ],
)
def test_more_than_thirty_percent_either_way_is_large(before, after, large):
    assert DoseChange(before, after).is_large is large


def test_orders_that_leave_the_dose_as_it_is_are_no_change(frames):
    frame = at_rate(frames[-1], source=CANOPY)
    for order in (Order(Do.MANUAL_RATE, 300.0), Order(Do.STRATEGY, "speed_first"), Order(Do.STOP)):
        assert predict_dose_change(frame, (order,)) is None, order
    change = predict_dose_change(frame, (Order(Do.MANUAL_RATE, 300.0), Order(Do.SOURCE, MANUAL)))
    assert change == DoseChange(441.0, 300.0)


def test_the_nudge_is_part_of_the_dose(frames):
    frame = at_rate(frames[-1], nudge_percent=-30.0)
    change = predict_dose_change(frame, (Order(Do.NUDGE, 30.0),))
    assert change is not None and change.is_large
    assert (change.before_kg_ha, change.after_kg_ha) == pytest.approx((70.0, 130.0))


def test_a_worker_that_does_not_tell_the_rates_of_its_sources(frames):
    frame = replace(at_rate(frames[-1]), source_rates=())
    assert predict_dose_change(frame, (Order(Do.MANUAL_RATE, 120.0),)) == DoseChange(100.0, 120.0)
    change = predict_dose_change(frame, (Order(Do.SOURCE, CANOPY),))
    assert change == DoseChange(100.0, None) and change.is_large


async def test_every_typed_rate_that_is_far_from_the_one_before_is_asked(app, source, pilot):
    await pilot.press("m", *"200", "enter")
    assert isinstance(app.screen, Confirm) and source.orders == []
    text = f"{app.screen.heading} {app.screen.text}"
    assert "100 kg/ha" in text and "200 kg/ha" in text and "+100 %" in text
    await pilot.press("escape")
    assert source.orders == []
    await pilot.press("m", *"200", "enter", "enter")
    assert source.orders == [Order(Do.MANUAL_RATE, 200.0)]
    source.orders.clear()
    await pilot.press("m", *"120", "enter")
    assert source.orders == [Order(Do.MANUAL_RATE, 120.0)], "a small one acts at once"


@pytest.mark.parametrize("size", [(80, 24)])
async def test_another_source_says_its_rate_and_is_asked_where_it_is_far_off(
    app, source, pilot, size
):
    source.current_frame = at_rate(source.current_frame, 0.0)
    await later(app, pilot)
    await pilot.press("o")
    assert isinstance(app.screen, ChoiceDialog) and "441 kg/ha" in text_of(app)
    await pilot.press("1", "enter")
    assert isinstance(app.screen, Confirm) and source.orders == []
    text = f"{app.screen.heading} {app.screen.text}"
    assert "from 0 kg/ha to 441 kg/ha" in text
    await pilot.press("enter")
    assert source.orders == [Order(Do.SOURCE, CANOPY)]


async def test_a_change_that_is_taken_back_says_the_dose_too(app, source, pilot):
    await pilot.press("m", *"120", "enter")
    source.current_frame = at_rate(source.current_frame, 300.0)
    await later(app, pilot)
    await pilot.press("ctrl+z")
    text = f"{app.screen.heading} {app.screen.text}"
    assert "300 kg/ha before, 100 kg/ha after (-67 %)" in text


async def test_a_preset_is_asked_once_with_both(app, source, pilot):
    app.presets_kg_ha = (150.0, 200.0, 250.0)
    await pilot.press("full_stop")
    text = f"{app.screen.heading} {app.screen.text}"
    assert "100 kg/ha before, 200 kg/ha after (+100 %)" in text
    await pilot.press("enter")
    assert app.screen is app.page
    assert source.orders == [Order(Do.MANUAL_RATE, 200.0), Order(Do.SOURCE, MANUAL)]
