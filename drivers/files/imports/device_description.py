"""What does a number of an ISO 11783-10 time log mean? The data dictionary (ISO 11783-11) and the
description of the device define it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple
from xml.etree.ElementTree import Element

from topdress.drivers.files.imports.units import find_named_unit


class NumberMeaning(NamedTuple):
    """Describes a number. `name` is its name in the table. Raw numbers times `step`, plus `offset`,
    are in `unit`."""

    name: str
    unit: str = ""
    step: float = 1.0
    offset: float = 0.0


class ValuePresentation(NamedTuple):
    """Describes a device's value presentation (DVP): (raw + offset) x scale is shown in `unit`."""

    unit: str
    scale: float
    offset: float


@dataclass(frozen=True)
class DeviceElement:
    """Describes an element of a device (DET), with the description of each data identifier
    (DDI)."""

    id: str
    # Id of the device (DVC).
    device: str
    device_name: str
    name: str
    # Type of the element: 1 device, 2 function, 3 bin, 4 section, 5 unit, 6 connector, 7
    # navigation.
    kind: str
    called: dict[int, str] = field(default_factory=dict)
    shown: dict[int, ValuePresentation] = field(default_factory=dict)
    # Values of device properties (DPT).
    fixed: dict[int, int] = field(default_factory=dict)


# Identifiers of ISO 11783-11 that a spreader, a sprayer or a tractor logs, each with its name, unit
# and step.
DATA_DICTIONARY = {
    1: NumberMeaning("target volume rate", "l/ha", 1e-4),
    2: NumberMeaning("applied volume rate", "l/ha", 1e-4),
    6: NumberMeaning("target rate", "mg/m2"),
    7: NumberMeaning("applied rate", "mg/m2"),
    11: NumberMeaning("wanted seeds per m2", "", 0.001),
    12: NumberMeaning("seeds per m2", "", 0.001),
    36: NumberMeaning("target volume flow", "l/min", 6e-5),
    37: NumberMeaning("applied volume flow", "l/min", 6e-5),
    41: NumberMeaning("target flow", "mg/s"),
    42: NumberMeaning("applied flow", "mg/s"),
    67: NumberMeaning("working width", "mm"),
    70: NumberMeaning("maximum working width", "mm"),
    72: NumberMeaning("volume content", "l", 0.001),
    75: NumberMeaning("hopper", "g"),
    80: NumberMeaning("total volume", "l"),
    81: NumberMeaning("total mass", "kg"),
    116: NumberMeaning("total area", "m2"),
    117: NumberMeaning("total distance at work", "m", 0.001),
    118: NumberMeaning("total distance out of work", "m", 0.001),
    119: NumberMeaning("total time at work", "s"),
    120: NumberMeaning("total time out of work", "s"),
    141: NumberMeaning("work state"),
    352: NumberMeaning("total mass in grams", "g"),
    353: NumberMeaning("total nitrogen", "g"),
    397: NumberMeaning("speed", "mm/s"),
}
# Identifiers of rates; a wrong step of these would be a wrong dose.
RATE_DDIS = (1, 2, 6, 7, 36, 37, 41, 42)
# Identifiers of the actual and the largest working width, mm.
WIDTH_DDIS = (67, 70)
# Relative difference up to which presentation and dictionary agree, because presentations are
# rounded.
PRESENTATION_TOLERANCE = 0.01


def read_device_elements(root: Element) -> dict[str, DeviceElement]:
    """Returns the elements of all devices by their ids."""
    found = {}
    for device in root.iter("DVC"):
        shown = {one.get("A"): one for one in device.findall("DVP")}
        data = {one.get("A"): one for one in (*device.findall("DPD"), *device.findall("DPT"))}
        for element in device.findall("DET"):
            part = DeviceElement(
                element.get("A", ""),
                device.get("A", ""),
                device.get("B", ""),
                element.get("D", ""),
                element.get("C", ""),
            )
            for reference in element.findall("DOR"):
                _describe_element(part, data.get(reference.get("A")), shown)
            found[part.id] = part
    return found


def _describe_element(
    part: DeviceElement, data: Element | None, shown: dict[str | None, Element]
) -> None:
    if data is None or (ddi := parse_ddi(data.get("B", ""))) is None:
        return
    is_property = data.tag == "DPT"
    name, presentation = (
        (data.get("D"), data.get("E")) if is_property else (data.get("E"), data.get("F"))
    )
    if name:
        part.called[ddi] = name
    # Attributes that are no numbers are ignored; the dictionary then applies.
    if (one := shown.get(presentation)) is not None:
        try:
            part.shown[ddi] = ValuePresentation(
                one.get("E", ""), float(one.get("C", "1")), float(one.get("B", "0"))
            )
        except ValueError:
            pass
    if is_property and (value := data.get("C", "")).lstrip("-").isdigit():
        part.fixed[ddi] = int(value)


def parse_ddi(text: str) -> int | None:
    """Returns an identifier from an attribute in hexadecimal; None for another text."""
    try:
        return int(text, 16)
    except ValueError:
        return None


def find_meaning(root: Element, ddi: int | None, part: DeviceElement | None) -> NumberMeaning:
    """Returns the meaning of an identifier by the dictionary, else by the device's description.

    Parameters
    ----------
    root : the task file, whose devices may name an identifier.
    ddi : data identifier; None if the log names none.
    part : the element; None for an element without a description.
    """
    if ddi is None:
        return NumberMeaning("no data identifier")
    if ddi in DATA_DICTIONARY:
        return DATA_DICTIONARY[ddi]
    name = part.called.get(ddi, "") if part is not None else ""
    if not name:
        name = next(
            (one.get("E", "") for one in root.iter("DPD") if parse_ddi(one.get("B", "")) == ddi), ""
        )
    shown = part.shown.get(ddi) if part is not None else None
    if shown is None:
        return NumberMeaning(name or f"ddi {ddi}")
    return NumberMeaning(name or f"ddi {ddi}", shown.unit, shown.scale, shown.offset * shown.scale)


def find_contradiction(ddi: int | None, part: DeviceElement | None) -> NumberMeaning | None:
    """Returns a rate's meaning by its device's presentation, if the dictionary differs; None if
    they agree."""
    shown = None if part is None or ddi not in RATE_DDIS else part.shown.get(ddi)
    if shown is None or ddi is None:
        return None
    by_book, unit = DATA_DICTIONARY[ddi], find_named_unit(shown.unit)
    own = find_named_unit(by_book.unit)
    if (
        unit is None
        or own is None
        or unit.quantity != own.quantity
        or (unit.quantity == "other" and unit != own)
    ):
        return None
    # The ratio of the displayed step to the step of the dictionary.
    as_shown = shown.scale * unit.factor / (by_book.step * own.factor)
    if abs(as_shown - 1.0) <= PRESENTATION_TOLERANCE and shown.offset == 0.0:
        return None
    return NumberMeaning(by_book.name, shown.unit, shown.scale, shown.offset * shown.scale)


def find_width_m(parts: dict[str, DeviceElement], device: str | None = None) -> float | None:
    """Returns the working width of a device's description, m: the width of its widest element; None
    without a width."""
    stated = [
        part.fixed[ddi]
        for part in parts.values()
        if device in (None, part.device)
        for ddi in WIDTH_DDIS
        if part.fixed.get(ddi, 0) > 0
    ]
    return max(stated) / 1000.0 if stated else None
