"""Which map, plant list, index map and worked ground does a job name? They are read and placed on
the plane of the job's loop.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import TypedDict, TypeVar

import numpy as np
from topdress.control.field.done_ground import DoneGround
from topdress.control.field.job import Job
from topdress.control.geodesy import TangentPlane
from topdress.control.machine.machine import Machine
from topdress.control.targets.index_map import IndexMap
from topdress.control.targets.map_check import MapCheck, check_map
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.plant_doser import OTHER_PLANT_DISTANCE_M, DoseError
from topdress.control.targets.plant_places import PlantList
from topdress.control.targets.prescription import MapData, project_prescription, project_rates
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.archives import list_opened_files
from topdress.drivers.files.limits import check_file
from topdress.drivers.files.prescriptions.map_choices import (
    ZONE_FACTOR,
    PrescriptionError,
    RateQuestion,
)
from topdress.drivers.plain_text import PlaceInFile

Made = TypeVar("Made")
# Largest speed of a machine that gives single doses, m/s; a speed in km/h exceeds it.
MAX_DOSE_SPEED_MPS = 10.0


def read_plant_places(path: Path) -> Floats:
    """Returns a plant list: CSV with lat_deg and lon_deg, or GeoJSON points.

    Returns
    -------
    positions (n, 2), latitude and longitude, in the file's order.

    Raises
    ------
    RefusedInput : the file cannot be used, in one line.
    OSError : the file cannot be opened.
    """
    if not path.exists():
        raise PrescriptionError(
            path, "not there", ": allowed is a CSV with lat_deg and lon_deg, or GeoJSON points"
        )
    # Large files are refused before they are read.
    check_file(path)
    rows = (
        _read_geojson_points(path)
        if path.suffix.lower() in (".geojson", ".json")
        else _read_csv_rows(path)
    )
    # An empty list would skip every plant without a message.
    if not rows:
        raise PrescriptionError(path, "no plants: allowed is at least one")
    places = np.array(rows, dtype=np.float64)
    # The condition is written so that NaN counts as wrong.
    bad = np.flatnonzero(~((np.abs(places[:, 0]) <= 90.0) & (np.abs(places[:, 1]) <= 180.0)))
    if len(bad):
        lat, lon = places[bad[0]]
        raise PrescriptionError(
            PlaceInFile(str(path)).go_down("plant {plant}", plant=bad[0] + 1),
            "{lat:g}, {lon:g}: allowed are degrees, latitude -90 to 90, longitude -180 to 180",
            lat=lat,
            lon=lon,
        )
    return places


def read_dose_errors(path: Path) -> tuple[DoseError, ...]:
    """Returns the dose errors of a CSV with error_m (late positive), speed_mps and, where it was
    not 0, threshold_m. Raises PrescriptionError in one line, OSError."""
    if not path.exists():
        raise PrescriptionError(
            path, "not there", ": allowed is a table with error_m and speed_mps"
        )
    check_file(path)
    found = []
    # Line numbers begin at 2, because the header is line 1.
    for number, cells in enumerate(
        _read_csv_rows(path, ("error_m", "speed_mps"), ("threshold_m",)), start=2
    ):
        one = DoseError(*cells)
        # A speed in km/h or an error in mm would shift every dose.
        if not (
            abs(one.error_m) <= OTHER_PLANT_DISTANCE_M
            and 0.0 < one.speed_mps <= MAX_DOSE_SPEED_MPS
            and abs(one.threshold_m) <= OTHER_PLANT_DISTANCE_M
        ):
            raise PrescriptionError(
                PlaceInFile(str(path)).go_down("line {line}", line=number),
                "{error:g} m at {speed:g} m/s: allowed are errors and thresholds of at most "
                "{most:g} m, speeds above 0 to {fastest:g} m/s",
                error=one.error_m,
                speed=one.speed_mps,
                most=OTHER_PLANT_DISTANCE_M,
                fastest=MAX_DOSE_SPEED_MPS,
            )
        found.append(one)
    return tuple(found)


def _read_csv_rows(
    path: Path, needed: tuple[str, ...] = ("lat_deg", "lon_deg"), more: tuple[str, ...] = ()
) -> list[tuple[float, ...]]:
    """Returns the columns `needed`, and the existing columns of `more`, in the file's order."""
    # Editors on Windows add a byte order mark, which would hide the first column.
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        reader = csv.DictReader(file)
        names = reader.fieldnames or []
        for name in needed:
            if name not in names:
                raise PrescriptionError(
                    path,
                    "column {column} missing: allowed is a header with {names}",
                    column=name,
                    names=", ".join(needed),
                )
        rows = []
        # The header is line 1.
        for number, row in enumerate(reader, start=2):
            cells = [row[name] for name in (*needed, *more) if name in names]
            try:
                # An empty cell fails as a text does, because a position has no default.
                rows.append(tuple(float(cell or "") for cell in cells))
            except ValueError:
                raise PrescriptionError(
                    PlaceInFile(str(path)).go_down("line {line}", line=number),
                    "{cells}: allowed are numbers",
                    cells=", ".join(str(cell) for cell in cells),
                ) from None
        return rows


