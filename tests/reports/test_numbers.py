"""Numbers as people write them."""
from __future__ import annotations

import pytest

from console.reports.diagnosis_text import _left
from console.reports.numbers import number, p_value, percent, span_of, with_interval
from control.diagnosis.result import Unexplained


@pytest.mark.parametrize(("value", "said"), [
    (0.0, "0"), (1234567.0, "1230000"), (-0.0123456, "−0.0123"), (8.1, "8.10"), (None, "–"), (float("nan"), "–"),
    (1e-9, "0"), (99.96, "100.0"), (12345.6, "12300")])
def test_number(value: float | None, said: str) -> None:
    assert number(value) == said


@pytest.mark.parametrize(("value", "low", "high", "said", "interval"), [
    (0.4692, 0.4061, 0.5329, "0.469", "0.406 to 0.533"),
    (-1.784, -1.95, -1.61, "−1.78", "−1.95 to −1.61"),
    (8.13, 2.2, 14.1, "8.1", "2.2 to 14.1"),
    (231.4, 105.0, 350.0, "231", "105 to 350"),
    (0.109404, 0.109366, 0.109442, "0.1094", "narrower than the last digit"),
    (3.0, None, None, "3.00", ""), (0.02, -0.3, 0.34, "0.02", "−0.30 to 0.34")])
def test_interval_decides_the_digits(value: float, low: float | None, high: float | None, said: str,
                                     interval: str) -> None:
    assert with_interval(value, low, high) == (said, interval)


def test_shares_never_claim_certainty() -> None:
    assert [percent(p) for p in (1.0, 0.26, 0.0)] == ["over 99 %", "26 %", "under 1 %"]
    assert [p_value(p) for p in (0.0, 0.0134)] == ["< 0.001", "0.013"]


def test_spans_read_like_a_clock() -> None:
    assert [span_of(s) for s in (59.6, 370.0, 1200.0, 7860.0)] == ["60 s", "6 min 10 s", "20 min", "2 h 11 min"]


@pytest.mark.parametrize(("share", "said"), [(0.0, "0 %"), (0.624, "62 %"), (1.0, "100 %")])
def test_the_share_that_no_effect_explains_is_in_per_cent(share: float, said: str) -> None:
    assert f"flow depends on pitch_deg ({said} of what is left)" in _left(Unexplained("flow", "pitch_deg", share))
    assert _left(Unexplained("flow", "", share)).startswith(f"flow: {said} of its error is not noise")
