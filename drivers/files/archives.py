"""Which files does a folder or a zip contain? The answer omits the files that operating systems
add.
"""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

from topdress.drivers.files.limits import DAMAGED_ZIP, SHAPEFILE_LIMIT, check_limit
from topdress.drivers.plain_text import RefusedInput

# Depth of folders within folders that are searched.
MAX_FOLDER_DEPTH = 4
# Suffixes of the files that a map or a field may consist of.
MAP_SUFFIXES = (".xml", ".bin", ".shp", ".shx", ".dbf", ".prj", ".cpg", ".cst", ".json", ".txt")
# Folders that macOS and Windows add to a disk or zip.
HIDDEN_FOLDERS = ("__macosx", "$recycle.bin", "system volume information")


@dataclass(frozen=True)
class Folder:
    """Reads the files of a folder. Names are paths with slashes, relative to the folder."""

    path: Path
    # False restricts the search to the folder's own files.
    deep: bool = True

    # The names are sorted, so that the first match does not depend on the disk.
    @cached_property
    def names(self) -> list[str]:
        """Names of all files, sorted."""
        found = []
        for folder, folders, files in os.walk(self.path):
            place = Path(folder).relative_to(self.path)
            if not self.deep or len(place.parts) >= MAX_FOLDER_DEPTH:
                folders.clear()
            found += [(place / file).as_posix() for file in files]
        return sorted(name for name in found if _is_listed_file(name))

    def read(self, name: str) -> bytes:
        """Returns the bytes of a file. Raises RefusedInput, OSError."""
        file = self.path / name
        check_limit(SHAPEFILE_LIMIT, file.stat().st_size, file)
        return file.read_bytes()

    def label(self, name: str) -> str:
        """Returns the name of a file for messages."""
        return str(self.path / name)


@dataclass(frozen=True)
class ZipArchive:
    """Reads the files of a zip. Its directory is read once, however many files are read."""

    path: Path

    @cached_property
    def _archive(self) -> zipfile.ZipFile:
        try:
            return zipfile.ZipFile(self.path)
        except DAMAGED_ZIP as error:
            raise RefusedInput(self.path, "not readable as a zip: {why}", why=error) from None

    # The names are sorted, so that the first match does not depend on the zip.
    @cached_property
    def names(self) -> list[str]:
        """Names of all files, sorted."""
        found = [
            info.filename
            for info in self._archive.infolist()
            if info.filename and not info.is_dir()
        ]
        return sorted(name for name in found if _is_listed_file(name))

    def read(self, name: str) -> bytes:
        """Returns the bytes of a file. Raises RefusedInput, OSError."""
        try:
            check_limit(SHAPEFILE_LIMIT, self._archive.getinfo(name).file_size, self.label(name))
            return self._archive.read(name)
        except DAMAGED_ZIP as error:
            raise RefusedInput(self.label(name), "not readable: {why}", why=error) from None

    def label(self, name: str) -> str:
        """Returns the name of a file in the zip for messages."""
        return f"{self.path}/{name}"


ArchiveFiles = Folder | ZipArchive


def open_archive(path: Path) -> ArchiveFiles:
    """Returns a reader for a zip or a folder."""
    return ZipArchive(path) if path.suffix.lower() == ".zip" and path.is_file() else Folder(path)


def has_time_log(files: ArchiveFiles) -> bool:
    """Returns whether the files include the time log of a task that was worked."""
    names = (PurePosixPath(name).name.lower() for name in files.names)
    return any(name.startswith("tlg") and name.endswith(".bin") for name in names)


def find_parent_folder(name: str) -> str:
    """Returns the folder of a name, with its slash; empty for a name at the top."""
    folder = PurePosixPath(name).parent.as_posix()
    return "" if folder == "." else f"{folder}/"


def choose_names(found: list[str], inside: str) -> list[str]:
    """Returns the names that equal, end in, or contain as a folder the text `inside`, regardless of
    case."""
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


def _is_listed_file(name: str) -> bool:
    """Returns whether a file was not added by macOS or Windows."""
    # Zips made on Windows may contain backslashes.
    parts = name.replace("\\", "/").split("/")
    # macOS stores attributes in files with this prefix.
    return not any(part.lower() in HIDDEN_FOLDERS or part.startswith("._") for part in parts)


def list_opened_files(path: Path) -> tuple[Path, ...]:
    """Returns all files that a reader of `path` may open: the files of its task or of a field of
    AgOpenGPS, and the companions of a shapefile."""
    folder = path if path.is_dir() else path.parent
    if path.is_dir() or path.suffix.lower() == ".xml":
        names = Folder(folder, deep=path.is_dir()).names
        return tuple(folder / name for name in names if Path(name).suffix.lower() in MAP_SUFFIXES)
    if path.suffix.lower() == ".shp":
        return tuple(
            file
            for file in folder.glob("*")
            if file.name.casefold().startswith(path.stem.casefold())
        )
    return (path,)
