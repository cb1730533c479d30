"""Polygons with attributes, as shapefile and GeoJSON have them, to zones: which column is the rate, in which unit."""
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from control.recordings.finding import Finding, many
from control.targets.prescription import NO_FALLBACKS, Fallbacks, MapData, Zone
from control.targets.rate_map import Floats
from drivers.files.archives import Folder
from drivers.files.imports.trouble import listed
from drivers.files.prescriptions.rate_column import rate_column
from drivers.files.prescriptions.words import (
    Imported,
    NoPolygons,
    PrescriptionError,
    RateChoice,
    checked_index,
    checked_rate,
    factor_kg_ha,
    not_degrees,
    with_choice,
)
from drivers.files.stated_units import NO_UNITS, StatedUnit, side_units, together
from drivers.plain_text import PlaceInFile

KNOWN_EXTRA = ("title",)        # of our own files


class Feature(NamedTuple):
    """`number` counts from 1 as people do. polygons_deg: each outline first, then holes, latitude and longitude."""

    number: int
    attributes: Mapping[str, Any]
    polygons_deg: Sequence[tuple[Floats, ...]]


def imported(path: Path, format_name: str, features: Sequence[Feature], choice: RateChoice, findings: list[Finding],
             *,
             fallbacks: Fallbacks = NO_FALLBACKS, fields_deg: tuple[tuple[Floats, ...], ...] = (), title: str = "",
             product: str = "", units: Mapping[str, StatedUnit] = NO_UNITS) -> Imported:
    """Zones of the features, by the operator's choice. units: of columns, as the file says besides their names; what
    lies next to it is looked at here. Raises Refused, OSError."""
    if not features:
        raise NoPolygons(path, "no polygons: allowed is at least one")
    if path.is_file():
        columns = {name for feature in features for name in feature.attributes}
        units = together(units, side_units(Folder(path.parent, deep=False), path.name, columns))
    chosen = rate_column(path, [(feature.number, feature.attributes) for feature in features], choice, units)
    column, unit = chosen.name, chosen.unit
    where = PlaceInFile(str(path))
    factor = factor_kg_ha(choice, unit, where.at("column {column}", column=column))
    zones: list[Zone] = []
    empty = 0
    for feature, cell in zip(features, chosen.cells, strict=True):
        if math.isnan(cell.value):
            empty += 1
            continue
        rate = _checked(choice, cell.value * factor, where.at("row {row}: {column}", row=feature.number, column=column))
        zones += [Zone(rate, rings) for rings in feature.polygons_deg]
    unused = [name for name in dict.fromkeys(name for feature in features for name in feature.attributes)
              if name != column and name not in KNOWN_EXTRA]
    if unused:
        findings.append(Finding("unused_columns", f"{many(len(unused), 'column')} not used: {listed(unused)}"))
    if empty:
        findings.append(Finding("empty_rates", f"{many(empty, 'polygon')} without a rate left out", column, empty))
    if not zones:
        raise PrescriptionError(where.at("column {column}", column=column), "empty everywhere: allowed is a number")
    _check_degrees(path, zones)
    data = MapData(tuple(zones), None, with_choice(fallbacks, choice, where), fields_deg, title, product)
    return Imported(path, format_name, data, unit, factor, (column,), tuple(findings),
                    f"{column} ({chosen.why})", chosen.unit_from)


def _checked(choice: RateChoice, value: float, where: PlaceInFile) -> float:
    """Raises PrescriptionError."""
    if choice.index is not None:
        return checked_index(value, choice.index, lambda: where)
    return checked_rate(value, lambda: where)


def ring(corners: Sequence[Sequence[float]] | Floats) -> Floats:
    """(k, 2) latitude and longitude of a ring given as longitude and latitude, its closing corner left out."""
    lon_lat = np.asarray([corner[:2] for corner in corners], dtype=np.float64).reshape(-1, 2)
    if len(lon_lat) > 1 and (lon_lat[0] == lon_lat[-1]).all():
        lon_lat = lon_lat[:-1]
    return np.ascontiguousarray(lon_lat[:, ::-1])


def _check_degrees(path: Path, zones: Sequence[Zone]) -> None:
    corners = np.concatenate([rings[0] for _, rings, _ in zones])
    if not np.isfinite(corners).all():
        raise PrescriptionError(path, "a corner is not finite: allowed are degrees")
    highest = np.abs(corners).max(axis=0)
    if highest[0] > 90.0 or highest[1] > 180.0:
        raise not_degrees(path, float(highest[0]), float(highest[1]))
