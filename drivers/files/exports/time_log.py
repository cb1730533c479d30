"""How is an ISO 11783-10 time log (TLG) written: the binary records of a device's work, and the
XML with their layout?"""

from __future__ import annotations

import datetime as dt
import struct
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

# Days are counted from here (ISO 11783-10).
FIRST_DAY_UTC = dt.datetime(1980, 1, 1, tzinfo=dt.UTC)
# ms of day, days since 1980, north and east (1e-7 deg), status, HDOP (0.1), satellites.
RECORD_HEAD = struct.Struct("<IHiiBHB")
# Index of the process data, and its value.
RECORD_VALUE = struct.Struct("<Bi")
# Largest value of 32 bits with a sign.
MAX_INT32 = 2_147_483_647
# Position status of a place of unknown quality (ISO 11783-10).
NO_POSITION_STATUS = 15


class LoggedData(NamedTuple):
    """Names a logged process data: data dictionary identifier and device element."""

    ddi: int
    element: str


class TimeRecord(NamedTuple):
    """Holds a record. values: as many as there are process data; None: not known, left out."""

    utc: dt.datetime
    lat_deg: float
    lon_deg: float
    status: int  # as GGA's fix quality; 15: not known
    hdop: float | None
    satellites: int | None
    values: Sequence[int | None]


def encode_layout(data: Sequence[LoggedData]) -> bytes:
    """Returns the XML next to the binary: empty attributes are those that every record holds."""
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
        # All bits set stands for not known; one less is the largest number.
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
