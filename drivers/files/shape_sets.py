"""Which files form a shapefile? They may be in a folder or a zip, and their texts have an encoding
and units.
"""

from __future__ import annotations

import io
import re
import struct
import warnings
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import shapefile
import shapely
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.archives import ArchiveFiles, Folder, open_archive
from topdress.drivers.files.imports.dialect import find_encoding
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.limits import DAMAGED_ZIP
from topdress.drivers.files.shape_layers import (
    Layer,
    apply_projection,
    build_polygon,
    combine_shapes,
    drop_closing_corner,
    find_projection,
)
from topdress.drivers.files.stated_units import StatedUnit, read_side_units
from topdress.drivers.plain_text import OneLineError, PlaceInFile, RefusedInput

# Encodings by byte 29 of a .dbf, the language driver of dBase, FoxPro and Esri.
ENCODING_OF_DRIVER = {
    0x01: "cp437",
    0x02: "cp850",
    0x03: "cp1252",
    0x57: "cp1252",
    0x58: "cp1252",
    0x59: "cp1252",
    0x4D: "gb18030",
    0x7A: "gb18030",
    0x4E: "cp949",
    0x79: "cp949",
    0x4F: "cp950",
    0x78: "cp950",
    0x13: "cp932",
    0x7B: "cp932",
    0x64: "cp852",
    0x65: "cp866",
    0xC8: "cp1250",
    0xC9: "cp1251",
    0xCA: "cp1254",
    0xCB: "cp1253",
}
# Encodings by the content of a .cpg.
ENCODING_OF_SPELLING = {
    "utf8": "utf-8",
    "65001": "utf-8",
    "gbk": "gb18030",
    "gb2312": "gb18030",
    "936": "gb18030",
    "54936": "gb18030",
    "big5": "cp950",
    "950": "cp950",
    "latin1": "cp1252",
    "88591": "cp1252",
    "iso88591": "cp1252",
    "1252": "cp1252",
    "ansi1252": "cp1252",
    "1250": "cp1250",
    "1251": "cp1251",
    "932": "cp932",
    "sjis": "cp932",
    "949": "cp949",
}


@dataclass(frozen=True)
class ShapeSet:
    """Names the files of a shapefile. `name` is the name of its .shp, relative to `files`; `label`
    is its name in messages."""

    files: ArchiveFiles
    name: str
    label: str

    @property
    def stem(self) -> str:
        """Name without its suffix."""
        return PurePosixPath(self.name).stem

    def part(self, ending: str) -> bytes | None:
        """Returns the bytes of the file of this set with a suffix, regardless of case; None for a
        missing file. Raises RefusedInput, OSError."""
        # Programs on Windows write suffixes in any case.
        wanted = self.name[: -len(".shp")].casefold() + ending
        for name in self.files.names:
            if name.casefold() == wanted:
                return self.files.read(name)
        return None

    @contextmanager
    def reader(self, encoding: str | None = None) -> Iterator[Any]:
        """Yields a pyshp reader. Raises the errors of pyshp, RefusedInput, OSError."""
        parts = {
            key: io.BytesIO(data)
            for key in ("shp", "shx", "dbf")
            if (data := self.part(f".{key}")) is not None
        }
        # pyshp would read a set without attributes, but a map needs them.
        if "dbf" not in parts:
            raise shapefile.ShapefileException("its .dbf is not there")
        with (
            # pyshp warns of many harmless properties that reports of this program do not need.
            warnings.catch_warnings(action="ignore"),
            shapefile.Reader(
                **parts,
                encoding=encoding or self.encoding(parts["dbf"].getvalue()),
                encodingErrors="replace",
            ) as reader,
        ):
            yield reader

    def encoding(self, dbf: bytes) -> str:
        """Returns the encoding of the texts: UTF-8 for bytes that are valid UTF-8, else the
        encoding by the .cpg or the language driver unless the texts contradict it, else the
        encoding by the bytes."""
        # Some programs name the file .cst instead of .cpg.
        stated = self.part(".cpg") or self.part(".cst") or b""
        spelled = re.sub(r"[^a-z0-9]", "", stated.decode("ascii", "ignore").lower())
        # The prefixes cp, ansi and ms precede the same numbers of code pages.
        bare = spelled.removeprefix("cp").removeprefix("ansi").removeprefix("ms")
        names = (
            ENCODING_OF_SPELLING.get(spelled) or ENCODING_OF_SPELLING.get(bare),
            ENCODING_OF_DRIVER.get(dbf[29]) if len(dbf) > 29 else None,
        )
        texts = _read_dbf_texts(dbf)
        # Texts in other encodings are hardly ever valid UTF-8.
        # The texts decide before the declared encoding, because declarations are often wrong.
        for name in ("utf-8", *names):
            if name is not None and _is_encoded_as(texts, name):
                return name
        return find_encoding(b" ".join(texts))

    def units(self, columns: Collection[str]) -> dict[str, StatedUnit]:
        """Returns units by column, in small letters, from the companion files that
        programs write."""
        return read_side_units(self.files, self.name, columns)


