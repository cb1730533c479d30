"""The files that jobs are gone on with, NAME.resume.json, as far as they are looked at without
what is in them."""

from __future__ import annotations

import json
from pathlib import Path

from topdress.drivers.files.limits import RESUME, check_limit

SNAPSHOT_FORMAT = "topdress-resume/1"
SNAPSHOT_SUFFIX = ".resume.json"
# two weeks of a contractor's: jobs left longer ago are not gone on with
MOST_SNAPSHOTS = 100


def read_mtime_ns(path: Path) -> int:
    """Time of the file's last change, ns; 0 where it cannot be read."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def list_newest_first(folder: Path) -> list[Path]:
    """The snapshots of a folder, the newest `MOST_SNAPSHOTS`."""
    return sorted(folder.glob(f"*{SNAPSHOT_SUFFIX}"), key=read_mtime_ns, reverse=True)[
        :MOST_SNAPSHOTS
    ]


def may_have_open_job(folder: Path) -> bool:
    """Whether a job may go on: false where each was ended by its operator, or none was worked.

    Quick; `resume.find_open_jobs` reads which go on indeed.
    """
    for path in list_newest_first(folder):
        try:
            check_limit(RESUME, path.stat().st_size, str(path))
            data = json.loads(path.read_bytes())
        except (ValueError, OSError, RecursionError):
            continue
        if (
            isinstance(data, dict)
            and data.get("format") == SNAPSHOT_FORMAT
            and not data.get("finished")
        ):
            return True
    return False
