"""Numerals drawn from blocks: one 3 x 5 pixel face, at one or two pixels a dot.

At scale 1 a numeral is 3 columns and 3 rows (half-blocks), at scale 2 it is 6 columns and 5
rows of full cells, with strokes two columns wide: readable at arm's length. At scale 3 it is 12
columns and 10 rows: from outside the cab.
"""

from __future__ import annotations

from collections.abc import Iterable

_DIGIT_FACES = {
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
ROWS_AT_SCALE = {1: 3, 2: 5, 3: 10}
_GAPS = {1: 1, 2: 2, 3: 4}  # columns between the numerals of a number
_HALF_BLOCKS = {"  ": " ", "# ": "▀", " #": "▄", "##": "█"}


def draw_digits(text: str, scale: int = 1) -> tuple[str, ...]:
    """Rows of one width that show `text` (digits, point, signs, space); `ROWS_AT_SCALE[scale]`
    rows.

    Raises KeyError for a character that has no face.
    """
    pixels = [" ".join(_DIGIT_FACES[character][row] for character in text) for row in range(5)]
    if scale > 1:
        wide, high = (2, 1) if scale == 2 else (4, 2)
        drawn = ["".join(("█" if dot == "#" else " ") * wide for dot in row) for row in pixels]
        return tuple(row for row in drawn for _same in range(high))
    pixels.append(" " * len(pixels[0]))
    return tuple(
        "".join(_HALF_BLOCKS[up + down] for up, down in zip(pixels[i], pixels[i + 1], strict=True))
        for i in range(0, 6, 2)
    )


def find_largest_scale(texts: Iterable[str], columns: int, rows: int) -> int:
    """The largest scale at which each text fits into the room; 1 where none does.

    columns: from one number to the next, which must stand twice as far apart as the numerals of
    one, else 89 and 89 are read as 8 98 9.
    """
    kept = list(texts)
    return next(
        (
            scale
            for scale in (3, 2)
            if ROWS_AT_SCALE[scale] <= rows
            and all(len(draw_digits(text, scale)[0]) + 2 * _GAPS[scale] <= columns for text in kept)
        ),
        1,
    )
