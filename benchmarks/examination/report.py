"""The page of an examination: the table, by kind of case, differences, reliability with a
picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from score import Scored, list_bins, write_bins, write_differences, write_table


def write_page(
    by_entry: dict[str, list[Scored]],
    turns: Sequence[str],
    trouble: dict[str, int],
    out: Path | None,
    ours: str = "topdress",
) -> str:
    """Returns the page as Markdown. turns : what each case is. trouble : answers of each entry
    that broke, came late or read the truth. out : of the page, next to which the picture lies."""
    parts = [write_table(by_entry, "constant")]
    if ours in by_entry and len(by_entry) > 1:
        parts.append(write_differences(by_entry, ours))
    for turn in dict.fromkeys(turns):
        some = {
            name: [one for one, its in zip(scored, turns, strict=True) if its == turn]
            for name, scored in by_entry.items()
        }
        parts.append(f"Cases of the kind `{turn}`:\n\n{write_table(some, 'constant')}")
    broken = [f"{name} {count}" for name, count in trouble.items() if count]
    if broken:
        parts.append(f"No answer (raised, late, peeked): {', '.join(broken)}\n")
    for name, scored in by_entry.items():
        parts.append(f"Reliability of `{name}`:\n\n{write_bins(scored)}")
    if out is not None:
        picture = out.with_suffix(".svg")
        picture.write_text(draw_reliability(by_entry), encoding="utf-8", newline="\n")
        parts.append(f"![Said and there, by entry]({picture.name})\n")
    return "\n".join(parts)


def draw_reliability(by_entry: dict[str, list[Scored]]) -> str:
    """Returns an SVG: share that is there over probability said, a panel for each entry."""
    from topdress.console.reports.chart import BEFORE_COLOUR, DIM_COLOUR, ChartSheet

    columns = 4
    rows = -(-len(by_entry) // columns)
    sheet = ChartSheet(9.0, 2.6 * rows, rows, columns)
    for k, (name, scored) in enumerate(by_entry.items()):
        panel = sheet.panels[k // columns][k % columns]
        panel.label("said", "there", name)
        panel.x_ends = panel.y_ends = (0.0, 1.0)
        panel.plot([0.0, 1.0], [0.0, 1.0], DIM_COLOUR, dash="--")
        bins = list_bins(scored)
        there = np.array([one.there for one in bins])
        half = 1.645 * np.sqrt(there * (1.0 - there) / np.array([one.count for one in bins]))
        panel.plot_intervals([one.said for one in bins], there, half, BEFORE_COLOUR)
    # Alone, a picture has no page to define its colours.
    style = (
        "<style>svg{--ink:#222;--line:#888;--grid:#ddd;--dim:#999;--before:#06c;--paper:#fff;"
        "font-family:sans-serif;background:#fff}</style>"
    )
    svg = sheet.to_svg("Probability said and share that is there, by entry")
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1).replace(
        ">", f">{style}", 1
    )
