"""Reads and writes the snapshot next to the log, NAME.resume.json, from which a job is resumed
after a power cut.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any

from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.console.worker.resume_ground import EMPTY_RASTER, RasterSchema, Spot, pack_raster
from topdress.console.worker.snapshots import (
    SNAPSHOT_FORMAT,
    SNAPSHOT_SUFFIX,
    list_newest_first,
    read_mtime_ns,
)
from topdress.control.field.coverage import Raster
from topdress.control.field.job_totals import NO_SUMS, TotalSums
from topdress.control.orders import Strategy
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.limits import RESUME_LIMIT, check_limit

# A job that has done less, ha, is not worth resuming.
MIN_RESUMABLE_HA = 0.001
# Earlier times come from a clock that nobody has set: this program did not exist then.
EARLIEST_PLAUSIBLE_UTC = datetime(2020, 1, 1, tzinfo=UTC)
# A pass over a field takes less than this, days, and the next dressing comes later.
MAX_OPEN_DAYS = 14

Place = tuple[float, float]
# UTC of the refill, and mass in kg.
Refill = tuple[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Holds the progress of a job. Times are the worker's UTC, ISO 8601."""

    log_path: str
    # Start of the job, not of its last part.
    began_utc: str = ""
    saved_utc: str = ""
    # Names as displayed on the screens.
    job: str = ""
    machine: str = ""
    crop: str = ""
    simulated: bool = False
    # Configuration files of the worker.
    config: tuple[str, ...] = ()
    seed: int = 1
    effects: tuple[str, ...] = ()
    hz: float = 20.0
    # True if the operator has ended the job: it is not offered again.
    finished: bool = False
    # True if the worker was asked to end, so that nothing was interrupted.
    quit: bool = False
    # Earlier parts of the job, oldest first.
    logs_before: tuple[str, ...] = ()
    # True once flow was commanded: what the snapshot lacks is in the log.
    worked: bool = False
    # Time of the last row in this snapshot, s.
    time_s: float = 0.0
    sums: TotalSums = NO_SUMS
    # Time of the last row in the sums, s.
    sums_s: float = 0.0
    held_s: float = 0.0
    # Changes of the opening's set-point while working.
    moves: int = 0
    refills: tuple[Refill, ...] = ()
    strategy: Strategy = Strategy.OPENING_FIRST
    look_ahead: bool = True
    flow_trim_on: bool = True
    # Latitude and longitude of the plane's origin.
    origin_deg: Place | None = None
    # Last position of the outlets, m.
    place_m: Place | None = None
    heading_deg: float | None = None
    hopper_kg: float | None = None
    # NDVI of strips that were measured during the job.
    ndvi_nrich: float | None = None
    ndvi_check: float | None = None
    # Mass released after the last row by the machine model, kg; it is included in the sums.
    after_cut_kg: float = 0.0
    # Reading of the scale at the last row, kg, estimated from the rows before.
    cut_hopper_kg: float | None = None
    alarms: tuple[AlarmRecord, ...] = ()
    track: tuple[Spot, ...] = ()
    ground: Annotated[Raster, RasterSchema] = EMPTY_RASTER

    @property
    def area_ha(self) -> float:
        """Area that the job has done, ha."""
        return self.sums.area_ha

    @property
    def is_worth_resuming(self) -> bool:
        """Whether the job is unfinished and has done anything."""
        return not self.finished and (self.worked or self.area_ha >= MIN_RESUMABLE_HA)


# Tolerance when a refill is identified by its mass, kg: refills are reported to 0.1 kg.
REFILL_TOLERANCE_KG = 0.05


def drop_last_refill(refills: tuple[Refill, ...], kg: float) -> tuple[Refill, ...]:
    """Return the refills without the newest refill of this mass, which was undone."""
    for number in range(len(refills) - 1, -1, -1):
        if abs(refills[number][1] - kg) < REFILL_TOLERANCE_KG:
            return (*refills[:number], *refills[number + 1 :])
    return refills


