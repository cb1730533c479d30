"""How does topdress read XML: elements and their texts, no entities, and no more than memory
holds?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from topdress.drivers.files.limits import TAGS, check_limit
from topdress.drivers.plain_text import OneLineError, PlaceInFile


class XmlError(OneLineError):
    """The text is no XML, or none that is read; a line says why."""


@dataclass
class XmlTotal:
    """Counts bytes and tags of several files that are joined to one. label: of the file that
    names them."""

    label: PlaceInFile | Path | str
    bytes: int = 0
    tags: int = 0


def parse_xml_root(
    data: bytes, label: PlaceInFile | Path | str, total: XmlTotal | None = None
) -> Element:
    """Returns the root of all elements. total: of the files that this file is joined to. Raises
    XmlError, BeyondLimits."""
    plain = data.replace(b"\0", b"") if b"\0" in data[:200] else data  # UTF-16
    total = total or XmlTotal(label)
    total.tags += plain.count(b"<")
    check_limit(TAGS, total.tags, label)
    # A few bytes of entities can stand for any number of bytes.
    if b"<!ENTITY" in plain:
        raise XmlError("entities of its own: allowed is XML without them")
    try:
        return ElementTree.fromstring(data)
    # LookupError: of an unknown encoding
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise XmlError(str(error)) from None


def find_local_name(element: Element) -> str:
    """Returns an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]
