"""How are KML (OGC 12-007r2) and KMZ known, read and written?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from topdress.drivers.files.formats.file_format import (
    FileFormat,
    defer,
    find_root_tag,
    list_zip_names,
)
from topdress.drivers.files.limits import KML_LIMIT


def is_kmz(path: Path, head: bytes) -> bool:
    """Returns whether a zip has a KML and no map of another format."""
    endings = {name.suffix for name in list_zip_names(path, head)}
    return ".kml" in endings and not endings & {".shp", ".xml"}


KML = FileFormat(
    id="kml",
    words="a KML file",
    title="KML",
    endings=(".kml",),
    rank=40,
    writing_extra="gis",
    limit=KML_LIMIT,
    is_content=lambda path, head: find_root_tag(head) == "kml",
    read_map=defer("prescriptions.shapes", "read_map_layers"),
    read_layers=defer("kml", "read_kml"),
    write_map=defer("prescriptions.shapes", "write_map_layers"),
    write_field=defer("fields.shapes", "write_field_layers"),
)
KMZ = replace(
    KML, id="kmz", words="a KMZ file", title="KMZ", endings=(".kmz",), rank=41, is_content=is_kmz
)
FORMATS = (KML, KMZ)
