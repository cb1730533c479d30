"""Reading a prescription of any known format."""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from drivers.files.archives import ArchiveError, chosen, files_at
from drivers.files.findings import Finding
from drivers.files.imports.trouble import listed
from drivers.files.limits import BeyondLimits, check_file
from drivers.files.prescriptions.task_files import find_task_files
from drivers.files.prescriptions.words import Choice, Imported, PrescriptionError, RateQuestion
from drivers.files.shape_sets import ShapeSet, shape_sets

KNOWN = ("an ISO 11783-10 task (TASKDATA.XML, its folder or zip), a shapefile (.shp or zip), GeoJSON (.geojson, "
         ".json), CSV with polygons (WKT)")


def read_prescription(path: str | Path, choice: Choice | None = None) -> Imported:
    """Reads a prescription; the operator's choices as given. Raises PrescriptionError in one line, OSError."""
    path, choice = Path(path), choice or Choice()
    if not path.exists():
        raise PrescriptionError(f"{path}: not there: allowed is {KNOWN}")
    try:
        check_file(path)
    except BeyondLimits as error:
        raise PrescriptionError(str(error)) from None
    suffix = path.suffix.lower()
    if suffix in (".geojson", ".json"):
        from drivers.files.prescriptions.geojson import read_geojson
        return read_geojson(path, choice)
    if suffix == ".csv":
        from drivers.files.prescriptions.csv_zones import read_csv_zones
        return read_csv_zones(path, choice)
    return _of_several(path, choice)


def _of_several(path: Path, choice: Choice) -> Imported:
    """Of a folder or zip: its task set, beside which shapefiles do not count, else its shapefile."""
    try:
        shapes = [] if path.suffix.lower() == ".xml" else shape_sets(path)
        if choice.inside is not None:
            named = chosen([one.name for one in shapes], choice.inside)
            shapes = [one for one in shapes if one.name in named]
    except ArchiveError as error:
        raise PrescriptionError(str(error)) from None
    files = find_task_files(path, choice.inside)
    if files is not None:
        from drivers.files.prescriptions.isoxml_read import read_isoxml
        return _said(read_isoxml(files, path, choice), shapes)
    if len(shapes) > 1:
        raise RateQuestion(f"{path}: {len(shapes)} shapefiles: allowed is one of "
                           f"{listed(one.name for one in shapes)} (--inside says which)")
    if not shapes:
        inside = "" if choice.inside is None else f" named {choice.inside}"
        raise PrescriptionError(f"{path}: no prescription{inside}: allowed is {KNOWN}{_packed(path)}")
    from drivers.files.prescriptions.shapefiles import read_shapefile
    return read_shapefile(shapes[0], choice, [])


def _said(read: Imported, shapes: list[ShapeSet]) -> Imported:
    if not shapes:
        return read
    names = listed(one.name for one in shapes)
    beside = Finding("shapefiles_beside", f"not used beside the task set: {names} (--inside takes one)")
    return replace(read, findings=(*read.findings, beside))


def _packed(path: Path) -> str:
    """What to do about a zip in a zip."""
    if path.suffix.lower() != ".zip":
        return ""
    packed = [name for name in files_at(path).names() if name.lower().endswith(".zip")]
    return f"; it holds {listed(packed)}: unpack that first" if packed else ""