def _read_geojson_points(path: Path) -> list[tuple[float, ...]]:
    # This import is local, because most jobs name no plants.
    from topdress.drivers.files.shape_layers import read_geojson

    points = read_geojson(path, ["Point"]).shapes
    # Points of this program have the latitude first.
    return [(point.y, point.x) for point in points if point is not None and not point.is_empty]


def read_job_map(job: Job, folder: Path) -> MapProfile | None:
    """Returns the prescription of `target.map`, a path relative to the job file.

    The file's rates are read as kg/ha; a file that needs a choice is converted with `topdress map`
    first.

    Parameters
    ----------
    job : job that names the map.
    folder : folder of the job file.

    Returns
    -------
    the map on its plane; None where the job names none.

    Raises
    ------
    PrescriptionError : the map cannot be used, in one line.
    OSError : the map cannot be opened.
    """
    return _convert_job_map(
        job, folder, lambda data, plane: MapProfile(project_prescription(data, plane), plane)
    )


def find_map_check(job: Job, limit_kg_ha: float, folder: Path) -> MapCheck | None:
    """Returns which parts of the job's map will not be applied unchanged.

    Parameters
    ----------
    job : job that names the map and the field.
    limit_kg_ha : limit of the crop, kg/ha.
    folder : folder of the job file.

    Returns
    -------
    the check; None where the job names no map.

    Raises
    ------
    PrescriptionError : the map cannot be used, in one line.
    OSError : the map cannot be opened.
    """
    return _convert_job_map(
        job,
        folder,
        lambda data, plane: check_map(data, limit_kg_ha, job.field.make_boundary(), plane),
    )


def find_map_rates(job: Job, folder: Path) -> list[float]:
    """Returns the different rates above 0 of the job's map, kg/ha, in increasing order; none
    without a map.

    Raises
    ------
    PrescriptionError : the map cannot be used, in one line.
    OSError : the map cannot be opened.
    """
    return _convert_job_map(job, folder, lambda data, _: data.rates_kg_ha) or []


def _convert_job_map(
    job: Job, folder: Path, make: Callable[[MapData, TangentPlane], Made]
) -> Made | None:
    """Returns the result of `make` for the job's map, unchanged, on the field's plane, else on its
    own. Raises PrescriptionError, OSError."""
    if job.target.map is None:
        return None
    # This import is local, because most jobs have no map.
    from topdress.drivers.files.prescriptions.map_reader import read_prescription

    try:
        read = read_prescription(folder / job.target.map)
    # A job cannot answer questions, so the map must be converted before.
    except RateQuestion as question:
        raise RateQuestion.from_error(
            question, hint="; a job takes what topdress map IN ... --out NEW.geojson writes"
        ) from None
    try:
        # On the field's plane map and boundary use the same coordinates.
        return make(read.data, _find_field_plane(job) or read.data.make_plane())
    except ValueError as error:
        raise PrescriptionError(read.path, "{why}", why=error) from None


