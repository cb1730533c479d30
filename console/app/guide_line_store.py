"""Converts the A-B line and a boundary in progress to records of a file next to the log, so that
the next console continues with them. Pure.

A record is a line of JSON. The file only grows: the last record of a kind is valid, and a truncated
line is ignored.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, NamedTuple

from topdress.console.app.boundary_drive import BoundaryDrive, Corner
from topdress.console.app.guide_line import GuideLine, Place


class StoredLines(NamedTuple):
    """Holds the stored lines of a log.

    Attributes
    ----------
    guide
        A-B line.
    drive
        Boundary in progress; None without a boundary drive.
    way
        Way of the drive for the map; east and north, m.
    until_s
        Log time of the last record of the drive, s.
    changed
        True if the line was set or removed in this log.
    of_day
        Start of the earlier job on this field from which the line comes; "" for a line of this job.
    """

    guide: GuideLine
    drive: BoundaryDrive | None = None
    way: tuple[Place, ...] = ()
    until_s: float = 0.0
    changed: bool = False
    of_day: str = ""


def make_line_record(guide: GuideLine) -> str:
    """Return a record of the present line; a removed line is recorded too."""
    return json.dumps(
        {
            # JSON's null records a removed line.
            "guide": None
            if guide.a is None
            else {"a": guide.a, "b": guide.b, "width_m": guide.width_m}
        }
    )


def make_drive_record(drive: BoundaryDrive | None, time_s: float) -> str:
    """Return a record of a drive that begins; None records the end of the drive."""
    return json.dumps(
        {"drive": None if drive is None else {"right_m": drive.right_m, "time_s": time_s}}
    )


def make_corner_record(corner: Corner, place: Place, time_s: float) -> str:
    """Return a record of a corner of the drive."""
    return json.dumps({"corner": corner, "place_m": place, "time_s": time_s})


def read_kept_lines(records: Iterable[str]) -> StoredLines:
    """Return the lines that result from records; damaged records are ignored."""
    # Records are applied in the order of the file.
    kept = StoredLines(GuideLine())
    for record in records:
        try:
            kept = _apply_record(kept, json.loads(record))
        except (ValueError, TypeError, KeyError):
            continue
    return kept


def _apply_record(kept: StoredLines, said: dict[str, Any]) -> StoredLines:
    """Apply one record to the lines. Raises ValueError, TypeError or KeyError for a damaged
    record."""
    # The key of a record is its kind.
    if "guide" in said:
        line = said["guide"]
        guide = (
            GuideLine()
            if line is None
            else GuideLine(
                _parse_place(line["a"]),
                None if line["b"] is None else _parse_place(line["b"]),
                float(line["width_m"]),
            )
        )
        return kept._replace(guide=guide, changed=True)
    if "drive" in said:
        drive = said["drive"]
        # The end of a drive also removes its way.
        if drive is None:
            return StoredLines(kept.guide, changed=kept.changed)
        return StoredLines(
            kept.guide,
            BoundaryDrive(float(drive["right_m"])),
            (),
            float(drive["time_s"]),
            kept.changed,
        )
    # A corner without a drive belongs to a drive whose first record is damaged.
    if kept.drive is None:
        return kept
    corner, place, time_s = (
        Corner(*map(float, said["corner"])),
        _parse_place(said["place_m"]),
        float(said["time_s"]),
    )
    # The drive itself checks the distance, so a repeated record is harmless.
    kept.drive.add_corner(corner)
    return kept._replace(way=(*kept.way, place), until_s=time_s)


def _parse_place(record: Any) -> Place:
    east_m, north_m = record
    return float(east_m), float(north_m)
