"""Where are prescriptions? USB sticks, downloads and the user's own folder are searched, but not
deeply.
"""

from __future__ import annotations

import contextlib
import os
import string
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

from topdress.console.app.pages.job.service import MapFile
from topdress.drivers import day_clock
from topdress.drivers.files.formats.registry import find_format

# Number of bytes by which a configuration file is recognised.
SNIFFED_BYTES = 4096
TASK_FILE = "taskdata.xml"
# Depth of folders below a stick: TASKDATA, or farm / field / map.
MAX_FOLDER_DEPTH = 3
MAX_LISTED_MAPS = 60
# Number of entries of one place, so that a stick full of pictures does not delay the list.
MAX_ENTRIES = 3000


def list_places() -> tuple[tuple[Path, str], ...]:
    """Returns the folders to search, with the operator's names for them."""
    found: list[tuple[Path, str]] = []
    if sys.platform == "win32":
        found += [(Path(f"{letter}:/"), f"{letter}:") for letter in string.ascii_uppercase[3:]]
    else:
        user = os.environ.get("USER", "")
        for base in (
            Path("/media") / user,
            Path("/run/media") / user,
            Path("/Volumes"),
            Path("/mnt"),
        ):
            with contextlib.suppress(OSError):
                found += [(one, one.name) for one in sorted(base.iterdir()) if one.is_dir()]
    found += [(Path.home() / "Downloads", "Downloads"), (Path.cwd(), Path.cwd().name or ".")]
    return tuple((path, name) for path, name in found if path.is_dir())


def find_maps(looked_at: tuple[tuple[Path, str], ...]) -> tuple[MapFile, ...]:
    """Returns the maps of these folders, the newest first; unreadable files are omitted."""
    found: dict[Path, tuple[float, str]] = {}
    for folder, name in looked_at:
        for path in _iterate_maps(folder):
            with contextlib.suppress(OSError):
                found.setdefault(path.resolve(), (path.stat().st_mtime, name))
    listed = sorted(found.items(), key=lambda one: -one[1][0])[:MAX_LISTED_MAPS]
    return tuple(
        MapFile(str(path), path.name, where, day_clock.format_file_time(changed))
        for path, (changed, where) in listed
    )


def _iterate_maps(folder: Path) -> Iterator[Path]:
    looked, waiting = 0, [(folder, 0)]
    while waiting:
        here, depth = waiting.pop(0)
        try:
            entries = sorted(here.iterdir())
        except OSError:
            continue
        if any(one.name.lower() == TASK_FILE for one in entries):
            # A task is represented by its folder.
            yield here
            continue
        for one in entries:
            looked += 1
            if looked > MAX_ENTRIES:
                return
            if one.name.startswith("."):
                continue
            if one.is_dir():
                if depth < MAX_FOLDER_DEPTH:
                    waiting.append((one, depth + 1))
            elif is_map_likely(one):
                yield one


def is_map_likely(path: Path) -> bool:
    """Returns whether a file may be a map, as its format says; lists of settings, logs and archives
    of pictures are excluded."""
    try:
        if path.suffix.lower() == ".zip":
            with zipfile.ZipFile(path) as archive:
                names = [name.lower() for name in archive.namelist()[:MAX_ENTRIES]]
            return any(name.endswith((".shp", TASK_FILE)) for name in names)
        found = find_format(path, "read_map")
        return found is not None and found.is_map_likely(path)
    except (OSError, ValueError, zipfile.BadZipFile):
        return False


def make_kind_test(kind: str) -> Callable[[Path], bool]:
    """Returns a test by suffix and first bytes: for a map, or for a job, crop or machine file."""
    if kind == "map":
        return is_map_likely

    def is_configuration(path: Path) -> bool:
        if path.suffix.lower() not in (".yaml", ".yml"):
            return False
        with path.open("rb") as file:
            return f"topdress-{kind}/".encode() in file.read(SNIFFED_BYTES)

    return is_configuration


def list_entries(folder: Path, kind: str = "map") -> tuple[MapFile, ...]:
    """Returns the entries of one folder: the parent folder, folders, and files of a kind by name.
    Raises OSError."""
    wanted = make_kind_test(kind)
    found = [MapFile(str(folder.parent), "..", "", "")] if folder.parent != folder else []
    here = sorted(
        (one for one in folder.iterdir() if not one.name.startswith(".")),
        key=lambda one: one.name.lower(),
    )
    if kind == "map" and any(one.name.lower() == TASK_FILE for one in here):
        found.append(MapFile(str(folder), folder.name, folder.name, _format_changed(folder)))
    for one in here[:MAX_ENTRIES]:
        with contextlib.suppress(OSError):
            if one.is_dir():
                found.append(MapFile(str(one), f"{one.name}/", "", ""))
    for one in here[:MAX_ENTRIES]:
        with contextlib.suppress(OSError):
            if one.is_file() and wanted(one):
                found.append(MapFile(str(one), one.name, folder.name, _format_changed(one)))
    return tuple(found)


def _format_changed(path: Path) -> str:
    return day_clock.format_file_time(path.stat().st_mtime)
