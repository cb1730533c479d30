"""How strongly does a field respond to nitrogen, and how far can its response index be trusted?
The definition of its authors at Oklahoma State.

RI = NDVI of the N-rich strip over NDVI of the farmer check, one figure for the field and the
day (Mullen et al. 2003, Agron. J. 95:347-351;
nue.okstate.edu/NLS/NLS_Non_N_Limiting_Strip.htm). The farmer check is a strip that got what the
field got. The paper of the Huanghai machine divides by the NDVI of each place instead
(`calc_response_index`, eq 5): there a thin place counts as one that answers to nitrogen."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator
from topdress.control.agronomy.reference_strips import ReferenceStrips, calc_measured_index
from topdress.control.frozen_model import FrozenModel

ResponseRule = Literal["paper", "field"]


class HarvestLine(FrozenModel):
    """Converts the response index of the canopy to that of the harvest: slope x RI + intercept.

    Oklahoma State's table of equations has such a line for some crops and years only
    (nue.okstate.edu/Yield_Potential.htm): 1.69 RI - 0.70 for wheat from 2005 on and durum, 1.64
    RI - 0.5287 for corn of 2004. `yield_potential` fixes which line belongs to which crop.
    Without a line the index of the canopy is used, as on the page above."""

    slope: float = Field(gt=0.0, le=5.0)
    intercept: float = Field(ge=-3.0, le=3.0)

    def __str__(self) -> str:
        return f"slope {self.slope:g}, intercept {self.intercept:g}"

    @model_validator(mode="after")
    def _check_fixed_point(self) -> Self:
        at_one = self.slope + self.intercept
        if not 0.8 <= at_one <= 1.3:
            raise ValueError(
                f"slope {self.slope:g} and intercept {self.intercept:g}: RI 1 becomes "
                f"{at_one:g}: allowed "
                "is 0.8 to 1.3 (OSU: wheat 1.69 and -0.70, corn 1.64 and -0.5287)"
            )
        return self


def calc_field_response(
    strips: ReferenceStrips, cap: float, line: HarvestLine | None
) -> float | None:
    """Returns the response index of the field that the yield with topdressing is calculated
    with; None where a strip is missing.

    Parameters
    ----------
    strips : NDVI of the N-rich strip and the farmer check.
    cap : highest response index of the canopy, before the line: "RI_NDVI cannot exceed 2.0"
        (nue.okstate.edu/ Managing_N_Fertilizer_NRS.htm).
    line : from the canopy's index to that of the harvest; None: the canopy's own."""
    index = calc_measured_index(strips)
    if index is None:
        return None
    index = min(index, cap)
    return index if line is None else line.slope * index + line.intercept
