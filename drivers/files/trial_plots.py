"""Which plots does a trial have, and which amounts were applied, read, weighed and harvested in
each plot?
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from topdress.control.agronomy.crop import Crop
from topdress.control.geodesy import TangentPlane
from topdress.control.log_row import HEAD_COLUMNS, NDRE_COLUMNS
from topdress.control.machine.machine import Machine
from topdress.control.machine.model_elements import Array
from topdress.control.papers.field_trial import FieldTrial, TrialPlot
from topdress.drivers.files.any_log import open_any_log
from topdress.drivers.files.exports.as_applied import build_as_applied, find_outlet_way
from topdress.drivers.files.fields.shapes import read_named_shapes
from topdress.drivers.files.outline_overlaps import check_outlines
from topdress.drivers.files.read_log import RunLog
from topdress.drivers.files.table import read_table
from topdress.drivers.plain_text import OneLineError

# Length of the intervals that belong to a plot by their middle, s: 0.25 m at 4.5 km/h.
FINE_SEGMENT_S = 0.2
# Columns of weights, in kg, kg and m2.
WEIGHT_COLUMNS = ("applied_kg", "sample_kg", "sample_m2")


class TrialError(OneLineError):
    """Reports that plots, weights or a log form no trial. The line names file, row and the
    permitted values."""


class PlotWeights(NamedTuple):
    """Holds the weights of a plot. `treatment` is empty where no column has it."""

    treatment: str
    applied_kg: float | None
    samples_kg_ha: tuple[float, ...]


def read_trial_plots(path: Path) -> dict[str, Any]:
    """Returns plots, name -> polygon in longitude and latitude, from any format of a field. Raises
    TrialError, RefusedInput, OSError."""
    found: dict[str, Any] = {}
    for name, shape in read_named_shapes(path):
        parts = [
            part
            for part in shapely.get_parts(shape)
            if part.geom_type == "Polygon" and not part.is_empty
        ]
        if not parts:
            continue
        # Weights refer to plots by name, so each name must be unique.
        if not name or name in found:
            raise TrialError(
                f"{path}: plot {name or len(found) + 1}: allowed is a name of its own for "
                "each (attribute "
                "name)"
            )
        # Outlines that cross themselves too often would take minutes to repair.
        check_outlines(
            [
                [shapely.get_coordinates(ring)[:-1] for ring in (one.exterior, *one.interiors)]
                for one in parts
            ],
            path,
        )
        # Plots that were drawn by hand may touch themselves.
        found[name] = shapely.make_valid(shapely.MultiPolygon(parts))
    if not found:
        raise TrialError(f"{path}: no polygon in it: allowed is an outline for each plot")
    return found


def read_weights(path: Path, plots: Mapping[str, Any]) -> dict[str, PlotWeights]:
    """Returns the weights of each plot.

    Rows have `plot`, and either applied_kg (hopper before minus after) or sample_kg harvested from
    sample_m2; `treatment` is optional. Amounts of a plot are added, samples are replicates. Raises
    TrialError, TableError.
    """
    table = read_table(path, numbers=WEIGHT_COLUMNS, texts=("plot", "treatment"))
    if "plot" not in table.columns:
        raise TrialError(
            f"{path}: column plot missing: allowed are plot, treatment, {', '.join(WEIGHT_COLUMNS)}"
        )
    if not any(name in table.columns for name in WEIGHT_COLUMNS[:2]):
        raise TrialError(
            f"{path}: neither applied_kg nor sample_kg: allowed is what was spread, or "
            "harvested, by plot"
        )
    found: dict[str, PlotWeights] = {}
    for row in range(table.rows):
        cells = {name: column[row] for name, column in table.columns.items()}
        name = str(cells["plot"]).strip()
        # A misspelt plot would silently lose its weights.
        if name not in plots:
            raise TrialError(
                f"{path}: row {row + 1}: plot {name!r}: allowed is one of {', '.join(plots)}"
            )
        found[name] = _add_weight_row(
            found.get(name, PlotWeights("", None, ())), cells, f"{path}: row {row + 1}"
        )
    return found


def _add_weight_row(before: PlotWeights, cells: Mapping[str, Any], where: str) -> PlotWeights:
    """Returns a plot's weights with another row. Raises TrialError."""
    applied, sample, area = (float(cells.get(key, np.nan)) for key in WEIGHT_COLUMNS)
    for key, value, least in (
        ("applied_kg", applied, 0.0),
        ("sample_kg", sample, 0.0),
        ("sample_m2", area, 0.01),
    ):
        # A million kilograms is a wrong unit.
        if not np.isnan(value) and not least <= value < 1e6:
            raise TrialError(f"{where}: {key} {value:g}: allowed is {least:g} or more")
    if not np.isnan(sample) and np.isnan(area):
        raise TrialError(f"{where}: sample_m2 missing: the area that sample_kg was harvested from")
    # Several rows of a plot must agree on its treatment.
    treatment = str(cells.get("treatment", "")).strip()
    if before.treatment and treatment and before.treatment != treatment:
        raise TrialError(
            f"{where}: treatment {treatment!r}: allowed is {before.treatment!r}, as above"
        )
    return PlotWeights(
        before.treatment or treatment,
        before.applied_kg if np.isnan(applied) else (before.applied_kg or 0.0) + applied,
        before.samples_kg_ha
        if np.isnan(sample)
        else (*before.samples_kg_ha, sample * 10_000.0 / area),
    )


