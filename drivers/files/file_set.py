"""Which files a map or a log is made of, where it is more than one."""
from __future__ import annotations

from pathlib import Path


def files_of(path: Path) -> tuple[Path, ...]:
    """All files that reading what lies at `path` may open: those of its task, the companions of a shapefile."""
    folder = path if path.is_dir() else path.parent
    if path.is_dir() or path.suffix.lower() == ".xml":
        return tuple(file for file in (*folder.glob("*"), *folder.glob("*/*"))
                     if file.suffix.lower() in (".xml", ".bin") and file.is_file())
    if path.suffix.lower() == ".shp":
        return tuple(file for file in folder.glob("*") if file.stem.casefold() == path.stem.casefold())
    return (path,)
