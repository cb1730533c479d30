"""How is a GeoPackage (OGC 12-128r19) known, read and written?"""

from __future__ import annotations

from pathlib import Path

from topdress.drivers.files.formats.file_format import FileFormat, defer
from topdress.drivers.files.limits import GEOPACKAGE_LIMIT

SUFFIX = ".gpkg"


def is_geopackage(path: Path, head: bytes) -> bool:
    """Returns whether an SQLite database has the application id, or the usual suffix."""
    named = head[68:72] == b"GPKG" or path.suffix.lower() == SUFFIX
    return named and head.startswith(b"SQLite format 3\0")


FORMATS = (
    FileFormat(
        id="gpkg",
        words="a GeoPackage",
        title="GeoPackage",
        endings=(SUFFIX,),
        rank=30,
        writing_extra="gis",
        limit=GEOPACKAGE_LIMIT,
        is_content=is_geopackage,
        read_map=defer("prescriptions.shapes", "read_map_layers"),
        read_layers=defer("geopackage", "read_geopackage"),
        write_map=defer("prescriptions.shapes", "write_map_layers"),
        write_field=defer("fields.shapes", "write_field_layers"),
        write_export=defer("exports.export_writer", "write_export_geopackage"),
    ),
)
