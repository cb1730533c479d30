"""How are words written into HTML? All text from files or users is escaped here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape as _escape
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from topdress.console.reports.chart import ChartSheet

# This element in every page names the program that made it.
GENERATOR_META = '<meta name="generator" content="topdress">'
# No page may fetch or run anything, whatever text a hostile file contains; colour scales are
# embedded pictures.
POLICY_META = (
    '<meta http-equiv="Content-Security-Policy" '
    """content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">"""
)


class Picture(NamedTuple):
    """Holds a picture of a page: the whole `<svg>`, ready to be written."""

    svg: str
    # Plain text, not escaped.
    caption: str
    # The chart of this picture, which can be drawn again in another style; None for other pictures.
    sheet: ChartSheet | None = None


def escape_text(text: object) -> str:
    """Returns the text with the special characters of HTML escaped."""
    return _escape(str(text), quote=True)


def make_page(title: str, body: str, style: str = "") -> str:
    """Returns a whole page that fetches nothing. `title` is plain text, `body` HTML, `style`
    further rules."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n{POLICY_META}\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{GENERATOR_META}<title>{escape_text(title)}</title>\n"
        f"<style>{PAGE_STYLE}{style}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def format_paragraph(text: str, kind: str = "") -> str:
    """Returns plain text in a paragraph."""
    return f"<p{_format_class(kind)}>{escape_text(text)}</p>"


def format_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], numbers: frozenset[int] = frozenset()
) -> str:
    """Returns plain text in cells; columns in `numbers` are right-aligned."""
    heads = "".join(
        f'<th scope="col"{_format_class("number" if k in numbers else "")}>{escape_text(text)}</th>'
        for k, text in enumerate(head)
    )
    body = "\n".join(
        "<tr>"
        + "".join(
            f"<td{_format_class('number' if k in numbers else '')}>{escape_text(text)}</td>"
            for k, text in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return (
        "<div "
        f'class="wide"><table><thead><tr>{heads}</tr></thead>\n<tbody>\n{body}\n</tbody>'
        "</table></div>"
    )


def format_facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Returns pairs of a plain word and a piece of HTML as a list of facts."""
    return (
        "<dl>"
        + "\n".join(f"<dt>{escape_text(word)}</dt><dd>{said}</dd>" for word, said in pairs)
        + "</dl>"
    )


def format_list(texts: Iterable[str], ordered: bool = False) -> str:
    """Returns plain texts as a list; empty without texts."""
    tag, inside = (
        "ol" if ordered else "ul",
        "\n".join(f"<li>{escape_text(text)}</li>" for text in texts),
    )
    return f"<{tag}>{inside}</{tag}>" if inside else ""


def format_section(title: str, *inside: str, kind: str = "") -> str:
    """Returns a part of the page with a title; empty without content."""
    body = "\n".join(part for part in inside if part)
    return (
        f"<section{_format_class(kind)}><h2>{escape_text(title)}</h2>\n{body}\n</section>"
        if body
        else ""
    )


def format_folded(title: str, *inside: str) -> str:
    """Returns content that a reader may open; on paper it is open. Empty without content."""
    body = "\n".join(part for part in inside if part)
    return (
        f'<details class="fold"><summary>{escape_text(title)}</summary>\n{body}\n</details>'
        if body
        else ""
    )


def format_figure(picture: Picture | None) -> str:
    """Returns a picture with its caption; empty without a picture."""
    if picture is None:
        return ""
    return f"<figure>{picture.svg}<figcaption>{escape_text(picture.caption)}</figcaption></figure>"


def _format_class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""


