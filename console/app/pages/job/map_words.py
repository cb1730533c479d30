"""Words the check of a job's map before work: the parts that will not be applied as planned.
Pure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app.units import Units
from topdress.console.locale import _

if TYPE_CHECKING:
    from topdress.control.targets.map_check import MapCheck

# Share of the map's or the field's area beyond which the map may be the wrong one.
DOUBTFUL_AREA_SHARE = 0.1
# Smaller areas result from rounding of corners, ha.
MIN_REPORTED_AREA_HA = 0.0001


def describe_map_check(check: MapCheck, units: Units) -> tuple[str, ...]:
    """Return a sentence for each part of the map that is not applied as planned; () if everything
    is applied."""
    area, rate = units.area._replace(decimals=4), units.rate
    # A map that lies elsewhere makes every other remark meaningless.
    if check.away_m > 0.0:
        away = f"{check.away_m / 1000.0:.1f}"
        if check.swapped:
            return (
                _(
                    "latitude and longitude look swapped: exchanged, the map lies on the "
                    "field; as it is, {away} km "
                    "away"
                ).format(away=away),
            )
        if check.away_kg_ha > 0.0:
            return (
                _(
                    "the map lies {away} km away from the field: its rate for outside, "
                    "{rate}, is applied "
                    "everywhere"
                ).format(away=away, rate=rate.format_with_name(check.away_kg_ha)),
            )
        return (
            _("the map lies {away} km away from the field: nothing of it is applied").format(
                away=away
            ),
        )
    said = []
    if check.above_ha > MIN_REPORTED_AREA_HA and check.limit_kg_ha is not None:
        said.append(
            _(
                "{area} of the map want up to {highest}, above the crop's limit: {limit} "
                "are applied there, "
                "{mass} less than the map wants"
            ).format(
                area=area.format_with_name(check.above_ha),
                highest=rate.format_with_name(check.highest_kg_ha),
                limit=rate.format_with_name(check.limit_kg_ha),
                mass=units.mass.format_with_name(check.above_kg),
            )
        )
    if check.outside_ha > MIN_REPORTED_AREA_HA:
        text = (
            _(
                "{area} of the map's {mapped} lie outside the field: the map's rate for "
                "outside, {rate}, is applied "
                "there"
            )
            if check.beyond_kg_ha > 0.0
            else (_("{area} of the map's {mapped} lie outside the field: not applied"))
        )
        said.append(
            text.format(
                area=area.format_with_name(check.outside_ha),
                mapped=area.format_with_name(check.mapped_ha),
                rate=rate.format_with_name(check.beyond_kg_ha),
            )
        )
    if check.uncovered_ha > MIN_REPORTED_AREA_HA:
        text = (
            _(
                "{area} of the field's {field} have no rate of their own in the map: its "
                "rate for the rest, {rate}, "
                "is applied there"
            )
            if check.uncovered_kg_ha > 0.0
            else (
                _("{area} of the field's {field} have no rate in the map: nothing is applied there")
            )
        )
        said.append(
            text.format(
                area=area.format_with_name(check.uncovered_ha),
                field=area.format_with_name(check.field_ha),
                rate=rate.format_with_name(check.uncovered_kg_ha),
            )
        )
    if check.overlap_ha > MIN_REPORTED_AREA_HA:
        said.append(
            _(
                "{area} lie in more than one zone: the first in the file holds, each place "
                "counts once"
            ).format(area=area.format_with_name(check.overlap_ha))
        )
    return tuple(said)


def is_doubtful(check: MapCheck) -> bool:
    """Return whether the map may be the wrong one, or plans rates that will not be applied."""
    field_ha = check.field_ha or 0.0
    return (
        check.away_m > 0.0
        or check.above_ha > MIN_REPORTED_AREA_HA
        or check.outside_ha > DOUBTFUL_AREA_SHARE * check.mapped_ha
        or check.uncovered_ha > DOUBTFUL_AREA_SHARE * field_ha
    )
