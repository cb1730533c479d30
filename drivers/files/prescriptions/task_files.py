"""Which files does an ISO 11783-10 data transfer contain, and how are they read and written? They
are in a folder or a zip, and the case of their names does not matter.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.archives import (
    ArchiveFiles,
    Folder,
    choose_names,
    find_parent_folder,
    open_archive,
)
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.limits import REFERENCES_LIMIT, XML_LIMIT, check_limit
from topdress.drivers.files.prescriptions.map_choices import PrescriptionError, RateQuestion
from topdress.drivers.files.run_meta import find_software_version
from topdress.drivers.files.xml_text import XmlError, XmlTotal, parse_xml_root


@dataclass(frozen=True)
class TaskSet:
    """Names a task set. `inside` is the folder of the task file within `files`, with its slash;
    empty for the top. `label` is the name in messages."""

    files: ArchiveFiles
    inside: str
    label: str

    def read(self, name: str) -> bytes | None:
        """Returns the file's bytes; None for a missing file. Raises RefusedInput, OSError."""
        there = self._by_name.get((self.inside + name).casefold())
        return None if there is None else self.files.read(there)

    @cached_property
    def _by_name(self) -> dict[str, str]:
        """Names by their small letters, the first of equal names."""
        return {name.casefold(): name for name in reversed(self.files.names)}


def find_task_sets(path: Path) -> list[TaskSet]:
    """Returns the task sets at a path: a TASKDATA.XML, or all task sets of a folder or zip at any
    depth. Raises RefusedInput for a zip that cannot be opened, OSError."""
    if path.suffix.lower() == ".xml" and not path.is_dir():
        return [TaskSet(Folder(path.parent, deep=False), "", str(path))] if path.is_file() else []
    if not path.is_dir() and path.suffix.lower() != ".zip":
        return []
    files = open_archive(path)
    return [
        TaskSet(files, find_parent_folder(name), files.label(name))
        for name in files.names
        if PurePosixPath(name).name.lower() == "taskdata.xml"
    ]


def choose_task_set(path: Path, inside: str | None = None) -> TaskSet | None:
    """Returns the task set at a path.

    Parameters
    ----------
    path : a TASKDATA.XML, folder or zip.
    inside : name of a task set where the path has several.

    Returns
    -------
    the task set, or None without a task set.

    Raises
    ------
    RateQuestion : the path has several task sets.
    RefusedInput : a zip cannot be opened.
    OSError : a file cannot be opened.
    """
    found = find_task_sets(path)
    if inside is not None:
        names = choose_names([one.inside + "TASKDATA.XML" for one in found], inside)
        found = [one for one in found if one.inside + "TASKDATA.XML" in names]
    if len(found) > 1:
        names = [one.inside.rstrip("/") or "TASKDATA.XML" for one in found]
        raise RateQuestion(
            path,
            "{count} task sets: allowed is one of {names}",
            " (--inside says which)",
            count=len(found),
            names=", ".join(names),
        )
    return found[0] if found else None


def read_task_tree(files: TaskSet) -> ElementTree.Element:
    """Returns the root of the task file, with its external files (XFR). Raises RefusedInput."""
    data = files.read("TASKDATA.XML")
    if data is None:
        raise PrescriptionError(files.label, "{name} is not there", name="TASKDATA.XML")
    # External files count towards the same limits.
    total = XmlTotal(files.label)
    root = _parse_limited_xml(data, files.label, total)
    if root.tag != "ISO11783_TaskData":
        raise PrescriptionError(
            files.label, "root element {tag}: allowed ISO11783_TaskData", tag=root.tag
        )
    references = [f"{reference.get('A', '')}.XML" for reference in root.findall("XFR")]
    check_limit(REFERENCES_LIMIT, len(references), files.label)
    for name in dict.fromkeys(references):
        more = files.read(name)
        if more is None:
            raise PrescriptionError(files.label, "{name}, which XFR names, is not there", name=name)
        root.extend(_parse_limited_xml(more, name, total))
    return root


def _parse_limited_xml(data: bytes, label: str, total: XmlTotal) -> ElementTree.Element:
    """Returns the root of an XML file, within the limits of the whole set. Raises RefusedInput."""
    total.bytes += len(data)
    check_limit(XML_LIMIT, total.bytes, total.label)
    try:
        return parse_xml_root(data, label, total)
    except XmlError as error:
        raise PrescriptionError(label, "not readable as XML: {why}", why=error) from None


# Largest number of letters of a name (designator) in the public schema of version 4.3.
MAX_NAME_LENGTH = 32
# Well-known text (ESRI) of degrees on WGS84, as a `.prj` holds it.
WGS84_PRJ = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)


def make_task_root(from_terminal: bool) -> Element:
    """Returns the root element, version 4.3. `from_terminal` means that the file is written after
    the work instead of before it."""
    version = find_software_version()
    root = Element(
        "ISO11783_TaskData",
        VersionMajor="4",
        VersionMinor="3",
        ManagementSoftwareManufacturer="topdress",
        ManagementSoftwareVersion=version,
        # 1 is management software (FMIS), 2 a terminal (MICS).
        DataTransferOrigin="2" if from_terminal else "1",
    )
    if from_terminal:
        root.set("TaskControllerManufacturer", "topdress")
        root.set("TaskControllerVersion", version)
    return root


def format_degrees(value: float) -> str:
    """Returns degrees with at most nine decimals, as in the public schema (0.1 mm), never with an
    exponent."""
    return np.format_float_positional(round(value, 9), trim="-")


def format_cell_degrees(value: float) -> str:
    """Returns the size of a grid's cell as the shortest decimal that reads back the same, because
    its error accumulates from cell to cell."""
    return np.format_float_positional(value, trim="-")


def add_polygon_element(parent: Element, rings: Sequence[Floats], kind: str) -> None:
    """Adds a polygon of a kind with its outline, then its holes, (k, 2) latitude and longitude
    each."""
    polygon = SubElement(parent, "PLN", A=kind)
    for k, corners in enumerate(rings):
        line = SubElement(polygon, "LSG", A="1" if k == 0 else "2")
        for lat, lon in [*corners.tolist(), corners[0].tolist()]:
            SubElement(line, "PNT", A="2", C=format_degrees(lat), D=format_degrees(lon))


def clean_task_name(text: str) -> str:
    """Returns a name that the public schema allows: at most 32 letters, without characters that XML
    cannot hold."""
    return "".join(letter for letter in text if letter.isprintable())[:MAX_NAME_LENGTH].strip()


def write_task_files(path: Path, root: Element, files: Mapping[str, bytes]) -> None:
    """Writes a zip for a path that ends in .zip, else a folder (the folder of a path that ends in
    .xml). Raises OSError."""
    ElementTree.indent(root)
    text = bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True))
    everything = {"TASKDATA.XML": text, **files}
    if path.suffix.lower() == ".zip":
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in everything.items():
                archive.writestr(f"TASKDATA/{name}", data)
        write_atomically(path, packed.getvalue())
        return
    folder = path.parent if path.suffix.lower() == ".xml" else path
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in everything.items():
        write_atomically(folder / name, data)
