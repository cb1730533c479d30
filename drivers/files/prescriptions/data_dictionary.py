"""What do identifiers of the data dictionary (ISO 11783-11) mean? They are described in words for
messages.
"""

from __future__ import annotations

# Quantities to which a machine can be set; each has five identifiers, from the set-point on.
_QUANTITY_OF_DDI = {
    1: "volume per area",
    6: "mass per area",
    11: "count per area",
    16: "spacing",
    21: "volume per volume",
    26: "mass per mass",
    31: "volume per mass",
    36: "volume per time",
    41: "mass per time",
    46: "count per time",
    51: "tillage depth",
    56: "seeding depth",
    61: "working height",
    66: "working width",
}
# The order of those five identifiers.
_ROLES_OF_DDI = ("wanted", "applied", "by default", "at least", "at most")
# Further identifiers that task files often contain.
_OTHER_DDIS = {
    80: "total volume",
    81: "total mass",
    82: "total count",
    116: "total area",
    141: "work state",
}


def describe_ddi(ddi: int) -> str:
    """Returns an identifier in words: `DDI 0006 (mass per area, wanted)`."""
    begin = ddi - (ddi - 1) % len(_ROLES_OF_DDI)
    quantity = _QUANTITY_OF_DDI.get(begin)
    words = _OTHER_DDIS.get(ddi) or (quantity and f"{quantity}, {_ROLES_OF_DDI[ddi - begin]}")
    return f"DDI {ddi:04X} ({words or 'no name known here'})"
