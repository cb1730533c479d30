"""Which choices does an operator have at the import of a prescription, which result does it give,
and which errors may occur?
"""

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
from topdress.drivers.plain_text import PlaceInFile, RefusedInput

# Highest rate of a map, kg/ha: 20 t/ha of lime; a higher rate has a wrong unit.
MAX_RATE_KG_HA = 20_000.0
# Column of a rule by zones of yield or soil, and the largest factor: double the rate.
ZONE_FACTOR, MAX_ZONE_FACTOR = "factor", 2.0
# The international acre, ha (NIST Handbook 44).
ACRE_HA = 0.40468564224
# A pound per acre, kg/ha; the pound is 0.45359237 kg.
LB_AC_KG_HA = 0.45359237 / ACRE_HA
# A US gallon per acre, l/ha; the gallon is 3.785411784 l.
GAL_AC_L_HA = 3.785411784 / ACRE_HA

# Factors from each unit to kg/ha.
MASS_UNITS: dict[str, float] = {
    "kg/ha": 1.0,
    "t/ha": 1000.0,
    "g/m2": 10.0,
    "mg/m2": 0.01,
    "lb/ac": LB_AC_KG_HA,
    # A mu is a fifteenth of a hectare.
    "kg/ac": 1.0 / ACRE_HA,
    "kg/mu": 15.0,
}
# Factors from each unit to l/ha.
VOLUME_UNITS: dict[str, float] = {
    "l/ha": 1.0,
    "mm3/m2": 0.01,
    "m3/ha": 1000.0,
    "gal/ac": GAL_AC_L_HA,
    "l/ac": 1.0 / ACRE_HA,
}
# Factors from each unit to kg of nitrogen per ha.
NITROGEN_UNITS: dict[str, float] = {"kg N/ha": 1.0, "lb N/ac": LB_AC_KG_HA}
RATE_UNITS = (*MASS_UNITS, *VOLUME_UNITS, *NITROGEN_UNITS)

# Source of the unit where the file names none: plain kg/ha.
UNIT_NOT_NAMED = "as the file names no unit"


class PrescriptionError(RefusedInput):
    """Reports an unusable file with file, place, value and the permitted values."""


class NotAMapError(PrescriptionError):
    """Reports that the content shows no prescription map."""


class NoPolygonsError(PrescriptionError):
    """Reports that the file has no polygon; it may contain points."""


class RateQuestion(PrescriptionError):
    """Reports that the operator must choose between several readings of the file. `columns` lists
    the columns of numbers, where the question is about a column."""

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
    """Holds the operator's choices; None means the file's own statement, or the default."""

    # Column of a shapefile or GeoJSON; None means the only numeric column, or a known name.
    column: str | None = None
    # One of `RATE_UNITS`; None means kg/ha.
    unit: str | None = None
    # Factor in addition to the unit.
    scale: float = 1.0
    # Density of the product, needed for volumes.
    density_kg_l: float | None = None
    # Share of nitrogen in the product, needed for rates of nitrogen.
    n_fraction: float | None = None
    default_kg_ha: float | None = None
    outside_kg_ha: float | None = None
    lost_kg_ha: float | None = None
    # Layer of a task file with several layers: TASK/DDI or TASK/DDI/PRODUCT.
    layer: str | None = None
    # UTM zone of a table of positions in metres: 32N.
    zone: str | None = None
    # Task set or shapefile in a folder or zip with several.
    inside: str | None = None
    # Source of the rate where a task file contradicts itself.
    rate_from: Literal["ddi", "presentation"] | None = None
    # Name of the canopy's index, or ZONE_FACTOR, that the numbers hold instead of rates.
    index: str | None = None
    # Working width, m, to which a raster of too many cells is averaged.
    width_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ImportedMap:
    """Holds a prescription as read. `unit` is the unit of the file's numbers, `factor` converts
    them to kg of product per ha."""

    path: Path
    # Name of the format: isoxml, shapefile, geojson.
    format: str
    data: MapData
    unit: str
    factor: float
    # Names of all layers in the file.
    layers: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    # The column of the rates, and the reason of its choice.
    rate_from: str = "the task's process data"
    # The source of the unit.
    unit_from: str = "by the data dictionary"


