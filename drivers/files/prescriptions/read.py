"""Reading a prescription of any known format."""
from __future__ import annotations

import zipfile
from pathlib import Path

from drivers.files.prescriptions.task_files import find_task_files
from drivers.files.prescriptions.words import Choice, Imported, PrescriptionError

KNOWN = ("an ISO 11783-10 task (TASKDATA.XML, its folder or zip), a shapefile (.shp or zip), GeoJSON (.geojson, "
         ".json), CSV with polygons (WKT)")


def read_prescription(path: str | Path, choice: Choice | None = None) -> Imported:
    """Reads a prescription; the operator's choices as given. Raises PrescriptionError in one line, OSError."""
    path, choice = Path(path), choice or Choice()
    if not path.exists():
        raise PrescriptionError(f"{path}: not there: allowed is {KNOWN}")
    suffix = path.suffix.lower()
    if suffix in (".geojson", ".json"):
        from drivers.files.prescriptions.geojson import read_geojson
        return read_geojson(path, choice)
    if suffix == ".shp" or (suffix == ".zip" and _holds_shapefile(path)):
        from drivers.files.prescriptions.shapefiles import read_shapefile
        return read_shapefile(path, choice)
    if suffix == ".csv":
        from drivers.files.prescriptions.csv_zones import read_csv_zones
        return read_csv_zones(path, choice)
    files = find_task_files(path)
    if files is None:
        raise PrescriptionError(f"{path}: no prescription: allowed is {KNOWN}")
    from drivers.files.prescriptions.isoxml_read import read_isoxml
    return read_isoxml(files, path, choice)


def _holds_shapefile(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.lower().endswith(".shp") for name in archive.namelist())
    except zipfile.BadZipFile as error:
        raise PrescriptionError(f"{path}: {error}") from None
