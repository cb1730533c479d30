"""The files that jobs are gone on with, NAME.resume.json, as far as they are looked at without
what is in them."""

from __future__ import annotations

import json
from pathlib import Path

from topdress.drivers.files.limits import RESUME, held_to

FORMAT = "topdress-resume/1"
ENDING = ".resume.json"
# two weeks of a contractor's: jobs left longer ago are not gone on with
LOOKED_AT = 100


def find_saved_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def list_newest_first(folder: Path) -> list[Path]:
    """The snapshots of a folder, as many as are looked at."""
    return sorted(folder.glob(f"*{ENDING}"), key=find_saved_ns, reverse=True)[:LOOKED_AT]


def may_go_on(folder: Path) -> bool:
    """False where every job was ended by its operator, or none was worked. Quick;
    `resume.find_open_jobs` says which go on indeed."""
    for path in list_newest_first(folder):
        try:
            held_to(RESUME, path.stat().st_size, str(path))
            data = json.loads(path.read_bytes())
        except (ValueError, OSError, RecursionError):
            continue
        if isinstance(data, dict) and data.get("format") == FORMAT and not data.get("finished"):
            return True
    return False
