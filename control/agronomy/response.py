"""The response index of a field as its authors at Oklahoma State define it, and what of it can be believed.

RI = NDVI of the N-rich strip over NDVI of the farmer check, one figure for the field and the day (Mullen et al. 2003,
Agron. J. 95:347-351; nue.okstate.edu/NLS/NLS_Non_N_Limiting_Strip.htm). The farmer check is a strip that got what the
field got. The paper of the Huanghai machine divides by the NDVI of each place instead (`noa.response_index`, eq 5):
there a thin place counts as one that answers to nitrogen.
"""
from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from control.agronomy.strips import Strips, measured_index

ResponseRule = Literal["paper", "field"]


class HarvestLine(BaseModel):
    """What the response of the yield is, from that of the canopy: slope x RI + intercept.

    OSU's calculators use 1.64 RI - 0.53 (RI of harvest over RI of NDVI, after Mullen et al. 2003). Without a line the
    canopy's own index counts, as on the page above.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    slope: float = Field(gt=0.0, le=5.0)
    intercept: float = Field(ge=-3.0, le=3.0)

    @model_validator(mode="after")
    def _no_response_stays_none(self) -> Self:
        at_one = self.slope + self.intercept
        if not 0.8 <= at_one <= 1.3:
            raise ValueError(f"slope {self.slope:g} and intercept {self.intercept:g}: RI 1 becomes {at_one:g}: allowed "
                             "is 0.8 to 1.3 (OSU: slope 1.64, intercept -0.53)")
        return self


def field_response(strips: Strips, cap: float, line: HarvestLine | None) -> float | None:
    """RI of the field as the yield with topdressing is computed with, at most `cap`; None where a strip is missing."""
    index = measured_index(strips)
    if index is None:
        return None
    return min(index if line is None else line.slope * index + line.intercept, cap)