def calc_factor_kg_ha(choice: RateChoice, unit: str, where: PlaceInFile) -> float:
    """Returns kg of product per ha for a `unit`, the operator's scale included.

    Parameters
    ----------
    choice : the operator's choice, with density (kg/l) or share of nitrogen where the unit needs
    it.
    unit : one of `RATE_UNITS`.
    where : place in the file, for messages.

    Returns
    -------
    kg/ha.

    Raises
    ------
    PrescriptionError : scale, density or share are missing or out of range.
    """
    if not (isfinite(choice.scale) and choice.scale > 0.0):
        raise PrescriptionError(where, "scale {scale:g}: allowed is above 0", scale=choice.scale)
    if unit in MASS_UNITS:
        return MASS_UNITS[unit] * choice.scale
    if unit in VOLUME_UNITS:
        if choice.density_kg_l is None or not 0.1 <= choice.density_kg_l <= 5.0:
            raise _choose_error_class(choice.density_kg_l)(
                where,
                "rates in {unit}, density {density}: allowed with the product's density, "
                "0.1 to 5 kg/l",
                unit=unit,
                density=choice.density_kg_l,
            )
        return VOLUME_UNITS[unit] * choice.density_kg_l * choice.scale
    if unit in NITROGEN_UNITS:
        if choice.n_fraction is None or not 0.0 < choice.n_fraction <= 1.0:
            raise _choose_error_class(choice.n_fraction)(
                where,
                "rates in {unit}, nitrogen {share}: allowed with the product's share of N, "
                "above 0 to 1",
                unit=unit,
                share=choice.n_fraction,
            )
        return NITROGEN_UNITS[unit] / choice.n_fraction * choice.scale
    raise PrescriptionError(
        where, "unit {unit}: allowed {units}", unit=unit, units=", ".join(RATE_UNITS)
    )


def _choose_error_class(given: float | None) -> type[PrescriptionError]:
    """Returns the error's class: a missing value is a question, a wrong value is refused."""
    return RateQuestion if given is None else PrescriptionError


def check_degrees(path: Path, places: NDArray[np.float64]) -> None:
    """Refuses positions (n, 2) that are no latitude and longitude. Raises PrescriptionError."""
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


def check_rate_kg_ha(rate_kg_ha: float, where: Callable[[], PlaceInFile]) -> float:
    """Returns the rate, kg/ha, if it is possible. Raises PrescriptionError otherwise."""
    if not 0.0 <= rate_kg_ha <= MAX_RATE_KG_HA:
        raise PrescriptionError(
            where(),
            "rate {rate:g} kg/ha: allowed 0 to {highest:g} (is the unit right?)",
            rate=rate_kg_ha,
            highest=MAX_RATE_KG_HA,
        )
    return rate_kg_ha


def check_index_value(value: float, name: str, where: Callable[[], PlaceInFile]) -> float:
    """Returns an index of the canopy; values of water and bare ground below 0 count as 0. Raises
    PrescriptionError for a number out of range."""
    if name == ZONE_FACTOR:
        if not 0.0 <= value <= MAX_ZONE_FACTOR:
            raise PrescriptionError(
                where(),
                "{value:g}: allowed as {index} is 0 to {most:g}",
                value=value,
                index=name,
                most=MAX_ZONE_FACTOR,
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


def apply_fallback_choice(found: Fallbacks, choice: RateChoice, where: PlaceInFile) -> Fallbacks:
    """Returns the file's fallbacks, replaced by the fallbacks that the operator chose. Raises
    PrescriptionError."""
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
        check_rate_kg_ha(value, lambda name=name: where.go_down("{key}", key=name))  # type: ignore[misc]
    return found._replace(**picked)
