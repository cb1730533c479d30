"""How does topdress read XML? Elements and their texts are read, entities are refused, and the size
is limited.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from topdress.drivers.files.limits import TAGS_LIMIT, check_limit
from topdress.drivers.plain_text import OneLineError, PlaceInFile


class XmlError(OneLineError):
    """Reports a text that is no XML, or XML that is not supported, in a line."""


@dataclass
class XmlTotal:
    """Counts bytes and tags of several files that are joined into one. `label` is the file that
    names them."""

    label: PlaceInFile | Path | str
    bytes: int = 0
    tags: int = 0


def parse_xml_root(
    data: bytes, label: PlaceInFile | Path | str, total: XmlTotal | None = None
) -> Element:
    """Returns the root of all elements. `total` counts the files that this file is joined to.
    Raises XmlError, BeyondLimits."""
    # UTF-16 has a zero byte next to each ASCII character.
    plain = data.replace(b"\0", b"") if b"\0" in data[:200] else data
    total = total or XmlTotal(label)
    total.tags += plain.count(b"<")
    check_limit(TAGS_LIMIT, total.tags, label)
    # A few bytes of entities can expand to any number of bytes.
    if b"<!ENTITY" in plain:
        raise XmlError("entities of its own: allowed is XML without them")
    try:
        return ElementTree.fromstring(data)
    # An unknown encoding raises LookupError.
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise XmlError(str(error)) from None


def find_local_name(element: Element) -> str:
    """Returns an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]
