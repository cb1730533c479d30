"""Which files does a folder or a zip hold, by their names, without those that operating systems
put next to them?"""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

from topdress.drivers.files.limits import DAMAGED_ZIP, SHAPES, held_to
from topdress.drivers.plain_text import RefusedInput

# Folders within folders that are searched.
DEEPEST = 4
# Suffixes of files that a map or a field may consist of.
OF_MAPS = (".xml", ".bin", ".shp", ".shx", ".dbf", ".prj", ".cpg", ".cst", ".json", ".txt")
# Folders that macOS and Windows add.
HIDDEN = ("__macosx", "$recycle.bin", "system volume information")


@dataclass(frozen=True)
class Folder:
    """Reads the files of a folder. Names are paths with slashes, from the top."""

    path: Path
    deep: bool = True  # False: the folder's own files only

    # Returns the names of all files, sorted.
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
        """Returns the bytes of a file. Raises Refused, OSError."""
        file = self.path / name
        held_to(SHAPES, file.stat().st_size, file)
        return file.read_bytes()

    def label(self, name: str) -> str:
        """Returns a file's name for messages."""
        return str(self.path / name)


@dataclass(frozen=True)
class Zip:
    """Reads the files of a zip. Its directory is read once, however many files are read."""

    path: Path

    @cached_property
    def _archive(self) -> zipfile.ZipFile:
        try:
            return zipfile.ZipFile(self.path)
        except DAMAGED_ZIP as error:
            raise RefusedInput(self.path, "not readable as a zip: {why}", why=error) from None

    # Returns the names of all files, sorted.
    @cached_property
    def names(self) -> list[str]:
        found = [
            info.filename
            for info in self._archive.infolist()
            if info.filename and not info.is_dir()
        ]
        return sorted(name for name in found if _counts(name))

    # Returns the bytes of a file. Raises Refused, OSError.
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
    """Returns a zip, else a folder."""
    return Zip(path) if path.suffix.lower() == ".zip" and path.is_file() else Folder(path)


def holds_time_log(files: Files) -> bool:
    """Tells whether a task that was worked is in it."""
    names = (PurePosixPath(name).name.lower() for name in files.names)
    return any(name.startswith("tlg") and name.endswith(".bin") for name in names)


def parent(name: str) -> str:
    """Returns the folder of a name, with its slash; empty: the top."""
    folder = PurePosixPath(name).parent.as_posix()
    return "" if folder == "." else f"{folder}/"


def chosen(found: list[str], inside: str) -> list[str]:
    """Returns the names that are, end in, or hold as a folder what was chosen, in either case of
    letters."""
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
    """Tells whether a file is neither macOS's nor Windows's own."""
    parts = name.replace("\\", "/").split("/")
    # macOS keeps attributes in files of this name.
    return not any(part.lower() in HIDDEN or part.startswith("._") for part in parts)


def files_of(path: Path) -> tuple[Path, ...]:
    """Returns all files that a reader of `path` may open: those of its task or of a field of
    AgOpenGPS, and the companions of a shapefile."""
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
