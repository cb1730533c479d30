"""Which kind of file is a file, by its first bytes and its name, and which command reads it?
Refusals state both for the operator.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from topdress.drivers.devices.capture import CAPTURE_HEADER as CAPTURE
from topdress.drivers.files.formats.file_format import find_root_tag, list_zip_names
from topdress.drivers.files.formats.registry import list_able, list_formats, list_kinds
from topdress.drivers.files.limits import read_json
from topdress.drivers.plain_text import OneLineError

# Number of bytes at the beginning that are examined.
SNIFFED_BYTES = 4096
# Share of bytes that must be text in a text file.
MIN_TEXT_BYTE_SHARE = 0.95


class WrongKindError(OneLineError):
    """Reports a file of a kind that is not read here, in one line."""


class FileKind(NamedTuple):
    """Describes a kind of file. Commands list the kinds that they accept by `id`. `words` describes
    the kind, `instead` names the command that reads it or another remedy."""

    id: str
    words: str
    instead: str


_ADVICE_SAVE = "save it as CSV, GeoJSON or shapefile in the program that it comes from"
_ADVICE_UNPACK = "unpack it first"
_ADVICE_EXPORT = "no command reads it: export it as a shapefile or as ISOXML from"
# All kinds that are recognised, by their id.
FILE_KINDS = {
    kind.id: kind
    for kind in (
        FileKind("picture", "a picture", "no command reads pictures"),
        FileKind("pdf", "a PDF document", f"no command reads PDF; {_ADVICE_SAVE}"),
        FileKind("html", "a web page", "no command reads web pages; was a download refused?"),
        FileKind("sqlite", "an SQLite database", f"no command reads it; {_ADVICE_SAVE}"),
        FileKind("gpx", "a GPX track", f"no command reads it; {_ADVICE_SAVE}"),
        FileKind(
            "xml",
            "an XML file that is no task file",
            "of XML, ISOXML task files (TASKDATA.XML) and KML are read",
        ),
        FileKind("fgb", "a FlatGeobuf file", _ADVICE_SAVE),
        FileKind("las", "a LAS point cloud", "no command reads point clouds"),
        FileKind("deere", "a file of a John Deere display", f"{_ADVICE_EXPORT} Operations Center"),
        FileKind("agleader", "a file of an Ag Leader display", f"{_ADVICE_EXPORT} SMS or AgFiniti"),
        FileKind(
            "cnh", "a card of a Case IH or New Holland display", f"{_ADVICE_EXPORT} AFS or PLM"
        ),
        FileKind(
            "planting", "a file of a Precision Planting display", f"{_ADVICE_EXPORT} Panorama"
        ),
        FileKind("gzip", "a gzip file", _ADVICE_UNPACK),
        FileKind("7z", "a 7z archive", _ADVICE_UNPACK),
        FileKind("rar", "a RAR archive", _ADVICE_UNPACK),
        FileKind("office", "a text document", f"no command reads it; {_ADVICE_SAVE}"),
        FileKind(
            "zip",
            "a zip",
            "topdress map, import and field read zips that hold task files or shapefiles",
        ),
        FileKind("shp part", "a part of a shapefile", "give the .shp next to it"),
        FileKind("nmea", "a receiver's capture (NMEA)", "topdress decode gnss reads it"),
        FileKind("capture", "a capture of the console", "topdress decode reads it"),
        FileKind("config", "a configuration file of topdress", "topdress check says what is in it"),
        FileKind(
            "folder",
            "a folder",
            "topdress map, import, field and check read folders with a task file or shapefiles",
        ),
        FileKind("empty", "an empty file", "nothing is in it"),
        FileKind(
            "binary",
            "no text and no known format",
            f"known are {', '.join(one.title for one in list_formats())}",
        ),
        *(FileKind(one.id, one.words, one.advice) for one in list_formats()),
    )
}
# Kinds that may contain a table.
TABLE_KINDS = list_kinds("read_table")
# Suffixes of tables.
TABLE_SUFFIXES = frozenset(e for one in list_formats() if one.is_table for e in one.endings)
# Suffixes of foreign logs, and of topdress's Parquet stores.
FOREIGN_SUFFIXES = (
    frozenset(
        ending
        for one in list_able("read_table")
        for ending in (*one.endings, *((".zip",) if one.is_packed else ()))
    )
    - TABLE_SUFFIXES
)
# Types of a shapefile's points: plain, with height, with measure (ESRI).
POINT_TYPES = (1, 11, 21)

# First bytes of formats, as file(1) lists them.
_MAGIC_BYTES = (
    (b"\x89PNG", "picture"),
    (b"\xff\xd8\xff", "picture"),
    (b"GIF8", "picture"),
    (b"BM6", "picture"),
    (b"%PDF", "pdf"),
    (b"fgb\x03", "fgb"),
    (b"LASF", "las"),
    (b"\x1f\x8b", "gzip"),
    (b"SQLite format 3\0", "sqlite"),
    (b"7z\xbc\xaf", "7z"),
    (b"Rar!", "rar"),
)
# Suffixes that machine displays write for the programs of their manufacturers.
_MAKER_OF_SUFFIX = {
    **dict.fromkeys((".fdshape", ".fdl", ".fdd", ".gsy", ".gsd"), "deere"),
    **dict.fromkeys((".agdata", ".agsetup", ".ilf", ".yld"), "agleader"),
    **dict.fromkeys((".cn1", ".vy1"), "cnh"),
    ".2020": "planting",
}
# Suffixes of the other files of a shapefile.
_SHAPEFILE_PARTS = (".shx", ".dbf", ".prj", ".cpg", ".sbn", ".sbx", ".qix")
# Kinds of XML files by their first element.
_KIND_OF_ROOT = {"gpx": "gpx", "html": "html"}
# Beginning of a sentence of NMEA 0183.
_NMEA_SENTENCE = re.compile(rb"^[$!](G[A-Z]|BD|PQ|PM|II)[A-Z]{3},", re.MULTILINE)
# Every configuration file of topdress names its format.
_CONFIG_FORMAT_LINE = re.compile(rb"^format:\s*[\"']?topdress-", re.MULTILINE)
_HTML_BEGINNING = re.compile(rb"^\s*(<!doctype html|<html)", re.IGNORECASE)


def sniff_file_kind(path: Path) -> FileKind:
    """Returns the kind of a file or folder. Raises OSError."""
    if (maker := _MAKER_OF_SUFFIX.get(path.suffix.lower())) is not None:
        return FILE_KINDS[maker]
    if path.is_dir():
        names = {one.name.lower() for one in path.iterdir()}
        return FILE_KINDS[
            "aog"
            if {"field.txt", "boundary.txt"} & names and "taskdata.xml" not in names
            else "folder"
        ]
    with path.open("rb") as file:
        head = file.read(SNIFFED_BYTES)
    return FILE_KINDS[_sniff_bytes(path, head)]


def _sniff_bytes(path: Path, head: bytes) -> str:
    suffix = path.suffix.lower()
    if not head.strip(b"\0 \r\n\t\xef\xbb\xbf"):
        return "empty" if len(head) < SNIFFED_BYTES else "binary"
    if suffix in _SHAPEFILE_PARTS:
        return "shp part"
    for one in list_formats():
        if one.is_content(path, head):
            return one.id
    for magic, kind in _MAGIC_BYTES:
        if head.startswith(magic):
            return kind
    if head.startswith(b"PK"):
        names = list_zip_names(path, head)
        return "office" if any(name.parts[0] in ("word", "ppt") for name in names) else "zip"
    return _sniff_text(head)


def _sniff_text(head: bytes) -> str:
    begin = head.lstrip(b"\xef\xbb\xbf \r\n\t")
    if head[:2] in (b"\xff\xfe", b"\xfe\xff") or head[1:8:2] == b"\0\0\0\0":
        # A byte order mark of UTF-16 identifies a text.
        return "text"
    if begin.startswith(b"<"):
        if _HTML_BEGINNING.match(begin):
            return "html"
        return _KIND_OF_ROOT.get(find_root_tag(head), "xml")
    if begin.startswith(CAPTURE):
        return "capture"
    if _CONFIG_FORMAT_LINE.search(head):
        return "config"
    if len(_NMEA_SENTENCE.findall(head)) >= 2:
        return "nmea"
    readable = sum(byte >= 32 or byte in b"\t\r\n\0\x0c" for byte in head)
    return (
        "text"
        if readable >= MIN_TEXT_BYTE_SHARE * len(head) and head.count(0) < 0.3 * len(head)
        else "binary"
    )


def refuse_kind(path: Path, takes: Collection[str], reads: str) -> None:
    """Refuses a file of a wrong kind; a kind that may be right passes.

    Parameters
    ----------
    path : the file.
    takes : ids of the permitted kinds.
    reads : description of the permitted content.

    Raises
    ------
    WrongKindError : the file is missing, or of another kind; the message names the command that
    reads it.
    OSError : the file cannot be opened.
    """
    if not path.exists():
        raise WrongKindError(f"{path}: no such file")
    if not (path.is_file() or path.is_dir()):
        # Opening a pipe would wait for its writer and take the bytes from its reader.
        return
    kind = sniff_file_kind(path)
    if kind.id not in takes:
        instead = f" ({kind.instead})" if kind.instead else ""
        raise WrongKindError(f"{path}: this is {kind.words}{instead}: allowed here is {reads}")


def has_worked_points(path: Path) -> bool:
    """Returns whether a file that might be a map of areas contains worked points instead. Raises
    OSError."""
    is_json = path.suffix.lower() in (".geojson", ".json") and not path.is_dir()
    try:
        return _has_geojson_points(path) if is_json else _has_file_points(path)
    except ValueError:
        return False


def _has_geojson_points(path: Path) -> bool:
    root = read_json(path)
    features = root.get("features") if isinstance(root, dict) else None
    shapes = (
        [one.get("geometry") for one in features if isinstance(one, dict)]
        if isinstance(features, list)
        else []
    )
    kinds = {str(shape.get("type")) for shape in shapes if isinstance(shape, dict)}
    return "Point" in kinds and not kinds & {"Polygon", "MultiPolygon"}


def _has_file_points(path: Path) -> bool:
    """Returns whether a task was worked and prescribes nothing, or no shapefile has areas."""
    from topdress.drivers.files.prescriptions.task_files import find_task_sets, read_task_tree
    from topdress.drivers.files.shape_sets import find_shape_sets

    tasks = find_task_sets(path)
    if tasks:
        roots = [read_task_tree(one) for one in tasks]
        return any(root.find("TSK/TLG") is not None for root in roots) and not any(
            root.find("TSK/TZN") is not None for root in roots
        )
    heads = [one.part(".shp") or b"" for one in find_shape_sets(path)]
    kinds = [int.from_bytes(head[32:36], "little") for head in heads]
    return bool(kinds) and all(kind in POINT_TYPES for kind in kinds)
