"""How does a crop turn NDVI into a rate of product, and within which limits? The crop file."""

from __future__ import annotations

import datetime as dt
import math
from typing import Literal, Self

from pydantic import Field, model_validator
from topdress.control.agronomy.growth_stage import GrowthWindow
from topdress.control.agronomy.nitrogen_response import HarvestLine, ResponseRule
from topdress.control.agronomy.yield_potential import YieldPotential, describe_day_rule
from topdress.control.frozen_model import FrozenModel

# This line leaves the response index of the canopy as it is.
IDENTITY_LINE = HarvestLine(slope=1.0, intercept=0.0)


class GrowingDays(FrozenModel):
    """Holds the growing days, D of paper A, eq 4: days from sowing to sensing whose mean
    temperature is above the crop's base temperature.

    Either counted by hand (`count` with the base it was counted over, `above_c`), or counted
    from a weather file (`weather` with `sown`, and `sensed` where it is not the day of work).
    Where the curve counts every day: `count` alone, or `sown` alone."""

    count: int | None = Field(default=None, ge=1, le=400, strict=True)
    above_c: float | None = Field(
        default=None, ge=-5.0, le=15.0, description="base the days were counted over"
    )
    weather: str | None = Field(
        default=None, min_length=1, description="CSV of daily temperatures, next to this file"
    )
    sown: dt.date | None = None
    sensed: dt.date | None = None

    @model_validator(mode="after")
    def _check_one_source(self) -> Self:
        # Two sources of the days could contradict each other without anyone noticing.
        if self.count is not None and self.weather is not None:
            raise ValueError("allowed is one of count (with above_c) and weather (with sown)")
        if self.count is None and self.sown is None:
            raise ValueError(
                "sown missing: a weather file needs the date of sowing, e.g. 2013-11-01"
                if self.weather is not None
                else "allowed is one of count (with above_c) and weather (with sown)"
            )
        if self.count is not None and (self.sown is not None or self.sensed is not None):
            raise ValueError("sown and sensed go with weather, not with count")
        if self.weather is not None and self.above_c is not None:
            raise ValueError(
                # The base temperature of a weather file is the crop's own, so a second value would
                # be ignored.
                "above_c goes with count: a weather file is counted over the crop's own base_temp_c"
            )
        if self.sown is not None and self.sensed is not None and self.sensed <= self.sown:
            raise ValueError(f"sensed {self.sensed} is not after sown {self.sown}")
        return self

    def find_mismatch(self, curve: YieldPotential) -> str:
        """Returns why these days do not fit the yield curve's own day rule, in one line.

        Returns
        -------
        An empty string where they fit."""
        rule = describe_day_rule(curve.base_temp_c)
        # A curve over all days depends on no temperature.
        if curve.base_temp_c == "every_day":
            if self.above_c is not None:
                return (
                    f"days.above_c {self.above_c:g}: the yield curve counts {rule}: leave "
                    "the key out"
                )
            return (
                ""
                if self.weather is None
                else f"days.weather: the yield curve counts {rule}: it needs no weather"
            )
        if self.count is not None and self.above_c is None:
            return "above_c missing: say over which base temperature the days were counted"
        if self.count is None and self.weather is None:
            return (
                f"days: sown without weather: the yield curve counts {rule}, which a "
                "weather file tells"
            )
        # Days over another base give another INSEY, and the curve would not apply.
        if self.above_c is not None and self.above_c != curve.base_temp_c:
            return (
                f"days.above_c {self.above_c:g}: the yield curve's own rule is {rule}; "
                "count the days again"
            )
        return ""


