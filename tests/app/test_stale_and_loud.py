"""An old number never looks like a new one, and an error beyond its limit is loud, in each layout
of the rates."""

from __future__ import annotations

import pytest
from topdress.console.app.panel_views import AgedText, RatesView, TileView
from topdress.console.app.widgets.rate_panels import SeatRates, SmallPanel, SmallView

SIZES = [(80, 4), (80, 16), (40, 2)]


def rates(stale: bool, level: str = "") -> RatesView:
    target, applied, error = (AgedText(text, stale) for text in ("120", "98", "-18 %"))
    return RatesView(target, applied, "kg/ha", "", error, -0.6, level)


def list_styles(rows) -> list[str]:
    """Styles of the rows; the first row has the labels, in the colours of their numbers."""
    return [str(span.style) for row in rows for span in row.spans]


def draw_all(view: RatesView, size: tuple[int, int]):
    small = SmallView(view, (TileView("speed", "km/h", view.target, ""),), "")
    return (
        SeatRates(view).draw_rows(view, *size),
        SmallPanel(small).draw_rows(small, *size),
    )


@pytest.mark.parametrize("size", SIZES)
def test_old_rates_are_grey_in_each_layout(size):
    for old, new in zip(draw_all(rates(True), size), draw_all(rates(False), size), strict=True):
        greyed = [one for one in list_styles(old) if "$stale" in one]
        coloured = [one for one in list_styles(new) if "$target" in one or "$applied" in one]
        assert greyed and not [one for one in list_styles(new) if "$stale" in one]
        # Of the coloured parts of new rates only the two labels keep their colours.
        left = [one for one in list_styles(old) if "$target" in one or "$applied" in one]
        assert len(left) == 2 < len(coloured)


@pytest.mark.parametrize("size", SIZES[:2])
@pytest.mark.parametrize("level", ["amber", "red"])
def test_an_error_beyond_its_limit_is_loud_and_an_old_one_is_not(size, level):
    loud = f"bold $on-alarm-{level} on $alarm-{level}"
    assert loud in list_styles(draw_all(rates(False, level), size)[0])
    assert loud not in list_styles(draw_all(rates(True, level), size)[0])
