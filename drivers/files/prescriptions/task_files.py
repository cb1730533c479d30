"""The files of an ISO 11783-10 data transfer: in a folder or a zip, whatever the case of their names."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

from drivers.files.archives import Files, Folder, chosen, files_at, parent
from drivers.files.limits import REFERENCES, XML, held_to
from drivers.files.prescriptions.words import PrescriptionError, RateQuestion
from drivers.files.xml_text import Total, XmlError, xml_root


@dataclass(frozen=True)
class TaskSet:
    """`inside`: the folder of the task file within `files`, with its slash; empty: the top. `label`: for messages."""

    files: Files
    inside: str
    label: str

    def read(self, name: str) -> bytes | None:
        """The file's bytes, None where it is not there. Raises Refused, OSError."""
        there = self._by_name.get((self.inside + name).casefold())
        return None if there is None else self.files.read(there)

    @cached_property
    def _by_name(self) -> dict[str, str]:
        """Names in small letters, the first of equal ones."""
        return {name.casefold(): name for name in reversed(self.files.names)}


def task_sets(path: Path) -> list[TaskSet]:
    """The task sets at a path: a TASKDATA.XML, a folder or a zip that holds some, however deep. Raises Refused for a
    zip that cannot be opened, OSError."""
    if path.suffix.lower() == ".xml" and not path.is_dir():
        return [TaskSet(Folder(path.parent, deep=False), "", str(path))] if path.is_file() else []
    if not path.is_dir() and path.suffix.lower() != ".zip":
        return []
    files = files_at(path)
    return [TaskSet(files, parent(name), files.label(name)) for name in files.names
            if PurePosixPath(name).name.lower() == "taskdata.xml"]


def find_task_files(path: Path, inside: str | None = None) -> TaskSet | None:
    """The one task set at a path, or the one named by `inside`; None: there are none.

    Raises RateQuestion where there are several, Refused, OSError.
    """
    found = task_sets(path)
    if inside is not None:
        names = chosen([one.inside + "TASKDATA.XML" for one in found], inside)
        found = [one for one in found if one.inside + "TASKDATA.XML" in names]
    if len(found) > 1:
        names = [one.inside.rstrip("/") or "TASKDATA.XML" for one in found]
        raise RateQuestion(path, "{count} task sets: allowed is one of {names}", " (--inside says which)",
                           count=len(found), names=", ".join(names))
    return found[0] if found else None


def task_tree(files: TaskSet, own_name: str = "TASKDATA.XML") -> ElementTree.Element:
    """The root of the task file, its external files (XFR) joined in. Raises Refused."""
    data = files.read(own_name)
    if data is None:
        raise PrescriptionError(files.label, "{name} is not there", name=own_name)
    total = Total(files.label)
    root = _parsed(data, files.label, total)
    if root.tag != "ISO11783_TaskData":
        raise PrescriptionError(files.label, "root element {tag}: allowed ISO11783_TaskData", tag=root.tag)
    references = [f"{reference.get('A', '')}.XML" for reference in root.findall("XFR")]
    held_to(REFERENCES, len(references), files.label)
    for name in dict.fromkeys(references):
        more = files.read(name)
        if more is None:
            raise PrescriptionError(files.label, "{name}, which XFR names, is not there", name=name)
        root.extend(_parsed(more, name, total))
    return root


def _parsed(data: bytes, label: str, total: Total) -> ElementTree.Element:
    total.bytes += len(data)
    held_to(XML, total.bytes, total.label)
    try:
        return xml_root(data, label, total)
    except XmlError as error:
        raise PrescriptionError(label, "not readable as XML: {why}", why=error) from None
