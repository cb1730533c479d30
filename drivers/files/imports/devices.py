"""What does a number of an ISO 11783-10 time log mean, by the data dictionary (ISO 11783-11) and
by its device's description?"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple
from xml.etree.ElementTree import Element

from topdress.drivers.files.imports.units import unit_named


class Meaning(NamedTuple):
    """Describes a number. `name`: as it is called here. Raw numbers times `step`, plus `offset`,
    are in `unit`."""

    name: str
    unit: str = ""
    step: float = 1.0
    offset: float = 0.0


class Presented(NamedTuple):
    """Describes a device's value presentation (DVP): (raw + offset) x scale is shown in `unit`."""

    unit: str
    scale: float
    offset: float


@dataclass(frozen=True)
class DeviceElement:
    """Describes an element of a device (DET), with what its description says of each data
    identifier (DDI)."""

    id: str
    device: str  # id of the device (DVC)
    device_name: str
    name: str
    # 1 device, 2 function, 3 bin, 4 section, 5 unit, 6 connector, 7 navigation
    kind: str
    called: dict[int, str] = field(default_factory=dict)
    shown: dict[int, Presented] = field(default_factory=dict)
    fixed: dict[int, int] = field(default_factory=dict)  # properties (DPT)


# ISO 11783-11: the identifiers that a spreader, a sprayer or a tractor logs, each with name, unit
# and a step in it.
DICTIONARY = {
    1: Meaning("target volume rate", "l/ha", 1e-4),
    2: Meaning("applied volume rate", "l/ha", 1e-4),
    6: Meaning("target rate", "mg/m2"),
    7: Meaning("applied rate", "mg/m2"),
    11: Meaning("wanted seeds per m2", "", 0.001),
    12: Meaning("seeds per m2", "", 0.001),
    36: Meaning("target volume flow", "l/min", 6e-5),
    37: Meaning("applied volume flow", "l/min", 6e-5),
    41: Meaning("target flow", "mg/s"),
    42: Meaning("applied flow", "mg/s"),
    67: Meaning("working width", "mm"),
    70: Meaning("maximum working width", "mm"),
    72: Meaning("volume content", "l", 0.001),
    75: Meaning("hopper", "g"),
    80: Meaning("total volume", "l"),
    81: Meaning("total mass", "kg"),
    116: Meaning("total area", "m2"),
    117: Meaning("total distance at work", "m", 0.001),
    118: Meaning("total distance out of work", "m", 0.001),
    119: Meaning("total time at work", "s"),
    120: Meaning("total time out of work", "s"),
    141: Meaning("work state"),
    352: Meaning("total mass in grams", "g"),
    353: Meaning("total nitrogen", "g"),
    397: Meaning("speed", "mm/s"),
}
# Identifiers of which a wrong step is a wrong dose.
RATES = (1, 2, 6, 7, 36, 37, 41, 42)
# Identifiers of the actual and the largest working width, mm.
WIDTHS = (67, 70)
# Share by which presentation and dictionary may differ: presentations are rounded.
AGREES = 0.01


def parts_of(root: Element) -> dict[str, DeviceElement]:
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
                _describe(part, data.get(reference.get("A")), shown)
            found[part.id] = part
    return found


def _describe(part: DeviceElement, data: Element | None, shown: dict[str | None, Element]) -> None:
    if data is None or (ddi := ddi_of(data.get("B", ""))) is None:
        return
    is_property = data.tag == "DPT"
    name, presentation = (
        (data.get("D"), data.get("E")) if is_property else (data.get("E"), data.get("F"))
    )
    if name:
        part.called[ddi] = name
    # Attributes that are no numbers are ignored: the dictionary holds then.
    if (one := shown.get(presentation)) is not None:
        try:
            part.shown[ddi] = Presented(
                one.get("E", ""), float(one.get("C", "1")), float(one.get("B", "0"))
            )
        except ValueError:
            pass
    if is_property and (value := data.get("C", "")).lstrip("-").isdigit():
        part.fixed[ddi] = int(value)


def ddi_of(text: str) -> int | None:
    """Returns an identifier of an attribute in hexadecimal; None where it is none."""
    try:
        return int(text, 16)
    except ValueError:
        return None


def meaning_of(root: Element, ddi: int | None, part: DeviceElement | None) -> Meaning:
    """Returns the meaning of an identifier, by the dictionary, else as the device describes it.

    Parameters
    ----------
    root : the task file, whose devices may name an identifier.
    ddi : data identifier; None: the log names none.
    part : the element; None: not described.
    """
    if ddi is None:
        return Meaning("no data identifier")
    if ddi in DICTIONARY:
        return DICTIONARY[ddi]
    name = part.called.get(ddi, "") if part is not None else ""
    if not name:
        name = next(
            (one.get("E", "") for one in root.iter("DPD") if ddi_of(one.get("B", "")) == ddi), ""
        )
    shown = part.shown.get(ddi) if part is not None else None
    if shown is None:
        return Meaning(name or f"ddi {ddi}")
    return Meaning(name or f"ddi {ddi}", shown.unit, shown.scale, shown.offset * shown.scale)


def contradiction(ddi: int | None, part: DeviceElement | None) -> Meaning | None:
    """Returns a rate's meaning by its device's presentation, where the dictionary differs; None:
    they agree."""
    shown = None if part is None or ddi not in RATES else part.shown.get(ddi)
    if shown is None or ddi is None:
        return None
    by_book, unit = DICTIONARY[ddi], unit_named(shown.unit)
    own = unit_named(by_book.unit)
    if (
        unit is None
        or own is None
        or unit.quantity != own.quantity
        or (unit.quantity == "other" and unit != own)
    ):
        return None
    # Ratio of a step as shown to a step by the dictionary.
    as_shown = shown.scale * unit.factor / (by_book.step * own.factor)
    if abs(as_shown - 1.0) <= AGREES and shown.offset == 0.0:
        return None
    return Meaning(by_book.name, shown.unit, shown.scale, shown.offset * shown.scale)


def width_m(parts: dict[str, DeviceElement], device: str | None = None) -> float | None:
    """Returns the working width of a device's description, m: that of its widest element; None:
    it describes none."""
    stated = [
        part.fixed[ddi]
        for part in parts.values()
        if device in (None, part.device)
        for ddi in WIDTHS
        if part.fixed.get(ddi, 0) > 0
    ]
    return max(stated) / 1000.0 if stated else None
