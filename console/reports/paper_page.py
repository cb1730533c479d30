"""The page of `topdress reproduce`: what the papers print beside what this program obtains."""
from __future__ import annotations

from collections.abc import Sequence

from console.reports.figure import AFTER, BEFORE, THIRD, drawn, svg
from console.reports.html import GENERATOR, escape, figure, paragraph, section, table
from console.reports.numbers import fixed
from console.reports.page_style import STYLE
from console.reports.picture import Picture as Drawn
from control.simulation.papers.page import Cell, Picture, Section, Table

COLOURS = {"published": BEFORE, "ours": AFTER, "other": THIRD}
MARKS = {"published": "s", "ours": "o", "other": "^"}


def paper_page(sections: Sequence[Section], software: str) -> str:
    """A whole HTML page, pictures inside, nothing fetched from elsewhere."""
    body = "\n".join(section(part.title, *(paragraph(text) for text in part.words),
                             *(_table(one) for one in part.tables),
                             *(figure(draw(one, f"p{k}{j}")) for j, one in enumerate(part.pictures)))
                     for k, part in enumerate(sections))
    return (f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
            f'content="width=device-width">{GENERATOR}<title>Papers, published beside obtained</title>'
            f'<style>{STYLE}</style>'
            f"</head>\n<body><h1>{escape(software)}</h1>"
            f"<p class=\"verdict\">The papers, published beside obtained</p>\n{body}\n</body></html>\n")


def draw(picture: Picture, name: str) -> Drawn:
    """One picture as SVG."""
    with drawn(6.4, 3.4) as (canvas, axes):
        ax = axes[0][0]
        for line in picture.lines:
            colour = COLOURS[line.kind]
            ax.plot(line.x, line.y, "-" if line.joined else MARKS[line.kind], color=colour, label=line.name,
                    markersize=3.0 if len(line.x) > 40 else 6.0)
        ax.set_xlabel(picture.x)
        ax.set_ylabel(picture.y)
        ax.legend()
        return Drawn(svg(canvas, name, escape(picture.title)), picture.title)


def _table(one: Table) -> str:
    numbers = frozenset(k for k in range(len(one.columns))
                        if all(not isinstance(row[k], str) for row in one.rows))
    rows = [[cell_text(cell, decimals) for cell, decimals in zip(row, one.decimals, strict=True)] for row in one.rows]
    return f"<h3>{escape(one.title)}</h3>" + table(one.columns, rows, numbers)


def cell_text(cell: Cell, decimals: int) -> str:
    if cell is None:
        return "\N{EN DASH}"
    return cell if isinstance(cell, str) else fixed(float(cell), decimals)
