"""The A-B line and a boundary that is being driven, as records of a file next to the log: a
console that dies, or is closed, leaves them to the next one. Pure.

A record is a line of JSON. The file only grows: what was said last holds, and a line that was
cut off counts for nothing.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, NamedTuple

from topdress.console.app.boundary_drive import BoundaryDrive, Corner
from topdress.console.app.guide_line import GuideLine, Place


class KeptLines(NamedTuple):
    """Holds the lines of a log.

    drive None: no boundary is being driven. way: of the drive, east and north, m, as the map draws
    it. until_s: the log's time of its last record. changed: the line was set or taken away here.
    of_day: when the job began, by its log, whose line this is on the same field; "": of this job
    itself.
    """

    guide: GuideLine
    drive: BoundaryDrive | None = None
    way: tuple[Place, ...] = ()
    until_s: float = 0.0
    changed: bool = False
    of_day: str = ""


def make_line_record(guide: GuideLine) -> str:
    """A record of the line as it is now, also of one that was taken away."""
    return json.dumps(
        {
            "guide": None
            if guide.a is None
            else {"a": guide.a, "b": guide.b, "width_m": guide.width_m}
        }
    )


def make_drive_record(drive: BoundaryDrive | None, time_s: float) -> str:
    """A record of a drive that begins; None: it has ended, kept or cancelled."""
    return json.dumps(
        {"drive": None if drive is None else {"right_m": drive.right_m, "time_s": time_s}}
    )


def make_corner_record(corner: Corner, place: Place, time_s: float) -> str:
    """A record of a corner of the drive."""
    return json.dumps({"corner": corner, "place_m": place, "time_s": time_s})


def read_kept_lines(records: Iterable[str]) -> KeptLines:
    """The lines after these records; damaged records are left out."""
    kept = KeptLines(GuideLine())
    for record in records:
        try:
            kept = _apply_record(kept, json.loads(record))
        except (ValueError, TypeError, KeyError):
            continue
    return kept


def _apply_record(kept: KeptLines, said: dict[str, Any]) -> KeptLines:
    """Raises ValueError, TypeError, KeyError."""
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
        if drive is None:
            return KeptLines(kept.guide, changed=kept.changed)
        return KeptLines(
            kept.guide,
            BoundaryDrive(float(drive["right_m"])),
            (),
            float(drive["time_s"]),
            kept.changed,
        )
    if kept.drive is None:
        return kept
    corner, place, time_s = (
        Corner(*map(float, said["corner"])),
        _parse_place(said["place_m"]),
        float(said["time_s"]),
    )
    kept.drive.add_corner(corner)
    return kept._replace(way=(*kept.way, place), until_s=time_s)


def _parse_place(record: Any) -> Place:
    east_m, north_m = record
    return float(east_m), float(north_m)