# Styles for day, night and paper; the colours are distinguishable for colour-blind readers, and
# shapes differ too.
PAGE_STYLE = """
:root { color-scheme: light dark; --paper:#ffffff; --ink:#16191d; --dim:#6a7179; --line:#8b9198;
--grid:#e3e6e9;
  --soft:#f3f5f7; --before:#b84a00; --after:#005ea8; --third:#8a3f7d; }
@media (prefers-color-scheme: dark) { :root { --paper:#14171a; --ink:#e8eaec; --dim:#9aa1a8;
--line:#7d848b;
  --grid:#2b3035; --soft:#1e2226; --before:#f2a154; --after:#6cb8f6; --third:#d79bcb; } }
@media print { :root { --paper:#ffffff; --ink:#000000; --dim:#555555; --line:#777777;
--grid:#dddddd; --soft:#f4f4f4;
  --before:#b84a00; --after:#005ea8; --third:#8a3f7d; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem 1rem 3rem; max-width: 62rem; background: var(--paper);
color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; }
h1 { font-size: 1.05rem; font-weight: 600; color: var(--dim); margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; padding-bottom: .25rem; border-bottom: 1px solid
var(--grid); }
h3 { font-size: 1.05rem; margin: 0; }
.verdict { font-size: 1.5rem; line-height: 1.3; font-weight: 600; margin: .3rem 0 .5rem; }
.word { display: inline-block; font-size: .8rem; font-weight: 700; letter-spacing: .04em;
text-transform: uppercase;
  border: 2px solid var(--ink); border-radius: 3px; padding: .05rem .5rem; }
.dim, figcaption, code, .id { color: var(--dim); font-size: .9rem; }
code, .id { font-family: ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
.cause { border-left: 4px solid var(--after); padding: .1rem 0 .1rem 1rem; margin: 1.2rem 0 2rem; }
.cause.open { border-left-color: var(--third); }
.do { font-weight: 600; }
dl { display: grid; grid-template-columns: 9rem 1fr; gap: .3rem 1rem; margin: .7rem 0; }
dt { color: var(--dim); } dd { margin: 0; }
.sized { display: flex; flex-wrap: wrap; align-items: center; gap: .1rem .8rem; }
.rivals { display: grid; max-width: 42rem; grid-template-columns: minmax(0, 1fr) max-content 220px;
  gap: 0 .8rem; align-items: center; }
.big { font-size: 1.15rem; font-weight: 600; margin-right: .5rem; }
figure { margin: 1rem 0; break-inside: avoid; } svg.picture { display: block; width: 100%; height:
auto; }
svg text { font-family: system-ui, "DejaVu Sans", sans-serif; }
svg.bar { vertical-align: middle; } .bar .base { stroke: var(--grid); stroke-width: 3; }
.bar .zero { stroke: var(--dim); stroke-width: 1.5; } .bar .interval { stroke: var(--after);
stroke-width: 5; }
.bar .value { fill: var(--after); stroke: var(--paper); stroke-width: 1.5; } .bar .trough { fill:
var(--grid); }
.bar .share { fill: var(--after); } .bar .other { fill: var(--third); }
table { border-collapse: collapse; width: 100%; font-size: .92rem; } .wide { overflow-x: auto; }
th, td { text-align: left; padding: .3rem .7rem .3rem 0; border-bottom: 1px solid var(--grid);
vertical-align: top; }
th { font-weight: 600; color: var(--dim); } .number { text-align: right; font-variant-numeric:
tabular-nums; }
li { margin: .25rem 0; } section.cause, tr { break-inside: avoid; }
@media (max-width: 40rem) { dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: .5rem;
} }
.simulated { border: 3px solid var(--before); color: var(--before); font-weight: 700; padding:
.3rem .8rem;
  letter-spacing: .04em; }
.blank { display: inline-block; min-width: 14rem; border-bottom: 1px solid var(--line); height:
1.1em; }
.signed { display: grid; grid-template-columns: 1fr 1fr; gap: 2rem; margin-top: 3rem; }
.signed span { border-top: 1px solid var(--line); padding-top: .2rem; color: var(--dim);
font-size: .9rem; }
.fold { margin-top: 2.2rem; } .fold > summary { cursor: pointer; font-weight: 600; color:
var(--dim); }
@media print { .fold::details-content { content-visibility: visible; block-size: auto; } }
@media print { body { max-width: none; padding: 0; font-size: 10.5pt; } h2 { break-after: avoid; } }
"""
