"""How is a GeoTIFF (Cloud Optimized too) known and read?"""

from __future__ import annotations

from topdress.drivers.files.formats.file_format import FileFormat, defer
from topdress.drivers.files.limits import RASTER_LIMIT

FORMATS = (
    FileFormat(
        id="geotiff",
        words="a TIFF picture or GeoTIFF raster",
        title="GeoTIFF",
        endings=(".tif", ".tiff"),
        rank=60,
        limit=RASTER_LIMIT,
        part_read="it (extra raster)",
        # TIFF and BigTIFF in both orders of bytes.
        is_content=lambda path, head: head.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")),
        read_map=defer("prescriptions.raster", "read_raster"),
    ),
)
