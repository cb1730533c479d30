"""The response index of a field as its authors at Oklahoma State define it, and what of it can be believed.

RI = NDVI of the N-rich strip over NDVI of the farmer check, one figure for the field and the day (Mullen et al. 2003,
Agron. J. 95:347-351; nue.okstate.edu/NLS/NLS_Non_N_Limiting_Strip.htm). The farmer check is a strip that got what the
field got. The paper of the Huanghai machine divides by the NDVI of each place instead (`noa.response_index`, eq 5):
there a thin place counts as one that answers to nitrogen.
"""
from __future__ import annotations

import math
from typing import Literal, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

ResponseRule = Literal["paper", "field"]
Doubt = Literal["", "below_1", "above_3"]

NO_RESPONSE = 1.0           # a strip that got more nitrogen and is no greener: the crop has enough
HIGHEST_BELIEVED = 3.0      # beyond it a strip was driven over soil or weeds, or the two on different days


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


class Strips(NamedTuple):
    """NDVI of the two strips, as far as they are known; of the newest pass over them."""

    nrich: float | None = None
    check: float | None = None


def measured_index(strips: Strips) -> float | None:
    """N-rich over farmer check, neither capped nor lined; None where a strip is missing."""
    if strips.nrich is None or strips.check is None:
        return None
    return strips.nrich / strips.check


def field_response(strips: Strips, cap: float, line: HarvestLine | None) -> float | None:
    """RI of the field as the yield with topdressing is computed with, at most `cap`; None where a strip is missing."""
    index = measured_index(strips)
    if index is None:
        return None
    return min(index if line is None else line.slope * index + line.intercept, cap)


def doubt(strips: Strips) -> Doubt:
    """Why the measured index is not to be believed as it stands; "" where nothing speaks against it."""
    index = measured_index(strips)
    if index is None or NO_RESPONSE <= index <= HIGHEST_BELIEVED:
        return ""
    return "below_1" if index < NO_RESPONSE else "above_3"


class StripValue(NamedTuple):
    """A strip as it was measured: `se` is the standard error of the mean, `samples` how many readings it rests on."""

    which: Literal["nrich", "check"]
    ndvi: float
    se: float | None = None
    samples: int = 0

    @property
    def text(self) -> str:
        """As an order and a log's event say it: `nrich 0.712 0.0041 38`."""
        more = "" if self.se is None else f" {self.se:.4f} {self.samples}"
        return f"{self.which} {self.ndvi:.4f}{more}"


def read_strip(text: object) -> StripValue | None:
    """What `StripValue.text` says; None where it says nothing that can be used: NDVI in (0, 1]."""
    words = text.split() if isinstance(text, str) else []
    if len(words) not in (2, 4) or words[0] not in ("nrich", "check"):
        return None
    try:
        ndvi = float(words[1])
        se = float(words[2]) if len(words) == 4 else None
        samples = int(words[3]) if len(words) == 4 else 0
    except ValueError:
        return None
    if not 0.0 < ndvi <= 1.0 or samples < 0 or (se is not None and not (math.isfinite(se) and se >= 0.0)):
        return None
    return StripValue("nrich" if words[0] == "nrich" else "check", ndvi, se, samples)