def read_job_plants(job: Job, folder: Path, plane: TangentPlane | None = None) -> PlantList | None:
    """Returns the plants of `target.plants`, a path relative to the job file, on the field's plane,
    else on `plane`, else on their own. Raises PrescriptionError, OSError."""
    if job.target.plants is None:
        return None
    places = read_plant_places(folder / job.target.plants)
    # Without a field the plane lies in the middle of the plants.
    own = (
        _find_field_plane(job)
        or plane
        or TangentPlane(float(places[:, 0].mean()), float(places[:, 1].mean()))
    )
    return PlantList(places, own)


def list_job_files(job: Job, folder: Path) -> tuple[Path, ...]:
    """Returns the files of the job's map, plants, index map, zones and worked ground."""
    return tuple(file for name in job.named_files for file in list_opened_files(folder / name))


class LoopTargets(TypedDict):
    """Holds the target data of a job's loop, by the names of the loop's parameters."""

    prescription: MapProfile | None
    plants: PlantList | None
    index_map: IndexMap | None
    zone_map: IndexMap | None
    done: DoneGround | None
    dose_errors: tuple[DoseError, ...]


def read_loop_targets(job: Job, folder: Path, machine: Machine, index: str) -> LoopTargets:
    """Returns map, plants, index map, zones and worked ground of a job on a common plane.

    Parameters
    ----------
    job : job that names the files.
    folder : folder of the job file.
    machine : machine that defines the working width.
    index : index of the crop's rule.

    Returns
    -------
    the data by the names of the loop's parameters.

    Raises
    ------
    PrescriptionError : a file cannot be used, in one line.
    FieldError : the worked ground cannot be used, in one line.
    OSError : a file cannot be opened.
    """
    prescription = read_job_map(job, folder)
    plants = read_job_plants(job, folder, None if prescription is None else prescription.plane)
    # Plants need the exact position, so their plane comes first.
    plane = (
        plants.plane if plants is not None else None if prescription is None else prescription.plane
    )
    width_m = machine.geometry.working_width_m
    # Each further map uses the plane of the first one, so that all positions agree.
    under = _read_index_map(job, job.target.index_map, folder, width_m, index, plane)
    plane = plane or (None if under is None else under.plane)
    zones = _read_index_map(job, job.target.zone_map, folder, width_m, ZONE_FACTOR, plane)
    plane = plane or (None if zones is None else zones.plane)
    return {
        "prescription": prescription,
        "plants": plants,
        "index_map": under,
        "zone_map": zones,
        "done": read_job_worked_area(job, folder, plane),
        "dose_errors": (
            ()
            if job.target.dose_errors is None
            else read_dose_errors(folder / job.target.dose_errors)
        ),
    }


def _read_index_map(
    job: Job, name: str | None, folder: Path, width_m: float, index: str, plane: TangentPlane | None
) -> IndexMap | None:
    """Returns a map of an index, or of zones, on the field's plane, else on `plane`, else on its
    own; None where the job names none. Raises PrescriptionError in one line, OSError."""
    if name is None:
        return None
    # This import is local, because most jobs have no such map.
    from topdress.drivers.files.prescriptions.map_reader import read_index_map

    data = read_index_map(folder / name, index).data
    # A map without a field has only its own plane.
    plane = _find_field_plane(job) or plane or data.make_plane()
    return IndexMap(project_rates(data, plane), plane, width_m)


def read_job_worked_area(job: Job, folder: Path, plane: TangentPlane | None) -> DoneGround | None:
    """Returns the ground of `field.done`, on the field's plane, else on `plane`. Raises FieldError
    in one line, OSError."""
    if job.field.done is None:
        return None
    # This import is local, because most jobs have no worked ground.
    from topdress.drivers.files.fields.worked_area import read_worked_area

    return read_worked_area(folder / job.field.done, _find_field_plane(job) or plane)


def _find_field_plane(job: Job) -> TangentPlane | None:
    """Returns the plane of the job's field, so that boundary and map share it; None without a
    field."""
    return (
        TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
        if job.field.boundary_m
        else None
    )
