"""Which files a map or a log is made of, where it is more than one."""
from __future__ import annotations

from pathlib import Path

from drivers.files.archives import Folder

OF_MAPS = (".xml", ".bin", ".shp", ".shx", ".dbf", ".prj", ".cpg", ".cst", ".json", ".txt")


def files_of(path: Path) -> tuple[Path, ...]:
    """All files that reading what lies at `path` may open: those of its task or of a field of AgOpenGPS, the companions
    of a shapefile."""
    folder = path if path.is_dir() else path.parent
    if path.is_dir() or path.suffix.lower() == ".xml":
        names = Folder(folder, deep=path.is_dir()).names()
        return tuple(folder / name for name in names if Path(name).suffix.lower() in OF_MAPS)
    if path.suffix.lower() == ".shp":
        return tuple(file for file in folder.glob("*") if file.name.casefold().startswith(path.stem.casefold()))
    return (path,)
