"""Is the crop at the growth stage for which its rule was made? The answer is a warning, never a
stop.

A yield curve over NDVI was fitted at certain stages: OSU's wheat curves at Feekes 4 to 6
(nue.okstate.edu/NLS/ NLS_Non_N_Limiting_Strip.htm), best between 87 and 112 days above 4.4 degC
(nue.okstate.edu/GSchart.htm). Earlier the crop has not yet shown what it will be, later it has
closed and NDVI says little."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator
from topdress.control.frozen_model import FrozenModel

Scale = Literal["feekes", "bbch", "days"]
# Ends of the published scales: Feekes 1 to 11.4, BBCH 0 to 99; days as in the crop file.
GROWTH_SCALE_RANGES: dict[str, tuple[float, float]] = {
    "feekes": (1.0, 11.4),
    "bbch": (0.0, 99.0),
    "days": (1.0, 400.0),
}

# The widest range of the three scales.
Stage = Annotated[float, Field(ge=0, le=400)]


class GrowthWindow(FrozenModel):
    """Holds the growth stages between which the crop's rule holds. On the scale `days` they are
    counted as the rule counts them, above its base temperature."""

    scale: Scale
    first: Stage
    last: Stage
    source: str = Field(default="", description="who says so")

    @model_validator(mode="after")
    def _check_scale(self) -> Self:
        low, high = GROWTH_SCALE_RANGES[self.scale]
        if not low <= self.first <= self.last <= high:
            raise ValueError(
                f"first {self.first:g} and last {self.last:g}: allowed is {low:g} to "
                f"{high:g} on the "
                f"scale {self.scale}, first not after last"
            )
        return self


class GrowthStage(FrozenModel):
    """Holds the crop's growth stage on the day of work, as a person saw it."""

    scale: Literal["feekes", "bbch"]
    stage: Stage

    @model_validator(mode="after")
    def _check_scale(self) -> Self:
        low, high = GROWTH_SCALE_RANGES[self.scale]
        if not low <= self.stage <= high:
            raise ValueError(
                f"stage {self.stage:g}: allowed is {low:g} to {high:g} on the scale {self.scale}"
            )
        return self


class GrowthStageComparison(NamedTuple):
    """Compares the stage of the crop with the window of its rule, on the window's scale. The
    stage is None where it is not known."""

    scale: Scale
    first: float
    last: float
    stage: float | None

    @property
    def is_outside(self) -> bool:
        """Returns whether the known stage lies outside the window."""
        return self.stage is not None and not self.first <= self.stage <= self.last

    @property
    def event_text(self) -> str:
        """Returns the words of a log's event: `feekes 8 (4 to 6)`."""
        stage = "?" if self.stage is None else f"{self.stage:g}"
        return f"{self.scale} {stage} ({self.first:g} to {self.last:g})"


def assess_growth(
    window: GrowthWindow | None, seen: GrowthStage | None, days: int | None
) -> GrowthStageComparison | None:
    """Returns the stage on the scale of the window; None where the crop file has no window.

    Parameters
    ----------
    window : of the crop file.
    seen : stage that a person saw; on another scale than the window's it counts as unknown.
    days : growing days, as the yield curve counts them."""
    if window is None:
        return None
    # A stage on another scale cannot be converted without knowing the crop.
    stage = None
    if window.scale == "days":
        stage = None if days is None else float(days)
    elif seen is not None and seen.scale == window.scale:
        stage = seen.stage
    return GrowthStageComparison(window.scale, window.first, window.last, stage)
