"""The files that jobs are gone on with, NAME.resume.json, as far as they are looked at without what is in them."""
from __future__ import annotations

import json
from pathlib import Path

from drivers.files.limits import RESUME, held_to

FORMAT = "topdress-resume/1"
ENDING = ".resume.json"


def saved_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def newest_first(folder: Path) -> list[Path]:
    """All snapshots of a folder."""
    return sorted(folder.glob(f"*{ENDING}"), key=saved_ns, reverse=True)


def may_go_on(folder: Path) -> bool:
    """False where no job was cut off: none is there, or the newest was ended by its operator. Quick; `resume.newest`
    says whether there is one indeed."""
    for path in newest_first(folder):
        try:
            held_to(RESUME, path.stat().st_size, str(path))
            data = json.loads(path.read_bytes())
        except (ValueError, OSError, RecursionError):
            continue
        if isinstance(data, dict) and data.get("format") == FORMAT:
            return not (data.get("quit") or data.get("finished"))
    return False
