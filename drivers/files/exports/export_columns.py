"""Which columns do the flat exports (CSV, GeoJSON, shapefile) have? One table defines them for all
three.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from topdress.control.machine.model_elements import Array
from topdress.drivers.files.exports.as_applied import AsApplied


class ExportColumn(NamedTuple):
    """Describes a column: `name` in CSV and GeoJSON, `short` in a shapefile (at most ten
    characters), number of `decimals`, and `find_values`, which returns its values (n,)."""

    name: str
    short: str
    width: int
    decimals: int
    find_values: Callable[[AsApplied], Array]


# Name in a shapefile of the column that is utc elsewhere.
TIME_SHORT_NAME = "ISOTIME"

# The order is that of the columns; short names have at most ten letters (dBASE).
EXPORT_COLUMNS = (
    ExportColumn("time_s", "TIME_S", 12, 2, lambda a: a.stretches.time_s),
    ExportColumn("lat_deg", "LATITUDE", 14, 9, lambda a: a.stretches.lat_deg),
    ExportColumn("lon_deg", "LONGITUDE", 14, 9, lambda a: a.stretches.lon_deg),
    ExportColumn("heading_deg", "HEADING", 8, 1, lambda a: a.stretches.heading_deg),
    ExportColumn("speed_mps", "SPEED_MPS", 8, 3, lambda a: a.stretches.speed_mps),
    ExportColumn("duration_s", "DURATION_S", 9, 3, lambda a: a.stretches.duration_s),
    ExportColumn("distance_m", "DISTANCE_M", 10, 4, lambda a: a.stretches.length_m),
    ExportColumn("swath_width_m", "SWATHWDTH", 8, 3, lambda a: a.stretches.width_m),
    ExportColumn("area_m2", "AREA_M2", 12, 5, lambda a: a.stretches.area_m2),
    ExportColumn("target_rate_kg_ha", "TARGETRATE", 10, 3, lambda a: a.stretches.target_kg_ha),
    ExportColumn("applied_rate_kg_ha", "APPLIEDRAT", 10, 3, lambda a: a.stretches.applied_kg_ha),
    ExportColumn("target_kg", "TARGET_KG", 14, 8, lambda a: a.stretches.target_kg),
    ExportColumn("applied_kg", "APPLIED_KG", 14, 8, lambda a: a.stretches.applied_kg),
    ExportColumn(
        "applied_n_kg", "N_KG", 14, 8, lambda a: a.stretches.applied_kg * a.product.n_fraction
    ),
    ExportColumn("shaft_rpm", "SHAFT_RPM", 8, 2, lambda a: a.stretches.shaft_rpm),
    ExportColumn("opening_mm", "OPENING_MM", 8, 2, lambda a: a.stretches.opening_mm),
    ExportColumn("fix_quality", "FIXQUALITY", 4, 0, lambda a: a.stretches.fix_quality),
)


def iter_export_records(applied: AsApplied) -> Iterator[tuple[str, list[float | None]]]:
    """Yields each segment's time (ISO 8601, empty where unknown) and the columns' rounded values;
    None for unknown."""
    arrays = [
        np.round(column.find_values(applied), column.decimals).tolist() for column in EXPORT_COLUMNS
    ]
    for k, time_s in enumerate(applied.stretches.time_s.tolist()):
        moment = applied.utc(time_s)
        text = (
            ""
            if moment is None
            # ISO 8601 writes UTC as Z.
            else moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
        )
        yield text, [None if array[k] != array[k] else array[k] for array in arrays]


def summarise_export(applied: AsApplied) -> dict[str, object]:
    """Returns the sums for programs, from the log's own rows. `worked_ha` and `mean_kg_ha` use the
    positions of the material."""
    return {
        "format": "topdress-as-applied/1",
        "machine": applied.machine.id,
        "product": applied.product.name,
        "product_n_fraction": applied.product.n_fraction,
        "working_width_m": applied.width_m,
        "cut_at_crop_limit": None if applied.cut is None else applied.cut._asdict(),
        "released_stopped": [
            # NaN, an unknown position, is not equal to itself.
            dict(one._asdict())
            for one in applied.stopped
            if one.lat_deg == one.lat_deg
        ],
        "worked_ha": applied.worked_ha,
        "mean_kg_ha": applied.mean_kg_ha,
        **applied.totals._asdict(),
    }
