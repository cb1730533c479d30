"""How is a shapefile known, read and written? Folders and zips are read alike."""

from __future__ import annotations

from topdress.drivers.files.formats.file_format import FileFormat, defer
from topdress.drivers.files.limits import SHAPEFILE_LIMIT

FORMATS = (
    FileFormat(
        id="shp",
        words="a shapefile",
        title="shapefile",
        endings=(".shp",),
        rank=20,
        is_packed=True,
        limit=SHAPEFILE_LIMIT,
        source_kind="shapefile",
        # The number 9994, with which every .shp begins.
        is_content=lambda path, head: head.startswith(b"\0\0\x27\x0a"),
        read_map=defer("prescriptions.map_reader", "read_packed_map"),
        read_layers=defer("shape_sets", "read_shape_layers"),
        read_table=defer("imports.point_tables", "read_point_shapefile"),
        write_map=defer("prescriptions.map_writer", "write_map_shapefile"),
        write_export=defer("exports.export_writer", "write_export_shapefile"),
    ),
)
