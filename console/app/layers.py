"""What a map can be coloured by, and from where to where its colours go."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.units import Units
from topdress.console.app.view import ERROR_SPAN
from topdress.console.locale import N_
from topdress.console.scale import (
    Rgb,
    find_error_colour,
    find_passes_colour,
    find_rate_colour,
    round_calm_ends,
)


class MapLayer(StrEnum):
    """Lists the numbers by which a map can be coloured."""

    APPLIED = "applied"
    TARGET = "target"
    ERROR = "error"
    NDVI = "ndvi"
    PASSES = "passes"


LAYER_LABELS = {
    MapLayer.APPLIED: N_("applied"),
    MapLayer.TARGET: N_("target"),
    MapLayer.ERROR: N_("error"),
    MapLayer.NDVI: N_("NDVI"),
    MapLayer.PASSES: N_("passes"),
}
LAYER_KINDS = {
    MapLayer.APPLIED: (0,),
    MapLayer.TARGET: (1,),
    MapLayer.ERROR: (0, 1),
    MapLayer.NDVI: (2,),
    MapLayer.PASSES: (3,),
}  # of Worked
PASSES_ENDS = (1.0, 2.0)  # covered once; twice or more: overlap
# bare soil to a closed canopy, as the heads tell them
NDVI_ENDS = (0.2, 0.9)
RATE_LAYERS = frozenset({MapLayer.APPLIED, MapLayer.TARGET})


class LayerScale(NamedTuple):
    """Holds a colour scale. low, high: of the colours, in the unit inside; per_si and decimals: how
    they are shown."""

    layer: MapLayer
    low: float
    high: float
    per_si: float
    decimals: int
    unit: str

    def format_value(self, value: float | None) -> str:
        """A value as shown, without its unit."""
        if value is None:
            return "--"
        sign = "+" if self.layer is MapLayer.ERROR and value > 0.0 else ""
        return f"{sign}{round(value * self.per_si, self.decimals) + 0.0:.{self.decimals}f}"

    def find_colour(self, share: float) -> Rgb:
        """The colour at a share of the scale."""
        return {MapLayer.ERROR: find_error_colour, MapLayer.PASSES: find_passes_colour}.get(
            self.layer, find_rate_colour
        )(share)


def find_colour_scale(
    layer: MapLayer,
    worked: WorkedGround,
    picture: FieldPicture | None,
    units: Units,
    laid: tuple[float, float] | None = None,
    most_kg_ha: float | None = None,
) -> LayerScale:
    """The scale of a layer. Applied and target share one scale, which also covers the plan, and the
    rates of a laid file.

    most_kg_ha: of the job that runs. Its scale then stands from the first metre to the last, by the
    plan, else by this limit: a colour that meant 200 kg/ha in the morning means 200 kg/ha in the
    evening. None: by what was worked so far.
    """
    if layer is MapLayer.ERROR:
        return LayerScale(layer, -ERROR_SPAN, ERROR_SPAN, 100.0, 0, "%")
    if layer is MapLayer.PASSES:
        return LayerScale(layer, *PASSES_ENDS, 1.0, 0, "x")
    if layer is MapLayer.NDVI:
        low, high = (
            NDVI_ENDS
            if most_kg_ha is not None
            else round_calm_ends(worked.ndvi_ends or (), step=0.05, least=0.2)
        )
        return LayerScale(layer, low, high, 1.0, 2, "")
    planned = (
        picture.planned.rate_ends if picture is not None and picture.planned is not None else None
    )
    per_si = units.rate.per_si
    own = worked.rate_ends if most_kg_ha is None else planned or (0.0, most_kg_ha)
    low, high = round_calm_ends(
        value * per_si for ends in (own, planned, laid) for value in ends or ()
    )
    return LayerScale(layer, low / per_si, high / per_si, per_si, 0, units.rate.name)


def find_next_layer(layer: MapLayer) -> MapLayer:
    """The layer after this one."""
    layers = tuple(MapLayer)
    return layers[(layers.index(layer) + 1) % len(layers)]
