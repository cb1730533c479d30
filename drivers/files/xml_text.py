"""XML as topdress reads it: elements and their texts, no entities of its own, no more of them than memory holds."""
from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from drivers.files.limits import TAGS, held_to
from drivers.plain_text import OneLine, Where


class XmlError(OneLine):
    """Why it is no XML, or none that is read."""


class Total:
    """Of several files that are joined to one: their bytes and tags so far. label: of the one that names them."""

    def __init__(self, label: Where | Path | str) -> None:
        self.label = label
        self.bytes = self.tags = 0

    def add_bytes(self, count: int) -> int:
        self.bytes += count
        return self.bytes

    def add_tags(self, count: int) -> int:
        self.tags += count
        return self.tags


def xml_root(data: bytes, label: Where | Path | str, total: Total | None = None) -> Element:
    """The root of all elements. total: of the files that this one is joined to. Raises XmlError, BeyondLimits."""
    plain = data.replace(b"\0", b"") if b"\0" in data[:200] else data        # UTF-16
    held_to(TAGS, (total or Total(label)).add_tags(plain.count(b"<")), label)
    if b"<!ENTITY" in plain:                            # a few bytes that stand for as many as somebody likes
        raise XmlError("entities of its own: allowed is XML without them")
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise XmlError(str(error)) from None
    except (LookupError, ValueError) as error:          # of an encoding that there is not
        raise XmlError(str(error)) from None


def local(element: Element) -> str:
    """Its name without its namespace."""
    return str(element.tag).rpartition("}")[2]
