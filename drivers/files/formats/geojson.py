"""How is GeoJSON (RFC 7946) known, read and written?"""

from __future__ import annotations

from pathlib import Path

from topdress.drivers.files.formats.file_format import FileFormat, defer
from topdress.drivers.files.limits import JSON_LIMIT

# Number of bytes in which a list of maps looks for a feature.
SEARCHED_BYTES = 4096


def is_json(path: Path, head: bytes) -> bool:
    """Returns whether a text begins as JSON, in an encoding of single bytes."""
    begin = head.lstrip(b"\xef\xbb\xbf \r\n\t")
    return begin[:1] in (b"{", b"[") and begin[1:2] != b"\0"


def has_feature(path: Path) -> bool:
    """Returns whether a feature is in the beginning, unlike in settings. Raises OSError."""
    with path.open("rb") as file:
        return b'"Feature' in file.read(SEARCHED_BYTES)


FORMATS = (
    FileFormat(
        id="json",
        words="a JSON file",
        title="GeoJSON",
        endings=(".geojson", ".json"),
        rank=10,
        keeps_fallbacks=True,
        limit=JSON_LIMIT,
        source_kind="geojson",
        part_read="GeoJSON",
        is_content=is_json,
        is_map_likely=has_feature,
        read_map=defer("prescriptions.map_reader", "read_geojson_areas_or_points"),
        read_layers=defer("shape_layers", "read_geojson_layers"),
        read_table=defer("imports.point_tables", "read_points"),
        write_map=defer("prescriptions.map_writer", "write_geojson"),
        write_field=defer("fields.shapes", "write_field_geojson"),
        write_export=defer("exports.export_writer", "write_export_geojson"),
    ),
)
