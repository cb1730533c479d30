"""Matplotlib figures as SVG inside a page: colours are the page's own, so that day, night and
paper all read well."""

from __future__ import annotations

import io
import re
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.figure import Figure

# Stand-in colour -> the page's variable that takes its place.
INK, LINE, GRID, DIM = "#010203", "#040506", "#070809", "#0a0b0c"
BEFORE, AFTER, THIRD = "#0d0e0f", "#101112", "#131415"
VARIABLES = {
    INK: "ink",
    LINE: "line",
    GRID: "grid",
    DIM: "dim",
    BEFORE: "before",
    AFTER: "after",
    THIRD: "third",
}
PAPER = "#161718"

STYLE: Any = {
    "svg.fonttype": "none",
    "font.size": 10.0,
    "font.family": "sans-serif",
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": LINE,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "xtick.color": LINE,
    "ytick.color": LINE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "axes.unicode_minus": True,
    "text.parse_math": False,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 6),
    "lines.solid_capstyle": "butt",
}


@contextmanager
def drawn(
    width_in: float, height_in: float, columns: int = 1, rows: int = 1, **grid: Any
) -> Iterator[tuple[Figure, Any]]:
    """A figure and its array of axes (rows, columns), in the page's style."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasSVG(figure)
        yield figure, figure.subplots(rows, columns, squeeze=False, **grid)


def svg(figure: Figure, name: str, said: str) -> str:
    """The figure as an SVG element without ids, addresses or fonts of its own.

    `name` keeps the ids of one page apart; `said` describes the picture, already escaped.
    """
    import matplotlib

    out = io.StringIO()
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name}), warnings.catch_warnings():
        # the page's own fonts draw the words
        warnings.filterwarnings("ignore", message="Glyph")
        figure.savefig(
            out,
            format="svg",
            metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
        )
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)
    used = set(re.findall(r"url\(#([^)]+)\)", text)) | set(re.findall(r'href="#([^"]+)"', text))
    text = re.sub(r' id="([^"]*)"', lambda m: m[0] if m[1] in used else "", text)
    text = re.sub(r"font: ([0-9.]+)px [^;\"]*", r"font-size: \1px", text)
    for stand_in, variable in VARIABLES.items():
        text = text.replace(stand_in, f"var(--{variable})")
    text = text.replace(PAPER, "var(--paper)")
    size = re.search(r'width="([0-9.]+)pt"', text)
    wide = f"{float(size[1]):.0f}" if size else "600"
    text = re.sub(r'<svg height="[^"]*"|<svg ', "<svg ", text, count=1)
    text = re.sub(r' (width|height)="[0-9.]+pt"', "", text, count=2)
    text = text.replace(
        "<svg ",
        f'<svg class="picture" style="max-width:{wide}pt" role="img" aria-label="{said}" ',
        1,
    )
    return re.sub(r"\n\s*", "\n", text).strip()
