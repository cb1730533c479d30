"""Charts: what a reader measures on the SVG is what was plotted."""

from __future__ import annotations

import re

import numpy as np
import pytest
from topdress.console.reports.chart import AFTER_COLOUR, ChartPanel, ChartSheet, find_ticks

TEXT = re.compile(r'<text x="([-\d.]+)" y="([-\d.]+)"[^>]*>([^<]*)</text>')


@pytest.mark.parametrize(
    ("low", "high", "most", "words"),
    [
        (0.0, 10.0, 5, ["0.0", "2.5", "5.0", "7.5", "10.0"]),
        (-0.03, 0.03, 4, ["\N{MINUS SIGN}0.02", "0.00", "0.02"]),
        (0.0, 3e7, 4, ["0", "1e+07", "2e+07", "3e+07"]),
        (5.0, 5.0, 4, ["5.000"]),
    ],
)
def test_ticks_are_round_and_not_more_than_asked_for(low, high, most, words):
    ticks = find_ticks(low, high, most)
    assert [text for _, text in ticks] == words
    assert len(ticks) <= most


def test_points_lie_where_the_numbers_of_the_axes_say():
    sheet = ChartSheet(5.0, 3.0)
    x, y = np.array([0.0, 2.0, 7.0, 10.0]), np.array([-3.0, 1.0, np.nan, 5.0])
    sheet.panel.plot(x, y, AFTER_COLOUR, label="series")
    svg = sheet.to_svg("title")
    words = [
        (float(a), float(b), text.replace("\N{MINUS SIGN}", "-"))
        for a, b, text in TEXT.findall(svg)
    ]
    numbers = [(a, b, float(text)) for a, b, text in words if re.fullmatch(r"-?[\d.]+", text)]
    below = max(b for _, b, _ in numbers)
    across = np.polyfit(*np.array([(a, value) for a, b, value in numbers if b == below]).T, 1)
    # The words of the y axis stand 3 points below their level.
    up = np.polyfit(*np.array([(b - 3.0, v) for _, b, v in numbers if b != below]).T, 1)
    line = re.search(r'<path d="(M[^"]*)" style="fill:none;stroke:var\(--after\)', svg)
    assert line is not None
    places = np.array(re.findall(r"([\d.]+) ([\d.]+)", line[1]), float)
    assert np.polyval(across, places[:, 0]) == pytest.approx([0.0, 2.0, 10.0], abs=0.05)
    assert np.polyval(up, places[:, 1]) == pytest.approx([-3.0, 1.0, 5.0], abs=0.05)
    assert line[1].count("M") == 2, "what is not known leaves a gap"


def test_panels_that_share_an_axis_have_one_scale():
    sheet = ChartSheet(5.0, 4.0, rows=2, shares_x=True)
    (above,), (below,) = sheet.panels
    above.plot([0.0, 1.0], [1000.0, 2000.0], AFTER_COLOUR)
    below.plot([0.0, 10.0], [0.0, 1.0], AFTER_COLOUR)
    lines = re.findall(
        r'd="M([\d.]+) [\d.]+L([\d.]+) [\d.]+" style="[^"]*--after', sheet.to_svg("")
    )
    (left, short), (also_left, long) = [tuple(map(float, ends)) for ends in lines]
    assert left == also_left and short - left == pytest.approx(0.1 * (long - left), abs=0.2)


def test_words_of_others_stay_words():
    panel = (sheet := ChartSheet(4.0, 3.0)).panel
    panel.plot([0.0], [1.0], AFTER_COLOUR, label="<script>x</script>")
    assert isinstance(panel, ChartPanel) and "<script" not in sheet.to_svg('"><script>')
