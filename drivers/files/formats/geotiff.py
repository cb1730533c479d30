"""How is a GeoTIFF (Cloud Optimized too) known and read?"""

from __future__ import annotations

from pathlib import Path

from topdress.drivers.files.formats.file_format import FileFormat, defer
from topdress.drivers.files.limits import RASTER_LIMIT


def write_raster(path: Path) -> None:
    """Writes sixteen cells of 120 kg/ha. Raises ImportError without the extra raster."""
    import numpy as np
    import rasterio

    place = rasterio.transform.from_origin(120.0, 33.0, 1e-4, 1e-4)
    like = {"driver": "GTiff", "height": 4, "width": 4, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs="EPSG:4326", transform=place, **like) as raster:
        raster.write(np.full((1, 4, 4), 120.0, "f4"))
        raster.set_band_description(1, "rate_kg_ha")


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
        make_example=write_raster,
    ),
)
