"""Defines the quantities that colour a map, and the range of each colour scale."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.panel_views import ERROR_BAR_END_SHARE
from topdress.console.app.units import Units
from topdress.console.colour_scale import (
    Rgb,
    find_error_colour,
    find_passes_colour,
    find_rate_colour,
    round_calm_ends,
)
from topdress.console.locale import N_


class MapLayer(StrEnum):
    """Lists the quantities that can colour a map."""

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
# Kinds of `WorkedGround` that a layer needs (0 applied, 1 target, 2 NDVI, 3 passes).
LAYER_KINDS = {
    MapLayer.APPLIED: (0,),
    MapLayer.TARGET: (1,),
    MapLayer.ERROR: (0, 1),
    MapLayer.NDVI: (2,),
    MapLayer.PASSES: (3,),
}  # of Worked
# One pass is full coverage; two or more passes are overlap.
PASSES_RANGE = (1.0, 2.0)
# NDVI of bare soil and of a closed canopy, as the sensor heads report it.
NDVI_RANGE = (0.2, 0.9)
# Layers in kg/ha, which share one colour scale.
RATE_LAYERS = frozenset({MapLayer.APPLIED, MapLayer.TARGET})


class LayerScale(NamedTuple):
    """Holds a colour scale.

    Attributes
    ----------
    low, high
        Ends of the scale, in internal units.
    per_si
        Factor from internal to displayed units.
    decimals
        Decimals of displayed values.
    """

    layer: MapLayer
    low: float
    high: float
    per_si: float
    decimals: int
    unit: str

    def format_value(self, value: float | None) -> str:
        """Return a value in displayed units, without the name of the unit."""
        if value is None:
            return "--"
        sign = "+" if self.layer is MapLayer.ERROR and value > 0.0 else ""
        # Adding 0.0 turns a rounded -0.0 into 0.0.
        return f"{sign}{round(value * self.per_si, self.decimals) + 0.0:.{self.decimals}f}"

    def find_colour(self, share: float) -> Rgb:
        """Return the colour at a share (0 to 1) of the scale."""
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
    """Return the colour scale of a layer. Applied and target share a scale, which also covers the
    plan and an overlaid file.

    Parameters
    ----------
    layer
        Quantity that colours the map.
    worked
        Ground worked so far.
    picture
        Static parts of the map with the plan, or None.
    units
        Units of displayed values.
    laid
        Lowest and highest rate of an overlaid file, kg/ha.
    most_kg_ha
        Rate limit of the running job, kg/ha. With it the scale is constant during the job, so that
        a colour means the same rate in the morning and in the evening. None: the scale covers the
        ground worked so far.
    """
    if layer is MapLayer.ERROR:
        return LayerScale(layer, -ERROR_BAR_END_SHARE, ERROR_BAR_END_SHARE, 100.0, 0, "%")
    if layer is MapLayer.PASSES:
        return LayerScale(layer, *PASSES_RANGE, 1.0, 0, "x")
    if layer is MapLayer.NDVI:
        low, high = (
            NDVI_RANGE
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
    """Return the layer after this layer, in the order of the menu."""
    layers = tuple(MapLayer)
    return layers[(layers.index(layer) + 1) % len(layers)]
