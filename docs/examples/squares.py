"""How is a text of squares known and read? Its lines are `LON LAT DEGREES RATE`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from topdress.drivers.files.formats.file_format import FileFormat, defer

if TYPE_CHECKING:
    from topdress.drivers.files.shape_layers import Layer


def read_squares(path: Path) -> list[Layer]:
    """Returns the squares as a layer. Raises OSError."""
    import numpy as np
    import shapely
    from topdress.drivers.files.shape_layers import Layer

    lines = path.read_text(encoding="utf-8").splitlines()[1:]
    squares = [tuple(map(float, line.split())) for line in lines]
    shapes = [shapely.box(x, y, x + side, y + side) for x, y, side, _ in squares]
    rows = tuple({"rate_kg_ha": rate} for *_, rate in squares)
    return [Layer(path.stem, rows, np.array(shapes, dtype=object))]


FORMATS = (
    FileFormat(
        id="squares",
        words="a text of squares",
        title="squares",
        endings=(".squares",),
        rank=45,
        is_content=lambda path, head: head.startswith(b"SQUARES"),
        read_map=defer("prescriptions.shapes", "read_map_layers"),
        read_layers=read_squares,
        make_example=lambda path: path.write_text("SQUARES\n120.0 33.0 0.001 120\n"),
    ),
)
