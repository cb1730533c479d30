"""Draws numerals from blocks, with one face of 3 x 5 pixels at three scales.

At scale 1 a numeral has 3 columns and 3 rows of half-blocks. At scale 2 it has 6 columns and 5 rows
of full cells, with strokes two columns wide: readable at arm's length. At scale 3 it has 12 columns
and 10 rows: readable from outside the cab.
"""

from __future__ import annotations

from collections.abc import Iterable

# Narrow faces of point and minus sign leave more columns for digits.
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
# Rows of a numeral at each scale.
ROWS_AT_SCALE = {1: 3, 2: 5, 3: 10}
# Empty columns between two numerals of a number, at each scale.
_GAPS = {1: 1, 2: 2, 3: 4}
# A character of half-blocks shows two pixels, one above the other.
_HALF_BLOCKS = {"  ": " ", "# ": "▀", " #": "▄", "##": "█"}


def draw_digits(text: str, scale: int = 1) -> tuple[str, ...]:
    """Return the rows of text that show a number.

    Parameters
    ----------
    text
        Digits, point, signs and spaces.
    scale
        1, 2 or 3.

    Returns
    -------
    tuple of str
        `ROWS_AT_SCALE[scale]` rows of equal width.

    Raises
    ------
    KeyError
        A character has no face.
    """
    pixels = [" ".join(_DIGIT_FACES[character][row] for character in text) for row in range(5)]
    if scale > 1:
        wide, high = (2, 1) if scale == 2 else (4, 2)
        drawn = ["".join(("█" if dot == "#" else " ") * wide for dot in row) for row in pixels]
        return tuple(row for row in drawn for _same in range(high))
    # Half-blocks need an even number of pixel rows.
    pixels.append(" " * len(pixels[0]))
    return tuple(
        "".join(_HALF_BLOCKS[up + down] for up, down in zip(pixels[i], pixels[i + 1], strict=True))
        for i in range(0, 6, 2)
    )


def find_largest_scale(texts: Iterable[str], columns: int, rows: int) -> int:
    """Return the largest scale at which every text fits; 1 where none fits.

    Parameters
    ----------
    texts
        Numbers to draw side by side.
    columns
        Columns from one number to the next. Numbers stand twice as far apart as numerals within a
        number; otherwise 89 and 89 read as 8 98 9.
    rows
        Rows for a number.
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
