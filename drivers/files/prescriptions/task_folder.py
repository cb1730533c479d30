"""Writing the files of an ISO 11783-10 data transfer: a folder or a zip with TASKDATA.XML and what lies next to it."""
from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from control.targets.rate_map import Floats
from drivers.files.atomic import write_atomically
from drivers.files.run_meta import software_version

LONGEST_NAME = 32
WGS84_PRJ = ('GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
             'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]')


def task_root(from_terminal: bool) -> Element:
    """The root element, version 4.3. `from_terminal`: written after the work, not before it."""
    version = software_version()
    root = Element("ISO11783_TaskData", VersionMajor="4", VersionMinor="3", ManagementSoftwareManufacturer="topdress",
                   ManagementSoftwareVersion=version, DataTransferOrigin="2" if from_terminal else "1")
    if from_terminal:
        root.set("TaskControllerManufacturer", "topdress")
        root.set("TaskControllerVersion", version)
    return root


def degrees(value: float) -> str:
    """A place's degrees: nine decimals at most, as the public schema has them (0.1 mm), never with an exponent."""
    return np.format_float_positional(round(value, 9), trim="-")


def cell_degrees(value: float) -> str:
    """The size of a grid's cell: the shortest decimal that reads back the same, for it counts once a cell."""
    return np.format_float_positional(value, trim="-")


def outline(parent: Element, rings: Sequence[Floats], kind: str) -> None:
    """A polygon of this kind with its outline, then its holes, (k, 2) latitude and longitude each."""
    polygon = SubElement(parent, "PLN", A=kind)
    for k, corners in enumerate(rings):
        line = SubElement(polygon, "LSG", A="1" if k == 0 else "2")
        for lat, lon in [*corners.tolist(), corners[0].tolist()]:
            SubElement(line, "PNT", A="2", C=degrees(lat), D=degrees(lon))


def name_of(text: str) -> str:
    """A name as the public schema allows it: at most 32 letters, none that XML has no place for."""
    return "".join(letter for letter in text if letter.isprintable())[:LONGEST_NAME].strip()


def write_task(path: Path, root: Element, files: Mapping[str, bytes]) -> None:
    """A zip where the path ends in .zip, else the folder (or that of a path that ends in .xml). Raises OSError."""
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
