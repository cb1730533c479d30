"""The page of `topdress reproduce`: what the papers print next to what this program obtains."""

from __future__ import annotations

from collections.abc import Sequence

from topdress.console.reports.chart import AFTER, BEFORE, THIRD, ChartSheet
from topdress.console.reports.html import Picture as Drawn
from topdress.console.reports.html import escape, figure, format_paragraph, page, table
from topdress.console.reports.numbers import fixed
from topdress.control.papers.page import Cell, Picture, Section, Table

COLOURS = {"published": BEFORE, "ours": AFTER, "other": THIRD}
PAPERS_STYLE = """
h3 { margin: 2rem 0 .5rem; } figure { margin: 2rem 0; }
.contents ul { columns: 1; margin: .2rem 0; padding-left: 1.2rem; } .contents a { color:
var(--after); }
.contents > ul { padding-left: 0; list-style: none; } .contents > ul > li { margin: .6rem 0; }
"""
MARKS = {"published": "s", "ours": "o", "other": "^"}


def paper_page(
    sections: Sequence[Section],
    software: str,
    title: str = "The papers, published next to obtained",
) -> str:
    """A whole HTML page, nothing fetched from elsewhere; the first section stands above the
    contents."""
    parts = [_section(part, k) for k, part in enumerate(sections)]
    body = "\n".join([*parts[:1], _contents(sections), *parts[1:]])
    return page(
        title,
        f'<h1>{escape(software)}</h1><p class="verdict">{escape(title)}</p>\n{body}\n',
        PAPERS_STYLE,
    )


def _section(part: Section, number: int) -> str:
    inside = "\n".join(
        [
            *(format_paragraph(text) for text in part.words),
            *(_table(one, _anchor(number, k)) for k, one in enumerate(part.tables)),
            *(figure(draw(one)) for one in part.pictures),
        ]
    )
    return f'<section id="s{number}"><h2>{escape(part.title)}</h2>\n{inside}\n</section>'


def _contents(sections: Sequence[Section]) -> str:
    """Links to every section and to every table in it."""
    listed = "\n".join(
        f'<li><a href="#s{number}">{escape(part.title)}</a><ul>'
        + "".join(
            f'<li><a href="#{_anchor(number, k)}">{escape(_short(one.title))}</a></li>'
            for k, one in enumerate(part.tables)
        )
        + "</ul></li>"
        for number, part in enumerate(sections)
    )
    return f'<nav class="contents"><h2>Contents</h2><ul>{listed}</ul></nav>'


def _short(title: str) -> str:
    """A table's title up to its first remark."""
    return title.split(";")[0].split(". ")[0]


def _anchor(section: int, table: int) -> str:
    return f"t{section}-{table + 1}"


def draw(picture: Picture) -> Drawn:
    """One picture as SVG."""
    sheet = ChartSheet(6.4, 3.4)
    for line in picture.lines:
        sheet.panel.plot(
            line.x,
            line.y,
            COLOURS[line.kind],
            label=line.name,
            dash="-" if line.joined else "",
            marker="" if line.joined else MARKS[line.kind],
            size=3.0 if len(line.x) > 40 else 6.0,
        )
    sheet.panel.label(picture.x, picture.y)
    return Drawn(sheet.to_svg(picture.title), picture.title)


def _table(one: Table, anchor: str) -> str:
    numbers = frozenset(
        k for k in range(len(one.columns)) if all(not isinstance(row[k], str) for row in one.rows)
    )
    rows = [
        [cell_text(cell, decimals) for cell, decimals in zip(row, one.decimals, strict=True)]
        for row in one.rows
    ]
    return f'<h3 id="{anchor}">{escape(one.title)}</h3>' + table(one.columns, rows, numbers)


def cell_text(cell: Cell, decimals: int) -> str:
    if cell is None:
        return "\N{EN DASH}"
    return cell if isinstance(cell, str) else fixed(float(cell), decimals)
