"""A term next to what the data themselves say, class by class of its variable."""
from __future__ import annotations

import numpy as np

from console.reports.figure import AFTER, INK, PAPER, THIRD, drawn, svg
from console.reports.html import Picture, escape
from console.reports.panels import legend_below, zero_line
from console.reports.term_words import sentence, variable_name
from control.diagnosis.result import TermFound


def term_picture(found: TermFound, name: str) -> Picture | None:
    """None where the data hold no means to show."""
    if not found.seen:
        return None
    at, seen, by_term = np.array(found.seen).T
    over = found.term["over"]
    product = len(over) > 1
    label = f"what the term says, {found.unit}" if product else variable_name(over[0]["name"])
    with drawn(6.4, 3.4) as (figure, grid):
        axes = grid[0, 0]
        zero_line(axes)
        order = np.argsort(at)
        axes.plot(at[order], by_term[order], color=THIRD, linewidth=2.0, label="the term")
        axes.plot(at, seen, color=AFTER, marker="s", linestyle="none", markerfacecolor=PAPER, label="means of the data")
        axes.set_xlabel(label)
        axes.set_ylabel(f"{found.stage} over nominal, {found.unit}", color=INK)
        axes.set_title(found.term["id"])
        legend_below(figure, grid)
        text = svg(figure, name, escape(sentence(found.term)))
    return Picture(text, f"{sentence(found.term)}. Squares are the data's own means in classes of equally many rows, "
                         "the line is the mean of the term there.")