@contextmanager
def report_damage(label: str) -> Iterator[None]:
    """Turns every error of a reader of shapefiles on damaged files into a line."""
    try:
        yield
    except (OneLineError, TableError):
        raise
    except (shapefile.ShapefileException, UnicodeDecodeError, *DAMAGED_ZIP) as trouble:
        said = (str(trouble).splitlines() or [type(trouble).__name__])[0]
        raise RefusedInput(label, "not readable as a shapefile: {why}", why=said) from None
    # pyshp raises KeyError for an unknown type of shape.
    except KeyError as trouble:
        raise RefusedInput(
            label, "not a shapefile: no type of shapes is {number}", number=trouble
        ) from None
    # A damaged header may announce any sizes, which fail in many ways.
    except (ValueError, IndexError, OverflowError, MemoryError) as trouble:
        raise RefusedInput(
            label, "damaged shapefile ({kind})", kind=type(trouble).__name__
        ) from None


def read_shape_layers(path: Path) -> list[Layer]:
    """Returns a layer for each shapefile at a .shp, in a zip, or in a folder. Raises RefusedInput,
    OSError."""
    return [read_shape_layer(shapes) for shapes in find_shape_sets(path)]


def find_shape_sets(path: Path) -> list[ShapeSet]:
    """Returns the shapefiles at a .shp, in a zip, or in a folder. Raises RefusedInput, OSError."""
    if path.suffix.lower() == ".shp" and not path.is_dir():
        # Only files with the same stem belong to the set, so other folders are not searched.
        return [ShapeSet(Folder(path.parent, deep=False), path.name, str(path))]
    files = open_archive(path)
    return [
        ShapeSet(files, name, files.label(name))
        for name in files.names
        if name.lower().endswith(".shp")
    ]


def read_shape_layer(shapes: ShapeSet, encoding: str | None = None) -> Layer:
    """Returns all shapes of a set with their attributes: points, lines and polygons. Raises
    RefusedInput, OSError."""
    where = PlaceInFile(shapes.label)
    with report_damage(shapes.label):
        # Without a .prj the coordinates must be degrees, which a later check verifies.
        text = shapes.part(".prj")
        with shapes.reader(encoding) as reader:
            names, kind = read_column_names(reader), reader.shapeTypeName
            found = np.empty(len(reader), dtype=object)
            rows = []
            for k, (shape, record) in enumerate(
                zip(reader.iterShapes(), reader.iterRecords(), strict=True)
            ):
                found[k] = _build_shape(shape, kind, where.go_down("row {row}", row=k + 1))
                rows.append(dict(zip(names, record, strict=True)))
        units = shapes.units(names)
        projection = (
            None
            if text is None
            else find_projection(
                # The area of the shapes selects the most accurate transformation.
                text.decode("utf-8", "replace"),
                where,
                shapely.get_coordinates(found),
            )
        )
    degrees, findings = apply_projection(found, projection)
    return Layer(shapes.stem, tuple(rows), degrees, findings, units, kind)


