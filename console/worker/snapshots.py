"""Lists the snapshots of jobs, NAME.resume.json, without reading their contents completely."""

from __future__ import annotations

import json
from pathlib import Path

from topdress.drivers.files.limits import RESUME_LIMIT, check_limit

SNAPSHOT_FORMAT = "topdress-resume/1"
SNAPSHOT_SUFFIX = ".resume.json"
# Two weeks of a contractor's jobs; older jobs are not resumed.
MAX_SNAPSHOTS = 100


def read_mtime_ns(path: Path) -> int:
    """Return the time of a file's last change, ns; 0 where unreadable."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def list_newest_first(folder: Path) -> list[Path]:
    """Return the newest `MAX_SNAPSHOTS` snapshots of a folder, newest first."""
    return sorted(folder.glob(f"*{SNAPSHOT_SUFFIX}"), key=read_mtime_ns, reverse=True)[
        :MAX_SNAPSHOTS
    ]


def may_have_open_job(folder: Path) -> bool:
    """Return whether any job may be resumable: False if each was ended by its operator, or none was
    worked.

    This check is quick; `resume.find_open_jobs` reads which jobs are resumable.
    """
    for path in list_newest_first(folder):
        try:
            check_limit(RESUME_LIMIT, path.stat().st_size, str(path))
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
