"""How is a prescription of any known format read? The suffix and the content select the reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.recordings.finding import Finding, many
from topdress.control.targets.prescription import MapData, merge_zones
from topdress.drivers.files.archives import choose_names, open_archive
from topdress.drivers.files.file_sniffer import has_worked_points
from topdress.drivers.files.formats.registry import describe_able, find_format
from topdress.drivers.files.imports.import_errors import format_list
from topdress.drivers.files.limits import check_file
from topdress.drivers.files.outline_overlaps import check_zones
from topdress.drivers.files.prescriptions.map_choices import (
    ImportedMap,
    NoPolygonsError,
    NotAMapError,
    PrescriptionError,
    RateChoice,
    RateQuestion,
)
from topdress.drivers.files.prescriptions.task_files import choose_task_set
from topdress.drivers.files.shape_sets import ShapeSet, find_shape_sets, read_shape_layer

# Formats of equal cells that never overlap.
EVEN_FORMATS = ("raster", "points")
# Formats in a message to the operator.
KNOWN_FORMATS = f"{describe_able('read_map')}; a task and shapefiles as folder or zip too"


def read_prescription(path: str | Path, choice: RateChoice | None = None) -> ImportedMap:
    """Returns a prescription of any known format.

    Parameters
    ----------
    path : a file, folder or zip.
    choice : the operator's choice; None means everything as the file states it.

    Returns
    -------
    zones or grid, with findings.

    Raises
    ------
    RefusedInput : the file cannot be used, in one line; PrescriptionError and its kinds refer to
    the map's contents.
    OSError : the file cannot be opened.
    """
    path, choice = Path(path), choice or RateChoice()
    if not path.exists():
        raise PrescriptionError(path, "not there", f": allowed is {KNOWN_FORMATS}")
    check_file(path)
    found = find_format(path, "read_map")
    read = ((found and found.read_map) or read_packed_map)(path, choice)
    if (
        # The check is slow, and equal cells never overlap.
        read.format not in EVEN_FORMATS
        and read.data.grid is None
        and (crossed := check_zones([zone.rings_deg for zone in read.data.zones], path))
    ):
        said = f"{many(crossed, 'zone')} with edges that cross: what they enclose is taken"
        read = replace(read, findings=(*read.findings, Finding("crossing", said, rows=crossed)))
    return read


def merge_map_zones(read: ImportedMap, step_kg_ha: float) -> ImportedMap:
    """Returns the prescription with zones merged by a step of rate, kg/ha, and a finding about the
    change. Raises PrescriptionError."""
    if not step_kg_ha > 0.0 or not read.data.zones:
        raise PrescriptionError(
            read.path,
            "merge {step:g}: allowed is a step above 0 kg/ha, for a map of zones",
            step=step_kg_ha,
        )
    found = merge_zones(read.data.zones, step_kg_ha)
    said = (
        f"{many(len(read.data.zones), 'zone')} merged to {len(found.zones)} by steps of "
        f"{step_kg_ha:g} kg/ha: as "
        f"much mass, rates changed by up to {found.most_kg_ha:.2f} kg/ha, by "
        f"{found.mean_kg_ha:.2f} in the mean"
    )
    return replace(
        read,
        data=replace(read.data, zones=found.zones),
        findings=(*read.findings, Finding("merged", said)),
    )


def read_table_map(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of a table of polygons or of even points. Raises RefusedInput,
    OSError."""
    from topdress.drivers.files.file_content import FileContent
    from topdress.drivers.files.prescriptions.csv_zones import has_polygon_text, read_csv_zones
    from topdress.drivers.files.prescriptions.grid_from_points import read_point_grid

    if has_polygon_text(path):
        return read_csv_zones(path, choice)
    if path.suffix.lower() == ".csv" or FileContent(path).content_kind == "map":
        return read_point_grid(path, choice)
    return read_packed_map(path, choice)


