"""A rate from the sufficiency index: how far a place is behind the strip that lacks nothing.

SI = reading of the place over reading of the N-rich strip, by whatever index the heads read. The crop's response to
nitrogen is a quadratic with a plateau; turned round, N = N_opt sqrt((1 - SI) / delta_SI), where delta_SI = 1 - SI of a
crop that got none. Form: Holland and Schepers 2010, Agron. J. 102:1415-1424, as teaching notes that cite it have it
(University of Novi Sad, 2022); the paper itself, with its coefficients for one index or another, could not be read
here, nor that of Solari et al. 2010 (Agron. J. 102:1090-1098). So nothing is preset: N_opt and delta_SI belong to a
crop, an index and a stage, and a crop file that uses this rule says its own, with their source.
"""
from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict, Field


class Sufficiency(BaseModel):
    """The two coefficients of the curve, from one source, over the crop file's own index."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    n_opt_kg_ha: float = Field(gt=0.0, le=400.0, description="N, not product: what a place with SI 1 - delta_si gets; "
                               "what a job's nitrogen keys say was given and is credited comes off it")
    delta_si: float = Field(gt=0.01, lt=1.0, description="1 - SI of a crop that got no N, over this index")
    source: str = Field(min_length=8, description="where both were published, for this crop and index")

    def n_kg_ha(self, si: float, zone_factor: float = 1.0, less_n_kg_ha: float = 0.0) -> float:
        """N, kg/ha, from 0: none from SI 1 on, no more than the optimum below 1 - delta_si. zone_factor: of the optimum
        at this place; less_n_kg_ha: given and credited, off it."""
        optimum = max(0.0, self.n_opt_kg_ha * zone_factor - less_n_kg_ha)
        return optimum * math.sqrt(min(1.0, max(0.0, (1.0 - si) / self.delta_si)))