class Crop(FrozenModel):
    """Crop file "topdress-crop/1". Rates are kg of product per ha, yields t of grain per ha.

    Its rule is one of two: a yield curve (`yield_potential`, with `days` and `y_max_t_ha`), or
    the sufficiency index (`sufficiency`), which needs none of those.
    """

    format: Literal["topdress-crop/1"]
    id: str = Field(pattern=r"^[a-z][a-z0-9_]*$")
    name: str = Field(min_length=1)
    note: str = Field(default="", description="where the figures come from")
    flag: str = Field(default="", description="what the operator must know before using this crop")
    examples: tuple[str, ...] = Field(
        default=(), max_length=100, description="keys whose values are examples, to be replaced"
    )

    index: Literal["ndvi", "ndre"] = Field(
        default="ndvi",
        description="what the heads are to read; ndre (red edge) "
        "for dense canopies, with a curve of its own",
    )
    yield_potential: YieldPotential | None = Field(
        default=None,
        description="the yield without topdressing from the reading; or else sufficiency",
    )
    days: GrowingDays | None = Field(
        default=None, description="of growth, by the yield curve's own rule"
    )
    sufficiency: Sufficiency | None = Field(
        default=None,
        description="nitrogen from how far a place is behind the "
        "N-rich strip; in the place of yield_potential",
    )
    growth_window: GrowthWindow | None = Field(
        default=None, description="stages for which the rule was made; work outside is warned of"
    )
    y_max_t_ha: float | None = Field(
        default=None,
        gt=0.0,
        le=20.0,
        description="no yield is assumed beyond this (eq 5); with a yield curve it must be said",
    )
    fixed_yield_t_ha: float | None = Field(
        default=None,
        gt=0.0,
        le=20.0,
        description="yield with topdressing, where no N-rich strip was sown",
    )
    ndvi_nrich: float | None = Field(
        default=None, gt=0.0, le=1.0, description="NDVI of the N-rich strip"
    )
    ndvi_check: float | None = Field(
        default=None,
        gt=0.0,
        le=1.0,
        description="NDVI of the farmer check: a strip that got what the field got",
    )
    response_index: ResponseRule = Field(
        default="paper",
        description="paper: N-rich strip over the NDVI of each place "
        "(eq 5); field: N-rich strip over farmer check, once a field (Oklahoma State)",
    )
    harvest_line: HarvestLine | None = Field(
        default=None,
        description="response of the yield from that of the "
        "canopy, with response_index field; a set brings its own",
    )
    response_index_max: float = Field(
        default=2.0, ge=1.0, le=2.0, description="cap of the canopy's RI (Oklahoma State: 2.0)"
    )
    yield_ceiling: Literal["y_max", "nrich"] = Field(
        default="y_max",
        description="nrich: no place is given more than "
        "the yield of the curve at the N-rich strip's own NDVI, as "
        "Oklahoma State's calculator has it; y_max: y_max_t_ha alone",
    )

    grain_n_kg_t: float = Field(default=23.9, ge=10.0, le=40.0, description="N in the grain (eq 2)")
    product: str = Field(default="urea", min_length=1)
    product_n_fraction: float = Field(
        default=0.45, ge=0.05, le=0.82, description="N in the product (eq 2)"
    )
    efficiency: float = Field(
        default=0.6, ge=0.5, le=0.7, description="share of the applied N taken up, eta of eq 2"
    )

    ndvi_min: float = Field(default=0.25, ge=0.0, le=0.9, description="no rate below: bare soil")
    ndvi_max: float | None = Field(
        default=None,
        ge=0.1,
        le=1.0,
        description="no rate above: dense canopy (Chen et "
        "al.: 0.75); none: no such limit (Oklahoma State)",
    )
    taper_ndvi: float = Field(
        default=0.0,
        ge=0.0,
        le=0.3,
        description="inside both ends of ndvi_min to ndvi_max the "
        "rate comes and goes over this span of NDVI; 0: in a step",
    )
    grades: bool = Field(
        default=False,
        description="the paper's rule: rate in steps of NDVI, each taken at its upper edge",
    )
    grade_width: float = Field(default=0.05, ge=0.005, le=0.5)

    fallback_rate_kg_ha: float = Field(
        ge=0.0, le=2000.0, description="where there is no canopy reading"
    )
    min_rate_kg_ha: float = Field(
        default=0.0,
        ge=0.0,
        le=2000.0,
        description="of the rule, from ndvi_min to ndvi_max: "
        "no place there gets less, but within taper_ndvi; 0: none",
    )
    max_rate_kg_ha: float = Field(gt=0.0, le=2000.0, description="absolute limit of the product")

    @model_validator(mode="after")
    def _check_one_rule(self) -> Self:
        # These keys belong to the yield curve and have no meaning for the sufficiency index.
        of_yield = {
            "days": self.days,
            "y_max_t_ha": self.y_max_t_ha,
            "fixed_yield_t_ha": self.fixed_yield_t_ha,
            "harvest_line": self.harvest_line,
        }
        if self.sufficiency is not None:
            too_many = [
                key for key in ("yield_potential", *of_yield) if getattr(self, key) is not None
            ]
            too_many += [
                f"{key}: {value}"
                for key, value, only in (
                    ("response_index", self.response_index, "paper"),
                    ("yield_ceiling", self.yield_ceiling, "y_max"),
                )
                # A key at its default was probably not written by the user.
                if value != only
            ]
            if too_many:
                raise ValueError(
                    f"{', '.join(too_many)}: goes with yield_potential, not with sufficiency"
                )
            return self
        missing = [
            key for key in ("yield_potential", "days", "y_max_t_ha") if getattr(self, key) is None
        ]
        if missing:
            raise ValueError(
                f"{', '.join(missing)} missing: allowed is a yield curve with "
                "yield_potential, days and "
                "y_max_t_ha, or sufficiency"
            )
        return self

    @model_validator(mode="after")
    def _check_yield_curve(self) -> Self:
        curve = self.yield_potential
        if curve is None or self.days is None:
            return self
        # A curve of NDVI gives wrong yields from NDRE readings.
        if self.index == "ndre" and curve.set is not None:
            raise ValueError(
                f"index ndre: yield_potential.set {curve.set} was published for NDVI: write "
                "out a_t_ha, "
                "b_days, base_temp_c and source of a curve over NDRE, or take sufficiency"
            )
        # Some published sets hold for one crop only.
        if curve.only_crop and self.id != curve.only_crop:
            raise ValueError(
                f"yield_potential.set {curve.set} belongs to crop {curve.only_crop} alone: "
                f"{curve.warning}"
            )
        if curve.warning and not self.flag:
            # The operator must see the warning, so the file must carry it.
            raise ValueError(f"flag missing: set {curve.set} needs one, because {curve.warning}")
        fault = self.days.find_mismatch(curve)
        if fault:
            raise ValueError(fault)
        own = self.harvest_line
        if (
            curve.set is not None
            and own is not None
            # A set comes with its own line; another line would mix two publications.
            and own not in (curve.response_line, IDENTITY_LINE)
        ):
            raise ValueError(
                f"harvest_line: {own}: the row of set {curve.set} has "
                f"{curve.response_line or 'none'}: leave the "
                "key out, or say slope 1, intercept 0 for the canopy's own index"
            )
        return self

    @model_validator(mode="after")
    def _check_consistency(self) -> Self:
        # NDRE has another range, so the default of NDVI would cut off real canopies.
        if self.index == "ndre" and "ndvi_min" not in self.model_fields_set:
            raise ValueError("index ndre: ndvi_min missing: its default, 0.25, is one of NDVI")
        fixed, most = self.fixed_yield_t_ha, self.y_max_t_ha
        if fixed is not None and most is not None and fixed > most:
            raise ValueError(f"fixed_yield_t_ha {fixed:g}: allowed is at most y_max_t_ha {most:g}")
        # A fallback or lowest rate above the limit could never be applied.
        for key in ("fallback_rate_kg_ha", "min_rate_kg_ha"):
            if getattr(self, key) > self.max_rate_kg_ha:
                raise ValueError(
                    f"{key} {getattr(self, key):g}: allowed is at most max_rate_kg_ha "
                    f"{self.max_rate_kg_ha:g}"
                )
        unknown = [key for key in self.examples if key not in type(self).model_fields]
        if unknown:
            raise ValueError(f"examples {', '.join(unknown)}: no such key")
        return self

    @model_validator(mode="after")
    def _check_ndvi_range(self) -> Self:
        top = self.ndvi_top
        if self.ndvi_min >= top:
            raise ValueError(f"ndvi_min {self.ndvi_min:g}: allowed is below ndvi_max {top:g}")
        if self.grades and self.ndvi_max is None:
            raise ValueError("ndvi_max missing: grades need an upper end (Chen et al.: 0.75)")
        # Grades must end exactly at the upper end, otherwise the last grade would be cut.
        steps = (top - self.ndvi_min) / self.grade_width
        if self.grades and abs(steps - round(steps)) > 1e-6:
            raise ValueError(
                f"grade_width {self.grade_width:g}: allowed is a whole part of the span "
                f"{self.ndvi_min:g} to {top:g}"
            )
        # A taper would replace the steps that grades are.
        if self.grades and self.taper_ndvi > 0.0:
            raise ValueError(
                f"taper_ndvi {self.taper_ndvi:g}: allowed is 0 with grades, which are steps"
            )
        # Tapers that overlap would leave no NDVI with the full rate; 1e-9 allows rounding.
        if 2.0 * self.taper_ndvi > top - self.ndvi_min + 1e-9:
            raise ValueError(
                f"taper_ndvi {self.taper_ndvi:g}: allowed is at most half of the span "
                f"{self.ndvi_min:g} to {top:g}"
            )
        if self.harvest_line is not None and self.response_index != "field":
            raise ValueError("harvest_line goes with response_index: field")
        return self

    def limit_rates(self, rate_kg_ha: float) -> Crop:
        """Returns the crop with its rates limited to `rate_kg_ha`, where its own limits are
        higher."""
        # All three keys are lowered, because the check above requires their order.
        keys = ("max_rate_kg_ha", "fallback_rate_kg_ha", "min_rate_kg_ha")
        return self.model_copy(update={key: min(getattr(self, key), rate_kg_ha) for key in keys})

    @property
    def ndvi_top(self) -> float:
        """Returns the highest NDVI that gets a rate."""
        return 1.0 if self.ndvi_max is None else self.ndvi_max

    @property
    def response_line(self) -> HarvestLine | None:
        """Returns the line from the canopy's response index to that of the harvest: the file's
        own, else that of its published set."""
        if self.harvest_line is not None or self.yield_potential is None:
            return self.harvest_line
        return self.yield_potential.response_line

    @property
    def warnings(self) -> tuple[str, ...]:
        """Returns the warnings to show before work starts, one line each."""
        lines = [self.flag, "" if self.yield_potential is None else self.yield_potential.warning]
        if self.examples:
            lines.append(f"example values, not of this field: {', '.join(self.examples)}")
        # A file that does not name the key gets the present default, which older versions did not
        # have.
        if "grades" not in self.model_fields_set:
            lines.append(
                "grades is not said: the rate follows NDVI smoothly; grades: true gives the "
                "steps of older "
                "versions"
            )
        if "ndvi_max" not in self.model_fields_set:
            lines.append(
                "ndvi_max is not said: dense canopies get what the rule gives; ndvi_max: "
                "0.75 gives them "
                "nothing, as older versions did"
            )
        if (
            self.harvest_line == IDENTITY_LINE
            and self.yield_potential is not None
            and self.yield_potential.response_line
        ):
            lines.append(
                f"harvest_line 1, 0: the canopy's own response index counts, not the line of set "
                f"{self.yield_potential.set}"
            )
        return tuple(line for line in lines if line)


