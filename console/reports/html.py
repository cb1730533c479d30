"""Words into HTML: everything that comes from files or users is escaped here."""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape as _escape
from typing import NamedTuple

GENERATOR = '<meta name="generator" content="topdress">'       # in the head of every page: whose it is
# No page may fetch or run anything, whatever words a hostile file has put into it; scales of colour are pictures in it.
POLICY = ('<meta http-equiv="Content-Security-Policy" '
          """content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">""")


class Picture(NamedTuple):
    """A picture of a page: the whole `<svg>`, ready to be written."""

    svg: str
    caption: str            # plain text, not escaped


def escape(text: object) -> str:
    return _escape(str(text), quote=True)


def page(title: str, style: str, body: str) -> str:
    """A whole page, nothing fetched from elsewhere. title : plain text. body : HTML."""
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n{POLICY}\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"{GENERATOR}<title>{escape(title)}</title>\n"
            f"<style>{style}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n")


def paragraph(text: str, kind: str = "") -> str:
    """Plain text in a paragraph."""
    return f"<p{_class(kind)}>{escape(text)}</p>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: frozenset[int] = frozenset()) -> str:
    """Plain text in cells; columns in `numbers` are set to the right."""
    heads = "".join(f'<th scope="col"{_class("number" if k in numbers else "")}>{escape(text)}</th>'
                    for k, text in enumerate(head))
    body = "\n".join("<tr>" + "".join(f'<td{_class("number" if k in numbers else "")}>{escape(text)}</td>'
                                      for k, text in enumerate(row)) + "</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{heads}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>'


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Pairs of a plain word and a piece of HTML."""
    return "<dl>" + "\n".join(f"<dt>{escape(word)}</dt><dd>{said}</dd>" for word, said in pairs) + "</dl>"


def items(texts: Iterable[str], ordered: bool = False) -> str:
    """Plain texts as a list."""
    tag = "ol" if ordered else "ul"
    return f"<{tag}>" + "\n".join(f"<li>{escape(text)}</li>" for text in texts) + f"</{tag}>"


def section(title: str, *inside: str, kind: str = "") -> str:
    """A titled part of the page; nothing where nothing is inside."""
    body = "\n".join(part for part in inside if part)
    return f"<section{_class(kind)}><h2>{escape(title)}</h2>\n{body}\n</section>" if body else ""


def folded(title: str, *inside: str) -> str:
    """Parts that a reader opens who wants them; on paper they stand open. Nothing where nothing is inside."""
    body = "\n".join(part for part in inside if part)
    return f'<details class="fold"><summary>{escape(title)}</summary>\n{body}\n</details>' if body else ""


def figure(picture: Picture | None) -> str:
    if picture is None:
        return ""
    return f"<figure>{picture.svg}<figcaption>{escape(picture.caption)}</figcaption></figure>"


def _class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""
