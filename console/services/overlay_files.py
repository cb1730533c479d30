"""How does the Map page show files of other days? Applied or harvested amounts are placed on the
plane of the job.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from topdress.console.app.coverage_raster import GroundBox, WorkedGround, make_spot
from topdress.console.app.map_layers import MapLayer
from topdress.console.app.overlay_file import HarvestColumn, OverlayFile
from topdress.console.app.pages.diagnosis.service import ImportNeedsAnswersError
from topdress.console.app.pages.replay.service import LogFile
from topdress.console.frame import Frame
from topdress.console.services.diagnosis import DiagnosisFiles
from topdress.console.services.field import find_job_plane
from topdress.console.services.foreign_files import IMPORT_FILE_SUFFIX, import_file_as_log
from topdress.console.services.run_logs import select_logs

if TYPE_CHECKING:
    from topdress.control.geodesy import TangentPlane
    from topdress.drivers.files.read_log import RunLog
    from topdress.drivers.files.run_meta import RunMeta

# Distance of the outlets behind the antenna, m, where the frame's machine is unknown.
OUTLET_BEHIND_M = 2.0
# Distance between fix and position, m, up to which the fix may only be some seconds older; a larger
# distance means another plane.
MAX_STALE_FIX_M = 30.0
DEFAULT_WIDTH_M = 2.4


class StoredOverlayFiles:
    """Implements `console.app.pages.map.service.OverlayFiles` on real files."""

    def __init__(self, files: DiagnosisFiles | None = None) -> None:
        self._files = files or DiagnosisFiles()

    def list_layer_files(self, running_log: str) -> tuple[LogFile, ...]:
        """Returns logs that can be shown on the map."""
        return select_logs(one for one in self._files.list_sources(running_log) if not one.working)

    def make_overlay(self, path: str, frame: Frame) -> OverlayFile:
        """Returns the overlay of a file. Raises ValueError in one line for an unreadable file, open
        questions, or a file without positions, or without rate and harvest."""
        from topdress.drivers.files.run_meta import read_sidecar_meta

        meta = read_sidecar_meta(frame.log_path) if frame.log_path else None
        try:
            log = _open_layer_log(Path(path))
            return make_log_overlay(
                log, find_frame_plane(frame, meta), _find_working_width_m(meta), frame
            )
        except ImportNeedsAnswersError as asked:
            raise ValueError(_describe_open_question(Path(path), asked.questions)) from None
        except (ValueError, OSError) as error:
            raise ValueError(
                str(error).splitlines()[0].replace(f"{path}", Path(path).name)
            ) from None


def _open_layer_log(path: Path) -> RunLog:
    """Returns the log, read by the import file next to it. Raises ValueError, OSError."""
    from topdress.drivers.files.any_log import open_any_log
    from topdress.drivers.files.imports.import_errors import UnsureImportError
    from topdress.drivers.files.read_log import read_nonempty_log

    if not path.with_name(f"{path.stem}{IMPORT_FILE_SUFFIX}").exists():
        try:
            return open_any_log(path)
        except UnsureImportError as asked:
            raise ValueError(_describe_open_question(path, asked.reasons)) from None
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        return read_nonempty_log(import_file_as_log(path, Path(folder))[0])


def _describe_open_question(path: Path, questions: Sequence[str]) -> str:
    """Returns the line that refers to the Diagnosis page, which asks the questions and stores the
    answer next to the file, where this page finds it."""
    return f"{path.name}: Diagnosis asks about it first: {questions[0]}"


def make_log_overlay(log: RunLog, plane: TangentPlane, width_m: float, frame: Frame) -> OverlayFile:
    """Returns a log of any program as an overlay on a plane. `width_m` is the width of the covered
    ground for a log without a width."""
    from topdress.console.services.replay_frames import make_frames

    if not (log.has("lat_deg") and log.has("lon_deg")):
        raise ValueError(
            f"{log.path}: no places in it: allowed is a file with latitude and longitude"
        )
    worked = WorkedGround(_find_log_width_m(log, width_m))
    has = frozenset(
        layer
        for layer, columns in (
            (MapLayer.APPLIED, ("applied_rate_kg_ha",)),
            (MapLayer.TARGET, ("target_rate_kg_ha",)),
            (MapLayer.ERROR, ("applied_rate_kg_ha", "target_rate_kg_ha")),
            (MapLayer.NDVI, ("ndvi",)),
        )
        if all(log.has(column) for column in columns)
    )
    harvest = None if has else _find_harvest_column(log)
    if not has and harvest is None:
        raise ValueError(
            f"{log.path}: no rate, no NDVI and no yield in it: nothing to show on the map"
        )
    values: Iterator[float] | None = (
        None if harvest is None else iter(log.numbers(harvest[0]).tolist())
    )
    spots = []
    for one in make_frames(log.rows(), log, plane=plane):
        value = None if values is None else next(values)
        spot = make_spot(one)
        if spot is not None:
            spots.append(spot if value is None else spot._replace(ndvi=value))
    worked.add_spots(spots)
    return OverlayFile(
        log.path.name,
        worked,
        has or frozenset({MapLayer.NDVI}),
        None if harvest is None else harvest[1],
        _calc_distance_m(worked.box, frame),
    )


def find_frame_plane(frame: Frame, meta: RunMeta | None) -> TangentPlane:
    """Returns the plane of a frame's position: its job's plane if the frame's fix is on it, else
    the plane by fix and position."""
    from topdress.control.geodesy import TangentPlane, calc_plane_distance_m, offset_place

    row, place = frame.row, frame.place_m
    if place is None or row.lat_deg is None or row.lon_deg is None:
        raise ValueError("no position yet: allowed once the machine has one")
    geometry = dict((meta.machine or {}).get("geometry") or {}) if meta is not None else {}
    ahead_m = float(geometry.get("antenna_m", OUTLET_BEHIND_M))
    antenna = place if row.heading_deg is None else offset_place(place, row.heading_deg, ahead_m)
    job = find_job_plane(meta, Path(frame.log_path).parent) if meta is not None else None
    if (
        job is not None
        and calc_plane_distance_m(job.project_to_m(row.lat_deg, row.lon_deg), antenna)
        < MAX_STALE_FIX_M
    ):
        return job
    plane = TangentPlane(row.lat_deg, row.lon_deg)
    for _again in range(3):
        east, north = plane.project_to_m(row.lat_deg, row.lon_deg)
        plane = TangentPlane(*plane.convert_to_deg(east - antenna[0], north - antenna[1]))
    return plane


def _find_working_width_m(meta: RunMeta | None) -> float:
    machine = dict(meta.machine or {}) if meta is not None else {}
    return float(dict(machine.get("geometry") or {}).get("working_width_m", DEFAULT_WIDTH_M))


def _find_log_width_m(log: RunLog, otherwise_m: float) -> float:
    """Returns the log's own working width: its machine's, else the median of its column, m."""
    from topdress.drivers.files.imports.column_vocabulary import find_subject, fold_column_name
    from topdress.drivers.files.imports.table_header import split_unit_name
    from topdress.drivers.files.imports.units import find_named_unit

    for name in log.columns:
        word, unit = split_unit_name(name)
        subject = find_subject(fold_column_name(word), None)
        length = find_named_unit(unit) if unit else None
        if (
            subject is not None
            and subject.id == "working width"
            and length is not None
            and length.quantity == "length"
        ):
            width_m = float(np.nanmedian(log.numbers(name))) * length.factor / 1000.0
            if 0.1 <= width_m <= 100.0:
                return width_m
    return (
        otherwise_m if log.meta is None or not log.meta.machine else _find_working_width_m(log.meta)
    )


def _find_harvest_column(log: RunLog) -> tuple[str, HarvestColumn] | None:
    """Returns the column of the harvest; None without such a column."""
    from topdress.drivers.files.imports.column_vocabulary import HARVEST_WORDS, fold_column_name
    from topdress.drivers.files.imports.table_header import split_unit_name

    for word in HARVEST_WORDS:
        for name, values in log.columns.items():
            if word in fold_column_name(name) and values.dtype != object and log.has(name):
                label, unit = split_unit_name(name.removeprefix("x_"))
                return name, HarvestColumn(label.replace("_", " "), (unit or "").replace("_", "/"))
    return None


def _calc_distance_m(box: GroundBox | None, frame: Frame) -> float:
    """Returns the distance from the machine to the nearest side of the overlay, m."""
    if box is None or frame.place_m is None:
        return 0.0
    east, north = frame.place_m
    return hypot(
        max(box.west_m - east, east - box.east_m, 0.0),
        max(box.south_m - north, north - box.north_m, 0.0),
    )
