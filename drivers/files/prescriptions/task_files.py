"""The files of an ISO 11783-10 data transfer: in a folder or a zip, whatever the case of their names."""
from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Protocol
from xml.etree import ElementTree

from drivers.files.limits import REFERENCES, held_to
from drivers.files.prescriptions.words import PrescriptionError

LARGEST_BYTES = 512 << 20


class TaskFiles(Protocol):
    @property
    def label(self) -> str:
        """Of the task file, for messages."""
        ...

    def read(self, name: str) -> bytes | None:
        """The file's bytes, None where it is not there. Raises PrescriptionError."""
        ...


@dataclass(frozen=True)
class FolderFiles:
    """`label`: the task file's own path, for messages."""

    folder: Path
    label: str

    def read(self, name: str) -> bytes | None:
        for path in self.folder.iterdir():
            if path.name.lower() == name.lower():
                if path.stat().st_size > LARGEST_BYTES:
                    raise PrescriptionError(f"{path}: {path.stat().st_size >> 20} MB: allowed up to "
                                            f"{LARGEST_BYTES >> 20} MB")
                return path.read_bytes()
        return None


@dataclass(frozen=True)
class ZipFiles:
    path: Path
    inside: str            # folder within the zip, with its slash; empty: none
    label: str

    def read(self, name: str) -> bytes | None:
        with zipfile.ZipFile(self.path) as archive:
            for info in archive.infolist():
                if info.filename.lower() == (self.inside + name).lower():
                    if info.file_size > LARGEST_BYTES:
                        raise PrescriptionError(f"{self.path}: {info.filename}: {info.file_size >> 20} MB: allowed "
                                                f"up to {LARGEST_BYTES >> 20} MB")
                    try:
                        return archive.read(info)
                    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, EOFError) as error:
                        raise PrescriptionError(f"{self.path}: {info.filename}: {error}") from None
        return None


def find_task_files(path: Path) -> TaskFiles | None:
    """The task files at a path (TASKDATA.XML, its folder, the folder above, or a zip); None: there are none.

    Raises PrescriptionError for a zip that cannot be opened, OSError.
    """
    if path.is_dir():
        folders = (path, *(sub for sub in sorted(path.iterdir()) if sub.is_dir() and sub.name.lower() == "taskdata"))
        for folder in folders:
            for file in folder.iterdir():
                if file.name.lower() == "taskdata.xml":
                    return FolderFiles(folder, str(file))
        return None
    if path.suffix.lower() == ".xml":
        return FolderFiles(path.parent, str(path)) if path.is_file() else None
    if path.suffix.lower() == ".zip":
        try:
            with zipfile.ZipFile(path) as archive:
                names = archive.namelist()
        except zipfile.BadZipFile as error:
            raise PrescriptionError(f"{path}: {error}") from None
        for name in names:
            if PurePosixPath(name).name.lower() == "taskdata.xml":
                return ZipFiles(path, name[:-len("taskdata.xml")], f"{path}/{name}")
    return None


def task_tree(files: TaskFiles, own_name: str = "TASKDATA.XML") -> ElementTree.Element:
    """The root of the task file, its external files (XFR) joined in. Raises PrescriptionError."""
    data = files.read(own_name)
    if data is None:
        raise PrescriptionError(f"{files.label}: {own_name} is not there")
    root = _parsed(data, files.label)
    if root.tag != "ISO11783_TaskData":
        raise PrescriptionError(f"{files.label}: root element {root.tag}: allowed ISO11783_TaskData")
    references = [f"{reference.get('A', '')}.XML" for reference in root.findall("XFR")]
    held_to(REFERENCES, len(references), files.label)
    for name in dict.fromkeys(references):
        more = files.read(name)
        if more is None:
            raise PrescriptionError(f"{files.label}: {name}, which XFR names, is not there")
        root.extend(_parsed(more, name))
    return root


def _parsed(data: bytes, label: str) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise PrescriptionError(f"{label}: not readable as XML: {error}") from None
