"""What an operator chooses at an import, what comes out of it, and what goes wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from topdress.control.recordings.finding import Finding
from topdress.control.targets.prescription import Fallbacks, MapData
from topdress.drivers.plain_text import PlaceInFile, Refused

HIGHEST_KG_HA = 20_000.0
# of a rule by zones of yield or soil: the column's name; at most double
ZONE_FACTOR, MOST_FACTOR = "factor", 2.0
ACRE_HA = 0.40468564224  # the international acre
LB_AC_KG_HA = 0.45359237 / ACRE_HA  # kg/ha
GAL_AC_L_HA = 3.785411784 / ACRE_HA  # l/ha

MASS_UNITS: dict[str, float] = {
    "kg/ha": 1.0,
    "t/ha": 1000.0,
    "g/m2": 10.0,
    "mg/m2": 0.01,
    "lb/ac": LB_AC_KG_HA,
    # a mu is a fifteenth of a hectare
    "kg/ac": 1.0 / ACRE_HA,
    "kg/mu": 15.0,
}
VOLUME_UNITS: dict[str, float] = {
    "l/ha": 1.0,
    "mm3/m2": 0.01,
    "m3/ha": 1000.0,
    "gal/ac": GAL_AC_L_HA,
    "l/ac": 1.0 / ACRE_HA,
}
NITROGEN_UNITS: dict[str, float] = {"kg N/ha": 1.0, "lb N/ac": LB_AC_KG_HA}
UNITS = (*MASS_UNITS, *VOLUME_UNITS, *NITROGEN_UNITS)

UNIT_NOT_NAMED = "as the file names no unit"  # who says the unit: nobody, so plain kg/ha


class PrescriptionError(Refused):
    """The file cannot be used: file, place, value and what is allowed."""


class NotAMap(PrescriptionError):
    """Nothing in the file says that it is a prescription map."""


class NoPolygons(PrescriptionError):
    """There is not one polygon in the file; it may hold points."""


class RateQuestion(PrescriptionError):
    """The file can be used once the operator has said which of several readings is meant.
    columns: that hold numbers, where it is a column that is asked for."""

    def __init__(
        self,
        where: PlaceInFile | Path | str,
        text: str,
        hint: str = "",
        columns: tuple[str, ...] = (),
        **values: object,
    ) -> None:
        super().__init__(where, text, hint, **values)
        self.columns = columns


@dataclass(frozen=True, slots=True, kw_only=True)
class RateChoice:
    """What the operator picks; None: what the file says, or the plain default."""

    # of a shapefile or GeoJSON; None: the one numeric column, or a known name
    column: str | None = None
    unit: str | None = None  # one of UNITS; None: kg/ha
    scale: float = 1.0  # on top of the unit
    density_kg_l: float | None = None  # of the product; needed for volumes
    n_fraction: float | None = None  # N in the product; needed for rates of nitrogen
    default_kg_ha: float | None = None
    outside_kg_ha: float | None = None
    lost_kg_ha: float | None = None
    # of a task file with several: TASK/DDI or TASK/DDI/PRODUCT
    layer: str | None = None
    # of a table of places in metres: 32N
    zone: str | None = None
    # of a folder or zip with several: the task set or shapefile
    inside: str | None = None
    # where a task file contradicts itself
    rate_from: Literal["ddi", "presentation"] | None = None
    # the numbers are the canopy's index of this name, or ZONE_FACTOR, not rates
    index: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """A prescription as read. `unit`: what the file's numbers are in; `factor`: to kg of
    product per ha from there."""

    path: Path
    format: str  # isoxml, shapefile, geojson
    data: MapData
    unit: str
    factor: float
    layers: tuple[str, ...] = ()  # all that the file holds
    findings: tuple[Finding, ...] = ()
    # which column the rates are, and why that one
    rate_from: str = "the task's process data"
    unit_from: str = "by the data dictionary"  # who says what they are in


def factor_kg_ha(choice: RateChoice, unit: str, where: PlaceInFile) -> float:
    """kg of product per ha for one `unit`, the operator's scale included. Raises
    PrescriptionError."""
    if not (isfinite(choice.scale) and choice.scale > 0.0):
        raise PrescriptionError(where, "scale {scale:g}: allowed is above 0", scale=choice.scale)
    if unit in MASS_UNITS:
        return MASS_UNITS[unit] * choice.scale
    if unit in VOLUME_UNITS:
        if choice.density_kg_l is None or not 0.1 <= choice.density_kg_l <= 5.0:
            raise _asked(choice.density_kg_l)(
                where,
                "rates in {unit}, density {density}: allowed with the product's density, "
                "0.1 to 5 kg/l",
                unit=unit,
                density=choice.density_kg_l,
            )
        return VOLUME_UNITS[unit] * choice.density_kg_l * choice.scale
    if unit in NITROGEN_UNITS:
        if choice.n_fraction is None or not 0.0 < choice.n_fraction <= 1.0:
            raise _asked(choice.n_fraction)(
                where,
                "rates in {unit}, nitrogen {share}: allowed with the product's share of N, "
                "above 0 to 1",
                unit=unit,
                share=choice.n_fraction,
            )
        return NITROGEN_UNITS[unit] / choice.n_fraction * choice.scale
    raise PrescriptionError(
        where, "unit {unit}: allowed {units}", unit=unit, units=", ".join(UNITS)
    )


def _asked(given: float | None) -> type[PrescriptionError]:
    """What was not given is a question, what was given wrongly is refused."""
    return RateQuestion if given is None else PrescriptionError


def check_degrees(path: Path, places: NDArray[np.float64]) -> None:
    """Raises PrescriptionError where places (n, 2), latitude and longitude, are none."""
    lat_deg, lon_deg = np.abs(places).max(axis=0).tolist()
    if not (isfinite(lat_deg) and isfinite(lon_deg)):
        raise PrescriptionError(path, "a corner is not finite: allowed are degrees")
    if lat_deg <= 90.0 and lon_deg <= 180.0:
        return
    if lat_deg <= 180.0 and lon_deg <= 90.0:
        raise PrescriptionError(
            path,
            "latitude and longitude look swapped: latitudes up to {lat:.0f}, longitudes up "
            "to {lon:.0f}: allowed are latitudes to 90",
            " (GeoJSON and WKT name the longitude first)",
            lat=lat_deg,
            lon=lon_deg,
        )
    raise PrescriptionError(
        path,
        "coordinates up to {lon:.0f}, {lat:.0f}: allowed are degrees (WGS84)",
        "; export the map again in longitude and latitude",
        lat=lat_deg,
        lon=lon_deg,
    )


def checked_rate(rate_kg_ha: float, where: Callable[[], PlaceInFile]) -> float:
    """The rate, where it can be one. Raises PrescriptionError."""
    if not 0.0 <= rate_kg_ha <= HIGHEST_KG_HA:
        raise PrescriptionError(
            where(),
            "rate {rate:g} kg/ha: allowed 0 to {highest:g} (is the unit right?)",
            rate=rate_kg_ha,
            highest=HIGHEST_KG_HA,
        )
    return rate_kg_ha


def checked_index(value: float, name: str, where: Callable[[], PlaceInFile]) -> float:
    """An index of the canopy: water and bare ground below 0 count as 0. Raises
    PrescriptionError for what is none."""
    if name == ZONE_FACTOR:
        if not 0.0 <= value <= MOST_FACTOR:
            raise PrescriptionError(
                where(),
                "{value:g}: allowed as {index} is 0 to {most:g}",
                value=value,
                index=name,
                most=MOST_FACTOR,
            )
        return value
    if not -1.0 <= value <= 1.0:
        raise PrescriptionError(
            where(),
            "{value:g}: allowed as {index} is -1 to 1 (is it scaled by 10000 or 255?)",
            value=value,
            index=name,
        )
    return max(0.0, value)


def with_choice(found: Fallbacks, choice: RateChoice, where: PlaceInFile) -> Fallbacks:
    """Fallbacks of a file, those that the operator picked instead. Raises PrescriptionError."""
    picked = {
        name: value
        for name, value in (
            ("default_kg_ha", choice.default_kg_ha),
            ("outside_kg_ha", choice.outside_kg_ha),
            ("lost_kg_ha", choice.lost_kg_ha),
        )
        if value is not None
    }
    for name, value in picked.items():
        checked_rate(value, lambda name=name: where.at("{key}", key=name))  # type: ignore[misc]
    return found._replace(**picked)