def read_trial(
    plots: Path,
    log: Path,
    weights: Path | None,
    after: Path | None = None,
    machine: Machine | None = None,
) -> FieldTrial:
    """Returns a trial with the applied, sensed and weighed amounts of each plot.

    Parameters
    ----------
    plots : file of the plots' polygons.
    log : log of the application.
    weights : table of weights; None if no plot was weighed.
    after : log of a later reading of the canopy.
    machine : machine for logs that name none.

    Raises
    ------
    TrialError : plots, weights or log do not fit.
    ExportError : the log cannot be exported.
    TableError : a table cannot be read.
    RefusedInput : the plots cannot be read.
    OSError : a file cannot be opened.
    """
    outlines = read_trial_plots(plots)
    weighed = {} if weights is None else read_weights(weights, outlines)
    run = open_any_log(log)
    # Short segments assign the material near a plot's edge to the right side.
    applied = build_as_applied(run, machine, every_s=FINE_SEGMENT_S)
    readings, hz = _find_head_readings(run, applied.machine)
    later = None
    if after is not None:
        seen = open_any_log(after)
        # The later reading may come from another machine with other heads.
        own = None if seen.meta is None else seen.meta.machine
        later, _ = _find_head_readings(
            seen, applied.machine if own is None else Machine.model_validate(own)
        )
    s = applied.stretches
    at = np.column_stack((s.lon_deg, s.lat_deg))
    found = []
    for name, outline in outlines.items():
        # Preparing the outline makes the thousands of tests below fast.
        shapely.prepare(outline)
        inside = shapely.contains_xy(outline, at[:, 0], at[:, 1])
        there = weighed.get(name, PlotWeights("", None, ()))
        found.append(
            TrialPlot(
                name,
                # Without a column the treatment is the plot's name without its replicate.
                there.treatment or name.rpartition("-")[0] or name,
                _calc_area_m2(outline),
                readings.select_within(outline),
                np.zeros(0) if later is None else later.select_within(outline),
                # None means that no material was logged there; 0 would mean a recorded rate of 0.
                float(s.target_kg[inside].sum()) if inside.any() else None,
                float(s.applied_kg[inside].sum()) if inside.any() else None,
                there.applied_kg,
                there.samples_kg_ha,
            )
        )
    if not any(len(plot.before) or plot.logged_kg is not None for plot in found):
        raise TrialError(
            f"{log}: lies in none of the plots of {plots}: allowed is a log of this field"
        )
    # Nitrogen of wheat grain, kg/t, for a log that names no crop.
    grain_n, share = 23.9, applied.product.n_fraction
    if run.meta is not None and run.meta.crop is not None:
        grain_n = Crop.model_validate(run.meta.crop).grain_n_kg_t
    return FieldTrial(tuple(found), hz, share, grain_n)


class _HeadReadings(NamedTuple):
    """Holds the fused readings of the heads at the ground that they view: values (n,), positions
    (n, 2) in longitude and latitude."""

    values: Array
    at: Array

    def select_within(self, outline: Any) -> Array:
        """Returns the values within an outline (k,)."""
        return np.asarray(self.values[shapely.contains_xy(outline, self.at[:, 0], self.at[:, 1])])


def _find_head_readings(log: RunLog, machine: Machine) -> tuple[_HeadReadings, float]:
    """Returns the mean of each new reading of the heads once, with the position that they view, and
    the rate of readings, 1/s. Raises TrialError."""
    columns = [name for names in (HEAD_COLUMNS, NDRE_COLUMNS) for name in names if log.has(name)]
    # Fused readings replace single heads where a log has only them.
    if not columns:
        columns = [name for name in ("ndvi", "ndre") if log.has(name)]
    if not columns:
        raise TrialError(
            f"{log.path}: no canopy readings (ndvi_1 to ndvi_6, or ndvi): allowed is a log "
            "that has some"
        )
    heads = np.column_stack([log.numbers(name) for name in columns])
    some = np.isfinite(heads).any(axis=1)
    # Heads repeat their reading until the next reading arrives.
    new = some & np.concatenate(([True], np.any(heads[1:] != heads[:-1], axis=1)))
    # The place that the heads view is ahead of the outlets along the heading.
    plane, way, heading = find_outlet_way(log, machine)
    ahead = np.radians(heading)
    places = way + machine.geometry.heads_m * np.column_stack((np.sin(ahead), np.cos(ahead)))
    if new.sum() < 2:
        raise TrialError(f"{log.path}: fewer than two canopy readings: allowed are more")
    hz = 1.0 / float(np.median(np.diff(log.time_s[new])))
    at = np.array([plane.convert_to_deg(east, north)[::-1] for east, north in places[new].tolist()])
    return _HeadReadings(np.nanmean(heads[new], axis=1), at), hz


def _calc_area_m2(outline: Any) -> float:
    """Returns an outline's area, m2."""
    middle = outline.centroid
    # A plane in the middle of the plot has the smallest distortion.
    plane = TangentPlane(float(middle.y), float(middle.x))
    return float(
        shapely.transform(outline, lambda at: plane.project_many_to_m(at[:, 1], at[:, 0])).area
    )
