"""Writing an as-applied export in the format that the path's ending names."""
from __future__ import annotations

from pathlib import Path

from drivers.files.exports.as_applied import AsApplied, ExportError

KNOWN = (".csv, .geojson or .json, .shp, .gpkg, .zip (ISO 11783-10 task), a folder (task), or .html (the report, which "
         "a browser prints to a PDF)")


def write_as_applied(applied: AsApplied, path: str | Path, polygons: bool = False) -> None:
    """polygons: the ground of each stretch instead of its middle (GeoJSON and shapefile).

    Raises ExportError for an ending that is none of these, OSError.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".geojson", ".json", ".shp", ".gpkg", ".zip", ""):
        raise ExportError(f"{path}: ending {suffix}: allowed {KNOWN}")
    path.parent.mkdir(parents=True, exist_ok=True)
    if suffix in (".zip", ""):
        from drivers.files.exports.isoxml import write_isoxml
        write_isoxml(applied, path)
        return
    from drivers.files.exports import flat
    if suffix == ".csv":
        flat.write_csv(applied, path)
    elif suffix == ".gpkg":
        flat.write_gpkg(applied, path, polygons)
    elif suffix == ".shp":
        flat.write_shapefile(applied, path, polygons)
    else:
        flat.write_geojson(applied, path, polygons)
