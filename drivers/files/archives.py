"""The files of a folder or a zip, by their names, without what operating systems put next to
them."""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

from topdress.drivers.files.limits import DAMAGED_ZIP, SHAPES, held_to
from topdress.drivers.plain_text import RefusedInput

DEEPEST = 4  # folders in one another that are looked into
OF_MAPS = (".xml", ".bin", ".shp", ".shx", ".dbf", ".prj", ".cpg", ".cst", ".json", ".txt")
HIDDEN = ("__macosx", "$recycle.bin", "system volume information")


@dataclass(frozen=True)
class Folder:
    """Names are paths with slashes, from the top."""

    path: Path
    deep: bool = True  # False: the folder's own files only

    @cached_property
    def names(self) -> list[str]:
        found = []
        for folder, folders, files in os.walk(self.path):
            place = Path(folder).relative_to(self.path)
            if not self.deep or len(place.parts) >= DEEPEST:
                folders.clear()
            found += [(place / file).as_posix() for file in files]
        return sorted(name for name in found if _counts(name))

    def read(self, name: str) -> bytes:
        """Raises Refused, OSError."""
        file = self.path / name
        held_to(SHAPES, file.stat().st_size, file)
        return file.read_bytes()

    def label(self, name: str) -> str:
        """For messages."""
        return str(self.path / name)


@dataclass(frozen=True)
class Zip:
    """Its directory is read once, however many of its files are."""

    path: Path

    @cached_property
    def _archive(self) -> zipfile.ZipFile:
        try:
            return zipfile.ZipFile(self.path)
        except DAMAGED_ZIP as error:
            raise RefusedInput(self.path, "not readable as a zip: {why}", why=error) from None

    @cached_property
    def names(self) -> list[str]:
        found = [
            info.filename
            for info in self._archive.infolist()
            if info.filename and not info.is_dir()
        ]
        return sorted(name for name in found if _counts(name))

    def read(self, name: str) -> bytes:
        try:
            held_to(SHAPES, self._archive.getinfo(name).file_size, self.label(name))
            return self._archive.read(name)
        except DAMAGED_ZIP as error:
            raise RefusedInput(self.label(name), "not readable: {why}", why=error) from None

    def label(self, name: str) -> str:
        return f"{self.path}/{name}"


Files = Folder | Zip


def files_at(path: Path) -> Files:
    """Of a zip, else of a folder."""
    return Zip(path) if path.suffix.lower() == ".zip" and path.is_file() else Folder(path)


def holds_time_log(files: Files) -> bool:
    """Whether a task that was worked is in it."""
    names = (PurePosixPath(name).name.lower() for name in files.names)
    return any(name.startswith("tlg") and name.endswith(".bin") for name in names)


def parent(name: str) -> str:
    """The folder of a name, with its slash; empty: the top."""
    folder = PurePosixPath(name).parent.as_posix()
    return "" if folder == "." else f"{folder}/"


def chosen(found: list[str], inside: str) -> list[str]:
    """Those names that are, or end in, or hold as a folder, what was asked for, letters of
    either case."""
    wanted = inside.casefold().strip("/")
    return [
        name
        for name in found
        if (plain := name.casefold()) == wanted
        or plain.endswith(f"/{wanted}")
        or PurePosixPath(plain).stem == wanted
        or plain.startswith(f"{wanted}/")
        or f"/{wanted}/" in f"/{plain}"
    ]


def _counts(name: str) -> bool:
    """Not what a Macintosh or Windows leaves in every folder."""
    parts = name.replace("\\", "/").split("/")
    return not any(part.lower() in HIDDEN or part.startswith("._") for part in parts)


def files_of(path: Path) -> tuple[Path, ...]:
    """All files that reading what lies at `path` may open: those of its task or of a field of
    AgOpenGPS, the companions of a shapefile."""
    folder = path if path.is_dir() else path.parent
    if path.is_dir() or path.suffix.lower() == ".xml":
        names = Folder(folder, deep=path.is_dir()).names
        return tuple(folder / name for name in names if Path(name).suffix.lower() in OF_MAPS)
    if path.suffix.lower() == ".shp":
        return tuple(
            file
            for file in folder.glob("*")
            if file.name.casefold().startswith(path.stem.casefold())
        )
    return (path,)
