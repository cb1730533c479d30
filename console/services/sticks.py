"""Where prescriptions lie: on sticks, among downloads, in the user's own folder. Looked at, never searched deep."""
from __future__ import annotations

import contextlib
import datetime as dt
import os
import string
import sys
from collections.abc import Iterator
from pathlib import Path

from console.app.pages.job.desk import MapFile

ENDINGS = (".shp", ".geojson", ".json", ".zip")
TASK = "taskdata.xml"
DEEP = 3                    # folders below a stick: TASKDATA, or farm / field / map
MOST_FILES = 60
MOST_LOOKED_AT = 3000       # entries of one place: a stick full of pictures must not hold the list up


def places(own: Path) -> tuple[tuple[Path, str], ...]:
    """Folders to look into, and what an operator calls them."""
    found: list[tuple[Path, str]] = []
    if sys.platform == "win32":
        found += [(Path(f"{letter}:/"), f"{letter}:") for letter in string.ascii_uppercase[3:]]
    else:
        user = os.environ.get("USER", "")
        for base in (Path("/media") / user, Path("/run/media") / user, Path("/Volumes"), Path("/mnt")):
            with contextlib.suppress(OSError):
                found += [(one, one.name) for one in sorted(base.iterdir()) if one.is_dir()]
    found += [(Path.home() / "Downloads", "Downloads"), (own / "maps", "topdress"),
              (Path.cwd(), Path.cwd().name or ".")]
    return tuple((path, name) for path, name in found if path.is_dir())


def maps_in(looked_at: tuple[tuple[Path, str], ...]) -> tuple[MapFile, ...]:
    """The newest first; what cannot be read is left out."""
    found: dict[Path, tuple[float, str]] = {}
    for folder, name in looked_at:
        for path in _maps(folder):
            with contextlib.suppress(OSError):
                found.setdefault(path.resolve(), (path.stat().st_mtime, name))
    listed = sorted(found.items(), key=lambda one: -one[1][0])[:MOST_FILES]
    return tuple(MapFile(str(path), path.name, where, dt.datetime.fromtimestamp(changed).strftime("%Y-%m-%d %H:%M"))
                 for path, (changed, where) in listed)


def _maps(folder: Path) -> Iterator[Path]:
    looked, waiting = 0, [(folder, 0)]
    while waiting:
        here, depth = waiting.pop(0)
        try:
            entries = sorted(here.iterdir())
        except OSError:
            continue
        if any(one.name.lower() == TASK for one in entries):
            yield here                      # a task is its folder
            continue
        for one in entries:
            looked += 1
            if looked > MOST_LOOKED_AT:
                return
            if one.name.startswith("."):
                continue
            if one.is_dir():
                if depth < DEEP:
                    waiting.append((one, depth + 1))
            elif one.suffix.lower() in ENDINGS:
                yield one
