"""Parts of a picture that runs and tables share: binned residuals before and after, a smooth
line, legends."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from console.reports.binned import Axis, Binned
from console.reports.figure import AFTER, BEFORE, DIM, PAPER, THIRD

Array = npt.NDArray[np.float64]

NOMINAL, EXTENDED, MEASURED = "nominal machine", "with the causes", "measured"
# in place of the nominal machine, where there are several: each shows its own
OTHERS = "with the other causes"
# of a smooth nameless dependence, as in the machine model's own tables
HALF_WAVES = 4


def residual_panel(
    axes: Any, axis: Axis, before: Binned, after: Binned | None, unit: str, first: str = NOMINAL
) -> None:
    """Means before (hollow, dashed; `first` says of what) and after (filled) over an axis, with
    bands of 90 %; None: nothing is named."""
    series = [(before, BEFORE, "o", "--", first, -1.0)]
    if after is not None:
        series.append((after, AFTER, "s", "-", EXTENDED, 1.0))
    zero_line(axes)
    for means, colour, marker, line, label, side in series:
        if axis.names:
            at = means.at + (0.12 * side if after is not None else 0.0)
            axes.errorbar(
                at,
                means.mean,
                yerr=means.half,
                color=colour,
                marker=marker,
                linestyle="none",
                capsize=3,
                markerfacecolor=PAPER if side < 0 else colour,
                label=label,
            )
        else:
            _banded(axes, means, colour, marker, line, label, hollow=side < 0)
    if axis.names:
        axes.set_xticks(range(len(axis.names)), axis.names)
        axes.set_xlim(-0.6, len(axis.names) - 0.4)
        axes.grid(False, axis="x")
    axes.set(xlabel=axis.label, ylabel=f"residual, {unit}")


def _banded(
    axes: Any, means: Binned, colour: str, marker: str, line: str, label: str, hollow: bool
) -> None:
    axes.fill_between(
        means.at,
        means.mean - means.half,
        means.mean + means.half,
        color=colour,
        alpha=0.22,
        linewidth=0,
    )
    axes.plot(
        means.at,
        means.mean,
        color=colour,
        marker=marker,
        linestyle=line,
        linewidth=1.4,
        markersize=4.5,
        markerfacecolor=PAPER if hollow else colour,
        label=label,
    )


def zero_line(axes: Any) -> None:
    axes.axhline(0.0, color=DIM, linewidth=0.9)


def legend_below(figure: Any, axes: Any) -> None:
    """One legend for the whole picture, below it; what has the same name stands there once."""
    known: dict[str, Any] = {}
    for one in np.ravel(np.array(axes, object)):
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            known.setdefault(label, handle)
    figure.legend(list(known.values()), list(known), loc="outside lower center", ncols=4)


def smooth_line(axes: Any, at: Array, values: Array) -> None:
    """Least-squares half-waves over the range of `at`: what the machine model would take up
    without a name for it."""
    low, high = (
        np.percentile(at, (1.0, 99.0)) if len(at) > 200 else (float(at.min()), float(at.max()))
    )
    if not high > low:
        return

    def waves(x: Array) -> Array:
        share = np.clip((x - low) / (high - low), 0.0, 1.0)
        count = min(HALF_WAVES, max(1, len(np.unique(at)) - 2))
        return np.array([np.cos(np.pi * k * share) for k in range(count + 1)]).T

    weights, *_ = np.linalg.lstsq(waves(at), values, rcond=None)
    fine = np.linspace(low, high, 120)
    axes.plot(fine, waves(fine) @ weights, color=THIRD, linewidth=2.2, label="smooth function")
