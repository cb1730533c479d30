"""Which passes does a farm record contain, one CSV line each, and which sums result by product and
field?
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.exports.as_applied import AsApplied
from topdress.drivers.files.farm_lines import RECORD_COLUMNS, read_record_rows


class FarmPass(NamedTuple):
    """Holds the work of a log. `cost` and `price_per_kg` are None without a price."""

    applied: AsApplied
    # The operator's entries: client, farm, field, crop, operator, product.
    said: Mapping[str, str]
    simulated: bool
    log: str
    price_per_kg: float | None
    currency: str

    @property
    def product(self) -> str:
        """The product's name that the operator gave, else the log's."""
        return self.said.get("product") or self.applied.product.name

    @property
    def cost(self) -> float | None:
        """Cost of the product; None without a price."""
        return (
            None
            if self.price_per_kg is None
            else self.price_per_kg * self.applied.totals.applied_kg
        )

    def cells(self) -> list[str]:
        """Returns the pass as cells of `RECORD_COLUMNS`; empty for unknown values."""
        applied, totals = self.applied, self.applied.totals
        s = applied.stretches
        begin = applied.utc(float(s.time_s[0] - 0.5 * s.duration_s[0]))
        end = applied.utc(float(s.time_s[-1] + 0.5 * s.duration_s[-1]))
        hectares = applied.worked_ha
        return [
            "" if begin is None else f"{begin:%Y-%m-%d}",
            *("" if moment is None else f"{moment:%Y-%m-%dT%H:%M:%SZ}" for moment in (begin, end)),
            *(self.said.get(name, "") for name in ("client", "farm", "field", "crop", "operator")),
            applied.machine.id,
            self.product,
            f"{hectares:.4f}",
            "" if totals.covered_ha is None else f"{totals.covered_ha:.4f}",
            f"{totals.applied_kg:.2f}",
            f"{applied.mean_kg_ha:.2f}",
            f"{totals.target_kg:.2f}",
            f"{totals.applied_n_kg:.2f}",
            f"{applied.mean_kg_ha * applied.product.n_fraction:.2f}",
            f"{totals.worked_s / 3600.0:.3f}",
            "" if self.price_per_kg is None else f"{self.price_per_kg:g}",
            "" if self.cost is None else f"{self.cost:.2f}",
            "" if self.cost is None else self.currency,
            "yes" if self.simulated else "",
            self.log,
        ]


class FarmSum(NamedTuple):
    """Holds the sums of the passes with one product on one field, paid in one currency."""

    product: str
    field: str
    currency: str
    passes: int
    hectares: float
    kilograms: float
    nitrogen_kg: float
    cost: float | None


def sum_passes(passes: Iterable[FarmPass]) -> list[FarmSum]:
    """Returns sums by product, field and currency, in the order of the passes."""
    found: dict[tuple[str, str, str], FarmSum] = {}
    for one in passes:
        key = (one.product, one.said.get("field", ""), one.currency)
        before = found.get(key, FarmSum(*key, 0, 0.0, 0.0, 0.0, 0.0))
        # A sum that includes an unknown cost is unknown.
        both = None if before.cost is None or one.cost is None else before.cost + one.cost
        totals = one.applied.totals
        found[key] = FarmSum(
            *key,
            before.passes + 1,
            before.hectares + one.applied.worked_ha,
            before.kilograms + totals.applied_kg,
            before.nitrogen_kg + totals.applied_n_kg,
            both,
        )
    return list(found.values())


def write_farm_record(passes: Sequence[FarmPass], path: Path) -> tuple[int, int]:
    """Appends these passes to the farm record; the line of a log that the record already contains
    is replaced in place.

    Returns
    -------
    the number of added lines and of replaced lines.

    Raises
    ------
    FarmRecordError : the file is no farm record.
    OSError : the file cannot be read or written.
    """
    rows = read_record_rows(path)
    # The last column is the log's name.
    places = {row[-1]: k for k, row in enumerate(rows)}
    added = replaced = 0
    for one in passes:
        cells = one.cells()
        if one.log in places:
            rows[places[one.log]] = cells
            replaced += 1
        else:
            places[one.log] = len(rows)
            rows.append(cells)
            added += 1
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(RECORD_COLUMNS)
    writer.writerows(rows)
    write_atomically(path, text.getvalue())
    return added, replaced
