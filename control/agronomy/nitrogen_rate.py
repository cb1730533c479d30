"""How much product does an NDVI ask for? The nitrogen optimisation algorithm of paper A, eq 2 to
5, in kg of product per ha.

Two forms: with the NDVI of an N-rich strip (response index), or with a fixed yield where no
strip was sown. The response index is that of each place (the paper) or that of the field (its
authors at Oklahoma State, `nitrogen_response`). Put right against the print: the rate is never
below zero (eq 2 gives -21.9 kg/ha at NDVI 0.75), the response index is capped, and no yield is
assumed beyond the crop's Y_max. A crop file may go by the sufficiency index instead
(`sufficiency`), without any yield.

`yield_ceiling: nrich` holds the yield with topdressing at that of the curve at the N-rich
strip's own NDVI: a place as green as the strip lacks nothing. So has Oklahoma State's own sheet
for variable rates, as `R/SBNRC_Algorithm.R` of github.com/beardon/ninja-active-mapper writes it
out ("from SBNRC NRate VRN equations excel sheet from Dr. Arnall"); a lowest rate of the rule
stands there too. Of Solie, Monroe, Raun and Stone 2012 ("Generalized Algorithm for
Variable-Rate Nitrogen Application in Cereal Grains") only the abstract could be read: their
curve is not here."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_response import ResponseRule, calc_field_response
from topdress.control.agronomy.reference_strips import ReferenceStrips, StripMean
from topdress.control.agronomy.yield_potential import YieldPotential

Why = Literal[
    "in_range",
    "no_ndvi",
    "no_strips",
    "below_cutoff",
    "above_cutoff",
    "yield_reached",
    "limited",
    "lowest",
    "no_zone",
]


class RateDecision(NamedTuple):
    """Holds a rate together with the numbers that it was calculated from.

    Yields in t/ha, capped at the crop's Y_max; None where a cut-off decided before they were
    needed."""

    # Rate of product, kg/ha, from 0 to the crop's max_rate_kg_ha.
    rate_kg_ha: float
    why: Why
    # Grade of the NDVI; None without grades.
    grade: int | None
    # Upper edge of the grade, or the NDVI itself.
    ndvi_used: float | None
    insey_per_day: float | None = None
    yield_without_t_ha: float | None = None
    yield_with_t_ha: float | None = None
    # None for the rule with a fixed yield.
    response_index: float | None = None
    # None for a rule with a yield curve.
    sufficiency_index: float | None = None


def calc_insey(ndvi: float, days: float) -> float:
    """Returns the in-season estimate of yield, NDVI per day (paper A, eq 4).

    Raises
    ------
    ValueError : `days` is not above 0."""
    if not days > 0.0:
        raise ValueError(f"days {days:g}: allowed is above 0")
    return ndvi / days


def calc_yield_without_t_ha(insey_per_day: float, a_t_ha: float, b_days: float) -> float:
    """Returns the yield without topdressing, a exp(b INSEY), t/ha (paper A, eq 3). It is not
    capped, and infinite where the exponent reaches 700."""
    exponent = b_days * insey_per_day
    # exp(700) is near the largest double; beyond it math.exp raises.
    return a_t_ha * math.exp(exponent) if exponent < 700.0 else math.inf


def calc_response_index(ndvi_nrich: float, ndvi_field: float, cap: float = 2.0) -> float:
    """Returns the NDVI of the N-rich strip divided by that of the field, at most `cap` (paper A,
    eq 5; cap: Raun et al. 2002).

    A field at NDVI 0 or below gives the cap."""
    # A reading of 0 or less is bare soil or an error and must not divide.
    if ndvi_field <= 0.0:
        return cap
    return min(ndvi_nrich / ndvi_field, cap)


def calc_requirement_kg_ha(
    yield_with_t_ha: float,
    yield_without_t_ha: float,
    grain_n_kg_t: float = 23.9,
    product_n_fraction: float = 0.45,
    efficiency: float = 0.6,
) -> float:
    """Returns the product needed for a higher yield, kg/ha (paper A, eq 2). As in print, it is
    negative where the yield with topdressing is the lower one."""
    return grain_n_kg_t * (yield_with_t_ha - yield_without_t_ha) / (product_n_fraction * efficiency)


def _name_cutoff(ndvi: float, crop: Crop) -> Why:
    return "above_cutoff" if ndvi > crop.ndvi_top else "below_cutoff"


@dataclass(frozen=True, slots=True)
class CropRule:
    """Holds a crop with days and strips fixed for one field, so that a decision needs only the
    NDVI."""

    crop: Crop
    # None for the sufficiency index.
    days: int | None
    # NDVI of the N-rich strip; None for the rule with a fixed yield.
    ndvi_nrich: float | None
    # NDVI of the farmer check, used by response rule "field".
    ndvi_check: float | None = None
    response_rule: ResponseRule = "paper"
    # Nitrogen since sowing, which the canopy shows: subtracted from the optimum of the sufficiency
    # index.
    n_given_kg_ha: float = 0.0
    # Nitrogen from other sources that the canopy does not show yet: subtracted from the rate of
    # either rule.
    n_credit_kg_ha: float = 0.0

    @property
    def strip_ndvi(self) -> ReferenceStrips:
        """Returns the NDVI of the two strips."""
        return ReferenceStrips(self.ndvi_nrich, self.ndvi_check)

    @property
    def response_of_field(self) -> float | None:
        """Returns the response index of the field; None by the paper's rule, or where a strip is
        missing."""
        if self.response_rule == "paper":
            return None
        return calc_field_response(
            self.strip_ndvi, self.crop.response_index_max, self.crop.response_line
        )

    @property
    def is_ready(self) -> bool:
        """Returns whether the rule can decide: with strips, or with the crop's fixed yield while
        there are none."""
        # A fixed yield needs no strip.
        if self.crop.fixed_yield_t_ha is not None:
            return True
        return (
            self.ndvi_nrich is not None
            if self.response_rule == "paper"
            else self.response_of_field is not None
        )

    def replace_strip(self, strip: StripMean) -> CropRule:
        """Returns the rule with a strip that was measured just now."""
        if strip.which == "nrich":
            return replace(self, ndvi_nrich=strip.ndvi)
        return replace(self, ndvi_check=strip.ndvi)

    def decide_rate(self, ndvi: float | None, zone_factor: float = 1.0) -> RateDecision:
        """Returns the rate for a canopy reading.

        Parameters
        ----------
        ndvi : of the canopy; None or not finite gives rate 0 with `why` "no_ndvi", and the
            caller takes the crop's fallback rate. A rule that waits for its strips gives 0 with
            "no_strips".
        zone_factor : factor on the rate at this place; 0 gives nothing, whatever the lowest
            rate."""
        crop = self.crop
        # A missing reading is no reading of zero: the caller applies the fallback rate.
        if ndvi is None or not math.isfinite(ndvi):
            return RateDecision(0.0, "no_ndvi", None, None)
        if not self.is_ready:
            return RateDecision(0.0, "no_strips", None, None)
        if not zone_factor > 0.0:
            return RateDecision(0.0, "no_zone", None, None)
        if not crop.grades:
            if crop.ndvi_min <= ndvi <= crop.ndvi_top:
                return self._taper_rate(self._decide_from_reading(ndvi, None, zone_factor), ndvi)
            return RateDecision(0.0, _name_cutoff(ndvi, crop), None, None)
        grade, used = grade_ndvi(ndvi, crop.ndvi_min, crop.ndvi_top, crop.grade_width)
        if used is None:
            # Grade 0 lies outside of the NDVI range.
            return RateDecision(0.0, _name_cutoff(ndvi, crop), 0, None)
        return self._decide_from_reading(used, grade, zone_factor)

    def _taper_rate(self, decision: RateDecision, ndvi: float) -> RateDecision:
        """Reduces the rate linearly to 0 over `taper_ndvi` at both ends of the NDVI range.

        Towards bare soil and towards a dense canopy a reading says less and less. In place of a
        step, which noise would cross again and again, the rate rises and falls gradually."""
        crop = self.crop
        if crop.taper_ndvi <= 0.0:
            return decision
        # The distance to the nearer end of the range sets the share.
        inside = ndvi - crop.ndvi_min
        if crop.ndvi_max is not None:
            inside = min(inside, crop.ndvi_max - ndvi)
        return decision._replace(
            rate_kg_ha=decision.rate_kg_ha * min(1.0, inside / crop.taper_ndvi)
        )

    def _decide_from_reading(
        self, ndvi: float, grade: int | None, zone_factor: float
    ) -> RateDecision:
        curve = self.crop.yield_potential
        if curve is None:
            return self._decide_from_sufficiency(ndvi, grade, zone_factor)
        return self._decide_from_yields(ndvi, grade, curve, zone_factor)

    def _decide_from_sufficiency(
        self, ndvi: float, grade: int | None, zone_factor: float
    ) -> RateDecision:
        crop, rich = self.crop, self.ndvi_nrich
        # The crop file's own check and is_ready guarantee these values.
        assert crop.sufficiency is not None and rich is not None
        index = ndvi / rich
        n_kg_ha = crop.sufficiency.find_n_rate_kg_ha(
            index, zone_factor, self.n_given_kg_ha + self.n_credit_kg_ha
        )
        rate, why = self._limit_need(n_kg_ha / crop.product_n_fraction)
        return RateDecision(rate, why, grade, ndvi, sufficiency_index=index)

    def _limit_need(self, need_kg_ha: float) -> tuple[float, Why]:
        least, most = self.crop.min_rate_kg_ha, self.crop.max_rate_kg_ha
        why: Why = "limited" if need_kg_ha > most else "in_range"
        # A need below the lowest rate is raised to it, and so is a need of 0 or less.
        if need_kg_ha <= 0.0 or need_kg_ha < least:
            why = "lowest" if least > 0.0 else "yield_reached"
        return min(max(need_kg_ha, least), most), why

    def _decide_from_yields(
        self, ndvi: float, grade: int | None, curve: YieldPotential, zone_factor: float
    ) -> RateDecision:
        crop, days, most = self.crop, self.days, self.crop.y_max_t_ha
        # `prepare_rule` and the crop file's own check guarantee these values.
        assert days is not None and most is not None
        index = calc_insey(ndvi, days)
        # No yield above Y_max is assumed, for either of both yields.
        without = min(calc_yield_without_t_ha(index, curve.a_t_ha, curve.b_days), most)
        if crop.yield_ceiling == "nrich" and self.ndvi_nrich is not None:
            most = min(
                most,
                calc_yield_without_t_ha(
                    calc_insey(self.ndvi_nrich, days), curve.a_t_ha, curve.b_days
                ),
            )
        response = self.response_of_field
        if self.response_rule == "paper" and self.ndvi_nrich is not None:
            response = calc_response_index(self.ndvi_nrich, ndvi, crop.response_index_max)
        if response is not None:
            wanted = without * response
        else:
            wanted = crop.fixed_yield_t_ha if crop.fixed_yield_t_ha is not None else 0.0
        with_n = min(wanted, most)
        need = calc_requirement_kg_ha(
            with_n, without, crop.grain_n_kg_t, crop.product_n_fraction, crop.efficiency
        )
        rate, why = self._limit_need(
            # Credited nitrogen becomes product before it is subtracted.
            need * zone_factor - self.n_credit_kg_ha / crop.product_n_fraction
        )
        return RateDecision(rate, why, grade, ndvi, index, without, with_n, response)


def prepare_rule(
    crop: Crop,
    days: int | None = None,
    ndvi_nrich: float | None = None,
    ndvi_check: float | None = None,
    response_rule: ResponseRule | None = None,
    n_given_kg_ha: float = 0.0,
    n_credit_kg_ha: float = 0.0,
) -> CropRule:
    """Returns the rule of a crop for one field. Arguments that are given override the crop
    file's own values.

    With an N-rich NDVI the response index decides, else the crop's fixed yield. With response
    rule "field" both strips may still be missing, and with the sufficiency index the N-rich
    strip: they are measured while driving.

    Parameters
    ----------
    crop : the crop file.
    days : growing days, 1 to 400; None: the crop file's own.
    ndvi_nrich, ndvi_check : NDVI of the N-rich strip and of the farmer check, in (0, 1].
    response_rule : "paper" or "field".
    n_given_kg_ha : nitrogen applied since sowing, kg/ha.
    n_credit_kg_ha : nitrogen from other sources that the canopy does not show yet, kg/ha.

    Raises
    ------
    ValueError : the days are not known yet (a weather file has to be counted first) or out of
        range, neither form is possible, or the NDVI of a strip is not in (0, 1]."""
    if crop.yield_potential is not None:
        days = _find_growing_days(crop, days)
    ndvi_nrich = ndvi_nrich if ndvi_nrich is not None else crop.ndvi_nrich
    ndvi_check = ndvi_check if ndvi_check is not None else crop.ndvi_check
    response_rule = response_rule or crop.response_index
    if crop.sufficiency is not None and response_rule != "paper":
        raise ValueError(
            f"crop {crop.id}: response_index field: goes with yield_potential, not with sufficiency"
        )
    # A rule by place decides at once and needs its strip or a fixed yield beforehand.
    by_place = crop.sufficiency is None and response_rule == "paper"
    if by_place and ndvi_nrich is None and crop.fixed_yield_t_ha is None:
        raise ValueError(
            f"crop {crop.id}: ndvi_nrich and fixed_yield_t_ha both missing: one is needed"
        )
    for name, ndvi in (("ndvi_nrich", ndvi_nrich), ("ndvi_check", ndvi_check)):
        if ndvi is not None and not 0.0 < ndvi <= 1.0:
            raise ValueError(f"crop {crop.id}: {name} {ndvi:g}: allowed is above 0, at most 1")
    return CropRule(
        crop,
        None if crop.yield_potential is None else days,
        ndvi_nrich,
        ndvi_check,
        response_rule,
        n_given_kg_ha,
        n_credit_kg_ha,
    )


def _find_growing_days(crop: Crop, counted: int | None) -> int:
    """Returns the growing days, as counted or from the crop file. Raises ValueError."""
    days = counted if counted is not None else None if crop.days is None else crop.days.count
    if days is None:
        source = (crop.days and crop.days.weather) or "the day of sowing"
        raise ValueError(f"crop {crop.id}: days are to be counted from {source}; count them first")
    if not 1 <= days <= 400:
        raise ValueError(f"crop {crop.id}: days {days}: allowed is 1 to 400")
    return days


def decide_rate_kg_ha(
    crop: Crop, ndvi: float | None, days: int | None = None, ndvi_nrich: float | None = None
) -> float:
    """Returns the rate of product for a canopy reading, kg/ha, from 0 to the crop's limit (paper
    A, eq 2 to 5)."""
    return prepare_rule(crop, days, ndvi_nrich).decide_rate(ndvi).rate_kg_ha


class GradeRate(NamedTuple):
    """Holds one line of a crop's rate table: NDVI above `ndvi_above` up to `ndvi_to` gets
    `rate_kg_ha`."""

    grade: int
    ndvi_above: float
    ndvi_to: float
    rate_kg_ha: float


def make_rate_table(
    crop: Crop, days: int | None = None, ndvi_nrich: float | None = None
) -> tuple[GradeRate, ...]:
    """Returns the crop's grades in rising NDVI, (low, low + width] and so on, without the zero
    grade (paper A, figure 4).

    A crop without grades is tabulated at the same edges, each line with the rate at its upper
    edge."""
    rule = prepare_rule(crop, days, ndvi_nrich)
    edges = list_grade_edges(crop.ndvi_min, crop.ndvi_top, crop.grade_width)
    lower = (crop.ndvi_min, *edges[:-1])
    return tuple(
        GradeRate(k, low, high, rule.decide_rate(high).rate_kg_ha)
        for k, (low, high) in enumerate(zip(lower, edges, strict=True), start=1)
    )


# NDVI so little above an edge still belongs to the grade below: rounding of floats.
_EDGE = 1e-9


class NdviGrade(NamedTuple):
    """Holds one of the 11 grades of paper A, section 2.1 (5): ten steps of NDVI and the zero
    grade.

    The paper's text gives a step of 0.5; its own example ((0.25, 0.3] is one grade) gives 0.05.
    `grade` 0 is the zero grade. `ndvi` is the upper edge of the grade, at which the rate is
    calculated (None in the zero grade)."""

    grade: int
    ndvi: float | None


def grade_ndvi(
    ndvi: float, low: float = 0.25, high: float = 0.75, width: float = 0.05
) -> NdviGrade:
    """Returns the grade of an NDVI: (low, low + width] is grade 1, and so on up to `high`;
    elsewhere grade 0 (paper A, section 2.1 (5)).

    Raises
    ------
    ValueError : the width is not positive."""
    if width <= 0.0:
        raise ValueError(f"grade width {width:g}: allowed is above 0")
    if not low + _EDGE < ndvi <= high + _EDGE:
        return NdviGrade(0, None)
    # The ceiling makes the upper edge belong to its grade.
    grade = math.ceil((ndvi - low) / width - _EDGE / width)
    return NdviGrade(grade, min(low + grade * width, high))


def list_grade_edges(
    low: float = 0.25, high: float = 0.75, width: float = 0.05
) -> tuple[float, ...]:
    """Returns the upper edges of grades 1, 2, ..., rounded to 1e-9: ten for the paper's values."""
    return tuple(round(low + k * width, 9) for k in range(1, round((high - low) / width) + 1))