def read_geojson_areas_or_points(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of a GeoJSON of polygons or of even points. Raises RefusedInput,
    OSError."""
    from topdress.drivers.files.prescriptions.shapes import read_geojson_map

    return _read_areas_or_points(partial(read_geojson_map, path, choice), path, choice)


def read_packed_map(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the task set of a folder or zip, else its shapefile. Shapefiles next to a task set
    are ignored. Raises RefusedInput, OSError."""
    shapes = [] if path.suffix.lower() == ".xml" else find_shape_sets(path)
    if choice.inside is not None:
        named = choose_names([one.name for one in shapes], choice.inside)
        shapes = [one for one in shapes if one.name in named]
    files = choose_task_set(path, choice.inside)
    if files is not None:
        from topdress.drivers.files.prescriptions.isoxml_read import read_isoxml_map

        return _report_unused_shapes(read_isoxml_map(files, path, choice), shapes)
    if len(shapes) > 1:
        raise RateQuestion(
            path,
            "{count} shapefiles: allowed is one of {names}",
            " (--inside says which)",
            count=len(shapes),
            names=format_list(one.name for one in shapes),
        )
    if not shapes:
        packed = (
            format_list(name for name in open_archive(path).names if name.lower().endswith(".zip"))
            if path.suffix.lower() == ".zip"
            else ""
        )
        raise NotAMapError(
            path,
            "no prescription" if choice.inside is None else "no prescription named {name}",
            f": allowed is {KNOWN_FORMATS}"
            + (f"; it holds {packed}: unpack that first" if packed else ""),
            name=choice.inside,
        )
    from topdress.drivers.files.prescriptions.shapes import convert_map_layer

    [one] = shapes
    return _read_areas_or_points(
        lambda: convert_map_layer(
            Path(one.label), "shapefile", read_shape_layer(one), choice, title=one.stem
        ),
        path,
        choice,
    )


def _read_areas_or_points(
    areas: Callable[[], ImportedMap], path: Path, choice: RateChoice
) -> ImportedMap:
    """Returns the areas of a file, or its points if it has no areas. Raises PrescriptionError,
    OSError."""
    try:
        return areas()
    except NoPolygonsError:
        if not has_worked_points(path):
            raise
    from topdress.drivers.files.prescriptions.grid_from_points import read_point_grid

    return read_point_grid(path, choice)


def _report_unused_shapes(read: ImportedMap, shapes: list[ShapeSet]) -> ImportedMap:
    if not shapes:
        return read
    names = format_list(one.name for one in shapes)
    unused = Finding(
        "shapefiles_beside", f"not used next to the task set: {names} (--inside takes one)"
    )
    return replace(read, findings=(*read.findings, unused))


def choose_index_column(choice: RateChoice, rule: CropRule, where: str) -> RateChoice:
    """Returns the choice that reads the index's column as plain numbers. Raises
    PrescriptionError."""
    if choice.unit is not None or choice.scale != 1.0:
        raise PrescriptionError(
            where, "--unit and --scale: allowed without --rule, whose map holds an index"
        )
    if not rule.is_ready:
        raise PrescriptionError(
            where,
            "the rule waits for its strips: allowed is a job with ndvi_nrich (and, by the "
            "field's response, ndvi_check)",
        )
    # This unit has the factor 1, so numbers are unchanged.
    return replace(choice, index=rule.crop.index.upper(), unit="kg/ha")


def read_index_map(path: Path, index: str) -> ImportedMap:
    """Returns a map of the canopy's index, or of zones, for the loop, with these numbers in place
    of rates.

    Parameters
    ----------
    path : the map.
    index : ndvi, ndre or ZONE_FACTOR.

    Returns
    -------
    zones whose rates are the numbers of the index.

    Raises
    ------
    PrescriptionError : the map holds no such numbers.
    OSError : the file cannot be opened.
    """
    from topdress.drivers.files.prescriptions.map_reader import read_prescription

    read = read_prescription(path, RateChoice(index=index.upper(), unit="kg/ha"))
    _require_zones(read)
    return read


def _require_zones(read: ImportedMap) -> None:
    """Refuses a grid, which holds rates. Raises PrescriptionError."""
    if read.data.grid is not None:
        raise PrescriptionError(
            read.path, "a grid of rates: allowed is a map of the canopy's index"
        )


def apply_canopy_rule(read: ImportedMap, rule: CropRule) -> ImportedMap:
    """Returns the prescription with the rate, kg/ha, that the rule gives for each zone's index.
    Raises PrescriptionError for a grid."""
    data = read.data
    _require_zones(read)
    index = rule.crop.index.upper()
    zones = tuple(
        zone._replace(rate_kg_ha=rule.decide_rate(zone.rate_kg_ha).rate_kg_ha)
        for zone in data.zones
    )
    said = Finding("by_rule", f"{index} taken to rates by the rule of {rule.crop.name}")
    new = MapData(zones, None, data.fallbacks, data.fields_deg, data.title, data.product)
    return replace(
        read, data=new, findings=(*read.findings, said), unit_from=f"by the rule, from {index}"
    )