def _build_shape(shape: Any, kind: str, where: PlaceInFile) -> shapely.Geometry | None:
    """Returns a shape; None for an empty shape. A polygon consists of outlines, which run
    clockwise, and holes, which run counter-clockwise."""
    # Heights and measures follow the two coordinates and are dropped.
    places = np.asarray([corner[:2] for corner in shape.points], dtype=np.float64).reshape(-1, 2)
    if not len(places) or kind.startswith(("MULTI", "NULL")):
        return None
    if kind.startswith("POINT"):
        return shapely.Point(places[0])
    parts = np.split(places, shape.parts[1:])
    if kind.startswith("POLYLINE"):
        return combine_shapes([shapely.LineString(part) for part in parts if len(part) > 1])
    # Outlines and holes are distinguished by their direction only.
    clockwise = [_is_clockwise(drop_closing_corner(part)) for part in parts]
    # A file with reversed directions has no outline; all rings then count as outlines.
    outlines = [part for part, is_one in zip(parts, clockwise, strict=True) if is_one] or parts
    holes = (
        [part for part, is_one in zip(parts, clockwise, strict=True) if not is_one]
        if len(parts) > 1
        else []
    )
    return combine_shapes(
        [
            build_polygon(rings, where)
            for rings in sort_rings(outlines, holes if any(clockwise) else [])
        ]
    )


def _is_clockwise(corners: Floats) -> bool:
    # Coordinates relative to the first corner keep the precision of large UTM numbers.
    x, y = corners[:, 0] - corners[0, 0], corners[:, 1] - corners[0, 1]
    return bool(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0.0)


def sort_rings(outlines: Sequence[Floats], holes: Sequence[Floats]) -> list[tuple[Floats, ...]]:
    """Returns each outline with its holes; holes outside of all outlines are omitted."""
    # With one outline every hole belongs to it, without a geometric test.
    if len(outlines) == 1 or not holes:
        return [(outline, *(holes if len(outlines) == 1 else ())) for outline in outlines]
    polygons = [shapely.make_valid(shapely.Polygon(outline)) for outline in outlines]
    inside: list[list[Floats]] = [[] for _ in outlines]
    for hole in holes:
        # A point inside of the hole is more robust than its corners, which may touch the outline.
        place = shapely.Polygon(hole).representative_point()
        for k, polygon in enumerate(polygons):
            if shapely.contains(polygon, place):
                inside[k].append(hole)
                break
    return [(outline, *inside[k]) for k, outline in enumerate(outlines)]


def read_column_names(reader: Any) -> list[str]:
    """Returns the names of a reader's columns, each once; a letter that was cut by the ten bytes of
    a name is omitted."""
    names: list[str] = []
    for field in reader.fields:
        if field[0] == "DeletionFlag":
            continue
        # A name cut inside of a multi-byte letter ends with the replacement character.
        name, number = str(field[0]).rstrip("\ufffd").strip(), 2
        free = name
        while free in names:
            free, number = f"{name} ({number})", number + 1
        names.append(free)
    return names


def _is_encoded_as(texts: list[bytes], encoding: str) -> bool:
    """Returns whether texts are valid in an encoding. The last letter of a text may be cut by the
    length of the cell, but not that of every text with non-ASCII letters."""
    whole = cut = 0
    for text in texts:
        try:
            text.decode(encoding)
            whole += not text.isascii()
        except UnicodeDecodeError as error:
            # An error before the end of a text cannot come from a cut letter.
            if error.end < len(text) or error.start < len(text) - 3:
                return False
            whole += not text[: error.start].isascii()
            cut += 1
    # At least one complete non-ASCII text must confirm the encoding.
    return whole > 0 or cut == 0


def _read_dbf_texts(dbf: bytes) -> list[bytes]:
    """Returns the bytes of names and text cells."""
    if len(dbf) < 32:
        return []
    # The header of a dBASE file holds the number of rows, the bytes of the header and the bytes of
    # a row.
    rows, header, width = struct.unpack("<IHH", dbf[4:12])
    fields: list[tuple[int, int]] = []
    # The first byte of each row marks deleted rows.
    texts, at = [], 1
    for place in range(32, min(header, len(dbf)) - 31, 32):
        descriptor = dbf[place : place + 32]
        if descriptor[:1] == b"\r" or len(descriptor) < 32:
            break
        texts.append(descriptor[:11].partition(b"\0")[0])
        if descriptor[11:12] == b"C":
            fields.append((at, descriptor[16]))
        at += descriptor[16]
    # Two thousand rows are enough to recognise an encoding.
    for row in range(min(rows, 2000)):
        begin = header + row * width
        texts += [
            dbf[begin + start : begin + start + length].rstrip(b" \0") for start, length in fields
        ]
    return [text for text in texts if text]