def make_snapshot_path(log: str | Path) -> Path:
    """Return the path of a log's snapshot."""
    return Path(log).with_suffix(SNAPSHOT_SUFFIX)


def write_snapshot(path: Path, snapshot: Snapshot) -> None:
    """Write a snapshot completely or not at all. Raises OSError.

    The file becomes the newest of its folder even if the clock was set back, because jobs are
    listed by the time of their files.
    """
    own = {name: getattr(snapshot, name) for name in Snapshot.__dataclass_fields__}
    own |= {
        "sums": snapshot.sums._asdict(),
        "alarms": [record._asdict() for record in snapshot.alarms],
        "ground": pack_raster(snapshot.ground),
    }
    write_atomically(
        path, json.dumps({"format": SNAPSHOT_FORMAT} | own, separators=(",", ":")) + "\n"
    )
    others = max(
        (read_mtime_ns(one) for one in path.parent.glob(f"*{SNAPSHOT_SUFFIX}") if one != path),
        default=0,
    )
    if others >= read_mtime_ns(path):
        os.utime(path, ns=(others + 1_000_000, others + 1_000_000))


def read_snapshot(path: Path) -> Snapshot:
    """Read a snapshot. Raises ValueError with one line that names the file, or OSError."""
    return _check_snapshot(path, _read_snapshot_data(path))


# Errors of a file that is no snapshot or is damaged.
_NO_SNAPSHOT = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)


def _read_snapshot_data(path: Path) -> dict[str, Any]:
    """Return the JSON object of a file. Raises ValueError or OSError."""
    try:
        # The size is checked before reading: a wrong file may be huge.
        check_limit(RESUME_LIMIT, path.stat().st_size, str(path))
        data = json.loads(path.read_bytes())
        if not isinstance(data, dict) or data.get("format") != SNAPSHOT_FORMAT:
            raise ValueError(f"key format: allowed {SNAPSHOT_FORMAT}")
    except _NO_SNAPSHOT as error:
        raise ValueError(f"{path}: not a job that can go on: {error}") from None
    return data


def _check_snapshot(path: Path, data: dict[str, Any]) -> Snapshot:
    """Return the snapshot of a file's data. Raises ValueError."""
    from topdress.drivers.files.plain_data import (
        build_from_plain,  # pydantic: only where a job goes on
    )

    try:
        for name in ("began_utc", "saved_utc"):
            if data[name]:
                datetime.fromisoformat(data[name])
        return build_from_plain(Snapshot, data)
    except _NO_SNAPSHOT as error:
        raise ValueError(f"{path}: not a job that can go on: {error}") from None


def mark_finished(path: Path) -> None:
    """Mark a job as ended by its operator, after its worker has ended. Raises ValueError or
    OSError."""
    write_snapshot(path, replace(read_snapshot(path), finished=True))


def find_open_jobs(folder: Path, now: datetime) -> Iterator[tuple[Path, Snapshot]]:
    """Yield the jobs of a folder that can be resumed, newest first.

    Such a job was not ended by its operator, has done something, was left within two weeks, and no
    later log continues it. Unreadable files are skipped.
    """
    gone_on: set[str] = set()
    for path in list_newest_first(folder):
        try:
            data = _read_snapshot_data(path)
            name = Path(data["log_path"]).name
            gone_on.update(Path(one).name for one in data.get("logs_before", ()))
            if name in gone_on or data.get("finished"):
                # Snapshots of a whole season are not unpacked at every start.
                continue
            snapshot = _check_snapshot(path, data)
            left = (
                datetime.fromisoformat(snapshot.saved_utc).astimezone(UTC)
                if snapshot.saved_utc
                else now
            )
        except (OSError, *_NO_SNAPSHOT):
            continue
        if snapshot.is_worth_resuming and (
            # A clock that was never set gives no age, so such a job is offered.
            left < EARLIEST_PLAUSIBLE_UTC or now - left <= timedelta(days=MAX_OPEN_DAYS)
        ):
            yield path, snapshot
