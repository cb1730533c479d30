"""How is an ISO 11783-10 time log (TLG) written? It consists of the binary records of a device's
work, and an XML file with their layout.
"""

from __future__ import annotations

import datetime as dt
import struct
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

# Epoch from which ISO 11783-10 counts days.
FIRST_DAY_UTC = dt.datetime(1980, 1, 1, tzinfo=dt.UTC)
# Milliseconds of the day, days since 1980, north and east (1e-7 deg), status, HDOP (0.1),
# satellites.
RECORD_HEAD = struct.Struct("<IHiiBHB")
# Index of the process data, and its value.
RECORD_VALUE = struct.Struct("<Bi")
# Largest signed value of 32 bits.
MAX_INT32 = 2_147_483_647
# Position status for a position of unknown quality (ISO 11783-10).
NO_POSITION_STATUS = 15


class LoggedData(NamedTuple):
    """Names a logged value by data dictionary identifier and device element."""

    ddi: int
    element: str


class TimeRecord(NamedTuple):
    """Holds a record. `values` has one entry for each logged value; None for an unknown value,
    which is omitted."""

    utc: dt.datetime
    lat_deg: float
    lon_deg: float
    # GGA's fix quality; 15 means unknown.
    status: int
    hdop: float | None
    satellites: int | None
    values: Sequence[int | None]


def encode_layout(data: Sequence[LoggedData]) -> bytes:
    """Returns the XML of the record layout; an empty attribute is present in every record."""
    root = Element("TIM", A="", D="4")
    SubElement(root, "PTN", A="", B="", D="", F="", G="")
    for item in data:
        SubElement(root, "DLV", A=f"{item.ddi:04X}", B="", C=item.element)
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True))


def encode_records(moments: Iterable[TimeRecord]) -> bytes:
    """Returns the binary records. A value beyond 32 bits is limited to the end of its range."""
    out = bytearray()
    for moment in moments:
        since = moment.utc - FIRST_DAY_UTC
        known = [(k, value) for k, value in enumerate(moment.values) if value is not None]
        # All bits set means unknown, so the largest number is one less.
        hdop = 0xFFFF if moment.hdop is None else min(0xFFFE, max(0, round(10 * moment.hdop)))
        satellites = 0xFF if moment.satellites is None else min(0xFE, max(0, moment.satellites))
        out += RECORD_HEAD.pack(
            since.seconds * 1000 + since.microseconds // 1000,
            since.days,
            round(moment.lat_deg * 1e7),
            round(moment.lon_deg * 1e7),
            moment.status,
            hdop,
            satellites,
        )
        out.append(len(known))
        for k, value in known:
            out += RECORD_VALUE.pack(k, min(MAX_INT32, max(-MAX_INT32 - 1, value)))
    return bytes(out)