# A rate from the sufficiency index: how far a place is behind the strip that lacks nothing. SI
# = reading of the place over reading of the N-rich strip, by whatever index the heads read. The
# crop's response to nitrogen is a quadratic with a plateau; turned round, N = N_opt sqrt((1 -
# SI) / delta_SI), where delta_SI = 1 - SI of a crop that got none. Form: Holland and Schepers
# 2010, Agron. J. 102:1415-1424, as teaching notes that cite it have it (University of Novi Sad,
# 2022); the paper itself, with its coefficients for one index or another, could not be read
# here, nor that of Solari et al. 2010 (Agron. J. 102:1090-1098). So nothing is preset: N_opt
# and delta_SI belong to a crop, an index and a stage, and a crop file that uses this rule says
# its own, with their source.
class Sufficiency(FrozenModel):
    """Holds the two coefficients of the sufficiency curve, from one source, over the crop file's
    own index."""

    n_opt_kg_ha: float = Field(
        gt=0.0,
        le=400.0,
        description="N, not product: what a place with SI 1 - delta_si gets; "
        "what a job's nitrogen keys say was given and is credited comes off it",
    )
    delta_si: float = Field(
        gt=0.01, lt=1.0, description="1 - SI of a crop that got no N, over this index"
    )
    source: str = Field(
        min_length=8, description="where both were published, for this crop and index"
    )

    def find_n_rate_kg_ha(
        self, si: float, zone_factor: float = 1.0, less_n_kg_ha: float = 0.0
    ) -> float:
        """Returns the nitrogen rate, kg/ha: none from an index of 1 on, at most the optimum
        below 1 - delta_si.

        Parameters
        ----------
        si : sufficiency index of the place.
        zone_factor : factor on the optimum at this place.
        less_n_kg_ha : nitrogen that was given before or is credited, kg/ha; it is subtracted."""
        # Nitrogen that the crop already received is subtracted from the optimum before the curve is
        # applied.
        optimum = max(0.0, self.n_opt_kg_ha * zone_factor - less_n_kg_ha)
        # The index can be above 1 on noise, and the root needs a value between 0 and 1.
        return optimum * math.sqrt(min(1.0, max(0.0, (1.0 - si) / self.delta_si)))
