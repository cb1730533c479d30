"""Which parts of pictures do runs and tables share? They are binned residuals before and after, a
smooth line, and legends.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from topdress.console.reports.binned_means import BinnedMeans, ResidualAxis
from topdress.console.reports.chart import (
    AFTER_COLOUR,
    BEFORE_COLOUR,
    PAPER_COLOUR,
    THIRD_COLOUR,
    ChartPanel,
)

Array = npt.NDArray[np.float64]

NOMINAL_LABEL, EXTENDED_LABEL, MEASURED_LABEL = "nominal machine", "with the causes", "measured"
# Legend in place of the nominal machine if several causes exist, because each picture shows its own
# cause.
OTHER_CAUSES_LABEL = "with the other causes"
# Number of half-waves of a smooth dependence without a name, as in the machine model's tables.
HALF_WAVE_COUNT = 4


def draw_residual_panel(
    panel: ChartPanel,
    axis: ResidualAxis,
    before: BinnedMeans,
    after: BinnedMeans | None,
    unit: str,
    first: str = NOMINAL_LABEL,
) -> None:
    """Draws means before (hollow, dashed; `first` names their machine) and after (filled) over an
    axis, with 90 % bands. None omits a part."""
    series = [(before, BEFORE_COLOUR, "o", "--", first, -1.0)]
    if after is not None:
        series.append((after, AFTER_COLOUR, "s", "-", EXTENDED_LABEL, 1.0))
    panel.draw_level(0.0)
    for means, colour, marker, line, label, side in series:
        if axis.names:
            at = means.at + (0.12 * side if after is not None else 0.0)
            panel.plot_intervals(
                at,
                means.mean,
                means.half,
                colour,
                label=label,
                marker=marker,
                fill=PAPER_COLOUR if side < 0 else colour,
            )
        else:
            _draw_means(panel, means, colour, marker, line, label, hollow=side < 0)
    if axis.names:
        panel.x_names = tuple((float(k), name) for k, name in enumerate(axis.names))
        panel.x_ends = -0.6, len(axis.names) - 0.4
    panel.label(axis.label, f"residual, {unit}")


def _draw_means(
    panel: ChartPanel,
    means: BinnedMeans,
    colour: str,
    marker: str,
    dash: str,
    label: str,
    hollow: bool,
) -> None:
    panel.fill_between(means.at, means.mean - means.half, means.mean + means.half, colour)
    panel.plot(
        means.at,
        means.mean,
        colour,
        label=label,
        dash=dash,
        width=1.4,
        marker=marker,
        size=4.5,
        fill=PAPER_COLOUR if hollow else colour,
    )


def draw_smooth_line(panel: ChartPanel, at: Array, values: Array) -> None:
    """Draws least-squares half-waves over the range of `at`: the smooth function that the machine
    model would adopt without a name."""
    low, high = (
        np.percentile(at, (1.0, 99.0)) if len(at) > 200 else (float(at.min()), float(at.max()))
    )
    if not high > low:
        return

    def make_half_waves(x: Array) -> Array:
        share = np.clip((x - low) / (high - low), 0.0, 1.0)
        count = min(HALF_WAVE_COUNT, max(1, len(np.unique(at)) - 2))
        return np.array([np.cos(np.pi * k * share) for k in range(count + 1)]).T

    weights, *_ = np.linalg.lstsq(make_half_waves(at), values, rcond=None)
    fine = np.linspace(low, high, 120)
    panel.plot(
        fine, make_half_waves(fine) @ weights, THIRD_COLOUR, width=2.2, label="smooth function"
    )
