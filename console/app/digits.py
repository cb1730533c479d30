"""Numerals drawn from blocks: one 3 x 5 pixel face, at one or two pixels a dot.

At scale 1 a numeral is 3 columns and 3 rows (half-blocks), at scale 2 it is 6 columns and 5 rows of full cells, with
strokes two columns wide: readable at arm's length.
"""
from __future__ import annotations

_FACE = {
    "0": ("###", "# #", "# #", "# #", "###"),
    "1": (" # ", "## ", " # ", " # ", "###"),
    "2": ("###", "  #", "###", "#  ", "###"),
    "3": ("###", "  #", " ##", "  #", "###"),
    "4": ("# #", "# #", "###", "  #", "  #"),
    "5": ("###", "#  ", "###", "  #", "###"),
    "6": ("###", "#  ", "###", "# #", "###"),
    "7": ("###", "  #", "  #", "  #", "  #"),
    "8": ("###", "# #", "###", "# #", "###"),
    "9": ("###", "# #", "###", "  #", "###"),
    ".": (" ", " ", " ", " ", "#"),
    "-": ("  ", "  ", "##", "  ", "  "),
    "+": ("   ", " # ", "###", " # ", "   "),
    " ": (" ", " ", " ", " ", " "),
}
_HALVES = {"  ": " ", "# ": "▀", " #": "▄", "##": "█"}


def draw(text: str, scale: int = 1) -> tuple[str, ...]:
    """Rows of one width that show `text` (digits, point, signs, space); 3 rows at scale 1, 5 at scale 2.

    Raises KeyError for a character that has no face.
    """
    pixels = [" ".join(_FACE[character][row] for character in text) for row in range(5)]
    if scale == 2:
        return tuple("".join("██" if dot == "#" else "  " for dot in row) for row in pixels)
    pixels.append(" " * len(pixels[0]))
    return tuple("".join(_HALVES[up + down] for up, down in zip(pixels[i], pixels[i + 1], strict=True))
                 for i in range(0, 6, 2))
