"""A map of the canopy's index (NDVI of a drone or a satellite) as rates, by the rule of a job's crop."""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from control.agronomy.noa import Rule
from control.recordings.finding import Finding
from control.targets.prescription import MapData
from drivers.files.prescriptions.words import Imported, PrescriptionError, RateChoice


def index_choice(choice: RateChoice, rule: Rule, where: str) -> RateChoice:
    """How the map is read: the index's column as plain numbers. Raises PrescriptionError."""
    if choice.unit is not None or choice.scale != 1.0:
        raise PrescriptionError(where, "--unit and --scale: allowed without --rule, whose map holds an index")
    if not rule.is_ready:
        raise PrescriptionError(where, "the rule waits for its strips: allowed is a job with ndvi_nrich (and, by the "
                                "field's response, ndvi_check)")
    return replace(choice, index=rule.crop.index.upper(), unit="kg/ha")


def read_index(path: Path, index: str) -> Imported:
    """A map of the canopy's index, or of zones, for the loop, its numbers in the place of rates. index: ndvi, ndre or
    ZONE_FACTOR. Raises PrescriptionError for what is none, OSError."""
    from drivers.files.prescriptions.read import read_prescription
    read = read_prescription(path, RateChoice(index=index.upper(), unit="kg/ha"))
    _need_zones(read)
    return read


def _need_zones(read: Imported) -> None:
    if read.data.grid is not None:
        raise PrescriptionError(read.path, "a grid of rates: allowed is a map of the canopy's index")


def by_rule(read: Imported, rule: Rule) -> Imported:
    """Each zone with the rate that the rule gives for its index. Raises PrescriptionError for what is no index."""
    data = read.data
    _need_zones(read)
    index = rule.crop.index.upper()
    zones = tuple(zone._replace(rate_kg_ha=rule.decide(zone.rate_kg_ha).rate_kg_ha) for zone in data.zones)
    said = Finding("by_rule", f"{index} taken to rates by the rule of {rule.crop.name}")
    new = MapData(zones, None, data.fallbacks, data.fields_deg, data.title, data.product)
    return replace(read, data=new, findings=(*read.findings, said), unit_from=f"by the rule, from {index}")
