"""What is kept next to the log, so that a job goes on after a power cut: NAME.resume.json. Read
here, written whole."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any

from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.console.worker.resume_ground import NOTHING_DONE, RasterSchema, Spot, pack_raster
from topdress.console.worker.snapshots import (
    SNAPSHOT_FORMAT,
    SNAPSHOT_SUFFIX,
    list_newest_first,
    read_mtime_ns,
)
from topdress.control.field.coverage import Raster
from topdress.control.field.totals import NO_SUMS, TotalSums
from topdress.control.orders import Strategy
from topdress.drivers.files.atomic import write_atomically
from topdress.drivers.files.limits import RESUME, check_limit

WORTHWHILE_HA = 0.001  # less done than this: nothing to go on with
# before there was a topdress: of a clock that nobody has set
EARLIEST_CLOCK = datetime(2020, 1, 1, tzinfo=UTC)
# a pass over a field takes no longer; the next dressing comes later
OPEN_DAYS = 14

Place = tuple[float, float]
Refill = tuple[str, float]  # UTC, kg


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """A job as far as it got. Moments are the worker's UTC, ISO 8601."""

    log_path: str
    began_utc: str = ""  # of the job, not of its last part
    saved_utc: str = ""
    job: str = ""  # names as the screens show them
    machine: str = ""
    crop: str = ""
    simulated: bool = False
    config: tuple[str, ...] = ()  # what the worker was started with
    seed: int = 1
    effects: tuple[str, ...] = ()
    hz: float = 20.0
    finished: bool = False  # by the operator: nothing is offered any more
    # the worker was asked to end: nothing was cut off
    quit: bool = False
    logs_before: tuple[str, ...] = ()  # the job's earlier parts, oldest first
    # flow was commanded: what the snapshot lacks is in the log
    worked: bool = False
    time_s: float = 0.0  # of the last row that is in here
    sums: TotalSums = NO_SUMS
    sums_s: float = 0.0  # of the last row that is in the sums
    held_s: float = 0.0
    moves: int = 0  # of the opening's set-point, while working
    refills: tuple[Refill, ...] = ()
    strategy: Strategy = Strategy.OPENING_FIRST
    look_ahead: bool = True
    flow_trim_on: bool = True
    origin_deg: Place | None = None  # of the plane: latitude, longitude
    place_m: Place | None = None  # the outlets' last one
    heading_deg: float | None = None
    hopper_kg: float | None = None
    ndvi_nrich: float | None = None  # strips that were measured on the way
    ndvi_check: float | None = None
    # by the machine model: released after the last row, and counted
    after_cut_kg: float = 0.0
    # the scale at the last row, from the rows before it
    cut_hopper_kg: float | None = None
    alarms: tuple[AlarmRecord, ...] = ()
    track: tuple[Spot, ...] = ()
    ground: Annotated[Raster, RasterSchema] = NOTHING_DONE

    @property
    def area_ha(self) -> float:
        """Area that the job has done, ha."""
        return self.sums.area_ha

    @property
    def is_worth_resuming(self) -> bool:
        """Whether the job is unfinished and has done anything."""
        return not self.finished and (self.worked or self.area_ha >= WORTHWHILE_HA)


REFILL_TOLERANCE_KG = 0.05  # refills are reported to 0.1 kg


def drop_last_refill(refills: tuple[Refill, ...], kg: float) -> tuple[Refill, ...]:
    """Refills without the newest of this mass, which was none."""
    for number in range(len(refills) - 1, -1, -1):
        if abs(refills[number][1] - kg) < REFILL_TOLERANCE_KG:
            return (*refills[:number], *refills[number + 1 :])
    return refills


def make_snapshot_path(log: str | Path) -> Path:
    """Path of the snapshot of a log."""
    return Path(log).with_suffix(SNAPSHOT_SUFFIX)


def write_snapshot(path: Path, snapshot: Snapshot) -> None:
    """Write a snapshot whole or not at all, the newest of its folder even where the clock was set
    back. Raises OSError."""
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
    """Read a snapshot. Raises ValueError, one line that names the file, where it is none;
    OSError."""
    return _check_snapshot(path, _read_snapshot_data(path))


_NO_SNAPSHOT = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)


def _read_snapshot_data(path: Path) -> dict[str, Any]:
    """The file's JSON object. Raises ValueError, OSError."""
    try:
        check_limit(RESUME, path.stat().st_size, str(path))
        data = json.loads(path.read_bytes())
        if not isinstance(data, dict) or data.get("format") != SNAPSHOT_FORMAT:
            raise ValueError(f"key format: allowed {SNAPSHOT_FORMAT}")
    except _NO_SNAPSHOT as error:
        raise ValueError(f"{path}: not a job that can go on: {error}") from None
    return data


def _check_snapshot(path: Path, data: dict[str, Any]) -> Snapshot:
    """The snapshot made of the file's data. Raises ValueError."""
    from topdress.drivers.files.plain import build_from_plain  # pydantic: only where a job goes on

    try:
        for name in ("began_utc", "saved_utc"):
            if data[name]:
                datetime.fromisoformat(data[name])
        return build_from_plain(Snapshot, data)
    except _NO_SNAPSHOT as error:
        raise ValueError(f"{path}: not a job that can go on: {error}") from None


def mark_finished(path: Path) -> None:
    """Mark a job as finished by its operator, where its worker is gone. Raises ValueError,
    OSError."""
    write_snapshot(path, replace(read_snapshot(path), finished=True))


def find_open_jobs(folder: Path, now: datetime) -> Iterator[tuple[Path, Snapshot]]:
    """Jobs of these logs that can go on, the newest first: not ended by their operator, something
    done, left in the last two weeks, and continued in no later log. Files that cannot be read are
    passed over."""
    gone_on: set[str] = set()
    for path in list_newest_first(folder):
        try:
            data = _read_snapshot_data(path)
            name = Path(data["log_path"]).name
            gone_on.update(Path(one).name for one in data.get("logs_before", ()))
            if name in gone_on or data.get("finished"):
                # a season of these is not unpacked at every start
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
            left < EARLIEST_CLOCK or now - left <= timedelta(days=OPEN_DAYS)
        ):
            yield path, snapshot
