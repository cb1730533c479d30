"""How does the page of `topdress reproduce` compare the papers' published numbers with those that
this program computes?
"""

from __future__ import annotations

from collections.abc import Sequence

from topdress.console.reports.chart import AFTER_COLOUR, BEFORE_COLOUR, THIRD_COLOUR, ChartSheet
from topdress.console.reports.html import Picture as Drawn
from topdress.console.reports.html import (
    escape_text,
    format_figure,
    format_paragraph,
    format_table,
    make_page,
)
from topdress.console.reports.number_text import format_fixed
from topdress.control.papers.page import Picture, Section, Table, TableCell

SERIES_COLOURS = {"published": BEFORE_COLOUR, "ours": AFTER_COLOUR, "other": THIRD_COLOUR}
PAPERS_STYLE = """
h3 { margin: 2rem 0 .5rem; } figure { margin: 2rem 0; }
.contents ul { columns: 1; margin: .2rem 0; padding-left: 1.2rem; } .contents a { color:
var(--after); }
.contents > ul { padding-left: 0; list-style: none; } .contents > ul > li { margin: .6rem 0; }
"""
SERIES_MARKERS = {"published": "s", "ours": "o", "other": "^"}


def make_paper_page(
    sections: Sequence[Section],
    software: str,
    title: str = "The papers, published next to obtained",
) -> str:
    """Returns a whole HTML page that fetches nothing; the first section precedes the contents."""
    parts = [_format_paper_section(part, k) for k, part in enumerate(sections)]
    body = "\n".join([*parts[:1], _format_contents(sections), *parts[1:]])
    return make_page(
        title,
        f'<h1>{escape_text(software)}</h1><p class="verdict">{escape_text(title)}</p>\n{body}\n',
        PAPERS_STYLE,
    )


def _format_paper_section(part: Section, number: int) -> str:
    inside = "\n".join(
        [
            *(format_paragraph(text) for text in part.words),
            *(
                _format_paper_table(one, _make_anchor(number, k))
                for k, one in enumerate(part.tables)
            ),
            *(format_figure(draw_paper_picture(one)) for one in part.pictures),
        ]
    )
    return f'<section id="s{number}"><h2>{escape_text(part.title)}</h2>\n{inside}\n</section>'


def _format_contents(sections: Sequence[Section]) -> str:
    """Returns links to every section and to every table in it."""
    listed = "\n".join(
        f'<li><a href="#s{number}">{escape_text(part.title)}</a><ul>'
        + "".join(
            f'<li><a href="#{_make_anchor(number, k)}">{escape_text(_shorten_title(one.title))}'
            f"</a></li>"
            for k, one in enumerate(part.tables)
        )
        + "</ul></li>"
        for number, part in enumerate(sections)
    )
    return f'<nav class="contents"><h2>Contents</h2><ul>{listed}</ul></nav>'


def _shorten_title(title: str) -> str:
    """Returns a table's title up to its first remark."""
    return title.split(";")[0].split(". ")[0]


def _make_anchor(section: int, table: int) -> str:
    return f"t{section}-{table + 1}"


def draw_paper_picture(picture: Picture) -> Drawn:
    """Returns one picture as SVG."""
    sheet = ChartSheet(6.4, 3.4)
    for line in picture.lines:
        sheet.panel.plot(
            line.x,
            line.y,
            SERIES_COLOURS[line.kind],
            label=line.name,
            dash="-" if line.joined else "",
            marker="" if line.joined else SERIES_MARKERS[line.kind],
            size=3.0 if len(line.x) > 40 else 6.0,
        )
    sheet.panel.label(picture.x, picture.y)
    return Drawn(sheet.to_svg(picture.title), picture.title)


def _format_paper_table(one: Table, anchor: str) -> str:
    numbers = frozenset(
        k for k in range(len(one.columns)) if all(not isinstance(row[k], str) for row in one.rows)
    )
    rows = [
        [
            format_paper_cell(cell, decimals)
            for cell, decimals in zip(row, one.decimals, strict=True)
        ]
        for row in one.rows
    ]
    return f'<h3 id="{anchor}">{escape_text(one.title)}</h3>' + format_table(
        one.columns, rows, numbers
    )


def format_paper_cell(cell: TableCell, decimals: int) -> str:
    """Returns a cell as text; a dash for an empty cell."""
    if cell is None:
        return "\N{EN DASH}"
    return cell if isinstance(cell, str) else format_fixed(float(cell), decimals)
